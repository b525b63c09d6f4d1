"""The data, sources and licences behind a network and the networks from which it started."""

import contextlib
import pathlib
from collections.abc import Iterator, Sequence
from typing import Any

from psgn_jax.config.experiment import Config
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.system.errors import UserError
from psgn_jax.weights.file import Weights, read_weights
from psgn_jax.weights.opening import weights_path
from psgn_jax.weights.run_folder import load_config


def data_of(config: Config) -> list[dict[str, Any]]:
    """The data sets of a training and of the networks from which it started.

    A row has the name and, if the manifest can be read, the source and the number of training
    samples. Folders with the same name are listed with the names of their parents.
    """
    return _once([*_own_data(config), *_inherited_data(config)])


def sources_of(config: Config, stated: Sequence[dict[str, Any]] = ()) -> list[dict[str, Any]]:
    """The sources and licences of `data_of`, as in `weights.file.Weights`.

    `stated` are the rows for the training's data; without them, licences are "not stated". The
    result is empty if nothing is known.
    """
    inherited: list[dict[str, Any]] = []
    for name, origin in _origins(config):
        rows = sources_of(origin) if isinstance(origin, Config) else getattr(origin, "sources", ())
        inherited += rows or [_not_stated(f"the data of {pathlib.Path(name).name}")]
    known = {row["name"] for row in _inherited_data(config)}
    new = [row["name"] for row in _own_data(config) if row["name"] not in known]
    rows = list(stated) or [_not_stated(name) for name in new if inherited]
    return [*rows, *(row for row in _once(inherited) if row not in rows)]


def _own_data(config: Config) -> list[dict[str, Any]]:
    if not config.data.path:
        return [{"name": "default data set"}]
    folders = [pathlib.Path(folder) for folder in dict.fromkeys(config.data.folders)]
    names = [folder.name for folder in folders]
    rows: list[dict[str, Any]] = []
    for folder in folders:
        alone = names.count(folder.name) == 1
        rows.append({"name": folder.name if alone else f"{folder.parent.name}/{folder.name}"})
        with contextlib.suppress(RecordError, OSError):
            manifest = load_manifest(folder)
            shards = manifest.splits().get(config.data.train_split, ())
            rows[-1] |= {"source": manifest.source, "samples": sum(shard.count for shard in shards)}
    return rows


def _inherited_data(config: Config) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for _, origin in _origins(config):
        if isinstance(origin, Config):
            rows += data_of(origin)
        elif origin is not None:
            rows += origin.figures["data"]
    return rows


def _origins(config: Config) -> Iterator[tuple[str, Config | Weights | None]]:
    """The networks from which a training started: name, and content or None if it is missing."""
    for init in filter(None, map(str.strip, config.train.init.split(","))):
        origin: Config | Weights | None = None
        with contextlib.suppress(UserError, OSError):
            is_run = pathlib.Path(init).is_dir()
            origin = load_config(init) if is_run else read_weights(weights_path(init))
        yield init, origin


def _not_stated(source: str) -> dict[str, Any]:
    return {"source": source, "licences": {}}


def _once(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [row for i, row in enumerate(rows) if row not in rows[:i]]
