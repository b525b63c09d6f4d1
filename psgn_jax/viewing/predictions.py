"""Reads the NPZ files of `psgn predict` and `Prediction.save`."""

import math
import os
import zipfile
from collections.abc import Sequence

import numpy as np

from psgn_jax.data import schema
from psgn_jax.system.errors import UserError
from psgn_jax.system.untrusted import kind_of, one_line, read_npz

VERSION = 1
"""Version of the NPZ and JSON files of a prediction."""

# Types and shape of each field; a letter stands for any size, the same in all fields.
_FIELDS = {
    "points": ("f", "kn3"),
    "colours": ("uint8", "kn3"),
    "seen": ("bool", "kn"),
    "branch": ("uint8", "n"),
    "image": ("uint8", "hw3"),
    "photo": ("uint8", "ab3"),
    "intrinsics": ("f", "33"),
    "extrinsics": ("f", "34"),
    "to_view": ("f", "33"),
}
MOST_CLOUDS = 64
_LARGEST = {"k": MOST_CLOUDS, "n": 1 << 14, "h": 2048, "w": 2048, "a": 2048, "b": 2048}


class PredictionFileError(UserError):
    """A file is not a prediction, or is damaged."""


def read_prediction(path: str | os.PathLike[str], fields: Sequence[str]) -> dict[str, np.ndarray]:
    """The arrays `fields` of a prediction; nothing is unpickled.

    Raises:
      PredictionFileError: the file is missing, of another kind or damaged.
    """
    shown = one_line(path)
    try:
        if kind_of(path) is None and not zipfile.is_zipfile(path):
            raise PredictionFileError(
                f"{shown} is not a prediction: expected a file NAME.npz of `psgn predict`"
            )
        limits = {
            name: math.prod(_LARGEST.get(c) or int(c) for c in _FIELDS[name][1]) for name in fields
        }
        arrays = read_npz(path, {**limits, "version": 1})
        if (version := arrays.pop("version", VERSION)) != VERSION:
            raise PredictionFileError(
                f"{shown} was made by a later version of psgn_jax: its version is {version}, this "
                f"one reads {VERSION}; predict again, or use a newer psgn_jax"
            )
        for name in fields:
            if name not in arrays:
                raise ValueError(f"it has no array {name!r}")
            if arrays[name].dtype.kind == "f":
                arrays[name] = arrays[name].astype(np.float32)
                if not np.isfinite(arrays[name]).all():
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
        kind, letters = _FIELDS[name]
        fits = array.ndim == len(letters) and all(
            0 < n <= _LARGEST.get(a, n) and sizes.setdefault(a, n) == n
            for a, n in zip(letters, array.shape, strict=True)
        )
        if not fits or kind not in (array.dtype.kind, array.dtype.name):
            most = ", ".join(f"{a} up to {_LARGEST[a]}" for a in letters if a in _LARGEST)
            raise PredictionFileError(
                f"{shown}: {name} is {array.dtype} {list(array.shape)}, expected "
                f"{'float' if kind == 'f' else kind} [{', '.join(letters)}]"
                + (f" with {most}" if most else "")
            )
    if "branch" in arrays and arrays["branch"].max() > 1:
        raise PredictionFileError(f"{shown}: branch is {arrays['branch'].max()}, expected 0 or 1")
    if "to_view" in arrays:
        (across, *rest), (skew, down, _), last = arrays["to_view"].tolist()
        if not (across > 0 and down > 0 and [rest[0], skew, *last] == [0, 0, 0, 0, 1]):
            raise PredictionFileError(f"{shown}: to_view is no scale and shift")
    if {"intrinsics", "extrinsics"} <= arrays.keys():
        try:
            schema.check_camera(arrays["intrinsics"], arrays["extrinsics"])
        except ValueError as error:
            raise PredictionFileError(f"{shown}: {one_line(error)}") from None
    return arrays
