import zipfile

import numpy as np
import pytest
from helpers.features import outcome, promised
from helpers.looks import BLUE, GREY, RED, area, colours
from helpers.obj_text import RED_BLUE, png

from data_gen.mesh import UnusableModelError
from data_gen.readers import collada
from data_gen.readers.load import load_model
from data_gen.readers.parts import Part, placed

HALVES = "<triangles count='2' material='m'>{inputs}<p>{p}</p></triangles>"
VERTEX = "<input semantic='VERTEX' source='#v' offset='0'/>"
INSTANCE = (
    "<instance_geometry url='#g'><bind_material><technique_common><instance_material symbol='m' "
    "target='#{target}'>{inputs}</instance_material></technique_common></bind_material>"
    "</instance_geometry>"
)
U = "0 0 0 3 0 0 3 3 0 2 3 0 2 1 0 1 1 0 1 3 0 0 3 0"
COLOURED = "<diffuse><color>1 0 0 1</color></diffuse>"
SHARE = "<transparency><float>{}</float></transparency>"
TEXTURED = "<diffuse><texture texture='sa' texcoord='UV'/></diffuse>"


def source(name, numbers, stride=3):
    params = "".join(f"<param name='{c}' type='float'/>" for c in "XYZW"[:stride])
    count = len(numbers.split())
    return (
        f"<source id='{name}'><float_array id='{name}a' count='{count}'>{numbers}</float_array>"
        f"<technique_common><accessor source='#{name}a' count='{count // stride}' "
        f"stride='{stride}'>{params}</accessor></technique_common></source>"
    )


def mesh(primitives, points="0 0 0 1 0 0 1 1 0 0 1 0", more="", name="g"):
    vertices = "<vertices id='v'><input semantic='POSITION' source='#p'/></vertices>"
    inside = f"{source('p', points)}{more}{vertices}{primitives}"
    return f"<geometry id='{name}'><mesh>{inside}</mesh></geometry>"


def dae(
    geometry=None, nodes=None, shading=COLOURED, more="", up="Y_UP", shader="lambert", scene=True
):
    geometry = geometry or mesh(HALVES.format(inputs=VERTEX, p="0 1 2 0 2 3"))
    nodes = nodes or f"<node id='n'>{INSTANCE.format(target='red', inputs='')}</node>"
    used = "<scene><instance_visual_scene url='#s'/></scene>" if scene else ""
    return (
        "<?xml version='1.0'?><COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' "
        f"version='1.4.1'><asset><up_axis>{up}</up_axis></asset>"
        "<library_images><image id='i'><init_from>halves.png</init_from></image></library_images>"
        "<library_effects><effect id='e'><profile_COMMON>"
        "<newparam sid='su'><surface type='2D'><init_from>i</init_from></surface></newparam>"
        "<newparam sid='sa'><sampler2D><source>su</source></sampler2D></newparam>"
        f"<technique sid='c'><{shader}>{shading}</{shader}></technique></profile_COMMON></effect>"
        "</library_effects><library_materials><material id='red'><instance_effect url='#e'/>"
        f"</material></library_materials><library_geometries>{geometry}</library_geometries>{more}"
        f"<library_visual_scenes><visual_scene id='s'>{nodes}</visual_scene>"
        f"</library_visual_scenes>{used}</COLLADA>"
    )


def primitive(tag, body, points="0 0 0 1 0 0 1 1 0 0 1 0"):
    return mesh(f"<{tag} count='1'>{VERTEX}{body}</{tag}>", points)


OTHER = "<visual_scene id='other'/>"
CONCAVE = primitive("polylist", "<vcount>8</vcount><p>0 1 2 3 4 5 6 7</p>", U)
SKIN = "<library_controllers><controller id='c'>{}</controller></library_controllers>"
CONTROLLED = "<node id='n'><instance_controller url='#c'/></node>"
TWO = f"<node>{INSTANCE.format(target='red', inputs='')}<instance_geometry url='#{{}}'/></node>"
UV = "<input semantic='TEXCOORD' source='#{}' offset='{}' set='{}'/>"
COLOR = "<input semantic='COLOR' source='#k' offset='0'/>"
RED_CORNERS = source("k", "1 0 0 " * 4)


def painted(shading=COLOURED, material=" material='m'"):
    inside = f"<triangles{material}>{VERTEX}{COLOR}<p>0 1 2 0 2 3</p></triangles>"
    return dae(mesh(inside, more=RED_CORNERS), shading=shading)


def textured(shading=TEXTURED, inputs="", shader="lambert"):
    """Coordinates of set 0 in the left half of the texture, of set 1 in the right half."""
    sets = source("a", "0.1 0.5 " * 4, 2) + source("b", "0.9 0.5 " * 4, 2)
    both = VERTEX + UV.format("a", 0, 0) + UV.format("b", 0, 1)
    body = HALVES.format(inputs=both, p="0 1 2 0 2 3")
    nodes = f"<node>{INSTANCE.format(target='red', inputs=inputs)}</node>"
    return dae(mesh(body, more=sets), nodes, shading, shader=shader)


def wrapped(mode):
    return textured().replace("<source>su", f"<wrap_s>{mode}</wrap_s><source>su")


def test_features_are_read_as_the_table_says(write):
    write("halves.png", RED_BLUE)
    scaled = "<extra><technique profile='MAYA'><repeatU>2</repeatU></technique></extra></texture>"
    texts = {
        "concave polygons": dae(CONCAVE),
        "faces with missing vertices": dae(primitive("triangles", "<p>0 1 2 0 1 9</p>")),
        "missing materials": dae(nodes=f"<node>{INSTANCE.format(target='x', inputs='')}</node>"),
        "missing textures": textured().replace("halves.png", "gone.png"),
        "coordinates that are not finite": dae(primitive("triangles", "<p>0 1 2</p>", "nan " + U)),
        "colours of vertices": painted(),
        "colours of faces with a texture": painted(TEXTURED),
        "several sets of texture coordinates": textured(),
        "a byte-order mark": "\ufeff" + dae(),
        "strips and fans of triangles": dae(primitive("tristrips", "<p>0 1 3 2</p>")),
        "polygons with holes": dae(primitive(
            "polygons", "<ph><p>0 1 2</p><h>3 4 5</h></ph>", "0 0 0 9 0 0 0 9 0 1 1 0 2 1 0 1 2 0"
        )),
        "lines and points": dae(mesh(
            HALVES.format(inputs=VERTEX, p="0 1 2") + f"<linestrips>{VERTEX}<p>0 1</p></linestrips>"
        )),
        "transparency": dae(shading=COLOURED + SHARE.format(0.5)),
        "normal maps, emission, maps of roughness": dae(
            shading="<emission><color>0 0 1 1</color></emission>" + COLOURED
        ),
        "transforms of textures": textured(TEXTURED.replace("/>", ">" + scaled)),
        "textures that do not repeat": wrapped("CLAMP"),
        "skins": dae(nodes=CONTROLLED, more=SKIN.format("<skin source='#g'/>")),
        "morph targets": dae(nodes=CONTROLLED, more=SKIN.format("<morph source='#g'/>")),
        "parts that are damaged": dae(
            mesh(HALVES.format(inputs=VERTEX, p="0 1 2"))
            + mesh("", name="g2").replace("mesh>", "spline>"),
            TWO.format("g2"),
        ),
        "scenes other than the default": dae().replace("<visual_scene", OTHER + "<visual_scene"),
        "animations": dae(more="<library_animations><animation/></library_animations>"),
        "cut-off files": dae()[:-400],
    }  # fmt: skip
    assert {f: outcome(write("a.dae", text)) for f, text in texts.items()} == promised("COLLADA")


@pytest.mark.parametrize(
    ("geometry", "faces", "size"),
    [
        (primitive("triangles", "<p>0 1 2 0 2 3</p>"), 2, 1),
        (primitive("polylist", "<vcount>4 3</vcount><p>0 1 2 3 0 1 2</p>"), 3, 1.5),
        (CONCAVE, 6, 7 / 9),
        (primitive("polygons", "<p>0 1 2 3</p><p>0 1 2</p>"), 3, 1.5),
        (primitive("tristrips", "<p>0 1 3 2</p><p>0 1 2</p>"), 3, 1.5),
        (primitive("trifans", "<p>0 1 2 3</p>"), 2, 1),
        (
            primitive(
                "polygons", "<ph><p>0 1 2 3</p><h>4 5 6 7</h></ph>",
                "0 0 0 4 0 0 4 4 0 0 4 0 1 1 0 3 1 0 3 3 0 1 3 0",
            ), 8, 12 / 16,
        ),
    ],
)  # fmt: skip
def test_collada_primitives(write, geometry, faces, size):
    model = load_model(write("a.dae", dae(geometry)))
    assert (len(model.faces), area(model)) == (faces, pytest.approx(size))


@pytest.mark.parametrize(
    ("shading", "opacity"),
    [
        ("<transparency><float>.3</float></transparency>", 0.3),
        ("<transparent><color>1 1 1 .5</color></transparent>", 0.5),
        ("<transparent opaque='A_ONE'><color>0 0 0 1</color></transparent>"
         "<transparency><float>.3</float></transparency>", 0.3),
        ("<transparent opaque='RGB_ZERO'><color>.4 .4 .4 1</color></transparent>"
         "<transparency><float>.5</float></transparency>", 0.8),
        ("<transparent opaque='RGB_ZERO'><color>0 0 0 1</color></transparent>", 1),
        ("<transparent><color>1 1 1 1</color></transparent>"
         "<transparency><float>0</float></transparency>", 1),
        ("<transparent opaque='RGB_ONE'><color>.4 .4 .4 1</color></transparent>", 0.4),
        ("<transparent opaque='A_ZERO'><color>1 1 1 .25</color></transparent>", 0.75),
    ],
)  # fmt: skip
def test_collada_transparency(write, shading, opacity):
    model = load_model(write("a.dae", dae(shading=COLOURED + shading)))
    assert model.materials[0].opacity == pytest.approx(opacity)
    assert colours(model) == [RED] * 2


def test_collada_textures_and_colours(write):
    write("halves.png", RED_BLUE)
    bound = "<bind_vertex_input semantic='UV' input_semantic='TEXCOORD' input_set='1'/>"
    assert colours(load_model(write("a.dae", textured()))) == [RED] * 2
    assert colours(load_model(write("a.dae", textured(inputs=bound)))) == [BLUE] * 2
    direct = textured().replace("texture='sa'", "texture='i'")
    direct = direct.replace("halves.png", "file:///C:/a/halves.png")
    assert colours(load_model(write("a.dae", direct))) == [RED] * 2
    for wrap, u, shown in (
        ("WRAP", 1.1, RED), ("MIRROR", 1.1, BLUE), ("CLAMP", 1.1, BLUE),
        ("MIRROR", 2.1, RED), ("CLAMP", 2.1, BLUE),
    ):  # fmt: skip
        path = write("a.dae", wrapped(wrap).replace("0.1 0.5", f"{u} 0.5"))
        assert colours(load_model(path)) == [shown] * 2
    cut_out = TEXTURED + "<transparent><texture texture='sa' texcoord='UV'/></transparent>"
    write("halves.png", png((255, 0, 0, 51), mode="RGBA"))
    assert not load_model(write("a.dae", textured())).materials[0].has_alpha  # it states none
    assert load_model(write("a.dae", textured(cut_out))).materials[0].texture[0, 0, 3] == 51
    for material, shown in ((" material='m'", RED), ("", RED)):
        assert colours(load_model(write("a.dae", painted(material=material)))) == [shown] * 2


def test_collada_nothing_vanishes(write):
    missing = dae(nodes=TWO.format("g") + f"<node>{INSTANCE.format(target='x', inputs='')}</node>")
    model = load_model(write("a.dae", missing))
    assert sorted(set(colours(model))) == [GREY, RED]
    assert "materials missing, grey is used" in model.warnings[0]
    assert "'#x' is not in the file" in model.warnings[0]
    one = mesh(HALVES.format(inputs=VERTEX, p="0 1 2"))
    broken = one.replace("'v'", "'w'").replace("#v", "#w").replace("'p'", "'q'").replace("#p", "#q")
    broken = broken.replace("'g'", "'g2'").replace("1 0 0", "1,5 0 0")
    model = load_model(write("a.dae", dae(one + broken, TWO.format("g2"))))
    assert "g2 (a word in <float_array> that is not a number" in model.warnings[0]
    matrix = "<bind_shape_matrix>2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix>"
    skin = f"<skin source='#g'>{matrix}</skin>"
    moved = CONTROLLED.replace("<instance", "<translate>5 0 0</translate><instance")
    model = load_model(write("a.dae", dae(nodes=moved, more=SKIN.format(skin))))
    assert model.warnings[0] == "skins are read in bind pose: c"
    extent = np.ptp(model.vertices, axis=0)
    assert extent[1] / extent[2] == pytest.approx(2)
    no_scenes = dae(nodes=" ").replace("visual_scene", "x")
    no_namespace, comment = dae().replace("xmlns=", "x="), dae().replace("?>", "?><!-- a -->")
    empty_hole = dae(primitive("polygons", "<p>0 1 2</p><p>0 2 3</p><ph/>"))
    for text in (dae(scene=False), no_scenes, no_namespace, comment, empty_hole):
        assert len(load_model(write("a.dae", text)).faces) == 2
    elsewhere = load_model(write("a.dae", dae().replace("url='#s'", "url='#t'")))
    assert elsewhere.warnings[0] == "no scene, the first one or all geometries are read: #t"


def test_primitives_that_share_an_array_keep_what_they_use(rng):
    points, corners = rng.random((100, 3)), np.array([7, 99, 3, 7, -1, 100])
    part = placed(Part(points, np.array([3, 3]), corners), np.eye(4)[None])
    np.testing.assert_array_equal(part.vertices, points[[3, 7, 99]])
    assert part.corners.tolist() == [1, 2, 0, 1, -1, -1]


@pytest.mark.parametrize(
    ("up", "extent"), [("Y_UP", [3, 1, 2]), ("Z_UP", [2, 1, 3]), ("X_UP", [3, 2, 1])]
)
def test_collada_axes_and_transforms(write, up, extent):
    """Extents along x, y, z of a box with the edges 1, 2, 3: toward the camera, right, up."""
    corners = " ".join(f"{x} {y} {z}" for x in (0, 1) for y in (0, 2) for z in (0, 3))
    faces = "0 1 3 0 3 2 4 6 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6 0 6 4 1 5 7 1 7 3"
    box = primitive("triangles", f"<p>{faces}</p>", corners)
    nodes = (
        "<node><translate>1 2 3</translate><rotate>0 0 1 90</rotate><node><scale>-1 1 1</scale>"
        "<rotate>0 0 1 -90</rotate><instance_geometry url='#g'/></node></node>"
    )
    for text in (
        dae(box, nodes, up=up),
        dae(box, "<node><instance_geometry url='#g'/></node>", up=up),
    ):
        model = load_model(write("a.dae", text))
        size = np.ptp(model.vertices, axis=0)
        np.testing.assert_allclose(size / size.min(), extent)
        outward = model.corners() - model.vertices.mean(axis=0)
        assert (outward * model.normals).sum(axis=2).min() > 0
    instance = INSTANCE.format(target="red", inputs="")
    library = f"<library_nodes><node id='in'>{instance}</node></library_nodes>"
    text = dae(
        nodes="<node><instance_node url='#in'/><instance_node url='#in'/></node>", more=library
    )
    assert len(load_model(write("a.dae", text)).faces) == 4


def test_collada_archives(write, tmp_path):
    write("halves.png", RED_BLUE)
    for texts, words in (
        ({"b/a.dae": textured(), "b/halves.png": RED_BLUE}, None),
        ({"a.dae": b" " * (9 << 20)}, "zip bomb"),
        ({"a.txt": b""}, "no .dae file"),
    ):
        with zipfile.ZipFile(tmp_path / "a.zae", "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in texts.items():
                archive.writestr(name, content)
        if words is None:
            assert colours(load_model(tmp_path / "a.zae")) == [RED] * 2
            continue
        with pytest.raises(UnusableModelError, match=words):
            load_model(tmp_path / "a.zae")


def test_collada_refusals(write, monkeypatch):
    bomb = dae().replace("<COLLADA", '<!DOCTYPE a [<!ENTITY b "b">]><COLLADA')
    wide = bomb.replace("version='1.0'", "version='1.0' encoding='utf-16'").encode("utf-16")
    monkeypatch.setattr(collada, "MAX_XML_BYTES", 50_000)
    monkeypatch.setattr(collada, "_MAX_NODES", 100)
    for words, text in {
        "not readable as COLLADA: XML": dae()[:-400],
        "kind of|XML with <svg>": "<svg/>",
        "XML entities are refused": bomb,
        "entities": wide,
        "the XML file: 50001 bytes are more than": dae().ljust(50_001),
        "nodes that contain themselves": dae(nodes="<node id='n'><instance_node url='#n'/></node>"),
        "no faces": dae(nodes="<node/>"),
        r"empty: parts not readable, left out: n \(a word in <translate> that is not": dae(
            nodes="<node id='n'><translate>1,5 0 0</translate><instance_geometry url='#g'/></node>"
        ),
        "all faces are transparent": dae(shading=COLOURED + SHARE.format(0)),
    }.items():
        with pytest.raises(UnusableModelError, match=words):
            load_model(write("a.dae", text))
