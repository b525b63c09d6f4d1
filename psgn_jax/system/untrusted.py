"""Untrusted files: JSON and arrays in bounded memory, and one-line messages."""

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

    ValueError if it is not JSON (NaN and Infinity are not), or if brackets are nested more than
    `max_depth` deep: printing or comparing the value could then raise RecursionError.
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


def read_json(path: str | os.PathLike[str]) -> Any:
    """`parse_json` of a file; ValueError if it is too large, OSError if it is no regular file."""
    if (size := size_of(path)) > MAX_JSON_BYTES:
        raise ValueError(f"{size} bytes, expected at most {MAX_JSON_BYTES}")
    return parse_json(pathlib.Path(path).read_bytes())


def read_npz(path: str | os.PathLike[str], limits: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Reads arrays of numbers from an NPZ file; nothing is unpickled.

    The size of an array is checked before it is inflated, so a small file cannot take much memory.

    Args:
      limits: name of an array -> largest number of elements. Missing arrays are left out.

    Raises:
      ValueError: the file is damaged, or an array is too large or has no numbers.
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
                # Without a length, `read` would inflate beyond the stated size.
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
    except Exception as error:  # damaged files raise errors of any type
        raise ValueError(brief(error) or type(error).__name__) from None
    return arrays


def with_checksum(entry: Mapping[str, Any] | Mapping[int, Any]) -> dict[str, Any]:
    """A JSON object whose first key `crc32` is the checksum of the other entries."""
    plain = json.loads(json.dumps(entry))
    return {"crc32": _crc32(plain), **plain}


def without_checksum(entry: Any) -> dict[str, Any]:
    """The inverse of `with_checksum`; an object without `crc32`, edited by hand, is accepted.

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
    """Raises `OSError` if a path or anything below it is a named pipe, a socket or a device."""
    for path in paths:
        below = (os.path.join(top, name) for top, _, names in os.walk(path) for name in names)
        for each in itertools.chain([os.fspath(path)], below):
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                kind = kind_of(each)
                if kind not in (None, "a folder"):
                    raise OSError(errno.EINVAL, f"it is {kind}, expected a file", each)


def kind_of(path: str | os.PathLike[str]) -> str | None:
    """What a path is, such as "a named pipe"; None for a regular file."""
    mode = os.stat(path).st_mode
    return next((name for test, name in _KINDS if test(mode)), None)


def size_of(path: str | os.PathLike[str]) -> int:
    """The size of a regular file in bytes; `OSError` for anything else, such as a pipe."""
    kind = kind_of(path)
    if kind is not None:  # opening a pipe would wait for its other end
        raise OSError(errno.EINVAL, f"it is {kind}, expected a file", os.fspath(path))
    return os.stat(path).st_size


def one_line(text: object) -> str:
    r"""A text in one line: line breaks (`\n`) and unprintable characters are escaped.

    URLs, which lose a slash when they are treated as paths, get it back.
    """
    shown = re.sub(r"\b(https?|ftp|s3|gs):/(?!/)", r"\1://", str(text))
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in shown
    )


def message_line(error: object) -> str:
    """An error's message in one line; for an error of the operating system, file and reason."""
    text = str(error)
    if isinstance(error, MemoryError):
        text = f"not enough memory; {text}".rstrip("; ")
    if isinstance(error, OSError) and error.strerror:
        named = isinstance(error.filename, str | bytes)
        text = (f"{one_line(os.fsdecode(error.filename))}: " if named else "") + error.strerror
    return one_line(" ".join(text.split())) or type(error).__name__


def brief(error: object) -> str:
    """The message of another library's error, in one line of at most 200 characters."""
    return one_line(" ".join(str(error).split()))[:200]


def reason_of(error: object) -> str:
    """As `brief`, but an error of the operating system without the file, which the caller names."""
    return getattr(error, "strerror", None) or brief(error)


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not JSON")
