"""Builds the input channels of a network from the image, mask and depth of a sample.

All functions use jax.numpy and can run inside jit. Arguments may be NumPy arrays or traced.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp

from psgn_jax.array_types import Array, Bool, Float, UInt8

# Background colour in the authors' files (github.com/fanhqme/PointSetGeneration).
BACKGROUND = 191 / 255
# Depth of the frame's origin in the authors' camera, along the optical axis. It was fitted to the
# silhouettes in their images (`data.camera.default_camera`) and is used if no camera is given.
DEFAULT_DISTANCE = 3.6


def stack_channels(
    image: UInt8[Array, "*b h w 3"],
    mask: Bool[Array, "*b h w"],
    depth: Float[Array, "*b h w"] | None,
    *,
    channels: Sequence[str],
    distance: Float[Array, "*b"] | float | None = None,
) -> Float[Array, "*b h w c"]:
    """Builds the input of a network, with its channels in the order of `channels`.

    - "rgb", three channels: colour / 255; every background pixel is 191 / 255.
    - "mask", one channel: the **background** mask, 1 = background, 0 = object.
    - "depth", two channels. The first is `distance - z`: how much nearer to the camera the surface
      is than the frame's origin, in units. It is in [-1, 1] on the object, because the unit is the
      bounding radius; it is not clipped. The second is 1 where depth was measured. Both are 0 on
      the background and where the sensor measured nothing on the object (z <= 0 or not finite). The
      "mask" channel distinguishes these holes from the background; the second depth channel
      distinguishes them from a surface at the depth of the origin.

    Args:
      image: RGB.
      mask: True on the object.
      depth: z along the optical axis in units (radius of the bounding hemisphere); required if
        "depth" is in `channels`, otherwise ignored.
      channels: any of "rgb", "mask", "depth".
      distance: depth of the frame's origin along the optical axis, `extrinsics[2, 3]`; None: 3.6,
        the value of the default camera.

    Source: the authors' published code and data, which store colours as BGR. Their files store
    depth as 16-bit integers, (5.4 - z) / 3.6 * 65535. Neither the files nor the paper say how depth
    is passed to a network; the two depth channels are **ours**.
    """
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


def network_inputs(channels: Sequence[str], batch: Mapping[str, Any]) -> Array:
    """The network input of a batch: [B,H,W,C], or [B,V,H,W,C] for several views."""
    camera = batch.get("extrinsics")
    return stack_channels(
        batch["image"],
        batch["mask"],
        batch.get("depth"),
        channels=channels,
        distance=None if camera is None else camera[..., 2, 3],
    )
