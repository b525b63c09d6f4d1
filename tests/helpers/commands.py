"""Runs commands as users do."""

import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]


def psgn(*arguments, cwd=ROOT, **environment):
    """`psgn ARGUMENTS` in a process of its own; its output is captured as text."""
    command = [sys.executable, "-m", "psgn_jax.commands.psgn", *map(str, arguments)]
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT), **environment}
    return subprocess.run(
        command, capture_output=True, text=True, cwd=cwd, env=environment, timeout=400
    )
