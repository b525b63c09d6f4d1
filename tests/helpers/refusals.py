"""Errors about what a user gives: a class, and the things that the message names, in one line.

Tests assert these, never the sentence. `PSGN_MESSAGES=FILE python -m pytest` appends all messages
to a file, for a reviewer.
"""

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import pytest


@contextlib.contextmanager
def refused(error: type[BaseException], *names: object) -> Iterator[pytest.ExceptionInfo]:
    """Expects an error of this class, whose message has one line and contains all `names`."""
    with pytest.raises(error) as caught:
        yield caught
    check_message(str(caught.value), *names)


def check_message(message: str, *names: object) -> None:
    """A message, also one that a command printed, has one line and contains all `names`."""
    if file := os.environ.get("PSGN_MESSAGES"):
        with open(file, "a", encoding="utf-8") as listed:
            listed.write(message.strip() + "\n")
    assert "\n" not in message.strip()
    missing = [name for name in names if str(name) not in message]
    assert not missing, f"{missing} not in: {message}"


def all_refused(
    function: Callable[[Any], object], error: type[BaseException], table: Iterable[tuple]
) -> None:
    """Each row of a table is an argument of `function` and the names of its error."""
    for argument, *names in table:
        with refused(error, *names):
            function(argument)
