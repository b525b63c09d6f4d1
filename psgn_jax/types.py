"""Array types used in signatures: the dtype, the rank and the name of each axis."""

import jax
from jaxtyping import Array, Bool, Float, Int, UInt8

Points = Float[Array, "n 3"]
"""One point cloud in the project's frame; unit = radius of the bounding hemisphere."""

PRNGKey = jax.Array

__all__ = ["Array", "Bool", "Float", "Int", "PRNGKey", "Points", "UInt8"]
