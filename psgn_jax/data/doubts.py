"""Compares samples with the schema and finds probable mistakes, each with its cause and remedy.

**Camera.** The *fit* of a sample is the smaller of two fractions: of the points that project near
the mask, and of the mask that is near a projected point. Near is 5 % of the longer side of the
mask's box. If more than `_SHARE` of the samples have a fit below `FLAG_BELOW`, we try the usual
other conventions and name the one that fits. If none does, as many must be below `_OFF`. (Of the
authors' 1,759 samples, .2 % are below both: their images show a part of the object.)

**Frame.** Points and cameras can agree in a frame with another axis up, or in the object's own.
In the image of a level camera, the right is a horizontal axis of the frame. It must be +y.

**Depth.** In most places, the foremost point must have the depth of the map.
"""

import zlib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from psgn_jax.data import camera
from psgn_jax.data.manifest import DUPLICATES
from psgn_jax.data.schema import SMALLEST_EXTENT

# Accepted radii, and the accepted height of the lowest point as a share of the radius.
_RADII, _GROUND = (0.5, 2.0), 0.1
FLAG_BELOW, _OFF, _SHARE = 0.75, 0.5, 0.1  # fits, and a share of the samples
_CLEARLY, _MOST = 0.1, 0.75  # a convention is named if its fit is larger, for most of the samples
_GRID, _MARGIN = 48, 12  # cells along the longer side of the mask's box, and around the box
_NEAR = 2.5  # cells
# We compare the first samples with their images, then every 16th: a tenth of the time to encode.
_CLOSELY, _EVERY = 128, 16
_TRIED, _POINTS = 16, 1000  # samples for which we try other conventions, and points of each
_ROLL = float(np.sin(np.deg2rad(20)))  # accepted, of a camera
_RATIO, _FEWEST = 1.1, 20  # accepted ratio of depths, and how many are compared at least

# The axis that is up -> columns and signs for points and extrinsics, which make it +z.
_UP = {
    "+z": ([0, 1, 2], [1, 1, 1]),
    "+y": ([0, 2, 1], [1, -1, 1]),
    "-y": ([0, 2, 1], [1, 1, -1]),
    "+x": ([2, 1, 0], [-1, 1, 1]),
    "-x": ([2, 1, 0], [1, 1, -1]),
    "-z": ([0, 1, 2], [1, -1, -1]),
}


class _Silhouette:
    """A mask on a small grid around its box, with which projected points are compared."""

    def __init__(self, mask: np.ndarray, num_points: int) -> None:
        step = max(1, max(mask.shape) // 512)  # bounds memory and time for large images
        shown = np.argwhere(mask[::step, ::step])[:, ::-1] * step
        shown = shown if len(shown) else np.argwhere(mask)[:, ::-1]
        low, high = shown.min(axis=0), shown.max(axis=0) + step
        self._cell = max(float(step), (high - low).max() / _GRID)
        self._low = low - _MARGIN * self._cell
        self._mask = np.zeros((_GRID + 2 * _MARGIN,) * 2, np.bool_)
        self._mask[tuple(((shown + 0.5 - self._low) / self._cell).astype(int).T)] = True
        self._distance = ndimage.distance_transform_edt(~self._mask)
        self._gap = max(_NEAR, 2.5 * np.sqrt(self._mask.sum() / num_points))

    def _cells(self, pixels: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which projected points [n, 2] with depths [n] are on the grid, and their cells [m, 2]."""
        cells = (pixels - self._low) / self._cell
        shown = (depth > 0) & ((cells >= 0) & (cells < len(self._mask))).all(axis=1)
        return shown, cells[shown].astype(int)

    def fit(self, pixels: np.ndarray, depth: np.ndarray) -> float:
        shown, cells = self._cells(pixels, depth)
        if not len(cells):
            return 0.0
        inside = (self._distance[tuple(cells.T)] <= _NEAR).sum() / len(shown)
        empty = np.ones_like(self._mask)
        empty[tuple(cells.T)] = False
        covered = ndimage.distance_transform_edt(empty)[self._mask] <= self._gap
        return float(min(inside, covered.mean()))

    def wrong_depth(self, depth_map: np.ndarray, pixels: np.ndarray, depth: np.ndarray) -> str:
        """What is wrong with a depth map, "" = nothing."""
        shown, cells = self._cells(pixels, depth)
        pixels, depth, cell = pixels[shown].astype(int), depth[shown], cells @ [1, len(self._mask)]
        nearest = np.full(self._mask.size, np.inf)
        np.minimum.at(nearest, cell, depth)
        columns, rows = np.clip(pixels, 0, np.array(depth_map.shape[::-1]) - 1).T
        mapped = depth_map[rows, columns]
        chosen = (depth <= nearest[cell]) & (mapped > 0)
        if chosen.sum() < _FEWEST:
            return ""
        mapped, depth = np.log(mapped[chosen]), np.log(depth[chosen])
        (low, off, high), of_inverse = (
            np.quantile(values, (0.25, 0.5, 0.75)) for values in (mapped - depth, mapped + depth)
        )
        if abs(off) <= np.log(_RATIO):
            return ""
        if of_inverse[2] - of_inverse[0] < (high - low) / 2:
            return "inverse depth: use 1 / depth, in the unit of the points"
        if high - low <= np.log(_RATIO):
            return f"depth in another unit, such as {np.exp(off):.4g} times the points': divide it"
        return "another depth than the points: expected their unit, and along the optical axis"


def _conventions(
    points: np.ndarray, inner: np.ndarray, outer: np.ndarray, size: tuple[int, int]
) -> Iterator[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """What a sample may have in place of the schema; its extrinsics, pixels and depths then.

    The first, "", is the schema itself.
    """
    (height, width), middle = size, np.maximum(np.abs(inner[:2, 2]), 1e-6)
    swapped = inner.copy()
    swapped[:2, 2] = inner[1::-1, 2]
    other_size = np.diag([width / 2 / middle[0], height / 2 / middle[1], 1]) @ inner
    rotation, last = outer[:, :3], outer[:, 3:]
    for of_pixels, matrix in (
        ("", inner),
        ("intrinsics in 0..1: multiply row 1 by the width and row 2 by the height",
         np.diag([width, height, 1]) @ inner),
        ("intrinsics of another image size: scale rows 1 and 2 as the image", other_size),
        ("intrinsics with cx and cy swapped: swap them", swapped),
    ):  # fmt: skip
        for of_pose, turned, moved in (
            ("", rotation, last),
            ("extrinsics from camera to world: invert them", rotation.T, -rotation.T @ last),
            ("extrinsics with a transposed rotation: transpose it", rotation.T, last),
            ("a position C as last column of extrinsics: use -R @ C", rotation, -rotation @ last),
        ):
            for of_axes, signs in (
                ("", (1, 1, 1)),
                ("cameras of OpenGL or Blender: negate rows 2 and 3 of extrinsics", (1, -1, -1)),
                ("cameras of PyTorch3D: negate rows 1 and 2 of extrinsics", (-1, -1, 1)),
            ):
                what = "; then ".join(filter(None, (of_pixels, of_pose, of_axes)))
                extrinsics = np.array(signs)[:, None] * np.hstack([turned, moved])
                yield what, extrinsics, *camera.project(points, matrix, extrinsics)
    pixels, depth = camera.project(points, inner, outer)
    column, row = pixels.T
    for what, mapped in (
        ("mirrored left to right: flip their columns", (width - column, row)),
        ("upside down and mirrored: flip their rows", (column, height - row)),
        ("turned by 180 degrees: turn them back", (width - column, height - row)),
        ("turned by 90 degrees: turn them back", (row, height - column)),
        ("turned by -90 degrees: turn them back", (width - row, column)),
        ("with rows and columns swapped: transpose them", (row, column)),
    ):
        yield f"image, mask and depth {what}", outer, np.stack(mapped, axis=1), depth
    for columns, flips in _UP.values():
        what = f"points with other axes: use points[:, {columns}] * {flips}"
        yield what, outer, *camera.project(points[:, columns] * flips, inner, outer)
    for angle in np.arange(1, 24) * np.pi / 12:
        what = "points turned about z against the camera: turn them by the azimuth of the view"
        sine, cosine = np.sin(angle), np.cos(angle)
        turned = points @ [[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]
        yield what, outer, *camera.project(turned, inner, outer)


class _Seen(NamedTuple):
    """The numbers of a sample that `Doubts.lines` compares."""

    radius: float
    ends: np.ndarray  # [2, 3], smallest and largest coordinates
    shown: bool  # the mask is not empty
    extrinsics: np.ndarray
    fit: float = np.nan  # NaN: not compared with its image
    depth: str = ""  # what is wrong with the depth
    others: Mapping[str, tuple[float, np.ndarray]] = {}  # convention -> fit and extrinsics

    @property
    def spread_out(self) -> bool:
        return bool(np.ptp(self.ends, axis=0).max() > SMALLEST_EXTENT * min(self.radius, 1))

    def lowest(self, up: str) -> float:
        columns, signs = _UP[up]
        return float((self.ends[:, columns[2]] * signs[2]).min())


@np.errstate(all="ignore")
def fit(sample: Any) -> float:
    """The fit of the module of a `Sample`, 0 to 1."""
    points = sample.points[:: max(1, len(sample.points) // _POINTS)]
    projected = camera.project(points, sample.intrinsics, sample.extrinsics)
    return _Silhouette(sample.mask, len(points)).fit(*projected) if sample.mask.any() else 0.0


@np.errstate(all="ignore")
def _compared(sample: Any, *, closely: bool, try_others: bool) -> _Seen:
    points, mask, inner, outer = sample.points, sample.mask, sample.intrinsics, sample.extrinsics
    axes = np.ascontiguousarray(points.T)  # reductions of its rows are fast
    radius, ends = np.sqrt((axes**2).sum(axis=0).max()), [axes.min(axis=1), axes.max(axis=1)]
    seen = _Seen(float(radius), np.stack(ends), bool(mask.any()), outer)
    if not (closely and seen.shown and seen.spread_out):
        return seen
    some, more = (points[:: max(1, len(points) // count)] for count in (_POINTS, 4 * _POINTS))
    silhouette = _Silhouette(mask, len(some))
    fit, depth = silhouette.fit(*camera.project(some, inner, outer)), ""
    others: dict[str, tuple[float, np.ndarray]] = {}
    if fit >= FLAG_BELOW and sample.depth is not None:
        if np.count_nonzero(sample.depth[~mask]) > _SHARE * mask.sum():
            depth = "depth outside of the mask: set it to 0 there"
        else:
            depth = silhouette.wrong_depth(sample.depth, *camera.project(more, inner, outer))
    elif fit < FLAG_BELOW and try_others:
        for what, extrinsics, *projected in _conventions(some, inner, outer, mask.shape):
            found = silhouette.fit(*projected), extrinsics
            others[what] = max(found, others.get(what, found), key=lambda pair: pair[0])
        inverse = mask if mask.all() else ~mask
        found = _Silhouette(inverse, len(some)).fit(*camera.project(some, inner, outer)), outer
        others["a mask of the background: invert it"] = found
    return seen._replace(fit=fit, depth=depth, others=others)


class Doubts:
    """Collects samples by `add`; `lines` lists the probable mistakes."""

    def __init__(self) -> None:
        self._seen: list[_Seen] = []
        self._tried = 0
        # First split of a model or a cloud. Models that are, or whose cloud is, in two splits.
        self._models: dict[tuple[str, str], str] = {}
        self._clouds: dict[tuple[int, int], str] = {}
        self._twice: dict[tuple[str, str], tuple[str, str]] = {}
        self._same: dict[tuple[str, str], tuple[str, str]] = {}

    def add(self, split: str, stored: Mapping[str, Any], sample: Any = None) -> None:
        """Adds the `codec.unpack` of a record, and its `Sample` (without image) if it is known.

        Without it, only models and clouds are compared. ValueError if it is no record.
        """
        try:
            model, cloud_of = (str(stored["category"]), str(stored["model_id"])), stored["points"]
            steps = cloud_of["steps"]
            cloud = len(steps), zlib.crc32(steps, zlib.crc32(cloud_of["matrix"]))
        except (KeyError, TypeError) as error:
            raise ValueError(f"a field is not as expected: {error}") from None
        if sample is not None:
            closely = len(self._seen) < _CLOSELY or len(self._seen) % _EVERY == 0
            self._seen.append(_compared(sample, closely=closely, try_others=self._tried < _TRIED))
            self._tried += bool(self._seen[-1].others)
        if split == DUPLICATES:
            return
        if model[1] and (first := self._models.setdefault(model, split)) != split:
            self._twice.setdefault(model, (first, split))
        if (other := self._clouds.setdefault(cloud, split)) != split:
            self._same.setdefault(model, (other, split))

    def lines(self) -> Iterator[str]:
        """A line for each kind of mistake, with the remedy."""
        if self._seen:
            yield from _about_samples(self._seen)
        yield from _in_two_splits("models are", self._twice)
        same = {model: two for model, two in self._same.items() if model not in self._twice}
        yield from _in_two_splits("models have a cloud that is", same)


def _about_samples(seen: list[_Seen]) -> Iterator[str]:
    compared = [each for each in seen if each.fit >= 0]
    of, of_compared = f"of {len(seen)} samples have", f"of {len(compared)} samples have"
    if empty := sum(not each.shown for each in seen):
        yield f"{empty} {of} an empty mask: leave them out"
    if alike := sum(not each.spread_out for each in seen):
        yield f"{alike} {of} all points in one place: leave them out"
    enough = _SHARE * len(compared)
    cameras = [each.extrinsics for each in compared if each.fit >= FLAG_BELOW]
    wrong = [each for each in compared if each.fit < FLAG_BELOW]
    what, corrected = _best(wrong) if len(wrong) > enough else ("", [])
    if not what:  # thin objects vanish in small images
        wrong = [each for each in wrong if each.fit < _OFF]
    if len(wrong) > enough:
        what = what or "check intrinsics, extrinsics, mask and points against docs/data.md"
        yield f"{len(wrong)} {of_compared} points that do not project onto the mask: {what}"
    up, text = _frame(np.array(corrected or cameras), seen) if corrected or cameras else ("+z", "")
    if text:
        yield f"frame of {len(compared)} samples: {text}"
    if far := [e.radius for e in seen if e.spread_out and not _RADII[0] <= e.radius <= _RADII[1]]:
        yield (
            f"{len(far)} {of} their farthest point {_range(far)} from the origin, expected about "
            "1: divide points, depth and the translation of extrinsics by the radius of the "
            "bounding hemisphere"
        )
    off = [e.lowest(up) for e in seen if e.spread_out and abs(e.lowest(up)) > _GROUND * e.radius]
    if off and not what.startswith("points"):
        yield (
            f"{len(off)} {of} their lowest point at z = {_range(off)}, expected 0: move the origin "
            "of points and extrinsics onto the ground below the object"
        )
    depths = [each.depth for each in compared if each.depth]
    if len(depths) > enough:
        yield f"{len(depths)} {of_compared} {max(depths, key=depths.count)}"


def _best(wrong: list[_Seen]) -> tuple[str, list[np.ndarray]]:
    """The convention that fits most of these samples, "" = none, and its extrinsics.

    Of conventions that fit equally, the one is likelier whose cameras are level in the frame.
    """
    tried = [each.others for each in wrong if each.others]

    def score(what: str) -> float:
        return float(np.mean([found[what][0] + 0.1 * _level(found[what][1]) for found in tried]))

    for what in sorted(tried[0], key=score, reverse=True):
        fitting = [e[what][1] for e in tried if e[what][0] >= max(FLAG_BELOW, e[""][0] + _CLEARLY)]
        if what and len(fitting) >= _MOST * len(tried):
            return what, fitting
    return "", []


def _level(extrinsics: np.ndarray) -> bool:
    """Whether +z is up in the image and +y is to its right."""
    return bool(extrinsics[0, 1] > 1 - _ROLL**2 and extrinsics[1, 2] < _ROLL)


def _frame(cameras: np.ndarray, seen: list[_Seen]) -> tuple[str, str]:
    """The axis that is up, and what is wrong with the frame, "" = nothing."""
    if np.mean([not _level(each) for each in cameras]) <= _SHARE:
        return "+z", ""

    def score(up: str) -> float:
        columns, signs = _UP[up]
        right, down, _ = (cameras[:, :, columns[2]] * signs[2]).T
        stands = [abs(each.lowest(up)) <= _GROUND * each.radius for each in seen]
        level = (np.abs(right) < _ROLL) & (down < _ROLL)
        return float(level.mean() + np.mean(stands) - 0.1 * down.mean())

    up = max(_UP, key=score)
    columns, signs = [*_UP[up][0], 3], [*_UP[up][1], 1]
    remedies = []
    if up != "+z":
        points = f"points[:, {columns[:3]}] * {signs[:3]}"
        remedies = [f"{up} is up, not +z: use {points} and extrinsics[:, {columns}] * {signs}"]
    if np.mean([not _level(each) for each in cameras[:, :, columns] * signs]) > _SHARE:
        remedies.append(
            "points in the object's own frame, +y is not to the right of the image: turn them and "
            "extrinsics about z by psgn_jax.data.camera.turn_to_view"
        )
    return up, "; then ".join(remedies)


def _range(values: list[float]) -> str:
    return " to ".join(dict.fromkeys((f"{min(values):.4g}", f"{max(values):.4g}")))


def _in_two_splits(what: str, found: Mapping[tuple[str, str], tuple[str, str]]) -> Iterator[str]:
    if not found:
        return
    (category, model), (first, second) = next(iter(found.items()))
    shown = repr(model) + (f" ({category})" if category else "")
    yield (
        f"{len(found)} {what} in two splits, such as {shown} in {first!r} and {second!r}: keep all "
        "samples of an object in one split, or the evaluation measures what was trained on"
    )
