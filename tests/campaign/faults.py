"""Faults at every file operation of a checkpoint, a result, a data set and a manifest.

Each operation is made to fail in turn: by EIO, by a disk that is full from then on, by an
incomplete write, and by the end of the process after the operation. Everything that was finished
before must still exist, bit for bit. Everything that exists after the fault must be correct. The
same command must then succeed.
"""

import contextlib
import errno
import json
import pathlib
import random
import shutil
import subprocess
import sys
import time

import numpy as np

from campaign import fault_server, frame
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.schema import RecordError
from psgn_jax.training.checkpoint import Checkpoints
from psgn_jax.training.log import read_metrics

KINDS = {
    "EIO": ("e", errno.EIO),
    "no room": ("f", errno.ENOSPC),
    "short write": ("s", 0),
    "kill": ("k", 0),
}


class Server:
    """The process that runs the trials, see `fault_server`."""

    def __init__(self, folder: pathlib.Path) -> None:
        library = folder / "faults.so"
        source = pathlib.Path(__file__).with_name("faults.c")
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
        self.log = folder / "log"
        self._process = subprocess.Popen(
            [sys.executable, "-m", "campaign.fault_server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=frame.environment(LD_PRELOAD=str(library)),
            cwd=frame.ROOT,
            text=True,
        )

    def run(self, writer: str, folder: pathlib.Path, step: int, kind="n", error=0, at=0):
        """Runs a writer; returns (exit code, operations, what it printed)."""
        trial = {"writer": writer, "folder": str(folder), "step": step, "log": str(self.log)}
        trial |= {"kind": kind, "error": error, "at": at}
        self._process.stdin.write(json.dumps(trial) + "\n")
        self._process.stdin.flush()
        answer = json.loads(self._process.stdout.readline())
        return answer["code"], answer["operations"], self.log.read_text(errors="replace")

    def close(self) -> None:
        """Ends the process."""
        self._process.stdin.close()
        self._process.wait()


def check_checkpoint(folder: pathlib.Path, done: int) -> str:
    """What is wrong with the checkpoints of a folder; that of step `done` was finished before."""
    found = Checkpoints(folder / "checkpoints", read_only=True).restore_newest()
    if found is None or found.step < done:
        return f"the checkpoint of step {done} is lost: {found and found.step}"
    for name, leaf in fault_server.leaves(found.step).items():
        if not np.array_equal(found.leaves[name], leaf):
            return f"{name} of step {found.step} is wrong"
    for entry in read_metrics(folder / "metrics.jsonl"):
        if entry != {"step": entry["step"], "kind": "eval", "cd_sq_radius2": 1 / entry["step"]}:
            return f"a wrong line of metrics: {entry}"
    return ""


def check_result(folder: pathlib.Path, done: int) -> str:
    """What is wrong with a file of results."""
    table = json.loads((folder / "table.json").read_text())
    return "" if table["step"] >= done and len(table["rows"]) == 20 else f"wrong: {table['step']}"


def check_records(folder: pathlib.Path, done: int) -> str:
    """What is wrong with a data set that is being replaced: it must be complete or refused."""
    try:
        reader = RecordReader(folder / "records", "train")
        reader.verify()
        list(reader)
    except RecordError as error:
        # While it is replaced, it may contain shards of the old and of the new data set. It must
        # then be refused.
        return "" if done == 1 else f"the finished data set is refused: {error}"
    return ""


def check_manifest(folder: pathlib.Path, done: int) -> str:
    """What is wrong with a data set of `done` shards, or `done` + 1 if one has been added."""
    reader = RecordReader(folder / "extended", "train")
    reader.verify()
    count = len(list(reader))
    return "" if done <= count <= 2 else f"{count} records, expected {done} or more"


CHECKS = {
    "checkpoint": check_checkpoint,
    "result": check_result,
    "records": check_records,
    "manifest": check_manifest,
}


def _trial(
    server: Server, writer: str, name: str, at: int, base: pathlib.Path, folder: pathlib.Path
) -> str:
    """Makes one fault in a copy of `base`, where step 1 is finished; returns what did not hold."""
    kind, error = KINDS[name]
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(base, folder)
    code, _, text = server.run(writer, folder, 2, kind, error, at)
    where = f"{writer}, {name} at operation {at}: "
    # Tensorstore treats an incomplete write as a full disk.
    expected = {"EIO": {0, 2}, "no room": {0, 5}, "short write": {0, 5}, "kill": {-9, 0}}[name]
    if code not in expected:
        return f"{where}exit code {code}: {text[-600:]}"
    if "Traceback" in text:
        return f"{where}a traceback: {text[-600:]}"
    if wrong := CHECKS[writer](folder, 2 if code == 0 and kind != "k" else 1):
        return where + wrong
    code, _, text = server.run(writer, folder, 2)
    if code:
        return f"{where}the next start: exit code {code}: {text[-600:]}"
    if wrong := CHECKS[writer](folder, 2):
        return f"{where}after the next start: {wrong}"
    # The temporary file of a result may remain: the next start does not remove the temporary files
    # of other processes.
    left = [p.name for p in folder.rglob("*") if "tmp" in p.name and writer != "result"]
    return f"{where}left behind: {left}" if left else ""


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[frame.Finding]:
    """The part of the campaign; see the module."""
    findings = []
    with contextlib.closing(Server(folder)) as server:
        trials = []
        for writer in CHECKS:
            base, second = folder / f"base-{writer}", folder / f"count-{writer}"
            base.mkdir()
            code, _, text = server.run(writer, base, 1)
            if code:
                findings.append(frame.Finding(f"{writer} without a fault", 1, 0, [text[-900:]]))
                continue
            shutil.copytree(base, second)
            _, operations, text = server.run(writer, second, 2)
            for name in KINDS:
                finding = frame.Finding(f"{writer}, {operations} file operations: {name}")
                if not operations:
                    finding.add(f"nothing was counted: {text[-500:]}")
                findings.append(finding)
                trials += [(writer, name, at + 1, finding) for at in range(operations)]
        rng.shuffle(trials)
        for writer, name, at, finding in trials:
            if time.monotonic() > deadline:
                break
            try:
                finding.add(
                    _trial(server, writer, name, at, folder / f"base-{writer}", folder / "trial")
                )
            except Exception as error:
                finding.add(f"{writer}, {name} at operation {at}: {type(error).__name__}: {error}")
    return findings
