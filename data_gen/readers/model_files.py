"""The files of a model in a folder or a zip archive. We never open files outside."""

import abc
import contextlib
import functools
import itertools
import os
import pathlib
import posixpath
import re
import urllib.parse
import zipfile
import zlib
from collections.abc import Sequence
from typing import IO, Any

import numpy as np

from data_gen.mesh import MAX_FACES, UnreadableModelError, UnusableModelError
from psgn_jax.system.files import same_name
from psgn_jax.system.untrusted import kind_of

MAX_FILE_BYTES = 256 << 20
"""Largest accepted size of a mesh or image file."""

UTF_16_MARKS = (b"\xff\xfe", b"\xfe\xff")


class DamagedError(Exception):
    """A file, or a part of a file, violates its format; the text says how."""


class OverBudgetError(UnusableModelError):
    """A file asks for more than its `Budget`."""


LIMITS = {"faces": MAX_FACES, "bytes of arrays": 4 << 30, "visits of parts": 200_000}
"""What a file may ask for, by default. A visit of a part takes some 0.1 ms."""


class Budget:
    """What a file asks for. Readers charge it before they do the work.

    So a small file cannot ask for much by repeating its parts.
    """

    def __init__(self, max_faces: int = MAX_FACES) -> None:
        self.limits = {**LIMITS, "faces": max_faces}
        self.spent = dict.fromkeys(self.limits, 0)

    def charge(self, *, faces: int = 0, made: int = 0, visits: int = 0) -> None:
        """Adds faces, bytes that are made, and visits; OverBudgetError above a limit."""
        for kind, amount in zip(self.limits, (faces, made, visits), strict=True):
            self.spent[kind] += int(amount)
            if self.spent[kind] > self.limits[kind]:
                what = f"the file asks for {self.spent[kind]} {kind}"
                raise OverBudgetError(f"{what}, more than the limit of {self.limits[kind]}")


# As programs for Windows write infinity and what is not a number.
_NOT_FINITE = re.compile(r"[-+]?(1\.#(IND|QNAN|SNAN|INF)\d*|nan\(\w*\))", re.IGNORECASE)


def _plain(word: str | bytes) -> str:
    return _NOT_FINITE.sub("nan", word if isinstance(word, str) else word.decode("latin-1"))


def numbers(words: Sequence[Any], kind: type = np.float64, where: str = "") -> np.ndarray:
    """Words or rows of words as numbers. `where` is a place for the error."""
    refused = ValueError, OverflowError, TypeError, AttributeError
    with contextlib.suppress(*refused):
        return np.array(words, kind)
    with contextlib.suppress(*refused):
        return np.array(np.vectorize(_plain, otypes=[object])(np.array(words, object)), kind)
    raise DamagedError(f"a word{where} that is not a number")


def check_size(what: str, size: int, limit: int) -> None:
    """Raises UnusableModelError if `size` bytes are more than `limit`."""
    if size > limit:
        raise UnusableModelError(f"{what}: {size} bytes are more than the limit of {limit}")


def check_announced(what: str, announced: int, there: int) -> None:
    """Raises UnusableModelError if a file announces more than it has."""
    if there < announced:
        counts = f"{announced} announced, {there} there"
        raise UnusableModelError(f"the file is cut off: {what}: {counts}")


def as_utf8(text: bytes) -> bytes:
    """A text of any encoding as UTF-8, without a byte-order mark, with line feeds as line ends."""
    if text[:2] in UTF_16_MARKS or b"\0" in text[:2]:
        encoding = "utf-16-be" if text[:1] == b"\0" else "utf-16-le"
        encoding = "utf-16" if text[:2] in UTF_16_MARKS else encoding
        text = text.decode(encoding, "replace").encode("utf-8", "replace")
    return text.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def whole_lines(text: bytes) -> bytes:
    """`as_utf8` with continued lines joined. A backslash may also be half a character of GBK."""
    text = as_utf8(text)
    return re.sub(rb"(?<![\x80-\xff])\\\n", b" ", text) if b"\\\n" in text else text


def reason(data: bytes) -> str | None:
    """Why the content contradicts the name of a file; None if it need not."""
    if not data.lstrip(b"\0"):
        return "it contains only zeros" if data else "it is empty"
    start = data[:200].removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    if start.startswith(b"version https://git-lfs"):
        return "it is a Git LFS pointer: fetch the file itself with `git lfs pull`"
    if start.startswith(b"/annex/objects/"):
        return "it is a pointer of git-annex: fetch the file itself with `git annex get`"
    if start.startswith(b"<") and (b"<!doctype html" in start or b"<html" in start):
        return "it is a web page: download the file itself"
    return next(
        (f"it is compressed by {c}: unpack it" for m, c in _PACKED if data.startswith(m)), None
    )


_PACKED = ((b"PK\3\4", "zip"), (b"\x1f\x8b", "gzip"), (b"BZh", "bzip2"), (b"\xfd7zXZ\0", "xz"),
           (b"7z\xbc\xaf", "7-Zip"), (b"(\xb5/\xfd", "Zstandard"), (b"Rar!", "RAR"))  # fmt: skip


class Files(abc.ABC):
    """The files that a model may refer to. Names are relative to a root."""

    refusal = UnusableModelError  # if a file is missing

    @abc.abstractmethod
    def find(self, name: str) -> Any:
        """The place of a file for `read`, with the case of letters ignored; None if missing."""

    def why_not(self, name: str) -> str:
        """Why `find` returns None for a name."""
        return "is missing"

    @abc.abstractmethod
    def read(self, place: Any) -> bytes:
        """The content of a file. UnusableModelError if it is larger than `MAX_FILE_BYTES`."""

    def open(self, name: str, *folders: str) -> bytes:
        """The content of a file, whose name is relative to one of the `folders`.

        We accept backslashes, quotes, spaces around a name, wrong case, escapes and queries of
        URLs, names in Latin-1 or GBK and comments after names. Names often contain folders of the
        author's computer: if the file does not exist or is outside of the root, we take a file with
        the last part of the name in the folder.

        Raises:
          FileNotFoundError: there is no such file.
        """
        clean = name.strip().strip('"').replace("\\", "/")
        short = re.split("[#?]", clean)[0].rstrip()
        texts = [name, clean, short, *map(urllib.parse.unquote, (clean, short))]
        texts += [text.strip() for text in texts]
        if not clean.isprintable():
            raw = [text.encode("utf-8", "surrogateescape") for text in (clean, short)]
            texts += [r.decode(coding, "replace") for r in raw for coding in ("latin-1", "gb18030")]
        names = dict.fromkeys(x for text in texts for x in (text, posixpath.basename(text)))
        for folder, tried in itertools.product(dict.fromkeys(folders), names):
            path = posixpath.normpath(posixpath.join(folder, tried))
            if path.startswith(("/", "../")) or path in ("", ".", "..") or ":" in path:
                continue
            if (place := self.find(path)) is not None:
                return self.read(place)
        raise FileNotFoundError(name)


class FolderFiles(Files):
    """The files below a folder. Links may only lead below it, or below the folders `linked`.

    In the cache of a hub, whose files are links, they may also lead to the content of the cache.
    """

    refusal = UnreadableModelError

    def __init__(self, root: str | os.PathLike[str], linked: Sequence[str] = ()) -> None:
        self.root = pathlib.Path(root).absolute()  # for processes in other working directories
        self._homes = [self.root.resolve(), *(pathlib.Path(path).resolve() for path in linked)]
        for folder in self._homes[0].parents:  # REPOSITORY/snapshots/VERSION/a.glb -> ../../blobs/1
            if folder.name == "snapshots" and (folder.parent / "refs").is_dir():
                self._homes.append(folder.parent / "blobs")
        self._names: dict[pathlib.Path, dict[str, str]] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_names": {}}  # each process lists the folders again

    def find(self, name: str) -> pathlib.Path | None:
        path = self.root
        for part in posixpath.normpath(name).split("/"):
            alike = part if os.path.exists(path / part) else self._alike(path, part)
            if alike is None or part == "..":
                return None
            path = path / alike
        if not path.is_file():  # before `resolve`, which raises for a cycle of links
            return None
        real = path.resolve()
        return path if any(real.is_relative_to(home) for home in self._homes) else None

    def why_not(self, name: str) -> str:
        with contextlib.suppress(OSError, ValueError):
            kind = kind_of(self.root / name)
            return f"is {kind or 'a link that leads out of the folder'}, expected a file"
        return "is missing"

    def _alike(self, folder: pathlib.Path, name: str) -> str | None:
        """A name in a folder that differs in case only; None if there is none."""
        if folder not in self._names:
            entries: list[str] = []
            with contextlib.suppress(OSError):
                entries = sorted(os.listdir(folder), reverse=True)
            self._names[folder] = {same_name(entry): entry for entry in entries}
        return self._names[folder].get(same_name(name))

    def read(self, place: pathlib.Path) -> bytes:
        check_size(place.name, place.stat().st_size, MAX_FILE_BYTES)
        return place.read_bytes()


_MAX_MEMBERS = 200_000

# The text of a mesh has a compression ratio of 3 to 10, a small image of one colour up to 1,000.
_MAX_RATIO, _RATIO_FROM = 200, 8 << 20


class ZipFiles(Files):
    """The members of a zip archive."""

    def __init__(self, path: str | os.PathLike[str] | IO[bytes]) -> None:
        self._archive = zipfile.ZipFile(path)
        members = self._archive.infolist()
        if len(members) > _MAX_MEMBERS:
            raise ValueError(f"{len(members)} members are more than the limit of {_MAX_MEMBERS}")
        self._members = {m.filename.replace("\\", "/"): m for m in members if not m.is_dir()}
        self._folded = {same_name(name): name for name in self._members}

    @property
    def names(self) -> list[str]:
        """The names of all members."""
        return list(self._members)

    def find(self, name: str) -> str | None:
        return name if name in self._members else self._folded.get(same_name(name))

    def read(self, place: str, limit: int = MAX_FILE_BYTES) -> bytes:
        """UnusableModelError if the member is larger than `limit`, damaged or a zip bomb."""
        member = self._members[place]
        check_size(repr(place), member.file_size, limit)
        ratio = member.file_size / max(member.compress_size, 1)
        if member.file_size > _RATIO_FROM and ratio > _MAX_RATIO:
            what = f"{place!r} may be a zip bomb: its compression ratio is {ratio:.0f}"
            raise UnusableModelError(f"{what}, expected at most {_MAX_RATIO}")
        try:  # with a size, because the content may be larger than stated
            with self._archive.open(member) as stream:
                return stream.read(member.file_size)
        except (zipfile.BadZipFile, zlib.error, OSError, RuntimeError, EOFError,
                NotImplementedError) as error:  # fmt: skip
            raise UnusableModelError(f"{place!r} in the archive is damaged") from error


@functools.lru_cache(maxsize=8)
def open_archive(path: str, _modified: int) -> ZipFiles:
    """The archive, open for the next models of this process until the file changes."""
    return ZipFiles(path)
