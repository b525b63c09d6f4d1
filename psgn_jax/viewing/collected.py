"""Keeps the samples and predictions of an evaluation on disk until its pages are written."""

import dataclasses
import io
import pathlib
import tempfile
import weakref
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class Shown:
    """One sample with its prediction, as the pages show it.

    Attributes:
      image: uint8 [h, w, 3].
      points: true points [m, 3], about as many as predicted.
      intrinsics, extrinsics: the camera of `image`.
      pred: predicted points, float32 [n, 3].
    """

    image: np.ndarray
    points: np.ndarray
    intrinsics: np.ndarray
    extrinsics: np.ndarray
    pred: np.ndarray


class Collector:
    """The samples of an evaluation, in an unnamed file in `folder`; a hook `on_batch`."""

    def __init__(self, folder: str | pathlib.Path) -> None:
        pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._starts: list[int] = []

    def __call__(self, index: int, batch: Any, points: np.ndarray) -> None:
        """Stores the valid rows of a batch with their predicted points [b, n, 3]."""
        for i in np.flatnonzero(batch["valid"]):
            true = np.asarray(batch["points"][i])
            true = true[:: max(1, len(true) // len(points[i]))]
            others = [batch[name][i] for name in ("image", "intrinsics", "extrinsics")]
            self._starts.append(self._file.seek(0, io.SEEK_END))
            for array in (true, *others, np.asarray(points[i], np.float32)):
                np.save(self._file, array)

    def __len__(self) -> int:
        return len(self._starts)

    def __getitem__(self, index: int) -> Shown:
        self._file.seek(self._starts[index])
        points, image, intrinsics, extrinsics, pred = (np.load(self._file) for _ in range(5))
        return Shown(image, points, intrinsics, extrinsics, pred)
