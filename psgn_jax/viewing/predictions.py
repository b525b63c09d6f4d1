"""Reads the NPZ files that `psgn_jax.predict` writes."""

import os
import zipfile
import zlib
from collections.abc import Sequence

import numpy as np

from psgn_jax.config import UserError
from psgn_jax.data import schema
from psgn_jax.untrusted import kind_of, one_line

_BROKEN = (zipfile.BadZipFile, zlib.error)

_MAX_BYTES = 1 << 28  # of an array

# Kinds of dtypes and shape of each field; a letter stands for any size, the same in all fields.
_FIELDS = {
    "points": ("f", "kn3"),
    "colours": ("u", "kn3"),
    "branch": ("ub", "n"),
    "image": ("u", "hw3"),
    "intrinsics": ("f", "33"),
    "extrinsics": ("f", "34"),
}


class PredictionFileError(UserError):
    """A file is not a prediction, or is damaged."""


def read_prediction(path: str | os.PathLike[str], fields: Sequence[str]) -> dict[str, np.ndarray]:
    """Some arrays of a prediction, see `prediction.export`; nothing is unpickled.

    Args:
      path: path of the NPZ file.
      fields: any of points [k, n, 3], colours [k, n, 3], branch [n], image [h, w, 3],
        intrinsics [3, 3] and extrinsics [3, 4].

    Raises:
      PredictionFileError: the file is missing, of another kind or damaged.
    """
    shown = one_line(path)
    try:
        kind = kind_of(path)
        if kind is not None:
            raise PredictionFileError(f"{shown} is {kind}, expected a file NAME.npz")
        if not zipfile.is_zipfile(path):
            raise PredictionFileError(
                f"{shown} is not a prediction: expected a file NAME.npz of psgn_jax.predict"
            )
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: _read(archive, name) for name in fields}
    except PredictionFileError:
        raise
    except FileNotFoundError:
        raise PredictionFileError(f"{shown}: no such file") from None
    except OSError as error:
        raise PredictionFileError(f"{shown}: {error.strerror or error}") from None
    # RuntimeError includes the NotImplementedError of an unknown compression.
    except (ValueError, KeyError, TypeError, EOFError, RuntimeError, *_BROKEN) as error:
        why = one_line(error.args[0] if error.args else error)[:160]
        raise PredictionFileError(f"{shown} is damaged, or not a prediction: {why}") from None
    sizes: dict[str, int] = {str(digit): digit for digit in range(10)}
    for name, array in arrays.items():
        dtype, letters = _FIELDS[name]
        if (
            array.dtype.kind not in dtype
            or array.ndim != len(letters)
            or 0 in array.shape
            or any(sizes.setdefault(a, n) != n for a, n in zip(letters, array.shape, strict=True))
        ):
            raise PredictionFileError(
                f"{shown}: {name} is {array.dtype} {list(array.shape)}, expected "
                f"{'float' if dtype == 'f' else 'uint8'} [{', '.join(letters)}]"
            )
    if {"intrinsics", "extrinsics"} <= arrays.keys():
        try:
            schema.check_camera(arrays["intrinsics"], arrays["extrinsics"])
        except ValueError as error:
            raise PredictionFileError(f"{shown}: {one_line(error)}") from None
    return arrays


def _read(archive: np.lib.npyio.NpzFile, name: str) -> np.ndarray:
    if name not in archive.files:
        raise KeyError(f"it has no array {name!r}")
    assert archive.zip is not None  # while it is open
    size = archive.zip.getinfo(f"{name}.npy").file_size
    if size > _MAX_BYTES:
        raise ValueError(f"{name} takes {size} bytes, expected at most {_MAX_BYTES}")
    try:
        array: np.ndarray = archive[name]
    except ValueError as error:
        # NumPy's message advises to allow pickles, which would execute code from the file.
        raise ValueError(f"{name} is not an array of numbers") from error
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise ValueError(f"{name} is not finite")
    return array
