"""Zip archives as `files.Files`: read in place without unpacking, with limits for every member."""

import functools
import os
import zipfile
import zlib

from data_gen.mesh import UnusableModelError
from data_gen.readers.files import MAX_FILE_BYTES, Files

_MAX_MEMBERS = 200_000

# The text of a mesh has a compression ratio of 3 to 10. A large member above this ratio is a zip
# bomb. Small members may exceed it: an image of one colour has a ratio of a thousand.
_MAX_RATIO = 200

_RATIO_FROM = 8 << 20


class ZipFiles(Files):
    """The members of a zip archive."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._archive = zipfile.ZipFile(path)
        members = self._archive.infolist()
        if len(members) > _MAX_MEMBERS:
            raise ValueError(f"{len(members)} members are more than the limit of {_MAX_MEMBERS}")
        self._members = {m.filename.replace("\\", "/"): m for m in members if not m.is_dir()}
        self._folded = {name.casefold(): name for name in self._members}

    def find(self, name: str) -> str | None:
        """See `readers.files.Files`."""
        return name if name in self._members else self._folded.get(name.casefold())

    def read(self, name: str, limit: int = MAX_FILE_BYTES) -> bytes:
        """See `readers.files.Files`.

        Raises:
          UnusableModelError: the member is too large, damaged or a zip bomb.
        """
        member = self._members[name]
        if member.file_size > limit:
            raise UnusableModelError(
                f"{name!r} has {member.file_size} bytes, more than the limit of {limit}"
            )
        ratio = member.file_size / max(member.compress_size, 1)
        if member.file_size > _RATIO_FROM and ratio > _MAX_RATIO:
            raise UnusableModelError(
                f"{name!r} has a compression ratio of {ratio:.0f}, expected at most {_MAX_RATIO}: "
                "it may be a zip bomb"
            )
        try:
            with self._archive.open(member) as stream:
                data = stream.read(limit + 1)
        except (zipfile.BadZipFile, zlib.error, OSError, RuntimeError, EOFError,
                NotImplementedError) as error:  # fmt: skip
            raise UnusableModelError(f"{name!r} is damaged: {error}"[:200]) from error
        if len(data) > limit:
            raise UnusableModelError(f"{name!r} has more bytes than the limit of {limit}")
        return data


@functools.lru_cache(maxsize=8)
def _archive(path: str, _modified: int) -> ZipFiles:
    return ZipFiles(path)


def open_files(path: str) -> ZipFiles:
    """The archive, kept open for the next models that this process loads."""
    return _archive(path, os.stat(path).st_mtime_ns)
