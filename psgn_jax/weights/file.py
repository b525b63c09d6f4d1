"""The file format of weights: safetensors with configuration, metrics, data and licences.

A file contains the parameters of a network, as float16 or float32, named like the leaves of a
checkpoint (`params.<layer>.kernel`), and these metadata:

    format    "psgn_jax weights 1"
    config    the configuration of the training, like `config.json` but without local paths
    figures   JSON: step, samples_seen, parameters (their number), averaged, metrics (name ->
              number), data (name, source and number of samples of each training set)
    sources   JSON: data and licences, in the format of a data set's `sources.json`
    sha256    checksum of all texts above and of every array

The reader checks, in this order: the sizes of the file and of its header; the format and the
dtypes; the checksum; that all numbers are finite; the metadata; and that the configuration's
network has exactly these parameters, with the same shapes.
"""

import dataclasses
import json
import math
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import jax
import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from psgn_jax.config.experiment import Config, ConfigError, from_json, require_points_task, to_json
from psgn_jax.config.structured import Bounds, build
from psgn_jax.models import networks
from psgn_jax.models.cpu_convolution import convolutions_for
from psgn_jax.system.errors import UserError
from psgn_jax.system.files import write_atomic
from psgn_jax.system.untrusted import brief, parse_json, read_json, reason_of, size_of
from psgn_jax.weights.leaves import checksum, from_named_leaves, named_leaves
from psgn_jax.weights.run_folder import Trained

FORMAT = "psgn_jax weights 1"
SUFFIX = ".safetensors"
MAX_HEADER_BYTES = 1 << 20
MAX_FILE_BYTES = 1 << 30
DTYPES = {"float16": "F16", "float32": "F32"}  # dtype -> name in safetensors

_LIMITS = f"accepted: at most {MAX_FILE_BYTES}, of these {MAX_HEADER_BYTES} for the header"
_TEXTS = ("format", "config", "figures", "sources")

_Large = Annotated[int, Bounds(low=0, high=2**63 - 1)]


@dataclasses.dataclass(frozen=True)
class _DataSet:
    name: str = ""
    source: str = ""
    samples: _Large = 0


@dataclasses.dataclass(frozen=True)
class _Figures:
    step: _Large
    samples_seen: _Large
    parameters: _Large
    metrics: Mapping[str, float]
    data: tuple[_DataSet, ...]
    averaged: bool = False


@dataclasses.dataclass(frozen=True)
class _Licence:
    models: _Large = 0
    holders: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class _Source:
    source: str
    licences: Mapping[str, _Licence]


class WeightsError(UserError):
    """A file of weights cannot be read or written."""


def write_weights(path: str | os.PathLike[str], weights: Trained) -> None:
    """Writes a network with its figures and sources atomically, without local paths.

    Raises:
      ConfigError: the task is not "points".
      WeightsError: the suffix is wrong, the parameters do not fit the network, a parameter is not
        finite or too large for float16, or the file would exceed the limit.
    """
    require_points_task(weights.config, "a file of weights")
    path, dtype = pathlib.Path(path), weights.dtype
    named = named_leaves({"params": weights.params}).items()
    leaves = {name: np.asarray(leaf, np.float32) for name, leaf in named}
    _check_fits(weights.config, leaves, path)
    if path.suffix != SUFFIX:
        raise WeightsError(f"{path}: accepted: a name with the suffix {SUFFIX}")
    with np.errstate(over="ignore"):
        stored = {n: np.ascontiguousarray(leaf, dtype=dtype) for n, leaf in leaves.items()}
    _check_finite(path, leaves, "is not finite: the training diverged")
    _check_finite(path, stored, f"is too large for {dtype}; use float32")
    metadata = {
        "format": FORMAT,
        "config": to_json(_without_paths(weights.config)),
        "figures": json.dumps(dict(weights.figures), allow_nan=False),
        "sources": json.dumps(list(weights.sources), allow_nan=False),
    }
    metadata["sha256"] = _digest(metadata, stored)
    content = save(stored, metadata)
    if int.from_bytes(content[:8], "little") > MAX_HEADER_BYTES or len(content) > MAX_FILE_BYTES:
        raise WeightsError(f"{path}: {len(content)} bytes: {_LIMITS}")
    write_atomic(path, content)


def read_weights(path: str | os.PathLike[str]) -> Trained:
    """Reads a file of weights; `WeightsError` if it is missing, damaged or from another program."""
    path = pathlib.Path(path)
    metadata, leaves, dtype = _read_arrays(path)
    try:
        config = from_json(metadata["config"])
        require_points_task(config, "a file of weights")
        figures, sources = parse_json(metadata["figures"]), parse_json(metadata["sources"])
        build(_Figures, figures, "figures.")
        _check_sources(sources)
    except (KeyError, ValueError, TypeError) as error:
        raise WeightsError(f"{path}: error in its metadata: {brief(error)}") from None
    params = _check_fits(config, leaves, path)
    step, scores = figures["step"], dict(figures["metrics"])
    of_file = {"figures": figures, "dtype": dtype}
    return Trained(config, step, params, scores, path.stem, "weights", sources, **of_file)


def _read_arrays(path: pathlib.Path) -> tuple[dict[str, str], dict[str, np.ndarray], str]:
    """The texts of a file, its arrays as float32, and their stored dtype."""
    try:
        size = size_of(path)
        with path.open("rb") as start:
            header = int.from_bytes(start.read(8), "little")
        if size > MAX_FILE_BYTES or header > min(MAX_HEADER_BYTES, size):
            raise WeightsError(
                f"{path}: not a file of weights, or cut off: {size} bytes, header of {header}: "
                f"{_LIMITS}"
            )
        with safe_open(path, framework="np") as file:
            metadata = file.metadata() or {}
            if (found := str(metadata.get("format"))[:40]) != FORMAT:
                later = found.rpartition(" ")[0] == FORMAT.rpartition(" ")[0]
                maker = "a later version of psgn_jax" if later else "another program"
                raise WeightsError(f"{path}: a file of {maker}: {found!r}, expected {FORMAT!r}")
            names = sorted(file.keys())
            found = ", ".join(sorted({file.get_slice(name).get_dtype() for name in names}))
            if not (dtypes := [name for name, stored in DTYPES.items() if stored == found]):
                accepted = "accepted: all F16 or all F32"
                raise WeightsError(f"{path}: parameters of {found or 'nothing'}; {accepted}")
            stored = {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError, UnicodeDecodeError) as error:
        raise WeightsError(f"{path}: not readable as weights: {reason_of(error)}") from None
    if _digest(metadata, stored) != metadata.get("sha256"):
        raise WeightsError(f"{path}: damaged: the checksum does not match; download it again")
    leaves = {name: leaf.astype(np.float32) for name, leaf in stored.items()}
    _check_finite(path, leaves, "is not finite")
    return metadata, leaves, dtypes[0]


def read_sources(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """The data and licences in a JSON file; `ConfigError` if it lists none."""
    try:
        rows = read_json(path)
        if rows == []:
            raise ValueError("the list is empty")
        _check_sources(rows)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f'sources={path}: {reason_of(error)}; accepted: a list of {{"source": NAME, '
            '"licences": {LICENCE: {"models": N, "holders": [...]}}}, like sources.json of a '
            "training set"
        ) from None
    return list(rows)


def source_text(row: Mapping[str, Any]) -> str:
    """A row of `sources` as text: "chairs: CC-BY-3.0 (7 models: Ada, Bo), CC0-1.0"."""
    texts = []
    for name, each in row["licences"].items():
        holders = ", ".join(map(str, each.get("holders") or []))
        count = f"{each['models']} models" if "models" in each else ""
        details = ": ".join(part for part in (count, holders) if part)
        texts.append(f"{name} ({details})" if details else name)
    return f"{row['source']}: {', '.join(texts) or 'not stated'}"


def figures_of(
    run: Trained, data: Sequence[dict[str, Any]] = (), *, averaged: bool, samples_before: int = 0
) -> dict[str, Any]:
    """The metadata `figures` of a training (see the module)."""
    return {
        "step": run.step,
        "samples_seen": samples_before + run.step * run.config.train.batch_size,
        "parameters": sum(np.size(leaf) for leaf in jax.tree.leaves(run.params)),
        "averaged": averaged,
        "metrics": {name: value for name, value in run.scores.items() if math.isfinite(value)},
        "data": list(data),
    }


def _check_sources(rows: Any) -> None:
    if not isinstance(rows, list):
        raise TypeError(f"sources: {type(rows).__name__}, expected a list")
    for row in rows:
        build(_Source, {name: row[name] for name in ("source", "licences")}, "sources.")


def _check_finite(path: pathlib.Path, leaves: Mapping[str, np.ndarray], what: str) -> None:
    for name, leaf in leaves.items():
        if not np.isfinite(leaf).all():
            raise WeightsError(f"{path}: {name} {what}")


def _check_fits(config: Config, leaves: Mapping[str, np.ndarray], path: pathlib.Path) -> Any:
    """The parameters as a tree; `WeightsError` unless they fit the network exactly."""
    try:
        # Each takes a millisecond or more to trace, and has a kernel.
        if len(config.model.widths) + len(config.model.fc_widths) > len(leaves):
            raise ValueError(f"{len(leaves)} arrays, expected more")
        with convolutions_for("export"):  # the simplest to trace
            model = networks.build(config.model)
            shapes = jax.eval_shape(lambda: networks.init_params(config, model))
        return from_named_leaves({"params": shapes}, dict(leaves))["params"]
    except (ValueError, TypeError, ArithmeticError) as error:
        raise WeightsError(
            f"{path}: the parameters do not belong to the network of its configuration: "
            f"{brief(error)}"
        ) from None


def _without_paths(config: Config) -> Config:
    names = config.train.networks
    init = ",".join(pathlib.Path(name).name or "a run" for name in names)
    data = dataclasses.replace(config.data, path="", eval_path="")
    train = dataclasses.replace(config.train, init=init)
    return dataclasses.replace(config, data=data, train=train)


def _digest(metadata: Mapping[str, str], leaves: Mapping[str, np.ndarray]) -> str:
    texts = {key: metadata.get(key, "").encode() for key in _TEXTS}
    head = b"".join(f"{key} {len(text)}\n".encode() + text for key, text in texts.items())
    return checksum(leaves, head)
