"""Finds probable mistakes in a data set: wrong units, objects off the ground, mixed splits."""

import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from psgn_jax.data.manifest import DUPLICATES
from psgn_jax.data.schema import SMALLEST_EXTENT

# Accepted radii, and the accepted height of the lowest point as a share of the radius.
_RADII, _GROUND = (0.5, 2.0), 0.1


class Doubts:
    """Collects samples by `add`; `lines` lists the probable mistakes."""

    def __init__(self) -> None:
        # Radius, lowest z, extent, and the number of pixels of the mask.
        self._sizes: list[tuple[float, float, float, int]] = []
        # First split of a model or a cloud. Models that are, or whose cloud is, in two splits.
        self._models: dict[tuple[str, str], str] = {}
        self._clouds: dict[tuple[int, int], str] = {}
        self._twice: dict[tuple[str, str], tuple[str, str]] = {}
        self._same: dict[tuple[str, str], tuple[str, str]] = {}

    def add(
        self, split: str, stored: Mapping[str, Any], content: tuple[np.ndarray, np.ndarray] | None
    ) -> None:
        """Adds the `codec.unpack` of a record, with its points [n, 3] and mask if they are known.

        Without them, only models and clouds are compared. ValueError if it is no record.
        """
        try:
            model, cloud_of = (str(stored["category"]), str(stored["model_id"])), stored["points"]
            steps = cloud_of["steps"]
            cloud = len(steps), zlib.crc32(steps, zlib.crc32(cloud_of["matrix"]))
        except (KeyError, TypeError) as error:
            raise ValueError(f"a field is not as expected: {error}") from None
        if content is not None:
            points, mask = content
            radius = float(np.linalg.norm(points, axis=1).max())
            extent = float(np.ptp(points, axis=0).max())
            self._sizes.append((radius, float(points[:, 2].min()), extent, mask.sum()))
        if split == DUPLICATES:
            return
        if model[1] and (first := self._models.setdefault(model, split)) != split:
            self._twice.setdefault(model, (first, split))
        if (other := self._clouds.setdefault(cloud, split)) != split:
            self._same.setdefault(model, (other, split))

    def lines(self) -> Iterator[str]:
        """A line for each kind of mistake, with the remedy."""
        radius, lowest, extent, pixels = np.array(self._sizes).reshape(-1, 4).T
        one_place = extent <= SMALLEST_EXTENT * np.minimum(radius, 1)
        far = ~one_place & ((radius < _RADII[0]) | (radius > _RADII[1]))
        off = ~one_place & (np.abs(lowest) > _GROUND * radius)
        of = f"of {len(radius)} samples"
        if one_place.any():
            yield f"{one_place.sum()} {of} have all points in one place: leave them out"
        if not pixels.all():
            yield f"{(pixels == 0).sum()} {of} have an empty mask: leave them out"
        if far.any():
            yield (
                f"{far.sum()} {of} have their farthest point {_range(radius[far])} from the "
                "origin, expected about 1: divide points, depth and the translation of extrinsics "
                "by the radius of the bounding hemisphere"
            )
        if off.any():
            yield (
                f"{off.sum()} {of} have their lowest point at z = {_range(lowest[off])}, expected "
                "0: move the origin of points and extrinsics onto the ground below the object"
            )
        yield from _in_two_splits("models are", self._twice)
        same = {model: two for model, two in self._same.items() if model not in self._twice}
        yield from _in_two_splits("models have a cloud that is", same)


def _range(values: np.ndarray) -> str:
    ends = (f"{values.min():.4g}", f"{values.max():.4g}")
    return " to ".join(dict.fromkeys(ends))


def _in_two_splits(what: str, found: Mapping[tuple[str, str], tuple[str, str]]) -> Iterator[str]:
    if not found:
        return
    (category, model), (first, second) = next(iter(found.items()))
    shown = repr(model) + (f" ({category})" if category else "")
    yield (
        f"{len(found)} {what} in two splits, such as {shown} in {first!r} and {second!r}: keep all "
        "samples of an object in one split, or the evaluation measures what was trained on"
    )
