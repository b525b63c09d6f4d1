"""The memory that this process may use."""

import contextlib
import os
import pathlib

# Limits of a container, in version 2 and 1 of Linux's control groups.
_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


def host_memory() -> int:
    """Bytes of memory of this machine, or of this container if it may use less."""
    found = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    for path in _LIMITS:
        with contextlib.suppress(OSError, ValueError):  # no file, or "max"
            found.append(int(pathlib.Path(path).read_text()))
    return min(found)
