"""Initial parameters of a training from a trained network: `train.init`.

A training that goes on with its own checkpoints does not read them again.
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
    """The network that `train.init` means: a run's folder, a file of weights, a name.

    Raises:
      ConfigError: there is none, or it is of another task.
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
            f"train.init={init!r}: nothing there; accepted: the folder of a trained run, a file of "
            f"weights, or the name of weights that come with the package ({names})"
        )
    if run.config.task != config.task:
        raise ConfigError(
            f"train.init={init!r} is of the task {run.config.task!r}; accepted: {config.task!r}"
        )
    return run


def initial_params(config: Config, drawn: Any, trained: Any) -> Any:
    """The trained parameters; those of layers that `train.init_skip` leaves out are the drawn ones.

    Args:
      config: of the new training.
      drawn: parameters (or their shapes) of the new network, a nested dict.
      trained: parameters of the trained one.

    Returns:
      a tree as `drawn`: NumPy arrays where trained, the leaves of `drawn` elsewhere.

    Raises:
      ConfigError: layers that do not fit and are not left out, or a pattern that fits no layer;
        one line with their names.
    """
    wanted, have = state_lib.named_leaves(drawn), state_lib.named_leaves(trained)
    patterns = config.train.init_skip
    layers = sorted({name.rpartition(".")[0] for name in (*wanted, *have)})
    skipped = {x for x in layers if any(fnmatch.fnmatchcase(x, p) for p in patterns)}
    for pattern in patterns:
        if not fnmatch.filter(layers, pattern):
            raise ConfigError(
                f"train.init_skip: {pattern!r} fits no layer; layers: {', '.join(layers)}"
            )
    misfits: dict[str, str] = {}
    for name in sorted(wanted.keys() | have.keys()):
        layer = name.rpartition(".")[0]
        why = _difference(wanted.get(name), have.get(name))
        if why and layer not in skipped:
            misfits.setdefault(layer, f"{name} {why}")
    if misfits:
        raise ConfigError(
            f"train.init={config.train.init!r}: {len(misfits)} layers do not fit: "
            f"{'; '.join(misfits.values())}; to leave them as they are drawn: "
            f"--config.train.init_skip={_as_flag(misfits)}"
        )
    if left := [name for name in wanted if name.rpartition(".")[0] in skipped]:
        names = sorted({name.rpartition(".")[0] for name in left})
        logging.info("not taken from %s: %s", config.train.init, ", ".join(names))
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
