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

# Faces, the area, the colours, and a word of a warning.
READ = {
    "ply/concave.ply": (6, 7 / 9, {GREY}, ""),
    "ply/concave_quad.ply": (2, 1 / 4, {GREY}, ""),
    "ply/tri_and_quad_binary.ply": (12, 26 / 9, {GREY}, ""),
    "ply/tri_and_quad_ascii.ply": (12, 26 / 9, {GREY}, ""),
    "ply/uv_and_vertex_colours.ply": (2, 1, {RED}, ""),
    "ply/uv_without_image.ply": (2, 1, {GREY}, ""),
    "ply/blank_line_before_faces.ply": (2, 1, {GREY}, ""),
    "ply/ascii_cr_line_ends.ply": (2, 1, {GREY}, ""),
    "ply/latin1_comment.ply": (2, 1, {GREY}, ""),
    "ply/tri_and_quad_texcoord.ply": (3, 3 / 8, {GREY}, "halves.png"),
    "ply/vertex_alpha_0.ply": (2, 1, {RED}, "alpha 0"),
    "ply/two_textures.ply": (2, 1, {RED, BLUE}, ""),
    "off/concave.off": (6, 7 / 9, {GREY}, ""),
    "off/poly_35.off": (4, 2 / 3, {GREY}, ""),
    "collada/concave.dae": (6, 7 / 9, {GREY}, ""),
    "collada/half.dae": (12, 22 / 9, {RED}, ""),
    "collada/xup.dae": (12, 22 / 9, {RED}, ""),
    "collada/missing_material.dae": (4, 2 / 9, {RED, GREY}, "#gone"),
    "collada/skinned_part.dae": (4, 2, {RED, GREY}, "bind pose: c"),
    "collada/broken_second_geometry.dae": (2, 1, {RED}, "g2"),
    "collada/second_uv_set.dae": (2, 1, {GREY}, "halves.png"),
    "collada/no_namespace.dae": (2, 1, {RED}, ""),
    "colours/coff.off": (12, 22 / 9, {RED}, ""),
    "colours/diffuse_red.ply": (12, 22 / 9, {RED}, ""),
    "colours/reference.ply": (12, 22 / 9, {RED}, ""),
    "colours/vcol.obj": (12, 22 / 9, {RED}, ""),
    "mtl/plain.obj": (12, 22 / 9, {RED}, ""),
    "mtl/scale.obj": (12, 22 / 9, {BLUE}, ""),
    "mtl/latin1_names.obj": (2, 1, {RED, BLUE}, ""),
    "stl/plain.stl": (12, 22 / 9, {GREY}, ""),
    "stl/bom.stl": (12, 22 / 9, {GREY}, ""),
    "stl/ascup.stl": (12, 22 / 9, {GREY}, ""),
    "stl/cr.stl": (2, 1, {GREY}, ""),
    "stl/long_name.stl": (2, 1, {GREY}, ""),
    "reasons/cr.obj": (12, 22 / 9, {GREY}, ""),
    "gltf/plain.gltf": (12, 22 / 9, {WHITE}, ""),
    "gltf/two.gltf": (24, 11 / 9, {WHITE}, ""),
    "gltf/quant.gltf": (24, 11 / 9, {WHITE}, ""),
    "gltf/fanmix.gltf": (15, 23.25 / 6.5**2, {WHITE}, ""),
    "gltf/tex.gltf": (12, 22 / 9, {RED}, ""),
    "gltf/textr.gltf": (12, 22 / 9, {BLUE}, ""),
    "gltf/texcoord1.gltf": (12, 22 / 9, {BLUE}, ""),
    "gltf/ktx2.gltf": (12, 22 / 9, {WHITE}, "KHR_texture_basisu"),
    "gltf/bom.gltf": (2, 1, {WHITE}, "scenes other than the default"),
    "gltf/wrong_file/chair.gltf": (2, 1, {WHITE}, "scenes other than the default"),
    "gltf/mesh_and_camera_in_one_node.gltf": (4, 2 / 16, {WHITE}, ""),
    "gltf/morph_default_weight.gltf": (2, 2 / 4, {WHITE}, ""),
    "gltf/skin_scaled_joint.gltf": (4, 4 / 9, {WHITE}, ""),
    "gltf/specgloss_palette.gltf": (2, 1, {RED, BLUE}, ""),
    "gltf/specgloss_4096px.gltf": (2, 1, {(0.39, 0.47, 0.55)}, "specularGlossinessTexture"),
    "gltf/white_by_default.gltf": (4, 2 / 9, {WHITE, (0.95, 0.95, 0.95)}, ""),
    "gltf/meshopt.gltf": (2, 1, {WHITE}, ""),
    "gltf/chain_300.gltf": (2, 1, {WHITE}, ""),
    "gltf/buffer_query.gltf": (2, 1, {WHITE}, ""),
    "gltf/trailing.glb": (2, 1, {WHITE}, ""),
    "reasons/tr1.obj": (12, 22 / 9, {RED}, "opacity 0"),
    "second/dae_transparency_alone.dae": (2, 2.5 / 9, {(0.64, 0.2, 0.2)}, ""),
    "second/mtl_d0_everywhere.obj": (1, 0.5, {(0.8, 0, 0)}, "opacity 0"),
    "second/obj_usemtl_without_name.obj": (2, 1, {RED, GREY}, ""),
    "second/off_faces_over_lines.off": (3, 1.5, {GREY}, ""),
    "second/3mf_root_custom_ending.3mf": (4, 1, {GREY}, ""),
    "second/dae_own_name_in_url.dae": (2, 2.5 / 9, {GREY}, "'m'"),
    "second/dae_lookat.dae": (2, 2.5 / 9, {GREY}, "'m'"),
    "second/zae_manifest.zae": (2, 2.5 / 9, {GREY}, "'m'"),
    "second/dae_up_axis_of_visual_scene.dae": (2, 2.5 / 9, {GREY}, "'m'"),
}

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


@pytest.mark.parametrize("name", READ)
def test_cases_that_are_read(name):
    if name == "gltf/meshopt.gltf":
        pytest.importorskip("meshoptimizer")
    faces, size, shown, word = READ[name]
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
