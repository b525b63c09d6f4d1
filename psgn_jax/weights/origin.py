"""The data, sources and licences behind a network and the networks from which it started."""

import contextlib
import pathlib
from collections.abc import Sequence
from typing import Any

from psgn_jax.config.experiment import Config
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.system.errors import UserError
from psgn_jax.weights.file import read_weights
from psgn_jax.weights.opening import weights_path
from psgn_jax.weights.run_folder import load_config

Rows = Sequence[dict[str, Any]]


def data_of(config: Config) -> Rows:
    """The data sets of a training and of the networks from which it started.

    A row has the name and, if the manifest can be read, the source and the number of training
    samples. Folders with the same name are listed with the names of their parents.
    """
    return _once([*_own_data(config), *(row for _, data, _ in _origins(config) for row in data)])


def sources_of(config: Config, stated: Rows = ()) -> Rows:
    """The sources and licences of `data_of`, as in `weights.file`.

    `stated` are the rows for the training's data; without them, licences are "not stated". The
    result is empty if nothing is known.
    """
    inherited: list[dict[str, Any]] = []
    known = set()
    for name, data, sources in _origins(config):
        inherited += sources or [_not_stated(f"the data of {pathlib.Path(name).name}")]
        known |= {row["name"] for row in data}
    new = [row["name"] for row in _own_data(config) if row["name"] not in known]
    rows = list(stated) or [_not_stated(name) for name in new if inherited]
    return [*rows, *(row for row in _once(inherited) if row not in rows)]


def _own_data(config: Config) -> Rows:
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


def _origins(config: Config) -> list[tuple[str, Rows, Rows]]:
    """The networks from which a training started: name, data and sources, if they are known."""
    found: list[tuple[str, Rows, Rows]] = []
    for init in filter(None, map(str.strip, config.train.init.split(","))):
        data: Rows = ()
        sources: Rows = ()
        with contextlib.suppress(UserError, OSError):
            path = weights_path(init)
            if path.is_dir():
                started = load_config(path)
                data, sources = data_of(started), sources_of(started)
            else:
                read = read_weights(path)
                data, sources = read.figures["data"], read.sources
        found.append((init, data, sources))
    return found


def _not_stated(source: str) -> dict[str, Any]:
    return {"source": source, "licences": {}}


def _once(rows: Rows) -> Rows:
    return [row for i, row in enumerate(rows) if row not in rows[:i]]
