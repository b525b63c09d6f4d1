"""Writes a checkpoint, a result or a data set while file operations fail (see `faults.c`).

Reads trials from stdin, one JSON object per line, and answers each with a JSON object on stdout.
Each trial runs in a process that is forked from this one, so that modules are imported only once.
"""

import contextlib
import ctypes
import faulthandler
import importlib
import json
import os
import pathlib
import signal
import sys
import warnings

import numpy as np
from absl import logging

from psgn_jax.command_line import exit_on_user_error
from psgn_jax.data.codec import encode
from psgn_jax.data.dataset import ShardWriter, write_dataset
from psgn_jax.data.manifest import MANIFEST, Manifest, load_manifest, save_manifest
from psgn_jax.files import remove_temporaries, write_atomic
from psgn_jax.training.checkpoint import Checkpoints
from psgn_jax.training.log import MetricsWriter
from psgn_jax.training.run_folder import locked

SECONDS = 300


def leaves(step):
    """Arrays of a checkpoint, which depend only on its step."""
    rng = np.random.default_rng(step)
    return {f"params.layer{n}.kernel": rng.normal(size=(50, n + 1)) for n in range(4)}


def checkpoint(folder, step):
    """Saves the checkpoint of a step with its score and its line of metrics, as a training does."""
    with locked(folder), contextlib.closing(MetricsWriter(folder, step - 1)) as writer:
        checkpoints = Checkpoints(folder / "checkpoints")
        if step not in checkpoints.steps():  # like a training that resumes there
            checkpoints.save(step, leaves(step), {})
            checkpoints.wait()
        writer.scalars(step, "eval", {"cd_sq_radius2": 1 / step})
        checkpoints.score(step, {"cd_sq_radius2": 1 / step})
        checkpoints.close()


def result(folder, step):
    """Writes a file of results."""
    write_atomic(folder / "table.json", json.dumps({"step": step, "rows": ["x" * 1000] * 20}))


def records(folder, step):
    """Writes a data set of two shards."""
    from helpers import drawn_solids

    samples = drawn_solids.samples(4, seed=step, image_size=(24, 32))
    write_dataset(
        folder / "records", {"train": samples}, source="test", records_per_shard=2, overwrite=True
    )


def manifest(folder, step):
    """Extends a data set by a shard, as a rendering does: the manifest is replaced."""
    from helpers import drawn_solids

    target = folder / "extended"
    target.mkdir(exist_ok=True)
    remove_temporaries(target)
    (sample,) = drawn_solids.samples(1, seed=step, image_size=(24, 32))
    with ShardWriter(target, "train", step) as writer:
        writer.write(encode(sample), sample)
    there = load_manifest(target).shards if (target / MANIFEST).exists() else ()
    kept = [shard for shard in there if shard.file != writer.shard.file]
    save_manifest(target, Manifest("test", True, (*kept, writer.shard)))


WRITERS = {"checkpoint": checkpoint, "result": result, "records": records, "manifest": manifest}


def run(trial, faults, answer):
    """In a forked process: runs a writer, then writes the number of operations to the pipe."""
    signal.alarm(SECONDS)
    log = os.open(trial["log"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 1)
    os.dup2(log, 2)
    faulthandler.dump_traceback_later(SECONDS - 2)
    code = 0
    arguments = [ord(trial["kind"]), trial["error"], trial["at"]]
    faults.arm(trial["folder"].encode(), arguments[0], arguments[1], ctypes.c_long(arguments[2]))
    try:
        with exit_on_user_error():
            WRITERS[trial["writer"]](pathlib.Path(trial["folder"]), trial["step"])
    except SystemExit as stopped:
        code = int(stopped.code or 0)
    except BaseException as error:
        import traceback

        traceback.print_exception(error)
        code = 1
    os.write(answer, str(faults.counted()).encode())
    sys.stderr.flush()
    os._exit(code)


def main():
    """Answers trials until stdin ends."""
    warnings.simplefilter("ignore")  # of forks
    logging.use_absl_handler()
    logging.set_verbosity(logging.WARNING)
    sys.modules["torch"] = None  # tensorboardX would import it, which takes two seconds
    importlib.import_module("tensorboardX")
    faults = ctypes.CDLL(os.environ["LD_PRELOAD"])
    faults.counted.restype = ctypes.c_long
    for line in sys.stdin:
        trial = json.loads(line)
        read, answer = os.pipe()
        child = os.fork()
        if not child:
            run(trial, faults, answer)
        os.close(answer)
        _, status = os.waitpid(child, 0)
        operations = os.read(read, 100).decode()
        os.close(read)
        code = os.waitstatus_to_exitcode(status)
        sys.stdout.write(json.dumps({"code": code, "operations": int(operations or 0)}) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
