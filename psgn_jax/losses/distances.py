"""Squared distances, safe square roots, the check of a cloud, and batches of pairs."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.types import Array, Float


def check_points(points: Float[Array, "n 3"], name: str) -> Float[Array, "n 3"]:
    """Returns one point cloud as float32 (float64 stays), or says what is wrong with it.

    The values are looked at only where they are at hand: inside `jit`, `vmap` or `grad` they are
    not, and a non-finite coordinate then reaches the loss as NaN.

    Args:
      points: [n, 3] coordinates of a floating dtype, n >= 1; any unit and frame.
      name: what the caller calls this argument; it begins the error messages.

    Raises:
      ValueError: the shape is not [n, 3] with n >= 1, the dtype is not floating, or a concrete
        coordinate is NaN or infinite.
    """
    if not isinstance(points, jax.Array | np.ndarray):
        raise ValueError(f"{name}: got {type(points).__name__}, expected an array [n, 3] of floats")
    if points.ndim != 2 or points.shape[-1] != 3 or points.shape[0] < 1:
        raise ValueError(
            f"{name}: got shape {tuple(points.shape)}, expected [n, 3] with n >= 1"
            " (one cloud; use jax.vmap or losses.map_pairs for a batch)"
        )
    if not jnp.issubdtype(points.dtype, jnp.floating):
        raise ValueError(f"{name}: got dtype {points.dtype}, expected a floating dtype")
    if not isinstance(points, jax.core.Tracer) and (
        not isinstance(points, jax.Array) or points.is_fully_addressable
    ):
        finite = np.asarray(np.isfinite(np.asarray(points, np.float32)).all(axis=-1))
        if not finite.all():
            row = int(np.argmin(finite))
            raise ValueError(
                f"{name}: point {row} of {len(finite)} is {np.asarray(points[row]).tolist()},"
                f" expected finite coordinates ({int((~finite).sum())} points are not)"
            )
    points = jnp.asarray(points)
    return points.astype(jnp.promote_types(points.dtype, jnp.float32))


def pairwise_sq(a: Float[Array, "n 3"], b: Float[Array, "m 3"]) -> Float[Array, "n m"]:
    """|a_i - b_j|^2 from coordinate differences (unit^2); it holds the whole [n, m] matrix.

    No expansion into |a|^2 - 2ab + |b|^2, which loses the digits of near points: every entry is
    right to a few units in its last place, wherever the clouds lie.
    """
    x, y, z = (jnp.square(a[:, None, axis] - b[None, :, axis]) for axis in range(3))
    return x + y + z


def safe_sqrt(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """sqrt(x) for x >= 0 with gradient 0 at x = 0 in place of infinity; NaN stays NaN."""
    is_zero = x == 0
    return jnp.where(is_zero, 0, jnp.sqrt(jnp.where(is_zero, 1, x)))


def map_pairs(function: Callable, *, platform: str | None = None) -> Callable:
    """Turns a function of one pair into one of a batch of pairs, the fast way for the platform.

    On a CPU one pair after the other (`jax.lax.map`): a pair's tile then stays in the cache. On
    accelerators all at once (`jax.vmap`; not measured there). The values agree within rounding.
    The EMD's auction goes pair by pair on a CPU under `jax.vmap` too: lock step would make every
    pair wait for the slowest.

    Args:
      function: of one pair, (pred [n, 3], gt [m, 3]) -> any pytree of arrays.
      platform: "cpu", "gpu" or "tpu"; None asks JAX for its default backend.

    Returns:
      (pred [B, n, 3], gt [B, m, 3]) -> the pytree with a leading axis B on every array. Further
      arrays, if the function takes them, have that axis too.

    Examples:
      >>> import jax.numpy as jnp
      >>> from psgn_jax import losses
      >>> preds, gts = jnp.zeros((2, 1, 3)), jnp.ones((2, 5, 3))
      >>> losses.map_pairs(losses.chamfer_sq_mean)(preds, gts).tolist()
      [6.0, 6.0]
    """

    # Made once, so that JAX knows it again and compiles it once, also without `jit` around.
    def one_pair(_: None, arrays: tuple[Array, ...]) -> tuple[None, Any]:
        return None, function(*arrays)

    def over_batch(pred: Array, gt: Array, *others: Array) -> Any:
        if (platform or jax.default_backend()) == "cpu":
            return jax.lax.scan(one_pair, None, (pred, gt, *others))[1]
        return jax.vmap(function)(pred, gt, *others)

    return over_batch
