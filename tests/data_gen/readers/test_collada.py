import numpy as np
import pytest
from helpers.looks import BLUE, RED, area, colours
from helpers.obj_text import RED_BLUE, png, zipped
from helpers.refusals import all_refused, check_message
from helpers.xml_models import COLOURED, HALVES, INSTANCE, VERTEX, dae, mesh, primitive, source

from data_gen.mesh import UnusableModelError
from data_gen.readers import collada
from data_gen.readers.load import load_model

SHARE = "<transparency><float>{}</float></transparency>"
TEXTURED = "<diffuse><texture texture='sa' texcoord='UV'/></diffuse>"
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


@pytest.mark.parametrize(
    ("tag", "body", "faces", "size"),
    [
        ("polylist", "<vcount>4 3</vcount><p>0 1 2 3 0 1 2</p>", 3, 1.5),
        ("polygons", "<p>0 1 2 3</p><p>0 1 2</p>", 3, 1.5),
        ("polygons", "<p>0 1 2</p><p>0 2 3</p><ph/>", 2, 1),
        ("tristrips", "<p>0 1 3 2</p><p>0 1 2</p>", 3, 1.5),
        ("trifans", "<p>0 1 2 3</p>", 2, 1),
    ],
)
def test_collada_primitives(write, tag, body, faces, size):
    flat = primitive(tag, body, "0 0 1 0 1 1 0 1").replace("count='2'", "count='4'")
    flat = flat.replace("stride='3'", "stride='2'")  # z is 0
    for geometry in (primitive(tag, body), flat):
        model = load_model(write("a.dae", dae(geometry)))
        assert (len(model.faces), area(model)) == (faces, pytest.approx(size))


@pytest.mark.parametrize(
    ("mode", "colour", "factor", "opacity"),
    [
        ("", "1 1 1 .5", "", 0.5),
        (" opaque='A_ONE'", "0 0 0 1", ".3", 0.3),
        (" opaque='RGB_ZERO'", ".4 .4 .4 1", ".5", 0.8),
        (" opaque='RGB_ZERO'", "0 0 0 1", "", 1),
        ("", "1 1 1 1", "0", 1),
        (" opaque='RGB_ONE'", ".4 .4 .4 1", "", 0.4),
        (" opaque='A_ZERO'", "1 1 1 .25", "", 0.75),
        ("", "", ".3", 1),  # it scales what is absent
        ("", "", "0", 1),
    ],
)
def test_collada_transparency(write, mode, colour, factor, opacity):
    shading = COLOURED + (SHARE.format(factor) if factor else "")
    if colour:
        shading += f"<transparent{mode}><color>{colour}</color></transparent>"
    model = load_model(write("a.dae", dae(shading=shading)))
    assert model.materials[0].opacity == pytest.approx(opacity)
    assert colours(model) == [RED] * 2


def test_collada_textures_and_colours(write):
    write("halves.png", RED_BLUE)
    bound = "<bind_vertex_input semantic='UV' input_semantic='TEXCOORD' input_set='1'/>"
    assert colours(load_model(write("a.dae", textured()))) == [RED] * 2
    assert colours(load_model(write("a.dae", textured(inputs=bound)))) == [BLUE] * 2
    glowing = TEXTURED.replace("diffuse", "emission")
    dark = "<diffuse><color>0 0 0 1</color></diffuse>"
    assert colours(load_model(write("a.dae", textured(dark + glowing)))) == [RED] * 2
    assert "emission" in load_model(write("a.dae", textured(COLOURED + glowing))).warnings[0]
    direct = textured().replace("texture='sa'", "texture='i'")
    direct = direct.replace("halves.png", "file:///C:/a/halves.png")
    assert colours(load_model(write("a.dae", direct))) == [RED] * 2
    for wrap, u, shown in (
        ("WRAP", 1.1, RED), ("MIRROR", 1.1, BLUE), ("CLAMP", 1.1, BLUE),
        ("MIRROR", 2.1, RED), ("CLAMP", 2.1, BLUE),
    ):  # fmt: skip
        text = textured().replace("<source>su", f"<wrap_s>{wrap}</wrap_s><source>su")
        path = write("a.dae", text.replace("0.1 0.5", f"{u} 0.5"))
        assert colours(load_model(path)) == [shown] * 2
    cut_out = TEXTURED + "<transparent><texture texture='sa' texcoord='UV'/></transparent>"
    write("halves.png", png((255, 0, 0, 51), mode="RGBA"))
    assert not load_model(write("a.dae", textured())).materials[0].has_alpha  # it states none
    assert load_model(write("a.dae", textured(cut_out))).materials[0].texture[0, 0, 3] == 51
    for material in (" material='m'", ""):
        assert colours(load_model(write("a.dae", painted(material=material)))) == [RED] * 2


def test_collada_nothing_vanishes(write):
    holed = "<ph><p>0 1 2</p><h>3 4 5</h></ph>"
    holed = primitive("polygons", holed, "0 0 0 9 0 0 0 9 0 1 1 0 2 1 0 1 2 0")
    model = load_model(write("a.dae", "\ufeff" + dae(holed)))
    assert (area(model), model.warnings) == (pytest.approx(40 / 81), ())
    one = mesh(HALVES.format(inputs=VERTEX, p="0 1 2"))
    broken = one.replace("'v'", "'w'").replace("#v", "#w").replace("'p'", "'q'").replace("#p", "#q")
    broken = broken.replace("'g'", "'g2'").replace("1 0 0", "1,5 0 0")
    model = load_model(write("a.dae", dae(one + broken, TWO.format("g2"))))
    check_message(model.warnings[0], "g2", "float_array")
    matrix = "<bind_shape_matrix>2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix>"
    skin = f"<skin source='#g'>{matrix}</skin>"
    moved = CONTROLLED.replace("<instance", "<translate>5 0 0</translate><instance")
    model = load_model(write("a.dae", dae(nodes=moved, more=SKIN.format(skin))))
    extent = np.ptp(model.vertices, axis=0)
    assert extent[1] / extent[2] == pytest.approx(2)
    no_scenes = dae(nodes=" ").replace("visual_scene", "x")
    for text in (dae(scene=False), no_scenes, dae().replace("?>", "?><!-- a -->")):
        assert len(load_model(write("a.dae", text)).faces) == 2
    elsewhere = load_model(write("a.dae", dae().replace("url='#s'", "url='b.dae#s'")))
    check_message(elsewhere.warnings[0], "scene", "b.dae#s")


@pytest.mark.parametrize(
    ("up", "extent"), [("Y_UP", [3, 1, 2]), ("Z_UP", [2, 1, 3]), ("X_UP", [3, 2, 1])]
)
def test_collada_axes_and_transforms(write, up, extent):
    """Extents along x, y, z of a box with the edges 1, 2, 3: toward the camera, right, up."""
    corners = " ".join(f"{x} {y} {z}" for x in (0, 1) for y in (0, 2) for z in (0, 3))
    faces = "0 1 3 0 3 2 4 6 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6 0 6 4 1 5 7 1 7 3"
    box = primitive("triangles", f"<p>{faces}</p>", corners)
    for moves in (
        "",
        "<lookat>1 2 3 1 2 -9 0 7 0</lookat>",
        # It looks along -x: its x axis is -z of the file, which the rotation undoes.
        "<lookat>1 2 3 0 2 3 0 1 0</lookat><rotate>0 1 0 -90</rotate>",
        # There and back: x += y tan 45, as the last column of a shear.
        "<skew>45 0 1 0 1 0 0</skew><matrix>1 -1 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix>",
        "<translate>1 2 3</translate><rotate>0 0 1 90</rotate><scale>1 -1 1</scale>"
        "<rotate>0 0 1 90</rotate>",
    ):
        nodes = f"<node>{moves}<instance_geometry url='#g'/></node>"
        model = load_model(write("a.dae", dae(box, nodes, up=up)))
        size = np.ptp(model.vertices, axis=0)
        np.testing.assert_allclose(size / size.min(), extent, rtol=1e-6)
        outward = model.corners() - model.vertices.mean(axis=0)
        assert (outward * model.normals).sum(axis=2).min() > 0
    instance = INSTANCE.format(target="red", inputs="")
    library = f"<library_nodes><node id='in'>{instance}</node></library_nodes>"
    text = dae(
        nodes="<node><instance_node url='#in'/><instance_node url='#in'/></node>", more=library
    )
    assert len(load_model(write("a.dae", text)).faces) == 4


def test_collada_what_is_not_read_is_named(write):
    write("halves.png", RED_BLUE)
    scaled = "<extra><technique profile='MAYA'><repeatU>2</repeatU></technique></extra></texture>"
    glowing = "<emission><color>0 0 1 1</color></emission>"
    line = HALVES.format(inputs=VERTEX, p="0 1 2") + f"<linestrips>{VERTEX}<p>0 1</p></linestrips>"
    for text, *words in (
        (dae(nodes=f"<node>{INSTANCE.format(target='x', inputs='')}</node>"), "materials", "#x"),
        (dae(mesh(line)), "lines", "g"),
        (dae(shading=glowing + COLOURED), "emission", "red"),
        (textured(TEXTURED.replace("/>", ">" + scaled)), "repeatU"),
        (dae(nodes=CONTROLLED, more=SKIN.format("<morph source='#g'/>")), "morph", "c"),
        (dae().replace("<visual_scene", "<visual_scene id='other'/><visual_scene"), "scenes", "1"),
        (dae(more="<library_animations><animation/></library_animations>"), "animations"),
    ):
        check_message(load_model(write("a.dae", text)).warnings[0], *words)


def test_collada_archives(write):
    def read(texts):
        return load_model(write("a.zae", zipped(texts)))

    inside = {"b/._a.dae": "", "b/a.dae": textured(), "b/halves.png": RED_BLUE}  # of a Mac
    assert colours(read(inside)) == [RED] * 2
    manifest = {"manifest.xml": "<dae_root>./b/a.dae#x</dae_root>"}
    assert colours(read({"a.dae": dae(scene=False)} | inside | manifest)) == [RED] * 2
    table = (({"a.dae": b" " * (9 << 20)}, "zip bomb"), ({"a.txt": b""}, ".dae"))
    all_refused(read, UnusableModelError, table)


def test_collada_refusals(write, monkeypatch):
    bomb = dae().replace("<COLLADA", '<!DOCTYPE a [<!ENTITY b "b">]><COLLADA')
    wide = bomb.replace("version='1.0'", "version='1.0' encoding='utf-16'").encode("utf-16")
    moved = "<node id='n'><translate>1,5 0 0</translate><instance_geometry url='#g'/></node>"
    monkeypatch.setattr(collada, "MAX_XML_BYTES", 50_000)
    table = (
        (dae()[:-400], "COLLADA", "XML"),
        ("<svg/>", "svg"),
        (bomb, "entities"),
        (wide, "entities"),
        (bomb.replace("ENTITY b", "ATTLIST node b CDATA"), "attributes"),
        (dae().ljust(50_001), "50001 bytes", "50000"),
        (dae(nodes="<node/>"), "no faces"),
        (dae(nodes=moved), "n (", "translate"),
    )
    all_refused(lambda text: load_model(write("a.dae", text)), UnusableModelError, table)
