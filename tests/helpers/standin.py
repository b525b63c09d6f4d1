"""A stand-in for a configuration, its data and its environment: steps take milliseconds."""

import os
import pathlib
import shutil

from psgn_jax.config.experiment import parse, to_dict

SOLIDS = pathlib.Path(__file__).resolve().parents[1] / "oracles" / "solids"
"""Records of 24 training and 11 validation samples, 16x32 pixels with depth."""
TINY = {"model__name": "vanilla", "model__widths": (4, 6, 8)}
VAE = TINY | {
    "model__posterior": True,
    "model__posterior_widths": (3, 4, 5),
    "model__posterior_hidden": 6,
    "loss__kl_weight": 1e-2,
    "loss__kl_warmup_steps": 4,
}


def config(**changes):
    """A `Config` whose step takes milliseconds, with changes given as `section__field=value`."""
    widths = {"widths": (4, 6, 8, 8), "fc_points": 8, "fc_widths": (12,)}
    every = {"log_every": 2, "eval_every": 6, "checkpoint_every": 3, "images_every": 0}
    points = {"num_points": 64, "num_eval_points": 64}
    tree = {
        "seed": 3,
        "data": {"path": str(SOLIDS), "image_size": (16, 32), **points},
        "model": {**widths, "deconv_level": 1, "random_size": 3},
        "optim": {"learning_rate": 1e-3, "ema_decay": 0.9, "clip_norm": 5.0},
        "loss": {"l2": "authors"},
        "train": {**every, "batch_size": 8, "steps": 12},
        "eval": {"batch_size": 4, "emd_tolerance": 0},
    }
    for name, value in changes.items():
        section, _, field = name.partition("__")
        tree[section] = {**tree.get(section, {}), field: value} if field else value
    return parse(tree)


def write_solids(folder):
    """Copies the records of `SOLIDS`; returns the folder."""
    return shutil.copytree(SOLIDS, folder, dirs_exist_ok=True)


def write_config(path, config):
    """Writes a file for `--config`; returns its path."""
    path.write_text(
        "import ml_collections\n\n\ndef get_config():\n"
        f"    return ml_collections.ConfigDict({to_dict(config)!r})\n"
    )
    return path


def quick_environment(folder):
    """An environment in which each program is compiled once, as by `keep_compiled`."""
    return os.environ | {
        "JAX_PLATFORMS": "cpu",
        "PSGN_CONVOLUTIONS": "xla",
        "JAX_COMPILATION_CACHE_DIR": str(folder / "cache"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        # XLA warns that cached programs might be for another machine, even on the same machine.
        "TF_CPP_MIN_LOG_LEVEL": "3",
    }
