"""Augmentation of training images with typical defects of photos and their masks: `disturb`.

`psgn_jax.config.data.PhotoEffects` describes the settings; lengths are in pixels of an image with
192 rows. The effects are applied in this order:

1. An occluder at an edge of the object's box.
2. A background of smooth colours instead of plain grey, because the masks of photos include
   background pixels at their edges. At the end, the background is grey again.
3. Light: exposure and white balance as factors of linear values, v -> 255 (g (v/255)^2.2)^(1/2.2).
4. Lens and sensor: Gaussian blur, Gaussian noise.
5. JPEG compression.
6. The mask: eroded or dilated, with a ragged edge.
"""

import io

import numpy as np
from PIL import Image, ImageFilter

from psgn_jax.config.data import PhotoEffects
from psgn_jax.data import schema
from psgn_jax.data.camera import VIEW_SIZE
from psgn_jax.data.resample import box_of, on_mask

LEAST_LEFT = 0.4
"""An effect that would leave less than this share of the mask is skipped."""

_GAMMA = 2.2
_GRAIN = 8  # node distance of the random field of ragged edges, in pixels for 192 rows


def disturb(
    image: np.ndarray, mask: np.ndarray, rng: np.random.Generator, effects: PhotoEffects
) -> tuple[np.ndarray, np.ndarray]:
    """Applies the effects to image uint8 [h, w, 3] and mask bool [h, w]; grey 191 outside the mask.

    Each effect has its own random generator, so its choices do not depend on the other effects.
    Without an effect or an object, the arguments are returned.
    """
    if not effects.any() or not mask.any():
        return image, mask
    pixel = mask.shape[0] / VIEW_SIZE[0]
    # The object's box with a margin for its edge and the blur; the other pixels become grey.
    margin = int(np.ceil((effects.dilate + effects.ragged + 3 * effects.blur) * pixel)) + 2
    top, bottom, left, right = box_of(mask)
    part = np.s_[max(0, top - margin) : bottom + margin, max(0, left - margin) : right + margin]
    changed = _disturbed(image[part], mask[part], rng, effects, pixel)
    image, mask = np.full_like(image, schema.BACKGROUND_GREY), np.zeros_like(mask)
    image[part], mask[part] = changed
    return image, mask


def _disturbed(
    image: np.ndarray, mask: np.ndarray, rng: np.random.Generator, effects: PhotoEffects,
    pixel: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """`disturb` of the object's box; lengths are multiplied by `pixel`."""
    occlusion, scene, light, sensor, jpeg, edge = rng.spawn(6)
    image = image.copy()
    if occlusion.random() < effects.occluders:
        image, mask = _occlude(image, mask, occlusion)
    if _has_grey_surroundings(image, mask):
        backdrop = smooth_colours(mask.shape, scene)
        image = on_mask(mask, image, backdrop)
    if effects.exposure or effects.white_balance:
        image = change_light(image, light, effects.exposure, effects.white_balance)
    image = degrade(image, sensor, effects.blur * pixel, effects.noise)
    if effects.jpeg:
        image = compress(image, 100 - 90 * effects.jpeg * jpeg.random())
    if effects.erode or effects.dilate or effects.ragged:
        length = edge.uniform(-effects.erode, effects.dilate)
        grain = max(2, round(_GRAIN * pixel))
        changed = _move_edge(mask, length * pixel, effects.ragged * pixel, grain, edge)
        mask = changed if changed.sum() >= LEAST_LEFT * mask.sum() else mask
    return on_mask(mask, image, np.uint8(schema.BACKGROUND_GREY)), mask


def _has_grey_surroundings(image: np.ndarray, mask: np.ndarray) -> bool:
    """Whether more than 90 % of the background is plain grey."""
    grey = image == schema.BACKGROUND_GREY
    plain = grey[..., 0] & grey[..., 1] & grey[..., 2] & ~mask
    outside = mask.size - np.count_nonzero(mask)
    return bool(outside and np.count_nonzero(plain) > 0.9 * outside)


def smooth_colours(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """uint8 [h, w, 3]: a few random colours, interpolated."""
    nodes = rng.integers(1, 7, 2)
    base = rng.integers(0, 256) + rng.integers(-40, 41, 3)  # most backgrounds are unsaturated
    spread = rng.integers(8, 96)
    colours = base + rng.integers(-spread, spread + 1, (*nodes, 1)) + rng.integers(-16, 17, 3)
    picture = Image.fromarray(np.clip(colours, 0, 255).astype(np.uint8))
    return np.asarray(picture.resize((shape[1], shape[0]), Image.Resampling.BILINEAR))


def _occlude(
    image: np.ndarray, mask: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Adds an ellipse or a rectangle of another colour at an edge of the object's box."""
    top, bottom, left, right = box_of(mask)
    high, wide = bottom - top, right - left
    side, along = rng.integers(4), rng.random()
    row, column = top + along * high, left + along * wide
    centre = ((row, left), (row, right), (top, column), (bottom, column))[side]
    axes = rng.uniform(0.1, 0.3, 2) * (high, wide)
    colour = rng.integers(0, 256, 3)
    rows = np.arange(mask.shape[0]) + 0.5 - centre[0]
    columns = np.arange(mask.shape[1]) + 0.5 - centre[1]
    if rng.random() < 0.5:
        rows, columns = rows / max(axes[0], 0.5), columns / max(axes[1], 0.5)
        patch = (rows**2)[:, None] + columns**2 <= 1
    else:
        patch = (np.abs(rows) <= axes[0])[:, None] & (np.abs(columns) <= axes[1])
    without = mask & ~patch
    if without.sum() < LEAST_LEFT * mask.sum():
        return image, mask
    image[patch] = np.clip(colour + rng.normal(0, 6, (int(patch.sum()), 1)), 0, 255)
    return image, without if rng.random() < 0.5 else mask


def change_light(
    image: np.ndarray, rng: np.random.Generator, exposure: float, white_balance: float
) -> np.ndarray:
    """The image with a random exposure, within +-`exposure` stops, and white balance."""
    gain = 2 ** (exposure * rng.uniform(-1, 1))
    red, blue = 1 + white_balance * rng.uniform(-1, 1, 2)
    levels = np.arange(256) / 255
    table = [
        np.rint(255 * np.minimum(1, factor ** (1 / _GAMMA) * levels)).astype(np.uint8)
        for factor in (gain * red, gain, gain * blue)
    ]
    return np.dstack([table[i].take(image[..., i]) for i in range(3)])


def degrade(image: np.ndarray, rng: np.random.Generator, blur: float, noise: float) -> np.ndarray:
    """The image with random blur and noise; the arguments are the largest standard deviations."""
    radius, deviation = rng.random(2) * (blur, noise)
    if radius:
        picture = Image.fromarray(image).filter(ImageFilter.GaussianBlur(float(radius)))
        image = np.asarray(picture)
    if deviation:
        grain = rng.standard_normal(image.shape, np.float32) * np.float32(255 * deviation)
        grain += image
        np.rint(grain, out=grain)
        image = np.clip(grain, 0, 255, out=grain).astype(np.uint8)
    return image


def compress(image: np.ndarray, quality: float) -> np.ndarray:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "jpeg", quality=max(1, round(quality)))
    return np.asarray(Image.open(buffer, formats=("JPEG",)))


def _step(mask: np.ndarray, *, diagonal: bool) -> np.ndarray:
    """The mask dilated by one pixel in four or, if `diagonal`, eight directions."""
    grown = mask.copy()
    grown[1:] |= mask[:-1]
    grown[:-1] |= mask[1:]
    wide = grown if diagonal else mask
    result = grown.copy()
    result[:, 1:] |= wide[:, :-1]
    result[:, :-1] |= wide[:, 1:]
    return result


def _move_edge(
    mask: np.ndarray, length: float, ragged: float, grain: int, rng: np.random.Generator
) -> np.ndarray:
    """Moves the mask's edge outward by `length` pixels plus a random field within +-`ragged`.

    The field is smooth over `grain` pixels. The border of the array is no edge.
    """
    height, width = mask.shape
    nodes = rng.random((height // grain + 2, width // grain + 2), np.float32)
    field = Image.fromarray(nodes).resize((width, height), Image.Resampling.BICUBIC)
    distance = length + ragged * np.clip(2 * np.asarray(field) - 1, -1, 1)
    result = mask
    for sign in (1, -1):
        grown = mask if sign > 0 else ~mask
        for step in range(1, int(np.ceil(max(0.0, float((sign * distance).max())) + 0.5)) + 1):
            # Alternating four and eight neighbours approximates a disc.
            grown = _step(grown, diagonal=step % 2 == 0)
            reached = grown & (sign * distance >= step - 0.5)
            result = result | reached if sign > 0 else result & ~reached
    return result
