"""Runs a command with many lists of arguments; its modules are imported once."""

import json
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]

_COMMANDS = """
import importlib, json, os, sys
from absl import app
module = importlib.import_module(sys.argv[1])
for number, arguments in enumerate(json.loads(sys.argv[2])):
    if os.fork() == 0:
        for stream in (1, 2):
            os.dup2(os.open(f"{number}.{stream}", os.O_WRONLY | os.O_CREAT), stream)
        sys.argv[:] = ["command", *arguments]
        app.run(module.main, flags_parser=module._parse_flags)
    code = os.waitstatus_to_exitcode(os.wait()[1])
    print(json.dumps([code, *(open(f"{number}.{stream}").read() for stream in (1, 2))]))
"""


def outcomes(module, commands, folder):
    """Exit code, standard output and standard error with each list of arguments."""
    done = subprocess.run(
        [sys.executable, "-c", _COMMANDS, module, json.dumps(commands)], cwd=folder, text=True,
        check=True, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE,
    )  # fmt: skip
    return [json.loads(line) for line in done.stdout.splitlines()]
