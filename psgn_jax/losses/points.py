"""What every loss does with a cloud: validate it, and take roots with a gradient at zero."""

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.array_types import Array, Float


def check_points(points: Float[Array, "n 3"], name: str) -> Float[Array, "n 3"]:
    """Validates one cloud, n >= 1, and returns it as float32 (float64 stays float64).

    Values are checked only outside `jit`, `vmap` and `grad`, where they are known.

    Raises:
      ValueError: wrong type, shape or dtype, or a non-finite coordinate; it starts with `name`.
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
    if not isinstance(points, jax.core.Tracer) and getattr(points, "is_fully_addressable", True):
        bad = np.flatnonzero(~np.isfinite(np.asarray(points, np.float32)).all(axis=-1))
        if len(bad):
            raise ValueError(
                f"{name}: point {bad[0]} of {len(points)} is {np.asarray(points[bad[0]]).tolist()},"
                f" expected finite coordinates ({len(bad)} points are not)"
            )
    points = jnp.asarray(points)
    return points.astype(jnp.promote_types(points.dtype, jnp.float32))


def safe_sqrt(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """sqrt(x) for x >= 0, with gradient 0 instead of infinity at x = 0; NaN stays NaN."""
    is_zero = x == 0
    return jnp.where(is_zero, 0, jnp.sqrt(jnp.where(is_zero, 1, x)))
