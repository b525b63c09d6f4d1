"""Draws the metrics of evaluations against the number of training samples seen.

    python tests/bench/learning_curve.py --out docs/learning_curve.png RUN [RUN ...]

Every `RUN` is the folder of a run, or a folder with its `config.json` and `metrics.jsonl`. Each run
continues the previous one (`train.init`). The number of samples seen is that of all previous runs
plus step times batch size; runs that were trained side by side are drawn one after the other.
Metrics are those of the averaged parameters on the validation split; values above 1.6 times the
smallest are outside the picture.
"""

import argparse
import json
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from psgn_jax.experiments import figures
from psgn_jax.files import write_atomic
from psgn_jax.training.log import read_metrics

METRICS = {"cd_sq_radius2": "CD squared [radius$^2$]", "emd_radius": "EMD [radius]"}


def evaluations(run):
    """Samples per step, number of steps made, and the evaluations of a run as (step, metrics)."""
    config = json.loads((run / "config.json").read_text(encoding="utf-8"))
    lines = read_metrics(run / "metrics.jsonl")
    rows = {row["step"]: row for row in lines if row["kind"] == "eval"}
    steps = max(row["step"] for row in lines)
    return config["train"]["batch_size"], steps, sorted(rows.items())


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("runs", nargs="+", type=pathlib.Path, metavar="RUN")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="the picture, *.png")
    arguments = parser.parse_args()
    figure = figures.blank(880, 330)
    axes = figure.subplots(1, len(METRICS))
    seen, smallest = 0, dict.fromkeys(METRICS, float("inf"))
    for number, run in enumerate(arguments.runs, 1):
        batch, steps, rows = evaluations(run)
        samples = [(seen + batch * step) / 1000 for step, _ in rows]
        for axis, metric in zip(axes, METRICS, strict=True):
            points = [
                (at, row[metric])
                for at, (_, row) in zip(samples, rows, strict=True)
                if metric in row
            ]
            if not points:
                continue
            smallest[metric] = min(smallest[metric], *(value for _, value in points))
            axis.plot(*zip(*points, strict=True), ".-", markersize=3)
            axis.annotate(str(number), points[0], xytext=(0, 8 + 9 * (number % 2)),
                          textcoords="offset points", ha="center", fontsize=7,
                          annotation_clip=True)  # fmt: skip
        for at, (step, row) in zip(samples, rows, strict=True):
            shown = ", ".join(f"{m} {row[m]:.5f}" for m in METRICS if m in row)
            print(f"run {number}, step {step}, {at:.1f} thousand samples: {shown}")
        seen += batch * steps
    for axis, (metric, label) in zip(axes, METRICS.items(), strict=True):
        axis.set(xlabel="training samples seen [thousands]", ylabel=label)
        if np.isfinite(smallest[metric]):
            axis.set_ylim(0.95 * smallest[metric], 1.6 * smallest[metric])
        axis.grid(alpha=0.3)
    write_atomic(arguments.out, figures.png(figure))


if __name__ == "__main__":
    main()
