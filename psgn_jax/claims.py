"""Locks in a job's folder, so that no two processes do the same part of the work.

    .work/parts.lock       held by all processes; contains the number of parts of the work
    .work/part-00000.lock  held by the process that does the first part

The locks are those of the operating system (`flock`), which releases them when the process ends for
any reason. On a network file system without locks nothing is claimed.
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
    files = folder / "parts.lock", folder / f"part-{number:05d}.lock"
    held: list[int] = []
    try:
        try:
            held.append(_join(files[0], count))
            held.append(_open_locked(files[1], fcntl.LOCK_EX))
            _write(held[-1], f"{os.getpid()}\n")
        except BlockingIOError:
            raise ClaimedError(
                f"another process (pid {_read(files[1]) or 'unknown'}) does part {number}/{count} "
                f"in {str(folder.parent)!r}; wait for it, or end it"
            ) from None
        except OSError as error:
            if error.errno not in _UNSUPPORTED:
                raise
            logging.warning(
                "%s: the file system has no locks; start each part of the job only once", folder
            )
        yield
    finally:
        for path, descriptor in zip(reversed(files), reversed(held), strict=False):
            _leave(path, descriptor)
        with contextlib.suppress(OSError):
            folder.rmdir()


def _join(path: pathlib.Path, count: int) -> int:
    """Joins the processes of the folder; the first one writes the number of parts."""
    try:
        descriptor = _open_locked(path, fcntl.LOCK_EX)
    except BlockingIOError:
        descriptor = _open_locked(path, fcntl.LOCK_SH, wait=True)
    else:
        _write(descriptor, f"{count}\n")
        # Between releasing the exclusive lock and taking the shared one, another process may take
        # the exclusive lock; `flock` waits for it.
        fcntl.flock(descriptor, fcntl.LOCK_SH)
    said = _read(path)
    if said != str(count):
        os.close(descriptor)
        raise ClaimedError(
            f"other processes divide the work in {str(path.parent.parent)!r} into "
            f"{said or 'other'} parts, not {count}; wait for them, or end them"
        )
    return descriptor


def _open_locked(path: pathlib.Path, kind: int, *, wait: bool = False) -> int:
    """Opens and locks a file; a file that was removed in between is opened again."""
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, kind | (0 if wait else fcntl.LOCK_NB))
            with contextlib.suppress(OSError):
                if os.fstat(descriptor).st_ino == path.stat().st_ino:
                    return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _leave(path: pathlib.Path, descriptor: int) -> None:
    """Ends a claim; the last process removes the file."""
    with contextlib.suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(descriptor).st_ino == path.stat().st_ino:
            path.unlink()
    os.close(descriptor)


def _write(descriptor: int, text: str) -> None:
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, text.encode(), 0)


def _read(path: pathlib.Path) -> str:
    try:
        return path.read_bytes()[:20].decode("ascii", "replace").strip()
    except OSError:
        return ""
