"""The demo's examples: renderings of procedural models of the test split of the free set.

They are under the licence of the project. The alpha channel of each is the mask of its object.
"""

import pathlib

FOLDER = pathlib.Path(__file__).resolve().parent / "examples"


def example_photos() -> list[pathlib.Path]:
    """The files, sorted by name."""
    return sorted(FOLDER.glob("*.png"))


def title(path: pathlib.Path) -> str:
    """The name of an example as a visitor reads it."""
    return path.stem.replace("_", " ")
