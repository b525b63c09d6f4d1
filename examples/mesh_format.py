"""A format of meshes: RAW, a line of nine numbers for each triangle.

In the package: a reader of the bytes in `data_gen/readers/`; its suffix in `READERS` of
`data_gen/readers/load.py`, then catalogues find such files; its column in the table of features in
`docs/rendering.md`
"""

from typing import Any

import numpy as np

from data_gen.mesh import UnusableModelError, check_face_count
from data_gen.readers.load import READERS
from data_gen.readers.textures import Assets


def read_raw(data: bytes, assets: Assets) -> dict[str, Any]:
    """The arrays of a file, for `mesh.build_model`; `assets` opens files that this one names."""
    check_face_count(data.count(b"\n"), assets.max_faces)
    try:
        corners = np.array([line.split() for line in data.decode().splitlines()], np.float64)
    except ValueError as error:
        raise UnusableModelError(f"not readable as raw: {error}") from None
    if corners.ndim != 2 or corners.shape[1] != 9:
        raise UnusableModelError("not readable as raw: expected nine numbers a line")
    return {"vertices": corners, "faces": np.arange(3 * len(corners))}


READERS["raw"] = read_raw
