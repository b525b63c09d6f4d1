"""Weights as text: what they are, how good, trained on what and under which licences."""

import pathlib
from collections.abc import Mapping
from typing import Any

from psgn_jax.models.point_layout import branch_of_point
from psgn_jax.untrusted import one_line
from psgn_jax.weights.file import Weights

FIGURES = ("cd_sq_radius2", "cd_l1_radius", "emd_radius", "fscore")
"""Metrics that are shown, those that were measured."""


def describe(weights: Weights, path: pathlib.Path, *, is_default: bool = False) -> str:
    """A few lines on a file of weights."""
    config, figures = weights.config, weights.figures
    branches = branch_of_point(config.model)
    height, width = config.data.image_size
    metrics = figures["metrics"]
    shown = [f"{name} {metrics[name]:.5f}" for name in FIGURES if metrics.get(name) is not None]
    rows = {
        "network": f"{config.model.name}, {figures['parameters'] / 1e6:.2f} M parameters, "
        f"{weights.dtype}, {path.stat().st_size / 1e6:.1f} MB; {'+'.join(config.data.inputs)} of "
        f"{height}x{width} pixels to {len(branches.fc) + len(branches.deconv)} points",
        "training": f"step {figures['step']}, {figures['samples_seen']} samples seen"
        + (", averaged parameters" if figures.get("averaged") else ""),
        "figures": ", ".join(shown) or "none were measured",
        "data": ", ".join(map(_data, figures["data"])) or "not stated",
        "licences": "; ".join(map(_licences, weights.sources)) or "not stated",
    }
    title = path.stem + (" (default)" if is_default else "")
    lines = [title, *(f"  {name:9} {text}" for name, text in rows.items())]
    return "".join(f"{one_line(line)}\n" for line in lines)


def _data(row: Mapping[str, Any]) -> str:
    samples = f" ({row['samples']} samples)" if "samples" in row else ""
    return f"{row.get('name', '?')}{samples}"


def _licences(row: Mapping[str, Any]) -> str:
    texts = []
    for name, each in row["licences"].items():
        holders = ", ".join(map(str, each.get("holders") or []))
        count = f"{each['models']} models" if "models" in each else ""
        details = ": ".join(part for part in (count, holders) if part)
        texts.append(f"{name} ({details})" if details else name)
    return f"{row['source']}: {', '.join(texts) or 'not stated'}"
