"""Constructors, initial parameters, inputs and predictions of all networks."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.array_types import Array, Bool, Float, PRNGKey, UInt8
from psgn_jax.config.experiment import Config, ModelConfig, VoxelConfig
from psgn_jax.config.structured import suggestion, wrong
from psgn_jax.data.camera import DISTANCE
from psgn_jax.data.schema import BACKGROUND_GREY
from psgn_jax.models import posterior, recurrent, volumes
from psgn_jax.models.point_out_net import CloudNetwork, PointOutNet

DTYPES = {"float32": jnp.float32, "bfloat16": jnp.bfloat16}
"""The accepted values of `model.compute_dtype`."""

# Purposes of random numbers, which depend on the seed, a purpose and a step only.
_INIT, _TRAIN_RANDOM, _EVAL_RANDOM, _INIT_POSTERIOR = 0, 1, 2, 3


def build(config: ModelConfig) -> CloudNetwork:
    """The network that predicts clouds; `ConfigError` for an unknown `model.name`."""
    if config.name not in NETWORKS:
        accepted = ", ".join(map(repr, NETWORKS))
        raise wrong("model.name", config.name, accepted, suggestion(config.name, NETWORKS))
    return NETWORKS[config.name](config)


def build_posterior(config: ModelConfig) -> posterior.Posterior:
    """The network that predicts the distribution of r from the ground truth."""
    sizes = config.posterior_hidden, config.random_size
    return posterior.Posterior(tuple(config.posterior_widths), *sizes)


def build_volume_net(config: ModelConfig) -> volumes.VolumeNet:
    """The network that predicts the volume of an object from its image."""
    return volumes.VolumeNet(config.widths, dtype=DTYPES[config.compute_dtype])


def build_r2n2(config: ModelConfig, sizes: VoxelConfig) -> recurrent.RecurrentVolume:
    """3D-R2N2 with the published widths times `voxels.width_multiplier`."""
    return recurrent.RecurrentVolume(sizes.width_multiplier, DTYPES[config.compute_dtype])


def _point_out_net(config: ModelConfig) -> PointOutNet:
    names = (
        "image_size", "in_channels", "widths", "fc_points", "fc_widths", "deconv_level",
        "deconv_channels", "random_size", "random_at",
    )  # fmt: skip
    fields: Any = {name: getattr(config, name) for name in names}
    return PointOutNet(version=config.name, dtype=DTYPES[config.compute_dtype], **fields)


NETWORKS: dict[str, Callable[[ModelConfig], CloudNetwork]] = {
    "vanilla": _point_out_net,
    "two_branch": _point_out_net,
    "hourglass": _point_out_net,
}
"""`model.name` -> constructor."""


def init_key(config: Config) -> PRNGKey:
    return jax.random.fold_in(jax.random.key(config.seed), _INIT)


def random_key(seed: int, step: Array | int, *, train: bool = True) -> PRNGKey:
    """Key of the random input r of a training step or of an evaluation batch."""
    purpose = _TRAIN_RANDOM if train else _EVAL_RANDOM
    return jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), purpose), step)


def init_params(config: Config, model: nn.Module) -> Any:
    """Initial parameters of the network and, with `model.posterior`, of the posterior network."""
    height, width = config.model.image_size
    image = jnp.zeros((1, height, width, config.model.in_channels))
    r = jnp.zeros((1, config.model.random_size)) if config.model.random_size else None
    params = model.init(init_key(config), image, r)["params"]
    if config.model.posterior:
        key = jax.random.fold_in(jax.random.key(config.seed), _INIT_POSTERIOR)
        encoder = build_posterior(config.model).init(key, jnp.zeros((1, *volumes.GRID)))
        params = {**params, posterior.NAME: encoder["params"]}
    return params


def input_keys(config: Config) -> tuple[str, ...]:
    """Names of the arrays of a batch that network, loss and evaluation read."""
    depth = ("depth", "extrinsics") if "depth" in config.data.inputs else ()
    camera = ("intrinsics", "extrinsics") if config.eval.refine else ()
    return tuple(dict.fromkeys(("image", "mask", "points", *depth, *camera)))


def random_input(
    config: Config, step: Array | int, batch_size: int, *, train: bool
) -> Array | None:
    """Random input r ~ N(0, I) [B, random_size]; None if the network has none.

    In training with `loss.min_of_n` > 1 it is [B, min_of_n, random_size]. B is the batch size over
    all devices and processes. Source: paper, section "Generation of Multiple Plausible Shapes".
    """
    if not config.model.random_size:
        return None
    key = random_key(config.seed, step, train=train)
    draws = (config.loss.min_of_n,) if train and config.loss.min_of_n > 1 else ()
    return jax.random.normal(key, (batch_size, *draws, config.model.random_size))


def stack_channels(
    image: UInt8[Array, "*b h w 3"],
    mask: Bool[Array, "*b h w"],
    depth: Float[Array, "*b h w"] | None,
    *,
    channels: Sequence[str],
    distance: Float[Array, "*b"] | float | None = None,
) -> Float[Array, "*b h w c"]:
    """The input of a network, with the channels in the order of `channels`.

    - "rgb", three channels: colour / 255; background pixels are 191 / 255.
    - "mask", one channel: the **background** mask, 1 = background, 0 = object.
    - "depth", two channels (**ours**: the sources do not say how a network reads depth). The first,
      `distance - z`, says how much nearer to the camera the surface is than the frame's origin, in
      units; on the object it is in [-1, 1]. The second is 1 where depth was measured. Both are 0 on
      the background and where the object's depth is missing (z <= 0 or not finite).

    The image is RGB, `mask` True on the object, `depth` z along the optical axis in units (radius
    of the bounding hemisphere), and `distance` the z of the frame's origin, `extrinsics[2, 3]`;
    None: 3.6, as for the default camera.

    Source: the authors' published code and data, which store colours as BGR.
    """
    image, mask = jnp.asarray(image), jnp.asarray(mask)
    planes = []
    for channel in channels:
        if channel == "rgb":
            colour = image.astype(jnp.float32) / 255
            planes.append(jnp.where(mask[..., None], colour, BACKGROUND_GREY / 255))
        elif channel == "mask":
            planes.append(1 - mask[..., None].astype(jnp.float32))
        else:
            z = jnp.asarray(depth, jnp.float32)
            origin = DISTANCE if distance is None else jnp.asarray(distance, jnp.float32)
            origin = jnp.broadcast_to(origin, z.shape[:-2])[..., None, None]
            measured = mask & (z > 0) & jnp.isfinite(z)
            nearness = jnp.where(measured, origin - z, 0.0)
            planes.append(jnp.stack([nearness, measured.astype(jnp.float32)], axis=-1))
    return jnp.concatenate(planes, axis=-1)


def network_inputs(channels: Sequence[str], batch: Mapping[str, Any]) -> Array:
    """`stack_channels` of a batch: [B,H,W,C], or [B,V,H,W,C] for several views."""
    camera, images = batch.get("extrinsics"), (batch["image"], batch["mask"], batch.get("depth"))
    distance = None if camera is None else camera[..., 2, 3]
    return stack_channels(*images, channels=channels, distance=distance)


def predict(
    config: Config, model: nn.Module, params: Any, batch: Mapping[str, Any], r: Array | None
) -> Array:
    """Points [B,N,3] for the images of a batch; [B,draws,N,3] if r is [B,draws,random_size]."""
    x = network_inputs(config.data.inputs, batch)
    return cast(Array, model.apply({"params": params}, x, r))
