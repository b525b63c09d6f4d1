"""Times whole training steps in memory on an accelerator, those with the EMD first.

    python tests/bench/gpu.py
    JAX_PLATFORMS=cpu python tests/bench/gpu.py --tiny      # on a CPU, to see it run

Rows of a table: networks, precisions and batch sizes. Times are the least of several calls. Each is
printed as soon as it is measured. `losses.py` times the EMD alone, on an accelerator too.
"""

import argparse
import dataclasses
import itertools
import os
import pathlib
import sys

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
NETWORKS = ("two_branch", "vanilla", "hourglass")
EMD, CD = "emd_mean@{} + 5*chamfer_sq_mean", "chamfer_sq_mean"


def surfaces(rng, pairs, points):
    """Clouds [pairs, points, 3] on ellipsoids of random proportions."""
    normals = rng.normal(size=(pairs, points, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return (normals * rng.uniform(0.3, 1, (pairs, 1, 3))).astype(np.float32)


def measure_steps(tiny):
    """Figures of training steps: (name, value)."""
    import jax
    from losses import seconds

    from psgn_jax import tasks
    from psgn_jax.config import parse
    from psgn_jax.config.experiment import LossConfig
    from psgn_jax.models import networks
    from psgn_jax.training.step import create_training, data_mesh, put_batch, put_replicated

    mesh = data_mesh()
    size, sizes = ((24, 32), (4,)) if tiny else ((192, 256), (32, 128, 256))
    small = {"widths": (4, 6, 8), "fc_points": 16, "fc_widths": (16,), "deconv_level": 1}
    rng = np.random.default_rng(0)
    precisions = ("float32", "bfloat16")
    for loss, name, precision, batch in itertools.product((EMD, CD), NETWORKS, precisions, sizes):
        model = {"name": name, "compute_dtype": precision, **(small if tiny else {})}
        if name == "vanilla" and not tiny:
            model["fc_points"] = 1024
        data = {"image_size": size, "num_points": 256 if tiny else 4096}
        config = parse({"model": model, "data": data, "train": {"batch_size": batch}})
        full_name = loss.format(networks.build(config.model).num_points)
        config = dataclasses.replace(config, loss=LossConfig(name=full_name))
        task = tasks.create(config, "")
        create, step = create_training(config, task, mesh)
        arrays = {
            "image": rng.integers(0, 256, (batch, *size, 3), np.uint8),
            "mask": rng.random((batch, *size)) < 0.3,
            "points": surfaces(rng, batch, data["num_points"]),
        }
        on_device = put_batch(arrays, mesh, task.keys)
        held = [put_replicated(jax.jit(create)(), mesh)]

        def run(step=step, held=held, on_device=on_device):
            held[0], metrics = step(held[0], on_device)
            return metrics

        figure = f"step, {full_name}, {name}, {precision}, batch {batch}: ms"
        yield figure, 1000 * seconds(run)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--tiny", action="store_true")
    arguments = parser.parse_args()
    os.environ.setdefault("JAX_PLATFORMS", "cuda,cpu")
    import jax

    device = f"{jax.devices()[0].device_kind}, jax {jax.__version__}"
    print("| figure | value | on |\n|---|---|---|")
    for figure, value in measure_steps(arguments.tiny):
        print(f"| {figure} | {value:.4f} | {device} |", flush=True)


if __name__ == "__main__":
    main()
