"""The data of the study `ambiguity`, images of cabinets, and measures of their depth.

The parts of a cabinet (panel, body, rail) are described in `data_gen.catalogues.doubt`.
"""

import pathlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from absl import logging

from psgn_jax.config import ConfigError
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.schema import RecordError
from psgn_jax.metrics import samples as sample_metrics
from psgn_jax.untrusted import parse_json

DOUBT, NO_DOUBT = "front", "turned"
"""Kinds of images: ambiguous (the depth is hidden), and unambiguous."""

# Geometry of `data_gen.catalogues.doubt` before normalisation: position of the front of the body
# along x, from the middle of the rail; and length of the deepest body.
BODY_BEGINS, DEEPEST = 0.94, 1.94
DEPTH_RANGE = (0.15, 1.0)


class Truth(NamedTuple):
    """Parameters of a validation sample."""

    kind: str
    seed: int
    scale: float
    depth: float


def build_data(
    folder: pathlib.Path,
    image_size: tuple[int, int],
    seeds: tuple[int, int],
    draws: tuple[int, int],
) -> None:
    """Renders the data set, or completes it.

    Raises:
      ConfigError: rendering is not installed or fails, or the folder contains other data.
    """
    # Imported here because only the data stage needs Mitsuba.
    from data_gen import cameras, job, settings
    from data_gen.catalogues import doubt

    options = settings.Settings(
        views=1,
        num_points=4096,
        models_per_shard=64,
        # The camera is at elevation 0 in front of the panel and aims at its middle.
        camera=cameras.CameraSettings(
            image_size=image_size, azimuth=(0.0, 0.0), elevation=(0.0, 0.0), aim=(0.45, 0.45)
        ),
    )
    try:
        summary = job.render_catalogue(doubt.DoubtCatalogue(seeds, draws), folder, options)
    except (RuntimeError, ValueError) as error:
        raise ConfigError(f"the study's data set: {error}") from error
    logging.info("data: %s", summary.text().splitlines()[1])


def truths(data: pathlib.Path) -> list[Truth]:
    """Kind, seed, scale and hidden depth of every validation record, in order."""
    reader = RecordReader(data, "validation")
    known: list[Truth] = []
    for sample in (reader[index] for index in range(len(reader))):
        try:
            entry = parse_json(sample.extra)["parameters"]
            depth = float(entry["hidden"]["depth"])
            known.append(Truth(sample.category, int(entry["seed"]), float(entry["scale"]), depth))
        except (ValueError, KeyError, TypeError) as error:
            raise RecordError(
                f"data set {str(data)!r}: {sample.model_id!r} lacks the study's parameters "
                f"({error!r}); remove the folder, and the study will render it again"
            ) from None
    return known


def measured_depth(points: np.ndarray, scale: float) -> float:
    """The hidden depth of a cabinet seen from the front, measured from its points [n, 3].

    The far end of the body is the 5 % quantile of x over the points above the rail. The back face
    of the body has more than 5 % of these points, and less than 5 % are stray points.
    `data_gen.catalogues.doubt` describes the body and the rail.

    Args:
      points: points in the frame of a sample of the kind `front`.
      scale: scale of the cabinet, `Truth.scale`; it does not depend on the hidden depth.
    """
    above = points[points[:, 2] > 0.1, 0]
    if not len(above):
        return DEPTH_RANGE[0]
    return float((BODY_BEGINS - np.quantile(above, 0.05) / scale) / DEEPEST)


def groups(known: Sequence[Truth]) -> dict[int, list[int]]:
    """Ambiguous records that share an image, by seed."""
    groups: dict[int, list[int]] = {}
    for i, t in enumerate(known):
        if t.kind == DOUBT:
            groups.setdefault(t.seed, []).append(i)
    return groups


def check_measure(data: pathlib.Path) -> dict[str, float]:
    """Errors of `measured_depth` on the true points: mean and maximum."""
    reader, known = RecordReader(data, "validation"), truths(data)
    errors = [
        abs(measured_depth(reader[i].points, t.scale) - t.depth)
        for i, t in enumerate(known)
        if t.kind == DOUBT
    ]
    return {"mean error": float(np.mean(errors)), "largest error": float(np.max(errors))}


def calibration(depths: np.ndarray, known: Sequence[Truth]) -> dict[str, float]:
    """Compares depths of draws [samples, draws] for ambiguous images with the true distribution."""
    low, high = DEPTH_RANGE
    uniform = np.linspace(low, high, 1001)
    rows = [i for i, t in enumerate(known) if t.kind == DOUBT]
    apart = [sample_metrics.wasserstein_1(depths[i], uniform) for i in rows]
    # For comparison: as many draws from the true distribution.
    exact = np.random.default_rng(0).uniform(low, high, (200, depths.shape[1]))
    return {
        "Wasserstein-1 of the depth, one image [share]": float(np.mean(apart)),
        "Wasserstein-1 of exact draws [share]": float(
            np.mean([sample_metrics.wasserstein_1(d, uniform) for d in exact])
        ),
        "Wasserstein-1 of the depth, all images [share]": sample_metrics.wasserstein_1(
            depths[rows].reshape(-1), uniform
        ),
        "Wasserstein-1 of a single value, the mean [share]": (high - low) / 4,
        "coverage of the range of depths": float(
            np.mean([sample_metrics.range_coverage(depths[i], low, high) for i in rows])
        ),
        "mean drawn depth [share]": float(depths[rows].mean()),
        "spread of the drawn depth [share]": float(depths[rows].std(axis=1).mean()),
        "spread of exact draws [share]": (high - low) / float(np.sqrt(12)),
    }
