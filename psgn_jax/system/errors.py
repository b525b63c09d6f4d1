"""The error that a user can fix."""


class UserError(ValueError):
    """An error that the user can fix; the message is one line, shown without a traceback."""

    exit_code = 2
