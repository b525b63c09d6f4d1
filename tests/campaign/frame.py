"""Code that the parts of the campaign share: findings, the list of parts, the table.

A part is a file of this folder with a function

    def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[Finding]

Parts import this module as `campaign.frame`, and the tests' helpers as `helpers`, because `tests`
is on the path. A part repeats its trials until `time.monotonic()` reaches `deadline`; each kind of
trial is made at least once. It writes only below `folder`, which is empty and used by no other
part. All random choices come from `rng`; docs/reliability.md says which trials the same seed
repeats.
"""

import contextlib
import dataclasses
import importlib
import json
import os
import pathlib
import random
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Any

ROOT = pathlib.Path(__file__).resolve().parents[2]
_FRAME = ("__init__", "__main__", "frame")


@dataclasses.dataclass
class Finding:
    """The number of trials of one kind, and after how many of them all requirements were met.

    Attributes:
      kind: the trial and the requirement, such as "SIGKILL in training: same bits".
      tried: number of trials.
      held: number of trials after which all requirements were met.
      details: one line for each trial that did not hold, with what is needed to repeat it.
    """

    kind: str
    tried: int = 0
    held: int = 0
    details: list[str] = dataclasses.field(default_factory=list)

    def add(self, wrong: str = "") -> None:
        """Counts one trial; `wrong` says what did not hold, "" = everything held."""
        self.tried += 1
        if wrong:
            self.details.append(" ".join(wrong.split())[:2000])
        else:
            self.held += 1


Part = Callable[[random.Random, float, pathlib.Path], list[Finding]]


def parts() -> dict[str, Part]:
    """Name -> part, for every file of this folder that has one."""
    names = sorted(p.stem for p in pathlib.Path(__file__).parent.glob("*.py"))
    modules = {n: importlib.import_module(f"campaign.{n}") for n in names if n not in _FRAME}
    return {name: module.part for name, module in modules.items() if hasattr(module, "part")}


def run_part(name: str, part: Part, seed: int, minutes: float, folder: pathlib.Path) -> str:
    """Runs one part, writes `<name>.json` into `folder` and returns its rows of the table.

    If a part raises an exception, the exception is a finding that did not hold.
    """
    own = folder / name
    own.mkdir(parents=True)
    began = time.monotonic()
    try:
        findings = part(random.Random(f"{seed} {name}"), began + 60 * minutes, own)
    except Exception:
        findings = [Finding("the part itself", 1, 0, [traceback.format_exc()])]
    document = {
        "part": name,
        "seed": seed,
        "seconds": round(time.monotonic() - began, 1),
        "findings": [dataclasses.asdict(finding) for finding in findings],
    }
    (folder / f"{name}.json").write_text(json.dumps(document, indent=1) + "\n")
    return "".join(f"| {name} | {f.kind} | {f.tried} | {f.held} |\n" for f in findings)


TABLE_HEAD = "| part | what was tried, what must hold | tried | held |\n|---|---|---|---|\n"


def all_held(folder: pathlib.Path) -> bool:
    """Whether everything in the JSON files of `folder` was tried and held."""
    findings = [f for p in folder.glob("*.json") for f in json.loads(p.read_text())["findings"]]
    return bool(findings) and all(0 < f["tried"] == f["held"] for f in findings)


# Tools of the parts.


@dataclasses.dataclass(frozen=True)
class Ended:
    """A command that has ended.

    Attributes:
      code: the exit code, minus the signal if it was killed.
      text: the output.
      seconds: how long it ran.
      memory: its largest resident memory in bytes; 0 = not measured.
    """

    code: int
    text: str
    seconds: float
    memory: int = 0


def environment(**variables: str) -> dict[str, str]:
    """The environment of commands: imports come from this repository first, JAX uses the CPU."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"PYTHONPATH": path, "JAX_PLATFORMS": "cpu"} | variables


@contextlib.contextmanager
def started(
    command: Sequence[str], log: pathlib.Path, **variables: str
) -> Iterator[subprocess.Popen[bytes]]:
    """Runs `python COMMAND` as the leader of a process group of its own, its output in `log`.

    No process of the group is left after the block.
    """
    with open(log, "ab") as file:
        process = subprocess.Popen(
            [sys.executable, *command],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=environment(**variables),
            cwd=ROOT,
            start_new_session=True,
        )
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def run(command: Sequence[str], log: pathlib.Path, timeout: float = 600, **variables: str) -> Ended:
    """Runs `python COMMAND` to its end; a command that takes too long has the exit code 124."""
    return ended(started(command, log, **variables), log, timeout)


def ended(process: Any, log: pathlib.Path, timeout: float) -> Ended:
    """Waits for the end of a command, given the context that starts it."""
    began, before = time.monotonic(), log.stat().st_size if log.exists() else 0
    with process as running:
        try:
            code = running.wait(timeout)
        except subprocess.TimeoutExpired:
            code = 124
    text = log.read_bytes()[before:].decode(errors="replace")
    return Ended(code, text, time.monotonic() - began, getattr(running, "memory", 0))


def not_one_line(ended: Ended, code: int = 2) -> str:
    """What is wrong with a command that should have ended with `code` and one line of error."""
    errors = [line for line in ended.text.splitlines() if line.startswith("error: ")]
    if ended.code != code:
        return f"exit code {ended.code}, expected {code}: {ended.text[-300:]}"
    if "Traceback" in ended.text:
        return f"a traceback: {ended.text[-300:]}"
    if len(errors) != 1:
        return f"{len(errors)} lines of error: {ended.text[-300:]}"
    return ""
