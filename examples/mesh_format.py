"""A format of meshes: RAW, a line of nine numbers for each triangle."""

import numpy as np

from data_gen.readers.load import READERS
from data_gen.readers.model_files import DamagedError, numbers
from data_gen.readers.parts import Part
from data_gen.readers.textures import Assets


def read_raw(data: bytes, assets: Assets) -> list[Part]:
    """The triangles of a file; `assets` opens files that this one names, and takes warnings."""
    assets.budget.charge(faces=data.count(b"\n"))
    corners = numbers([line.split() for line in data.decode().splitlines()])
    if corners.ndim != 2 or corners.shape[1] != 9:
        raise DamagedError("expected nine numbers a line")
    count = len(corners)
    return [Part(corners.reshape(-1, 3), np.full(count, 3), np.arange(3 * count))]


READERS["raw"] = read_raw
