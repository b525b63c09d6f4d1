"""Checkpoints of a run, written in the background; the newest and the best are kept.

The folder `<step>/` contains the arrays of a checkpoint by dotted name, and a JSON item `meta` with
the caller's data and a checksum of every array. `scores.json` contains the metrics of evaluated
checkpoints, and what they measure. Orbax renames a folder when it is complete, so a killed process
leaves no incomplete checkpoint; the checksums detect later damage.

Orbax's `CheckpointManager` does not suffice: it ranks checkpoints only by metrics that are known
when they are saved, returns wrong numbers for a flipped bit, and fails at a damaged checkpoint,
where this module takes an earlier checkpoint.
"""

import contextlib
import json
import math
import pathlib
import re
import shutil
import zlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
import orbax.checkpoint as ocp
from absl import logging

from psgn_jax.system.errors import UserError, is_disk_full, native_error
from psgn_jax.system.files import write_atomic
from psgn_jax.system.untrusted import brief, with_checksum, without_checksum

FORMAT = 1

_STEP = re.compile(r"0|[1-9][0-9]{0,17}")  # names of the folders of checkpoints

RANKING = ("cd_sq_radius2", "one_minus_iou", "log_volume_abs_error")
"""The first of these metrics in its evaluation ranks a checkpoint; lower is better."""


class Checkpoint(NamedTuple):
    """A checkpoint: its step, arrays by dotted name, and the caller's `meta`."""

    step: int
    leaves: dict[str, np.ndarray]
    meta: dict[str, Any]


class CheckpointError(UserError):
    """There is no checkpoint that can be read, or a checkpoint cannot be written."""


class Checkpoints:
    """The checkpoints in a folder, which keeps the `keep` newest and the best.

    With `read_only` nothing in the folder changes, because a training may be running there.
    """

    def __init__(self, directory: str | pathlib.Path, keep: int = 2, *, read_only: bool = False):
        self._directory, self._keep = pathlib.Path(directory).absolute(), keep
        self._read_only = read_only
        self._saver: ocp.AsyncCheckpointer | None = None
        if self._directory.is_dir() and not read_only:
            for pattern in ("*.orbax-checkpoint-tmp*", "*.deleting"):
                for leftover in list(self._directory.glob(pattern)):  # of a process that was killed
                    shutil.rmtree(leftover, ignore_errors=True)
        self.scores, self.measured = _read_scores(self._directory / "scores.json")

    def steps(self) -> list[int]:
        """Steps with a complete checkpoint, oldest first."""
        if not self._directory.is_dir():
            return []
        folders = [p for p in self._directory.iterdir() if _STEP.fullmatch(p.name) and p.is_dir()]
        return sorted(int(p.name) for p in folders)

    def best_step(self) -> int | None:
        """The step with the lowest metric (of ties, the latest), or None."""
        ranked = []
        for step in self.steps():
            scores = self.scores.get(step, {})
            score = next((scores[name] for name in RANKING if name in scores), math.nan)
            ranked += [(score, -step)] if math.isfinite(score) else []
        return -min(ranked)[1] if ranked else None

    def measure(self, what: Mapping[str, Any]) -> bool:
        """States what the next scores measure; returns whether it dropped incomparable scores."""
        changed = ", ".join(name for name in what if self.measured.get(name) != what[name])
        self.measured = dict(what)
        if forgotten := bool(changed and self.scores):
            logging.warning(
                "the evaluation has changed (%s): the scores so far are forgotten, and the best "
                "checkpoint so far is no longer kept", changed,
            )  # fmt: skip
            self.scores = {}
        return forgotten

    def score(self, step: int, metrics: Mapping[str, float]) -> None:
        steps = {step, *self.steps()}
        self.scores = {s: m for s, m in self.scores.items() if s in steps} | {step: dict(metrics)}
        content = {"measured": self.measured, **{str(s): m for s, m in self.scores.items()}}
        text = json.dumps(with_checksum(content), indent=1) + "\n"
        write_atomic(self._directory / "scores.json", text)
        if self._saver is None:  # otherwise `wait` does it
            self._delete_others()

    def save(self, step: int, leaves: Mapping[str, Any], meta: Mapping[str, Any]) -> None:
        """Copies the arrays to the host, waits for the previous save and writes in the background.

        This or the next call raises `OSError` for a full disk, else `CheckpointError`.
        """
        self.wait()
        # A copy, because the caller donates the buffers while the writer still reads them.
        arrays = {name: np.array(leaf, copy=True) for name, leaf in leaves.items()}
        document = {
            "format": FORMAT,
            "step": step,
            "meta": dict(meta),
            "leaves": {
                name: {"shape": list(a.shape), "dtype": a.dtype.name, "crc32": _checksum(a)}
                for name, a in arrays.items()
            },
        }
        items = ocp.args.Composite(
            state=ocp.args.StandardSave(arrays), meta=ocp.args.JsonSave(with_checksum(document))
        )
        self._saver = self._saver or _of_this_process(ocp.AsyncCheckpointer)
        with _writing(self._directory):
            self._directory.mkdir(parents=True, exist_ok=True)
            self._saver.save(self._directory / str(step), args=items)

    def restore_newest(self, *, best_first: bool = False) -> Checkpoint | None:
        """The newest intact checkpoint, or None if there is no checkpoint.

        With `best_first`, it is the best checkpoint, if intact. Damaged checkpoints are skipped
        with a warning, and moved to `damaged/` unless read-only. `CheckpointError` if no checkpoint
        can be read (then none is moved, because the cause is probably the disk or a permission), if
        a later version of this package wrote it, or if its folder has the name of another step.
        """
        steps, best = self.steps()[::-1], self.best_step()
        if best_first:
            steps.sort(key=lambda step: step != best)
        unreadable: list[tuple[int, Exception]] = []
        for step in steps:
            try:
                checkpoint = self._read(step)
            except CheckpointError:  # a later version, or another step
                raise
            except Exception as error:  # unreadable files raise errors of many types
                unreadable.append((step, error))
                continue
            for newer, why in unreadable:
                self._set_aside(newer, why)
            return checkpoint
        if unreadable:
            step, why = unreadable[0]
            raise CheckpointError(
                f"none of the {len(unreadable)} checkpoints in {self._directory} can be read "
                f"(step {step}: {brief(why)}); remove the cause, or move the folder away to "
                "start over"
            )
        return None

    def _read(self, step: int) -> Checkpoint:
        folder = self._directory / str(step)
        reader = _of_this_process(ocp.Checkpointer)
        try:
            items = ocp.args.Composite(meta=ocp.args.JsonRestore())
            document = without_checksum(reader.restore(folder, args=items).meta)
            if document["format"] != FORMAT:
                raise CheckpointError(
                    f"{folder} was made by a later version of psgn_jax: its format is "
                    f"{document['format']}, this version reads {FORMAT}; use a newer psgn_jax"
                )
            if (found := document["step"]) != step:
                remedy = f"rename the folder to {found}, or remove it"
                raise CheckpointError(f"{folder} has the checkpoint of step {found}; {remedy}")
            if not isinstance(document["meta"], dict):
                raise ValueError("its meta is not an object")
            template = {
                name: np.zeros(leaf["shape"], leaf["dtype"])
                for name, leaf in document["leaves"].items()
            }
            items = ocp.args.Composite(state=ocp.args.StandardRestore(template))
            restored = reader.restore(folder, args=items).state
        finally:
            reader.close()
        leaves = {name: np.asarray(restored[name]) for name in template}
        for name, leaf in leaves.items():
            if _checksum(leaf) != document["leaves"][name]["crc32"]:
                raise ValueError(f"the checksum of {name} does not match")
        return Checkpoint(step, leaves, document["meta"])

    def wait(self) -> None:
        """Waits for the last save, then deletes checkpoints that are not kept."""
        if self._saver is None:
            return
        with _writing(self._directory):
            self._saver.wait_until_finished()
        self._delete_others()

    def _delete_others(self) -> None:
        steps = self.steps()
        kept = {*steps[-self._keep :], self.best_step()}
        for step in steps:
            if step not in kept:
                # Renamed first, so that a kill leaves no incomplete checkpoint under its name.
                doomed = self._directory / f"{step}.deleting"
                (self._directory / str(step)).rename(doomed)
                shutil.rmtree(doomed, ignore_errors=True)

    def close(self) -> None:
        """Waits for the last save and releases the threads."""
        try:
            self.wait()
        finally:
            saver, self._saver = self._saver, None
            if saver is not None:
                with _writing(self._directory):
                    saver.close()

    def _set_aside(self, step: int, error: Exception) -> None:
        target = self._directory / "damaged" / str(step)
        done = "skipped" if self._read_only else f"moved to {target}"
        logging.warning("checkpoint %d is damaged (%s); %s", step, brief(error), done)
        if not self._read_only:
            self.scores.pop(step, None)
            target.parent.mkdir(exist_ok=True)
            shutil.rmtree(target, ignore_errors=True)
            (self._directory / str(step)).rename(target)


def _of_this_process(kind: Callable[..., Any]) -> Any:
    """A checkpointer of orbax that does not wait for the training's other processes."""
    alone = ocp.options.MultiprocessingOptions()
    if jax.process_count() > 1:
        index = jax.process_index()
        alone = ocp.options.MultiprocessingOptions(
            primary_host=index, active_processes={index}, barrier_sync_key_prefix=f"process{index}"
        )
    options = ocp.CompositeOptions(multiprocessing_options=alone)
    handler = ocp.CompositeCheckpointHandler(composite_options=options)
    return kind(handler, multiprocessing_options=alone)


def _read_scores(path: pathlib.Path) -> tuple[dict[int, dict[str, float]], dict[str, Any]]:
    """Step -> metrics, and what they measure; empty, with a warning, if the file is damaged."""
    try:
        raw = without_checksum(json.loads(path.read_text("utf-8")))
        measured = dict(raw.pop("measured", {}))
        return {int(s): {k: float(v) for k, v in one.items()} for s, one in raw.items()}, measured
    except FileNotFoundError:
        return {}, {}
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        logging.warning("%s is damaged (%s): the best checkpoint is unknown", path, brief(error))
        return {}, {}


@contextlib.contextmanager
def _writing(folder: pathlib.Path) -> Iterator[None]:
    """Turns orbax's errors into `OSError` for a full disk, or into `CheckpointError`."""
    try:
        yield
    except Exception as error:
        if is_disk_full(known := native_error(error, folder)):
            raise known from error
        what = f"the checkpoint in {folder} could not be written: {brief(error)}"
        raise CheckpointError(what) from error


def _checksum(array: np.ndarray) -> int:
    return zlib.crc32(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
