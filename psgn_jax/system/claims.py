"""Locks in a job's folder, so that no two processes do the same part of the work.

`.work/part-00000-of-00002.lock` is held by the process that does the first of two parts. The locks
are those of the operating system (`flock`), which releases them when the process ends for any
reason. On a network file system without locks nothing is claimed.
"""

import contextlib
import errno
import fcntl
import os
import pathlib
from collections.abc import Iterator

from absl import logging

_UNSUPPORTED = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)


class ClaimedError(ValueError):
    """Another process does this part of the work, or divides the work into other parts."""


@contextlib.contextmanager
def claim(folder: pathlib.Path, part: tuple[int, int]) -> Iterator[None]:
    """Context that claims a part of the work in a folder; at its end, an empty folder is removed.

    Args:
      folder: created if missing.
      part: (i, n): number i, counted from 0, of the n parts.

    Raises:
      ClaimedError: another process has claimed this part, or a process with another n is running.
    """
    folder.mkdir(parents=True, exist_ok=True)
    number, count = part
    own = folder / f"part-{number:05d}-of-{count:05d}.lock"
    with contextlib.ExitStack() as stack:
        stack.callback(_remove_if_empty, folder)
        try:
            try:
                descriptor = stack.enter_context(_locked(own))
            except BlockingIOError:
                raise ClaimedError(
                    f"another process (pid {_read(own) or 'unknown'}) does part {number}/{count} "
                    f"in {str(folder.parent)!r}; wait for it, or end it"
                ) from None
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()}\n".encode())
            # Two processes with different n that start at the same time may both end here.
            for other in folder.glob("part-*-of-*.lock"):
                if not other.name.endswith(f"-of-{count:05d}.lock"):
                    _require_free(other, count)
        except OSError as error:
            if error.errno not in _UNSUPPORTED:
                raise
            logging.warning(
                "%s: the file system has no locks; start each part of the job only once", folder
            )
        yield


def _remove_if_empty(folder: pathlib.Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


@contextlib.contextmanager
def _locked(path: pathlib.Path) -> Iterator[int]:
    """Context in which this process holds the lock of a file, which is removed at its end."""
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        with contextlib.ExitStack() as stack:
            stack.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # The process that held the lock before may have removed the file in between.
            with contextlib.suppress(FileNotFoundError):
                if os.fstat(descriptor).st_ino == path.stat().st_ino:
                    stack.callback(path.unlink, missing_ok=True)
                    yield descriptor
                    return


def _require_free(path: pathlib.Path, count: int) -> None:
    """Removes a lock file that no process holds; raises `ClaimedError` if one does."""
    try:
        with _locked(path):
            pass
    except BlockingIOError:
        said = int(path.stem.rpartition("-")[2])
        raise ClaimedError(
            f"other processes divide the work in {str(path.parent.parent)!r} into {said} parts, "
            f"not {count}; wait for them, or end them"
        ) from None


def _read(path: pathlib.Path) -> str:
    with contextlib.suppress(OSError):
        return path.read_bytes()[:20].decode("ascii", "replace").strip()
    return ""
