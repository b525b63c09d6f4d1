"""Damage to each of the files that a run consists of.

The run is opened as in `evaluate` and `predict`, and its metrics are read as in a resumed
training. Either the run must be refused with an error of one line, or the data must be those that
the training wrote. Only warnings of one line may be logged. In every `RESUMED_EVERY`th trial, the
training is resumed. It must then end with the results of an undamaged run, or be refused with an
error of one line.
"""

import gc
import logging
import pathlib
import random
import shutil
import time

import numpy as np

from campaign import frame, runs
from campaign.forks import TRAINING, Forks
from psgn_jax.command_line import exit_code_of
from psgn_jax.training.log import read_metrics
from psgn_jax.training.run_folder import open_run
from psgn_jax.training.state import params_from_named_leaves

RESUMED_EVERY = 20
KINDS = ("a file of a checkpoint", "another file of a run")
TEXTS = [b"", b"[]", b"null", b'{"a": {}}', b"\xff", b"[" * 100_000, b'{"20": {"iou": "x"}}']


def _flip(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data)) if data else 0
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :] if data else b"x"


DAMAGES = {
    "a bit flipped": _flip,
    "cut off": lambda rng, data: data[: rng.randrange(len(data) + 1)],
    "zeros": lambda rng, data: bytes(len(data)),
    "noise": lambda rng, data: rng.randbytes(rng.randrange(1, 5000)),
    "another text": lambda rng, data: rng.choice(TEXTS),
    "removed": lambda rng, data: None,
}


def _leaves(tree, prefix=""):
    for name, node in tree.items():
        if isinstance(node, dict):
            yield from _leaves(node, f"{prefix}{name}.")
        else:
            yield prefix + name, node


class _Log(logging.Handler):
    """Collects what is logged that is not a warning of one line."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.wrong: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Collects a record."""
        text = record.getMessage()
        if record.exc_info or "\n" in text or record.levelno > logging.WARNING:
            self.wrong.append(f"{record.name} logs {text[:300]}")


def _read(workdir: pathlib.Path, written: dict) -> str:
    """Opens a damaged run; returns what did not hold."""
    read_metrics(workdir / "metrics.jsonl")
    for which in ("best", "last"):
        try:
            run = open_run(workdir, which)
        except (ValueError, OSError) as error:
            if exit_code_of(error) is None or "\n" in str(error):
                return f"{which}: {type(error).__name__}: {error}"
            continue
        if run.step not in written:
            return f"{which}: step {run.step} was never written"
        for name, leaf in _leaves(run.params):
            if not np.array_equal(leaf, written[run.step][name]):
                return f"{which}: {name} of step {run.step} is wrong"
    return ""


def _resume(forks, command, workdir: pathlib.Path, reference: pathlib.Path, log) -> str:
    """Resumes a damaged run; returns what did not hold."""
    ended = forks.run(command, log)
    if ended.code:
        return frame.not_one_line(ended)
    if "Traceback" in ended.text:
        return f"a traceback: {ended.text[-300:]}"
    have, want = runs.last_checkpoint(workdir), runs.last_checkpoint(reference)
    if have.step != want.step:
        return f"it ended at step {have.step}"
    wrong = [n for n, leaf in want.leaves.items() if not np.array_equal(have.leaves[n], leaf)]
    return f"it ended with another {wrong[0]}" if wrong else ""


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[frame.Finding]:
    """The part of the campaign; see the module."""
    records = runs.make_records(folder / "records")
    reference, log = folder / "reference", folder / "log"
    with Forks(TRAINING, **runs.quick(folder)) as forks:
        ended = forks.run(runs.training(records, reference), log)
        if ended.code:
            return [frame.Finding("an undamaged training", 1, 0, [ended.text[-2000:]])]
        return _damage(rng, deadline, folder, records, forks)


def _damage(rng, deadline: float, folder: pathlib.Path, records, forks) -> list[frame.Finding]:
    reference, workdir = folder / "reference", folder / "run"
    checkpoints = runs.Checkpoints(reference / "checkpoints", read_only=True)
    written = {
        step: dict(_leaves(params_from_named_leaves(checkpoints.restore(step).leaves)))
        for step in checkpoints.steps()
    }
    files = sorted(p.relative_to(reference) for p in reference.rglob("*") if p.is_file())
    findings = {
        (kind, name): frame.Finding(f"{kind}: {name}") for kind in KINDS for name in DAMAGES
    }
    resumed = frame.Finding("training again after damage")
    log = _Log()
    logging.getLogger().addHandler(log)
    number = 0
    while number < 20 or time.monotonic() < deadline:
        number += 1
        shutil.rmtree(workdir, ignore_errors=True)
        shutil.copytree(reference, workdir)
        file, name = rng.choice(files), rng.choice(list(DAMAGES))
        content = DAMAGES[name](rng, (workdir / file).read_bytes())
        if content is None:
            (workdir / file).unlink()
        else:
            (workdir / file).write_bytes(content)
        what = f"trial {number}, {file}, {name}: "
        try:
            wrong = _read(workdir, written)
        except Exception as error:
            wrong = f"{type(error).__name__}: {error}"
        gc.collect()  # an exception that nobody has seen is logged when it is freed
        wrong = wrong or "; ".join(log.wrong)
        log.wrong.clear()
        kind = KINDS[file.parts[0] != "checkpoints"]
        findings[kind, name].add(wrong and what + wrong)
        if number % RESUMED_EVERY == 0:
            command = runs.training(records, workdir)
            wrong = _resume(forks, command, workdir, reference, folder / "log")
            resumed.add(wrong and what + wrong)
    logging.getLogger().removeHandler(log)
    return [*findings.values(), resumed]
