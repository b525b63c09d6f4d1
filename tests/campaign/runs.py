"""Small trainings for the parts of the campaign, and their results."""

import json
import os
import pathlib
import runpy
from typing import Any

import numpy as np
from helpers import drawn_solids

from campaign import frame
from psgn_jax.data.dataset import write_dataset
from psgn_jax.training.checkpoint import Checkpoint, Checkpoints

STEPS = 40
SIZE = (16, 32)
NETWORK = {
    "model.widths": (4, 8, 16),
    "model.fc_points": 8,
    "model.fc_widths": (8,),
    "model.deconv_level": 1,
    "data.image_size": SIZE,
    "data.num_points": 32,
    "data.num_eval_points": 32,
    "eval.emd_tolerance": 0.0,
    "eval.visible_tolerance": 0.0,
}
"""As small as possible, because a small training mostly compiles."""
# Compile fast, as in the tests: the trials concern files and signals.
QUICK = {"XLA_FLAGS": "--xla_backend_optimization_level=0", "TF_CPP_MIN_LOG_LEVEL": "3"}


def make_records(folder: pathlib.Path) -> pathlib.Path:
    """Writes a small data set; returns its folder."""
    splits = {
        "train": drawn_solids.samples(10, seed=0, image_size=SIZE),
        "validation": drawn_solids.samples(5, seed=1, image_size=SIZE),
    }
    write_dataset(folder, splits, source="solids", records_per_shard=4)
    return folder


def training(
    records: pathlib.Path, workdir: pathlib.Path, workers: int = 0, **more: Any
) -> list[str]:
    """Arguments of Python that train the debug configuration with many checkpoints.

    `more` are further fields of the configuration, with `__` in place of a dot.
    """
    fields = NETWORK | {
        "data.path": records,
        "data.num_workers": workers,
        "data.flip": True,
        "train.steps": STEPS,
        "train.batch_size": 4,
        "train.checkpoint_every": 4,
        "train.eval_every": 20,
        "train.images_every": 0,
        "eval.max_samples": 4,
        "eval.batch_size": 4,
    }
    fields |= {name.replace("__", "."): value for name, value in more.items()}
    flags = [f"--config.{name}={value}" for name, value in fields.items()]
    return ["-m", "psgn_jax.main", "--config=configs/debug.py", f"--workdir={workdir}", *flags]


def debug_configuration(records: str, steps: int) -> dict[str, Any]:
    """The debug configuration with these records, as a tree."""
    tree = runpy.run_path(str(frame.ROOT / "configs" / "debug.py"))["get_config"]().to_dict()
    tree["data"] |= {"path": str(records)}
    for name, value in NETWORK.items():
        section, field = name.split(".")
        tree[section][field] = value
    tree["train"] |= {"steps": steps, "batch_size": 4, "checkpoint_every": 4, "eval_every": 8}
    tree["train"] |= {"images_every": 0}
    tree["eval"] |= {"max_samples": 4, "batch_size": 4}
    return tree


def quick(folder: pathlib.Path) -> dict[str, str]:
    """The environment of the commands of a part; all parts share a compilation cache."""
    compiled = os.environ.get("JAX_COMPILATION_CACHE_DIR", str(folder.parent / "compiled"))
    return QUICK | {
        "JAX_COMPILATION_CACHE_DIR": compiled,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def newest(workdir: pathlib.Path) -> int:
    """Step of the newest complete checkpoint, 0 without one."""
    folder = workdir / "checkpoints"
    names = [p.name for p in folder.iterdir()] if folder.is_dir() else []
    return max((int(name) for name in names if name.isascii() and name.isdigit()), default=0)


def last_checkpoint(workdir: pathlib.Path) -> Checkpoint | None:
    """The newest checkpoint that can be read."""
    return Checkpoints(workdir / "checkpoints", read_only=True).restore_newest()


def metric_lines(workdir: pathlib.Path) -> list[dict]:
    """Lines of metrics without the numbers that depend on the clock."""
    entries = [json.loads(x) for x in (workdir / "metrics.jsonl").read_text().splitlines()]
    return [{k: v for k, v in e.items() if k != "samples_per_second"} for e in entries]


def difference(workdir: pathlib.Path, reference: pathlib.Path) -> str:
    """How the end of a run differs from that of another; "" = bit-identical."""
    have, want = last_checkpoint(workdir), last_checkpoint(reference)
    if have is None or want is None or have.step != want.step:
        return f"the last checkpoint is {have and have.step}, expected {want and want.step}"
    for name, leaf in want.leaves.items():
        if not np.array_equal(have.leaves[name], leaf):
            return f"{name} differs"
    if metric_lines(workdir) != metric_lines(reference):
        return "the lines of metrics differ"
    scores = [(w / "checkpoints" / "scores.json").read_text() for w in (workdir, reference)]
    return "" if scores[0] == scores[1] else "the scores differ"
