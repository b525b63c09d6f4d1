"""Writes the folder of `psgn export`: exported files, checked against JAX, and a description."""

import hashlib
import json
import os
import pathlib
import string
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from absl import logging

from psgn_jax.config.experiment import ConfigError
from psgn_jax.data import camera, framing, schema
from psgn_jax.models import networks
from psgn_jax.portable.network import ExportError, PortableNetwork
from psgn_jax.prediction import draws, silhouette
from psgn_jax.system.files import write_atomic
from psgn_jax.system.onnx_runtime import session
from psgn_jax.weights.file import source_text
from psgn_jax.weights.run_folder import Trained

FORMAT = "psgn_jax network 2"
LATENTS = 16
"""Number of random inputs in `network.json` besides r = 0: the first of `psgn predict --seed=0`."""

ONNX_NAMES = {"float32": "network.onnx", "float16": "network_float16.onnx"}
"""Stored type of the weights -> file."""

LARGEST_DIFFERENCE = {"float32": 1e-4, "float16": 1e-2}
"""Stored type of the weights -> largest accepted difference of a coordinate from JAX's (unit)."""

TEMPLATES = pathlib.Path(__file__).resolve().parent / "templates"
JAVASCRIPT = ("draws.js", "framing.js", "resample.js", "silhouette.js")
"""Modules in `TEMPLATES` that frame photos, and choose and fit draws, like the Python code."""


def _constants(module: Any, names: str) -> dict[str, Any]:
    """Name in lower case -> constant of a module, for programs in other languages."""
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


def write_network(
    run: Trained, out: str | os.PathLike[str], weights: Sequence[str] = ("float32", "float16")
) -> dict[str, Any]:
    """Writes a network as ONNX files, `network.json`, and `JAVASCRIPT`.

    Before we write a file, we compare its clouds with JAX's on random images.

    Args:
      weights: any of `ONNX_NAMES`, an ONNX file each.

    Returns:
      The content of `network.json`.

    Raises:
      ConfigError: an argument is wrong.
      ExportError: a parameter is not finite, an operation cannot be converted to ONNX, or a file's
        clouds differ too much from JAX's.
    """
    if not weights or not set(weights) <= set(ONNX_NAMES):
        raise ConfigError(
            f"weights stored as {','.join(weights)}: accepted: any of {', '.join(ONNX_NAMES)}"
        )
    network = PortableNetwork(run)
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(run.params)):
        raise ExportError("a parameter is not finite: a damaged or diverged training")
    from psgn_jax.portable import onnx_file  # imports onnx

    inputs = drawn_inputs(network)
    expected = np.asarray(jax.jit(network.__call__)(*inputs.values()))
    description = _describe(run, network)
    out = pathlib.Path(out)

    for stored in weights:
        name, texts = ONNX_NAMES[stored], {"name": description["name"], "format": FORMAT}
        content = onnx_file.to_onnx(network, network.inputs, "points", stored, texts)
        difference = float(np.abs(session(content)(inputs) - expected).max())
        if not difference <= LARGEST_DIFFERENCE[stored]:
            raise ExportError(
                f"the {stored} file's points differ from JAX's by {difference:.2g}, expected at "
                f"most {LARGEST_DIFFERENCE[stored]:g}"
            )
        write_atomic(out / name, content)
        description["files"][name] = {
            "weights": stored, "bytes": len(content),
            "sha256": hashlib.sha256(content).hexdigest(), "largest_difference": difference,
        }  # fmt: skip
        text = "%s: %.1f MB, largest difference from JAX %.1e"
        logging.info(text, name, len(content) / 1e6, difference)

    write_atomic(out / "network.json", json.dumps(description, indent=1) + "\n")
    for name in JAVASCRIPT:
        write_atomic(out / name, (TEMPLATES / name).read_text())
    return description


def write_folder(run: Trained, out: str | os.PathLike[str], **options: Any) -> dict[str, Any]:
    """Calls `write_network` and adds a README and examples; returns `write_network`'s result."""
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
            f"| `{name}` | {row['bytes'] / 1e6:.1f} MB | {row['largest_difference']:.1e} |\n"
            for name, row in description["files"].items()
        ),
        "licences": "\n".join(f"- {source_text(row)}" for row in description["sources"])
        or "Not stated.",
    }
    out = pathlib.Path(out)
    readme = string.Template((TEMPLATES / "README.md.txt").read_text())
    write_atomic(out / "README.md", readme.substitute(values))
    for name in ("example.py", "example.html"):
        write_atomic(out / name, (TEMPLATES / f"{name}.txt").read_text())
    return description


def drawn_inputs(network: PortableNetwork) -> dict[str, np.ndarray]:
    """Random images with elliptical masks, the same in every call."""
    rng, count = np.random.default_rng(0), 8
    height, width = network.config.data.image_size
    rows, columns = np.mgrid[:height, :width] / np.array([height, width]).reshape(2, 1, 1) - 0.5
    radii = rng.uniform(0.15, 0.4, (count, 2, 1, 1))
    masks = (rows / radii[:, 0]) ** 2 + (columns / radii[:, 1]) ** 2 < 1
    images = rng.integers(0, 256, (count, height, width, 3), dtype=np.uint8)
    inputs = {"image": images, "mask": masks}
    if size := network.config.model.random_size:
        inputs["r"] = rng.normal(size=(count, 1, size)).astype(np.float32)
    return inputs


def _describe(run: Trained, network: PortableNetwork) -> dict[str, Any]:
    """The content of `network.json`, without files."""
    model = network.config.model
    intrinsics, extrinsics = camera.default_camera(network.config.data.image_size)
    latents: list[Any] = []
    if model.random_size:
        latents = draws.image_latents(network.config, LATENTS, seed=0).tolist()
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
        "compared_points": draws.compared_points(network.num_points).tolist() if latents else [],
        "sources": [dict(row) for row in run.sources],
        "files": {},
    }
