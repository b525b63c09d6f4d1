"""Child processes that cannot import from the current folder.

`python -m` and `python -c` search the current folder first. It may contain other people's files: a
`numpy.py` beside a mesh must not run in a child process of a command.
"""

import os
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
"""The folder that contains the packages `psgn_jax` and `data_gen`."""


def python(module: str, *arguments: str) -> list[str]:
    """The command line that runs a module of this package; start it with `environment`."""
    return [sys.executable, "-P", "-m", module, *arguments]


def environment(**changes: str) -> dict[str, str]:
    """Environment variables of a child process, in which import paths are absolute."""
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    paths = [str(ROOT), *(path for path in given if os.path.isabs(path))]
    return {
        **os.environ,
        **changes,
        "PYTHONSAFEPATH": "1",
        "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)),
    }
