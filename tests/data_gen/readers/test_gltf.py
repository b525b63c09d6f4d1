"""Each case is a small file with what must be read of it.

The first cases have the names of public files that were read wrongly, the others those of models in
Khronos' glTF-Sample-Assets, whose features they have.
"""

import importlib.util
import json
import re
import sys
import urllib.parse

import numpy as np
import pytest
from helpers.gltf_files import CORNERS, SQUARE, TWO, Gltf
from helpers.looks import area, colours
from helpers.obj_text import RED_BLUE, picture, zipped
from helpers.refusals import all_refused, refused

from data_gen.mesh import UnusableModelError, face_normals, opacity_at
from data_gen.readers.load import load_model
from data_gen.readers.model_files import ZipFiles

ASIDE = CORNERS + np.float32([0.5, 0])
RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)
R, G, B, W = (tuple(c / 255 for c in colour) for colour in (RED, GREEN, BLUE, WHITE))
CASES = {}


def case(name="", **expected):
    """Registers a function that makes a file (text, bytes, or names with contents) as a case."""

    def register(make):
        CASES[name or make.__name__] = make, expected
        return make

    return register


def at(x=0, y=0, z=0):
    """The positions of a square elsewhere."""
    return SQUARE + np.float32([x, y, z])


def relative(lengths):
    return np.abs(lengths) / np.abs(lengths).max()


def extents(model):
    """In the axes of the file, as multiples of the largest."""
    return relative(np.ptp(model.vertices, axis=0)[[1, 2, 0]])


def opacities(model):
    """The opacity at the middle of each face."""
    count = len(model.faces)
    return opacity_at(model, np.arange(count), np.full((count, 3), 1 / 3)).tolist()


def textured(g, image=RED_BLUE, *, texture=None, sampler=None, **attributes):
    """A square with a texture; of the usual one, the first triangle is red, the second blue."""
    info = {"index": g.image(image, **(sampler or {})), **(texture or {})}
    return painted(g, {"baseColorTexture": info}, **{"TEXCOORD_0": CORNERS, **attributes})


def painted(g, factors=None, fields=None, **attributes):
    """A square with a material."""
    materials = g.json.setdefault("materials", [])
    materials.append({"pbrMetallicRoughness": factors or {}, **(fields or {})})
    return g.square(**attributes) | {"material": len(materials) - 1}


# --- Files that were read wrongly ---------------------------------------------------------------


def draco(garbage=False):
    DracoPy = pytest.importorskip("DracoPy")
    data = DracoPy.encode(at(2), TWO.reshape(2, 3), preserve_order=True)
    g = Gltf(extensionsRequired=["KHR_draco_mesh_compression"])
    view = g.bytes(data[:-9] if garbage else data)
    for kind, width, count in ((5126, "VEC3", 4), (5123, "SCALAR", 6)):
        g.json["accessors"].append({"componentType": kind, "count": count, "type": width})
    names = {"bufferView": view, "attributes": {"POSITION": 0}}
    packed = {"attributes": {"POSITION": 0}, "indices": 1,
              "extensions": {"KHR_draco_mesh_compression": names}}  # fmt: skip
    return g.show([g.square(), packed]).text()


case("draco_mixed", faces=4, extents=(3, 1, 0))(lambda _: draco())


@case(colours=[W, W], warns=("extensions not read", "textures not"))
def ktx2(_):
    g = Gltf(extensionsRequired=["KHR_texture_basisu"])
    g.show([textured(g, b"\xabKTX 20\xbb")])
    g.json["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]
    return g.text()


@case(faces=4, extents=(3, 3, 0), area=4 / 9)
def skin_scaled_joint(_):
    g = Gltf(skins=[{"joints": [2], "inverseBindMatrices": 0}])
    g.array(np.eye(4, dtype="f4").reshape(1, 16))
    share = np.tile(np.array([[2, 0, 0, 0]], "f4"), (4, 1))
    skinned = g.square(JOINTS_0=np.zeros((4, 4), "u1"), WEIGHTS_0=share)
    g.show([skinned], skin=0, translation=[7, 7, 7])
    g.show([g.square()], translation=[2, 0, 0])
    g.json["nodes"].append({"scale": [1, 3, 1]})
    return g.text()


@case(colours=[(0.73, 0, 0), (0, 0, 0.73)])
def specular_glossiness(g):
    glossy = {"diffuseTexture": {"index": g.image(RED_BLUE)}}
    glossy["diffuseFactor"] = [0.5, 1, 0.5, 1]
    fields = {"extensions": {"KHR_materials_pbrSpecularGlossiness": glossy}}
    return g.show([painted(g, fields=fields, TEXCOORD_0=CORNERS)]).text()


@case(colours=[R, B])
def data_without_base64(g):
    g.show([textured(g)])
    g.json["images"] = [{"uri": "data:image/png," + urllib.parse.quote(RED_BLUE)}]
    return g.text()


case("bom", area=1)(lambda g: "\ufeff" + g.show([g.square()]).text())
case("trailing", extents=(1, 1, 0))(lambda g: {"a.glb": g.show([g.square()]).glb() + b"junkjunk"})
case("animations", warns=("animations not read",))(
    lambda _: changed(animations=[{"channels": [], "samplers": []}])
)
case("missing texture", colours=[W, W], warns=("textures missing",))(
    lambda g: g.show([textured(g)]).text().replace('"bufferView": 0, "mimeType"', '"uri": "a", "b"')
)

# --- Models of glTF-Sample-Assets ---------------------------------------------------------------


BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], "f4") - np.float32(0.5)
SIDES = ("0132", "4675", "0451", "2376", "0264", "1573")
BOX_FACES = np.array([[int(side[k]) for k in (0, 1, 2, 0, 2, 3)] for side in SIDES], "u2")


def box(g, **attributes):
    return g.square(BOX_FACES.ravel(), BOX, **attributes)


@case("BoxInterleaved", faces=12, area=6)
def box_interleaved(g):
    view = g.bytes(np.hstack([BOX, BOX]).tobytes(), byteStride=24)
    for offset in (12, 0):
        g.json["accessors"].append({"bufferView": view, "byteOffset": offset, "count": 8,
                                    "componentType": 5126, "type": "VEC3"})  # fmt: skip
    return g.show([g.square(BOX_FACES.ravel(), 1, NORMAL=0)]).text()


@case("UnicodeTest", colours=[R, B])
def unicode_and_spaces(g):
    g.show([textured(g)])
    g.json["images"] = [{"uri": "Unicode%E2%9D%A4 %E2%99%BBTexture.png"}]
    text = g.text("Unicode❤%20♻Binary.bin")
    return {"a b/Unicode❤♻Test.gltf": text, "a b/Unicode❤ ♻Binary.bin": g.data,
            "a b/Unicode❤ ♻Texture.png": RED_BLUE}  # fmt: skip


@case(colours=[(0.730, 0.730, 0), (0.730, 0.832, 0)])
def box_vertex_colours(g):
    paint = np.array([[1, 0, 0], [0.5, 0.5, 0], [0, 1, 0], [2.5, 0.5, -1]], "f4")
    return g.show([g.square(COLOR_0=paint)]).text()


case("colours of vertices times a texture", colours=[(0.73, 0, 0), (0, 0, 0)])(
    lambda g: g.show([textured(g, COLOR_0=np.array([[0.5, 1, 0, 1]] * 4, "f4"))]).text()
)

case("MultipleScenes", warns=("scenes other than the default",))(
    lambda _: changed(nodes=[{}, {"mesh": 0}], scenes=[{"nodes": [0]}, {"nodes": [1]}], scene=1)
)


@case("MorphPrimitivesTest", faces=4, extents=(2, 1.5, 0))
def morph_primitives(g):
    up = np.array([[0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 1, 0]], "f4")
    targets = [{"POSITION": g.array(up)}, {"POSITION": g.array(up[:, [1, 0, 2]])}]
    g.show([g.square() | {"targets": targets}, g.square(positions=at(1))])
    g.json["meshes"][0]["weights"] = [0.5, 0]
    return g.text()


@case("SimpleSkin", extents=(1, 2, 0))
def simple_skin(_):
    g = Gltf(skins=[{"joints": [1, 2], "inverseBindMatrices": 0}])
    bind = np.tile(np.eye(4, dtype="f4"), (2, 1, 1))
    bind[1, 3, 1] = -1  # column after column: y - 1
    g.array(bind.reshape(2, 16))
    upper = (SQUARE[:, 1:2] * [0, 1, 0, 0]).astype("u2")
    share = (SQUARE[:, 1:2] * [-255, 255, 0, 0] + [255, 0, 0, 0]).astype("u1")
    joints = np.where(share > 0, [0, 1, 0, 0], 0).astype("u2") + upper * 0
    skinned = g.square(JOINTS_0=joints, WEIGHTS_0=share)
    g.show([skinned], skin=0)
    # The upper joint is a unit above the place that its matrix states.
    g.json["nodes"] += [{"children": [2]}, {"translation": [0, 2, 0]}]
    return g.text()


@case("SimpleSparseAccessor", faces=4, area=1)
def sparse(g):
    change = {"count": 2, "indices": {"bufferView": g.bytes(bytes([2, 3])), "componentType": 5121},
              "values": {"bufferView": g.bytes((2 * SQUARE[2:]).tobytes())}}  # fmt: skip
    flat = g.array(SQUARE * np.float32([1, 0, 0]), sparse=change)
    nothing = {"componentType": 5126, "count": 4, "type": "VEC3", "sparse": {
        "count": 4, "indices": {"bufferView": g.bytes(bytes(range(4))), "componentType": 5121},
        "values": {"bufferView": g.bytes(at(1).tobytes())}}}  # fmt: skip
    g.json["accessors"].append(nothing)
    return g.show([g.square(positions=flat), g.square(positions=1)]).text()


@case("SimpleInstancing", faces=6, extents=(6, 2, 0))
def instances(_):
    g = Gltf(extensionsRequired=["EXT_mesh_gpu_instancing"])
    moves = np.array([[0, 0, 0], [2, 0, 0], [6, 0, 0]], "f4")
    scales = np.array([[1, 1, 1], [1, 1, 1], [-1, 2, 1]], "f4")
    placed = {"TRANSLATION": g.array(moves), "SCALE": g.array(scales)}
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": placed}}
    return g.show([g.square()], extensions=instancing, translation=[9, 9, 9]).text()


@case(faces=6, extents=(6, 6, 0), colours=[R, B] * 3)
def quantised_coordinates_and_turned_instances(_):
    g = Gltf(extensionsRequired=["EXT_mesh_gpu_instancing", "KHR_mesh_quantization"])
    turns = np.array([[0, 0, 0, 127], [0, 0, 90, 90], [0, 0, 127, 0]], "i1")
    moves = {"TRANSLATION": g.array(np.array([[1, 0, 0], [0, 1, 0], [-1, -1, 0]], "f4"))}
    placed = moves | {"ROTATION": g.array(turns, normalized=True)}
    # Positions of a square of edge 2 as plain bytes, texture coordinates as fractions.
    part = textured(g, positions=(2 * SQUARE).astype("i1"),
                    TEXCOORD_0=g.array((255 * CORNERS).astype("u1"), normalized=True))  # fmt: skip
    return g.show([part], extensions={"EXT_mesh_gpu_instancing": {"attributes": placed}}).text()


case("MultiUVTest", faces=4, colours=[R, B, B, R])(
    lambda g: g.show([
        textured(g, TEXCOORD_1=ASIDE),
        textured(g, texture={"texCoord": 1}, positions=at(2), TEXCOORD_1=ASIDE),
    ]).text()
)  # fmt: skip


# A texture of four colours, whose columns are asked for beyond its right border.
COLUMNS = picture([[RED, GREEN, BLUE, WHITE]])


def beyond(wrap, start):
    g = Gltf()
    narrow = CORNERS * [0.03, 1] + np.array([start, 0])  # within one column
    return g.show([textured(g, COLUMNS, sampler={"wrapS": wrap}, TEXCOORD_0=narrow)]).text()


for way, wrap, start, shown in (
    ("repeat", 10497, 1.1, R), ("clamp", 33071, 1.3, W), ("clamp below", 33071, -2.7, R),
    ("mirror", 33648, 1.3, B),
):  # fmt: skip
    case(f"TextureSettingsTest: {way}", colours=[shown] * 2)(
        lambda _, wrap=wrap, start=start: beyond(wrap, start)
    )


# Its four quarters, and coordinates at a point of the first.
QUARTERS = picture([[RED, GREEN], [BLUE, WHITE]])


def transformed(transform, place=(0.25, 0.25)):
    g = Gltf(extensionsUsed=["KHR_texture_transform"])
    moved = {"extensions": {"KHR_texture_transform": transform}}
    there = np.tile(np.array([place], "f4"), (4, 1))
    sets = {"TEXCOORD_0": there, "TEXCOORD_1": there + np.float32([0, 0.5])}
    return g.show([textured(g, QUARTERS, texture=moved, **sets)]).text()


for name, shown, *how in (
    ("TextureTransformTest: offset", B, {"offset": [0, 0.5]}),
    # By a quarter: u becomes v, and v becomes -u, which is at the lower border.
    ("TextureTransformTest: rotation", B, {"rotation": np.pi / 2}),
    ("TextureTransformTest: scale", W, {"scale": [3, 3]}),
    # Scaled to (.75, .25), turned to (.25, -.75), moved to (.75, .25).
    ("TextureTransformTest: all", G, {"scale": [3, 1], "rotation": np.pi / 2, "offset": [0.5, 1]}),
    ("TextureTransformMultiTest", B, {"texCoord": 1}),
    ("TextureCoordinateTest", G, {}, (0.75, 0.25)),  # the first row is at v = 0, above
):
    case(name, colours=[shown] * 2)(lambda _, how=how: transformed(*how))


@case("AlphaBlendModeTest", faces=8, opacities=[1, 1, 0.4, 0.4, 1, 1, 1, 1])
def alpha_modes(_):
    g, parts = Gltf(), []
    modes = ({}, {"alphaMode": "BLEND"}, {"alphaMode": "MASK", "alphaCutoff": 0.3},
             {"alphaMode": "OPAQUE", "doubleSided": True})  # fmt: skip
    for place, mode in enumerate(modes):
        parts.append(painted(g, {"baseColorFactor": [1, 1, 1, 0.4]}, mode, positions=at(z=place)))
    return g.show(parts).text()


@case("CompareAlphaCoverage", opacities=[0, 1])
def alpha_mask(g):
    part = textured(g, picture([[(*RED, 100), (*BLUE, 200)]]))
    g.json["materials"][0]["alphaMode"] = "MASK"
    return g.show([part]).text()


case("the alpha of an opaque texture", opacities=[1, 1])(
    lambda g: g.show([textured(g, picture([[(*RED, 0), (*BLUE, 200)]]))]).text()
)

case("UnlitTest", colours=[(1, 0.73, 0), (1, 0.73, 0)])(
    lambda g: g.show([painted(
        g, {"baseColorFactor": [1, 0.5, 0, 1]}, {"extensions": {"KHR_materials_unlit": {}}}
    )]).text()
)  # fmt: skip


@case("NormalTangentTest", colours=[R, B],
      warns=("parts of materials not read: normalTexture, emissiveFactor, me",))  # fmt: skip
def normal_map(g):
    part = textured(g)
    g.json["materials"][0] |= {"normalTexture": {"index": 0}, "emissiveFactor": [0, 0, 1]}
    g.json["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": 0}
    return g.show([part]).text()


@case("WebP", colours=[R, B])
def webp(_):
    g = Gltf(extensionsRequired=["EXT_texture_webp"])
    g.show([textured(g, picture([[RED, BLUE]], "WEBP", lossless=True))])
    g.json["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
    return g.text()


@case(faces=7, warns=("lines, points",))
def modes(g):
    strip = g.square(np.array([0, 1, 2, 3], "u1"))  # (0 1 2) (2 1 3)
    fan = g.square(np.array([0, 1, 3, 2], "u4"))
    longer = np.vstack([SQUARE, [[0, 2, 0]]]).astype("f4")
    parts = [g.square() | {"mode": mode} for mode in range(4)]
    parts += [strip | {"mode": 5}, fan | {"mode": 6}, g.square(None, longer) | {"mode": 5}]
    return g.show(parts).text()


def packed_by_meshopt(mode="ATTRIBUTES"):
    meshoptimizer = pytest.importorskip("meshoptimizer")
    g = Gltf(extensionsRequired=["EXT_meshopt_compression"])
    g.json["buffers"].append({"byteLength": 72, "extensions": {"EXT_meshopt_compression": {}}})
    corners = meshoptimizer.encode_index_buffer(TWO.astype("u4"), 6, 4)
    encoded = (
        (meshoptimizer.encode_vertex_buffer(SQUARE, 4, 12), "VEC3", 5126, 12, 4, mode),
        (corners, "SCALAR", 5125, 4, 6, "TRIANGLES"),
    )
    for data, width, code, stride, count, kind in encoded:
        length, start = len(data), len(g.data) + -len(g.data) % 4
        packed = {"buffer": 0, "byteOffset": start, "byteLength": length, "byteStride": stride,
                  "mode": kind, "count": count}  # fmt: skip
        g.bytes(bytes(data), extensions={"EXT_meshopt_compression": packed}, buffer=1)
        view = {"bufferView": len(g.json["bufferViews"]) - 1, "componentType": code}
        g.json["accessors"].append({**view, "count": count, "type": width})
    part = {"attributes": {"POSITION": 0}, "indices": 1}
    return g.show([part]).text()


case("MeshoptCubeTest", area=1)(lambda _: packed_by_meshopt())


@pytest.mark.parametrize("name", CASES)
def test_case(write, name):
    make, expected = CASES[name]
    content = make(Gltf())
    files = content if isinstance(content, dict) else {f"{name}.gltf": content}
    first, *_ = [write(file, data) for file, data in files.items()]
    model = load_model(first)
    assert len(model.faces) == expected.get("faces", 2)
    if "extents" in expected:
        np.testing.assert_allclose(extents(model), relative(expected["extents"]), atol=1e-5)
    for name, measure, tolerance in (
        ("area", area, 1e-5), ("colours", colours, 0.006), ("opacities", opacities, 0.005)
    ):  # fmt: skip
        if name in expected:
            np.testing.assert_allclose(measure(model), expected[name], atol=tolerance)
    assert [w for w in model.warnings if not w.startswith(expected.get("warns", "none"))] == []
    assert bool(model.warnings) == ("warns" in expected)


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1], [-1, -2, 1], [-1, -2, -3]])
def test_negative_scales_leave_the_outside_outside(write, scale):
    """Khronos' NegativeScaleTest and OrientationTest."""
    g = Gltf()
    turned = {"rotation": [0, 0.5**0.5, 0, 0.5**0.5], "translation": [5, 0, 0]}
    with_normals = box(g, NORMAL=BOX / np.float32(0.75**0.5))
    path = write("a.glb", g.show([with_normals], [box(g)], scale=scale, **turned).glb())
    model = load_model(path)
    outward = model.corners() - model.vertices.mean(axis=0)
    flat = face_normals(model.vertices, model.faces)[:, None]
    assert (outward * flat).sum(axis=2).min() > 0
    assert (outward * model.normals).sum(axis=2).min() > 0
    # Its x is now -z, which the second axis of the file's frame does not see.
    np.testing.assert_allclose(extents(model), relative(scale[::-1]), atol=1e-6)


@pytest.mark.parametrize("size", [1, 1e-7])
def test_normals_of_the_file_are_kept(write, size):
    g = Gltf()
    tilted = np.tile(np.array([[0.6, 0, 0.8]], "f4"), (4, 1))
    scale = [size, size, 2 * size]
    model = load_model(write("a.gltf", g.show([g.square(NORMAL=tilted)], scale=scale).text()))
    # The plane through it is stretched along z: the normal becomes (.6, 0, .4) before its length.
    np.testing.assert_allclose(model.normals[0, 0], np.array([0.4, 0.6, 0]) / 0.52**0.5, atol=1e-6)


def changed(**fields):
    """A square whose JSON has other fields, or its first objects of these lists."""
    g = Gltf()
    g.show([g.square()])
    for key, value in fields.items():
        old = g.json.get(key)
        g.json[key] = [{**old[0], **value[0]}, *(value[1:] or old[1:])] if old and value else value
    return g.text()


def test_files_that_are_refused_with_the_reason(write):
    bare = '"bufferView": 0, '
    table = [
        (changed().replace('"byteLength": 12', '"byteLength": 1012'), "bufferViews[1]", "1060"),
        (changed(accessors=[{"count": 5}]), "accessors[0]"),
        (changed(accessors=[{"count": -1}]), "accessors[0].count", "-1"),
        (changed(accessors=[{"componentType": 5124}]), "accessors[0]", "componentType"),
        (changed(accessors=[{"type": "VEC2"}]), "accessors[0]", "VEC2"),
        (changed(accessors=[{"count": 399_999_999}]).replace(bare, ""), "4799999988 bytes"),
        (changed(accessors=[{"count": 9_999_999}]).replace(bare, "").replace('"indices"', '"none"'),
         "3333333 faces", "400000"),
        (changed(accessors=[{"bufferView": 7}]), "bufferViews[7]"),
        (changed(accessors=[{"count": 3}]), "vertices"),
        (changed(nodes=[{"children": [0]}], scenes=[{"nodes": [0]}]), "cycle"),
        (changed(nodes=[{"mesh": 0}, *[{"children": [0]}] * 2]), "nodes[0]"),
        (changed(nodes=[{"scale": "1"}]), "nodes[0].scale", "'1'", "3 numbers"),
        (changed(nodes=[{"mesh": 4}]), "meshes[4]"),
        (changed(nodes=[{"extensions": {"EXT_mesh_gpu_instancing": 3}}]), "mesh_gpu_instancing"),
        (changed(extensionsRequired=["A_ropes"]), "A_ropes"),
        (changed().replace("AAAAAAAA", "AADAfwAA", 1), "finite"),
        (re.sub("base64,[^\"]*", "base64,A", changed()), "URI"),
        (changed().replace('"count": 4', '"count": NaN'), "JSON", "NaN"),
        ("[" * 100 + "]" * 100, "JSON", "64"),
        ("nonsense", "JSON", "line 1, column 1"),
        (skin_scaled_joint(0).replace("WEIGHTS", "W"), "primitives[0]", "WEIGHTS_0"),
        ("[]", "JSON"),
        ('{"asset": {"version": "1.0"}, "meshes": {}}', "glTF 1.0", "2.0"),
        (b"glTF\1\0\0\0", "glTF 1", "2.0"),
        ("{}", "asset.version", "2.0"),
        (draco(garbage=True), "KHR_draco_mesh_compression"),
    ]  # fmt: skip
    whole = Gltf()
    whole = whole.show([whole.square()]).glb()
    table += [(whole[:k], "glTF") for k in [*range(4, len(whole) - 1, 17), len(whole) - 2]]
    if importlib.util.find_spec("meshoptimizer"):
        table.append((packed_by_meshopt("ROPES"), "EXT_meshopt_compression"))
    all_refused(lambda text: load_model(write("a.gltf", text)), UnusableModelError, table)


def test_packages_that_are_not_installed_are_named(write, monkeypatch):
    table = ((draco(), "KHR_draco_mesh", "psgn-jax[gltf]"),)
    if importlib.util.find_spec("meshoptimizer"):
        table += ((packed_by_meshopt(), "EXT_meshopt", "psgn-jax[gltf]"),)
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    all_refused(lambda text: load_model(write("a.gltf", text)), UnusableModelError, table)


def test_a_missing_buffer_is_unreadable_in_a_folder_and_refused_in_an_archive(write):
    g = Gltf()
    path = write("a.gltf", g.show([g.square()]).text("gone.bin"))
    with refused(UnusableModelError, "gone.bin") as caught:
        load_model(path)
    assert caught.value.status == "unreadable"
    archive = ZipFiles(write("a.zip", zipped({"a.gltf": path.read_bytes()})))
    with refused(UnusableModelError, "gone.bin") as caught:
        load_model("a.gltf", archive)
    assert caught.value.status == "refused"
    write("a.gltf", g.text("../gone.bin"))
    write("../gone.bin", g.data)
    with refused(UnusableModelError, "gone.bin"):
        load_model(path)
    write("gone.bin", g.data)
    for uri in (" gone.bin", "%20gone.bin ", " " + json.loads(g.text())["buffers"][0]["uri"]):
        assert len(load_model(write("a.gltf", g.text(uri))).faces) == 2
