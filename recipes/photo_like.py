"""Compares a network on photo-like images with the same network on plain renders.

    python recipes/photo_like.py --packages FOLDER --work FOLDER [--weights NAME|FILE]

Renders the test models of the sources `furniture` and `collections` of `free_set.py` twice: with
the preset `authors`, and with the preset `photo`, whose cameras, light and surroundings vary more.
The photo-like images are disturbed by `data.photo_effects`: noise, blur, JPEG compression,
occluders, and masks that are eroded or dilated, ragged, and sometimes incomplete. Images of both
sets are placed by the rule for photos, and predicted and true clouds are compared in normal form,
as `psgn predict` writes clouds of photos. The command prints the metrics of both sets, those of the
plain set with the same disturbances, and the aligned CD of the photo-like set divided by that of
the undisturbed plain set. The rendered sets stay in `--work`; a second call continues or reuses
them.
"""

import argparse
import dataclasses
import pathlib
import sys

import free_set
import jax
import numpy as np
from absl import logging
from free_set import select

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import psgn_jax
from data_gen import job
from data_gen.catalogues.entry import Catalogue
from psgn_jax.config.data import PhotoEffects
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.framing import normal_form
from psgn_jax.data.photo_effects import disturb
from psgn_jax.evaluation.aligned import aligned_metrics
from psgn_jax.losses.chamfer import chamfer_sq_mean

SOURCES = ("furniture", "collections")
METRICS = ("cd_sq_radius2", "aligned_cd_sq_radius2", "aligned_emd_radius")
NUM_TRUE = 4096
EFFECTS = PhotoEffects(
    erode=1.5, dilate=1.5, ragged=1.5, occluders=0.1, blur=0.7, noise=0.02, jpeg=0.5
)


def render(packages, work, views, workers):
    """Renders both sets of each source: {preset: folders}."""
    folders = {"authors": [], "photo": []}
    for name in SOURCES:
        source = dataclasses.replace(free_set.SOURCES[name], views=views)
        models = select(source, packages)
        models = Catalogue(models.name, [each for each in models.models if each.split == "test"])
        for preset, made in folders.items():
            part = free_set.Part(source, preset, f"{preset}/{name}", views)
            options = free_set.settings_of(part, workers=workers)
            job.render_catalogue(models, work / part.folder, options)
            made.append(work / part.folder)
    return folders


def samples_of(folder):
    """The samples of a set."""
    reader = RecordReader(folder, "test")
    return (reader[i] for i in range(len(reader)))


def disturbed(folder):
    """The samples of a set, disturbed, with grey outside the mask."""
    for i, sample in enumerate(samples_of(folder)):
        image, mask = disturb(sample.image, sample.mask, np.random.default_rng([0, i]), EFFECTS)
        yield dataclasses.replace(sample, image=image, mask=mask)


def measure(predictor, samples):
    """Metrics of the samples of a set: {metric: values}."""
    rows = []
    for sample in samples:
        prediction = predictor(sample.image, sample.mask, frame="place", normal_form="yes")
        scale, shift = normal_form(sample.points)
        chosen = np.random.default_rng(0).permutation(len(sample.points))[:NUM_TRUE]
        truth = ((sample.points[chosen] - shift) / scale).astype(np.float32)
        rows.append(jax.device_get(compare(prediction.points[0], truth)))
    return {name: np.array([row[name] for row in rows]) for name in METRICS}


@jax.jit
def compare(pred, gt):
    """Metrics of a pair of clouds."""
    return {
        "cd_sq_radius2": chamfer_sq_mean(pred, gt),
        **aligned_metrics(pred, gt, emd_tolerance=0.01),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--packages", required=True, help="folder of `free_set.py --packages`")
    parser.add_argument("--work", required=True, type=pathlib.Path, help="folder of the renders")
    parser.add_argument("--weights", default="", help="file or name; default: the package's")
    parser.add_argument("--views", type=int, default=2, help="images of each model")
    parser.add_argument("--workers", type=int, default=0)
    arguments = parser.parse_args()
    logging.set_verbosity(logging.INFO)
    folders = render(arguments.packages, arguments.work, arguments.views, arguments.workers)
    predictor = psgn_jax.load(arguments.weights)
    rows = {"plain": [], "plain, disturbed": [], "photo-like": []}
    for plain, photo in zip(folders["authors"], folders["photo"], strict=True):
        rows["plain"].append(measure(predictor, samples_of(plain)))
        rows["plain, disturbed"].append(measure(predictor, disturbed(plain)))
        rows["photo-like"].append(measure(predictor, disturbed(photo)))
    print("| set | source | images | " + " | ".join(METRICS) + " |")
    print("|" + "---|" * (3 + len(METRICS)))
    means = {}
    for title, measured in rows.items():
        both = {m: np.concatenate([values[m] for values in measured]) for m in METRICS}
        for source, values in zip((*SOURCES, "all"), (*measured, both), strict=True):
            cells = " | ".join(f"{np.mean(values[m]):.4f}" for m in METRICS)
            print(f"| {title} | {source} | {len(values[METRICS[0]])} | {cells} |")
        means[title] = np.mean(both["aligned_cd_sq_radius2"])
    ratio = means["photo-like"] / means["plain"]
    print(f"\naligned CD, photo-like over plain: {ratio:.2f}")


if __name__ == "__main__":
    main()
