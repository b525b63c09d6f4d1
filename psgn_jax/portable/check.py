"""Compares exported files with JAX, on images of records or on random images."""

import dataclasses
import os
from collections.abc import Callable, Mapping

import jax
import numpy as np

from psgn_jax.data import resize
from psgn_jax.data.dataset import open_split
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.portable.network import PortableNetwork

_ROWS = 16  # images that are predicted at a time
LARGEST_DIFFERENCE = 1e-4
"""Largest accepted difference between a coordinate of the float32 file and JAX's (unit)."""

LARGEST_CD_CHANGE = 0.01
"""Largest accepted change of the mean CD, relative to that of JAX's clouds."""

Arrays = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True, eq=False)
class Samples:
    """Inputs of a network, and the true clouds, if known.

    Attributes:
      inputs: arrays by the name of the input; the first axis is that of the images.
      truth: float32 [n, m, 3], or None for random images.
    """

    inputs: Arrays
    truth: np.ndarray | None

    def __len__(self) -> int:
        return len(self.inputs["image"])


@dataclasses.dataclass(frozen=True)
class Check:
    """Differences between the output of a file and that of JAX.

    Attributes:
      images: number of images that were compared.
      largest_difference: largest difference of a coordinate (unit).
      cd: mean `chamfer_sq_mean` of the file's clouds (unit^2); None without ground truth.
      cd_change: change of `cd`, relative to the value for JAX's clouds.
    """

    images: int
    largest_difference: float
    cd: float | None
    cd_change: float | None


def recorded_samples(
    network: PortableNetwork, path: str | os.PathLike[str], split: str, count: int
) -> Samples:
    """The first `count` samples of a split of records.

    Raises:
      RecordError: `path` contains no records of this split.
    """
    reader = open_split([path], split)
    size = network.config.data.image_size
    images, masks, clouds = [], [], []
    for i in range(min(count, len(reader))):
        sample = reader[i]
        images.append(resize.resize_image(sample.image, size))
        masks.append(resize.resize_mask(sample.mask, size))
        clouds.append(sample.points[np.linspace(0, len(sample.points) - 1, 1024).astype(int)])
    return Samples(_inputs(network, np.stack(images), np.stack(masks)), np.stack(clouds))


def drawn_samples(network: PortableNetwork, count: int = 8) -> Samples:
    """Random images whose masks are ellipses, for use without records; always the same images."""
    rng = np.random.default_rng(0)
    height, width = network.config.data.image_size
    rows, columns = np.mgrid[:height, :width] / np.array([height, width]).reshape(2, 1, 1) - 0.5
    radii = rng.uniform(0.15, 0.4, (count, 2, 1, 1))
    masks = (rows / radii[:, 0]) ** 2 + (columns / radii[:, 1]) ** 2 < 1
    images = rng.integers(0, 256, (count, height, width, 3), dtype=np.uint8)
    return Samples(_inputs(network, images, masks), None)


def _inputs(network: PortableNetwork, images: np.ndarray, masks: np.ndarray) -> Arrays:
    inputs = {"image": images, "mask": masks}
    if network.config.model.random_size:
        shape = (len(images), 1, network.config.model.random_size)
        inputs["r"] = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    return inputs


def expected(network: PortableNetwork, samples: Samples) -> np.ndarray:
    """The clouds [n, m, 3] that JAX predicts for the samples."""
    return _clouds(lambda arrays: np.asarray(network.compiled(*arrays.values())), samples)


def measure(
    run: Callable[[Mapping[str, np.ndarray]], np.ndarray],
    samples: Samples,
    clouds: np.ndarray,
) -> Check:
    """Compares the points of an exported file with JAX's.

    Args:
      run: maps inputs by name to the points that the file predicts.
      samples: the inputs.
      clouds: JAX's clouds, from `expected`.
    """
    own = _clouds(run, samples)
    difference = float(np.abs(own - clouds).max())
    if samples.truth is None:
        return Check(len(samples), difference, None, None)
    mean_cd = jax.jit(lambda a, b: jax.lax.map(lambda p: chamfer_sq_mean(*p), (a, b)).mean())
    cd, reference = (float(mean_cd(c, samples.truth)) for c in (own, clouds))
    return Check(len(samples), difference, cd, cd / reference - 1)


def _clouds(run: Callable[[Mapping[str, np.ndarray]], np.ndarray], samples: Samples) -> np.ndarray:
    parts = []
    for first in range(0, len(samples), _ROWS):
        arrays = {name: array[first : first + _ROWS] for name, array in samples.inputs.items()}
        parts.append(run(arrays))
    clouds = np.concatenate(parts)
    return clouds.reshape(len(samples), -1, 3)
