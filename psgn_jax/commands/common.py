"""Flags that several commands have, and the compilation cache."""

import contextlib
import functools
import os
import pathlib
import platform
import re
import warnings
import zlib
from collections.abc import Callable, Iterator
from typing import Any

from absl import logging

from psgn_jax.config.command_line import Flags
from psgn_jax.config.structured import ConfigError
from psgn_jax.system import distributed
from psgn_jax.system.cores import num_cores
from psgn_jax.system.cpu import features_line
from psgn_jax.system.errors import UserError
from psgn_jax.system.files import cache_folder, check_folder
from psgn_jax.system.untrusted import message_line, refuse_special_files


def define_network_flags(flags: Flags) -> None:
    """The flags of a network, for `network_of`."""
    flags.path("workdir", None, "Folder of a run, instead of weights.")
    flags.path("weights", None, "Name or file of weights; default: the package's.")
    flags.enum("checkpoint", "best", ["best", "last"], "Checkpoint of the run.")


def network_of(values: Any) -> dict[str, Any]:
    """The arguments of `weights.opening.open_weights` for the network that the flags name."""
    if values.workdir and values.weights:
        raise ConfigError(f"weights={values.weights}: accepted only without a run")
    return {
        "source": values.workdir or values.weights or "",
        "checkpoint": values.checkpoint,
        "argument": "workdir" if values.workdir else "weights",
    }


def define_process_flags(flags: Flags) -> None:
    """Flags of a process that shares the work with others, for `joined`."""
    flags.string("coordinator", None, "HOST:PORT of the first of several processes.")
    flags.integer("num_processes", None, "Number of processes that share the work.")
    flags.integer("process_id", None, "Index of this process, from 0.")


@contextlib.contextmanager
def joined(values: Any, batch_size: int) -> Iterator[bool]:
    """`system.distributed.joined` by flags; processes that are not the first one log only warnings.

    A process that works alone uses its cores as devices, if they divide the batch.
    """
    processes = values.coordinator, values.num_processes, values.process_id
    if not distributed.is_one_of_several(*processes):
        use_cores(batch_size)
    with distributed.joined(*processes) as first:
        if not first:
            logging.set_verbosity(logging.WARNING)
        yield first


def use_cores(batch_size: int) -> None:
    """Makes one CPU device of JAX for each core: at most four, and a number that divides the batch.

    The devices compute their shares of a batch at the same time. On one device, XLA computes the
    losses of the pairs one after another. It changes nothing if JAX has computed already, or if
    the number of devices is chosen by JAX_NUM_CPU_DEVICES or XLA_FLAGS.
    """
    import jax  # imported here so that wrong flags are reported before JAX is loaded

    chosen = "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", "")
    if not chosen and jax.config.values["jax_num_cpu_devices"] == -1:
        count = max(n for n in range(1, min(num_cores(), 4) + 1) if batch_size % n == 0)
        with contextlib.suppress(RuntimeError):
            jax.config.update("jax_num_cpu_devices", count)


_OF_THE_CACHE = r"Error (reading|writing) persistent compilation cache entry for '(\w+)': (.*)"


def _mend_cache(others: Callable[..., None], message: Any, *details: Any, **options: Any) -> None:
    """Shows a warning; for one about the cache, removes the program's entries and logs one line.

    JAX compiles the program then, but replaces no entry that exists.
    """
    import jax

    found = re.match(_OF_THE_CACHE, str(message), re.DOTALL)
    if found is None:
        others(message, *details, **options)
        return
    what, program, why = found.groups()
    removed = 0
    with contextlib.suppress(OSError):
        folder = pathlib.Path(jax.config.values["jax_compilation_cache_dir"])
        for entry in folder.glob(f"{program}-*-cache"):
            entry.unlink()
            removed += 1
    outcome = "removed, and written again" if removed and what == "reading" else "not kept"
    logging.warning("compiled program %s: %s (%s)", program, outcome, message_line(why)[:200])


def keep_compiled() -> None:
    """Enables JAX's persistent compilation cache in the cache folder, before JAX compiles anything.

    The cache has one folder per type of processor, because a program that was compiled for one may
    not run on another. Without a home, or where the folder cannot be written, nothing is kept.
    Entries that cannot be read, because a disk was full when they were written, are removed.
    """
    import jax  # imported here so that wrong flags are reported before JAX is loaded

    warnings.showwarning = functools.partial(_mend_cache, warnings.showwarning)
    if jax.config.values["jax_compilation_cache_dir"]:
        return
    features = features_line() or platform.processor()
    kind = f"{platform.machine()}-{zlib.crc32(features.encode()):08x}"
    try:
        folder = cache_folder() / "compiled" / kind
        check_folder(folder, "PSGN_CACHE")
        refuse_special_files(folder)
    except (OSError, UserError) as error:
        logging.info("compiled programs are not kept: %s", message_line(error))
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
