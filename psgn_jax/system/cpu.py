"""This machine's memory, and settings of the C library and of XLA for programs on a CPU."""

import contextlib
import ctypes
import os
import pathlib
import sys

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
_LARGEST = 2**31 - 1
# Limits of a container, in version 2 and 1 of Linux's control groups.
_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


def keep_freed_memory() -> bool:
    """Makes glibc keep freed memory for this process; returns whether it accepts the settings.

    XLA allocates a program's temporary memory at each call. By default, glibc returns large blocks
    to the operating system, so every call causes a page fault for each 4 KiB. With these settings,
    blocks under 2 GiB come from one heap for all threads, which keeps up to 2 GiB of free memory.
    Trainings process a third more samples per second and take a few percent more memory at most
    (docs/journal.md, "speed on two cores").
    """
    if sys.platform != "linux":
        return False
    library = ctypes.CDLL(None)
    if not hasattr(library, "gnu_get_libc_version"):
        return False
    settings = ((_M_ARENA_MAX, 1), (_M_MMAP_THRESHOLD, _LARGEST), (_M_TRIM_THRESHOLD, _LARGEST))
    return all(library.mallopt(name, value) == 1 for name, value in settings)


def compiler_options() -> dict[str, int] | None:
    """Options for `jax.jit` of programs with long loops over points; None = XLA's defaults.

    With AVX-512, XLA by default uses half of the vector width, because many older processors lower
    their clock rate for the full width. The full width saves a tenth of a training step; we use it
    only on processors with AVX512-BF16, which most older ones lack.
    """
    import jax  # here, because commands use this module before JAX is loaded

    if jax.default_backend() != "cpu" or "avx512_bf16" not in features_line().split():
        return None
    return {"xla_cpu_prefer_vector_width": 512}


def features_line() -> str:
    """The processor's features, a line of /proc/cpuinfo on Linux; "" on other systems."""
    try:
        text = pathlib.Path("/proc/cpuinfo").read_text()
    except OSError:
        return ""
    return next((x for x in text.splitlines() if x.startswith(("flags", "Feat"))), "")


def host_memory() -> int:
    """Bytes of memory of this machine, or the limit of this container if that is lower."""
    found = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    for path in _LIMITS:
        with contextlib.suppress(OSError, ValueError):  # no file, or "max"
            found.append(int(pathlib.Path(path).read_text()))
    return min(found)
