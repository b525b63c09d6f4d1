"""Draws the model card's picture: the case of median CD of each of several sets of records.

    python tests/bench/picture.py --out docs/predictions.png --data FOLDER:test:lamp ...

`--data` is a folder of records, its split, and optionally a category: `FOLDER:SPLIT:CATEGORY`. From
each, at most `--most` evenly spaced samples are predicted. The case with the median CD is drawn:
image, prediction and truth from the camera, prediction and truth from the side.
"""

import argparse
import io
import pathlib
import sys

import numpy as np
from PIL import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import psgn_jax
from psgn_jax.data.dataset import RecordReader
from psgn_jax.losses import chamfer_sq_mean
from psgn_jax.system.files import write_atomic
from psgn_jax.viewing import spheres

HEIGHT = 168


def median_case(predictor, data, most):
    """The case with the median CD: its sample, the prediction, as many true points, the CD."""
    folder, split, *category = data.split(":")
    reader = RecordReader(folder, split)
    samples = (reader[i] for i in range(len(reader)))
    chosen = [s for s in samples if not category or s.category == category[0]]
    cases = []
    for sample in chosen[:: -(-len(chosen) // most)]:
        points = predictor(sample.image, sample.mask, frame="keep", normal_form="no").points[0]
        order = np.random.default_rng(0).permutation(len(sample.points))
        error = float(chamfer_sq_mean(points, sample.points[order[:4096]]))
        cases.append((error, sample, points, sample.points[order[: len(points)]]))
    return sorted(cases, key=lambda case: case[0])[len(cases) // 2]


def draw(sample, points, truth):
    """One row of the picture."""
    clouds = spheres.by_height({"prediction": points, "truth": truth})
    panels = spheres.panels(vars(sample), clouds, height=HEIGHT)
    return np.concatenate(list(panels.values()), axis=1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--weights", default="", help="file or name; default: the package's")
    parser.add_argument("--data", nargs="+", required=True, metavar="FOLDER:SPLIT[:CATEGORY]")
    parser.add_argument("--most", type=int, default=100, help="largest number of samples of each")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    arguments = parser.parse_args()
    predictor = psgn_jax.load(arguments.weights)
    rows = []
    for data in arguments.data:
        error, *case = median_case(predictor, data, arguments.most)
        print(f"{data}: {case[0].model_id}, view {case[0].view}, CD squared {error:.4f}")
        rows.append(draw(*case))
    stream = io.BytesIO()
    picture = Image.fromarray(np.concatenate(rows))
    picture.quantize(256).save(stream, "PNG", optimize=True)
    write_atomic(arguments.out, stream.getvalue())


if __name__ == "__main__":
    main()
