"""Initial parameters of a training from a trained network: `train.init`.

A training that resumes from its own checkpoints does not read the trained network again.
"""

import fnmatch
import pathlib
from typing import Any

import jax
import numpy as np
from absl import logging

from psgn_jax.config import Config, ConfigError
from psgn_jax.training import state as state_lib
from psgn_jax.training.run_folder import Run, open_run
from psgn_jax.weights.opening import open_weights, shipped


def open_initial(config: Config) -> Run:
    """Opens the network that `train.init` names: the folder of a run, a file of weights, or a name.

    Raises:
      ConfigError: there is no such network, or its task differs.
      CheckpointError, WeightsError: it cannot be read.
    """
    init = config.train.init
    path = pathlib.Path(init)
    if path.is_dir():
        run = open_run(path)
    elif path.is_file() or init in shipped():
        run = open_weights(init)
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
    wanted, have = state_lib.named_leaves(drawn), state_lib.named_leaves(trained)
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
        raise ConfigError(
            f"train.init={config.train.init!r}: {len(misfits)} layers differ: "
            f"{'; '.join(misfits.values())}; to keep their random parameters: "
            f"--config.train.init_skip={_as_flag(misfits)}"
        )
    if left := [name for name in wanted if name.rpartition(".")[0] in skipped]:
        names = sorted({name.rpartition(".")[0] for name in left})
        logging.info("random parameters, not those of %s: %s", config.train.init, ", ".join(names))
    taken = [
        leaf if name.rpartition(".")[0] in skipped else np.array(have[name])
        for name, leaf in wanted.items()
    ]
    return jax.tree.unflatten(jax.tree.structure(drawn), taken)


def _difference(want: Any, have: Any) -> str:
    if want is None:
        return "is not in the new network"
    if have is None:
        return "is not in the trained network"
    if want.shape != have.shape:
        return f"is {list(have.shape)} and not {list(want.shape)}"
    return ""


def _as_flag(names: Any) -> str:
    return '"(' + "".join(f"'{name}'," for name in names) + ')"'
