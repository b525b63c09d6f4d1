"""Access to the files of a model. Files outside the root are never opened."""

import abc
import os
import pathlib
import posixpath

from data_gen.mesh import UnusableModelError

MAX_FILE_BYTES = 256 << 20
"""Largest accepted size of a mesh or image file."""


class Files(abc.ABC):
    """The files that a model may refer to, named relative to a root."""

    @abc.abstractmethod
    def find(self, name: str) -> str | None:
        """The stored name of the file `name`, which may differ in upper and lower case; or None."""

    @abc.abstractmethod
    def read(self, name: str) -> bytes:
        """The contents of a file, by a name that `find` returned."""

    def open(self, base: str, name: str) -> bytes:
        """The contents of the file `name`, as written in a file in the folder `base`.

        Backslashes, quotes and wrong case are accepted. If the file does not exist, a file of the
        same name directly in `base` is used, because references often contain folders of the
        author's computer. Of a path that leads out of the root only the last part is used.

        Raises:
          FileNotFoundError: there is no such file.
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
    """The files below a folder."""

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
