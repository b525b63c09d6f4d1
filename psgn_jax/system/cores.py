"""The number of cores that this process may use, and options of XLA for the processor."""

import os
import pathlib


def num_cores() -> int:
    """Number of cores; on Linux, those of the process's affinity."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def compiler_options() -> dict[str, int] | None:
    """Options for `jax.jit` of programs with long loops over points; None = XLA's defaults.

    With AVX-512, XLA uses half of the vector width, because many older processors lower their clock
    rate otherwise. With the full width, a step of the EMD and CD with the network of
    `authors_small.py` takes .161 s of CPU time instead of .178 (16 samples, one core). We set it
    only where there is AVX-512 with bfloat16, which most older processors lack.
    """
    import jax  # imported here, because `command_line` uses this module before JAX is loaded

    if jax.default_backend() != "cpu" or "avx512_bf16" not in features_line().split():
        return None
    return {"xla_cpu_prefer_vector_width": 512}


def features_line() -> str:
    """The line of the processor's features in Linux's /proc/cpuinfo; "" on other systems."""
    try:
        text = pathlib.Path("/proc/cpuinfo").read_text()
    except OSError:
        return ""
    return next((x for x in text.splitlines() if x.startswith(("flags", "Feat"))), "")
