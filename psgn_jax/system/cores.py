"""The number of cores that this process may use."""

import os


def num_cores() -> int:
    """Number of cores; on Linux, only cores to which the process is bound."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
