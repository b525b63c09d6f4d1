"""Catalogue of ShapeNetCore, versions 1 and 2, unpacked: `<synset>/<model>/...obj`.

The file is `model.obj` in version 1, with the front toward +x, and `models/model_normalized.obj` in
version 2, with the front toward -z (read-me files of the releases). +y is up.
"""

import functools
import os
import pathlib

from data_gen.catalogues.entry import Catalogue, Entry, split_of
from data_gen.mesh import MAX_FACES
from data_gen.readers.load import load_model
from data_gen.readers.model_files import FolderFiles
from psgn_jax.data import synsets

_LAYOUTS = (("models/model_normalized.obj", "-z"), ("model.obj", "+x"))


def shapenet(
    source: str | os.PathLike[str], *, validation: float = 0.0, max_faces: int = MAX_FACES
) -> Catalogue:
    """An unpacked ShapeNetCore of version 1 or 2, complete or in part.

    The first 80 % of the models of a category, by name, are for training, the others for testing:
    the split of 3D-R2N2 if the categories are complete.

    Args:
      source: the folder that contains the folders of the synsets.
      validation: fraction of the training models for validation, chosen by a hash of the name;
        0 = as published.
      max_faces: largest accepted number of faces of a model.

    Raises:
      ValueError: the folder contains no model, or a number is out of range.
    """
    root = pathlib.Path(source)
    if not root.is_dir():
        raise ValueError(f"source {str(source)!r}: expected the folder of ShapeNetCore")
    if not 0 <= validation < 1:
        raise ValueError(f"validation: got {validation}, expected 0 or more and less than 1")
    entries = []
    for synset in sorted(folder.name for folder in root.glob("[0-9]" * 8) if folder.is_dir()):
        category = synsets.SHAPENET.get(synset, synset)
        found = [
            (folder, next(layout for layout in _LAYOUTS if (folder / layout[0]).is_file()))
            for folder in sorted((root / synset).iterdir())
            if any((folder / file).is_file() for file, _ in _LAYOUTS)
        ]
        for index, (folder, (file, front)) in enumerate(found):
            model_id = f"{synset}/{folder.name}"
            train = index < int(0.8 * len(found))
            split = split_of(model_id, (1 - validation, validation, 0.0)) if train else "test"
            files = FolderFiles(folder)
            load = functools.partial(load_model, file, files, front=front, max_faces=max_faces)
            find = functools.partial(files.find, file)
            entries.append(Entry(model_id, category, split, load, find))
    if not entries:
        expected = " or ".join(f"<synset>/<model>/{file}" for file, _ in _LAYOUTS)
        raise ValueError(f"source {str(source)!r}: it contains no model, expected {expected}")
    return Catalogue("shapenet", entries)
