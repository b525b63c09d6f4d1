"""Commands in a folder with Python files of others, under every name that may be imported."""

import importlib.metadata
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from helpers import drawn_solids as solids
from PIL import Image

from data_gen.engine import has_mitsuba
from psgn_jax.data.dataset import write_dataset
from psgn_jax.system import processes

ROOT = pathlib.Path(__file__).resolve().parents[2]
CONSOLE_SCRIPT = """import sys
from psgn_jax.commands.psgn import main
if __name__ == "__main__":  # as in the scripts that pip installs
    sys.exit(main())
"""
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def hostile(tmp_path):
    """A folder with a mesh, a photo and records, beside modules that leave a mark when they run."""
    folder = tmp_path / "theirs"
    folder.mkdir()
    own = {"psgn_jax", "data_gen"}
    for name in {*sys.stdlib_module_names, *importlib.metadata.packages_distributions()} - own:
        if name.isidentifier():
            (folder / f"{name}.py").write_text(
                f"open({str(tmp_path / 'executed')!r}, 'a').write({name!r} + '\\n')\n"
            )
    (folder / "mesh.obj").write_text(MESH)
    photo = np.full((60, 80, 3), 255, np.uint8)
    photo[15:45, 25:55] = 60
    Image.fromarray(photo).save(folder / "photo.png")
    rng = np.random.default_rng(0)
    box = solids.random_solid("box", rng)
    samples = [solids.draw(box, rng, num_points=1500) for _ in range(4)]
    splits = dict.fromkeys(("train", "validation", "test"), samples)
    write_dataset(folder / "records", splits, source="solids")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/psgn").write_text(CONSOLE_SCRIPT)
    return folder


def run(folder, *arguments, script="bin/psgn"):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run(
        [sys.executable, folder.parent / script, *arguments], cwd=folder, env=environment,
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    executed = folder.parent / "executed"
    assert not executed.exists(), executed.read_text()
    return done


def test_a_child_process_imports_from_absolute_folders_only(hostile, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", ".", "theirs", "/absolute"]))
    environment = processes.environment(ADDED="1")
    assert environment["PYTHONPATH"].split(os.pathsep) == [str(ROOT), "/absolute"]
    assert environment["ADDED"] == "1"
    command = processes.python("psgn_jax.commands.psgn", "--version")
    done = subprocess.run(command, cwd=hostile, env=environment, capture_output=True, check=True)
    assert b"psgn_jax" in done.stdout
    assert not (hostile.parent / "executed").exists()


@pytest.mark.skipif(not has_mitsuba(), reason="Mitsuba is not installed")
@pytest.mark.parametrize("script", ["bin/psgn", ROOT / "data_gen/render.py"])
def test_render_executes_no_file_of_the_current_folder(hostile, script):
    command = ["render"] if script == "bin/psgn" else []
    done = run(
        hostile, *command, "--catalogue=folder", "--source=.", "--out=out", "--config.views=1",
        "--config.job.variant=scalar", "--config.job.workers=1", "--config.light.source=mixed",
        script=script,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (hostile / "out/manifest.json").exists()


def test_free_set_executes_no_file_of_the_current_folder(hostile):
    done = run(hostile, "free-set", "--packages=.", "--sources=procedural", "--check")
    assert done.returncode == 0, done.stderr


SMALL = ("--config.data.path=records", "--config.data.num_workers=2", "--config.train.steps=2",
         "--config.train.batch_size=2", "--config.optim.warmup_steps=0",
         "--config.train.eval_every=0")  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("train", "--config=quickstart", "--workdir=run", *SMALL), 0),
        (("predict", "photo.png", "--out=out"), 0),
        (("evaluate", "--data=records", "--out=out"), None),
        (("page", "--out=page.html"), None),  # without npm it ends with an error
    ],
)
def test_no_command_executes_a_file_of_the_current_folder(hostile, arguments, code):
    done = run(hostile, *arguments)
    assert code is None or done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
