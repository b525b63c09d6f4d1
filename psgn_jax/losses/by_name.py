"""The loss that a configuration names, such as `emd_mean@1024 + 5*chamfer_sq_mean`.

It is an entry of `LOSSES` or a sum of terms `WEIGHT*NAME@POINTS`: a weight (default 1), an entry of
`LOSSES`, and the number of true points (default: all `data.num_points`).
"""

import functools
import math
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import ConfigError, LossConfig
from psgn_jax.config.structured import shown, suggestion
from psgn_jax.losses import LOSSES

_TERM = re.compile(
    r"(?:(?P<weight>(?:\d+\.?\d*|\.\d+)(?:[eE]-?\d+)?)\s*\*\s*)?(?P<name>\w+)(?:\s*@\s*(?P<points>\d{1,9}))?"
)


class LossTerm(NamedTuple):
    """A term: name in `LOSSES`, unweighted loss of one pair, weight, and its text."""

    name: str
    distance: Callable[..., Any]
    weight: float
    text: str


def parse_terms(config: LossConfig) -> tuple[LossTerm, ...]:
    """The terms of `loss.name` in order; the EMD gets `loss.emd_tolerance`.

    `ConfigError` if a term is not `WEIGHT*NAME@POINTS`, or its name is unknown or occurs twice.
    """
    parts = [part.strip() for part in config.name.split("+")]
    terms: dict[str, LossTerm] = {}
    for part in parts:
        where = f"loss.name={shown(config.name)}"
        where += f": the term {shown(part)}" if len(parts) > 1 else ""
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
        if name in terms:
            raise ConfigError(f"{where}: {name} occurs twice; accepted: each loss once")
        options = {"tolerance": config.emd_tolerance} if name.startswith("emd") else {}
        loss = functools.partial(LOSSES[name], **options)
        distance = functools.partial(_on_chosen, loss, num_points) if num_points else loss
        terms[name] = LossTerm(name, distance, weight, part)
    return tuple(terms.values())


def _on_chosen(loss: Callable[..., Any], num_points: int, pred: Array, gt: Array) -> Any:
    return loss(pred, chosen_points(gt, num_points))


def configured_loss(config: LossConfig) -> Callable[[Array, Array], tuple[Array, dict[str, Array]]]:
    """`loss.name` as a function of one pair, (pred, gt) -> (value, terms).

    The value is sum_k w_k d_k(pred, gt_k) with the `chosen_points` gt_k of term k. `terms` maps
    names to d_k, without gradient; {} for a loss without weight and points. Errors: `parse_terms`.
    """
    return sum_of(parse_terms(config))


def sum_of(terms: Sequence[LossTerm]) -> Callable[[Array, Array], tuple[Array, dict[str, Array]]]:
    """The weighted sum of the terms, as in `configured_loss`."""

    def loss(pred: Array, gt: Array) -> tuple[Array, dict[str, Array]]:
        values = {term.name: term.distance(pred, gt) for term in terms}
        if len(terms) == 1 and terms[0].text == terms[0].name:
            return values[terms[0].name], {}
        weighted = [term.weight * values[term.name] for term in terms]
        return sum(weighted[1:], start=weighted[0]), jax.lax.stop_gradient(values)

    return loss


def chosen_points(gt: Array, num_points: int) -> Array:
    """A fixed random choice of the true points; ValueError if there are fewer than `num_points`.

    The first points would not do: records store points sorted from one side of the object.
    """
    if num_points > len(gt):
        raise ValueError(f"gt: got {len(gt)} points, expected at least {num_points}")
    if num_points == len(gt):
        return gt
    return gt[np.random.default_rng(0).permutation(len(gt))[:num_points]]
