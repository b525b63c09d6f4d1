"""Finds the object's pixels in a mask from its grey levels, palette indices or colours.

A mask has two levels, with sharp or soft edges between them. We refuse a mask of several labels,
because it does not say which label is the object's, and a photograph.
"""

from collections.abc import Sequence

import numpy as np
from PIL import Image
from scipy import ndimage

# We judge the levels on a sample of at most this many pixels a side.
_SIDE = 512
# A level fills areas if 3x3 windows without another level cover at least this share of the mask.
# With more than `FEW` levels, most come from soft edges or JPEG. Then at least half of the pixels
# at a level's border must also differ by `_STEP` of the range.
_LEAST_AREA, FEW, _STEP = 0.001, 16, 0.02
# A third level is this far beyond the mask's two levels or from the line between them, in units of
# their difference, and has this share of the pixels.
_OUTSIDE, _LEAST_SHARE = 0.1, 2e-4
# Soft edges, in the same unit: a pixel is between the levels if it is farther than `_NEAR` from
# both, or than `_OFF` from their line. Where a window of 5x5 pixels has both levels, the edge is
# sharp. If the other pixels between them exceed `_MOST_BETWEEN` of the object, they must differ by
# at most `_MOST_DIFFERENT` from a blurred mask. In the ten photographs of docs/photos, whole in
# grey or at 96 pixels in colour, these pixels are at least .2 of the object and differ by at least
# .124 on average. In their masks, at 96 pixels or whole, blurred with a deviation of up to 2
# pixels, they are fewer or differ by at most .117.
_NEAR, _OFF, _MOST_BETWEEN, _MOST_DIFFERENT = 0.25, 0.5, 0.17, 0.12
_MANY = 64  # more levels are a photograph's, unless areas of three levels cover half of the mask
_BLURS = (2, 4, 8, 16, 32)  # factors by which the mask is reduced

_LUMA = np.array([0.299, 0.587, 0.114])
_BILINEAR = Image.Resampling.BILINEAR


class MaskLevelsError(ValueError):
    """The levels do not show one object; the message follows the mask's name."""


def object_in(
    values: np.ndarray, ids: np.ndarray | None = None, label: int | Sequence[int] | None = None
) -> np.ndarray:
    """The object's pixels, bool [h, w].

    Args:
      values: numbers [h, w], or colours uint8 [h, w, 3].
      ids: numbers [h, w] that name the labels, such as palette indices; None = `values`.
      label: the object's number in `ids`, or its colour; None = the brighter of two levels.

    Raises:
      MaskLevelsError: there is no such label, there are not two levels, or it is a photograph.
    """
    values = np.atleast_3d(values)
    named = values if ids is None else np.atleast_3d(ids)
    small, small_named = sample(values), sample(named)
    codes, first, counts = _numbered(small)
    names = small_named.reshape(codes.size, -1)[first]
    shown = _shown(names, counts)
    if label is not None:
        wanted = np.atleast_1d(label)
        among = values if len(wanted) == values.shape[2] == 3 else named
        if len(wanted) != among.shape[2] or not (inside := (among == wanted).all(2)).any():
            raise MaskLevelsError(f"has no level {','.join(map(str, wanted))}; it has {shown}")
        return inside
    levels = small.reshape(codes.size, -1)[first].astype(np.float64)
    if len(levels) == 1:
        if levels.max() > 0:
            raise MaskLevelsError("covers the whole image: expected a background without it")
        raise MaskLevelsError("is empty: no pixel shows the object")
    areas = _fill_areas(codes, levels)
    low, high = _two_levels(areas, levels)
    if len(levels) <= FEW:  # count the levels of thin areas, such as outlines
        position, off = _between(levels, levels[low], levels[high])
        far = (position < -_OUTSIDE) | (position > 1 + _OUTSIDE) | (off > _OUTSIDE)
        areas |= far & (counts >= _LEAST_SHARE * codes.size)
    share = _share_between(*_between(small, levels[low], levels[high]))
    if share or areas.sum() > 2:
        labelled = areas.sum() > 2 and counts[areas].sum() > 0.5 * codes.size
        if len(levels) > _MANY and not labelled:
            raise MaskLevelsError(
                f"looks like a photograph: {share:.0%} of it is neither dark nor bright; accepted: "
                "white on the object, black elsewhere"
            )
        raise MaskLevelsError(
            f"has {len(levels)} levels ({shown}): accepted: two, the object and the rest; name the "
            "object's by mask_label, or in Python give mask=array == level"
        )
    return _between(values, levels[low], levels[high])[0] > 0.5


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


def _numbered(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Level numbers [h, w]; index of a pixel of each level; pixels of each level."""
    _, first, codes, counts = np.unique(_single(values), True, True, True)
    return codes.reshape(values.shape[:2]), first, counts


def _shown(names: np.ndarray, counts: np.ndarray) -> str:
    """The most frequent levels as text."""
    order = np.argsort(-counts, kind="stable")
    texts = [
        f"{','.join(f'{value:g}' for value in names[i].tolist())} on {counts[i] / counts.sum():.1%}"
        for i in order[:5]
    ]
    return ", ".join(texts) + ", ..." * (len(order) > 5)


def _neighbours(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The two levels at each pair of neighbouring pixels with different levels, in both orders."""
    pairs = [(codes[1:], codes[:-1]), (codes[:, 1:], codes[:, :-1])]
    one = np.concatenate([a.ravel() for a, _ in pairs] + [b.ravel() for _, b in pairs])
    other = np.concatenate([b.ravel() for _, b in pairs] + [a.ravel() for a, _ in pairs])
    return one[one != other], other[one != other]


def _fill_areas(codes: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Which levels fill areas, unlike those of soft edges and noise; see `_LEAST_AREA`."""
    inner = ndimage.maximum_filter(codes, 3) == ndimage.minimum_filter(codes, 3)
    number = len(levels)
    areas = np.bincount(codes[inner], minlength=number) >= _LEAST_AREA * codes.size
    if number > FEW:
        one, other = _neighbours(codes)
        step = np.abs(levels[one] - levels[other]).max(axis=1) > _STEP * np.ptp(levels)
        sharp = np.bincount(one, step, minlength=number)
        areas &= sharp >= 0.5 * np.bincount(one, minlength=number)
    return areas


def _two_levels(areas: np.ndarray, levels: np.ndarray) -> tuple[int, int]:
    """The darker and the brighter level: two that fill areas, or else two that differ most."""
    light = levels @ _LUMA if levels.shape[1] == 3 else levels[:, 0]
    one, *others = np.flatnonzero(areas).tolist() or [int(light.argmin())]
    apart = np.abs(levels - levels[one]).max(axis=1)
    other = others[0] if others else int(apart.argmax())
    return (one, other) if light[one] <= light[other] else (other, one)


def _between(
    values: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position of values [..., c] between two levels (0 to 1), and distance from their line."""
    axis = (high - low).astype(np.float32)
    channels = [values[..., c] - np.float32(low[c]) for c in range(len(axis))]
    position = sum(
        (x * (a / (axis @ axis)) for x, a in zip(channels, axis, strict=True)), np.zeros(())
    )
    off = [np.abs(x - position * a) for x, a in zip(channels, axis, strict=True)]
    return position, np.maximum.reduce(off) / np.abs(axis).max()


def _share_between(position: np.ndarray, off: np.ndarray) -> float:
    """The share of pixels between the levels; 0 if all belong to soft edges."""
    inside = position > 0.5
    near = (np.abs(position - inside) <= _NEAR) & (off <= _OFF)
    lowest, highest = ndimage.minimum_filter(position, 5), ndimage.maximum_filter(position, 5)
    between = ~near & ((lowest > _NEAR) | (highest < 1 - _NEAR))
    if between.sum() <= _MOST_BETWEEN * min(inside.sum(), (~inside).sum()):
        return 0.0
    height, width = position.shape
    picture, differences = Image.fromarray(inside.astype(np.uint8) * np.uint8(255)), []
    for factor in _BLURS:
        small = picture.resize((-(-width // factor), -(-height // factor)), _BILINEAR)
        soft = np.asarray(small.resize((width, height), _BILINEAR)) / np.float32(255)
        differences.append(float(np.maximum(np.abs(soft - position), off)[between].mean()))
    return float((~near).mean()) if min(differences) > _MOST_DIFFERENT else 0.0
