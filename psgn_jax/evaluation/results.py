"""Metrics of every sample of a split, and their averages over samples and over categories."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.losses.iou import PREDICTION_THRESHOLDS

OVER_SAMPLES, OVER_CATEGORIES = "mean over samples", "mean over categories"
THRESHOLD_OF = "threshold_of_"
"""`THRESHOLD_OF` + the name of a metric is the name of its chosen threshold."""


@dataclasses.dataclass(frozen=True)
class Row:
    """A category or an average: number of samples, mean metrics."""

    name: str
    count: int
    metrics: dict[str, float]


class SampleName(NamedTuple):
    """Identifies a sample, as in `samples.csv`; `record` is its index in the split."""

    record: int
    category: str
    model_id: str
    view: int


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Metrics of every sample of a split, in order."""

    split: str
    names: list[SampleName]
    metrics: dict[str, np.ndarray]  # name -> float64 [samples]
    threshold: float  # of the F-score, in units
    num_points: tuple[int, int]  # predicted and true points; most metrics depend on both
    visible_tolerance: float = 0.0  # of `data.visibility`, in units
    note: str = ""  # text below the table; "" = the default text about points
    frame: str = "keep"  # or "place": images and true points were placed by `data.framing`
    refined: bool = False  # whether the clouds went through `prediction.refine`
    # Values chosen on this or an earlier split, such as thresholds.
    chosen: Mapping[str, float] = dataclasses.field(default_factory=dict)
    num_distinct: tuple[int, int] | None = None  # least and most different points in a true cloud

    @property
    def means(self) -> dict[str, float]:
        """Metric -> mean over samples.

        Means of metrics of visible (hidden) points leave out samples without such points, and are
        NaN if all lack them. In other metrics, a NaN makes the mean NaN.
        """
        everything = range(len(self.names))
        return {name: _mean(self._counted(name, everything)) for name in self.metrics}

    def _counted(self, name: str, indices: Sequence[int]) -> np.ndarray:
        """A metric's values for samples that have it: visible (hidden) points may be missing."""
        values, share = self.metrics[name][list(indices)], self.metrics.get("visible_share")
        if share is None or not ("_visible" in name or "_hidden" in name):
            return values
        some = share[list(indices)]
        return values[some > 0 if "_visible" in name else some < 1]

    def rows(self) -> list[Row]:
        """A row per category, sorted by name, then the means over samples and over categories."""
        members: dict[str, list[int]] = {}
        for i, name in enumerate(self.names):
            members.setdefault(name.category or "(none)", []).append(i)
        rows = [
            Row(name, len(indices), {k: _mean(self._counted(k, indices)) for k in self.metrics})
            for name, indices in sorted(members.items())
        ]
        over_categories = {
            name: _mean([_mean(v) for i in members.values() if len(v := self._counted(name, i))])
            for name in self.metrics
        }
        total = len(self.names)
        averages = (OVER_SAMPLES, self.means), (OVER_CATEGORIES, over_categories)
        return [*rows, *(Row(name, total, metrics) for name, metrics in averages)]


def at_thresholds(
    measured: Evaluation, chosen: Mapping[str, float], *, best: str = ""
) -> Evaluation:
    """Replaces metrics [samples, thresholds] of an evaluation by the values at one threshold.

    `chosen` is `{"threshold_of_iou": .4, ...}` from an earlier evaluation. A missing threshold is
    chosen here, with the best mean over samples. `one_minus_iou` is 1 - the metric `best`.
    """
    metrics = dict(measured.metrics)
    taken: dict[str, float] = {}
    for name, values in measured.metrics.items():
        if values.ndim == 2:
            key = THRESHOLD_OF + name
            column = int(np.argmax(values.mean(axis=0)))
            if key in chosen:
                column = int(np.argmin(np.abs(np.array(PREDICTION_THRESHOLDS) - chosen[key])))
            metrics[name] = values[:, column]
            taken[key] = PREDICTION_THRESHOLDS[column]
    if best in metrics:
        metrics["one_minus_iou"] = 1 - metrics[best]
    note = "Natural logarithms of volumes in radius^3."
    if taken:
        earlier = taken.keys() <= chosen.keys()
        where = "on the split that was evaluated during training" if earlier else "on this split"
        text = ", ".join(f"{k.removeprefix(THRESHOLD_OF)} {v:g}" for k, v in taken.items())
        note = f"IoU of {OCCUPANCY_SIZE}^3 solid volumes; thresholds, chosen {where}: {text}."
    return dataclasses.replace(measured, metrics=metrics, note=note, chosen=taken)


def _mean(values: Sequence[float] | np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
