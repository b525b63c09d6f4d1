"""The cores of this machine."""

import os


def num_cores() -> int:
    """Number of cores that this process may use (on Linux, its CPU affinity)."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
