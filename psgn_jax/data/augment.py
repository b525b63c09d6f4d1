"""Augmentations of training samples that keep image, mask, depth, camera and points consistent.

After each augmentation, the camera still projects the points onto the object in the image and is
still valid (right-handed rotation, positive focal lengths). The exception is `reframe` of a view
from another angle than the authors': its points do not move with its image.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from psgn_jax.config.data import DataConfig
from psgn_jax.data import camera, framing, resample
from psgn_jax.data.effects import disturb


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """The fields of a `schema.Sample` that augmentations change, with a subset of the points."""

    image: np.ndarray
    mask: np.ndarray
    depth: np.ndarray | None
    points: np.ndarray
    intrinsics: np.ndarray
    extrinsics: np.ndarray
    occupancy: np.ndarray | None = None


def flip(view: View) -> View:
    """Mirrors the world, y to -y, and the image, left to right. It is its own inverse.

    With M = diag(-1, 1, 1) and N = diag(1, -1, 1) the camera (R, t) becomes (M R N, M t), a proper
    rotation again, and column cx becomes W - cx (pixel edges are at integers).
    """
    intrinsics = view.intrinsics.copy()
    intrinsics[0, 1] *= -1
    intrinsics[0, 2] = view.image.shape[1] - intrinsics[0, 2]
    extrinsics = view.extrinsics.copy()
    extrinsics[0] *= -1
    extrinsics[:, 1] *= -1
    return View(
        image=view.image[:, ::-1],
        mask=view.mask[:, ::-1],
        depth=None if view.depth is None else view.depth[:, ::-1],
        points=view.points * np.array([1, -1, 1], np.float32),
        intrinsics=intrinsics + np.float32(0),  # no -0 for the skew
        extrinsics=extrinsics + np.float32(0),
        occupancy=None if view.occupancy is None else view.occupancy[:, ::-1],
    )


def stretch(view: View, factor: float) -> View:
    """Scales y by `factor`, and the image about its principal column.

    This is exact if the image's x axis is parallel to the frame's y axis. Then y affects only the
    column, column - cx = fx (+-y + t0) / z, and t0 is multiplied by the same factor. Colours are
    interpolated between columns; mask and depth take the nearest column. Columns without a source
    become grey. The occupancy does not change; `config.experiment` refuses the combination.
    """
    width = view.image.shape[1]
    centre = float(view.intrinsics[0, 2])
    # Source coordinate of each column's centre; a column i has its centre at i + 0.5.
    source = centre + (np.arange(width) + 0.5 - centre) / factor
    image, mask = resample.stretch(view.image, view.mask, source)
    extrinsics = view.extrinsics.copy()
    extrinsics[0, 3] *= np.float32(factor)
    depth = None if view.depth is None else resample.take_nearest(view.depth, source)[0]
    points = view.points * np.array([1, factor, 1], np.float32)
    return dataclasses.replace(
        view, image=image, mask=mask, depth=depth, points=points, extrinsics=extrinsics
    )


def recrop(view: View, factor: float, shift: tuple[float, float]) -> View:
    """Scales the image about its middle and shifts it: another crop of the same scene.

    The camera changes, the points do not. Colours are interpolated; mask and depth take the nearest
    pixel; pixels without a source become grey. The scale and the shift (down, right), in pixels,
    are reduced if the object would leave the image.
    """
    (height, width), (down, right) = view.mask.shape, shift
    shown = view.mask if view.mask.any() else np.ones_like(view.mask)
    top, bottom, left, last = resample.box_of(shown)
    factor = min(factor, height / (bottom - top), width / (last - left))
    move = framing.Move(factor, (1 - factor) * width / 2 + right, (1 - factor) * height / 2 + down)
    move = framing.keep_inside(move, shown)
    offset = move.down, move.right
    image, mask = resample.recrop(view.image, view.mask, factor, offset)
    depth = view.depth
    if depth is not None:
        depth = resample.resample(depth, mask.shape, factor, offset)
    intrinsics = view.intrinsics.copy()
    intrinsics[:2] *= np.float32(factor)
    intrinsics[:2, 2] += np.array([move.right, move.down], np.float32)
    return dataclasses.replace(view, image=image, mask=mask, depth=depth, intrinsics=intrinsics)


def follow(view: View, move: framing.Move) -> View:
    """Moves image, mask, depth and points together and keeps the camera (`data.framing`).

    The background becomes grey. A view without an object does not change.
    """
    if not view.mask.any():
        return view
    size = view.mask.shape[0], view.mask.shape[1]
    image, mask = framing.move_image(view.image, view.mask, move.matrix(), size)
    depth = view.depth
    if depth is not None:
        depth = framing.move_depth(depth, view.points, move, view.extrinsics)
        depth = np.where(mask, depth, np.float32(0))
    points = framing.move_points(view.points, move, view.intrinsics, view.extrinsics)
    return dataclasses.replace(view, image=image, mask=mask, depth=depth, points=points)


def place(view: View) -> View:
    """Places the object, with its points, by the rule of `data.framing`.

    A view that shows too little of its object does not change (`framing.rule_move_within`).
    """
    move = framing.rule_move_within(view.mask)
    return view if move is None else follow(view, move)


def reframe(view: View, rng: np.random.Generator, cfg: DataConfig) -> View:
    """Places image and points by the rule with the probability `cfg.place`, then moves them.

    The scale is about the object's middle. `config.data` describes `reframe_scale` and
    `reframe_shift`. The number of draws from `rng` does not depend on the configuration.

    A view without depth from another angle than the authors' (`framing.has_authors_angle`) is
    always placed, unless `cfg.place` is 0 or the view shows too little of its object. The points
    of such a view are placed as if the authors' camera had taken the image, and the result has the
    authors' camera. So the points of an object have nearly the same scale and position for every
    angle.
    """
    placed = rng.random() < cfg.place
    size, down, right = np.clip(rng.standard_normal(3), -2, 2).tolist()
    if not view.mask.any():
        return view
    other_angle = view.depth is None and not framing.has_authors_angle(view.extrinsics)
    placed |= cfg.place > 0 and other_angle
    rule = framing.rule_move_within(view.mask) if placed else None
    scale = math.exp(cfg.reframe_scale * size)

    def scattered(
        first: framing.Move, box: tuple[float, float, float, float], shape: tuple[int, ...]
    ) -> framing.Move:
        """`first`, then the random scale about the middle of the box and the random shift."""
        top, bottom, left, right_edge = box
        column = first.scale * (left + right_edge) / 2 + first.right
        row = first.scale * (top + bottom) / 2 + first.down
        # Both shifts are fractions of the view's height. `across` is this height in columns of the
        # array, whose pixels need not be square.
        across = framing.VIEW_SIZE[0] / framing.VIEW_SIZE[1] * shape[1]
        shift = (cfg.reframe_shift * right) * across, (cfg.reframe_shift * down) * shape[0]
        second = framing.Move(scale, (1 - scale) * column + shift[0], (1 - scale) * row + shift[1])
        return first.then(second)

    move = rule
    if cfg.reframe_scale or cfg.reframe_shift:
        start = rule or framing.Move(1.0, 0.0, 0.0)
        move = scattered(start, resample.box_of(view.mask), view.mask.shape)
        move = framing.keep_inside(move, view.mask)
    if move is None:
        return view
    moved = follow(view, move)
    box = framing.box_from_authors_angle(view.points) if rule and other_angle else None
    first = box and framing.rule_move_of(box)
    if not (box and first):
        return moved
    move = scattered(first, box, framing.VIEW_SIZE)
    intrinsics, extrinsics = camera.default_camera(framing.VIEW_SIZE)
    points = framing.move_points(view.points, move, intrinsics, extrinsics)
    intrinsics = camera.scale_intrinsics(intrinsics, framing.VIEW_SIZE, view.mask.shape)
    return dataclasses.replace(moved, points=points, intrinsics=intrinsics, extrinsics=extrinsics)


def colour_jitter(view: View, rng: np.random.Generator, strength: float) -> View:
    """Changes brightness, contrast (about middle grey) and each channel's gain on the object.

    Each change is uniform within +-`strength` (gains within half of it), the brightness in units of
    a quarter of the full range. The background keeps its colour.
    """
    brightness, contrast = rng.uniform(-strength, strength, 2)
    gains = 1 + rng.uniform(-strength, strength, 3) / 2
    values = np.arange(256)[:, None]
    table = ((values - 127.5) * (1 + contrast) + 127.5 + 64 * brightness) * gains
    table = np.clip(np.rint(table), 0, 255).astype(np.uint8)
    image = view.image.copy()
    if view.mask.any():
        top, bottom, left, right = resample.box_of(view.mask)
        part = np.s_[top:bottom, left:right]
        for channel in range(3):
            plane = image[part][..., channel]
            np.copyto(plane, table[:, channel].take(plane), where=view.mask[part])
    return dataclasses.replace(view, image=image)


def augment(
    view: View, cfg: DataConfig, rng: np.random.Generator, photo_seeds: Sequence[int]
) -> View:
    """Applies the augmentations that the configuration enables.

    `rng` draws mirroring, width, crop and colours; `photo_seeds` seed the effects and the framing.
    """
    mirrored, factor = rng.random(), 1 + cfg.stretch * rng.uniform(-1, 1)
    zoom, move = rng.uniform(-1, 1), rng.uniform(-1, 1, 2)
    if cfg.flip and mirrored < 0.5:
        view = flip(view)
    if cfg.stretch:
        # `stretch` is exact if the camera is neither rolled nor skewed.
        off = np.abs(np.abs(view.extrinsics[0, :3]) - [0, 1, 0]).max()
        if off <= 1e-4 and not view.intrinsics[0, 1]:
            view = stretch(view, factor)
    if cfg.zoom or cfg.shift:
        down, right = cfg.shift * move * view.mask.shape
        view = recrop(view, 1 + cfg.zoom * zoom, (down, right))
    if cfg.colour_jitter:
        view = colour_jitter(view, rng, cfg.colour_jitter)
    framed = cfg.place or cfg.reframe_scale or cfg.reframe_shift
    if framed or cfg.photo.any():
        framing_rng, effects_rng = np.random.default_rng(photo_seeds).spawn(2)
        if cfg.photo.any():
            image, mask = disturb(view.image, view.mask, effects_rng, cfg.photo)
            depth = None if view.depth is None else np.where(mask, view.depth, np.float32(0))
            view = dataclasses.replace(view, image=image, mask=mask, depth=depth)
        if framed:
            # The rule uses the disturbed mask, because masks of photos are imperfect too.
            view = reframe(view, framing_rng, cfg)
    return view
