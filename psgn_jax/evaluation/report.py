"""Writes an evaluation as HTML pages that need no internet connection.

`index.html` is the gallery: a table per category, a histogram of errors (squared Chamfer distance),
the best, median and worst cases, and all cases, with links to the clouds in the interactive viewer
(`viewing.viewer`), `viewer.html`, `viewer-2.html`, ...
"""

import dataclasses
import io
import pathlib
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from psgn_jax.evaluation import table
from psgn_jax.evaluation.results import Evaluation
from psgn_jax.system.files import write_atomic
from psgn_jax.viewing import spheres, viewer

ERROR = "cd_sq_radius2"

_TEMPLATE = pathlib.Path(__file__).with_name("report.html")
_TABLE = ("cd_sq_radius2", "cd_l1_radius", "emd_radius", "fscore")
_PICTURES = 600  # with more cases, only the best, median and worst have pictures
_EXTREMES = 10  # number of best, median and worst cases each, as in `report.html`
_KEPT = ("points", "image", "intrinsics", "extrinsics")


class Collector:
    """A callback `on_batch` that stores the samples in an unnamed file in `folder`.

    A sample is a dict of arrays: `image` uint8 [h, w, 3], `intrinsics`, `extrinsics`, `points`
    (about as many true points as predicted) and the prediction `pred`, float32 [n, 3].
    """

    def __init__(self, folder: str | pathlib.Path) -> None:
        pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._starts: list[int] = []

    def __call__(self, index: int, batch: Any, points: np.ndarray) -> None:
        """Stores the valid rows of a batch with their predicted points [b, n, 3]."""
        for i in np.flatnonzero(batch["valid"]):
            truth, *others = (np.asarray(batch[name][i]) for name in _KEPT)
            self._starts.append(self._file.seek(0, io.SEEK_END))
            pred = np.asarray(points[i], np.float32)
            for array in (spheres.thinned(truth, pred), *others, pred):
                np.save(self._file, array)

    def __len__(self) -> int:
        return len(self._starts)

    def __getitem__(self, index: int) -> dict[str, np.ndarray]:
        self._file.seek(self._starts[index])
        return {name: np.load(self._file) for name in (*_KEPT, "pred")}


@dataclasses.dataclass(frozen=True, eq=False)
class Reported:
    """The evaluation of a network, and its samples as in `Collector`."""

    label: str  # a short name
    evaluation: Evaluation
    cases: Sequence[Mapping[str, np.ndarray]] | Collector
    num_fc: int = 0  # points of the fc branch, which come first


def write_report(folder: str | pathlib.Path, runs: Sequence[Reported]) -> pathlib.Path:
    """Writes the pages; returns the path of `index.html`.

    `runs` are one, or two on the same samples, else ValueError. The errors of the first rank cases.
    """
    folder = pathlib.Path(folder)
    first = runs[0].evaluation
    names, errors = first.names, [run.evaluation.metrics[ERROR] for run in runs]
    for run in runs:
        if run.evaluation.names != names:
            raise ValueError(f"run {run.label!r} has other samples: accepted: the same split")
    parts = [(f"{name.record:05d}", name.category, name.model_id[:16]) for name in names]
    titles = [" ".join(filter(None, part)) for part in parts]
    viewed = (_viewer_case(i, title, runs, errors) for i, title in enumerate(titles))
    pages = viewer.write_pages(folder / "viewer.html", viewed, title=runs[0].label)
    ranked = np.argsort(errors[0], kind="stable").tolist()  # NaN comes last
    middle = max(0, len(names) - _EXTREMES) // 2
    pictured = ranked[:_EXTREMES] + ranked[-_EXTREMES:] + ranked[middle:][:_EXTREMES]
    if len(names) <= _PICTURES:
        pictured = ranked
    cases = [
        {
            "name": titles[i],
            "page": pages[titles[i]].name,
            "category": name.category,
            "model": name.model_id,
            "record": name.record,
            "error": float(errors[0][i]) if np.isfinite(errors[0][i]) else None,
            "pictures": _thumbs(runs[0].cases[i]) if i in pictured else [],
        }
        for i, name in enumerate(names)
    ]
    data = {
        "title": " and ".join(run.label for run in runs),
        "about": f"{len(names)} cases of the split {first.split!r}; {first.num_points[0]} "
        f"predicted points, {first.num_points[1]} ground-truth points; radius = radius of the "
        "bounding hemisphere",
        "error_name": table.header(first, ERROR),
        "table": _table(runs),
        "histogram": _histogram(errors[0]),
        "cases": cases,
    }
    write_atomic(folder / "index.html", viewer.document(_TEMPLATE, viewer.to_json(data)))
    return folder / "index.html"


def _viewer_case(
    i: int, title: str, runs: Sequence[Reported], errors: Sequence[np.ndarray]
) -> viewer.Case:
    cases = [run.cases[i] for run in runs]
    # The viewer's slider needs clouds with the same number of points.
    same = [k for k, case in enumerate(cases) if case["pred"].shape == cases[0]["pred"].shape]
    return viewer.Case(
        name=title,
        image=cases[0]["image"],
        samples=np.stack([cases[k]["pred"] for k in same]),
        truth=cases[0]["points"],
        num_fc=runs[0].num_fc,
        about=runs[0].evaluation.names[i].category,
        metrics=tuple(f"{runs[k].label}: CD squared {errors[k][i]:.5f} radius^2" for k in same),
    )


def _thumbs(case: Mapping[str, np.ndarray]) -> list[str]:
    """Data URIs of small pictures of image and prediction."""
    clouds = spheres.by_height({"prediction": case["pred"]})
    return [*map(viewer.picture_uri, spheres.panels(case, clouds, (0,), height=96).values())]


def _table(runs: Sequence[Reported]) -> list[list[str]]:
    """The header and the rows, with the averages last; two runs are side by side."""
    rows: list[list[str]] = [[] for _ in range(len(runs[0].evaluation.rows()) + 1)]
    for run in runs:
        names = [x for x in _TABLE if all(x in run.evaluation.metrics for run in (runs[0], run))]
        prefix = f"{run.label}: " if len(runs) > 1 else ""
        for row, cells in zip(rows, table.lines(run.evaluation, names, prefix), strict=True):
            row += cells[2:] if row else cells
    return rows


def _histogram(errors: np.ndarray) -> dict[str, list[Any]]:
    """Histogram of the finite errors with logarithmically spaced bins."""
    finite = np.maximum(errors[np.isfinite(errors)], 1e-6)
    low = finite.min(initial=np.inf) if len(finite) else 1e-3
    edges = np.geomspace(low, finite.max(initial=1.1 * low), 17)
    counts, _ = np.histogram(finite, edges)
    return {"edges": edges.tolist(), "counts": counts.tolist()}
