"""File locks (`flock`), which the operating system releases when the process ends.

A training locks the folder of its run. If several processes divide the work of a job, each locks
its part, such as `.work/part-00000-of-00002.lock`. On a file system without locks, a warning says
that nothing is locked.
"""

import contextlib
import errno
import fcntl
import os
import pathlib
import time
from collections.abc import Iterator

from absl import logging

_UNSUPPORTED = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)


class TakenError(ValueError):
    """Another process works on this part, or the work is divided into another number of parts."""


@contextlib.contextmanager
def locked(path: pathlib.Path, *, waiting: str = "") -> Iterator[bool]:
    """Context that creates a file with this process's pid, locks it, and removes it at the end.

    The context's value is False on a file system without locks.

    Args:
      waiting: a message to log before waiting for another process's lock; "" = raise
        BlockingIOError instead of waiting.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        held = False
        while not held:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            file = stack.enter_context(os.fdopen(descriptor, "w"))
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if waiting:
                    logging.info("%s", waiting)
                    fcntl.flock(file, fcntl.LOCK_EX)
                else:
                    # A killed process's child may hold the lock until its exec.
                    time.sleep(0.5)
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                if error.errno not in _UNSUPPORTED:
                    raise
                logging.warning("%s cannot be locked (%s): start no second process", path, error)
                break
            # The previous holder may have removed the file in the meantime.
            with contextlib.suppress(FileNotFoundError):
                held = os.fstat(descriptor).st_ino == path.stat().st_ino
        if held:
            stack.callback(path.unlink, missing_ok=True)
            file.truncate(0)
            file.write(f"{os.getpid()}\n")
            file.flush()
        yield held


@contextlib.contextmanager
def lock_part(folder: pathlib.Path, part: tuple[int, int]) -> Iterator[None]:
    """Context that locks part (i, n), i from 0, of the work in a folder.

    At its end, an empty folder is removed.

    Raises:
      TakenError: another process works on this part, or with another n.
    """
    number, count = part
    path = folder / f"part-{number:05d}-of-{count:05d}.lock"
    with contextlib.ExitStack() as stack:
        stack.callback(_remove_if_empty, folder)
        try:
            stack.enter_context(locked(path))
        except BlockingIOError:
            raise TakenError(
                f"another process (pid {_read(path) or 'unknown'}) does part {number}/{count} in "
                f"{str(folder.parent)!r}; wait for it, or end it"
            ) from None
        # If two processes with different n start at the same time, both may raise here.
        for other in folder.glob("part-*-of-*.lock"):
            said = int(other.stem.rpartition("-")[2])
            try:
                if said != count:
                    with locked(other):  # removes the file of a process that has ended
                        pass
            except BlockingIOError:
                raise TakenError(
                    f"other processes divide the work in {str(folder.parent)!r} into {said} parts, "
                    f"not {count}; wait for them, or end them"
                ) from None
        yield


def _remove_if_empty(folder: pathlib.Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def _read(path: pathlib.Path) -> str:
    with contextlib.suppress(OSError):
        return path.read_bytes()[:20].decode("ascii", "replace").strip()
    return ""
