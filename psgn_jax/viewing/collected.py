"""Keeps the samples and predictions of an evaluation on disk until its pages are written."""

import dataclasses
import pathlib
import tempfile
import weakref
from collections.abc import Sequence
from typing import Any, overload

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class Sample:
    """Image, ground-truth points and camera of one sample."""

    image: np.ndarray
    points: np.ndarray
    intrinsics: np.ndarray
    extrinsics: np.ndarray


class StoredArrays(Sequence[np.ndarray]):
    """Arrays of one shape in an unnamed temporary file, which is removed with this object.

    Args:
      folder: folder of the file.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._count = 0
        self._shape: tuple[int, ...] = ()
        self._dtype = np.dtype(np.uint8)
        self._size = 0

    def append(self, array: np.ndarray) -> None:
        """Adds an array at the end.

        Raises:
          ValueError: the array has another shape or dtype than the first one.
        """
        if not self._count:
            self._shape, self._dtype, self._size = array.shape, array.dtype, array.nbytes
        if (array.shape, array.dtype) != (self._shape, self._dtype):
            raise ValueError(
                f"an array {array.dtype} {list(array.shape)}, expected {self._dtype} "
                f"{list(self._shape)}, like the first one"
            )
        self._file.seek(self._count * self._size)
        self._file.write(np.ascontiguousarray(array).data)
        self._count += 1

    def __len__(self) -> int:
        """Number of arrays."""
        return self._count

    @overload
    def __getitem__(self, index: int) -> np.ndarray: ...
    @overload
    def __getitem__(self, index: slice) -> list[np.ndarray]: ...
    def __getitem__(self, index: int | slice) -> np.ndarray | list[np.ndarray]:
        """An array, read from the file."""
        if isinstance(index, slice):
            return [self[i] for i in range(self._count)[index]]
        place = range(self._count)[index]
        self._file.seek(place * self._size)
        data = bytearray(self._file.read(self._size))
        return np.frombuffer(data, self._dtype).reshape(self._shape)


class StoredSamples(Sequence[Sample]):
    """Samples of one shape, stored as `StoredArrays`."""

    def __init__(self, folder: pathlib.Path) -> None:
        self._fields = [StoredArrays(folder) for _ in dataclasses.fields(Sample)]

    def append(self, sample: Sample) -> None:
        """Adds a sample at the end."""
        for stored, field in zip(self._fields, dataclasses.fields(Sample), strict=True):
            stored.append(getattr(sample, field.name))

    def __len__(self) -> int:
        """Number of samples."""
        return len(self._fields[0])

    @overload
    def __getitem__(self, index: int) -> Sample: ...
    @overload
    def __getitem__(self, index: slice) -> list[Sample]: ...
    def __getitem__(self, index: int | slice) -> Sample | list[Sample]:
        """A sample, read from the files."""
        if isinstance(index, slice):
            return [self[i] for i in range(len(self))[index]]
        return Sample(*(stored[index] for stored in self._fields))


class Collector:
    """Collects samples and clouds; an instance is the hook `on_batch` of `evaluate_run`.

    Of the true points, only those that the pages show are kept: about as many as there are
    predicted points.

    Args:
      folder: folder of the temporary files, which are removed with the collector; created if
        missing.
    """

    def __init__(self, folder: str | pathlib.Path) -> None:
        folder = pathlib.Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        self.samples = StoredSamples(folder)
        self.preds = StoredArrays(folder)

    def __call__(self, index: int, batch: Any, points: np.ndarray) -> None:
        """Stores the valid rows of a batch."""
        for i in np.flatnonzero(batch["valid"]):
            fields = {f.name: np.asarray(batch[f.name][i]) for f in dataclasses.fields(Sample)}
            fields["points"] = shown_points(fields["points"], len(points[i]))
            self.samples.append(Sample(**fields))
            self.preds.append(np.asarray(points[i], np.float32))


def shown_points(points: np.ndarray, predicted: int) -> np.ndarray:
    """Reduces true points [m, 3] to about `predicted`; applying it twice has no further effect."""
    return points[:: max(1, len(points) // predicted)]
