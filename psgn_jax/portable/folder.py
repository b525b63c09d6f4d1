"""Writes the folder of `psgn export`: exported files, compared with JAX, and their description."""

import dataclasses
import hashlib
import json
import os
import pathlib
import string
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
from absl import logging

from psgn_jax.config import ConfigError, UserError
from psgn_jax.data import camera, framing, schema
from psgn_jax.files import write_atomic
from psgn_jax.models import point_layout
from psgn_jax.portable import check as check_lib
from psgn_jax.portable import runtime
from psgn_jax.portable.network import PortableNetwork
from psgn_jax.prediction import sampling
from psgn_jax.training.run_folder import Run

FORMAT = "psgn_jax network 1"
LATENTS = 16
"""Number of random inputs in `network.json`: the first ones that `psgn predict --seed=0` uses."""

ONNX_NAMES = {
    "float32": "network.onnx",
    "float16": "network_float16.onnx",
    "int8": "network_int8.onnx",
}
STABLEHLO_NAME = "network.stablehlo"
TEMPLATES = pathlib.Path(__file__).resolve().parent / "templates"
JAVASCRIPT = ("framing.js", "resample.js")
"""JavaScript modules in `TEMPLATES` that frame and resample photos like the Python code."""

RULE = {
    "box_width": framing.BOX_WIDTH,
    "box_height": framing.BOX_HEIGHT,
    "box_power": framing.BOX_POWER,
    "middle_column": framing.MIDDLE_COLUMN,
    "middle_row": framing.MIDDLE_ROW,
    "middle_row_per_width": framing.MIDDLE_ROW_PER_WIDTH,
    "smallest_box": framing.SMALLEST_BOX,
}
"""Constants of the framing rule (`data.framing`), for programs in other languages."""


class ExportError(UserError):
    """A network cannot be exported, or an exported file gives wrong results."""


def write_folder(run: Run, out: str | os.PathLike[str], **options: Any) -> dict[str, Any]:
    """Calls `write_network`, adds a README and examples; returns the content of `network.json`."""
    write_network(run, out, **options)
    description: dict[str, Any] = json.loads((pathlib.Path(out) / "network.json").read_text())
    _write_texts(pathlib.Path(out), description)
    return description


def write_network(
    run: Run,
    out: str | os.PathLike[str],
    *,
    weights: Sequence[str] = ("float32", "float16"),
    stablehlo: bool = True,
    data: str = "",
    split: str = "validation",
    images: int = 64,
) -> list[str]:
    """Writes a network as ONNX and StableHLO files, `network.json`, and `JAVASCRIPT`.

    Every file is run and compared with JAX before it is written.

    Args:
      run: the network.
      out: folder, created if missing.
      weights: the types in which weights are stored, any of `ONNX_NAMES`; each gives one ONNX file.
        "int8" needs `data`.
      stablehlo: whether to write the StableHLO program.
      data: folder of records for the check; "" = random images, which have no ground truth.
      split: split of the records.
      images: number of images of the records for the check.

    Returns:
      names of the files.

    Raises:
      ConfigError: packages are missing, or an argument is wrong.
      ExportError: an operation cannot be converted to ONNX, or a file's clouds differ too much from
        JAX's.
    """
    runtime.require_packages()
    _check_arguments(weights, data, images)
    network = PortableNetwork.from_run(run)
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(run.params)):
        raise ExportError("a parameter is not finite: a damaged or diverged training")
    samples = (
        check_lib.recorded_samples(network, data, split, images)
        if data
        else check_lib.drawn_samples(network)
    )
    clouds = check_lib.expected(network, samples)
    description = describe(run, network)
    files: dict[str, dict[str, Any]] = {}
    for stored in weights:
        content = onnx_content(network, stored, {"name": run.source, "format": FORMAT})
        result = check_lib.measure(runtime.Session(content), samples, clouds)
        _require_agreement(stored, result)
        _write(pathlib.Path(out) / ONNX_NAMES[stored], content, files, result, weights=stored)
    if stablehlo:
        content = network.stablehlo()
        program = jax.export.deserialize(bytearray(content))
        result = check_lib.measure(
            lambda arrays: np.asarray(program.call(*arrays.values())), samples, clouds
        )
        _require_agreement("float32", result)
        _write(pathlib.Path(out) / STABLEHLO_NAME, content, files, result, weights="float32")
    description["files"] = files
    write_atomic(pathlib.Path(out) / "network.json", json.dumps(description, indent=1) + "\n")
    for name in JAVASCRIPT:
        write_atomic(pathlib.Path(out) / name, (TEMPLATES / name).read_text())
    return [*files, "network.json", *JAVASCRIPT]


def onnx_content(network: PortableNetwork, stored: str, texts: Mapping[str, str]) -> bytes:
    """Calls `onnx_file.to_onnx` and raises its errors as `ExportError`."""
    from psgn_jax.portable import graph, onnx_file  # imports onnx

    try:
        return onnx_file.to_onnx(network, stored, texts)
    except graph.UnsupportedError as error:
        raise ExportError(str(error)) from None


def describe(run: Run, network: PortableNetwork) -> dict[str, Any]:
    """The content of `network.json` except the list of files.

    It contains everything that a program needs to call the network.
    """
    model = network.config.model
    intrinsics, extrinsics = camera.default_camera(framing.VIEW_SIZE)
    latents = (
        np.asarray(sampling.sample_latents(network.config, 0, 1, LATENTS, 0))[0].tolist()
        if model.random_size
        else []
    )
    return {
        "format": FORMAT,
        "name": pathlib.Path(run.source).name if run.source else "",
        "step": run.step,
        "inputs": [
            {"name": item.name, "dtype": item.dtype, "shape": list(item.shape)}
            for item in network.inputs
        ],
        "num_points": network.num_points,
        "num_fc_points": len(point_layout.branch_of_point(model).fc),
        "image_size": list(network.config.data.image_size),
        "view_size": list(framing.VIEW_SIZE),
        "background": schema.BACKGROUND_GREY,
        "framing": dict(RULE),
        "camera": {"intrinsics": intrinsics.tolist(), "extrinsics": extrinsics.tolist()},
        "random_size": model.random_size,
        "latents": latents,
        "sources": [dict(row) for row in run.sources],
    }


def _check_arguments(weights: Sequence[str], data: str, images: int) -> None:
    if not weights or not set(weights) <= set(ONNX_NAMES):
        raise ConfigError(
            f"--weights_as={','.join(weights)}: accepted: any of {', '.join(ONNX_NAMES)}"
        )
    if "int8" in weights and not data:
        raise ConfigError(
            "--weights_as=int8: accepted only with --data=RECORDS, because its error must be "
            "measured on records"
        )
    if images < 1:
        raise ConfigError(f"--images={images}: accepted: 1 or more")


def _require_agreement(stored: str, result: check_lib.Check) -> None:
    if stored == "float32" and not result.largest_difference <= check_lib.LARGEST_DIFFERENCE:
        raise ExportError(
            f"the file's points differ from JAX's by {result.largest_difference:.2g}, expected at "
            f"most {check_lib.LARGEST_DIFFERENCE:g}"
        )
    change = result.cd_change
    if change is not None and not abs(change) <= check_lib.LARGEST_CD_CHANGE:
        raise ExportError(
            f"{stored} weights change the CD by {100 * change:.2f} %, expected at most "
            f"{100 * check_lib.LARGEST_CD_CHANGE:g} %; leave {stored} out of --weights_as"
        )


def _write(
    path: pathlib.Path,
    content: bytes,
    files: dict[str, dict[str, Any]],
    result: check_lib.Check,
    **details: str,
) -> None:
    write_atomic(path, content)
    digest = hashlib.sha256(content).hexdigest()
    checked = dataclasses.asdict(result)
    files[path.name] = {**details, "bytes": len(content), "sha256": digest, "check": checked}
    logging.info("%s: %.1f MB, %s", path.name, len(content) / 1e6, summary(result))


def summary(result: check_lib.Check) -> str:
    """Describes a check as text."""
    text = f"largest difference {result.largest_difference:.1e} on {result.images} images"
    if result.cd is None or result.cd_change is None:
        return text
    return f"{text}, CD {result.cd:.5f} ({100 * result.cd_change:+.3f} %)"


def _write_texts(out: pathlib.Path, description: Mapping[str, Any]) -> None:
    height, width = description["image_size"]
    values = {
        "name": description["name"] or "network",
        "height": height,
        "width": width,
        "points": description["num_points"],
        "r_row": f"| `r` | float32 [batch, draws, {description['random_size']}] | "
        "independent numbers of N(0, 1): each row gives one cloud |\n"
        if description["random_size"]
        else "",
        "points_shape": "[batch, draws, n, 3]" if description["random_size"] else "[batch, n, 3]",
        "r_python": "\n    feeds['r'] = np.float32([description['latents'][:1]])"
        if description["random_size"]
        else "",
        "r_javascript": "\n  feeds.r = new ort.Tensor('float32', "
        "Float32Array.from(about.latents[0]), [1, 1, about.random_size]);"
        if description["random_size"]
        else "",
        "onnx": next(name for name in description["files"] if name.endswith(".onnx")),
        "files": "".join(
            f"| `{name}` | {row['bytes'] / 1e6:.1f} MB | {_check_text(row['check'])} |\n"
            for name, row in description["files"].items()
        ),
        "licences": _licences(description["sources"]),
    }
    for source in sorted(TEMPLATES.glob("*.txt")):
        text = string.Template(source.read_text()).substitute(values)
        write_atomic(out / source.stem, text)


def _check_text(row: Mapping[str, Any]) -> str:
    return summary(check_lib.Check(**row))


def _licences(sources: Sequence[Mapping[str, Any]]) -> str:
    lines = [
        f"- {row['source']}: "
        + "; ".join(
            f"{licence} ({', '.join(map(str, each.get('holders') or [])) or 'no names given'})"
            for licence, each in row["licences"].items()
        )
        for row in sources
    ]
    return "\n".join(lines) or "Not stated."
