"""Writes the folder of `psgn export`: exported files, compared with JAX, and their description."""

import hashlib
import importlib.util
import json
import os
import pathlib
import string
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
from absl import logging

from psgn_jax.config.experiment import ConfigError
from psgn_jax.data import camera, framing, resample, schema
from psgn_jax.data.dataset import RecordReader
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.models import networks
from psgn_jax.portable.network import ExportError, PortableNetwork
from psgn_jax.prediction import sampling, silhouette
from psgn_jax.prediction.draws import compared_points
from psgn_jax.system.files import write_atomic
from psgn_jax.system.onnx_runtime import session
from psgn_jax.weights.run_folder import Trained

FORMAT = "psgn_jax network 2"
LATENTS = 16
"""Number of random inputs in `network.json`, the first of `psgn predict --seed=0`."""

ONNX_NAMES = {
    "float32": "network.onnx",
    "float16": "network_float16.onnx",
    "int8": "network_int8.onnx",
}
"""Type in which weights can be stored -> file."""

CHECKED = 64
"""Largest number of images of records on which a file is compared with JAX."""

LARGEST_DIFFERENCE = 1e-4
"""Largest accepted difference between a coordinate of a float32 file and JAX's (unit)."""

LARGEST_CD_CHANGE = 0.01
"""Largest accepted change of the mean CD, relative to JAX's clouds."""

TEMPLATES = pathlib.Path(__file__).resolve().parent / "templates"
JAVASCRIPT = ("draws.js", "framing.js", "resample.js", "silhouette.js")
"""Modules in `TEMPLATES` that frame photos, choose and fit draws like the Python code."""


def _constants(module: Any, names: str) -> dict[str, Any]:
    """Constants of a module by their names in lower case, for programs in other languages."""
    return {name.lower(): getattr(module, name) for name in names.split()}


RULES = {
    "framing": _constants(
        framing,
        "BOX_WIDTH BOX_HEIGHT BOX_POWER MIDDLE_COLUMN MIDDLE_ROW MIDDLE_ROW_PER_WIDTH SMALLEST_BOX",
    ),
    "fit": _constants(
        silhouette,
        "MOST_OUTSIDE COLUMNS FAR ROUNDS STEP NEIGHBOURHOOD TAIL DEEPEST NARROWEST ELEVATIONS "
        "SAMPLES HALF",
    ),
}
"""Constants of `data.framing` and `prediction.silhouette` in `network.json`."""

Arrays = Mapping[str, np.ndarray]


def require_packages() -> None:
    """Raises `ConfigError` if packages of the extra `export` are missing."""
    names = ("onnx", "flatbuffers")  # jax.export needs flatbuffers
    missing = [name for name in names if importlib.util.find_spec(name) is None]
    if missing:
        raise ConfigError(f"{', '.join(missing)}: not installed; pip install 'psgn-jax[export]'")


def write_network(
    run: Trained,
    out: str | os.PathLike[str],
    *,
    weights: Sequence[str] = ("float32", "float16"),
    stablehlo: bool = True,
    data: str = "",
    split: str = "validation",
) -> dict[str, Any]:
    """Writes a network as ONNX and StableHLO files, `network.json`, and `JAVASCRIPT`.

    Every file is run and compared with JAX before it is written. Returns the content of
    `network.json`.

    Args:
      weights: any of `ONNX_NAMES`; each gives one ONNX file. "int8" needs `data`.
      data: folder of records for the check; "" = random images, which have no ground truth.

    Raises:
      ConfigError: an argument is wrong.
      ExportError: a parameter is not finite, an operation has no form in ONNX, or a file's clouds
        differ too much from JAX's.
    """
    _check_arguments(weights, data)
    network = PortableNetwork(run)
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(run.params)):
        raise ExportError("a parameter is not finite: a damaged or diverged training")
    from psgn_jax.portable import onnx_file  # imports onnx

    inputs, truth = drawn_inputs(network), None
    if data:
        inputs, truth = _recorded(network, data, split)
    expected = np.asarray(network.compiled(*inputs.values()))
    description = _describe(run, network)
    out = pathlib.Path(out)

    def write(name: str, stored: str, content: bytes, points: np.ndarray) -> None:
        checked = check(stored, points, expected, truth)
        write_atomic(out / name, content)
        digest = hashlib.sha256(content).hexdigest()
        size = len(content)
        row = {"weights": stored, "bytes": size, "sha256": digest, "check": checked}
        description["files"][name] = row
        logging.info("%s: %.1f MB, %s", name, size / 1e6, _summary(checked))

    for stored in weights:
        texts = {"name": description["name"], "format": FORMAT}
        content = onnx_file.to_onnx(network, network.inputs, "points", stored, texts)
        write(ONNX_NAMES[stored], stored, content, session(content)(inputs))
    if stablehlo:
        content = network.stablehlo()
        program = jax.export.deserialize(bytearray(content))
        write("network.stablehlo", "float32", content, np.asarray(program.call(*inputs.values())))
    write_atomic(out / "network.json", json.dumps(description, indent=1) + "\n")
    for name in JAVASCRIPT:
        write_atomic(out / name, (TEMPLATES / name).read_text())
    return description


def write_folder(run: Trained, out: str | os.PathLike[str], **options: Any) -> dict[str, Any]:
    """Calls `write_network`, adds a README and examples; returns the content of `network.json`."""
    description = write_network(run, out, **options)
    height, width = description["image_size"]
    values = {
        "name": description["name"] or "network",
        "height": height,
        "width": width,
        "points": description["num_points"],
        "random_size": description["random_size"] or "k",
        "points_shape": "[batch, draws, n, 3]" if description["random_size"] else "[batch, n, 3]",
        "files": "".join(
            f"| `{name}` | {row['bytes'] / 1e6:.1f} MB | {_summary(row['check'])} |\n"
            for name, row in description["files"].items()
        ),
        "licences": _licences(description["sources"]),
    }
    out = pathlib.Path(out)
    readme = string.Template((TEMPLATES / "README.md.txt").read_text())
    write_atomic(out / "README.md", readme.substitute(values))
    for name in ("example.py", "example.html", "silhouette.py"):
        write_atomic(out / name, (TEMPLATES / f"{name}.txt").read_text())
    return description


def drawn_inputs(network: PortableNetwork) -> dict[str, np.ndarray]:
    """Random images whose masks are ellipses; always the same ones."""
    rng, count = np.random.default_rng(0), 8
    height, width = network.config.data.image_size
    rows, columns = np.mgrid[:height, :width] / np.array([height, width]).reshape(2, 1, 1) - 0.5
    radii = rng.uniform(0.15, 0.4, (count, 2, 1, 1))
    masks = (rows / radii[:, 0]) ** 2 + (columns / radii[:, 1]) ** 2 < 1
    images = rng.integers(0, 256, (count, height, width, 3), dtype=np.uint8)
    return _inputs(network, images, masks)


def _recorded(
    network: PortableNetwork, path: str, split: str
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The inputs and the true clouds of the first samples of a split."""
    reader = RecordReader(path, split)
    samples = [reader[i] for i in range(min(CHECKED, len(reader)))]
    size = network.config.data.image_size
    images = np.stack([resample.resize_image(sample.image, size) for sample in samples])
    masks = np.stack([resample.resize_mask(sample.mask, size) for sample in samples])
    clouds = [s.points[np.linspace(0, len(s.points) - 1, 1024).astype(int)] for s in samples]
    return _inputs(network, images, masks), np.stack(clouds)


def _inputs(
    network: PortableNetwork, images: np.ndarray, masks: np.ndarray
) -> dict[str, np.ndarray]:
    inputs = {"image": images, "mask": masks}
    if size := network.config.model.random_size:
        noise = np.random.default_rng(0).normal(size=(len(images), 1, size))
        inputs["r"] = noise.astype(np.float32)
    return inputs


def check(
    stored: str, points: np.ndarray, expected: np.ndarray, truth: np.ndarray | None
) -> dict[str, Any]:
    """Compares the clouds [n, ..., m, 3] of a file with JAX's; raises `ExportError`.

    Returns:
      `images`: number of images; `largest_difference`: of a coordinate (unit); and, None without
      the true clouds, `cd`: mean `chamfer_sq_mean` of the file's clouds (unit^2), and `cd_change`:
      its change relative to JAX's clouds.
    """
    difference = float(np.abs(points - expected).max())
    if stored == "float32" and not difference <= LARGEST_DIFFERENCE:
        raise ExportError(
            f"the file's points differ from JAX's by {difference:.2g}, expected at most "
            f"{LARGEST_DIFFERENCE:g}"
        )
    row = {"images": len(points), "largest_difference": difference, "cd": None, "cd_change": None}
    if truth is None:
        return row
    mean_cd = jax.jit(lambda a, b: jax.lax.map(lambda p: chamfer_sq_mean(*p), (a, b)).mean())
    clouds = [array.reshape(len(array), -1, 3) for array in (points, expected)]
    cd, reference = (float(mean_cd(cloud, truth)) for cloud in clouds)
    change = cd / reference - 1
    if not abs(change) <= LARGEST_CD_CHANGE:
        raise ExportError(
            f"{stored} weights change the CD by {100 * change:.2f} %, expected at most "
            f"{100 * LARGEST_CD_CHANGE:g} %; leave {stored} out of weights"
        )
    return row | {"cd": cd, "cd_change": change}


def _describe(run: Trained, network: PortableNetwork) -> dict[str, Any]:
    """The content of `network.json`, without files."""
    model = network.config.model
    intrinsics, extrinsics = camera.default_camera(network.config.data.image_size)
    latents: list[Any] = []
    if model.random_size:
        latents = sampling.sample_latents(network.config, 0, 1, LATENTS, 0)[0].tolist()
    return {
        "format": FORMAT,
        "name": run.name,
        "step": run.step,
        "inputs": [item._asdict() | {"shape": list(item.shape)} for item in network.inputs],
        "num_points": network.num_points,
        "num_fc_points": len(networks.build(model).branches.fc),
        "image_size": list(network.config.data.image_size),
        "view_size": list(camera.VIEW_SIZE),
        "background": schema.BACKGROUND_GREY,
        **RULES,
        "camera": {"intrinsics": intrinsics.tolist(), "extrinsics": extrinsics.tolist()},
        "random_size": model.random_size,
        "latents": latents,
        "compared_points": compared_points(network.num_points).tolist() if latents else [],
        "sources": [dict(row) for row in run.sources],
        "files": {},
    }


def _check_arguments(weights: Sequence[str], data: str) -> None:
    if not weights or not set(weights) <= set(ONNX_NAMES):
        raise ConfigError(
            f"weights stored as {','.join(weights)}: accepted: any of {', '.join(ONNX_NAMES)}"
        )
    if "int8" in weights and not data:
        raise ConfigError(
            "data='': accepted with weights stored as int8: records, to measure the error on"
        )


def _summary(row: Mapping[str, Any]) -> str:
    text = f"largest difference {row['largest_difference']:.1e} on {row['images']} images"
    if row["cd"] is None:
        return text
    return f"{text}, CD {row['cd']:.5f} ({100 * row['cd_change']:+.3f} %)"


def _licences(sources: Sequence[Mapping[str, Any]]) -> str:
    def text(licence: str, row: Mapping[str, Any]) -> str:
        return f"{licence} ({', '.join(map(str, row.get('holders') or [])) or 'no names given'})"

    rows = [(row["source"], [text(*item) for item in row["licences"].items()]) for row in sources]
    return "\n".join(f"- {source}: {'; '.join(each)}" for source, each in rows) or "Not stated."
