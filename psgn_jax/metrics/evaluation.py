"""Metrics of every sample of a split, and their averages.

There are two averages: over samples, and over categories (each category has the same weight).
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

OVER_SAMPLES, OVER_CATEGORIES = "mean over samples", "mean over categories"


@dataclasses.dataclass(frozen=True)
class Row:
    """One row of the table: a category (or an average), its number of samples, its mean metrics."""

    name: str
    count: int
    metrics: dict[str, float]


class SampleName(NamedTuple):
    """Identifies the sample of a row of `samples.csv`; `record` is its index in the split."""

    record: int
    category: str
    model_id: str
    view: int


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Metrics of every sample of a split, in order.

    Attributes:
      split: the split's name.
      names: one per sample.
      metrics: name -> float64 [samples].
      threshold: distance threshold of the F-score, in units.
      num_points: numbers of points of a predicted and of a true cloud; most metrics depend on both.
      visible_tolerance: largest distance of a visible true point from a point that the depth image
        measured, in units (`data.visibility`).
      note: text below the table, in place of the default text about points; "" = default text.
      frame: "place" if images were placed by the rule of `data.framing` and the true points were
        moved with them; "keep" if not.
      chosen: values that were chosen on a split (this or an earlier one) and used in the
        evaluation, such as thresholds.
    """

    split: str
    names: list[SampleName]
    metrics: dict[str, np.ndarray]
    threshold: float
    num_points: tuple[int, int]
    visible_tolerance: float = 0.0
    note: str = ""
    frame: str = "keep"
    chosen: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def means(self) -> dict[str, float]:
        """Every metric's mean over samples.

        Samples without visible points are left out of the means of the metrics of visible points;
        if no sample has any, the mean is NaN. The same holds for hidden points. In all other
        metrics a NaN makes the mean NaN.
        """
        everything = range(len(self.names))
        return {name: _mean(self._counted(name, everything)) for name in self.metrics}

    def _counted(self, name: str, indices: Sequence[int]) -> np.ndarray:
        """A metric of some samples.

        A metric of visible (hidden) points leaves out samples without visible (hidden) points.
        """
        values, share = self.metrics[name][list(indices)], self.metrics.get("visible_share")
        if share is not None and "_visible" in name:
            return values[share[list(indices)] > 0]
        if share is not None and "_hidden" in name:
            return values[share[list(indices)] < 1]
        return values

    def rows(self) -> list[Row]:
        """A row per category, sorted by name, then the mean over samples and over categories."""
        members: dict[str, list[int]] = {}
        for i, name in enumerate(self.names):
            members.setdefault(name.category or "(none)", []).append(i)
        rows = [
            Row(name, len(indices), {k: _mean(self._counted(k, indices)) for k in self.metrics})
            for name, indices in sorted(members.items())
        ]
        over_categories = {
            name: _mean(
                [_mean(v) for indices in members.values() if len(v := self._counted(name, indices))]
            )
            for name in self.metrics
        }
        return [
            *rows,
            Row(OVER_SAMPLES, len(self.names), self.means),
            Row(OVER_CATEGORIES, len(self.names), over_categories),
        ]


def _mean(values: Sequence[float] | np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
