"""Atomic writes, checks of output folders, and the cache folder."""

import contextlib
import errno
import math
import os
import pathlib
import re
import secrets
import tempfile
import unicodedata
import zlib
from collections.abc import Mapping
from typing import Any

from psgn_jax.system.errors import UserError, is_disk_full

_TEMPORARY = re.compile(r"\..+\.[0-9a-f]{8}\.tmp", re.DOTALL)
_NO_SYNC = {errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP}  # for folders on some network mounts


def local_path(path: str | os.PathLike[str], name: str) -> str:
    """A path that a user gave, with `~` and `~user` expanded, as in `--out=~/results`.

    `UserError` for an empty path, an address such as gs://bucket and an unknown user; the message
    begins with `name`.
    """
    text = os.path.expanduser(os.fspath(path))
    if not text:
        raise UserError(f"{name}=: the name is empty; expected a path")
    if re.match(r"[a-zA-Z][\w+.-]+:/", text):
        raise UserError(f"{name}={text}: expected a path on this machine, not an address")
    if re.match(r"~\w", text) and not os.path.lexists(text):
        raise UserError(f"{name}={text}: there is no such user; write ./{text} for that name")
    return text


def check_folder(folder: str | os.PathLike[str], name: str) -> None:
    """Checks that files can be written to a folder, without creating it.

    Raises:
      UserError: no file can be written there; the message begins with `name`, a flag or argument.
      OSError: the disk is full.
    """
    path = pathlib.Path(local_path(folder, name))
    there = next(p for p in (path, *path.parents) if os.path.lexists(p))
    try:
        with tempfile.NamedTemporaryFile(dir=there, prefix="."):
            pass
        for new in (path, *(there / part for part in path.relative_to(there).parts)):
            with contextlib.suppress(FileNotFoundError):
                os.lstat(new)  # fails for names that are too long
    except OSError as error:
        if is_disk_full(error):
            raise
        is_file = there == path and isinstance(error, NotADirectoryError)
        why = "it is a file" if is_file else error.strerror or error
        shown = f"{path}" if len(f"{path}") <= 80 else f"{path}"[:77] + "..."
        raise UserError(f"{name}={shown}: {why}; expected a folder for files") from error


def cache_folder() -> pathlib.Path:
    """Folder for data and compiled programs: $PSGN_CACHE, or psgn_jax in the cache.

    The cache is $XDG_CACHE_HOME or ~/.cache. `UserError` if the variables are unset and the user
    has no home, as in `docker run -u 1234`.
    """
    if given := os.environ.get("PSGN_CACHE"):
        return pathlib.Path(local_path(given, "PSGN_CACHE"))
    if os.path.isabs(given := os.environ.get("XDG_CACHE_HOME", "")):  # others are ignored
        return pathlib.Path(given, "psgn_jax")
    try:
        return pathlib.Path.home() / ".cache" / "psgn_jax"
    except RuntimeError:
        raise UserError(
            "this user has no home folder; name a folder for the cache in the environment variable "
            "PSGN_CACHE"
        ) from None


def temporary_for(path: pathlib.Path) -> pathlib.Path:
    """A path beside `path` that no other process uses; `remove_temporaries` recognises it."""
    # A name has at most 255 bytes, and a character up to 4.
    return path.with_name(f".{path.name[:60]}.{secrets.token_hex(4)}.tmp")


def write_atomic(path: str | os.PathLike[str], content: bytes | str, *, sync: bool = True) -> None:
    """Writes or replaces a file (`local_path`) atomically, text as UTF-8; creates its folder.

    With `sync` the file also survives a crash of the machine.
    """
    path = pathlib.Path(local_path(path, "path"))
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_for(path)
    try:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
        if sync:
            install(temporary, path)
        else:
            temporary.replace(path)
    except OSError as error:
        if error.errno:  # name the file, not the temporary one
            error.filename, error.filename2 = str(path), None
        raise
    finally:
        with contextlib.suppress(OSError):  # the write's error says more
            temporary.unlink()


def install(temporary: pathlib.Path, path: pathlib.Path) -> None:
    """Flushes `temporary` to disk and renames it to `path` atomically."""
    _sync(temporary)
    temporary.replace(path)
    try:
        _sync(path.parent)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise


def _sync(path: pathlib.Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove_temporaries(folder: pathlib.Path) -> None:
    """Removes the temporary files that killed processes left in a folder."""
    for path in folder.glob(".*.tmp"):
        if _TEMPORARY.fullmatch(path.name):
            path.unlink(missing_ok=True)


def same_name(name: str) -> str:
    """A form that is equal for names that people take for the same one: case, Unicode form."""
    return unicodedata.normalize("NFC", name).casefold()


def file_crc32(path: pathlib.Path) -> int:
    crc = 0
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            crc = zlib.crc32(block, crc)
    return crc


def finite_or_none(value: Any) -> Any:
    """A JSON value in which non-finite floats become None (null), because JSON has no NaN."""
    if isinstance(value, Mapping):
        return {key: finite_or_none(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite_or_none(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
