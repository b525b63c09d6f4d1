"""Trainings that are killed at random moments, with and without worker processes.

A run that was killed and resumed must end with the same bits as an undisturbed one. Neither a
process nor a file in /dev/shm may be left. After a signal to the whole group, the trainer must end
with the exit code of the signal and one line.
"""

import contextlib
import os
import pathlib
import random
import shutil
import signal
import time

from helpers import processes

from campaign import frame, kills, runs
from campaign.forks import TRAINING, Forks

KILLS = {
    "SIGKILL of the trainer": (signal.SIGKILL, os.kill, {-signal.SIGKILL}),
    "SIGKILL of the group": (signal.SIGKILL, os.killpg, {-signal.SIGKILL}),
    "SIGTERM to the group": (signal.SIGTERM, os.killpg, {143, -signal.SIGTERM}),
    "SIGINT to the group": (signal.SIGINT, os.killpg, {130, -signal.SIGINT}),
}
SHARES = (4, 3, 1, 1)
MOMENTS = ("starting", "working", "working", "working")
SECONDS_TO_START = 2.0
FROM_SCRATCH = 0.05
"""Share of the kills in which the process is not forked, so that it imports its modules itself."""
WITH_WORKERS = 0.3


def _wait(moment: str, rng: random.Random, process, workdir: pathlib.Path, before: int) -> None:
    """Waits for a moment of a training: while it starts, or some time after a checkpoint."""
    if moment == "starting":
        time.sleep(rng.uniform(0, SECONDS_TO_START))
        return
    processes.wait_until(
        lambda: runs.newest(workdir) > before or process.poll() is not None, seconds=300
    )
    time.sleep(rng.uniform(0, 0.3))


def _kill(rng, started, workdir, log, name: str) -> tuple[str, bool]:
    """Starts a training and kills it; returns (what did not hold, whether it was killed)."""
    number, send, codes = KILLS[name]
    moment = rng.choice(MOMENTS)
    start = log.stat().st_size if log.exists() else 0
    before = runs.newest(workdir)
    with started as process:
        _wait(moment, rng, process, workdir, before)
        files = processes.shared_memory(process.pid)
        with contextlib.suppress(ProcessLookupError):
            send(process.pid, number)
        code = process.wait(300)
        ended = processes.wait_until(lambda: not processes.of_group(process.pid), kills.SECONDS)
    if not ended:
        return f"{name} while {moment}: processes live on", True
    if left := kills.left_in_memory(files):
        return f"{name} while {moment}: {left}", True
    if code == 0:
        return "", False
    text = log.read_bytes()[start:].decode(errors="replace")
    # In the first second Python's own handlers are active, which print a traceback.
    if code not in codes or ("Traceback" in text and code > 0):
        return f"{name} while {moment}: exit code {code}: {text[-500:]}", True
    return "", True


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[frame.Finding]:
    """The part of the campaign; see the module."""
    records = runs.make_records(folder / "records")
    log, reference = folder / "log", folder / "reference"
    quick = runs.quick(folder)
    findings = {
        (name, workers): frame.Finding(f"{name}, {workers} workers: no process, no memory left")
        for name in KILLS
        for workers in (0, 2)
    }
    ends = frame.Finding("a training after kills: same bits as undisturbed")
    with Forks(TRAINING, **quick) as forks:
        ended = forks.run(runs.training(records, reference), log)
        if ended.code:
            return [frame.Finding("an undisturbed training", 1, 0, [ended.text[-2000:]])]
        number = 0
        while not number or time.monotonic() < deadline:
            number += 1
            workdir = folder / f"run{number}"
            for _ in range(rng.randint(1, 5)):
                workers = 2 if rng.random() < WITH_WORKERS else 0
                (name,) = rng.choices(list(KILLS), SHARES)
                command = runs.training(records, workdir, workers)
                if rng.random() < FROM_SCRATCH:
                    started = frame.started(command, log, **quick)
                else:
                    started = forks.started(command, log)
                wrong, killed = _kill(rng, started, workdir, log, name)
                if killed:
                    findings[name, workers].add(wrong and f"run {number}: {wrong}")
            ended = forks.run(runs.training(records, workdir), log)
            wrong = runs.difference(workdir, reference) if not ended.code else ended.text[-500:]
            if left := [p.name for p in workdir.rglob("*tmp*")]:
                wrong = wrong or f"left behind: {left}"
            ends.add(wrong and f"run {number}: {wrong}")
            if not wrong:
                shutil.rmtree(workdir)
    return [ends, *(finding for finding in findings.values() if finding.tried)]
