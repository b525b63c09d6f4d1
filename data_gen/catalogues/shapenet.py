"""ShapeNetCore, versions 1 and 2, as unpacked: `<synset>/<model>/...obj`.

Version 1 has `model.obj` in the model's folder and looks toward +x, version 2 has
`models/model_normalized.obj` and looks toward -z (read-me files of the two releases); +y is up in
both.
"""

import os
import pathlib
from collections.abc import Iterator, Sequence

from data_gen.catalogues.entry import FRACTIONS, Entry, loader, split_of
from data_gen.mesh import MAX_FACES, Model
from data_gen.readers.files import FolderFiles
from data_gen.readers.load import load_model

SYNSETS = {
    "02691156": "plane", "02747177": "trash bin", "02773838": "bag", "02801938": "basket",
    "02808440": "bathtub", "02818832": "bed", "02828884": "bench", "02843684": "birdhouse",
    "02871439": "bookshelf", "02876657": "bottle", "02880940": "bowl", "02924116": "bus",
    "02933112": "cabinet", "02942699": "camera", "02946921": "can", "02954340": "cap",
    "02958343": "car", "02992529": "cellular telephone", "03001627": "chair", "03046257": "clock",
    "03085013": "keyboard", "03207941": "dishwasher", "03211117": "monitor",
    "03261776": "earphone", "03325088": "faucet", "03337140": "file cabinet",
    "03467517": "guitar", "03513137": "helmet", "03593526": "jar", "03624134": "knife",
    "03636649": "lamp", "03642806": "laptop", "03691459": "speaker", "03710193": "mailbox",
    "03759954": "microphone", "03761084": "microwave", "03790512": "motorbike", "03797390": "mug",
    "03928116": "piano", "03938244": "pillow", "03948459": "pistol", "03991062": "flowerpot",
    "04004475": "printer", "04074963": "remote", "04090263": "firearm", "04099429": "rocket",
    "04225987": "skateboard", "04256520": "couch", "04330267": "stove", "04379243": "table",
    "04401088": "cellphone", "04460130": "tower", "04468005": "train", "04530566": "watercraft",
    "04554684": "washer",
}  # fmt: skip
"""Names of the synsets: those of the paper's table for the 13 categories of 3D-R2N2."""

_LAYOUTS = (("models/model_normalized.obj", "-z"), ("model.obj", "+x"))

# Part of each category's models that 3D-R2N2 trains on, the first ones by name.
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
    """An unpacked ShapeNetCore of either version, whole or in part.

    Args:
      source: the folder that holds the synsets' folders.
      categories: names or synset numbers to keep; () = all that are there.
      split: "r2n2": of each category, by name, the first 80 % are for training and the others for
        testing, as in 3D-R2N2. It is theirs only where a category is complete. "hash": see
        `catalogues.entry.split_of`.
      validation: with "r2n2", the part of the training models that is kept for validation, by a
        hash of the name. 0 = as published.
      fractions: with "hash", of models for training, validation and test.
      max_faces: models with more are refused.

    Raises:
      ValueError: no model in the folder, an unknown category or split.
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
        names = {name: synset for synset, name in SYNSETS.items()}
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
                f"{[SYNSETS.get(s, s) for s in there]}, which are in {str(source)!r}"
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
                f"source {str(source)!r}: no model in it, expected "
                "<synset>/<model>/models/model_normalized.obj or <synset>/<model>/model.obj"
            )

    def __len__(self) -> int:
        """Number of models."""
        return len(self._models)

    def entries(self) -> Iterator[Entry]:
        """The models, by synset and name; a model is named `<synset>/<model>`."""
        place: dict[str, int] = {}
        for synset, model, file, front in self._models:
            index = place[synset] = place.get(synset, -1) + 1
            model_id, category = f"{synset}/{model}", SYNSETS.get(synset, synset)
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
