"""Compares samples with the schema and finds probable mistakes, each with its cause and remedy.

**Camera.** The *fit* of a sample is the smaller of two fractions: of the points that project near
the mask, and of the mask that is near a projected point. Near is 5 % of the longer side of the
mask's box. If the mask reaches the border, points that project outside of the image do not count.
If more than `_SHARE` of the samples have a fit below `FLAG_BELOW`, we try the usual other
conventions and name the one that fits. If none does, as many must be below `_OFF`. (Of the authors'
1,759 samples, .2 % are below both: their images show a part of the object.) Among the samples that
fit, the points must be as wide in the image as the mask.

**Frame.** Points and cameras can agree in a frame with another axis up, or in the object's own.
The right of the image has a horizontal part in the frame. Its direction must be +y.

**Depth and volume.** In most places, the foremost point must have the depth of the map. The points
must be in occupied cells of the volume or beside them.
"""

import itertools
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from psgn_jax.data import camera
from psgn_jax.data.manifest import DUPLICATES
from psgn_jax.data.schema import OCCUPANCY_SIZE, SMALLEST_EXTENT

# Accepted radii, and the accepted height of the lowest point as a share of the radius.
_RADII, _GROUND = (0.5, 2.0), 0.1
FLAG_BELOW, _OFF, _SHARE = 0.75, 0.5, 0.1  # fits, and a share of the samples
_CLEARLY, _MOST = 0.1, 0.75  # a convention is named if its fit is larger, for most of the samples
_GRID, _MARGIN = 48, 12  # cells along the longer side of the mask's box, and around the box
_NEAR = 2.5  # cells
# We compare the first samples with their images, then every 16th: a tenth of the time to encode.
_CLOSELY, _EVERY = 128, 16
_TRIED, _POINTS = 16, 1000  # samples for which we try other conventions, and points of each
_TURN = float(np.sin(np.deg2rad(20)))  # accepted between the image's right and +y
_RATIO, _FEWEST = 1.1, 20  # accepted ratio of depths or widths; fewest depths to compare

# What a sample may have in place of the schema, with the remedy -> the right values, of what it
# has: intrinsics K and image size (width, height), rotation R and last column t, signs of the
# camera's axes, columns and rows of pixels.
_INTRINSICS: Mapping[str, Any] = {
    "": lambda k, size: k,
    "intrinsics in 0..1: multiply row 1 by the width and row 2 by the height":
        lambda k, size: np.diag([*size, 1]) @ k,
    "intrinsics of another image size: scale rows 1 and 2 as the image":
        lambda k, size: np.diag([*(size / 2 / np.maximum(abs(k[:2, 2]), 1e-6)), 1]) @ k,
    "intrinsics in -1..1: multiply by half the width and height, and add these to cx and cy":
        lambda k, size: np.array([[size[0] / 2, 0, size[0] / 2], [0, size[1] / 2, size[1] / 2],
                                  [0, 0, 1]]) @ k,
    "cx and cy counted from the image's centre: add half the width and height":
        lambda k, size: k + np.array([[0, 0, size[0] / 2], [0, 0, size[1] / 2], [0, 0, 0]]),
    "intrinsics with cx and cy swapped: swap them":
        lambda k, size: np.column_stack([k[:, :2], k[[1, 0, 2], 2]]),
}  # fmt: skip
_POSES: Mapping[str, Any] = {
    "": lambda r, t: (r, t),
    "extrinsics from camera to world: invert them": lambda r, t: (r.T, -r.T @ t),
    "extrinsics with a transposed rotation: transpose it": lambda r, t: (r.T, t),
    "a position C as last column of extrinsics: use -R @ C": lambda r, t: (r, -r @ t),
}
_AXES = {
    "": (1, 1, 1),
    "cameras of OpenGL or Blender: negate rows 2 and 3 of extrinsics": (1, -1, -1),
    "cameras of PyTorch3D: negate rows 1 and 2 of extrinsics": (-1, -1, 1),
}
_IMAGES: Mapping[str, Any] = {
    "mirrored left to right: flip their columns": lambda x, y, w, h: (w - x, y),
    "upside down and mirrored: flip their rows": lambda x, y, w, h: (x, h - y),
    "turned by 180 degrees: turn them back": lambda x, y, w, h: (w - x, h - y),
    "turned by 90 degrees: turn them back": lambda x, y, w, h: (y, h - x),
    "turned by -90 degrees: turn them back": lambda x, y, w, h: (w - y, x),
    "with rows and columns swapped: transpose them": lambda x, y, w, h: (y, x),
}
# The axis that is up -> columns and signs for points and extrinsics, which make it +z.
_UP = {
    "+z": ([0, 1, 2], [1, 1, 1]),
    "+y": ([0, 2, 1], [1, -1, 1]),
    "-y": ([0, 2, 1], [1, 1, -1]),
    "+x": ([2, 1, 0], [-1, 1, 1]),
    "-x": ([2, 1, 0], [1, 1, -1]),
    "-z": ([0, 1, 2], [1, -1, -1]),
}
_NORMAL = (
    "use normal_form and normalised_extrinsics of psgn_jax.data.framing for points and extrinsics, "
    "and divide depth"
)
_ABOUT_Z = "points turned about z against the camera: turn them by the azimuth of the view"
_TURNS = [
    (f"points with other axes: use points[:, {columns}] * {signs}", np.eye(3)[:, columns] * signs)
    for columns, signs in _UP.values()
]
_TURNS += [
    (_ABOUT_Z, np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]]))
    for a in np.arange(1, 24) * np.pi / 12
]


def _conventions(
    points: np.ndarray, inner: np.ndarray, outer: np.ndarray, shape: tuple[int, ...]
) -> Iterator[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Each hypothesis, the schema itself ("") first; its extrinsics, pixels and depths."""
    size = np.array(shape[::-1])
    cameras = itertools.product(_INTRINSICS.items(), _POSES.items(), _AXES.items())
    for (one, of_pixels), (two, of_pose), (three, signs) in cameras:
        extrinsics = np.diag(signs) @ np.column_stack(of_pose(outer[:, :3], outer[:, 3]))
        projected = camera.project(points, of_pixels(inner, size), extrinsics)
        yield "; then ".join(filter(None, (one, two, three))), extrinsics, *projected
    pixels, depth = camera.project(points, inner, outer)
    for what, moved in _IMAGES.items():
        pairs = np.column_stack(moved(*pixels.T, *size))
        yield f"image, mask and depth {what}", outer, pairs, depth
    in_camera = "points in the camera's frame: use (points - extrinsics[:, 3]) @ extrinsics[:, :3]"
    yield in_camera, outer, *camera.project(points, inner, np.eye(3, 4))
    for what, turn in _TURNS:
        yield what, outer, *camera.project(points @ turn, inner, outer)


class _Silhouette:
    """A mask on a small grid around its box, with which projected points are compared."""

    def __init__(self, mask: np.ndarray, num_points: int) -> None:
        step = max(1, max(mask.shape) // 512)  # bounds memory and time for large images
        shown = np.argwhere(mask[::step, ::step])[:, ::-1] * step
        shown = shown if len(shown) else np.argwhere(mask)[:, ::-1]
        low, high = self._box = shown.min(axis=0), shown.max(axis=0) + step
        self._size = np.array(mask.shape[::-1])
        self._cut = bool((low <= 0).any() or (high >= self._size).any())
        self._cell = max(float(step), (high - low).max() / _GRID)
        self._low = low - _MARGIN * self._cell
        self._mask = np.zeros((_GRID + 2 * _MARGIN,) * 2, np.bool_)
        self._mask[tuple(((shown + 0.5 - self._low) / self._cell).astype(int).T)] = True
        self._distance = ndimage.distance_transform_edt(~self._mask)
        self._gap = max(_NEAR, 2.5 * np.sqrt(self._mask.sum() / num_points))

    def _cells(self, pixels: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, Any]:
        """Which projected points [n, 2] with depths [n] are on the grid, and their cells."""
        cells = (pixels - self._low) / self._cell
        shown = (depth > 0) & ((cells >= 0) & (cells < len(self._mask))).all(axis=1)
        return shown, tuple(cells[shown].astype(int).T)

    def fit(self, pixels: np.ndarray, depth: np.ndarray) -> float:
        shown, cells = self._cells(pixels, depth)
        if not shown.any():
            return 0.0
        seen = (depth > 0) & ((pixels >= 0) & (pixels < self._size)).all(axis=1)
        if not self._cut:
            seen[:] = True
        near = (self._distance[cells] <= _NEAR) & seen[shown]
        inside = near.sum() / max(1, seen.sum())
        empty = np.ones_like(self._mask)
        empty[cells] = False
        covered = ndimage.distance_transform_edt(empty)[self._mask] <= self._gap
        return float(min(inside, covered.mean()))

    def width(self, pixels: np.ndarray) -> float:
        """How wide the points are, in widths of the mask; 1 if they exceed only one side of it."""
        left, right = (end[0] for end in self._box)
        more = np.array([left - pixels[:, 0].min(), pixels[:, 0].max() - right])
        # A pixel at each edge belongs to the object or not.
        clearly = (abs(more) > 1).all() and more.prod() > 0
        same = clearly and not self._cut and len(pixels) >= _POINTS
        return float(1 + more.sum() / (right - left)) if same else 1.0

    def wrong_depth(self, depth_map: np.ndarray, pixels: np.ndarray, depth: np.ndarray) -> str:
        """What is wrong with a depth map, "" = nothing."""
        shown, cells = self._cells(pixels, depth)
        depth, nearest = depth[shown], np.full(self._mask.shape, np.inf)
        np.minimum.at(nearest, cells, depth)
        columns, rows = np.clip(pixels[shown].astype(int), 0, np.array(depth_map.shape[::-1]) - 1).T
        mapped = depth_map[rows, columns]
        chosen = (depth <= nearest[cells]) & (mapped > 0)
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


class _Compared(NamedTuple):
    """A sample that was compared with its image."""

    fit: float
    extrinsics: np.ndarray
    width: float  # of the points, in widths of the mask
    depth: str  # what is wrong with the depth
    inside: bool  # whether the points are in the volume
    others: Mapping[str, tuple[float, np.ndarray]]  # convention -> fit and extrinsics


@np.errstate(all="ignore")
def fit(sample: Any) -> float:
    """The fit of the module of a `Sample`, 0 to 1."""
    return _compared(sample, try_others=False).fit if sample.mask.any() else 0.0


@np.errstate(all="ignore")
def _compared(sample: Any, *, try_others: bool) -> _Compared:
    points, mask, inner, outer = sample.points, sample.mask, sample.intrinsics, sample.extrinsics
    some, more = (points[:: max(1, len(points) // count)] for count in (_POINTS, 4 * _POINTS))
    silhouette, projected = _Silhouette(mask, len(some)), camera.project(some, inner, outer)
    fit, width, depth = silhouette.fit(*projected), 1.0, ""
    others: dict[str, tuple[float, np.ndarray]] = {}
    if fit >= _OFF:
        pixels, z = camera.project(more, inner, outer)
        width = silhouette.width(pixels[z > 0])
        if fit >= FLAG_BELOW and sample.depth is not None:
            depth = _misplaced(sample.depth, mask)
            depth = depth or silhouette.wrong_depth(sample.depth, pixels, z)
    if fit < FLAG_BELOW and try_others:
        for what, extrinsics, *moved in _conventions(some, inner, outer, mask.shape):
            found = silhouette.fit(*moved), extrinsics
            others[what] = max(found, others.get(what, found), key=lambda pair: pair[0])
        inverse = _Silhouette(mask if mask.all() else ~mask, len(some))
        others["a mask of the background: invert it"] = inverse.fit(*projected), outer
    inside = sample.occupancy is None or _share_inside(sample.occupancy, some) >= FLAG_BELOW
    return _Compared(fit, outer, width, depth, inside, others)


def _misplaced(depth: np.ndarray, mask: np.ndarray) -> str:
    """What is wrong if a depth map has depths outside of the mask, "" = nothing."""
    for what, turned in (
        ("", depth),
        ("depth upside down, unlike the mask: flip its rows", depth[::-1]),
        ("depth mirrored left to right, unlike the mask: flip its columns", depth[:, ::-1]),
    ):
        if np.count_nonzero(turned[~mask]) <= _SHARE * mask.sum():
            return what
    return "depth outside of the mask: set it to 0 there"


def _share_inside(volume: np.ndarray, points: np.ndarray) -> float:
    """The share of points [n, 3] that are in an occupied cell or beside one."""
    near = ndimage.binary_dilation(np.pad(volume, 2), np.ones((3, 3, 3)))
    cells = np.floor(np.add(points, [1, 1, 0]) * (OCCUPANCY_SIZE / 2)) + 2
    return float(near[tuple(np.clip(cells, 0, OCCUPANCY_SIZE + 3).astype(int).T)].mean())


class Doubts:
    """Collects samples by `add`; `lines` lists the probable mistakes."""

    def __init__(self) -> None:
        # Of each sample: whether the mask shows something, whether the points are spread out, their
        # largest distance from the origin, and for each axis that may be up, the lowest point.
        self._seen: list[list[float]] = []
        self._compared: list[_Compared] = []
        # First split of a model or a cloud. Models that are, or whose cloud is, in two splits.
        self._first: dict[tuple[Any, ...], str] = {}
        self._models: dict[tuple[str, str], str] = {}
        self._clouds: dict[tuple[str, str], str] = {}

    def add(self, split: str, stored: Mapping[str, Any], sample: Any = None) -> None:
        """Adds the `codec.unpack` of a record, and its `Sample` (without image) if it is known.

        Without it, only models and clouds are compared. ValueError if it is no record.
        """
        try:
            model, cloud = (str(stored["category"]), str(stored["model_id"])), stored["points"]
            steps = cloud["steps"]
            crc32 = zlib.crc32(steps, zlib.crc32(cloud["matrix"]))
        except (KeyError, TypeError) as error:
            raise ValueError(f"a field is not as expected: {error}") from None
        if sample is not None:
            self._add_sample(sample)
        shown = repr(model[1]) + (f" ({model[0]})" if model[0] else "")
        for found, key in (self._models, model), (self._clouds, (len(steps), crc32)):
            known = split != DUPLICATES and key[1] != ""
            if known and (first := self._first.setdefault(key, split)) != split:
                found.setdefault(model, f"{shown} in {first!r} and {split!r}")

    def _add_sample(self, sample: Any) -> None:
        axes = np.ascontiguousarray(sample.points.T)  # reductions of its rows are fast
        ends = np.stack([axes.min(axis=1), axes.max(axis=1)])
        radius = np.sqrt((axes**2).sum(axis=0).max())
        spread = np.ptp(ends, axis=0).max() > SMALLEST_EXTENT * min(radius, 1)
        lowest = [(ends[:, columns[2]] * signs[2]).min() for columns, signs in _UP.values()]
        closely = len(self._seen) < _CLOSELY or len(self._seen) % _EVERY == 0
        self._seen.append([sample.mask.any(), spread, radius, *lowest])
        if closely and all(self._seen[-1][:2]):
            tried = sum(bool(each.others) for each in self._compared)
            self._compared.append(_compared(sample, try_others=tried < _TRIED))

    def lines(self) -> Iterator[str]:
        """A line for each kind of mistake, with the remedy."""
        if self._seen:
            yield from _about_samples(np.array(self._seen), self._compared)
        same = {m: where for m, where in self._clouds.items() if m not in self._models}
        for what, found in ("are", self._models), ("have a cloud that is", same):
            for where in list(found.values())[:1]:
                yield (
                    f"{len(found)} models {what} in two splits, such as {where}: keep all samples "
                    "of an object in one split, or the evaluation measures what was trained on"
                )


def _about_samples(seen: np.ndarray, compared: list[_Compared]) -> Iterator[str]:
    enough, of_compared = _SHARE * len(compared), f"of {len(compared)} samples have"
    right = [each.extrinsics for each in compared if each.fit >= FLAG_BELOW]
    wrong = [each for each in compared if each.fit < FLAG_BELOW]
    what, corrected = _best(wrong) if len(wrong) > enough else ("", [])
    if not what:  # thin objects vanish in small images
        wrong = [each for each in wrong if each.fit < _OFF]
    if len(wrong) > enough:
        what = what or (
            "check intrinsics, extrinsics, mask and points against docs/data.md; points that were "
            "scaled or moved need another camera (normalised_extrinsics)"
        )
        yield f"{len(wrong)} {of_compared} points that do not project onto the mask: {what}"
    shown, spread, radius, *lowest = seen.T
    low = dict(zip(_UP, lowest, strict=True))
    stands = {up: (abs(low[up]) <= _GROUND * radius).mean() for up in _UP}
    if what.startswith(("points", "check")):  # they say nothing about the frame of the cameras
        stands = dict.fromkeys(_UP, 0.0)
    up, remedy = _frame(np.array(corrected or right), stands)
    if remedy:
        yield f"frame of {len(compared)} samples: {remedy}"
    placed = (spread > 0) & (not what.startswith("points"))
    far = placed & ((radius < _RADII[0]) | (radius > _RADII[1]))
    off = placed & (abs(low[up]) > _GROUND * radius)
    off &= off.mean() > _SHARE  # some objects hang
    for found, text in (
        (shown == 0, "an empty mask: leave them out"),
        (spread == 0, "all points in one place: leave them out"),
        (far, f"their farthest point {_range(radius[far])} from the origin, expected about 1, the "
         f"radius of the bounding hemisphere: {_NORMAL}"),
        (off, f"their lowest point at z = {_range(low[up][off])}, expected 0, the ground below the "
         f"origin: {_NORMAL}"),
    ):  # fmt: skip
        if found.any():
            yield f"{found.sum()} of {len(seen)} samples have {text}"
    widths = [each.width for each in compared if each.fit >= _OFF]
    width = float(np.median(widths or 1))
    widths = [] if 1 / _RATIO < width < _RATIO else widths
    depths = [each.depth for each in compared if each.depth]
    outside = [each for each in compared if not (each.inside or remedy or far.any() or off.any())]
    for some, text in (
        (widths, f"points {width:.3g} times as wide as the mask: check the focal "
         "length (a field of view is that of the width or of the height), the scale of the points, "
         "and the mask"),
        (depths, max(depths, key=depths.count, default="")),
        (outside, "a volume that does not contain the points: index occupancy [x, y, z], over "
         "[-1, 1] x [-1, 1] x [0, 2]"),
    ):  # fmt: skip
        if len(some) > enough and not what:  # else they may follow from it
            yield f"{len(some)} {of_compared} {text}"


def _best(wrong: list[_Compared]) -> tuple[str, list[np.ndarray]]:
    """The convention that fits most of these samples, "" = none, and its extrinsics.

    Of conventions that fit equally, the one is likelier whose cameras are level in the frame.
    """
    tried = [each.others for each in wrong if each.others]

    def score(what: str) -> float:
        return float(np.mean([e[what][0] + 0.1 * _level(e[what][1]) for e in tried]))

    for what in sorted(tried[0], key=score, reverse=True):
        fitting = [e[what][1] for e in tried if e[what][0] >= max(FLAG_BELOW, e[""][0] + _CLEARLY)]
        if what and len(fitting) >= _MOST * len(tried):
            return what, fitting
    return "", []


def _level(extrinsics: np.ndarray) -> np.ndarray:
    """Whether +z is up in the image and +y is to its right, of extrinsics [..., 3, 4]."""
    right = np.linalg.norm(extrinsics[..., 0, :2], axis=-1).clip(_TURN)
    return (extrinsics[..., 0, 1] > (1 - _TURN**2) * right) & (extrinsics[..., 1, 2] < _TURN)


def _frame(cameras: np.ndarray, stands: Mapping[str, float]) -> tuple[str, str]:
    """The axis that is up, and what is wrong with the frame, "" = nothing."""
    lies = stands["+z"] < 0.5 <= max(stands.values())
    if len(cameras) and np.allclose(cameras, np.eye(3, 4)):
        return "+z", (
            "points in the camera's frame, extrinsics are the identity: turn both into a frame "
            "whose +z is up"
        )
    if not len(cameras) or ((~_level(cameras)).mean() <= _SHARE and not lies):
        return "+z", ""

    def score(up: str) -> float:
        columns, signs = _UP[up]
        right, down, _ = (cameras[:, :, columns[2]] * signs[2]).T
        level = (abs(right) < _TURN) & (down < _TURN)
        return float(level.mean() + stands[up] - 0.1 * down.mean())

    up, remedies = max(_UP, key=score), []
    columns, signs = [*_UP[up][0], 3], [*_UP[up][1], 1]
    if up != "+z":
        points = f"points[:, {columns[:3]}] * {signs[:3]}"
        remedies = [f"{up} is up, not +z: use {points} and extrinsics[:, {columns}] * {signs}"]
    if (~_level(cameras[:, :, columns] * signs)).mean() > _SHARE:
        remedies.append(
            "points in the object's own frame, +y is not to the right of the image: turn them and "
            "extrinsics about z by psgn_jax.data.camera.turn_to_view"
        )
    return up, "; then ".join(remedies)


def _range(values: np.ndarray) -> str:
    ends = [f"{end:.4g}" for end in (values.min(), values.max())] if len(values) else []
    return " to ".join(dict.fromkeys(ends))
