import random
import re

import pytest

from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model

# Words of Python and its libraries, which a reason must not have.
PYTHON = (
    r"\w+(Error|Exception)\b|object has no|<_io|NoneType|literal|could not convert|out of bounds"
)


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


@pytest.mark.parametrize("kind", ["obj", "ply", "ascii.ply", "off", "stl", "ascii.stl", "dae"])
def test_broken_files_are_refused_or_read(trimesh, write, kind):
    box, ending = trimesh.creation.box(), kind.rpartition(".")[2]
    box.visual.vertex_colors = [255, 0, 0, 255]
    if kind == "dae":
        data = trimesh.exchange.dae.export_collada(box)
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
