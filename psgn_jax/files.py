"""Files that are whole or absent, and the folder of what can be made again."""

import math
import os
import pathlib
import zlib
from collections.abc import Mapping
from typing import Any


def cache_folder() -> pathlib.Path:
    """Folder of data and programs that can be made again: $PSGN_CACHE, or ~/.cache/psgn_jax."""
    return pathlib.Path(os.environ.get("PSGN_CACHE") or pathlib.Path.home() / ".cache" / "psgn_jax")


def write_atomic(path: str | os.PathLike[str], content: bytes | str, *, sync: bool = True) -> None:
    """Writes a file that appears under its name whole and durable, or not at all.

    Args:
      path: of the file; one that is there is replaced, its folder is made where missing.
      content: bytes, or text to be written as UTF-8.
      sync: whether it also outlives the machine's death at any moment, not the process's alone;
        False is for what is quickly made again.
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
    """Makes `temporary` durable and gives it its name, in one step."""
    with temporary.open("rb") as file:
        os.fsync(file.fileno())
    temporary.replace(path)
    _sync_directory(path.parent)


def file_crc32(path: pathlib.Path) -> int:
    """CRC-32 of a file's content."""
    crc = 0
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            crc = zlib.crc32(block, crc)
    return crc


def finite_or_none(entry: Mapping[str, Any]) -> dict[str, Any]:
    """JSON has no NaN: None, its null, in place of floats that are not finite."""
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
