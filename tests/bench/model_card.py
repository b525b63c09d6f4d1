"""Writes the figures and pictures of docs/model_card.md for a file of weights.

    python tests/bench/model_card.py --weights FILE --data records/authors \\
        [--data records/free/furniture:test ...] --out docs

Every `--data` is a folder of records, with the split after a colon (default: validation). Each is
evaluated twice: with the images as they are (`--frame=keep` of `psgn evaluate`) and with the object
placed in them (`--frame=place`). The metrics are means over all samples, by category if the records
have categories, and by elevation of the camera. For each frame, a sheet shows the first `--cases`
cases of the first folder, in the order of the records.

The command replaces the text between `<!-- begin NAME -->` and `<!-- end NAME -->` (weights,
sources, figures) of docs/model_card.md, and writes it with the sheets into `--out`. A sheet has at
most 400 kB.
"""

import argparse
import io
import itertools
import pathlib
import re
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from psgn_jax.files import write_atomic
from psgn_jax.metrics import table
from psgn_jax.tasks.runs import FRAMES, evaluate_run
from psgn_jax.viewing import spheres
from psgn_jax.viewing.collected import Collector
from psgn_jax.weights.file import read_weights
from psgn_jax.weights.listing import describe
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
ELEVATIONS = (-90, 5, 15, 25, 40, 90)
TITLES = {"keep": "as framed", "place": "placed"}


def elevation(extrinsics):
    """Degrees of a camera [3, 4] above the horizon, seen from the object's centre on the ground."""
    x, y, z = -extrinsics[:, :3].T @ extrinsics[:, 3]
    return float(np.degrees(np.arctan2(z, np.hypot(x, y))))


def number(metric, value):
    """The text of a cell."""
    return f"{100 * value:.1f} %" if metric == "fscore" else f"{value:.4f}"


def row(title, values):
    """Cells of a row: its title, the number of samples, means of the metrics."""
    count = len(next(iter(values.values())))
    return [title, str(count), *(number(name, float(np.mean(values[name]))) for name in METRICS)]


def parts(evaluation, elevations):
    """Rows of all samples, of categories and of elevations."""
    metrics = {name: evaluation.metrics[name] for name in METRICS}
    rows = [row("all", metrics)]
    categories = np.array([name.category for name in evaluation.names])
    groups = [(each, categories == each) for each in sorted(set(categories.tolist())) if each]
    for low, high in itertools.pairwise(ELEVATIONS):
        inside = (elevations >= low) & (elevations < high)
        groups.append((f"elevation {low} to {high} degrees", inside))
    if np.ptp(elevations) < 0.5:  # one elevation
        del groups[-len(ELEVATIONS) + 1 :]
    for title, at in groups:
        if at.any():
            rows.append(row(title, {name: values[at] for name, values in metrics.items()}))
    return rows


def figures(name, evaluations, elevations):
    """A section for a data set: both frames."""
    lines = []
    for frame, evaluation in evaluations.items():
        head = [TITLES[frame], "samples", *(table.header(evaluation, m) for m in METRICS)]
        lines += [table.markdown([head, *parts(evaluation, elevations)]), ""]
    return f"### {name}\n\n" + "\n".join(lines)


def sheet(evaluation, collector, cases):
    """PNG of the first cases: image, prediction, truth."""
    drawn = []
    for i in range(min(cases, len(collector.samples))):
        sample, points = collector.samples[i], collector.preds[i]
        error = evaluation.metrics["cd_sq_radius2"][i]
        clouds = {
            f"{error:.4f}": (points, spheres.colours_by_height(points)),
            "truth": (sample.points, spheres.colours_by_height(sample.points)),
        }
        label = f"{evaluation.names[i].record} {evaluation.names[i].category}"[:22]
        drawn.append(
            spheres.Case(label, sample.image, clouds, sample.intrinsics, sample.extrinsics)
        )
    picture = spheres.sheet(drawn, columns=4, height=84, turns=(0,))
    for colours in (256, 128, 64, 32, 16):
        stream = io.BytesIO()
        picture.quantize(colours).save(stream, "PNG", optimize=True)
        if stream.tell() <= LARGEST_SHEET:
            return stream.getvalue()
    raise SystemExit(f"the sheet has {stream.tell()} bytes: fewer --cases")


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
        None,
        weights=weights,
        data=path,
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
    sections = []
    with tempfile.TemporaryDirectory() as name:
        for data in arguments.data:
            results = {}
            for frame in FRAMES:
                evaluation, collector = evaluate(arguments.weights, data, frame, pathlib.Path(name))
                results[frame] = evaluation
                if data == arguments.data[0]:
                    content = sheet(evaluation, collector, arguments.cases)
                    write_atomic(arguments.out / f"model_card_{frame}.png", content)
                if frame == "keep":
                    elevations = np.array([elevation(s.extrinsics) for s in collector.samples])
            folder, _, split = data.partition(":")
            title = f"{pathlib.Path(folder).name}, split {split or 'validation'}"
            sections.append(figures(title, results, elevations))
    weights = read_weights(path)
    pictures = "".join(
        f"![The first {arguments.cases} cases, {TITLES[frame]}](model_card_{frame}.png)\n\n"
        f"*In order, {TITLES[frame]}: image, prediction with its CD squared, truth.*\n\n"
        for frame in FRAMES
    )
    blocks = {
        "weights": f"```\n{describe(weights, path)}```",
        "sources": sources(weights),
        "figures": "\n".join(sections) + "\n" + pictures,
    }
    text = filled(CARD.read_text(encoding="utf-8"), blocks)
    write_atomic(arguments.out / CARD.name, text)


if __name__ == "__main__":
    main()
