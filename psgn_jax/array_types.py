"""Array types for annotations, which state the dtype and the name of each axis."""

from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

if TYPE_CHECKING:
    from jax import Array
else:
    # At run time, the checks accept NumPy arrays too, as JAX does.
    Array = jax.Array | np.ndarray

PRNGKey = jax.Array

__all__ = ["Array", "Bool", "Float", "Int", "PRNGKey", "UInt8"]
