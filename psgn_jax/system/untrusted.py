"""Handling of untrusted files: JSON and arrays in bounded memory, one-line messages."""

import contextlib
import errno
import io
import itertools
import json
import math
import os
import pathlib
import re
import stat
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

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
    """The value of a JSON text; bytes are UTF-8.

    ValueError if it is not JSON (which has no NaN and Infinity), or has more than `max_depth`
    nested brackets: a `RecursionError` could follow where the value is shown or compared.
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
    """`parse_json` for a file; ValueError if it is too large, OSError if it is no regular file."""
    size = size_of(path)
    if size > max_bytes:
        raise ValueError(f"{size} bytes, expected at most {max_bytes}")
    return parse_json(pathlib.Path(path).read_bytes())


def read_npz(path: str | os.PathLike[str], limits: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Reads arrays of numbers from an NPZ file; nothing is unpickled.

    The size of an array is checked before it is inflated, so a small file cannot take much memory.

    Args:
      limits: names of the arrays that are read if they are there, with their largest sizes.

    Raises:
      ValueError: the file is damaged, or an array is not of numbers or is too large.
      OSError: the file cannot be read, or is not a regular file.
    """
    size_of(path)
    arrays = {}
    try:
        with zipfile.ZipFile(path) as archive:
            names = set(archive.namelist())
            for key in (key for key in limits if f"{key}.npy" in names):
                largest = 8 * limits[key] + 4096
                size = archive.getinfo(f"{key}.npy").file_size
                if size > largest:
                    raise ValueError(f"{key} takes {size} bytes, expected at most {largest}")
                # `read` without a length would inflate everything, even beyond the stated size.
                with archive.open(f"{key}.npy") as member:
                    data = io.BytesIO(member.read(size))
                # NumPy would allocate the stated shape before it reads the data.
                version = np.lib.format.read_magic(data)
                header = getattr(np.lib.format, "read_array_header_{}_{}".format(*version), None)
                if header is None:
                    raise ValueError(f"{key}: npy version {version}, expected (1, 0) or (2, 0)")
                shape, _, dtype = header(data)
                count, left = math.prod(shape), size - data.tell()
                fits = 0 <= count <= limits[key] and count * dtype.itemsize == left
                if dtype.kind not in "bfiu" or not fits:
                    raise ValueError(
                        f"{key} is {dtype} {list(shape)} in {size} bytes, expected at most "
                        f"{limits[key]} numbers"
                    )
                data.seek(0)
                arrays[key] = np.lib.format.read_array(data, allow_pickle=False)
    except OSError:
        raise
    except Exception as error:  # the readers of both formats raise any type for damaged files
        raise ValueError(brief(error) or type(error).__name__) from None
    return arrays


def with_checksum(entry: Mapping[str, Any] | Mapping[int, Any]) -> dict[str, Any]:
    """An object of JSON that begins with the key `crc32`, the checksum of the rest of it."""
    plain = json.loads(json.dumps(entry))
    return {"crc32": _crc32(plain), **plain}


def without_checksum(entry: Any) -> dict[str, Any]:
    """The object that was given to `with_checksum`; if you edit a file, remove its checksum.

    ValueError if it is no object, or its checksum does not match.
    """
    if not isinstance(entry, dict):
        raise ValueError("it is not an object")
    rest = {key: value for key, value in entry.items() if key != "crc32"}
    if "crc32" in entry and entry["crc32"] != _crc32(rest):
        raise ValueError("its checksum does not match; without the key crc32 it is not checked")
    return rest


def _crc32(entry: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(entry, sort_keys=True).encode())


def refuse_special_files(*paths: str | os.PathLike[str]) -> None:
    """Raises `OSError` if a path, or anything below it, is a named pipe, a socket or a device."""
    for path in paths:
        below = (os.path.join(top, name) for top, _, names in os.walk(path) for name in names)
        for each in itertools.chain([os.fspath(path)], below):
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                kind = kind_of(each)
                if kind not in (None, "a folder"):
                    raise OSError(errno.EINVAL, f"it is {kind}, expected a file", each)


def kind_of(path: str | os.PathLike[str]) -> str | None:
    """The kind of a path that is not a regular file, such as "a named pipe"; None for a file."""
    mode = os.stat(path).st_mode
    return next((name for test, name in _KINDS if test(mode)), None)


def size_of(path: str | os.PathLike[str]) -> int:
    """The size of a regular file in bytes; `OSError` for anything else, such as a pipe."""
    kind = kind_of(path)
    if kind is not None:  # opening a pipe would wait for its other end
        raise OSError(f"it is {kind}, expected a file")
    return os.stat(path).st_size


def one_line(text: object) -> str:
    r"""A text in one line: line breaks (`\n`) and unprintable characters are escaped.

    Addresses, which lose a slash as paths, get it back.
    """
    shown = re.sub(r"\b(https?|ftp|s3|gs):/(?!/)", r"\1://", str(text))
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in shown
    )


def message_line(error: object) -> str:
    """An error's message as one line; for errors of the operating system, file and reason."""
    text = str(error)
    if isinstance(error, MemoryError):
        text = f"not enough memory; {text}".rstrip("; ")
    if isinstance(error, OSError) and error.strerror:
        named = isinstance(error.filename, str | bytes)
        text = (f"{one_line(os.fsdecode(error.filename))}: " if named else "") + error.strerror
    return one_line(" ".join(text.split())) or type(error).__name__


def brief(error: object) -> str:
    """The message of an error of another library in one line of at most 200 characters."""
    return " ".join(str(error).split())[:200]


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not JSON")
