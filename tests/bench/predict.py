"""Times predictions from image files: the first result of the command, and further images.

    python tests/bench/predict.py                        # the full network, untrained
    python tests/bench/predict.py --workdir runs/mine    # a trained one

If no run is given, one of the full network is made. The command is started twice: first with an
empty compilation cache, then with the programs that the first call compiled. Prints the wall-clock
and CPU seconds of the whole command for one image. For further images, it prints milliseconds per
image and the median of each step (read, mask, place, network, colours, files).
"""

import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
from absl import app, flags
from PIL import Image

_WORKDIR = flags.DEFINE_string("workdir", "", "a run; default: the full network, untrained")
_IMAGES = flags.DEFINE_integer("images", 20, "further images")

ROOT = pathlib.Path(__file__).resolve().parents[2]


def make_run(folder: pathlib.Path) -> None:
    """A run of the default configuration whose parameters are as initialised."""
    import jax

    from psgn_jax import config
    from psgn_jax.models import point_out_net
    from psgn_jax.training import state
    from psgn_jax.training.checkpoint import Checkpoints

    settings = config.parse({})
    model = point_out_net.build(settings.model)
    tx = state.optimizer(settings.optim, 1)
    made = jax.jit(lambda: state.create(settings, model, tx).params)()
    folder.mkdir()
    (folder / "config.json").write_text(config.to_json(settings))
    checkpoints = Checkpoints(folder / "checkpoints")
    checkpoints.save(1, state.named_leaves({"params": made}), {})
    checkpoints.close()


def make_images(folder: pathlib.Path, count: int) -> None:
    """Photos of 640x480: a coloured box on white."""
    folder.mkdir()
    rng = np.random.default_rng(0)
    for i in range(count):
        image = np.full((480, 640, 3), 250, np.uint8)
        top, left = rng.integers(40, 200, 2)
        image[top : top + 200, left : left + 300] = rng.integers(0, 200, 3)
        Image.fromarray(image).save(folder / f"{i:03d}.png")


def run(images: pathlib.Path, workdir: pathlib.Path, cache: pathlib.Path) -> tuple[float, float]:
    """Seconds (wall clock, processor) of the command."""
    command = [sys.executable, "-m", "psgn_jax.predict", str(images), f"--workdir={workdir}"]
    command += [f"--out={cache}/out", "--checkpoint=last"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PSGN_CACHE": str(cache)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    quiet = subprocess.DEVNULL
    subprocess.run(command, check=True, env=environment, stdout=quiet, stderr=quiet)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, used


def main(_: list[str]) -> None:
    """Measures and prints."""
    sys.path.insert(0, str(ROOT))
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        workdir = pathlib.Path(_WORKDIR.value) if _WORKDIR.value else folder / "run"
        if not _WORKDIR.value:
            command = [sys.executable, __file__, f"--make={workdir}"]
            subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        make_images(folder / "images", _IMAGES.value + 1)
        one = folder / "images" / "000.png"
        for label in ("empty compilation cache", "programs in the cache"):
            wall, used = run(one, workdir, folder / "cache")
            print(f"first result of the command, {label}: {wall:.1f} s ({used:.1f} s of CPU time)")
        run(folder / "images", workdir, folder / "cache")
        documents = sorted((folder / "cache" / "out").glob("*.json"))[1:]
        seconds = [json.loads(path.read_text())["seconds"] for path in documents]
        totals = sorted(1000 * sum(s.values()) for s in seconds)
        parts = {k: 1000 * statistics.median(s[k] for s in seconds) for k in seconds[0]}
        print(
            f"further images ({len(totals)}): median {statistics.median(totals):.0f} ms, "
            f"fastest {totals[0]:.0f} ms, slowest {totals[-1]:.0f} ms"
        )
        print("  " + ", ".join(f"{name} {value:.1f}" for name, value in parts.items()))


_MAKE = flags.DEFINE_string("make", "", "only makes an untrained run there", module_name="hidden")


def _start(argv: list[str]) -> None:
    if _MAKE.value:
        sys.path.insert(0, str(ROOT))
        make_run(pathlib.Path(_MAKE.value))
    else:
        main(argv)


if __name__ == "__main__":
    app.run(_start)
