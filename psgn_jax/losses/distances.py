"""Squared distances, safe square roots, validation of a point cloud, and batches of pairs."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.cores import num_cores
from psgn_jax.types import Array, Float

# More parts take longer to compile, and small parts gain little.
_MAX_PARTS, _MIN_PAIRS = 4, 4


def check_points(points: Float[Array, "n 3"], name: str) -> Float[Array, "n 3"]:
    """Validates one point cloud and returns it as float32 (float64 stays float64).

    Values are checked only if they are concrete. Inside `jit`, `vmap` or `grad` they are traced:
    a non-finite coordinate then makes the loss NaN.

    Args:
      points: [n, 3] coordinates of a floating dtype, n >= 1; any unit and frame.
      name: the caller's name for this argument; error messages start with it.

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
    """|a_i - b_j|^2 from coordinate differences (unit^2); allocates the whole [n, m] matrix.

    The expansion |a|^2 - 2ab + |b|^2 is not used, because it cancels for nearby points. Every
    entry is accurate to a few units in its last place, at any offset of the clouds.
    """
    x, y, z = (jnp.square(a[:, None, axis] - b[None, :, axis]) for axis in range(3))
    return x + y + z


def safe_sqrt(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """sqrt(x) for x >= 0, with gradient 0 instead of infinity at x = 0; NaN stays NaN."""
    is_zero = x == 0
    return jnp.where(is_zero, 0, jnp.sqrt(jnp.where(is_zero, 1, x)))


def _num_parts(num_pairs: int) -> int:
    """Number of parts of a batch that may be processed at the same time on a CPU."""
    cores = num_cores() // jax.local_device_count()  # each device processes its own batch
    return max(1, min(cores, _MAX_PARTS, num_pairs // _MIN_PAIRS))


def map_pairs(function: Callable, *, platform: str | None = None) -> Callable:
    """Maps a function of one pair over a batch of pairs, by the method that suits the platform.

    On a CPU the pairs are processed one after another (`jax.lax.scan`), so that the data of a pair
    stay in the cache. While JAX traces, the batch is divided into at most four parts of four pairs
    or more, and at most one for each core. XLA may process them at the same time if the program is
    large. On a CPU the auction of the EMD runs pair by pair under `jax.vmap` too, because in lock
    step every pair would wait for the slowest one. On accelerators the pairs are processed together
    (`jax.vmap`); this choice has not been timed there. The results agree up to rounding.

    Args:
      function: (pred [n, 3], gt [m, 3]) -> any pytree of arrays, for one pair.
      platform: "cpu", "gpu" or "tpu"; None: the default backend of JAX.

    Returns:
      (pred [B, n, 3], gt [B, m, 3]) -> the pytree with a leading axis B on every array. If the
      function takes further arrays, they need the same leading axis.

    Examples:
      >>> import jax.numpy as jnp
      >>> from psgn_jax import losses
      >>> preds, gts = jnp.zeros((2, 1, 3)), jnp.ones((2, 5, 3))
      >>> losses.map_pairs(losses.chamfer_sq_mean)(preds, gts).tolist()
      [6.0, 6.0]
    """

    # Defined here, not in `over_batch`, so that every call passes the same function to `scan`. JAX
    # then finds it in its cache and compiles it only once, even without an enclosing `jit`.
    def one_pair(_: None, arrays: tuple[Array, ...]) -> tuple[None, Any]:
        return None, function(*arrays)

    def over_batch(pred: Array, gt: Array, *others: Array) -> Any:
        if (platform or jax.default_backend()) == "cpu":
            arrays = (pred, gt, *others)
            size = len(pred)
            if any(isinstance(a, jax.core.Tracer) for a in arrays):
                size = -(-size // _num_parts(size))
            parts = [
                jax.lax.scan(one_pair, None, tuple(a[i : i + size] for a in arrays))[1]
                for i in range(0, max(1, len(pred)), max(1, size))
            ]
            if len(parts) == 1:
                return parts[0]
            return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)
        return jax.vmap(function)(pred, gt, *others)

    return over_batch
