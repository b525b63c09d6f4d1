"""From a sample's image, mask and depth to the channels that a network sees.

The arrays may live on the host or be traced: everything is jax.numpy and runs inside jit.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp

from psgn_jax.config import CHANNELS_OF, Config
from psgn_jax.types import Array, Bool, Float, UInt8

# Background colour of the authors' files (github.com/fanhqme/PointSetGeneration).
BACKGROUND = 191 / 255
# Distance of the frame's origin from their camera along the optical axis, fitted on the silhouettes
# (`data.camera.default_camera`): what depth is counted from where no camera is given.
DEFAULT_DISTANCE = 3.6


def stack_channels(
    image: UInt8[Array, "*b h w 3"],
    mask: Bool[Array, "*b h w"],
    depth: Float[Array, "*b h w"] | None,
    *,
    channels: Sequence[str],
    distance: Float[Array, "*b"] | float | None = None,
) -> Float[Array, "*b h w c"]:
    """The input of a network, its channels in the order of `channels`.

    - "rgb", three channels: colour / 255; every background pixel is 191 / 255.
    - "mask", one channel: the **background** mask, 1 = background, 0 = object.
    - "depth", two channels: `distance - z`, in units how much nearer than the frame's origin,
      within [-1, 1] on the object (the unit is its bounding radius), not clipped; and 1 where that
      was measured. Both are 0 on the background and in a sensor's holes (z <= 0 or not finite): a
      hole differs from the background by the mask, and from a surface at the origin's distance by
      the second channel.

    Args:
      image: RGB.
      mask: True on the object.
      depth: z along the optical axis in units (radius of the bounding hemisphere); used, and
        needed, only if "depth" is among `channels`.
      channels: any of "rgb", "mask", "depth", each once.
      distance: of the frame's origin from the camera along the optical axis, `extrinsics[2, 3]`;
        None = 3.6, the default camera's.

    Raises:
      ValueError: for channels that are unknown, repeated or missing their array, for shapes that
        disagree and for an image that is not uint8 or a mask that is not bool.

    Source: the authors' published code and data, which order the colours BGR. Of depth their files
    hold 16 bits, (5.4 - z) / 3.6 * 65535; neither they nor the paper say how a network saw it. The
    two channels are **ours**.
    """
    _check(image, mask, depth, channels)
    image, mask = jnp.asarray(image), jnp.asarray(mask)
    planes = []
    for channel in channels:
        if channel == "rgb":
            colour = image.astype(jnp.float32) / 255
            planes.append(jnp.where(mask[..., None], colour, BACKGROUND))
        elif channel == "mask":
            planes.append(1 - mask[..., None].astype(jnp.float32))
        else:
            z = jnp.asarray(depth, jnp.float32)
            origin = DEFAULT_DISTANCE if distance is None else jnp.asarray(distance, jnp.float32)
            origin = jnp.broadcast_to(origin, z.shape[:-2])[..., None, None]
            measured = mask & (z > 0) & jnp.isfinite(z)
            nearness = jnp.where(measured, origin - z, 0.0)
            planes.append(jnp.stack([nearness, measured.astype(jnp.float32)], axis=-1))
    return jnp.concatenate(planes, axis=-1)


def _check(image: Any, mask: Any, depth: Any, channels: Sequence[str]) -> None:
    """Raises ValueError for arguments of `stack_channels` that do not fit."""
    if not channels or len(set(channels)) < len(channels) or not set(channels) <= set(CHANNELS_OF):
        raise ValueError(
            f"channels={tuple(channels)!r}: accepted: any of {tuple(CHANNELS_OF)}, each once"
        )
    if image.dtype != jnp.uint8 or image.ndim < 3 or image.shape[-1] != 3:
        raise ValueError(
            f"image is {image.dtype} {tuple(image.shape)}: accepted: uint8 [..., h, w, 3]"
        )
    if mask.dtype != jnp.bool_ or mask.shape != image.shape[:-1]:
        raise ValueError(
            f"mask is {mask.dtype} {tuple(mask.shape)}: accepted: bool {tuple(image.shape[:-1])}, "
            "the shape of the image"
        )
    if "depth" in channels:
        if depth is None:
            raise ValueError("depth=None: accepted: an array, since 'depth' is among the channels")
        if depth.shape != mask.shape:
            raise ValueError(
                f"depth has the shape {tuple(depth.shape)}: accepted: {tuple(mask.shape)}, "
                "the shape of the mask"
            )


def network_inputs(config: Config, batch: Mapping[str, Any]) -> Array:
    """What a network sees of a batch, [B,H,W,C], or [B,V,H,W,C] of several views."""
    camera = batch.get("extrinsics")
    return stack_channels(
        batch["image"],
        batch["mask"],
        batch.get("depth"),
        channels=config.data.inputs,
        distance=None if camera is None else camera[..., 2, 3],
    )
