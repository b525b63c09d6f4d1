"""Weights as one file: safetensors with configuration, figures, data and licences. Never pickle.

The only importer of safetensors. A file holds the parameters of one network under the names of a
checkpoint's leaves (`params.<layer>.kernel`), as float16 or float32, and this metadata, texts:

    format    "psgn_jax weights 1"
    config    the configuration of the training, as `config.json`; without paths of that machine
    figures   JSON: step, samples_seen, parameters, averaged, metrics (name -> number), data (what
              the training read: name, source and samples of each data set)
    sources   JSON: the data and their licences, rows as `sources.json` of a training set has them
    sha256    of all of the above and of every array

Reading checks all of it, in this order: sizes before anything of that size is read, names, dtypes
and shapes, the checksum, that every number is finite, and that the network of the configuration has
exactly these parameters.
"""

import dataclasses
import hashlib
import json
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
import optax
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from psgn_jax.config import (
    Config,
    ConfigError,
    UserError,
    from_json,
    require_points_task,
    to_json,
)
from psgn_jax.files import finite_or_none, write_atomic
from psgn_jax.models import point_out_net
from psgn_jax.training import state as state_lib
from psgn_jax.untrusted import kind_of, parse_json, read_json

FORMAT = "psgn_jax weights 1"
SUFFIX = ".safetensors"
MAX_HEADER_BYTES = 1 << 20
MAX_FILE_BYTES = 1 << 30
DTYPES = {"float16": "F16", "float32": "F32"}
"""Names of the dtypes that a file may have, and what safetensors calls them."""

_TEXTS = ("format", "config", "figures", "sources")


class WeightsError(UserError):
    """A file of weights that cannot be read or written."""


@dataclasses.dataclass(frozen=True, eq=False)
class Weights:
    """A network's parameters with what is to be known of them.

    Attributes:
      config: of the training.
      params: nested dict of float32 arrays.
      figures: `step`, `samples_seen`, `parameters`, `averaged`, `metrics`, `data`; see the module.
      sources: the data and their licences, a row for each source; () = not stated.
      dtype: as which the parameters are stored.
    """

    config: Config
    params: Any
    figures: Mapping[str, Any]
    sources: Sequence[Mapping[str, Any]] = ()
    dtype: str = "float16"


def write_weights(path: str | os.PathLike[str], weights: Weights) -> None:
    """Writes a file of weights, whole or not at all.

    Paths of the configuration (`data.path`, `data.eval_path`, `train.init`) are reduced to their
    last part or left out: the file is for other machines.

    Raises:
      ConfigError: the run's task is not "points", or the parameters are not those of its network.
      WeightsError: a parameter is not finite, or too large for float16.
    """
    path = pathlib.Path(path)
    require_points_task(weights.config, "a file of weights")
    if path.suffix != SUFFIX:
        raise WeightsError(f"{path}: accepted: a name that ends in {SUFFIX}")
    leaves = {
        name: np.ascontiguousarray(leaf, dtype=np.float32)
        for name, leaf in state_lib.named_leaves({"params": weights.params}).items()
    }
    _check_fits(weights.config, leaves, path)
    with np.errstate(over="ignore"):
        stored = {name: leaf.astype(weights.dtype) for name, leaf in leaves.items()}
    for name, leaf in stored.items():
        if not np.isfinite(leaves[name]).all():
            raise WeightsError(f"{path}: {name} is not finite: a damaged or diverged training")
        if not np.isfinite(leaf).all():
            raise WeightsError(f"{path}: {name} is too large for {weights.dtype}; use float32")
    metadata = {
        "format": FORMAT,
        "config": to_json(_without_paths(weights.config)),
        "figures": json.dumps(dict(weights.figures), allow_nan=False),
        "sources": json.dumps(list(weights.sources), allow_nan=False),
    }
    metadata["sha256"] = _digest(metadata, stored)
    content = save(stored, metadata)
    if int.from_bytes(content[:8], "little") > MAX_HEADER_BYTES or len(content) > MAX_FILE_BYTES:
        raise WeightsError(f"{path}: {len(content)} bytes, more than a file of weights may have")
    write_atomic(path, content)


def read_weights(path: str | os.PathLike[str]) -> Weights:
    """Reads and checks a file of weights.

    Raises:
      WeightsError: it is missing, damaged, foreign or does not fit its own configuration; one line.
    """
    path = pathlib.Path(path)
    _check_sizes(path)
    try:
        with safe_open(path, framework="np") as file:
            metadata = file.metadata() or {}
            if metadata.get("format") != FORMAT:
                raise WeightsError(
                    f"{path}: a file of another program or version (format "
                    f"{str(metadata.get('format'))[:40]!r}, expected {FORMAT!r})"
                )
            names = sorted(file.keys())
            dtype = _common_dtype(path, {name: file.get_slice(name).get_dtype() for name in names})
            stored = {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError, UnicodeDecodeError) as error:
        raise WeightsError(f"{path}: no intact file of weights: {_one_line(error)}") from None
    if _digest(metadata, stored) != metadata.get("sha256"):
        raise WeightsError(f"{path}: damaged: the checksum does not match; fetch it again")
    leaves = {name: leaf.astype(np.float32) for name, leaf in stored.items()}
    for name, leaf in leaves.items():
        if not np.isfinite(leaf).all():
            raise WeightsError(f"{path}: {name} is not finite")
    try:
        config = from_json(metadata["config"])
        require_points_task(config, "a file of weights")
        figures, sources = parse_json(metadata["figures"]), parse_json(metadata["sources"])
    except (KeyError, ValueError) as error:
        raise WeightsError(f"{path}: its metadata: {_one_line(error)}") from None
    if not _are_figures(figures) or not _are_rows(sources):
        raise WeightsError(f"{path}: its metadata: figures or sources are not as expected")
    params = _check_fits(config, leaves, path)
    return Weights(config, params, figures, sources, dtype)


def read_sources(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """Rows on data and licences: a JSON list of objects with `source` and `licences`.

    Raises:
      ConfigError: it is something else.
    """
    try:
        rows = read_json(path)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--sources={path}: {_one_line(error)}") from None
    if not rows or not _are_rows(rows):
        raise ConfigError(
            f'--sources={path}: accepted: a list of {{"source": NAME, "licences": {{LICENCE: '
            '{"models": N, "holders": [...]}}}, as sources.json of a training set'
        )
    return list(rows)


def figures_of(
    config: Config,
    params: Any,
    *,
    step: int,
    averaged: bool,
    metrics: Mapping[str, float],
    data: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """The figures of a training that a file of weights holds."""
    return {
        "step": step,
        "samples_seen": step * config.train.batch_size,
        "parameters": sum(np.size(leaf) for leaf in jax.tree.leaves(params)),
        "averaged": averaged,
        "metrics": finite_or_none(metrics),
        "data": [dict(row) for row in data],
    }


def _check_sizes(path: pathlib.Path) -> None:
    """Of the file and of its header, before more than eight bytes are read."""
    try:
        kind = kind_of(path)
        if kind is not None:  # opening a pipe would wait for its other end
            raise WeightsError(f"{path}: it is {kind}, expected a file")
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            header = int.from_bytes(file.read(8), "little")
    except OSError as error:
        raise WeightsError(f"{path}: {error.strerror or error}") from None
    if size > MAX_FILE_BYTES:
        raise WeightsError(f"{path}: {size} bytes, more than any file of weights has")
    if size < 8 or header > min(MAX_HEADER_BYTES, size - 8):
        raise WeightsError(
            f"{path}: no file of weights, or a truncated one: {size} bytes, of which the header "
            f"claims {header} (at most {MAX_HEADER_BYTES})"
        )


def _common_dtype(path: pathlib.Path, dtypes: Mapping[str, str]) -> str:
    for name, dtype in DTYPES.items():
        if dtypes and set(dtypes.values()) == {dtype}:
            return name
    raise WeightsError(
        f"{path}: parameters of {', '.join(sorted(set(dtypes.values()))) or 'nothing'}; accepted: "
        "all F16 or all F32"
    )


def _check_fits(config: Config, leaves: Mapping[str, np.ndarray], path: pathlib.Path) -> Any:
    """The parameters as a tree, if they are those of the configuration's network."""
    try:
        shapes = jax.eval_shape(
            lambda: (
                state_lib.create(config, point_out_net.build(config.model), optax.identity()).params
            )
        )
        return state_lib.from_named_leaves({"params": shapes}, dict(leaves))["params"]
    except (ValueError, TypeError, ArithmeticError) as error:
        raise WeightsError(
            f"{path}: the parameters are not those of the network of its configuration: "
            f"{_one_line(error)}"
        ) from None


def _without_paths(config: Config) -> Config:
    init = config.train.init and (pathlib.Path(config.train.init).name or "a run")
    return dataclasses.replace(
        config,
        data=dataclasses.replace(config.data, path="", eval_path="", default_folder=""),
        train=dataclasses.replace(config.train, init=init),
    )


def _digest(metadata: Mapping[str, str], leaves: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for key in _TEXTS:
        text = metadata.get(key, "").encode()
        digest.update(f"{key} {len(text)}\n".encode() + text)
    for name, leaf in sorted(leaves.items()):
        digest.update(f"{name} {leaf.dtype} {leaf.shape}\n".encode())
        digest.update(np.ascontiguousarray(leaf).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def _are_figures(figures: Any) -> bool:
    if not isinstance(figures, dict):
        return False
    metrics, data = figures.get("metrics"), figures.get("data")
    return (
        all(isinstance(figures.get(k), int) for k in ("step", "samples_seen", "parameters"))
        and isinstance(metrics, dict)
        and all(x is None or isinstance(x, int | float) for x in metrics.values())
        and isinstance(data, list)
        and all(isinstance(row, dict) for row in data)
    )


def _are_rows(rows: Any) -> bool:
    return isinstance(rows, list) and all(
        isinstance(row, dict)
        and isinstance(row.get("source"), str)
        and isinstance(row.get("licences"), dict)
        and all(isinstance(each, dict) for each in row["licences"].values())
        for row in rows
    )


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200]
