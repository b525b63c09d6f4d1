"""Kills of a command at random moments. When it is started again, it must write the same files."""

import contextlib
import dataclasses
import os
import pathlib
import random
import shutil
import signal
import time
from collections.abc import Callable, Mapping, Sequence

from helpers import processes

from campaign import frame
from campaign.forks import Forks

SECONDS = 120
"""How long processes may take to end; one second is enough, unless the machine is busy."""

SENDERS: Mapping[str, Callable[[int, int], None]] = {
    "SIGKILL of the process": os.kill,
    "SIGKILL of the group": os.killpg,
}


def files_of(folder: pathlib.Path) -> dict[str, bytes]:
    """The content of every file in a folder, by path."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {os.path.relpath(path, folder): path.read_bytes() for path in paths}


@dataclasses.dataclass(frozen=True)
class Command:
    """A command that is killed.

    Attributes:
      name: name of the trial.
      words: its arguments for Python; "{out}" is the folder of its results.
      results: returns the contents of that folder, by file, that must be the same after kills.
      codes: exit codes of a complete run.
    """

    name: str
    words: Sequence[str]
    results: Callable[[pathlib.Path], Mapping[str, object]] = files_of
    codes: tuple[int, ...] = (0,)

    def filled(self, out: pathlib.Path) -> list[str]:
        """The arguments for a folder of results."""
        return [word.replace("{out}", str(out)) for word in self.words]


class Killer:
    """Kills one command repeatedly, and counts the trials after which it met the requirements.

    Args:
      command: the command.
      forks: starts the command; None = `frame.started`.
      folder: an empty folder of its own.
    """

    def __init__(
        self,
        command: Command,
        forks: Forks | None,
        folder: pathlib.Path,
        rng: random.Random,
        most: int = 3,
    ) -> None:
        folder.mkdir(parents=True)
        self._command, self._folder, self._rng = command, folder, rng
        self._most = most
        self._start = forks or frame
        self._log = folder / "log"
        self.ends = frame.Finding(f"{command.name} after kills: same bytes, nothing left over")
        self.kills = {
            name: frame.Finding(f"{command.name}, {name}: no process, no shared memory left")
            for name in SENDERS
        }
        self._expected: Mapping[str, object] = {}
        for name in ("whole", "again"):  # the second one finds compiled programs: it is timed
            whole = self._start.run(command.filled(folder / name), self._log)
            results = command.results(folder / name) if whole.code in command.codes else {}
            self._seconds, self.broken = whole.seconds, not results
            if self.broken:
                self.ends.add(f"without a kill: exit code {whole.code}: {whole.text[-1500:]}")
                return
            self._expected = self._expected or results
        if wrong := self._difference(folder / "again"):
            self.broken = True
            self.ends.add(f"without a kill, the second time: {wrong}")

    def try_once(self) -> None:
        """Kills a run several times, lets it end, and compares its results."""
        number = self.ends.tried + 1
        out = self._folder / str(number)
        command = self._command.filled(out)
        for _ in range(self._rng.randint(1, self._most)):
            name = self._rng.choice(list(SENDERS))
            wrong, running = self._kill(command, SENDERS[name])
            if running:
                self.kills[name].add(wrong and f"run {number}: {wrong}")
        ended = self._start.run(command, self._log)
        wrong = ""
        if ended.code not in self._command.codes or "Traceback" in ended.text:
            wrong = f"exit code {ended.code}: {ended.text[-800:]}"
        else:
            wrong = self._difference(out)
        self.ends.add(wrong and f"run {number}: {wrong}")
        if not wrong:
            shutil.rmtree(out)

    def _kill(self, command: list[str], send: Callable[[int, int], None]) -> tuple[str, bool]:
        """Kills a run; returns (what did not hold, whether it was still running when killed)."""
        with self._start.started(command, self._log) as process:
            time.sleep(self._rng.uniform(0, 1.05 * self._seconds))
            running = process.poll() is None
            mapped = processes.shared_memory(process.pid)
            with contextlib.suppress(ProcessLookupError):
                send(process.pid, signal.SIGKILL)
            process.wait(300)
            gone = processes.wait_until(lambda: not processes.of_group(process.pid), SECONDS)
        if not gone:
            return "processes live on", running
        return left_in_memory(mapped), running

    def _difference(self, out: pathlib.Path) -> str:
        have = self._command.results(out)
        if have.keys() != self._expected.keys():
            return f"the files {sorted(have)}, expected {sorted(self._expected)}"
        wrong = [name for name, content in self._expected.items() if have[name] != content]
        return f"{wrong[0]} differs" if wrong else ""

    def findings(self) -> list[frame.Finding]:
        """All findings."""
        return [self.ends, *(finding for finding in self.kills.values() if finding.tried)]


def left_in_memory(mapped: set[str]) -> str:
    """Files that are left in /dev/shm some time after the end of the last process."""
    paths = [pathlib.Path("/dev/shm", name) for name in mapped]
    if processes.wait_until(lambda: not any(path.exists() for path in paths), SECONDS):
        return ""
    return f"{sum(path.exists() for path in paths)} files in /dev/shm"


def kill_all(killers: Sequence[Killer], deadline: float) -> list[frame.Finding]:
    """Kills the commands in turn until the deadline, each at least once."""
    sound = [killer for killer in killers if not killer.broken]
    once = False
    while sound and (not once or time.monotonic() < deadline):
        for killer in sound:
            if not once or time.monotonic() < deadline:
                killer.try_once()
        once = True
    return [finding for killer in killers for finding in killer.findings()]
