import json
import struct

import numpy as np
import pytest
from PIL import Image

from data_gen.mesh import UnusableModelError, face_normals, texels
from data_gen.readers.load import load_model


def stl(count, triangles=()):
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *np.ravel(t), 0) for t in triangles)
    return b"\0" * 80 + struct.pack("<I", count) + body


HEADERS = {
    "a.stl": stl(5_000_000),
    "a.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 5000000\nproperty list uchar int vertex_indices\nend_header\n",
    "a.off": b"OFF\n3 5000000 0\n",
    "a.gltf": json.dumps(
        {"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}] * 100,
         "accessors": [{"count": 200_000}],
         "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}
    ).encode(),
}  # fmt: skip


@pytest.mark.parametrize("name", HEADERS)
def test_too_many_faces_are_refused_by_the_header(write, name):
    with pytest.raises(UnusableModelError, match="more than the limit"):
        load_model(write(name, HEADERS[name]))


@pytest.mark.parametrize(
    "name", ["a.stl", "a.ply", "a.off", "a.glb", "a.gltf", "a.obj", "a.xyzzy", "a"]
)
@pytest.mark.parametrize("content", [b"", b"\0" * 100, b"\xff\xfe nonsense \n" * 20])
def test_nonsense_is_refused(write, name, content):
    with pytest.raises(UnusableModelError):
        load_model(write(name, content))


@pytest.mark.parametrize("kind", ["stl", "ply", "off", "glb", "obj"])
def test_formats_agree(write, tmp_path, kind):
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.icosphere(2)
    path = tmp_path / f"ball.{kind}"
    mesh.export(path)
    model = load_model(path, up="+y", front="+z")
    assert len(model.faces) == 320
    # A ball on the ground: its top is the farthest point.
    np.testing.assert_allclose(model.vertices[:, 2].max(), 1, atol=0.02)
    np.testing.assert_allclose(model.normals, (model.corners() - [0, 0, 0.5]) * 2, atol=0.1)
    data = path.read_bytes()
    for cut in (len(data) // 3, len(data) // 2, len(data) - 10):
        try:
            load_model(write(f"cut.{kind}", data[:cut]))
        except UnusableModelError:
            continue


def test_glb_scene_with_materials(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    pbr = trimesh.visual.material.PBRMaterial
    for place, (factor, mode) in enumerate(
        (([255, 0, 0, 255], "OPAQUE"), ([0, 0, 255, 128], "BLEND"))
    ):
        box = trimesh.creation.box()
        box.visual = trimesh.visual.TextureVisuals(
            uv=np.zeros((8, 2)), material=pbr(baseColorFactor=factor, alphaMode=mode)
        )
        mirror = np.diag([-1.0, 1, 1, 1]) if place else np.eye(4)
        mirror[0, 3] = 3 * place
        scene.add_geometry(box, transform=mirror)
    path = tmp_path / "two.glb"
    scene.export(path)
    model = load_model(path)
    assert len(model.faces) == 24
    assert sorted(round(m.opacity, 1) for m in model.materials) == [0.5, 1.0]
    for owner in (0, 1):  # the mirrored box is not inside out
        faces = model.faces[model.face_material == owner]
        corners = model.vertices[faces]
        outward = corners.mean(1) - corners.mean((0, 1))
        assert (outward * face_normals(model.vertices, faces)).sum(1).min() > 0


def test_vertex_colours_become_a_palette(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box()
    box.visual.face_colors = np.repeat([[255, 0, 0, 255], [0, 255, 0, 255]], 6, axis=0)
    path = tmp_path / "box.ply"
    box.export(path)
    model = load_model(path)
    colours = texels(model.materials[0].texture, model.uv[:, 0])
    assert {tuple(c[:3]) for c in colours.tolist()} <= {(255, 0, 0), (0, 255, 0)}
    assert not model.materials[0].has_alpha  # two of its four texels are not used


COLLADA = """\
<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit meter="1"/><up_axis>Y_UP</up_axis></asset>
  <library_images><image id="i"><init_from>bild.png</init_from></image></library_images>
  <library_effects><effect id="e"><profile_COMMON>
    <newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
    <newparam sid="p"><sampler2D><source>s</source></sampler2D></newparam>
    <technique sid="common"><phong><diffuse><texture texture="p" texcoord="UV"/></diffuse></phong>
    </technique></profile_COMMON></effect></library_effects>
  <library_materials><material id="m" name="m"><instance_effect url="#e"/></material>
  </library_materials>
  <library_geometries><geometry id="g"><mesh>
    <source id="v"><float_array id="va" count="12">0 0 0 4 0 0 4 1 0 0 1 2</float_array>
      <technique_common><accessor source="#va" count="4" stride="3"><param name="X" type="float"/>
      <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
    </source>
    <source id="t"><float_array id="ta" count="8">0 0 1 0 1 1 0 1</float_array>
      <technique_common><accessor source="#ta" count="4" stride="2"><param name="S" type="float"/>
      <param name="T" type="float"/></accessor></technique_common></source>
    <vertices id="vs"><input semantic="POSITION" source="#v"/></vertices>
    <triangles count="2" material="mat"><input semantic="VERTEX" source="#vs" offset="0"/>
      <input semantic="TEXCOORD" source="#t" offset="1" set="0"/>
      <p>0 0 1 1 2 2 0 0 2 2 3 3</p></triangles></mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="w"><node id="n"><instance_geometry url="#g">
    <bind_material><technique_common><instance_material symbol="mat" target="#m">
    <bind_vertex_input semantic="UV" input_semantic="TEXCOORD" input_set="0"/>
    </instance_material></technique_common></bind_material></instance_geometry></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#w"/></scene>
</COLLADA>
"""


def test_collada(tmp_path):
    pytest.importorskip("trimesh")
    pytest.importorskip("collada")
    (tmp_path / "a.dae").write_text(COLLADA)
    Image.fromarray(np.full((2, 2, 3), (10, 200, 30), np.uint8)).save(tmp_path / "bild.png")
    model = load_model(tmp_path / "a.dae")
    assert len(model.faces) == 2
    extent = np.ptp(model.vertices, axis=0)
    np.testing.assert_allclose(extent / extent[2], [2, 4, 1], rtol=1e-5)
    texture = model.materials[model.face_material[0]].texture
    assert texture is not None
    assert texture[0, 0].tolist() == [10, 200, 30, 255]
    assert model.uv.max() == 1
    (tmp_path / "torn.dae").write_text(COLLADA[:-400])
    with pytest.raises(UnusableModelError, match="not readable as dae"):
        load_model(tmp_path / "torn.dae")
    (tmp_path / "bomb.dae").write_text(
        COLLADA.replace("<COLLADA", '<!DOCTYPE a [<!ENTITY b "bbbb">]><COLLADA', 1)
    )
    with pytest.raises(UnusableModelError, match="entities"):
        load_model(tmp_path / "bomb.dae")


def glb(tree):
    text = tree if isinstance(tree, bytes) else json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON")
    return head + text


DEEP = b"[" * 100_000 + b"]" * 100_000


DEEPER = b'{"asset": {"version": "2.0"}, "extras": ' + DEEP + b"}"


@pytest.mark.parametrize(
    ("name", "content"), [("a.glb", glb(DEEP)), ("a.gltf", DEEP), ("a.glb", glb(DEEPER))]
)
def test_nested_brackets_are_refused_by_name(write, name, content):
    with pytest.raises(UnusableModelError, match="brackets nested more than 64 deep"):
        load_model(write(name, content))
