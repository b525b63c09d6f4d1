"""Simulates a full disk: files cannot grow beyond a given size."""

import contextlib
import resource


@contextlib.contextmanager
def without_room(largest=1000):
    """Writes of this process fail if they would make a file larger than `largest` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
