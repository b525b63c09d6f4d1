"""Catalogue of FlightGear's AI aircraft: AC3D files, with liveries defined in XML files.

For example, `A320/A320-AirFrance.xml` names the model `Models/A320.ac` and the folder of the
textures, `Textures/AirFrance`. Both may be named in a file that the XML file includes. Models of
lights, flames and parts of aircraft are left out.
"""

import functools
import os
import pathlib
import posixpath
import re
import xml.etree.ElementTree as ElementTree

from data_gen.catalogues import non_objects
from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.catalogues.folder import find_meshes
from data_gen.readers.ac3d import check_assimp, read_ac3d
from data_gen.readers.files import FolderFiles
from data_gen.readers.load import load_model

_MAX_XML_BYTES = 1 << 20

# By the beginning of the name; the others are aircraft.
_CATEGORIES = ((r"(?i)^ferry/", "watercraft"), (r"(?i)^balloon/", "balloon"))


class LiveryFiles(FolderFiles):
    """The files below a folder. Textures in the folder of the livery are preferred."""

    def __init__(self, root: str | os.PathLike[str], livery: str) -> None:
        super().__init__(root)
        self._livery = livery

    def open(self, base: str, name: str) -> bytes:
        """See `readers.files.Files`."""
        if self._livery:
            try:
                return super().open(self._livery, posixpath.basename(name.replace("\\", "/")))
            except FileNotFoundError:
                pass
        return super().open(base, name)


def _wrapper(path: pathlib.Path, root: pathlib.Path, depth: int = 0) -> tuple[str, str]:
    """The model and the texture folder named in an XML file, relative to the root; "" = none."""
    try:
        if path.stat().st_size > _MAX_XML_BYTES:
            return "", ""
        data = path.read_bytes()
        if b"<!ENTITY" in data:
            return "", ""
        tree = ElementTree.fromstring(data)
    except (OSError, ValueError, LookupError, ElementTree.ParseError):
        return "", ""
    here = path.parent.relative_to(root).as_posix()

    def named(key: str) -> str:
        text = (tree.findtext(key) or "").strip().replace("\\", "/")
        name = posixpath.normpath(posixpath.join(here, text)) if text else ""
        return "" if name.startswith(("/", "..")) else name

    model, livery = named("path"), named("texture-path")
    include = tree.get("include", "")
    if include and "/" not in include and "\\" not in include and depth < 4:
        inner_model, inner_livery = _wrapper(path.parent / include, root, depth + 1)
        model, livery = model or inner_model, livery or inner_livery
    return (model if model.casefold().endswith(".ac") else ""), livery


def flightgear(
    source: str | os.PathLike[str],
    *,
    liveries: int = 3,
    fractions: tuple[float, float, float] = FRACTIONS,
) -> Catalogue:
    """Aircraft below a folder, each with some of its liveries.

    An example of a name is `A320/Models/A320.ac:AirFrance`; a model without livery has the name of
    its file. All liveries of a model are in the same split. Ships and balloons in the folder are
    included.

    Args:
      source: the folder `AI/Aircraft` of FlightGear's data.
      liveries: largest number of liveries per file, chosen at equal distances in the sorted list.
      fractions: fractions of the models for training, validation and test, see `split_of`.

    Raises:
      ValueError: the folder is missing or contains no such file, or assimp is not installed.
    """
    if liveries < 1:
        raise ValueError(f"liveries: got {liveries}, expected 1 or more")
    root = pathlib.Path(source)
    names = find_meshes(source, {".ac"})
    files = [n for n in names if not re.search(non_objects.AIRCRAFT, n, re.IGNORECASE)]
    check_assimp("flightgear")
    folded = {name.casefold(): name for name in files}
    dresses: dict[str, set[str]] = {name: set() for name in files}
    for path in sorted(root.rglob("*.xml")):
        model, livery = _wrapper(path, root)
        name = folded.get(model.casefold())
        if name and livery and (root / livery).is_dir():
            dresses[name].add(livery)
    entries = []
    for name, found in dresses.items():  # sorted by file and livery
        count = min(len(found), liveries)  # at equal distances
        for livery in [sorted(found)[i * len(found) // count] for i in range(count)] or [""]:
            model_id = f"{name}:{posixpath.basename(livery)}" if livery else name
            category = next((c for p, c in _CATEGORIES if re.search(p, name)), "aircraft")
            load = functools.partial(
                load_model, name, LiveryFiles(root, livery), up="+y", front="-x",
                category=category, model_id=model_id, reader=read_ac3d,
            )  # fmt: skip
            entries.append(Entry(model_id, category, split_of(name, fractions), load))
    return Catalogue("flightgear", entries, fractions)
