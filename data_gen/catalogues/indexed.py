"""Catalogue of a folder of meshes with an index: a CSV file with a line for each model."""

import csv
import dataclasses
import fnmatch
import functools
import hashlib
import io
import os
import pathlib
from collections.abc import Callable, Sequence

import numpy as np

from data_gen.catalogues.entry import Catalogue, Entry, family_of, split_of
from data_gen.catalogues.families import kit, materials
from data_gen.mesh import Material, Model
from data_gen.readers.load import load_model
from data_gen.readers.model_files import FolderFiles, as_utf8
from psgn_jax.system.untrusted import one_line, size_of

INDEX = "index.csv"
_MAX_INDEX_BYTES = 64 << 20

_KINDS: dict[str, tuple[str, Sequence[Callable[[np.random.Generator], Material]]]] = {
    "wood": ("bed bench box cabinet chair frame instrument shelf table toy", (materials.wood,)),
    "metal": ("airplane bicycle bus can car cart cookware cutlery helicopter kettle lamp rifle "
              "tank tool train truck weapon wheel", (materials.metal,)),
    "plastic": ("appliance bathroom bottle box camera computer display drone headphones medical "
                "speaker sport stationery telephone toy", (materials.plastic, materials.paint)),
    "cloth": ("bag bed clothing pillow sofa tent",
              (materials.fabric, materials.fabric, materials.leather)),
    "stone": ("bathroom bowl mug planet plate rock vase", (materials.stone,)),
    "colour": ("airplane animal book bottle bowl candle car chair clock figure food lamp mug other "
               "plant plate sign spaceship table toy tool vase watercraft weapon",
               (materials.lacquer, materials.paint)),
}  # fmt: skip
"""For each kind of material, the categories of objects made of it, and functions that draw one."""


def indexed(
    source: str | os.PathLike[str],
    *,
    fractions: tuple[float, float, float] = (0.9, 0.05, 0.05),
    licences: tuple[str, ...] = (),
) -> Catalogue:
    """The meshes that a file `index.csv` in a folder lists.

    The index is a CSV file with a heading, also as Windows programs write it: with semicolons or
    tabs, in UTF-16 or cp1252. The column `file` has the path of each mesh in the folder; this is
    the name of the model. The column `category` is optional. Further columns, such as `licence`
    and `author`, become parameters of the model in the records, in lower case. In the files, +y is
    up and +z the front; COLLADA files may state Z_UP.

    A model of a single grey gets a material that fits its category, chosen by its name. Models with
    names that differ in numbers, colours or levels of detail are in the same split.

    Args:
      source: the folder.
      fractions: fractions of the models for training, validation and test, see `split_of`.
      licences: patterns such as `CC-BY-?.0` or `MIT*` of the column `licence`; we leave out models
        that fit no pattern. () = all models.

    Raises:
      ValueError: the index is missing or damaged; the message names the line.
    """
    rows = read_index(source, licences)
    files = FolderFiles(source)
    entries = []
    for row in rows:
        name, category = row["file"], row.get("category", "")
        about = {k: v for k, v in row.items() if k not in ("file", "category") and v}
        load = functools.partial(_load, name, files, category, about)
        find = functools.partial(files.find, name)
        entries.append(Entry(name, category, split_of(family_of(name), fractions), load, find))
    return Catalogue("indexed", entries, fractions)


def read_index(
    source: str | os.PathLike[str], licences: Sequence[str] = ()
) -> list[dict[str, str]]:
    """The lines of a folder's index, if there are patterns, with a licence that fits a pattern.

    Raises:
      ValueError: the index is missing or damaged; the message names the line.
    """
    path = pathlib.Path(source) / INDEX
    try:
        if size_of(path) > _MAX_INDEX_BYTES:
            raise ValueError(f"it is larger than {_MAX_INDEX_BYTES >> 20} MB")
        data = as_utf8(path.read_bytes())
        try:
            text = data.decode()
        except UnicodeDecodeError:
            text = data.decode("cp1252")
        text = text.partition("\n")[2] if text[:4].lower() == "sep=" else text  # of Excel
        mark = max(",;\t", key=text.partition("\n")[0].count)
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=mark, strict=True)
        keys = [key.strip().lower() for key in next(reader, ())]
        if "file" not in keys:
            raise ValueError("line 1: expected a heading with a column `file`")
        rows: dict[str, dict[str, str]] = {}
        for values in reader:
            if not any(map(str.strip, values)):  # spreadsheets write empty rows at the end
                continue
            row = dict(zip(keys, values, strict=False))
            if len(values) != len(keys) or not row["file"]:
                expected = f"{len(keys)} values, with a path in column `file`"
                raise ValueError(f"line {reader.line_num}: expected {expected}")
            row["file"] = row["file"].replace("\\", "/")
            if row["file"] in rows:
                raise ValueError(f"line {reader.line_num}: {row['file']!r} is listed twice")
            rows[row["file"]] = row
    except (OSError, csv.Error, ValueError) as error:
        raise ValueError(f"index {str(path)!r}: {one_line(error)}") from error
    kept = [r for r in rows.values() if not licences or fits(r.get("licence", ""), licences)]
    if not kept:
        there = sorted({row.get("licence", "") for row in rows.values()})
        wanted = f" with a licence of {list(licences)} (it has {there})" if licences else ""
        raise ValueError(f"index {str(path)!r}: it lists no such model{wanted}")
    return kept


def fits(licence: str, patterns: Sequence[str]) -> bool:
    return any(fnmatch.fnmatchcase(licence, pattern) for pattern in patterns)


def _load(name: str, files: FolderFiles, category: str, about: dict[str, str]) -> Model:
    """Reads a model; if it has a single grey and no texture, it gets a material."""
    model = load_model(name, files, parameters=about)
    first, *others = {(m.diffuse, m.texture is None) for m in model.materials}
    if others or not first[1] or np.ptp(first[0]) >= 0.02:
        return model
    digest = hashlib.sha256(f"material {name}".encode()).digest()
    rng = np.random.default_rng(int.from_bytes(digest[:8], "big"))
    fitting = [k for k, (names, _) in _KINDS.items() if category in names.split()]
    _, makers = _KINDS[str(rng.choice(fitting or list(_KINDS)))]
    material = makers[int(rng.integers(len(makers)))](rng)
    zero, owner = np.zeros(1, np.int64), np.zeros(len(model.faces), np.int64)
    uv = kit.texture_coordinates(model.vertices, model.faces, zero, owner, [material], zero)
    return dataclasses.replace(model, materials=(material,), face_material=owner, uv=uv)
