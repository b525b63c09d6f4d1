"""Locks of the operating system (`flock`), which end with the process for any reason.

A training locks the folder of its run. Several processes may divide the work of a job: the process
of the first of two parts holds `.work/part-00000-of-00002.lock`. On a network file system without
locks nothing is locked, with a warning.
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
    """Another process does this part of the work, or divides the work into other parts."""


@contextlib.contextmanager
def locked(path: pathlib.Path, *, waiting: str = "") -> Iterator[bool]:
    """Context in which this process holds the lock of a file, which contains its pid.

    The file is created, with its folder, and removed at the end. The context's value is False on a
    file system without locks.

    Args:
      waiting: logged before waiting for another process that holds the lock; "" = raise
        BlockingIOError instead.
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
                    # A child that a killed process was starting holds the lock until its exec.
                    time.sleep(0.5)
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                if error.errno not in _UNSUPPORTED:
                    raise
                logging.warning("%s cannot be locked (%s): start no second process", path, error)
                break
            # The process that held the lock before may have removed the file in between.
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
    """Context that locks part (i, n), number i (from 0) of n, of the work in a folder.

    At its end, an empty folder is removed.

    Raises:
      TakenError: another process does this part, or a process with another n is running.
    """
    number, count = part
    own = folder / f"part-{number:05d}-of-{count:05d}.lock"
    with contextlib.ExitStack() as stack:
        stack.callback(_remove_if_empty, folder)
        try:
            stack.enter_context(locked(own))
        except BlockingIOError:
            raise TakenError(
                f"another process (pid {_read(own) or 'unknown'}) does part {number}/{count} in "
                f"{str(folder.parent)!r}; wait for it, or end it"
            ) from None
        # Two processes with different n that start at the same time may both end here.
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
