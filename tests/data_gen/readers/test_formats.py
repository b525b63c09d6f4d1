import contextlib
import struct

import numpy as np
import pytest

from data_gen.mesh import UnusableModelError, face_normals, texels
from data_gen.readers.load import load_model

HEADERS = {
    "a.stl": b"\0" * 80 + struct.pack("<I", 5_000_000),
    "a.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 5000000\nproperty list uchar int vertex_indices\nend_header\n",
    "a.off": b"OFF\n3 5000000 0\n",
}  # fmt: skip


@pytest.mark.parametrize("name", HEADERS)
def test_too_many_faces_are_refused_by_the_header(write, name):
    with pytest.raises(UnusableModelError, match="more than the limit"):
        load_model(write(name, HEADERS[name]))


@pytest.mark.parametrize("kind", [".stl", ".ply", ".off", ".glb", ".gltf", ".obj", ".xyzzy", ""])
def test_nonsense_is_refused(write, kind):
    for content in (b"", b"\0" * 100, b"\xff\xfe nonsense \n" * 20):
        with pytest.raises(UnusableModelError):
            load_model(write(f"a{kind}", content))


@pytest.mark.parametrize("kind", ["stl", "ply", "off", "glb", "obj"])
def test_formats_agree(trimesh, write, kind):
    data = trimesh.creation.icosphere(2).export(file_type=kind)
    model = load_model(write(f"ball.{kind}", data), up="+y", front="+z")
    assert len(model.faces) == 320
    # A ball on the ground: its top is the farthest point.
    np.testing.assert_allclose(model.vertices[:, 2].max(), 1, atol=0.02)
    np.testing.assert_allclose(model.normals, (model.corners() - [0, 0, 0.5]) * 2, atol=0.1)
    for cut in (len(data) // 3, len(data) // 2, len(data) - 10):
        with contextlib.suppress(UnusableModelError):
            load_model(write(f"cut.{kind}", data[:cut]))


def test_glb_scene_with_materials(trimesh, write):
    scene = trimesh.Scene()
    pbr = trimesh.visual.material.PBRMaterial
    for place, (factor, mode) in enumerate([([255] * 4, "OPAQUE"), ([128] * 4, "BLEND")]):
        box = trimesh.creation.box()
        box.visual = trimesh.visual.TextureVisuals(
            uv=np.zeros((8, 2)), material=pbr(baseColorFactor=factor, alphaMode=mode)
        )
        mirror = np.diag([-1.0, 1, 1, 1]) if place else np.eye(4)
        mirror[0, 3] = 3 * place
        scene.add_geometry(box, transform=mirror)
    model = load_model(write("two.glb", scene.export(file_type="glb")))
    assert len(model.faces) == 24
    assert sorted(round(m.opacity, 1) for m in model.materials) == [0.5, 1.0]
    for owner in (0, 1):  # the mirrored box is not inside out
        faces = model.faces[model.face_material == owner]
        corners = model.vertices[faces]
        outward = corners.mean(1) - corners.mean((0, 1))
        assert (outward * face_normals(model.vertices, faces)).sum(1).min() > 0


def test_vertex_colours_become_a_palette(trimesh, write):
    box = trimesh.creation.box()
    box.visual.face_colors = np.repeat([[255, 0, 0, 255], [0, 255, 0, 255]], 6, axis=0)
    model = load_model(write("box.ply", box.export(file_type="ply")))
    colours = texels(model.materials[0].texture, model.uv[:, 0])
    assert {tuple(c[:3]) for c in colours.tolist()} <= {(255, 0, 0), (0, 255, 0)}
    assert not model.materials[0].has_alpha  # two of its four texels are not used
