"""AC3D: folders of `.ac` files, the models of flight and racing simulators."""

import os
from collections.abc import Callable, Sequence

from data_gen.catalogues import folder, non_objects
from data_gen.catalogues.entry import FRACTIONS
from data_gen.frame import axis_vector
from data_gen.mesh import MAX_FACES, Model
from data_gen.readers.ac3d import NO_ASSIMP, find_assimp, read_ac3d


class AC3DCatalogue(folder.FolderCatalogue):
    """All AC3D files below a folder.

    `Maritime/Civilian/ferry.ac` is the model of that name, of the category "Maritime"; files in
    the folder itself have no category. Textures may lie anywhere in the folder, nowhere else.

    Args:
      source: the folder.
      up: axis of the files that points up (`frame.AXES`).
      front: axis of the files toward which the objects look. The default is that of FlightGear's
        models; the cars of TORCS look to +x.
      fractions: of models for training, validation and test, see `catalogues.entry.split_of`.
      max_faces: models with more are refused.
      leave_out: names of folders, wherever they are, whose files are left out. The default are
        those of FlightGear that hold no objects: clouds, the sky, lights and smoke.
      objects_only: whether to refuse files elsewhere that hold no object, see `non_objects`.

    Raises:
      ValueError: the folder is missing or has no such file, an axis is wrong, or assimp is not
        installed.
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
            axis_vector(axis)  # "auto" is none here
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
