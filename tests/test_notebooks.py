import importlib.util
import json
import pathlib
import subprocess
import warnings

import nbclient
import nbformat
import pytest

FOLDER = pathlib.Path(__file__).resolve().parents[1] / "notebooks"


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda p: p.stem)
def test_notebook_runs(path, monkeypatch):
    # The kernel is a process of its own: it imports the package from this checkout.
    monkeypatch.setenv("PYTHONPATH", str(FOLDER.parent))
    # A command that another test has called in this process may have set it. The kernel's launcher
    # would then remove the checkout from the import path.
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    notebook = nbformat.read(path, as_version=4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the kernel's client, about its own event loop
        nbclient.NotebookClient(notebook, timeout=300).execute()
    outputs = [o for c in notebook.cells for o in c.get("outputs", [])]
    assert any("image/png" in o.get("data", {}) for o in outputs)


def test_without_a_clone_the_first_cell_installs_and_asks_for_a_photo(tmp_path, monkeypatch):
    cells = json.loads((FOLDER / "predict.ipynb").read_text())["cells"]
    first = "".join(next(c["source"] for c in cells if c["cell_type"] == "code"))
    commands = []
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(subprocess, "check_call", commands.append)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"no photo.jpg in .*Upload a photo"):
        exec(first, {})
    assert commands[0][-2:] == ["psgn-jax", "matplotlib"]
    (tmp_path / "photo.jpg").touch()
    variables = {}
    exec(first, variables)
    assert variables["PHOTO"] == "photo.jpg"
