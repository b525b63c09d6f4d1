"""Starts commands quickly: forks them from a process that has imported their modules.

A command that is started here skips its imports, which take most of the time of a small command. In
all other respects it is an ordinary process: it leads its own process group, runs the module as
`python -m` does, and Python ends it as usual.
"""

import contextlib
import importlib
import json
import os
import pathlib
import runpy
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

from campaign import frame

TRAINING = (
    "absl.app", "ml_collections.config_flags", "tensorboardX", "jax", "grain", "orbax.checkpoint",
    "psgn_jax.training.loop", "psgn_jax.default_data", "psgn_jax.training.processes",
)  # fmt: skip
"""Modules that a training imports, at its start or later."""


class Forked:
    """A running command; the part of `subprocess.Popen` that the campaign needs."""

    def __init__(self, forks: "Forks", pid: int) -> None:
        self._forks, self.pid = forks, pid
        self._code: int | None = None
        self.memory = 0
        """Largest resident memory in bytes, once it has ended."""

    def poll(self) -> int | None:
        """The exit code, minus the signal if it was killed; None while it runs."""
        if self._code is None and (answer := self._forks.ask({"poll": self.pid})):
            self._code, self.memory = answer
        return self._code

    def wait(self, timeout: float = 600) -> int:
        """Waits for the end; raises `subprocess.TimeoutExpired`."""
        deadline = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(0.01)
        return code


class Forks(contextlib.AbstractContextManager["Forks"]):
    """The process that forks; `started` and `run` are those of `frame`.

    Args:
      modules: the modules that it imports. They may neither start threads nor define flags.
      **variables: environment of all commands.
    """

    def __init__(self, modules: Sequence[str], **variables: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "campaign.forks", *modules],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=frame.environment(**variables),
            cwd=frame.ROOT,
        )

    def __exit__(self, *_: object) -> None:
        """Ends the process."""
        with self._process:  # closes both pipes
            pass

    def ask(self, question: dict) -> Any:
        """Sends a question to the process; returns its answer."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(question).encode() + b"\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError("the process that forks has ended")
        return json.loads(answer)

    @contextlib.contextmanager
    def started(self, command: Sequence[str], log: pathlib.Path) -> Iterator[Forked]:
        """Runs `python COMMAND`; no process of its group is left after the block."""
        pid = self.ask({"command": list(map(str, command)), "log": str(log)})
        process = Forked(self, pid)
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
            process.wait()

    def run(self, command: Sequence[str], log: pathlib.Path, timeout: float = 600) -> frame.Ended:
        """Runs `python COMMAND` to its end; after the timeout, the exit code is 124."""
        return frame.ended(self.started(command, log), log, timeout)


def _become(question: dict) -> list[str]:
    """In the new process: its own group and files; returns the command."""
    log = os.open(question["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for number, file in ((nothing, 0), (log, 1), (log, 2)):
        os.dup2(number, file)
    os.close(log)
    os.close(nothing)
    return question["command"]


def _serve() -> list[str] | None:
    """Answers questions until stdin ends; in a new process returns its command."""
    for line in iter(sys.stdin.buffer.readline, b""):
        question = json.loads(line)
        if "poll" in question:
            pid, status, usage = os.wait4(question["poll"], os.WNOHANG)
            answer = pid and (os.waitstatus_to_exitcode(status), 1024 * usage.ru_maxrss)
        else:
            read, write = os.pipe()
            answer = os.fork()
            if not answer:
                os.close(read)
                os.setsid()
                os.close(write)
                return _become(question)
            os.close(write)
            os.read(read, 1)  # until it leads its group, so that a signal can reach it
            os.close(read)
        os.write(1, json.dumps(answer).encode() + b"\n")
    return None


def main() -> None:
    """Imports the modules, then answers questions."""
    # Printed text must not be mixed with the answers.
    answers = os.dup(1)
    os.dup2(2, 1)
    sys.modules["torch"] = None  # type: ignore[assignment]  # tensorboardX would import it
    for name in sys.argv[1:]:
        importlib.import_module(name)
    os.dup2(answers, 1)
    os.close(answers)
    tasks = len(list(pathlib.Path("/proc/self/task").iterdir()))
    if tasks > 1:
        raise RuntimeError(f"{tasks} threads after the imports: a fork would lose them")
    command = _serve()
    if command is None:
        return
    if command[0] == "-m":
        sys.argv = command[1:]
        runpy.run_module(command[1], run_name="__main__", alter_sys=True)
    else:
        sys.argv = command
        runpy.run_path(command[0], run_name="__main__")


if __name__ == "__main__":
    main()
