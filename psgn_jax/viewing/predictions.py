"""Reads the NPZ files that `psgn_jax.commands.predict` writes."""

import os
import zipfile
from collections.abc import Sequence

import numpy as np

from psgn_jax.data import schema
from psgn_jax.system.errors import UserError
from psgn_jax.system.untrusted import kind_of, one_line, read_npz

_MOST = 1 << 25  # numbers of an array

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
    """The arrays `fields` (names of `_FIELDS`) of a prediction; nothing is unpickled.

    Raises:
      PredictionFileError: the file is missing, of another kind or damaged.
    """
    shown = one_line(path)
    try:
        if kind_of(path) is None and not zipfile.is_zipfile(path):
            raise PredictionFileError(
                f"{shown} is not a prediction: expected a file NAME.npz of `psgn predict`"
            )
        arrays = read_npz(path, dict.fromkeys(fields, _MOST))
        for name in fields:
            if name not in arrays:
                raise ValueError(f"it has no array {name!r}")
            if arrays[name].dtype.kind == "f" and not np.isfinite(arrays[name]).all():
                raise ValueError(f"{name} is not finite")
    except PredictionFileError:
        raise
    except FileNotFoundError:
        raise PredictionFileError(f"{shown}: no such file") from None
    except OSError as error:
        raise PredictionFileError(f"{shown}: {error.strerror or error}") from None
    except ValueError as error:
        why = one_line(error)[:160]
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
