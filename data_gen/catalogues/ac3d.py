"""Catalogue of a folder of AC3D files (`.ac`), the models of flight and racing simulators."""

import os
from collections.abc import Callable, Sequence

from data_gen.catalogues import folder, non_objects
from data_gen.catalogues.entry import FRACTIONS
from data_gen.frame import axis_vector
from data_gen.mesh import MAX_FACES, Model
from data_gen.readers.ac3d import NO_ASSIMP, find_assimp, read_ac3d


class AC3DCatalogue(folder.FolderCatalogue):
    """All AC3D files below a folder.

    `Maritime/Civilian/ferry.ac` is a model with this name and the category "Maritime". Files
    directly in the folder have no category. Textures may be anywhere below the folder, but not
    outside.

    Args:
      source: the folder.
      up: axis of the files that points up (`frame.AXES`).
      front: axis of the files toward which the fronts of the objects point. The default is that of
        FlightGear's models; for the cars of TORCS it is +x.
      fractions: fractions of the models for training, validation and test, see
        `catalogues.entry.split_of`.
      max_faces: models with more faces are refused.
      leave_out: names of folders at any depth whose files are left out. By default, these are
        FlightGear's folders of clouds, the sky, lights and smoke.
      objects_only: whether to refuse files in other folders that contain no object, see
        `non_objects`.

    Raises:
      ValueError: the folder is missing or contains no such file, an axis is unknown, or assimp is
        not installed.
    """

    name = "ac3d"
    _reader = staticmethod(read_ac3d)
    _objection: Callable[[str, Model], str] | None = staticmethod(non_objects.objection)

    def __init__(
        self,
        source: str | os.PathLike[str],
        *,
        up: str = "+y",
        front: str = "-x",
        fractions: tuple[float, float, float] = FRACTIONS,
        max_faces: int = MAX_FACES,
        leave_out: Sequence[str] = non_objects.FOLDERS,
        objects_only: bool = True,
    ) -> None:
        for axis in (up, front):
            axis_vector(axis)  # refuses "auto"
        super().__init__(
            source, up=up, front=front, fractions=fractions, max_faces=max_faces,
            leave_out=leave_out,
        )  # fmt: skip
        if not objects_only:
            self._objection = None
        if not find_assimp():
            raise ValueError(f"catalogue 'ac3d': {NO_ASSIMP}")

    def _endings(self) -> set[str]:
        return {".ac", ".acc"}
