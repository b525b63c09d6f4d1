"""The error that a user can fix, and the exit codes of all commands."""

import enum
import signal


class Exit(enum.IntEnum):
    """Exit codes; a signal's code is 128 + its number, as in shells."""

    DONE = 0
    PARTLY = 1  # done, but some inputs were refused; something is damaged (`psgn inspect`)
    ERROR = 2  # a wrong input, a file that cannot be read or written, too little memory, no result
    NOT_FINITE = 3  # the loss of a training
    UNFINISHED = 3  # this part of a rendering is done, others are not
    OTHER_ENDED = 4  # another process of the same training has ended
    DISK_FULL = 5  # or a quota is reached
    CTRL_C = 128 + signal.SIGINT
    CLOSED_PIPE = 128 + signal.SIGPIPE  # nothing reads the output any more


class UserError(ValueError):
    """An error that the user can fix; the message is one line, shown without a traceback."""

    exit_code: int = Exit.ERROR
