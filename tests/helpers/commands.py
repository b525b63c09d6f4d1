"""Runs commands as users do."""

import json
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
PHOTOS = ROOT / "docs" / "photos"

_USUAL = ("psgn_jax.commands.default_data", "psgn_jax.evaluation.baselines")

# Forks after the imports. Each child runs the command as its main module, as `psgn` does.
_EACH = """
import importlib, json, os, sys, tempfile
from psgn_jax.commands.psgn import main
for module in json.loads(sys.argv[1]):
    importlib.import_module(module)
done = []
for arguments in json.loads(sys.argv[2]):
    files = [tempfile.TemporaryFile() for _ in range(2)]
    if os.fork() == 0:
        for stream, file in enumerate(files, 1):
            os.dup2(file.fileno(), stream)
        try:
            sys.argv[1:] = arguments
            code = main()
        except SystemExit as stopped:
            code = stopped.code
        sys.stdout.flush()
        os._exit(code or 0)  # taking the modules down would last longer than the command
    code = os.waitstatus_to_exitcode(os.wait()[1])
    texts = [os.pread(file.fileno(), 10**6, 0).decode() for file in files]
    done.append((arguments, code, *texts))
print(json.dumps(done))
"""


def run(*command, code=0, **options):
    """A command in a process of its own, with its exit code; its output is captured as text."""
    command = [*map(str, command)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, **options)
    assert done.returncode == code, done.stdout + done.stderr
    return done


def python(code, *arguments, cwd=ROOT, **environment):
    """Python code in a process of its own, which must succeed."""
    return _succeeds(["-c", code, *map(str, arguments)], cwd, environment)


def psgn(*arguments, cwd=ROOT, **environment):
    """`psgn ARGUMENTS` in a process of its own, which must succeed."""
    return _succeeds(["-m", "psgn_jax.commands.psgn", *map(str, arguments)], cwd, environment)


def psgn_each(*commands, cwd=ROOT, imports=_USUAL, **environment):
    """`psgn` with each list of arguments; the modules in `imports` are imported only once."""
    commands = [[str(argument) for argument in arguments] for arguments in commands]
    done = python(_EACH, json.dumps(imports), json.dumps(commands), cwd=cwd, **environment)
    return [subprocess.CompletedProcess(*outcome) for outcome in json.loads(done.stdout)]


def _succeeds(arguments, cwd, environment):
    environment = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT), **environment}
    return run(sys.executable, *arguments, cwd=cwd, env=environment)
