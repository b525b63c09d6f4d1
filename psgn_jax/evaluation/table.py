"""Writes an evaluation as a table: text, CSV and JSON, one row per category and two averages."""

import csv
import io
import json
import re
import textwrap
import unicodedata
from collections.abc import Sequence
from typing import Any

import numpy as np

from psgn_jax.evaluation.aligned import ITERATIONS, LARGEST_SCALE, LEAST_SCALE
from psgn_jax.evaluation.clouds import METRICS
from psgn_jax.evaluation.results import OVER_CATEGORIES, OVER_SAMPLES, Evaluation, SampleName
from psgn_jax.prediction.silhouette import MOST_OUTSIDE
from psgn_jax.system.files import finite_or_none
from psgn_jax.system.untrusted import one_line

_HEADER = 10  # characters, as many as "[radius^2]" has

Lines = Sequence[Sequence[str]]  # cells of a table; the first row is the header


def aligned(lines: Lines, *, apart: int = 0) -> str:
    """A table as text: left-aligned first column, a rule before the last `apart` rows.

    Headers are broken into lines of at most `_HEADER` characters or one longer word.
    """
    head = [textwrap.wrap(cell, _HEADER, break_long_words=False) for cell in lines[0]]
    deep = max(map(len, head))
    rows = [*zip(*([""] * (deep - len(x)) + x for x in head), strict=True), *lines[1:]]
    left, *widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    text = [
        "  ".join([first.ljust(left), *map(str.rjust, others, widths)]) for first, *others in rows
    ]
    rule = "-" * len(text[0])
    text.insert(deep, rule)
    if apart:
        text.insert(len(text) - apart, rule)
    return "\n".join(text) + "\n"


def markdown(lines: Lines) -> str:
    head, *rows = lines
    ruled = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in ruled) + "\n"


def title(metric: str) -> str:
    """The column title of a metric in printed tables; "" if they lack it."""
    return METRICS[metric].title if metric in METRICS else ""


def header(evaluation: Evaluation, metric: str) -> str:
    """The column header of a metric: its name and unit."""
    if of_draws := _OF_DRAWS.fullmatch(metric):
        return f"{of_draws[2]} of {of_draws[3]} draws: {header(evaluation, of_draws[1])}"
    return (title(metric) or f"{metric} [fraction]").format(threshold=evaluation.threshold)


_OF_DRAWS = re.compile(r"(.*)_(best|mean)_of_(\d+)")


def cell(metric: str, value: float) -> str:
    return f"{100 * value:.2f}" if title(metric).endswith("[%]") else f"{value:.5f}"


def lines(evaluation: Evaluation, names: Sequence[str], prefix: str = "") -> list[list[str]]:
    """The cells of the metrics in `names`; their headers begin with `prefix`."""
    head = ["category", "samples", *(prefix + header(evaluation, name) for name in names)]
    rows = [(one_line(row.name), str(row.count), row.metrics) for row in evaluation.rows()]
    return [head, *([*ids, *(cell(name, of[name]) for name in names)] for *ids, of in rows)]


def text(evaluation: Evaluation) -> str:
    """The printed table: a row for each category, the two averages, and an explanation."""
    names = [name for name in METRICS if title(name) and name in evaluation.metrics]
    names += filter(_OF_DRAWS.fullmatch, evaluation.metrics)
    if evaluation.note:
        names = list(evaluation.metrics)
    table = aligned(lines(evaluation, names), apart=2)
    if evaluation.note:
        return f"{table}\nSplit {evaluation.split!r}. {evaluation.note}\n"
    return table + _note_on_points(evaluation)


def csv_text(evaluation: Evaluation) -> str:
    rows = [[r.name, r.count, *r.metrics.values()] for r in evaluation.rows()]
    return csv_of(["category", "samples", *evaluation.metrics], rows)


def samples_csv(evaluation: Evaluation) -> str:
    columns = [values.tolist() for values in evaluation.metrics.values()]
    rows = [[*name, *numbers] for name, *numbers in zip(evaluation.names, *columns, strict=True)]
    return csv_of([*SampleName._fields, *evaluation.metrics], rows)


def json_text(evaluation: Evaluation, **others: Any) -> str:
    """The table as JSON, with `others`; numbers that are not finite become null."""
    *categories, over_samples, over_categories = evaluation.rows()
    of_points = {
        "num_pred_points": evaluation.num_points[0],
        "num_gt_points": evaluation.num_points[1],
        "num_distinct_gt_points": evaluation.num_distinct,
        "fscore_threshold": evaluation.threshold,
    }
    document = {
        **others,
        "split": evaluation.split,
        "samples": over_samples.count,
        **(evaluation.chosen if evaluation.note else of_points),
        "categories": {
            r.name: {"samples": r.count, **finite_or_none(r.metrics)} for r in categories
        },
        OVER_SAMPLES.replace(" ", "_"): finite_or_none(over_samples.metrics),
        OVER_CATEGORIES.replace(" ", "_"): finite_or_none(over_categories.metrics),
    }
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def _note_on_points(evaluation: Evaluation) -> str:
    emd = visibility = aligned = frame = repeated = ""
    num_pred, num_gt = evaluation.num_points
    fewest, highest = evaluation.num_distinct or (num_gt, num_gt)
    if fewest < num_gt:
        number = f"{fewest} to {highest}" if fewest < highest else f"{fewest}"
        repeated = f", {number} of a cloud different, the others repeated"
    if "emd_gap" in evaluation.metrics:
        gap = 100 * float(np.max(evaluation.metrics["emd_gap"]))
        once = "as often as it occurs" if fewest < num_pred else "once"
        emd = f""" EMD: mean distance
between matched points of the prediction and of as many true points, each of which is used {once};
it is at most {gap:.2f} % above the minimum."""
    if "visible_share" in evaluation.metrics:
        tolerance = evaluation.visible_tolerance
        visibility = f"""
Visible: true points within {tolerance:g} radius of a point that the depth image measured;
hidden: the others. Their columns: mean over these points of the squared distance to the nearest
predicted point."""
    if "aligned_cd_sq_radius2" in evaluation.metrics:
        aligned = f"""
Aligned: the same distances after a scale in [{LEAST_SCALE:g}, {LARGEST_SCALE:g}] and a shift of
each prediction that bring it nearest to its truth ({ITERATIONS} nearest-neighbour iterations)."""
    if evaluation.frame == "place":
        frame = """
Images were cropped and placed like photos, and the true points were moved with them. This changes
an object's radius from 1 to about 0.8 to 1.2; distances are not divided by it."""
    if evaluation.refined:
        frame += f"""
Predicted clouds were averaged with the mirror image's clouds, unless the network reads depth, and
fitted to the image's mask if at most {MOST_OUTSIDE:.0%} of their points project outside it.
Distances of several draws are those of unchanged clouds."""
    return f"""
Split {evaluation.split!r}, {num_pred} predicted points against {num_gt} true ones{repeated}.
radius: of the object's bounding hemisphere, the unit of all coordinates.
CD squared: mean over predicted points of the squared distance to the nearest true point, plus the
mean over true points of the squared distance to the nearest predicted point. CD-L1: half the sum of
the corresponding means of distances without squares.{emd}{visibility}{aligned}{frame}
"""


def csv_of(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table as CSV, whose texts are quoted and never formulas or control characters.

    Names come from other people's records, and spreadsheet programs compute cells such as `=1+1`.
    We put an apostrophe before them (OWASP, "CSV Injection") and escape control characters.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC)
    writer.writerows([_harmless(cell) for cell in row] for row in [head, *rows])
    return buffer.getvalue()


def read_csv(text: str) -> list[dict[str, str]]:
    """The rows of a `csv_of` table, with the original texts."""
    head, *rows = ([_original(cell) for cell in row] for row in csv.reader(io.StringIO(text)))
    return [dict(zip(head, row, strict=True)) for row in rows]


def _harmless(cell: Any) -> Any:
    if not isinstance(cell, str):
        return cell
    first = unicodedata.normalize("NFKC", cell.lstrip()[:1])  # full-width signs, too
    if cell.isprintable() and first not in tuple("=+-@'"):
        return cell
    return "'" + "".join(
        c if c.isprintable() and c != "\\" else c.encode("unicode_escape").decode("ascii")
        for c in cell
    )


def _original(cell: str) -> str:
    if not cell.startswith("'"):
        return cell
    escapes = r"\\(?:[\\tnr]|x.{2}|u.{4}|U.{8})"
    return re.sub(escapes, lambda e: e[0].encode().decode("unicode_escape"), cell[1:])
