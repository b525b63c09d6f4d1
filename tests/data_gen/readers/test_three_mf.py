import numpy as np
import pytest
from helpers.looks import area
from helpers.refusals import all_refused, check_message, refused
from helpers.xml_models import SHAPE, three_mf

from data_gen.mesh import UnusableModelError, face_normals
from data_gen.readers.load import load_model

TWO = (
    "<object id='2'><components><component objectid='1' transform='-1 0 0 0 1 0 0 0 1 -1 0 0'/>"
    "<component objectid='1' p:path='/3D/b.model'/></components></object>"
)

SUPPORT = SHAPE.replace("id='1'", "id='2' type='support'")


def test_3mf_places_and_parts_in_other_files(write):
    model = load_model(write("a.3mf", three_mf()))
    assert (len(model.faces), model.warnings) == (4, ())
    moved = "<item objectid='2' transform='2 0 0 0 1 0 0 0 1 5 5 5'/>"
    model = load_model(write("a.3mf", three_mf(SHAPE + TWO, moved)))
    assert len(model.faces) == 8
    size = np.ptp(model.vertices, axis=0)
    # The longest is from -2 to 1, stretched by 2.
    np.testing.assert_allclose(np.sort(size / size.min()), [1, 1, 6])
    for faces in (model.faces[:4], model.faces[4:]):  # the mirrored one is not inside out
        corners = model.vertices[faces]
        outward = corners.mean(axis=1) - corners.mean(axis=(0, 1))
        assert (outward * face_normals(model.vertices, faces)).sum(axis=1).min() > 0


def test_3mf_what_is_not_read_is_named_or_refused(write):
    lattice = SHAPE.replace("</mesh>", "<beamlattice/></mesh>")
    for content, *words in (
        (three_mf(SHAPE.replace("v3='1'", "v3='1' pid='7'")), "colours and textures"),
        (three_mf(items="<item objectid='1'/><item objectid='9'/>"), "objects", "9"),
        (three_mf(lattice), "beamlattice"),
        (three_mf(SHAPE + SUPPORT, "<item objectid='1'/><item objectid='2'/>"), "supports", "2"),
        (three_mf(settings="<part subtype='negative_part'/>"), "cuts", "Metadata/"),
        (three_mf(SHAPE.replace("id=", "p:meshresolution='lowres' id=")), "slices", "1"),
        (three_mf(SHAPE + "<object id='2'><booleanshape/></object>"), "booleanshape"),
    ):
        (line,) = load_model(write("a.3mf", content)).warnings
        check_message(line, *words)
    table = (
        (three_mf(items=""), "no faces"),
        (three_mf(SHAPE.replace("v1='0'", "v1='9'")), "vertices"),
        (three_mf(head="<!DOCTYPE a [<!ENTITY b 'b'>]>"), "entities"),
        (three_mf(SHAPE[:-3]), "3MF", "XML"),
        (three_mf()[:300], "3MF", "damaged"),
        (three_mf(SHAPE.replace("v1='0'", "v1='a'")), "number"),
    )
    all_refused(lambda content: load_model(write("a.3mf", content)), UnusableModelError, table)
    with refused(UnusableModelError, "4 faces", "limit of 3"):
        load_model(write("a.3mf", three_mf()), max_faces=3)
    assert area(load_model(write("a.3mf", three_mf()))) == pytest.approx(1.5 + 3**0.5 / 2)
