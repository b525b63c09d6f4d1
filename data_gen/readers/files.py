"""Access to the files of a model. Files outside the root are never opened."""

import abc
import os
import pathlib
import posixpath

from data_gen.mesh import UnusableModelError
from psgn_jax.system.untrusted import kind_of

MAX_FILE_BYTES = 256 << 20
"""Largest accepted size of a mesh or image file."""


class Files(abc.ABC):
    """The files that a model may refer to, named relative to a root."""

    @abc.abstractmethod
    def find(self, name: str) -> str | None:
        """The stored name of the file `name`, which may differ in upper and lower case; or None."""

    def why_not(self, name: str) -> str:
        """The reason why `find` returns None for a name, such as "is missing"."""
        return "is missing"

    @abc.abstractmethod
    def read(self, name: str) -> bytes:
        """The contents of a file, by a name that `find` returned."""

    def open(self, base: str, name: str) -> bytes:
        """The contents of the file `name`, as written in a file in the folder `base`.

        Backslashes, quotes and wrong case are accepted. If the file does not exist, a file of the
        same name directly in `base` is used, because references often contain folders of the
        author's computer. If a path leads out of the root, only its last part is used.

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
    """The files below a folder. Links that lead out of it are not followed."""

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = pathlib.Path(root)
        self._names: dict[pathlib.Path, dict[str, str]] = {}

    def find(self, name: str) -> str | None:
        """See `Files`."""
        path = self.root
        for part in posixpath.normpath(name).split("/"):
            if part == "..":
                return None
            following = path / part
            try:
                there = following.exists()
            except (OSError, ValueError):  # a name too long, with a zero byte
                return None
            if not there:
                alike = self._alike(path, part)
                if alike is None:
                    return None
                following = path / alike
            path = following
        if not path.is_file() or self._leads_out(path):
            return None
        return str(path.relative_to(self.root))

    def why_not(self, name: str) -> str:
        """See `Files`."""
        path = self.root / name
        try:
            kind = kind_of(path)
        except (OSError, ValueError):
            return "is missing"
        if kind is not None:
            return f"is {kind}, expected a file"
        return "is a link that leads out of the folder" if self._leads_out(path) else "is missing"

    def _alike(self, folder: pathlib.Path, name: str) -> str | None:
        """The first name in a folder that differs only in case; the folder is listed once."""
        if folder not in self._names:
            try:
                entries = sorted(os.listdir(folder), reverse=True)
            except OSError:
                entries = []
            self._names[folder] = {entry.casefold(): entry for entry in entries}
        return self._names[folder].get(name.casefold())

    def _leads_out(self, path: pathlib.Path) -> bool:
        return not path.resolve().is_relative_to(self.root.resolve())

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
