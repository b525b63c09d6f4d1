"""Files that were read wrongly, in the folder PSGN_CASES; the other tests make their own."""

import os
import pathlib

import numpy as np
import pytest
from helpers.looks import BLUE, GREY, RED, WHITE, area, colours
from helpers.refusals import all_refused

from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model

CASES = pathlib.Path(os.environ.get("PSGN_CASES", "none"))
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="PSGN_CASES is no folder")

# Faces, the area, the colours, a word of a warning, and the files.
READ = [
    (6, 7 / 9, {GREY}, "", "ply/concave.ply off/concave.off collada/concave.dae"),
    (2, 1 / 4, {GREY}, "", "ply/concave_quad.ply"),
    (12, 26 / 9, {GREY}, "", "ply/tri_and_quad_binary.ply ply/tri_and_quad_ascii.ply"),
    (2, 1, {RED}, "", "ply/uv_and_vertex_colours.ply collada/no_namespace.dae"),
    (2, 1, {GREY}, "",
     "ply/uv_without_image.ply ply/blank_line_before_faces.ply ply/ascii_cr_line_ends.ply "
     "ply/latin1_comment.ply stl/cr.stl stl/long_name.stl"),
    (3, 3 / 8, {GREY}, "halves.png", "ply/tri_and_quad_texcoord.ply"),
    (2, 1, {RED}, "alpha 0", "ply/vertex_alpha_0.ply"),
    (2, 1, {RED, BLUE}, "",
     "ply/two_textures.ply mtl/latin1_names.obj gltf/specgloss_palette.gltf"),
    (4, 2 / 3, {GREY}, "", "off/poly_35.off"),
    (12, 22 / 9, {RED}, "",
     "collada/half.dae collada/xup.dae colours/coff.off colours/diffuse_red.ply "
     "colours/reference.ply colours/vcol.obj mtl/plain.obj gltf/tex.gltf"),
    (4, 2 / 9, {RED, GREY}, "#gone", "collada/missing_material.dae"),
    (4, 2, {RED, GREY}, "bind pose: c", "collada/skinned_part.dae"),
    (2, 1, {RED}, "g2", "collada/broken_second_geometry.dae"),
    (2, 1, {GREY}, "halves.png", "collada/second_uv_set.dae"),
    (12, 22 / 9, {BLUE}, "", "mtl/scale.obj gltf/textr.gltf gltf/texcoord1.gltf"),
    (12, 22 / 9, {GREY}, "", "stl/plain.stl stl/bom.stl stl/ascup.stl reasons/cr.obj"),
    (12, 22 / 9, {WHITE}, "", "gltf/plain.gltf"),
    (24, 11 / 9, {WHITE}, "", "gltf/two.gltf gltf/quant.gltf"),
    (15, 23.25 / 6.5**2, {WHITE}, "", "gltf/fanmix.gltf"),
    (12, 22 / 9, {WHITE}, "KHR_texture_basisu", "gltf/ktx2.gltf"),
    (2, 1, {WHITE}, "scenes other than the default",
     "gltf/bom.gltf gltf/wrong_file/chair.gltf"),
    (4, 2 / 16, {WHITE}, "", "gltf/mesh_and_camera_in_one_node.gltf"),
    (2, 2 / 4, {WHITE}, "", "gltf/morph_default_weight.gltf"),
    (4, 4 / 9, {WHITE}, "", "gltf/skin_scaled_joint.gltf"),
    (2, 1, {(0.39, 0.47, 0.55)}, "specularGlossinessTexture", "gltf/specgloss_4096px.gltf"),
    (4, 2 / 9, {WHITE, (0.95, 0.95, 0.95)}, "", "gltf/white_by_default.gltf"),
    (2, 1, {WHITE}, "",
     "gltf/meshopt.gltf gltf/chain_300.gltf gltf/buffer_query.gltf gltf/trailing.glb"),
    (12, 22 / 9, {RED}, "opacity 0", "reasons/tr1.obj"),
    (2, 2.5 / 9, {(0.64, 0.2, 0.2)}, "", "second/dae_transparency_alone.dae"),
    (1, 0.5, {(0.8, 0, 0)}, "opacity 0", "second/mtl_d0_everywhere.obj"),
    (2, 1, {RED, GREY}, "", "second/obj_usemtl_without_name.obj"),
    (3, 1.5, {GREY}, "", "second/off_faces_over_lines.off"),
    (4, 1, {GREY}, "", "second/3mf_root_custom_ending.3mf"),
    (2, 2.5 / 9, {GREY}, "'m'",
     "second/dae_own_name_in_url.dae second/dae_lookat.dae second/zae_manifest.zae "
     "second/dae_up_axis_of_visual_scene.dae"),
]  # fmt: skip

REFUSED = (
    ("ply/truncated.ply", "4 announced, 1"),
    ("gltf/draco_mixed.gltf", "KHR_draco_mesh_compression"),
    ("reasons/draco.gltf", "KHR_draco_mesh_compression"),
    ("reasons/v1.gltf", "glTF 1.0"),
    ("reasons/lfs.obj", "Git LFS"),
    ("reasons/zeroidx.obj", "index 0"),
    ("second/3mf_unknown_required.3mf", "http://example.org/volumes/2030"),
    ("second/3mf_slices_lowres.3mf", "slice"),
)


@pytest.mark.parametrize(
    ("faces", "size", "shown", "word", "name"),
    [(*row, name) for *row, names in READ for name in names.split()],
)
def test_cases_that_are_read(faces, size, shown, word, name):
    if name == "gltf/meshopt.gltf":
        pytest.importorskip("meshoptimizer")
    model = load_model(CASES / name)
    assert (len(model.faces), set(colours(model))) == (faces, shown)
    assert area(model) == pytest.approx(size, abs=1e-3)
    assert word in " ".join(model.warnings)
    assert word or model.warnings == ()
    if "up_axis" in name:  # z becomes y
        size = np.ptp(model.vertices, axis=0)
        np.testing.assert_allclose(size / size.min(), [2, 1, 3])


def test_cases_that_are_refused():
    all_refused(lambda name: load_model(CASES / name), UnusableModelError, REFUSED)
