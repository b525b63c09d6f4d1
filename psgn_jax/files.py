"""Atomic writing of files, and the cache folder."""

import math
import os
import pathlib
import re
import zlib
from collections.abc import Mapping
from typing import Any

_TEMPORARY = re.compile(r"\..+\.[0-9]+\.tmp", re.DOTALL)


def cache_folder() -> pathlib.Path:
    """Folder for data and compiled programs: $PSGN_CACHE, or ~/.cache/psgn_jax.

    Its contents can be deleted; they are created again when needed.
    """
    return pathlib.Path(os.environ.get("PSGN_CACHE") or pathlib.Path.home() / ".cache" / "psgn_jax")


def write_atomic(path: str | os.PathLike[str], content: bytes | str, *, sync: bool = True) -> None:
    """Writes a file atomically: it appears under its name complete, or not at all.

    Args:
      path: path of the file; an existing file is replaced, a missing folder is created.
      content: bytes, or text that is written as UTF-8.
      sync: whether the file also survives a crash of the machine, not only of the process. Use
        False for files that are quick to create again.
    """
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
        if sync:
            install(temporary, path)
        else:
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def install(temporary: pathlib.Path, path: pathlib.Path) -> None:
    """Flushes `temporary` to disk and renames it to `path` atomically."""
    with temporary.open("rb") as file:
        os.fsync(file.fileno())
    temporary.replace(path)
    _sync_directory(path.parent)


def remove_temporaries(folder: pathlib.Path) -> None:
    """Removes what writers that were killed left in a folder: `.NAME.PID.tmp`."""
    for path in folder.glob(".*.tmp"):
        if _TEMPORARY.fullmatch(path.name):
            path.unlink(missing_ok=True)


def file_crc32(path: pathlib.Path) -> int:
    """CRC-32 of the content of a file."""
    crc = 0
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            crc = zlib.crc32(block, crc)
    return crc


def finite_or_none(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Replaces non-finite floats by None (null in JSON), because JSON has no NaN."""
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in entry.items()
    }


def _sync_directory(folder: pathlib.Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
