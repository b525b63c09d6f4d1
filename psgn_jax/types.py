"""Array types used in signatures: the dtype, the rank and the name of each axis."""

from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

if TYPE_CHECKING:
    from jax import Array
else:
    # What a checker at run time accepts: as in JAX itself, NumPy's arrays serve as well.
    Array = jax.Array | np.ndarray

PRNGKey = jax.Array

__all__ = ["Array", "Bool", "Float", "Int", "PRNGKey", "UInt8"]
