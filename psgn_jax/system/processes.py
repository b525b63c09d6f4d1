"""Child processes that cannot import from the current folder.

Python puts the current folder first on the import path of `python -m` and `python -c`. Files from
others are data, so a `numpy.py` beside a mesh must not run in the children of a command.
"""

import os
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
"""The folder that contains the packages `psgn_jax` and `data_gen`."""


def python(module: str, *arguments: str) -> list[str]:
    """The command that runs a module of this package; start it with `environment`."""
    return [sys.executable, "-P", "-m", module, *arguments]


def environment(**changes: str) -> dict[str, str]:
    """The environment of a child process and its children: import paths are absolute folders."""
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    paths = [str(ROOT), *(path for path in given if os.path.isabs(path))]
    return {
        **os.environ,
        **changes,
        "PYTHONSAFEPATH": "1",
        "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)),
    }
