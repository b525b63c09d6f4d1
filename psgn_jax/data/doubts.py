"""Compares samples with the schema and finds probable mistakes, each with its cause and remedy.

**Camera.** The *fit* of a sample is the smaller of two fractions: of the points that project near
the mask, and of the mask that is near a projected point. Near is 5 % of the longer side of the
mask's box. If the fit of more than `_SHARE` of the samples is below `_FIT`, we try the usual other
conventions and name the one that fits.

**Frame.** Points and cameras can agree in a frame with another axis up, or in the object's own.
In the image of a level camera, the right is a horizontal axis of the frame. It must be +y.

**Depth.** In most places, the foremost point must have the depth of the map.
"""

import itertools
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from psgn_jax.data import camera
from psgn_jax.data.manifest import DUPLICATES
from psgn_jax.data.resample import box_of
from psgn_jax.data.schema import SMALLEST_EXTENT

# Accepted radii, and the accepted height of the lowest point as a share of the radius.
_RADII, _GROUND = (0.5, 2.0), 0.1
_FIT, _SHARE = 0.75, 0.1
_CLEARLY, _MOST = 0.1, 0.75  # a convention is named if its fit is larger, for most of the samples
_GRID, _MARGIN = 48, 12  # cells along the longer side of the mask's box, and around the box
_NEAR = 2.5  # cells
_TRIED, _POINTS = 16, 1000  # samples for which we try other conventions, and points of each
_CLOSELY = 128  # samples that are compared with their images, before `every` counts
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
_Named = tuple[str, str]  # what a sample has in place of the schema, and the remedy


class Silhouette:
    """A mask on a small grid around its box, with which projected points are compared."""

    def __init__(self, mask: np.ndarray, num_points: int) -> None:
        top, bottom, left, right = box_of(mask)
        self._cell = max(bottom - top, right - left) / _GRID
        self._low = np.array([left, top]) - _MARGIN * self._cell
        along = (np.arange(_GRID + 2 * _MARGIN) + 0.5) * self._cell
        ends = zip(self._low, mask.shape[::-1], strict=True)
        columns, rows = (np.clip(np.floor(low + along), -1, end) for low, end in ends)
        self._mask = np.pad(mask, 1)[np.ix_(rows.astype(int) + 1, columns.astype(int) + 1)]
        shown = (np.stack(np.nonzero(mask))[::-1].T + 0.5 - self._low) / self._cell
        self._mask[tuple(shown.astype(int).T[::-1])] = (
            True  # thin parts, between the cells' centres
        )
        self._distance = ndimage.distance_transform_edt(~self._mask)
        self._gap = max(_NEAR, 2.5 * np.sqrt(self._mask.sum() / num_points))

    def cells(self, pixels: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which projected points [n, 2] with depths [n] are on the grid, and their cells [m, 2]."""
        with np.errstate(invalid="ignore"):
            cells = (pixels - self._low) / self._cell
            shown = (depth > 0) & ((cells >= 0) & (cells < len(self._mask))).all(axis=1)
        return shown, cells[shown].astype(int)

    def fit(self, pixels: np.ndarray, depth: np.ndarray) -> float:
        shown, cells = self.cells(pixels, depth)
        if not len(cells):
            return 0.0
        columns, rows = cells.T
        inside = (self._distance[rows, columns] <= _NEAR).sum() / len(shown)
        empty = np.ones_like(self._mask)
        empty[rows, columns] = False
        covered = ndimage.distance_transform_edt(empty)[self._mask] <= self._gap
        return float(min(inside, covered.mean()))

    def ratios(
        self, depth_map: np.ndarray, pixels: np.ndarray, depth: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """In each cell, the foremost point's depth, and the depth in the map there."""
        shown, cells = self.cells(pixels, depth)
        width = len(self._mask)
        cell, depth = cells @ [1, width], depth[shown]
        nearest = np.full(width * width, np.inf)
        np.minimum.at(nearest, cell, depth)
        columns, rows = np.clip(pixels[shown].astype(int), 0, np.array(depth_map.shape[::-1]) - 1).T
        mapped = depth_map[rows, columns]
        chosen = (depth <= nearest[cell]) & (mapped > 0)
        return depth[chosen], mapped[chosen]


def _cameras(extrinsics: np.ndarray) -> Iterator[tuple[list[_Named], np.ndarray]]:
    rotation, last = extrinsics[:, :3], extrinsics[:, 3:]
    for name, remedy, turned, moved in (
        ("", "", rotation, last),
        ("from camera to world", "invert extrinsics", rotation.T, -rotation.T @ last),
        ("with a transposed rotation", "transpose it", rotation.T, last),
        ("with a position C as translation", "use -R @ C", rotation, -rotation @ last),
    ):
        for axes, negate, signs in (
            ("", "", (1, 1, 1)),
            ("of OpenGL or Blender", "negate rows 2 and 3 of extrinsics", (1, -1, -1)),
            ("of PyTorch3D", "negate rows 1 and 2 of extrinsics", (-1, -1, 1)),
        ):
            parts = [part for part in ((name, remedy), (axes, negate)) if part[0]]
            yield parts, np.array(signs)[:, None] * np.hstack([turned, moved])


def _conventions(
    points: np.ndarray, inner: np.ndarray, outer: np.ndarray, size: tuple[int, int]
) -> Iterator[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """What a sample may have in place of the schema; its extrinsics, pixels and depths then.

    The first is the schema itself.
    """
    height, width = size
    swapped, middle = inner.copy(), np.maximum(np.abs(inner[:2, 2]), 1e-6)
    swapped[:2, 2] = inner[1::-1, 2]
    for what, matrix in (
        ("", inner),
        (
            "intrinsics in 0..1: multiply row 1 by the width and row 2 by the height",
            np.diag([width, height, 1]) @ inner,
        ),
        (
            "intrinsics of another image size: scale rows 1 and 2 as the image",
            np.diag([width / 2 / middle[0], height / 2 / middle[1], 1]) @ inner,
        ),
        ("intrinsics with cx and cy swapped: swap them", swapped),
    ):
        for parts, extrinsics in _cameras(outer):
            names, remedies = (", then ".join(part[i] for part in parts) for i in (0, 1))
            text = f"cameras {names.replace(' then', '')}: {remedies}" if parts else ""
            both = "; and ".join(filter(None, (what, text)))
            yield both, extrinsics, *camera.project(points, matrix, extrinsics)
    pixels, depth = camera.project(points, inner, outer)
    column, row = pixels.T
    for what, moved in (
        ("mirrored left to right: flip their columns", (width - column, row)),
        ("upside down and mirrored: flip their rows", (column, height - row)),
        ("turned by 180 degrees: turn them back", (width - column, height - row)),
        ("turned by 90 degrees: turn them back", (row, height - column)),
        ("turned by -90 degrees: turn them back", (width - row, column)),
        ("with rows and columns swapped: transpose them", (row, column)),
    ):
        yield f"image, mask and depth {what}", outer, np.stack(moved, axis=1), depth
    for axes, signs in itertools.product(
        itertools.permutations(range(3)), itertools.product((1, -1), repeat=3)
    ):
        if np.linalg.det(np.eye(3)[list(axes)] * signs) > 0:
            what = f"points with other axes: use points[:, {list(axes)}] * {list(signs)}"
            yield what, outer, *camera.project(points[:, axes] * signs, inner, outer)
    for angle in np.arange(1, 24) * np.pi / 12:
        what = "points turned about z against the camera: turn them by the azimuth of the view"
        yield what, outer, *camera.project(points @ _turn(angle).T, inner, outer)


def _turn(angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


def _wrong_depth(
    depth_map: np.ndarray, mask: np.ndarray, points: np.ndarray, mapped: np.ndarray
) -> str:
    """What is wrong with a depth map, "" = nothing; with the results of `Silhouette.ratios`."""
    if np.count_nonzero(depth_map[~mask]) > _SHARE * mask.sum():
        return "depth outside of the mask: set it to 0 there"
    if len(points) < _FEWEST:
        return ""
    ratio, product = np.log(mapped / points), np.log(mapped * points)
    off, spread = float(np.median(ratio)), _spread(ratio)
    if abs(off) <= np.log(_RATIO):
        return ""
    if _spread(product) < spread / 2:
        return "inverse depth: use 1 / depth, in the unit of the points"
    if spread <= np.log(_RATIO):
        return f"depth in another unit, such as {np.exp(off):.4g} times the points': divide it"
    return "depth that is not that of the points: expected the distance along the optical axis"


def _spread(values: np.ndarray) -> float:
    low, high = np.quantile(values, (0.25, 0.75))
    return float(high - low)


class _Seen(NamedTuple):
    """The numbers of a sample that `Doubts.lines` compares."""

    radius: float
    ends: np.ndarray  # [2, 3], smallest and largest coordinates
    shown: bool  # the mask is not empty
    fit: float  # NaN: unknown
    extrinsics: np.ndarray
    depth: str  # what is wrong with the depth
    others: Mapping[str, tuple[float, np.ndarray]]  # convention -> fit and extrinsics


def _compared(sample: Any, *, closely: bool, try_others: bool) -> _Seen:
    points, mask, outer = sample.points, sample.mask, sample.extrinsics
    axes = np.ascontiguousarray(points.T)  # reductions of its rows are fast
    radius, ends = float(np.sqrt((axes**2).sum(axis=0).max())), [axes.min(axis=1), axes.max(axis=1)]
    shown = bool(mask.any())
    if not (shown and closely and np.ptp(ends, axis=0).max() > SMALLEST_EXTENT * min(radius, 1)):
        return _Seen(radius, np.stack(ends), shown, np.nan, outer, "", {})
    some = points[:: max(1, len(points) // _POINTS)]
    silhouette = Silhouette(mask, len(some))
    fit = silhouette.fit(*camera.project(some, sample.intrinsics, outer))
    depth, others = "", dict[str, tuple[float, np.ndarray]]()
    if fit >= _FIT and sample.depth is not None:
        seen = camera.project(points[:: max(1, len(points) // 4096)], sample.intrinsics, outer)
        depth = _wrong_depth(sample.depth, mask, *silhouette.ratios(sample.depth, *seen))
    elif fit < _FIT and try_others:
        for what, extrinsics, *seen in _conventions(some, sample.intrinsics, outer, mask.shape):
            found = silhouette.fit(*seen), extrinsics
            others[what] = max(found, others.get(what, found), key=lambda pair: pair[0])
        if not mask.all():
            inverse = Silhouette(~mask, len(some))
            found = inverse.fit(*camera.project(some, sample.intrinsics, outer)), outer
            others["a mask of the background: invert it"] = found
    return _Seen(radius, np.stack(ends), shown, fit, outer, depth, others)


class Doubts:
    """Collects samples by `add`; `lines` lists the probable mistakes.

    After the first samples, only `every` n-th is compared with its image, which takes a tenth of
    the time to encode it.
    """

    def __init__(self, every: int = 1) -> None:
        self._every = every
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
            number = len(self._seen)
            closely = number < _CLOSELY or number % self._every == 0
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
            yield from self._about_samples()
        yield from _in_two_splits("models are", self._twice)
        same = {model: two for model, two in self._same.items() if model not in self._twice}
        yield from _in_two_splits("models have a cloud that is", same)

    def _about_samples(self) -> Iterator[str]:
        seen = self._seen
        of, compared = f"of {len(seen)} samples", [each for each in seen if each.fit >= 0]
        if empty := sum(not each.shown for each in seen):
            yield f"{empty} {of} have an empty mask: leave them out"
        cameras = [each.extrinsics for each in compared if each.fit >= _FIT]
        wrong, enough = [each for each in compared if each.fit < _FIT], _SHARE * len(compared)
        what = ""
        if len(wrong) > enough:
            what, corrected = _best(wrong)
            cameras = corrected or cameras
            yield (
                f"{len(wrong)} of {len(compared)} samples have points that do not project onto the "
                f"mask: {what}"
            )
        up, text = _frame(np.array(cameras), seen) if cameras else ("+z", "")
        if text:
            yield f"frame of {len(cameras)} samples: {text}"
        radius = np.array([each.radius for each in seen])
        lowest = np.array([_lowest(each.ends, up) for each in seen])
        extent = np.array([np.ptp(each.ends, axis=0).max() for each in seen])
        one_place = extent <= SMALLEST_EXTENT * np.minimum(radius, 1)
        far = ~one_place & ((radius < _RADII[0]) | (radius > _RADII[1]))
        off = ~one_place & (np.abs(lowest) > _GROUND * radius)
        if one_place.any():
            yield f"{one_place.sum()} {of} have all points in one place: leave them out"
        if far.any():
            yield (
                f"{far.sum()} {of} have their farthest point {_range(radius[far])} from the "
                "origin, expected about 1: divide points, depth and the translation of extrinsics "
                "by the radius of the bounding hemisphere"
            )
        if off.any() and not what.startswith("points"):
            yield (
                f"{off.sum()} {of} have their lowest point at z = {_range(lowest[off])}, expected "
                "0: move the origin of points and extrinsics onto the ground below the object"
            )
        depths = [each.depth for each in compared if each.depth]
        if len(depths) > enough:
            most = max(depths, key=depths.count)
            yield f"{len(depths)} of {len(compared)} samples have {most}"


def _best(wrong: list[_Seen]) -> tuple[str, list[np.ndarray]]:
    """The convention that fits most of the samples with the wrong one, and its extrinsics.

    Of conventions that fit equally, the one is likelier whose cameras are level in the frame.
    """
    tried = [each.others for each in wrong if each.others]

    def score(what: str) -> float:
        of_all = [found[what] for found in tried]
        level = np.mean([_level(extrinsics) for _, extrinsics in of_all])
        return float(np.mean([fit for fit, _ in of_all]) + 0.1 * level)

    for what in sorted(tried[0], key=score, reverse=True):
        fitting = [e[what][1] for e in tried if e[what][0] >= max(_FIT, e[""][0] + _CLEARLY)]
        if what and len(fitting) >= _MOST * len(tried):
            return what, fitting
    return "check intrinsics, extrinsics, mask and points against docs/data.md", []


def _level(extrinsics: np.ndarray) -> bool:
    """Whether +z is up in the image and +y is to its right."""
    return bool(extrinsics[0, 1] > 1 - _ROLL**2 and extrinsics[1, 2] < _ROLL)


def _lowest(ends: np.ndarray, up: str) -> float:
    columns, signs = _UP[up]
    return float((ends[:, columns[2]] * signs[2]).min())


def _frame(cameras: np.ndarray, seen: list[_Seen]) -> tuple[str, str]:
    """The axis that is up, and what is wrong with the frame, "" = nothing."""
    if np.mean([not _level(each) for each in cameras]) <= _SHARE:
        return "+z", ""

    def score(up: str) -> float:
        columns, signs = _UP[up]
        right, down, _ = (cameras[:, :, columns[2]] * signs[2]).T
        stands = [abs(_lowest(each.ends, up)) <= _GROUND * each.radius for each in seen]
        level = (np.abs(right) < _ROLL) & (down < _ROLL)
        return float(level.mean() + np.mean(stands) - 0.1 * down.mean())

    up = max(_UP, key=score)
    columns, signs = _UP[up]
    turned = cameras[:, :, [*columns, 3]] * [*signs, 1]
    remedies = []
    if up != "+z":
        remedies.append(
            f"{up} is up, not +z: use points[:, {columns}] * {signs} and "
            f"extrinsics[:, {[*columns, 3]}] * {[*signs, 1]}"
        )
    if np.mean([not _level(each) for each in turned]) > _SHARE:
        remedies.append(
            "points in the object's own frame, +y is not to the right of the image: turn them and "
            "extrinsics about z by psgn_jax.data.camera.turn_to_view"
        )
    return up, "; then ".join(remedies)


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
