"""A metric of a pair of clouds: the Hausdorff distance.

In the package: its line in `METRICS` of `psgn_jax/evaluation/clouds.py` (CSV, JSON and the log
contain it); its title in `COLUMNS` of `psgn_jax/evaluation/table.py`, for printed tables and the
terminal; if it is a fraction, for studies, `_LARGER_IS_BETTER` or `_SMALLER_IS_BETTER` of
`psgn_jax/studies/runner.py`
"""

import jax.numpy as jnp

from psgn_jax.array_types import Array
from psgn_jax.evaluation.clouds import METRICS
from psgn_jax.evaluation.table import COLUMNS
from psgn_jax.losses import Nearest


def hausdorff(to_gt: Nearest, to_pred: Nearest, threshold: float | Array) -> Array:
    """The largest distance of a point to the nearest one of the other cloud [radius]."""
    return jnp.sqrt(jnp.maximum(to_gt.distance_sq.max(), to_pred.distance_sq.max()))


METRICS["hausdorff_radius"] = hausdorff
COLUMNS["hausdorff_radius"] = "Hausdorff [radius]"
