"""The losses that a configuration can name, alone or as a weighted sum.

The text of a loss is a name, `chamfer_sq_mean`, or a sum of terms,

    emd_mean@1024 + 5*chamfer_sq_mean

Each term is `WEIGHT*NAME@POINTS`: a weight (default 1), an entry of `LOSSES`, and the number of
true points that the loss uses (default all `data.num_points`).
"""

import dataclasses
import functools
import inspect
import math
import re
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from psgn_jax.config import ConfigError, LossConfig, suggestion
from psgn_jax.losses import chamfer, emd
from psgn_jax.types import Array

LOSSES: dict[str, Callable[..., Any]] = {
    "chamfer_sq": chamfer.chamfer_sq,
    "chamfer_sq_mean": chamfer.chamfer_sq_mean,
    "chamfer_l1_mean": chamfer.chamfer_l1_mean,
    "chamfer_authors": chamfer.chamfer_authors,
    "emd_sum": emd.emd_sum,
    "emd_mean": emd.emd_mean,
}
"""Losses of one pair `(pred [n,3], gt [m,3]) -> scalar`; callers vmap."""

_TERM = re.compile(
    r"(?:(?P<weight>(?:\d+\.?\d*|\.\d+)(?:[eE]-?\d+)?)\s*\*\s*)?(?P<name>\w+)(?:\s*@\s*(?P<points>\d+))?"
)


@dataclasses.dataclass(frozen=True)
class LossTerm:
    """One term of a loss.

    Attributes:
      name: an entry of `LOSSES`.
      weight: its factor in the sum.
      num_points: number of true points that the loss uses; 0 = all.
      text: the term as written in the configuration.
    """

    name: str
    weight: float = 1.0
    num_points: int = 0
    text: str = ""

    @property
    def is_plain(self) -> bool:
        """Whether the term has the weight 1 and uses all points."""
        return self.weight == 1 and not self.num_points


def parse_terms(text: str) -> tuple[LossTerm, ...]:
    """The terms of a loss, in their order.

    Raises:
      ConfigError: a term is not of the form `WEIGHT*NAME@POINTS`, its name is unknown, or a name
        occurs twice. The message is one line and quotes the term.
    """
    parts = [part.strip() for part in text.split("+")]
    terms: list[LossTerm] = []
    for part in parts:
        where = f"loss.name={text!r}" + (f": the term {part!r}" if len(parts) > 1 else "")
        match = _TERM.fullmatch(part)
        if match is None:
            raise ConfigError(
                f"{where} is not understood; accepted: a loss, or a sum such as "
                "'emd_mean@1024 + 5*chamfer_sq_mean' (WEIGHT*NAME@POINTS)"
            )
        name = match["name"]
        weight, num_points = float(match["weight"] or 1), int(match["points"] or 0)
        if name not in LOSSES:
            raise ConfigError(
                f"{where} is unknown; {suggestion(name, LOSSES)}accepted: {', '.join(LOSSES)}"
            )
        if not (weight > 0 and math.isfinite(weight)) or (match["points"] and not num_points):
            raise ConfigError(f"{where}: accepted: a weight above 0 and at least one point")
        if name in (term.name for term in terms):
            raise ConfigError(f"{where}: {name} occurs twice; accepted: each loss once")
        terms.append(LossTerm(name, weight, num_points, part))
    return tuple(terms)


def configured_terms(config: LossConfig) -> list[tuple[LossTerm, Callable[..., Any]]]:
    """The terms of `loss.name`, each with its unweighted loss of one pair of clouds.

    A loss raises ValueError for clouds that it does not accept.

    Raises:
      ConfigError: as `parse_terms`.
    """
    return [(term, _loss_of(term, config)) for term in parse_terms(config.name)]


def configured_loss(config: LossConfig) -> Callable[..., Any]:
    """The loss of one pair of clouds that `loss.name` describes.

    A loss with a parameter `schedule` (the EMD) gets `loss.emd_tolerance` and `loss.emd_schedule`.

    Raises:
      ConfigError: as `parse_terms`.
    """
    terms = configured_terms(config)
    if len(terms) == 1 and terms[0][0].is_plain:
        return terms[0][1]
    return WeightedSum(tuple(terms))


@dataclasses.dataclass(frozen=True)
class WeightedSum:
    """The sum over k of w_k d_k(pred, gt_k): a loss of one pair (pred [n, 3], gt [m, 3]).

    gt_k are the true points that `chosen_points` selects for term k.
    """

    terms: tuple[tuple[LossTerm, Callable[..., Any]], ...]

    def __call__(self, pred: Array, gt: Array) -> Array:
        """The sum, a scalar."""
        return self.with_terms(pred, gt)[0]

    def with_terms(self, pred: Array, gt: Array) -> tuple[Array, dict[str, Array]]:
        """The sum and, by name, the values d_k without weights, which carry no gradient."""
        values = {term.name: loss(pred, gt) for term, loss in self.terms}
        weighted = [term.weight * values[term.name] for term, _ in self.terms]
        total = sum(weighted[1:], start=weighted[0])
        return total, jax.lax.stop_gradient(values)


def with_terms(loss: Callable[..., Any]) -> Callable[..., tuple[Array, dict[str, Array]]]:
    """Returns (pred, gt) -> the loss and the values of its terms by name, {} if it is not a sum."""
    if isinstance(loss, WeightedSum):
        return loss.with_terms
    return lambda pred, gt: (loss(pred, gt), {})


def chosen_points(gt: Array, num_points: int) -> Array:
    """Selects `num_points` of the true points, always with the same indices.

    The indices are a fixed random choice. The first `num_points` points would be a biased choice: a
    record stores its points sorted, and a batch with all points of a record keeps their order, so
    the first ones would lie on one side of the object.

    Raises:
      ValueError: gt has fewer than `num_points` points.
    """
    if num_points > len(gt):
        raise ValueError(f"gt: got {len(gt)} points, expected at least {num_points}")
    if num_points == len(gt):
        return gt
    return gt[np.random.default_rng(0).permutation(len(gt))[:num_points]]


def _loss_of(term: LossTerm, config: LossConfig) -> Callable[..., Any]:
    function = LOSSES[term.name]
    if "schedule" in inspect.signature(function).parameters:
        function = functools.partial(
            function, tolerance=config.emd_tolerance, schedule=config.emd_schedule
        )
    if not term.num_points:
        return function
    return lambda pred, gt: function(pred, chosen_points(gt, term.num_points))
