"""Where the files of a model come from; nothing outside of a root is opened."""

import abc
import os
import pathlib
import posixpath

from data_gen.mesh import UnusableModelError

MAX_FILE_BYTES = 256 << 20
"""Largest file that is read, meshes and pictures alike."""


class Files(abc.ABC):
    """The files that a model may refer to, by names relative to a root."""

    @abc.abstractmethod
    def find(self, name: str) -> str | None:
        """The stored name of a file asked for by `name`, in its spelling but for case; or None."""

    @abc.abstractmethod
    def read(self, name: str) -> bytes:
        """Contents of a file that `find` named."""

    def open(self, base: str, name: str) -> bytes:
        """Contents of the file that a file in the folder `base` calls `name`.

        Backslashes, quotes and wrong case are forgiven. Where there is no such file, one of the
        same name in `base` itself will do: references often carry the author's own folders. A
        path that leads out of the root is looked up by its last part alone.

        Raises:
          FileNotFoundError: there is none.
        """
        clean = name.strip().strip('"').replace("\\", "/")
        joined = posixpath.normpath(posixpath.join(base, clean))
        alone = posixpath.normpath(posixpath.join(base, posixpath.basename(clean)))
        for path in (joined, alone):
            if path.startswith(("/", "../")) or path in ("", ".", "..") or ":" in path:
                continue
            stored = self.find(path)
            if stored is not None:
                return self.read(stored)
        raise FileNotFoundError(name)


class FolderFiles(Files):
    """Files below a folder."""

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = pathlib.Path(root)

    def find(self, name: str) -> str | None:
        """See `Files`."""
        path = self.root
        for part in posixpath.normpath(name).split("/"):
            if part == "..":
                return None
            following = path / part
            if not following.exists():
                try:
                    entries = sorted(os.listdir(path))
                except OSError:
                    return None
                alike = [e for e in entries if e.casefold() == part.casefold()]
                if not alike:
                    return None
                following = path / alike[0]
            path = following
        return str(path.relative_to(self.root)) if path.is_file() else None

    def read(self, name: str) -> bytes:
        """See `Files`.

        Raises:
          UnusableModelError: the file is larger than `MAX_FILE_BYTES`.
        """
        path = self.root / name
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise UnusableModelError(
                f"{path.name} has {size} bytes, more than the limit of {MAX_FILE_BYTES}"
            )
        return path.read_bytes()
