"""The augmentations of `data.augment` that an accelerator computes, in jax.numpy.

With the same random numbers, results are those of `data.augment` up to rounding: colours differ by
at most one level, mask and depth at single pixels of an edge. Functions take one sample; use
`jax.vmap` for batches.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from psgn_jax.data import schema
from psgn_jax.data_config import DataConfig
from psgn_jax.types import Array, Bool, Float, PRNGKey, UInt8


class View(NamedTuple):
    """As `data.augment.View`."""

    image: UInt8[Array, "h w 3"]
    mask: Bool[Array, "h w"]
    depth: Float[Array, "h w"] | None
    points: Float[Array, "p 3"]
    intrinsics: Float[Array, "3 3"]
    extrinsics: Float[Array, "3 4"]
    occupancy: Bool[Array, "32 32 32"] | None


class Draws(NamedTuple):
    """Random numbers of one sample, all uniform: see `data.augment.augment`.

    Attributes:
      mirrored: in [0, 1); mirrors if it is below 1/2. All following fields are in [-1, 1), as
        fractions of the largest change that the configuration allows.
      stretch: relative change of the width.
      zoom: relative change of the scale.
      shift: down and right.
      light: brightness and contrast.
      gains: of the channels.
    """

    mirrored: Float[Array, ""]
    stretch: Float[Array, ""]
    zoom: Float[Array, ""]
    shift: Float[Array, "2"]
    light: Float[Array, "2"]
    gains: Float[Array, "3"]


def draw(key: PRNGKey) -> Draws:
    """The random numbers of one sample; they do not depend on the configuration."""
    values = jax.random.uniform(key, (10,))
    signed = 2 * values - 1
    return Draws(values[0], signed[1], signed[2], signed[3:5], signed[5:7], signed[7:])


def augment(cfg: DataConfig, view: View, draws: Draws, can_stretch: Bool[Array, ""]) -> View:
    """All augmentations that the configuration enables, in the order of `data.augment`."""
    if cfg.flip:
        mirrored = flip(view)
        view = jax.tree.map(
            lambda new, old: jnp.where(draws.mirrored < 0.5, new, old), mirrored, view
        )
    if cfg.stretch:
        view = stretch(view, jnp.where(can_stretch, 1 + cfg.stretch * draws.stretch, 1))
    if cfg.zoom or cfg.shift:
        size = jnp.array(view.mask.shape, jnp.float32)
        view = recrop(view, 1 + cfg.zoom * draws.zoom, cfg.shift * draws.shift * size)
    if cfg.colour_jitter:
        light, gains = cfg.colour_jitter * draws.light, 1 + cfg.colour_jitter * draws.gains / 2
        view = colour_jitter(view, light[0], light[1], gains)
    return view


def flip(view: View) -> View:
    """Mirrors the world, y to -y, and the image, left to right."""
    intrinsics = view.intrinsics.at[0, 1].multiply(-1)
    intrinsics = intrinsics.at[0, 2].set(view.image.shape[1] - intrinsics[0, 2])
    extrinsics = view.extrinsics.at[0].multiply(-1).at[:, 1].multiply(-1)
    return View(
        image=view.image[:, ::-1],
        mask=view.mask[:, ::-1],
        depth=None if view.depth is None else view.depth[:, ::-1],
        points=view.points * jnp.array([[1.0, -1.0, 1.0]]),
        intrinsics=intrinsics,
        extrinsics=extrinsics,
        occupancy=None if view.occupancy is None else view.occupancy[:, ::-1],
    )


def _has_grey_background(view: View) -> Bool[Array, ""]:
    """Whether all pixels of the border, except those of the object, have the plain grey."""
    plain = view.mask | (view.image == schema.BACKGROUND_GREY).all(axis=-1)
    return plain[0].all() & plain[-1].all() & plain[:, 0].all() & plain[:, -1].all()


def _pixels(view: View, rows: Array, columns: Array, extend: Array) -> Array:
    """Colours [..., 3] at integer coordinates, which may lie outside the image.

    Outside, the edge is repeated or, with `extend`, the image is extended as by
    `data.augment._extend`.
    """
    height, width = view.mask.shape
    edge = jnp.clip(rows, 0, height - 1), jnp.clip(columns, 0, width - 1)
    outside = (edge[0] != rows) | (edge[1] != columns)
    again = _mirrored(rows, height), _mirrored(columns, width)
    use_edge = ~extend | view.mask[again]
    at = tuple(jnp.where(use_edge, e, a) for e, a in zip(edge, again, strict=True))
    chosen = tuple(jnp.where(outside, a, e) for a, e in zip(at, edge, strict=True))
    grey = outside & extend & view.mask[again] & view.mask[edge]
    return jnp.where(grey[..., None], schema.BACKGROUND_GREY, view.image[chosen])


def _mirrored(index: Array, size: int) -> Array:
    index = index % (2 * size)
    return jnp.where(index < size, index, 2 * size - 1 - index)


def stretch(view: View, factor: Float[Array, ""]) -> View:
    """Scales y by `factor`, and the image about its principal column."""
    height, width = view.mask.shape
    centre = view.intrinsics[0, 2]
    source = centre + (jnp.arange(width) + 0.5 - centre) / factor
    nearest = jnp.floor(source).astype(jnp.int32)
    vacated = (nearest < 0) | (nearest >= width)
    nearest = jnp.clip(nearest, 0, width - 1)
    grey = ~vacated.any() | _has_grey_background(view)
    left = jnp.floor(source - 0.5)
    weight = jnp.rint((source - 0.5 - left) * 256).astype(jnp.int32)[None, :, None]
    rows = jnp.arange(height)[:, None]
    columns = left.astype(jnp.int32)[None, :]
    rows, columns = jnp.broadcast_arrays(rows, columns)
    lower = _pixels(view, rows, columns, ~grey).astype(jnp.int32)
    upper = _pixels(view, rows, columns + 1, ~grey).astype(jnp.int32)
    image = ((lower * (256 - weight) + upper * weight + 128) >> 8).astype(jnp.uint8)
    fill = (grey & vacated)[None, :, None]
    image = jnp.where(fill, jnp.uint8(schema.BACKGROUND_GREY), image)
    depth = None
    if view.depth is not None:
        depth = jnp.where(vacated[None], 0, view.depth[:, nearest])
    scale = jnp.stack([jnp.ones(()), factor, jnp.ones(())])
    return view._replace(
        image=image,
        mask=view.mask[:, nearest] & ~vacated[None],
        depth=depth,
        points=view.points * scale[None],
        extrinsics=view.extrinsics.at[0, 3].multiply(factor),
    )


def _extent(occupied: Bool[Array, " n"]) -> tuple[Array, Array]:
    """First index that is True, and one after the last; the whole axis if none is."""
    size = len(occupied)
    low, high = jnp.argmax(occupied), size - jnp.argmax(occupied[::-1])
    return low, jnp.where(occupied.any(), high, size)


def recrop(view: View, factor: Float[Array, ""], shift: Float[Array, "2"]) -> View:
    """Scales the image about its middle, then moves it by (down, right) pixels."""
    sizes = view.mask.shape
    extents = [_extent(view.mask.any(axis=1)), _extent(view.mask.any(axis=0))]
    for size, (low, high) in zip(sizes, extents, strict=True):
        factor = jnp.minimum(factor, size / (high - low))
    sources, moves = [], []
    for axis, (size, (low, high)) in enumerate(zip(sizes, extents, strict=True)):
        offset = (1 - factor) * size / 2 + shift[axis]
        move = jnp.clip(offset, -factor * low, size - factor * high)
        sources.append((jnp.arange(size) + 0.5 - move) / factor)
        moves.append(move)
    inside = [(s >= 0) & (s < size) for s, size in zip(sources, sizes, strict=True)]
    extend = ~(inside[0].all() & inside[1].all()) & ~_has_grey_background(view)
    image = _bilinear(view, sources[0], sources[1], extend)
    within = inside[0][:, None] & inside[1][None]
    fill = ~(within | extend)[..., None]
    image = jnp.where(fill, jnp.uint8(schema.BACKGROUND_GREY), image)
    nearest = [
        jnp.clip(jnp.floor(s).astype(jnp.int32), 0, size - 1)
        for s, size in zip(sources, sizes, strict=True)
    ]
    take = nearest[0][:, None], nearest[1][None]
    intrinsics = view.intrinsics.at[:2].multiply(factor)
    return view._replace(
        image=image,
        mask=view.mask[take] & within,
        depth=None if view.depth is None else jnp.where(within, view.depth[take], 0),
        intrinsics=intrinsics.at[:2, 2].add(jnp.stack([moves[1], moves[0]])),
    )


def _bilinear(view: View, down: Array, across: Array, extend: Array) -> UInt8[Array, "h w 3"]:
    """Colours at rows `down` [h] and columns `across` [w], edges at integers."""
    top, left = jnp.floor(down - 0.5), jnp.floor(across - 0.5)
    y, x = (down - 0.5 - top)[:, None, None], (across - 0.5 - left)[None, :, None]
    rows, columns = jnp.broadcast_arrays(
        top.astype(jnp.int32)[:, None], left.astype(jnp.int32)[None]
    )

    def at(i: int, j: int) -> Array:
        return _pixels(view, rows + i, columns + j, extend).astype(jnp.float32)

    upper = at(0, 0) + (at(0, 1) - at(0, 0)) * x
    lower = at(1, 0) + (at(1, 1) - at(1, 0)) * x
    return (upper + (lower - upper) * y).astype(jnp.uint8)


def colour_jitter(view: View, brightness: Array, contrast: Array, gains: Float[Array, "3"]) -> View:
    """Changes brightness, contrast (about middle grey) and each channel's gain on the object."""
    values = view.image.astype(jnp.float32)
    values = ((values - 127.5) * (1 + contrast) + 127.5 + 64 * brightness) * gains[None, None]
    changed = jnp.clip(jnp.rint(values), 0, 255).astype(jnp.uint8)
    return view._replace(image=jnp.where(view.mask[..., None], changed, view.image))
