"""Every notebook runs from top to bottom."""

import pathlib
import warnings

import pytest

FOLDER = pathlib.Path(__file__).resolve().parents[1] / "notebooks"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda p: p.stem)
def test_notebook_runs(path, monkeypatch):
    import nbclient
    import nbformat

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
