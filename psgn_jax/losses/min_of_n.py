"""Min-of-N (MoN): the distance of the best of n predictions, for any distance of one pair.

    MoN(S_1, ..., S_n; S_gt) = min over j of d(S_j, S_gt)

With predictions S_j = G(image, r_j) for random r_j ~ N(0, I), MoN trains the network G to sample.
If an image allows several shapes, the plain loss (n = 1) is minimal at a mean of them. MoN is
minimal when different samples predict different shapes.

Source: Fan, Su, Guibas, "A Point Set Generation Network for 3D Object Reconstruction from a Single
Image", CVPR 2017, section "Generation of Multiple Plausible Shapes", where n = 2 suffices.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from psgn_jax.array_types import Array, Float, Int
from psgn_jax.losses.mapping import map_pairs


class MinOfN(NamedTuple):
    """The smallest of n distances, the index of its sample (the winner), and all n distances.

    `value` and `distances` are in the unit of the distance. Only `value` has a gradient. `aux` is
    the winner's auxiliary output, or () without `has_aux`.
    """

    value: Float[Array, ""]
    winner: Int[Array, ""]
    distances: Float[Array, " n"]
    aux: Any = ()


def min_of_n(
    distance: Callable[..., Any], *, has_aux: bool = False
) -> Callable[[Array, Array], MinOfN]:
    """Turns a distance d of one pair into the MoN of several predictions and one ground truth.

    `distance` maps (pred [n, 3], gt [m, 3]) to a scalar, like `chamfer_sq` or `emd_sum`, or with
    `has_aux` to (scalar, pytree); it may close over traced values. The result maps (preds
    [draws, n, 3], gt [m, 3]) to `MinOfN`, for any draws >= 1. It raises ValueError for a wrong
    shape of `preds`, and the errors of `distance`.

    The winner is the first sample with the smallest distance. Its gradient is the gradient of d.
    The other samples' gradients are multiplied by 0, so they must be finite, as those of `losses`
    are. A NaN distance wins, so that it is noticed.
    """

    def over_draws(preds: Array, gt: Array) -> MinOfN:
        if preds.ndim != 3 or not len(preds):
            raise ValueError(
                f"preds: got shape {tuple(preds.shape)}, expected [draws, n, 3] with draws >= 1"
            )
        gts = jnp.broadcast_to(gt[None], (len(preds), *gt.shape))
        result = map_pairs(distance)(preds, gts)
        distances, aux = result if has_aux else (result, ())
        winner = jnp.argmin(distances)
        aux = jax.tree.map(lambda leaf: jax.lax.stop_gradient(leaf[winner]), aux)
        return MinOfN(distances[winner], winner, jax.lax.stop_gradient(distances), aux)

    return over_draws
