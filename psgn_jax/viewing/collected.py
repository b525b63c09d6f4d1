"""Keeps the samples and predictions of an evaluation on disk until its pages are written."""

import io
import pathlib
import tempfile
import weakref
from typing import Any

import numpy as np

from psgn_jax.viewing.spheres import thinned

_FIELDS = ("points", "image", "intrinsics", "extrinsics")


class Collector:
    """The samples of an evaluation, in an unnamed file in `folder`; a hook `on_batch`.

    Each is a dict of arrays: `image` uint8 [h, w, 3] and its camera, `intrinsics` and `extrinsics`;
    true points `points`, about as many as predicted; predicted points `pred`, float32 [n, 3].
    """

    def __init__(self, folder: str | pathlib.Path) -> None:
        pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._starts: list[int] = []

    def __call__(self, index: int, batch: Any, points: np.ndarray) -> None:
        """Stores the valid rows of a batch with their predicted points [b, n, 3]."""
        for i in np.flatnonzero(batch["valid"]):
            truth, *others = (np.asarray(batch[name][i]) for name in _FIELDS)
            self._starts.append(self._file.seek(0, io.SEEK_END))
            for array in (thinned(truth, points[i]), *others, np.asarray(points[i], np.float32)):
                np.save(self._file, array)

    def __len__(self) -> int:
        return len(self._starts)

    def __getitem__(self, index: int) -> dict[str, np.ndarray]:
        self._file.seek(self._starts[index])
        return {name: np.load(self._file) for name in (*_FIELDS, "pred")}
