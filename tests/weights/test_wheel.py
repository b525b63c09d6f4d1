"""A sdist and a wheel built from a tree with weights; the wheel's commands run without a clone.

They run in a folder with Python files of others, which must not be executed.
"""

import pathlib
import shutil
import sys
import tarfile
import venv

import numpy as np
import pytest
from helpers import shapenet_trees
from helpers import weights as tiny
from helpers.commands import ROOT, run
from helpers.processes import write_modules
from helpers.standin import quick_environment, write_solids
from PIL import Image

import psgn_jax
from psgn_jax.weights.file import write_weights
from psgn_jax.weights.opening import DEFAULT

pytestmark = pytest.mark.slow


def build_wheel(folder):
    """Built from the sdist, as `python -m build` does, with the weights of a tiny network."""
    tree = folder / "tree"
    tree.mkdir(parents=True)
    for name in ("psgn_jax", "data_gen", "configs"):
        ignored = shutil.ignore_patterns("__pycache__", "*.safetensors")
        shutil.copytree(ROOT / name, tree / name, ignore=ignored)
    for name in ("pyproject.toml", "README.md", "LICENSE", ".gitignore"):
        shutil.copy(ROOT / name, tree / name)
    small = tiny.weights(tiny.config())
    write_weights(tree / "psgn_jax" / "weights" / f"{DEFAULT}.safetensors", small)
    build = (sys.executable, "-m", "hatchling", "build", "-d", folder, "-t")
    run(*build, "sdist", cwd=tree)
    (sdist,) = folder.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    run(*build, "wheel", cwd=folder / f"psgn_jax-{psgn_jax.__version__}")
    return folder / f"psgn_jax-{psgn_jax.__version__}-py3-none-any.whl"


@pytest.fixture
def packages(tmp_path):
    """The `site-packages` of an environment with the wheel and this environment's dependencies.

    It lacks this checkout: files `.pth` in the folders named by its own `.pth` file are not read.
    """
    venv.create(tmp_path / "env", symlinks=True)
    (packages,) = (tmp_path / "env").glob("lib/python*/site-packages")
    own = [path for path in sys.path if pathlib.Path(path).name == "site-packages"]
    (packages / "dependencies.pth").write_text("\n".join(own) + "\n")
    target = ("--no-deps", "--no-index", "--no-compile", "--target", packages)
    run(sys.executable, "-m", "pip", "install", "-q", *target, build_wheel(tmp_path / "build"))
    return packages


@pytest.fixture
def psgn(packages, tmp_path):
    """Runs the installed `psgn` in the folder `work`, which has a photo."""
    others = ("PYTHONPATH", "PYTHONSAFEPATH", "PSGN_CONVOLUTIONS")
    environment = {k: v for k, v in quick_environment(tmp_path).items() if k not in others}
    script = (packages.parents[2] / "bin" / "python", packages / "bin" / "psgn")
    (tmp_path / "work").mkdir()
    write_modules(tmp_path / "work", tmp_path / "executed")
    image = np.full((90, 120, 3), 230, np.uint8)
    image[30:60, 40:90] = (200, 60, 20)
    Image.fromarray(image).save(tmp_path / "work" / "photo.png")

    def psgn(*arguments):
        printed = run(*script, *arguments, cwd=tmp_path / "work", env=environment).stdout
        executed = tmp_path / "executed"
        assert not executed.exists(), executed.read_text()
        return printed

    return psgn


def test_an_installed_wheel_predicts_converts_trains_and_evaluates(psgn, packages, tmp_path):
    for path in [p for name in ("psgn_jax", "data_gen") for p in (ROOT / name).rglob("*.*")]:
        if path.suffix not in (".pyc", ".safetensors"):  # such as those of the page
            assert (packages / path.relative_to(ROOT)).read_bytes() == path.read_bytes()
    work = tmp_path / "work"
    assert psgn("--version") == f"psgn_jax {psgn_jax.__version__}\n"
    assert "8 points, mask plain" in psgn("predict", "photo.png", "--out=out")
    with np.load(work / "out" / "photo.npz") as archive:
        assert archive["points"].shape == (1, 8, 3)
    psgn("view", "out/photo.npz", "--out=view.html")
    shapenet_trees.write_r2n2(tmp_path / "r2n2", names=("a",))
    psgn("convert", "r2n2", tmp_path / "r2n2", "converted", "--points=64", "--views=1")
    write_solids(work / "records")
    psgn("human", "--data=records", "--cases=2", "--out=study")
    fields = ["data.path=records", "data.image_size=(16,32)", "loss.name=chamfer_sq_mean"]
    fields += ["train.steps=2", "train.eval_every=0", "train.batch_size=4", "optim.warmup_steps=0"]
    fields += ["data.num_workers=2"]
    psgn("train", "--config=quickstart", *(f"--config.{field}" for field in fields))
    assert "CD" in psgn("evaluate", "--workdir=runs/quickstart", "--report=report")
    for page in ("view.html", "study/index.html", "report/index.html"):
        assert "<html" in (work / page).read_text()[:400]
