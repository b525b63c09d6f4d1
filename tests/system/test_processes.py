"""Commands in a folder with Python files of others, under every name that may be imported.

`weights/test_wheel.py` runs the other commands in such a folder.
"""

import os
import sys

import pytest
from helpers import commands
from helpers.commands import ROOT
from helpers.obj_text import CUBE, FACES
from helpers.processes import write_modules

from data_gen.engine import has_mitsuba
from psgn_jax.system import processes


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A folder with a mesh, beside modules that leave a mark when they run."""
    base = tmp_path_factory.mktemp("hostile")
    folder = base / "theirs"
    folder.mkdir()
    write_modules(folder, base / "executed")
    (folder / "mesh.obj").write_text(CUBE + FACES)
    return folder


def run(folder, script, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    environment.pop("PYTHONSAFEPATH", None)
    commands.run(sys.executable, ROOT / script, *arguments, cwd=folder, env=environment)
    executed = folder.parent / "executed"
    assert not executed.exists(), executed.read_text()


def test_a_child_process_imports_from_absolute_folders_only(hostile, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", ".", "theirs", "/absolute"]))
    environment = processes.environment(ADDED="1")
    assert environment["PYTHONPATH"].split(os.pathsep) == [str(ROOT), "/absolute"]
    assert environment["ADDED"] == "1"
    command = processes.python("psgn_jax.commands.psgn", "--version")
    assert "psgn_jax" in commands.run(*command, cwd=hostile, env=environment).stdout
    assert not (hostile.parent / "executed").exists()


@pytest.mark.skipif(not has_mitsuba(), reason="Mitsuba is not installed")
def test_render_executes_no_file_of_the_current_folder(hostile):
    run(
        hostile, "data_gen/render.py", "--catalogue=folder", "--source=.", "--out=out",
        "--config.views=1", "--config.job.variant=scalar", "--config.job.workers=1",
        "--config.light.source=mixed", "--config.camera.image_size=(48,64)",
    )  # fmt: skip
    assert (hostile / "out" / "manifest.json").exists()


def test_free_set_executes_no_file_of_the_current_folder(hostile):
    run(hostile, "scripts/free_set.py", "--packages=.", "--sources=procedural", "--check")
