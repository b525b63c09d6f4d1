"""Small files that ask for much by repeating their parts, with a small budget."""

import struct

import numpy as np
import pytest
from helpers.gltf_files import SQUARE, Gltf
from helpers.obj_text import CUBE, FACES, png
from helpers.refusals import refused
from helpers.xml_models import VERTEX, dae, mesh, three_mf

from data_gen.readers import model_files
from data_gen.readers.load import load_model
from data_gen.readers.model_files import OverBudgetError

ONE = "<instance_geometry url='#g'/>"


def polygons(nodes, indices="<p>0 1 2</p>", more=""):
    return dae(mesh(f"{more}<polygons>{VERTEX}{indices}</polygons>", "0 0 0 1 0 0 0 1 0"), nodes)


def gltf(nodes=1, count=3, primitive=(), **fields):
    g = Gltf(**fields)
    part = {**g.square(None, SQUARE[:count]), **dict(primitive)}
    g.show([part] * 50)
    g.json["nodes"] = [{"mesh": 0, "weights": [k], **({"skin": 0} if fields else {})}
                       for k in range(nodes)]  # fmt: skip
    return g


def sparse():
    g = gltf(primitive={"targets": [{"POSITION": 0}] * 40})
    place = {"bufferView": g.bytes(bytes(4)), "componentType": 5121}
    change = {"count": 1, "indices": place, "values": {"bufferView": 0}}
    g.json["accessors"][0] = {"componentType": 5126, "count": 90_000, "type": "VEC3",
                              "sparse": change}  # fmt: skip
    g.json["meshes"][0]["weights"] = [1] * 40
    return g.text()


def ply(element, body):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
    head += "".join(f"property float {c}\n" for c in "xyz")
    points = np.eye(3, dtype="f4").tobytes()
    return f"{head}{element}end_header\n".encode() + points + body


COMPONENTS = "<component objectid='1'/>" * 500
LISTS = "element face {}\nproperty list uchar uchar vertex_indices\n"
STRIPS = "element tristrips 1\nproperty list int char vertex_indices\n"
STAR = np.exp(2j * np.pi * np.arange(400) / 400) * (1 + np.arange(400) % 2)
ROUND = "".join(f"v {z.real} {z.imag} 0\n" for z in STAR)
NAMES = "".join(f"newmtl {k}\nmap_Kd {'./' * k}x.png\n" for k in range(300))
USES = "".join(f"usemtl {k}\nf 1 2 3\n" for k in range(300))

BOMBS = {
    "components.3mf": three_mf(f"<object id='1'><components>{COMPONENTS}</components></object>"),
    "nodes.dae": polygons("<node id='n'>" + "<instance_node url='#n'/>" * 500 + "</node>"),
    "damaged.dae": polygons(f"<node>{ONE * 200}</node>", "<p>" + "0 1 2 " * 2000 + "x</p>"),
    "hole.dae": polygons(f"<node>{ONE}</node>", f"<ph>{'<p>' + '0 1 2 ' * 500 + '</p>'}"
                    f"{'<h>' + '0 1 2 ' * 500 + '</h>'}</ph>"),
    "empty.dae": polygons(f"<node>{ONE * 200}</node>", more="<triangles/>" * 200),
    "targets.gltf": sparse(),
    "primitives.gltf": gltf(nodes=200, count=0).text(),
    "joints.gltf": gltf(nodes=200, skins=[{"joints": [0] * 9000}]).text(),
    "strips.ply": ply(STRIPS, struct.pack("<i", 9_000) + bytes([0, 1, 2]) * 3000),
    "lists.ply": ply(LISTS.format(9) + "".join(
        f"property list uchar uchar p{k}\n" for k in range(3000)
    ), (b"\3\0\1\2" + bytes(3000) + b"\4\0\1\2\0" + b"\1\0" * 3000) * 5),
    "alternating.ply": ply(LISTS.format(9_000), b"\3\0\1\2\4\0\1\2\0" * 4500),
    "concave.obj": ROUND + ("f " + " ".join(str(k + 1) for k in range(400)) + "\n") * 4,
    "images.obj": f"mtllib images.mtl\n{CUBE}{USES}",
    "libraries.obj": "".join(f"mtllib {'./' * k}images.mtl\n" for k in range(300)) + CUBE + FACES,
}  # fmt: skip


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused(write, monkeypatch, name):
    limits = {"faces": 6000, "bytes of arrays": 16 << 20, "visits of parts": 2000}
    monkeypatch.setattr(model_files, "LIMITS", limits)
    write("x.png", png((1, 2, 3), (64, 64)))
    write("images.mtl", NAMES)
    with refused(OverBudgetError, "limit"):
        load_model(write(name, BOMBS[name]), max_faces=6000)
