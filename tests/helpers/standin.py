"""A data source without files, and a command that trains on it.

    python tests/helpers/standin.py FLAGS

Samples are coloured boxes. Their images and points depend only on the sample's number. With a
`data.path`, those records are read instead.
"""

import os
import pathlib
import sys
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))

from psgn_jax.data import loader

_train, _eval = loader.train_batches, loader.eval_batches  # which `install` replaces
SIZES = {"train": 24, "validation": 11}
CATEGORIES = ("bench", "car", "lamp")
INTRINSICS = np.array([[100.0, 0, 32], [0, 100.0, 24], [0, 0, 1]], np.float32)
EXTRINSICS = np.array([[0, 1, 0, 0], [0.342, 0, -0.94, 0.252], [-0.94, 0, -0.342, 3.6]], np.float32)


def sample(cfg, number, num_points, rng):
    own = np.random.default_rng(number)
    half = own.uniform(0.2, 0.6, 3).astype(np.float32)
    height, width = cfg.image_size
    mask = np.zeros((height, width), bool)
    rows, columns = (half[2] * height).astype(int), (half[1] * width).astype(int)
    mask[height // 2 - rows // 2 : height // 2 + rows, width // 4 : width // 4 + columns] = True
    image = np.full((height, width, 3), 191, np.uint8)
    image[mask] = own.integers(0, 255, 3)
    points = rng.uniform(-1, 1, (num_points, 3)).astype(np.float32) * half
    points[:, 2] += half[2]
    depth = {"depth": mask * np.float32(3)} if "depth" in cfg.inputs else {}
    camera = {"intrinsics": INTRINSICS, "extrinsics": EXTRINSICS}
    return {"image": image, "mask": mask, "points": points, **camera, **depth}


def _stack(samples):
    return {key: np.stack([s[key] for s in samples]) for key in samples[0]}


def train_batches(cfg, **options):
    if cfg.path:
        yield from _train(cfg, **options)
    batch_size, seed, step = (options[name] for name in ("batch_size", "seed", "start_step"))
    local = batch_size // options.get("process_count", 1)
    first = options.get("process_index", 0) * local
    delay = float(os.environ.get("PSGN_STANDIN_DELAY", "0"))
    while True:
        time.sleep(delay)
        rng = np.random.default_rng((seed, step))
        numbers = rng.integers(0, SIZES[cfg.train_split], batch_size)
        rows = [sample(cfg, n, cfg.num_points, rng) for n in numbers]
        yield _stack(rows[first : first + local])
        step += 1


def eval_batches(cfg, *, split, batch_size, choose=range, **options):
    if cfg.path:
        options |= {"batch_size": batch_size, "choose": choose}
        yield from _eval(cfg, split=split, **options)
        return
    total = SIZES[split]
    for batch in choose(-(-total // batch_size)):
        start = batch * batch_size
        numbers = [min(n, total - 1) for n in range(start, start + batch_size)]
        rows = [
            sample(cfg, 1000 + n, cfg.num_eval_points, np.random.default_rng(n)) for n in numbers
        ]
        yield _stack(rows) | {
            "valid": np.arange(start, start + batch_size) < total,
            "category": [CATEGORIES[n % 3] for n in numbers],
            "model_id": [f"model{n}" for n in numbers],
            "view": numbers,
        }


def num_samples(cfg, split, *, evaluation=False):
    return SIZES[split]


def install(monkeypatch):
    """Replaces the loader by this source for trainings and evaluations in this process."""
    from psgn_jax.commands import default_data
    from psgn_jax.data.manifest import Manifest
    from psgn_jax.training import loop

    def load_manifest(folder, read=loop.load_manifest):
        return read(folder) if os.path.isdir(folder) else Manifest("", True, ())

    monkeypatch.setattr(loop, "load_manifest", load_manifest)
    for function in (train_batches, eval_batches, num_samples):
        monkeypatch.setattr(loader, function.__name__, function)
    monkeypatch.setattr(default_data, "default_dataset", lambda: "")


def config(**changes):
    """A `Config` whose step takes milliseconds, with changes given as `section__field=value`."""
    from psgn_jax.config.experiment import parse

    widths = {"widths": (4, 6, 8, 8), "fc_points": 8, "fc_widths": (12,)}
    every = {"log_every": 2, "eval_every": 6, "checkpoint_every": 3, "images_every": 0}
    tree = {
        "seed": 3,
        "data": {"image_size": (16, 32), "num_points": 64, "num_eval_points": 64},
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


if __name__ == "__main__":
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    import pytest

    from psgn_jax import main
    from psgn_jax.system.terminal import start_command

    start_command()
    install(pytest.MonkeyPatch())
    sys.exit(main.main())
