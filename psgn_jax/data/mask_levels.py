"""Finds the object's pixels in a mask from its grey levels, palette indices or colours.

A mask has two levels, with a sharp or soft edge between them. We refuse anything else: a mask of
several labels does not say which label is the object's.
"""

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

# We judge the levels on a sample of at most this many pixels a side.
_SIDE = 512
# A level fills areas if windows of 3x3 pixels without another level cover this share of the mask.
# With more than `FEW` levels, which soft edges and JPEG cause, levels that differ by less than
# `_STEP` of the range count as one, up to `_WIDEST`. With few levels, such windows cover at least
# `_LEAST_FLAT` of the mask: less is noise, or stripes.
FEW, _LEAST_AREA, _LEAST_FLAT = 16, 0.005, 0.5
_STEP, _WIDEST = 0.02, 0.4
# Of the difference of the two levels: other pixels are near a level, or between them, or beyond
# them. At most the share `_BEYOND` of the pixels is beyond.
_NEAR, _BEYOND = 0.25, 2e-4
# Where a window of 5x5 pixels has both levels, the edge is sharp. If the other pixels between them
# exceed the share `_MOST_BETWEEN` of the object's, they differ by at most `_ROUGH` from an even
# slope. In the photographs of docs/photos, 96 pixels wide or whole, they exceed .2 and differ by
# .09. In their masks and others, sharp or blurred by up to 8 pixels, one of the two is smaller.
_MOST_BETWEEN, _ROUGH = 0.19, 0.0875

_LUMA = np.array([299, 587, 114], np.int32)


def object_in(
    values: np.ndarray, ids: np.ndarray | None = None, label: int | Sequence[int] | None = None
) -> np.ndarray:
    """The object's pixels, bool [h, w].

    Args:
      values: numbers [h, w], or colours uint8 [h, w, 3].
      ids: numbers [h, w] that name the labels, such as palette indices; None = `values`.
      label: the object's number in `ids`, or its colour; None = the brighter of two levels.

    ValueError if there is no such label, or not two levels; its message follows the mask's name.
    """
    light = values if values.ndim == 2 else values @ _LUMA
    values = np.atleast_3d(values)
    named = values if ids is None else np.atleast_3d(ids)
    small = sample(named)
    _, first, codes, counts = np.unique(_single(small), True, True, True)
    shown = _shown(small.reshape(codes.size, -1)[first], counts)
    if label is not None:
        wanted = np.atleast_1d(label)
        among = values if len(wanted) == values.shape[2] == 3 else named
        if len(wanted) != among.shape[2] or not (inside := (among == wanted).all(2)).any():
            raise ValueError(f"has no level {','.join(map(str, wanted))}; it has {shown}")
        return inside
    small = sample(light)
    levels = small.ravel()[first]
    if len(levels) == 1:
        if levels[0] > 0:
            raise ValueError("covers the whole image: expected a background without it")
        raise ValueError("is empty: no pixel shows the object")
    found = _two_levels(small, codes.reshape(small.shape), levels)
    if found is None:
        raise ValueError(
            f"has {len(levels)} levels ({shown}): accepted: two, the object in white on black; of "
            "several labels name the object's by mask_label, or in Python give mask=array == label"
        )
    low, high = found.tolist()
    # Exact for any numbers.
    return light > (low / 2 + high / 2 if isinstance(low, float) else (low + high) // 2)


def sample(values: np.ndarray) -> np.ndarray:
    """A regular sample of the pixels, at most `_SIDE` a side."""
    rows, columns = (
        ((np.arange(min(n, _SIDE)) + 0.5) * n / min(n, _SIDE)).astype(np.intp)
        for n in values.shape[:2]
    )
    return values[rows[:, None], columns]


def count(values: np.ndarray) -> int:
    """The number of different values [..., c]."""
    return len(np.unique(_single(values)))


def _single(values: np.ndarray) -> np.ndarray:
    """One number for each of the values [..., c]."""
    if values.shape[-1] == 1:
        return values[..., 0]
    return values.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])


def _shown(names: np.ndarray, counts: np.ndarray) -> str:
    """The most frequent levels as text."""
    order = np.argsort(-counts, kind="stable")
    texts = [
        f"{','.join(f'{value:g}' for value in names[i].tolist())} on {counts[i] / counts.sum():.1%}"
        for i in order[:5]
    ]
    return ", ".join(texts) + ", ..." * (len(order) > 5)


def _two_levels(light: np.ndarray, codes: np.ndarray, levels: np.ndarray) -> np.ndarray | None:
    """The darker and the brighter level of a mask, or None if it is no mask.

    `light` is the brightness [h, w], `codes` the labels' numbers [h, w], `levels` their brightness.
    """
    flat = ndimage.maximum_filter(codes, 3) == ndimage.minimum_filter(codes, 3)
    few = len(levels) <= FEW
    if few and flat.mean() < _LEAST_FLAT:
        return None
    if len(levels) == 2:
        return np.sort(levels) if levels[0] != levels[1] else None
    lowest, span = float(levels.min()), float(levels.max()) - float(levels.min())
    if not 0 < span < np.inf:
        return None
    light, heights = ((each - lowest) / span for each in (light, levels))
    if not few:
        if _jumps(light, flat):
            return None
        flat = ndimage.maximum_filter(light, 3) - ndimage.minimum_filter(light, 3) <= _STEP
    inner = np.bincount(codes[flat], minlength=len(levels))
    # Levels that fill areas: of many, those without a gap between them belong together.
    order = np.argsort(heights)
    filling = order[inner[order] > 0]
    groups = np.zeros(len(levels), int)
    groups[filling[1:]] = np.cumsum(few | (np.diff(heights[filling]) > _STEP))
    areas = np.flatnonzero(np.bincount(groups, inner) >= _LEAST_AREA * codes.size)
    ranges = [np.ptp(heights[(groups == group) & (inner > 0)]) for group in areas]
    if len(areas) not in (1, 2) or max(ranges) > _WIDEST:
        return None
    # The most frequent level of each group. A thin object has none: the level that differs most.
    two = [int(np.where(groups == group, inner, -1).argmax()) for group in areas]
    two += [int(np.abs(heights - heights[two[0]]).argmax())] * (len(two) == 1)
    low, high = np.sort(heights[two])
    if low == high or not _is_step((light - low) / (high - low)):
        return None
    return np.sort(levels[two])


def _jumps(light: np.ndarray, flat: np.ndarray) -> bool:
    """Whether areas of levels that differ a little have sharp borders, as many labels have."""
    total = 0
    for one, other in ((np.s_[3:], np.s_[:-3]), (np.s_[:, 3:], np.s_[:, :-3])):
        jump = np.abs(light[one] - light[other])
        total += (flat[one] & flat[other] & (jump > _STEP) & (jump < _NEAR)).sum()
    return bool(total > _BEYOND * light.size)


def _is_step(position: np.ndarray) -> bool:
    """Whether positions [h, w], 0 and 1 at two levels, are a step with a sharp or even slope."""
    if (np.abs(position - 0.5) > 0.5 + _NEAR).mean() > _BEYOND:
        return False
    off, on = position <= _NEAR, position >= 1 - _NEAR
    between = ~off & ~on
    sharp = ndimage.maximum_filter(off, 5) & ndimage.maximum_filter(on, 5)
    if (between & ~sharp).sum() <= _MOST_BETWEEN * min(off.sum(), on.sum()):
        return True
    away = [ndimage.distance_transform_edt(~level)[between] for level in (off, on)]
    slope = _NEAR + (1 - 2 * _NEAR) * (away[0] - 0.5) / (away[0] + away[1] - 1)
    return bool(np.abs(slope - position[between]).mean() <= _ROUGH)
