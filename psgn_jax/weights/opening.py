"""Opens a trained network: the folder of a run, a file of weights, or a name.

Names are those of the files in `psgn_jax/weights/`. With `train.init`, a training starts from a
trained network, whose data and licences it inherits (`origins_of`).
"""

import contextlib
import fnmatch
import os
import pathlib
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from absl import logging

from psgn_jax.config.experiment import Config, ConfigError
from psgn_jax.config.structured import suggestion
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.system.errors import UserError
from psgn_jax.weights.file import SUFFIX, read_weights
from psgn_jax.weights.leaves import named_leaves
from psgn_jax.weights.run_folder import Trained, load_config, open_run

Rows = Sequence[dict[str, Any]]
"""Data sets, or sources with their licences, as in the metadata of `weights.file`."""

FOLDER = pathlib.Path(__file__).resolve().parent  # folder of the package's weights

DEFAULT = "free-2"  # name of the default weights


def shipped() -> dict[str, pathlib.Path]:
    """Name -> file of the package's weights."""
    return {path.stem: path for path in sorted(FOLDER.glob(f"*{SUFFIX}"))}


def weights_path(source: str | os.PathLike[str] = "", argument: str = "weights") -> pathlib.Path:
    """The folder of a run or the file of weights, from its path or name; "" = `DEFAULT`.

    `ConfigError` if there is neither; `argument` is its name in the message.
    """
    known, name = shipped(), str(source) or DEFAULT
    path = pathlib.Path(os.path.expanduser(name))
    if name in known and not (path.is_file() or (path / "config.json").exists()):
        return known[name]
    if not os.path.exists(path):
        raise ConfigError(
            f"{argument}={name!r}: does not exist; {suggestion(name, known)}accepted: the folder "
            f"of a run, a file of weights, or one of {', '.join(known)}"
        )
    return path


def open_weights(
    source: str | os.PathLike[str] = "", checkpoint: str = "best", *, argument: str = "weights"
) -> Trained:
    """Opens a trained network from the folder of a run, a file of weights, or a name.

    Args:
      source: see `weights_path`. Weights have the metrics in their file as `scores`.
      checkpoint: "best" or "last" checkpoint of a run; "best" for weights.

    Raises:
      ConfigError: there is no such network, or `checkpoint` does not fit.
      CheckpointError, WeightsError: the network cannot be read.
    """
    path = weights_path(source, argument)
    if path.is_dir():
        return open_run(path, checkpoint, name=argument)
    if checkpoint != "best":
        raise ConfigError(f"checkpoint={checkpoint}: accepted only for a run")
    return read_weights(path)


def open_initial(config: Config) -> Trained:
    """Opens the network in `train.init`, as `open_weights` does.

    Of several networks, separated by commas, we take the mean of the parameters. It is often better
    than each network if they were trained from the same parameters with different seeds (Wortsman
    et al., "Model soups", ICML 2022). `ConfigError` if the task or the layers differ.
    """
    names = check_initial(config)
    runs = [open_weights(name, argument="train.init") for name in names]
    shapes = [jax.tree.map(np.shape, run.params) for run in runs]
    for name, run, shape in zip(names, runs, shapes, strict=True):
        if (task := run.config.task) != config.task:
            raise ConfigError(
                f"train.init={name!r} has the task {task!r}; accepted: {config.task!r}"
            )
        if shape != shapes[0]:
            raise ConfigError(
                f"train.init={config.train.init!r}: {name!r} has other layers than {names[0]!r}; "
                "expected networks with the same layers"
            )
    if len(names) == 1:
        return runs[0]

    def mean(*leaves: Any) -> np.ndarray:
        total = np.sum([np.asarray(leaf, np.float32) for leaf in leaves], axis=0)
        return (total / np.float32(len(leaves))).astype(leaves[0].dtype)

    params = jax.tree.map(mean, *(run.params for run in runs))
    source = "the mean of " + ", ".join(run.source for run in runs)
    return runs[0]._replace(params=params, source=source)


def check_initial(config: Config) -> list[str]:
    """The networks in `train.init`; `ConfigError` if one does not exist."""
    names = config.train.networks
    for name in names:
        if not name:
            raise ConfigError(
                f"train.init={config.train.init!r}: empty name; accepted: names between commas"
            )
        weights_path(name, "train.init")
    return names


def initial_params(config: Config, drawn: Any, trained: Any) -> Any:
    """The trained parameters, but for the layers in `train.init_skip` the random ones in `drawn`.

    If only the new network has a random input, the layers of this input start with a tenth of their
    random parameters (**ours**). With the full parameters, the first clouds would be noise, with an
    EMD of .83 instead of .13. `ConfigError` if layers differ and are not skipped (the message lists
    them), or if a pattern matches no layer.
    """
    wanted, have = named_leaves(drawn), named_leaves(trained)
    names = sorted(wanted.keys() | have.keys())
    layer_of = {name: name.rpartition(".")[0] for name in names}
    layers = sorted(set(layer_of.values()))
    added = {x for x in layers if x.endswith("random") and f"{x}.kernel" not in have}
    skipped = set(added)
    for pattern in config.train.init_skip:
        if not (matched := fnmatch.filter(layers, pattern)):
            known = ", ".join(layers)
            raise ConfigError(f"train.init_skip: {pattern!r} matches no layer; layers: {known}")
        skipped |= set(matched)
    misfits: dict[str, str] = {}
    for name in names:
        new, old = (str(list(x[name].shape)) if name in x else "missing" for x in (wanted, have))
        if new != old and layer_of[name] not in skipped:
            misfits.setdefault(layer_of[name], f"{name} is {old} there and {new} here")
    if misfits:
        flag = "".join(f"'{layer}'," for layer in misfits)
        raise ConfigError(
            f"train.init={config.train.init!r}: {len(misfits)} layers differ: "
            f"{'; '.join(misfits.values())}; to keep their random parameters: "
            f'train.init_skip="({flag})"'
        )
    if left := sorted(skipped.intersection(map(layer_of.__getitem__, wanted))):
        logging.info("random parameters, not from %s: %s", config.train.init, ", ".join(left))
    taken = {name: np.array(have[name]) for name in wanted if layer_of[name] not in skipped}
    drawn_leaves = {n: 0.1 * x if layer_of[n] in added else x for n, x in wanted.items()}
    leaves = [taken.get(name, leaf) for name, leaf in drawn_leaves.items()]
    return jax.tree.unflatten(jax.tree.structure(drawn), leaves)


def origins_of(
    config: Config, stated: Rows = (), seen: frozenset[pathlib.Path] = frozenset()
) -> tuple[Rows, Rows]:
    """Data sets of a training and of the networks from which it started; sources and licences.

    A data set has its name and, if the manifest can be read, the source and the number of training
    samples. Folders with the same name are listed with the names of their parents. Sources are
    those of `weights.file`; there is none if nothing is known.

    Args:
      stated: the sources of the training's own data.
      seen: folders of runs that are not read again: a run may have replaced its own origin.
    """
    own, known, inherited = _own_data(config), set(), list[dict[str, Any]]()
    data = [*own]
    for init in filter(None, config.train.networks):
        rows: Rows = ()
        sources: Rows = ()
        with contextlib.suppress(UserError, OSError):
            path = weights_path(init).resolve()
            if not path.is_dir():
                read = read_weights(path)
                rows, sources = read.figures["data"], read.sources
            elif path not in seen:
                rows, sources = origins_of(load_config(path), seen=seen | {path})
        data += rows
        known |= {row["name"] for row in rows}
        unknown = {"source": f"the data of {pathlib.Path(init).name}", "licences": {}}
        inherited += sources or [unknown]
    new = [row["name"] for row in own if row["name"] not in known]
    first = list(stated) or [{"source": name, "licences": {}} for name in new if inherited]
    return _once(data), [*first, *(row for row in _once(inherited) if row not in first)]


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


def _once(rows: Rows) -> Rows:
    return [row for i, row in enumerate(rows) if row not in rows[:i]]
