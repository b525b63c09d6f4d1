"""Handling of untrusted text: JSON with limits on size and depth, one-line messages."""

import json
import os
import pathlib
import stat
from typing import Any

MAX_DEPTH = 32
"""Largest depth of nested brackets that `parse_json` accepts."""

MAX_JSON_BYTES = 64 << 20
"""Largest size of a file that `read_json` accepts."""

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def parse_json(text: str | bytes, *, max_depth: int = MAX_DEPTH) -> Any:
    """The value of a JSON text.

    Args:
      text: the text; bytes are UTF-8.
      max_depth: largest depth of nested brackets. Deeper values would cause a `RecursionError`,
        here or where the value is shown or compared.

    Raises:
      ValueError: the text is not JSON (NaN and Infinity are not JSON), or is nested too deeply.
    """
    deep = ValueError(f"brackets nested more than {max_depth} deep")
    try:
        value = json.loads(text, parse_constant=_refuse)
    except RecursionError:
        raise deep from None
    level = [value]
    for _ in range(max_depth + 1):
        containers = [node for node in level if isinstance(node, dict | list)]
        if not containers:
            return value
        level = [
            child
            for node in containers
            for child in (node.values() if isinstance(node, dict) else node)
        ]
    raise deep


def read_json(path: str | os.PathLike[str], *, max_bytes: int = MAX_JSON_BYTES) -> Any:
    """The value of a JSON file.

    Raises:
      ValueError: the errors of `parse_json`, or the file has more than `max_bytes` bytes.
      OSError: the file cannot be read, or is not a regular file.
    """
    path = pathlib.Path(path)
    kind = kind_of(path)
    if kind is not None:
        raise OSError(f"it is {kind}, expected a file")
    size = path.stat().st_size
    if size > max_bytes:
        raise ValueError(f"{size} bytes, expected at most {max_bytes}")
    return parse_json(path.read_bytes())


def kind_of(path: str | os.PathLike[str]) -> str | None:
    """The kind of a path that is not a regular file, such as "a named pipe"; None for a file.

    Raises:
      OSError: the path does not exist or cannot be accessed.
    """
    mode = os.stat(path).st_mode
    return next((name for test, name in _KINDS if test(mode)), None)


def one_line(text: object) -> str:
    r"""The text of a name or message as one line of printable characters.

    Line breaks, control characters and undecodable bytes of file names are escaped: a file called
    "a, line break, b" is shown as `a\nb`.
    """
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in str(text)
    )


def message_line(error: object) -> str:
    """An error's message as one line: its lines are joined, unprintable characters are escaped.

    For an error of the operating system, the line contains the file and the reason.
    """
    text = str(error)
    if isinstance(error, OSError) and error.strerror:
        named = isinstance(error.filename, str | bytes)
        text = (f"{one_line(os.fsdecode(error.filename))}: " if named else "") + error.strerror
    return one_line(" ".join(text.split())) or type(error).__name__


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not JSON")
