"""Catalogue of 0 A.D. and other games of the Pyrogenesis engine: a zip archive of actors.

`readers.actors` assembles the actors. Meshes are PMD files, which distributions ship in place of
COLLADA. Animations are PSA files; the first frame of an idle animation gives people and animals a
natural pose (`readers.pmd`). The archive is read in place (`archives.ZipFiles`).
"""

import functools
import os
import pathlib
import posixpath
import re
import zipfile
from collections.abc import Iterator
from typing import Any

from data_gen.catalogues import non_objects
from data_gen.catalogues.entry import FRACTIONS, Entry, loader, split_of
from data_gen.frame import normalize, orient
from data_gen.mesh import MAX_FACES, UnusableModelError, build_model
from data_gen.readers import archives
from data_gen.readers.actors import ACTORS, Game, assemble, cut_below_ground
from data_gen.readers.notes import Notes
from data_gen.readers.textures import TEXTURE_SIDE

# Folders of actors that are objects, and their categories. Other folders contain pieces: heads,
# manes, roofs, crowns of trees.
_CATEGORIES = (
    (r"fauna/", "animal"),
    (r"flora/trees/", "tree"),
    (r"flora/|props/flora/", "plant"),
    (
        r"(units|structures|campaigns)/.*(ship|boat|trireme|quinq|bireme|penteconter|merchant)",
        "ship",
    ),
    (r"units/[^/]+/.*(operator|_infantry_|_[dh][0-9]?\.xml)", "person"),
    (r"units/[^/]+/.*(siege|catapult|ballista|onager|scorpio|wagon|chariot|cart_)", "machine"),
    (r"units/[^/]+/.*(cavalry|elephant|camel|horse|trader_h)", "rider"),
    (r"units/", "person"),
    (r"structures/|props/special/(palisade|greek_stoa)|campaigns/structures/", "building"),
    (r"props/special/eyecandy/", "thing"),
    (r"props/special/", "thing"),
    (r"props/units/shields/", "shield"),
    (r"props/units/helmets/", "helmet"),
    (r"props/units/(weapons|tools|standards|quivers|siege_artillery)/", "tool"),
    (r"geology/|props/geology/", "rock"),
)


@functools.lru_cache(maxsize=2)
def _game(files: archives.ZipFiles) -> Game:
    return Game(files)


def _load(path: str, name: str, variant: int, category: str, model_id: str, max_faces: int) -> Any:
    try:
        files = archives.open_files(path)
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise UnusableModelError(f"archive {path!r} cannot be read: {error}"[:200]) from error
    notes = Notes()
    arrays = assemble(_game(files), name, variant, TEXTURE_SIDE, max_faces, notes)
    if category == "building":  # buildings have foundations below the ground
        arrays = cut_below_ground(arrays)
    model = build_model(
        **arrays,
        category=category,
        model_id=model_id,
        warnings=notes.lines,
        max_faces=max_faces,
    )
    return normalize(orient(model, "+y", "+z"))


def category_of(name: str) -> str:
    """The category of an actor by its file name; "" if it is not an object on its own."""
    if re.search(non_objects.ACTORS, name):
        return ""
    return next((c for pattern, c in _CATEGORIES if re.match(pattern, name)), "")


class PyrogenesisCatalogue:
    """Actors in the archive of a game that are objects on their own.

    `units/romans/siege_ram.xml` is the model `units/romans/siege_ram`. If an actor has several
    variants, the second model is named `...-2`, the third `...-3`. Models are in the same split if
    the names of their main meshes differ only in a number or letter at the end.

    Args:
      source: the archive, such as 0 A.D.'s `public.zip`, or a folder that contains it.
      shapes: largest number of models of an actor.
      colours: largest number of models with the same meshes and different colours.
      fractions: fractions of the models for training, validation and test, see
        `catalogues.entry.split_of`.
      max_faces: models with more faces are refused.

    Raises:
      ValueError: the archive is missing, cannot be read or contains no actors.
    """

    name = "pyrogenesis"

    def __init__(
        self,
        source: str | os.PathLike[str],
        *,
        shapes: int = 4,
        colours: int = 2,
        fractions: tuple[float, float, float] = FRACTIONS,
        max_faces: int = MAX_FACES,
    ) -> None:
        path = pathlib.Path(source)
        if path.is_dir():
            path = next(iter(sorted(path.rglob("public.zip"))), path / "public.zip")
        if not path.is_file():
            raise ValueError(f"source {str(source)!r}: expected a game's public.zip")
        if shapes < 1 or colours < 1:
            raise ValueError(f"shapes, colours: got {shapes}, {colours}, expected 1 or more")
        try:
            files = archives.ZipFiles(path)
        except (zipfile.BadZipFile, OSError, ValueError) as error:
            raise ValueError(f"archive {str(path)!r} cannot be read: {error}") from error
        self.path, self._fractions, self._max_faces = path, fractions, max_faces
        self._models = list(self._choose(Game(files), files.names(), shapes, colours))
        if not self._models:
            raise ValueError(f"archive {str(path)!r}: it has no actors")

    @staticmethod
    def _choose(
        game: Game, names: list[str], shapes: int, colours: int
    ) -> Iterator[tuple[str, int, str, str]]:
        """Actor, variant, category and group of each model."""
        taken: dict[tuple[str, ...], set[tuple[str, ...]]] = {}
        for file in sorted(names):
            name = file.removeprefix(ACTORS)
            if name == file or not name.endswith(".xml") or not category_of(name):
                continue
            try:
                number = game.shapes(name, shapes)
                for variant in range(number):
                    parts = [a for _, _, a, _ in game.parts(name, variant) if a.mesh]
                    shape = tuple(a.mesh for a in parts)
                    looks = taken.setdefault(shape, set())
                    look = tuple(a.texture for a in parts)
                    if not parts or look in looks or len(looks) >= colours:
                        continue
                    looks.add(look)
                    yield name, variant, category_of(name), stem_of(shape[0])
            except UnusableModelError:
                # The actor stays in the list, and its loader raises the error.
                yield name, 0, category_of(name), name

    def __len__(self) -> int:
        """Number of models."""
        return len(self._models)

    def entries(self) -> Iterator[Entry]:
        """The models, sorted by the names of the actors."""
        for name, variant, category, group in self._models:
            model_id = name.removesuffix(".xml") + (f"-{variant + 1}" if variant else "")
            yield Entry(
                model_id,
                category,
                split_of(group, self._fractions),
                loader(_load, str(self.path), name, variant, category, model_id, self._max_faces),
            )


def stem_of(mesh: str) -> str:
    """The name of a mesh without suffix, and without numbers and single letters at its end."""
    stem = posixpath.splitext(mesh)[0].casefold()
    return re.sub(r"([_-]?[0-9]+|[_-][a-z])+$", "", stem) or stem
