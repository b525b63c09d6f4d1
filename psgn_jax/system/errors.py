"""Errors that a user can fix, and the exit codes of all commands."""

import enum
import errno
import os
import pathlib
import signal

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


class Exit(enum.IntEnum):
    """Exit codes; for a signal 128 + its number, as in shells."""

    DONE = 0
    PARTLY = 1  # done, but some inputs were refused; `psgn inspect`: something is damaged
    ERROR = 2  # wrong input, a file that cannot be read or written, too little memory, no result
    INCOMPLETE = 3  # the loss of a training is not finite; other parts of a rendering are not done
    OTHER_ENDED = 4  # another process of the same training has ended
    DISK_FULL = 5  # or a quota is reached
    CTRL_C = 128 + signal.SIGINT
    CLOSED_PIPE = 128 + signal.SIGPIPE  # nothing reads the output any more


class UserError(ValueError):
    """An error that the user can fix; the message is one line, shown without a traceback."""

    exit_code: int = Exit.ERROR


def is_disk_full(error: BaseException) -> bool:
    """Whether the cause is a full disk, an exceeded quota or the maximum size of a file."""
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, OSError) and seen.errno in _FULL:
            return True
        seen = seen.__cause__ or seen.__context__
    return False


def native_error(error: BaseException, path: pathlib.Path) -> OSError:
    """The `OSError` behind a C++ library's error, which only quotes the system's message."""
    said = str(error).replace(str(path.parent), "")  # a folder's name may look like a message
    full = is_disk_full(error) or any(os.strerror(number) in said for number in _FULL)
    number = errno.ENOSPC if full else errno.EIO
    return OSError(number, os.strerror(number), str(path))


def exit_code_of(error: BaseException) -> int | None:
    """The exit code of a command that ends with `error`; None if the user cannot fix it.

    Users can fix a `UserError`, an error of the operating system, and too little memory on the
    host or a device.
    """
    if is_disk_full(error):
        return Exit.DISK_FULL
    on_device = type(error).__name__ == "JaxRuntimeError" and "RESOURCE_EXHAUSTED" in str(error)
    fixable = isinstance(error, OSError | MemoryError) or on_device
    return getattr(error, "exit_code", Exit.ERROR if fixable else None)
