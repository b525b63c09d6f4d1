"""Catalogue of ShapeNetCore, versions 1 and 2, unpacked: `<synset>/<model>/...obj`.

In version 1 the file is `model.obj` and the front points toward +x. In version 2 it is
`models/model_normalized.obj` and the front points toward -z (read-me files of the two releases). In
both, +y is up.
"""

import os
import pathlib
from collections.abc import Iterator, Sequence

from data_gen.catalogues.entry import FRACTIONS, Entry, loader, split_of
from data_gen.mesh import MAX_FACES, Model
from data_gen.readers.files import FolderFiles
from data_gen.readers.load import load_model
from psgn_jax.data import synsets

_LAYOUTS = (("models/model_normalized.obj", "-z"), ("model.obj", "+x"))

# Fraction of each category that 3D-R2N2 trains on: the first models by name.
_R2N2_TRAIN = 0.8


def _load(
    folder: str, file: str, front: str, model_id: str, category: str, max_faces: int
) -> Model:
    return load_model(
        file,
        FolderFiles(folder),
        up="+y",
        front=front,
        category=category,
        model_id=model_id,
        max_faces=max_faces,
    )


class ShapeNetCatalogue:
    """An unpacked ShapeNetCore of either version, complete or in part.

    Args:
      source: the folder that contains the folders of the synsets.
      categories: names or synset numbers to keep; () = all in the folder.
      split: "r2n2": in each category, the first 80 % of the models by name are for training and the
        others for testing, as in 3D-R2N2. The split is that of 3D-R2N2 only if the categories are
        complete. "hash": see `catalogues.entry.split_of`.
      validation: with "r2n2", the fraction of the training models that becomes the validation
        split, by a hash of the name. 0 = as published.
      fractions: with "hash", fractions of the models for training, validation and test.
      max_faces: models with more faces are refused.

    Raises:
      ValueError: the folder contains no model, or a category or the split is unknown.
    """

    name = "shapenet"

    def __init__(
        self,
        source: str | os.PathLike[str],
        *,
        categories: Sequence[str] = (),
        split: str = "r2n2",
        validation: float = 0.0,
        fractions: tuple[float, float, float] = FRACTIONS,
        max_faces: int = MAX_FACES,
    ) -> None:
        self.root = pathlib.Path(source)
        if not self.root.is_dir():
            raise ValueError(f"source {str(source)!r}: expected the folder of ShapeNetCore")
        if split not in ("r2n2", "hash"):
            raise ValueError(f"split {split!r}: expected 'r2n2' or 'hash'")
        if not 0 <= validation < 1:
            raise ValueError(f"validation: got {validation}, expected 0 or more and less than 1")
        if split == "hash" and validation:
            raise ValueError(f"validation: got {validation}, which has no effect with split 'hash'")
        if split == "r2n2" and tuple(fractions) != FRACTIONS:
            raise ValueError(
                f"fractions: got {list(fractions)}, which has no effect with split 'r2n2'"
            )
        names = {name: synset for synset, name in synsets.SHAPENET.items()}
        wanted = {names.get(c, c) for c in categories}
        self._split, self._validation, self._fractions = split, validation, fractions
        self._max_faces = max_faces
        self._models: list[tuple[str, str, str, str]] = []  # synset, model, file, front
        self._count: dict[str, int] = {}
        there = sorted(
            f.name
            for f in self.root.iterdir()
            if f.is_dir() and f.name.isdigit() and len(f.name) == 8
        )
        unknown = wanted - set(there)
        if unknown:
            raise ValueError(
                f"categories {sorted(unknown)}: expected some of "
                f"{[synsets.SHAPENET.get(s, s) for s in there]}, which are in {str(source)!r}"
            )
        for synset in there:
            if wanted and synset not in wanted:
                continue
            for folder in sorted((self.root / synset).iterdir()):
                for file, front in _LAYOUTS:
                    if (folder / file).is_file():
                        self._models.append((synset, folder.name, file, front))
                        self._count[synset] = self._count.get(synset, 0) + 1
                        break
        if not self._models:
            raise ValueError(
                f"source {str(source)!r}: it contains no model, expected "
                "<synset>/<model>/models/model_normalized.obj or <synset>/<model>/model.obj"
            )

    def __len__(self) -> int:
        """Number of models."""
        return len(self._models)

    def entries(self) -> Iterator[Entry]:
        """The models, sorted by synset and name; a model is named `<synset>/<model>`."""
        place: dict[str, int] = {}
        for synset, model, file, front in self._models:
            index = place[synset] = place.get(synset, -1) + 1
            model_id, category = f"{synset}/{model}", synsets.SHAPENET.get(synset, synset)
            if self._split == "hash":
                split = split_of(model_id, self._fractions)
            elif index >= int(_R2N2_TRAIN * self._count[synset]):
                split = "test"
            else:
                parts = (1 - self._validation, self._validation, 0.0)
                split = split_of(model_id, parts)
            folder = str(self.root / synset / model)
            yield Entry(
                model_id,
                category,
                split,
                loader(_load, folder, file, front, model_id, category, self._max_faces),
            )
