"""A wheel built from a tree with weights predicts and trains without a clone."""

import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from helpers.commands import ROOT, psgn
from helpers.small_runs import write_solids
from PIL import Image

from psgn_jax.weights.file import write_weights
from psgn_jax.weights.opening import DEFAULT


@pytest.mark.slow
def test_a_wheel_has_weights_and_examples_predicts_and_trains(weights, tmp_path):
    tree, packages = tmp_path / "tree", tmp_path / "packages"
    tree.mkdir()
    for name in ("psgn_jax", "data_gen", "configs"):
        ignored = shutil.ignore_patterns("__pycache__", "*.safetensors")
        shutil.copytree(ROOT / name, tree / name, ignore=ignored)
    for name in ("pyproject.toml", "README.md", "LICENSE", ".gitignore"):
        shutil.copy(ROOT / name, tree / name)
    write_weights(tree / "psgn_jax" / "weights" / f"{DEFAULT}.safetensors", weights)
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", f"-w{tmp_path}", str(tree)]
    subprocess.run(command, check=True, timeout=300)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        archive.extractall(packages)
    assert f"psgn_jax/weights/{DEFAULT}.safetensors" in names
    examples = (ROOT / "psgn_jax" / "web" / "page" / "static" / "examples").glob("*.png")
    assert {path.relative_to(ROOT).as_posix() for path in examples} <= set(names)
    assert {"psgn_jax/configs/quickstart.py", "psgn_jax/py.typed", "data_gen/py.typed"} <= set(
        names
    )
    (entry_points,) = packages.glob("*.dist-info/entry_points.txt")
    assert "psgn = psgn_jax.commands.psgn:main" in entry_points.read_text()

    options = {"cwd": tmp_path, "PYTHONPATH": str(packages), "PYTHONSAFEPATH": "1"}
    image = np.full((90, 120, 3), 230, np.uint8)
    image[30:60, 40:90] = (200, 60, 20)
    Image.fromarray(image).save(tmp_path / "photo.png")
    done = psgn("predict", "photo.png", "--out=out", **options)
    assert done.returncode == 0, done.stderr
    assert "8 points, mask plain" in done.stdout
    with np.load(tmp_path / "out" / "photo.npz") as archive:
        assert archive["points"].shape == (1, 8, 3)
    write_solids(tmp_path / "records")
    fields = ["data.path=records", "train.steps=2", "train.eval_every=0", "train.batch_size=4"]
    flags = [f"--config.{field}" for field in [*fields, "optim.warmup_steps=0"]]
    done = psgn("train", "--config=debug", *flags, **options)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "debug" / "config.json").is_file()
