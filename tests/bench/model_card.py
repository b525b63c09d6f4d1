"""Writes the figures and pictures of docs/model_card.md for a file of weights.

    python tests/bench/model_card.py --weights FILE --data records/authors \\
        [--data records/free/furniture:test ...] --out docs

Every `--data` is a folder of records, with the split after a colon (default: validation). Each is
evaluated twice: with the images as they are (`--frame=keep` of `psgn evaluate`) and with the object
placed in them (`--frame=place`). The metrics are means over all samples. For each frame, a sheet
shows the first `--cases` cases of the first folder, in the order of the records.

The command replaces the text between `<!-- begin NAME -->` and `<!-- end NAME -->` (weights,
sources, figures) of docs/model_card.md, and writes it with the sheets into `--out`. A sheet has at
most 400 kB.
"""

import argparse
import pathlib
import re
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from small_png import small_png

from psgn_jax import tasks
from psgn_jax.commands.evaluate import open_with_records
from psgn_jax.commands.weights import describe
from psgn_jax.evaluation import table
from psgn_jax.evaluation.report import Collector
from psgn_jax.evaluation.run import FRAMES, evaluate_run
from psgn_jax.system.files import write_atomic
from psgn_jax.viewing import spheres
from psgn_jax.weights.file import read_weights
from psgn_jax.weights.opening import weights_path

CARD = pathlib.Path(__file__).resolve().parents[2] / "docs" / "model_card.md"
LARGEST_SHEET = 400_000
METRICS = (
    "cd_sq_radius2",
    "cd_l1_radius",
    "emd_radius",
    "fscore",
    "aligned_cd_sq_radius2",
    "aligned_emd_radius",
)
TITLES = {"keep": "as framed", "place": "placed"}


def row(data, frame, evaluation):
    """Cells of a row: data set and split, framing, number of samples, means of the metrics."""
    folder, _, split = data.partition(":")
    cells = [f"{pathlib.Path(folder).name}, {split or 'validation'}", TITLES[frame]]
    cells.append(str(len(evaluation.names)))
    for name in METRICS:
        value = float(np.mean(evaluation.metrics[name]))
        cells.append(f"{100 * value:.1f} %" if name == "fscore" else f"{value:.4f}")
    return cells


def sheet(evaluation, collector, cases):
    """PNG of the first cases: image, prediction, truth."""
    drawn = []
    for i in range(min(cases, len(collector))):
        case = collector[i]
        error = evaluation.metrics["cd_sq_radius2"][i]
        clouds = spheres.by_height({f"{error:.4f}": case["pred"], "truth": case["points"]})
        label = f"{evaluation.names[i].record} {evaluation.names[i].category}"[:22]
        drawn.append((label, spheres.panels(case, clouds, (0,), height=84)))
    picture = spheres.sheet(drawn, columns=4)
    return small_png(picture, LARGEST_SHEET)


def sources(weights):
    """The table of data and licences in the weights."""
    lines = [["source", "licence", "models", "by"]]
    for source in weights.sources:
        for licence, each in source["licences"].items():
            holders = ", ".join(map(str, each.get("holders") or []))
            lines.append([source["source"], licence, str(each.get("models", "")), holders])
    return table.markdown(lines) if len(lines) > 1 else "The weights do not state their data.\n"


def filled(text, blocks):
    """The card with the content of its blocks replaced."""
    for name, content in blocks.items():
        pattern = rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)"
        text, count = re.subn(
            pattern, lambda m, c=content: f"{m[1]}\n{c.strip()}\n\n{m[2]}", text, flags=re.DOTALL
        )
        if count != 1:
            raise SystemExit(f"{count} blocks {name!r} in the card: expected one")
    return text


def evaluate(weights, data, frame, folder):
    """The evaluation of a data set, and its samples."""
    path, _, split = data.partition(":")
    collector = Collector(folder)
    evaluation = evaluate_run(
        open_with_records(None, weights, data=path),
        tasks.create,
        split=split or "validation",
        frame=frame,
        out=folder / frame,
        on_batch=collector,
    )
    return evaluation, collector


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--weights", default="", help="file or name; default: the package's")
    parser.add_argument("--data", action="append", required=True, metavar="RECORDS[:SPLIT]")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--cases", type=int, default=64)
    arguments = parser.parse_args()
    path = weights_path(arguments.weights)
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for data in arguments.data:
            for frame in FRAMES:
                evaluation, collector = evaluate(arguments.weights, data, frame, pathlib.Path(name))
                rows.append(row(data, frame, evaluation))
                if data == arguments.data[0]:
                    content = sheet(evaluation, collector, arguments.cases)
                    write_atomic(arguments.out / f"model_card_{frame}.png", content)
    head = ["data", "framing", "samples", *(table.header(evaluation, name) for name in METRICS)]
    weights = read_weights(path)
    blocks = {
        "weights": f"```\n{describe(weights, path)}```",
        "sources": sources(weights),
        "figures": table.markdown([head, *rows]),
    }
    text = filled(CARD.read_text(encoding="utf-8"), blocks)
    write_atomic(arguments.out / CARD.name, text)


if __name__ == "__main__":
    main()
