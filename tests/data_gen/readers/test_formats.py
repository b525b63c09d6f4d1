import random
import re

import numpy as np
import pytest

from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model

# Words of Python and its libraries, which a reason must not have.
PYTHON = r"\w+(Error|Exception)\b|object has no|<_io|NoneType|literal|not convert|out of bounds"


def broken(data, rng):
    """The bytes cut off, or with some of them changed, removed, repeated or inserted."""
    place, more = rng.randrange(len(data)), rng.randbytes(rng.randrange(1, 9))
    stop = place + rng.randrange(1, 40)
    match rng.randrange(5):
        case 0:
            return data[:place]
        case 1:
            return data[:place] + more + data[place + len(more) :]
        case 2:
            return data[:place] + data[stop:]
        case 3:
            return data[:stop] + data[place:]
    return data[:place] + bytes(rng.choices(b"0123456789.-e ", k=3)) + data[place + 3 :]


DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Y_UP</up_axis></asset><library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="24">{}</float_array><technique_common>
<accessor source="#a" count="8" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{}</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize("kind", ["obj", "ply", "ascii.ply", "off", "stl", "ascii.stl", "dae"])
def test_broken_files_are_refused_or_read(trimesh, write, kind):
    box, ending = trimesh.creation.box(), kind.rpartition(".")[2]
    box.visual.vertex_colors = [255, 0, 0, 255]
    if kind == "dae":
        numbers = (" ".join(map(str, values.ravel())) for values in (box.vertices, box.faces))
        data = DAE.format(*numbers)
    elif kind == "ascii.stl":
        data = trimesh.exchange.stl.export_stl_ascii(box).encode()
    elif kind == "ascii.ply":
        data = trimesh.exchange.ply.export_ply(box, encoding="ascii")
    else:
        data = box.export(file_type=kind)
    data = data if isinstance(data, bytes) else data.encode()
    rng, reasons = random.Random(0), []
    for _ in range(120):
        path = write(f"a.{ending}", broken(data, rng))
        try:
            load_model(path)
        except UnusableModelError as error:
            reasons.append(str(error))
    assert len(reasons) > 20
    assert [reason for reason in reasons if re.search(PYTHON, reason)] == []


@pytest.mark.parametrize("kind", ["stl", "ply", "off", "glb", "obj"])
def test_formats_agree(trimesh, write, kind):
    data = trimesh.creation.icosphere(2).export(file_type=kind)
    model = load_model(write(f"ball.{kind}", data), up="+y", front="+z")
    assert len(model.faces) == 320
    # A ball on the ground: its top is the farthest point.
    np.testing.assert_allclose(model.vertices[:, 2].max(), 1, atol=0.02)
    np.testing.assert_allclose(model.normals, (model.corners() - [0, 0, 0.5]) * 2, atol=0.1)
