"""Initial parameters of a training from a trained network: `train.init`.

A training that resumes from its own checkpoints does not read the trained network again.
"""

import fnmatch
import pathlib
from typing import Any

import jax
import numpy as np
from absl import logging

from psgn_jax.config.experiment import Config, ConfigError
from psgn_jax.weights.leaves import named_leaves
from psgn_jax.weights.opening import open_network, shipped
from psgn_jax.weights.run_folder import Run


def open_initial(config: Config) -> Run:
    """Opens the network that `train.init` names: the folder of a run, a file of weights, or a name.

    Several, separated by commas, must have the same layers; the result has the mean of their
    parameters. The mean of networks that were trained from the same parameters with different
    seeds is often better than each of them (Wortsman et al., "Model soups", ICML 2022).

    Raises:
      ConfigError: there is no such network, its task differs, or the layers of several differ.
      CheckpointError, WeightsError: one of them cannot be read.
    """
    init = config.train.init
    names = [name.strip() for name in init.split(",")]
    if len(names) == 1 or pathlib.Path(init).exists():
        return _open(config, init)
    if "" in names:
        raise ConfigError(f"train.init={init!r}: a name is empty; accepted: names between commas")
    runs = [_open(config, name) for name in names]
    shapes = [
        {key: np.shape(leaf) for key, leaf in named_leaves(run.params).items()} for run in runs
    ]
    for name, other in zip(names[1:], shapes[1:], strict=True):
        if other != shapes[0]:
            raise ConfigError(
                f"train.init={init!r}: the layers of {name!r} differ from those of {names[0]!r}; "
                "expected networks with the same layers"
            )

    def mean(*leaves: Any) -> np.ndarray:
        total = np.sum([np.asarray(leaf, np.float32) for leaf in leaves], axis=0)
        return (total / np.float32(len(leaves))).astype(leaves[0].dtype)

    params = jax.tree.map(mean, *(run.params for run in runs))
    source = "the mean of " + ", ".join(run.source for run in runs)
    return runs[0]._replace(params=params, source=source)


def _open(config: Config, init: str) -> Run:
    path = pathlib.Path(init)
    if path.is_dir():
        run = open_network(path)
    elif path.is_file() or init in shipped():
        run = open_network(weights=init)
    else:
        names = ", ".join(shipped()) or "none in this version"
        raise ConfigError(
            f"train.init={init!r}: does not exist; accepted: the folder of a trained run, a file "
            f"of weights, or the name of weights in the package ({names})"
        )
    if run.config.task != config.task:
        raise ConfigError(
            f"train.init={init!r} has the task {run.config.task!r}; accepted: {config.task!r}"
        )
    return run


def initial_params(config: Config, drawn: Any, trained: Any) -> Any:
    """The trained parameters, with random ones for the layers in `train.init_skip`.

    Args:
      config: configuration of the new training.
      drawn: random parameters (or their shapes) of the new network, a nested dict.
      trained: parameters of the trained network.

    Returns:
      A tree like `drawn`: NumPy arrays for trained layers, the leaves of `drawn` for the others.

    Raises:
      ConfigError: layers of the two networks differ and are not skipped (the message lists them),
        or a pattern matches no layer.
    """
    wanted, have = named_leaves(drawn), named_leaves(trained)
    patterns = config.train.init_skip
    layers = sorted({name.rpartition(".")[0] for name in (*wanted, *have)})
    skipped = {x for x in layers if any(fnmatch.fnmatchcase(x, p) for p in patterns)}
    for pattern in patterns:
        if not fnmatch.filter(layers, pattern):
            raise ConfigError(
                f"train.init_skip: {pattern!r} matches no layer; layers: {', '.join(layers)}"
            )
    misfits: dict[str, str] = {}
    for name in sorted(wanted.keys() | have.keys()):
        layer = name.rpartition(".")[0]
        why = _difference(wanted.get(name), have.get(name))
        if why and layer not in skipped:
            misfits.setdefault(layer, f"{name} {why}")
    if misfits:
        flag = "".join(f"'{layer}'," for layer in misfits)
        raise ConfigError(
            f"train.init={config.train.init!r}: {len(misfits)} layers differ: "
            f"{'; '.join(misfits.values())}; to keep their random parameters: "
            f'--config.train.init_skip="({flag})"'
        )
    taken, left = [], set()
    for name, leaf in wanted.items():
        layer = name.rpartition(".")[0]
        if layer in skipped:
            left.add(layer)
        taken.append(leaf if layer in skipped else np.array(have[name]))
    if left:
        names = ", ".join(sorted(left))
        logging.info("random parameters, not those of %s: %s", config.train.init, names)
    return jax.tree.unflatten(jax.tree.structure(drawn), taken)


def _difference(want: Any, have: Any) -> str:
    if want is None:
        return "is not in the new network"
    if have is None:
        return "is not in the trained network"
    if want.shape != have.shape:
        return f"is {list(have.shape)} and not {list(want.shape)}"
    return ""
