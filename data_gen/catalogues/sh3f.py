"""Catalogue of furniture libraries of Sweet Home 3D: `.sh3f` files, which are zip archives.

`PluginFurnitureCatalog.properties` lists the models with category, size in centimetres and rotation
of the file. We unpack nothing to disk.
"""

import dataclasses
import functools
import os
import pathlib
import re
import zipfile

import numpy as np
from absl import logging

from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.mesh import Model, UnreadableModelError
from data_gen.readers.load import load_model
from data_gen.readers.model_files import ZipFiles, open_archive
from data_gen.readers.obj import floats
from psgn_jax.system.untrusted import size_of

PROPERTIES = "PluginFurnitureCatalog.properties"
_MAX_PROPERTIES_BYTES = 16 << 20


def parse_properties(text: str) -> dict[str, str]:
    r"""Keys and values of a Java properties file, decoded as Latin-1."""
    escape = re.compile(r"\\(?:u([0-9a-fA-F]{4})|(.))", re.DOTALL)

    def plain(match: re.Match[str]) -> str:
        if match[1]:
            return chr(int(match[1], 16))
        return {"t": "\t", "n": "\n", "r": "\r", "f": "\f"}.get(match[2], match[2])

    def text_of(part: str) -> str:  # Java writes characters such as emojis in two halves
        units = escape.sub(plain, part).encode("utf-16", "surrogatepass")
        return units.decode("utf-16", "replace")

    result: dict[str, str] = {}
    pending = ""
    for raw in re.split(r"\r\n|\r|\n", text):
        line = pending + raw.lstrip(" \t\f")
        if not pending and (not line or line[0] in "#!"):
            continue
        if (len(line) - len(line.rstrip("\\"))) % 2:
            pending = line[:-1]
            continue
        pending = ""
        match = re.match(r"((?:\\.|[^\\=: \t\f])*)[ \t\f]*[=:]?[ \t\f]*(.*)", line, re.DOTALL)
        assert match is not None  # both parts may be empty
        result[text_of(match[1])] = text_of(match[2])
    return result


@dataclasses.dataclass(frozen=True)
class Furniture:
    """A piece of a library: name, file, size (width, depth, height) and rotation."""

    model_id: str
    name: str
    category: str
    file: str
    size: tuple[float, float, float]
    rotation: tuple[float, ...]


def read_library(path: str | os.PathLike[str]) -> list[Furniture]:
    """The pieces of a library in the order of its list; ValueError if it is no library."""
    try:
        size_of(pathlib.Path(path))  # refuses pipes and devices
        files = ZipFiles(path)
        stored = files.find(PROPERTIES)
        if stored is None:
            raise ValueError(f"expected a member {PROPERTIES}")
        table = parse_properties(files.read(stored, _MAX_PROPERTIES_BYTES).decode("latin-1"))
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise ValueError(f"library {str(path)!r} cannot be read: {error}") from error
    numbers = sorted(int(key[6:]) for key in table if re.fullmatch(r"model#[0-9]{1,9}", key))
    pieces = []
    stem = pathlib.Path(path).stem
    for n in numbers:
        name = table.get(f"name#{n}", "")
        identity = table.get(f"id#{n}") or name or str(n)
        texts = (table.get(f"{key}#{n}", "").split() for key in ("width", "depth", "height"))
        size = [(floats(words, 1) or [0.0])[0] for words in texts]
        pieces.append(Furniture(
            model_id=f"{stem}/{identity}", name=name, category=table.get(f"category#{n}", ""),
            file=table[f"model#{n}"].lstrip("/"), size=(size[0], size[1], size[2]),
            rotation=tuple(floats(table.get(f"modelRotation#{n}", "").split(), 9) or ()),
        ))  # fmt: skip
    return pieces


def _place(model: Model, rotation: tuple[float, ...], size: tuple[float, float, float]) -> Model:
    """Rotates and scales a model as Sweet Home 3D does."""
    matrix = np.eye(3)
    if rotation:
        given = np.array(rotation).reshape(3, 3)
        if abs(abs(np.linalg.det(given)) - 1) < 0.1:
            matrix = given
    turned = model.vertices @ matrix.T
    extent = np.ptp(turned, axis=0)
    target = np.array([size[0], size[2], size[1]])  # width, height, depth: x, y, z of the file
    known = (target > 0) & (extent > 1e-6 * extent.max())
    if known.any():
        scale = np.where(known, target / np.where(known, extent, 1), 0)
        # Directions with zero extent or size have the mean scale of the others.
        scale = np.where(known, scale, scale[known].mean())
        # Otherwise the size in the library must be wrong.
        if scale.max() < 20 * scale.min():
            matrix = scale[:, None] * matrix
    return model.transformed(matrix)


def _load(path: str, piece: Furniture) -> Model:
    try:
        files = open_archive(path, os.stat(path).st_mtime_ns)
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise UnreadableModelError(f"library {path!r} cannot be read: {error}"[:200]) from error
    return load_model(
        piece.file, files, parameters={"name": piece.name, "size_cm": piece.size},
        turn=functools.partial(_place, rotation=piece.rotation, size=piece.size),
    )  # fmt: skip


def _unique(names: list[str]) -> list[str]:
    """The names, with `-2`, `-3` ... appended to repeated names."""
    given, result = set(names), dict[str, None]()
    for name in names:
        fresh, number = name, 1
        while fresh in result or (number > 1 and fresh in given):
            number += 1
            fresh = f"{name}-{number}"
        result[fresh] = None
    return list(result)


def sweet_home(
    source: str | os.PathLike[str], *, fractions: tuple[float, float, float] = FRACTIONS
) -> Catalogue:
    """The pieces of a `.sh3f` library, or of all libraries in a folder.

    The name of a model is `<library>/<id of the piece>`, its category is the library's, such as
    "Living room". We leave out libraries that we cannot read, with a warning.

    Args:
      source: the file or folder.
      fractions: fractions of the models for training, validation and test, see `split_of`.

    Raises:
      ValueError: no library can be read.
    """
    path = pathlib.Path(source).absolute()  # for processes in other working directories
    libraries = sorted(path.rglob("*.sh3f")) if path.is_dir() else [path]
    if not libraries or not (path.is_dir() or path.is_file()):
        raise ValueError(f"source {str(source)!r}: expected a .sh3f file or a folder of them")
    pieces, problems = [], []
    for library in libraries:
        try:
            pieces += [(library, piece) for piece in read_library(library)]
        except ValueError as error:
            problems.append(str(error))
    if not pieces and problems:
        raise ValueError("; ".join(problems))
    for problem in problems:
        logging.warning("left out: %s", problem)
    names = _unique([piece.model_id for _, piece in pieces])
    entries = []
    for (library, piece), name in zip(pieces, names, strict=True):
        load = functools.partial(_load, str(library), piece)
        entries.append(Entry(name, piece.category, split_of(name, fractions), load))
    return Catalogue("sh3f", entries, fractions)
