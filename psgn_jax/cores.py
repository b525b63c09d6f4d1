"""The number of cores that this process may use, and options of XLA for the processor."""

import functools
import os
import pathlib

import jax


def num_cores() -> int:
    """Number of cores; on Linux, those of the process's affinity."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def compiler_options() -> dict[str, int] | None:
    """Options for `jax.jit` of programs with long loops over points; None = XLA's defaults.

    On a processor with AVX-512, XLA uses half of its vector width by default, because many older
    processors lower their clock rate otherwise. With the full width, a step of the EMD and CD with
    the network of `authors_small.py` takes .161 s of CPU time instead of .178 (16 samples, one
    core). The option is set only if the processor has AVX-512 with bfloat16, which most older ones
    lack.
    """
    if jax.default_backend() != "cpu" or "avx512_bf16" not in _flags():
        return None
    return {"xla_cpu_prefer_vector_width": 512}


@functools.cache
def _flags() -> frozenset[str]:
    """The processor's features, as Linux names them; empty on other systems."""
    try:
        text = pathlib.Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        return frozenset()
    lines = (line.partition(":") for line in text.splitlines())
    return frozenset(next((v for k, _, v in lines if k.strip() == "flags"), "").split())
