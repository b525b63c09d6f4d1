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
    "spread": ("f", "kn"),
    "image": ("uint8", "hw3"),
    "photo": ("uint8", "ab3"),
    "intrinsics": ("f", "33"),
    "extrinsics": ("f", "34"),
    "to_view": ("f", "33"),
}
_OPTIONAL = ("spread",)  # networks without a random input, and earlier versions, have none
MOST_CLOUDS = 64
_LARGEST = {"k": MOST_CLOUDS, "n": 1 << 18, "h": 2048, "w": 2048, "a": 2048, "b": 2048}
_MOST_NUMBERS = 1 << 24  # in one array


class PredictionFileError(UserError):
    """A file is not a prediction, or is damaged."""


def read_prediction(path: str | os.PathLike[str], fields: Sequence[str]) -> dict[str, np.ndarray]:
    """The arrays `fields` of a prediction, and `spread` if it has one; nothing is unpickled.

    Raises:
      PredictionFileError: the file is missing, of another kind or damaged.
    """
    shown = one_line(path)
    try:
        if kind_of(path) is None and not zipfile.is_zipfile(path):
            raise ValueError("expected a file NAME.npz of `psgn predict`")
        limits = {
            name: min(_MOST_NUMBERS, math.prod(_LARGEST.get(c) or int(c) for c in _FIELDS[name][1]))
            for name in (*fields, *_OPTIONAL)
        }
        arrays = read_npz(path, {**limits, "version": 1})
        _check(arrays, [*fields, *(name for name in _OPTIONAL if name in arrays)])
    except FileNotFoundError:
        raise PredictionFileError(f"{shown}: no such file") from None
    except OSError as error:
        raise PredictionFileError(f"{shown}: {error.strerror or error}") from None
    except ValueError as error:
        why = one_line(error)[:160]
        raise PredictionFileError(f"{shown} cannot be read as a prediction: {why}") from None
    return arrays


def _check(arrays: dict[str, np.ndarray], fields: Sequence[str]) -> None:
    """Raises a `ValueError` if arrays are not a prediction; removes its version."""
    if (version := arrays.pop("version", VERSION)) != VERSION:
        raise ValueError(
            f"it was made by a later version of psgn_jax: its version is {version}, this one reads "
            f"{VERSION}; predict again, or use a newer psgn_jax"
        )
    sizes = {str(digit): digit for digit in range(10)}
    for name in fields:
        if name not in arrays:
            raise ValueError(f"it has no array {name!r}")
        array, (kind, letters) = arrays[name], _FIELDS[name]
        fits = array.ndim == len(letters) and all(
            0 < n <= _LARGEST.get(a, n) and sizes.setdefault(a, n) == n
            for a, n in zip(letters, array.shape, strict=True)
        )
        if not fits or kind not in (array.dtype.kind, array.dtype.name):
            most = ", ".join(f"{a} up to {_LARGEST[a]}" for a in letters if a in _LARGEST)
            raise ValueError(
                f"{name} is {array.dtype} {list(array.shape)}, expected "
                f"{'float' if kind == 'f' else kind} [{', '.join(letters)}]"
                + (f" with {most}" if most else "")
            )
        if kind == "f":
            arrays[name] = array.astype(np.float32)
            if not np.isfinite(arrays[name]).all():
                raise ValueError(f"{name} is not finite")
    if "branch" in fields and arrays["branch"].max() > 1:
        raise ValueError(f"branch is {arrays['branch'].max()}, expected 0 or 1")
    if "to_view" in fields:
        (across, *rest), (skew, down, _), last = arrays["to_view"].tolist()
        if not (across > 0 and down > 0 and [rest[0], skew, *last] == [0, 0, 0, 0, 1]):
            raise ValueError("to_view is no scale and shift")
    if {"intrinsics", "extrinsics"} <= set(fields):
        schema.check_camera(arrays["intrinsics"], arrays["extrinsics"])
