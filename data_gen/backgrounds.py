"""Backgrounds: grey, noise in two random colours, or an image from a folder."""

import pathlib
from typing import Any

import numpy as np
import scipy.ndimage
from PIL import Image

from data_gen import scene
from data_gen.settings import Settings


def draw_background(rng: np.random.Generator, settings: Settings, pictures: list[str]) -> Any:
    """A random background: a grey value, or an image in [0, 1]."""
    height, width = settings.camera.image_size
    if settings.image.background in ("grey", "surroundings"):
        return scene.BACKGROUND
    if settings.image.background == "folder":
        with Image.open(pictures[int(rng.integers(len(pictures)))]) as opened:
            whole = opened.convert("RGB")
        scale = max(height / whole.height, width / whole.width) * rng.uniform(1, 1.5)
        size = max(width, round(whole.width * scale)), max(height, round(whole.height * scale))
        array = np.asarray(whole.resize(size), np.float32) / 255
        top = int(rng.integers(size[1] - height + 1))
        left = int(rng.integers(size[0] - width + 1))
        return array[top : top + height, left : left + width]
    # Two colours mixed by noise at several scales.
    low, high = rng.random((2, 3))
    noise = np.zeros((height, width))
    for cells in (2, 4, 8, 16):
        grid = rng.random((cells + 1, cells + 1))
        zoomed = scipy.ndimage.zoom(grid, (height / cells, width / cells), order=1)
        noise += zoomed[:height, :width] / cells
    noise = (noise - noise.min()) / max(float(np.ptp(noise)), 1e-9)
    return (low + noise[..., None] * (high - low)).astype(np.float32)


def list_pictures(folder: str) -> list[str]:
    """The images below a folder, sorted by name.

    Raises:
      ValueError: there is no image, or a file is not an image.
    """
    paths = sorted(
        str(p.resolve()) for p in pathlib.Path(folder).rglob("*")
        if p.suffix.lower() in (".png", ".jpg", ".jpeg")
    )  # fmt: skip
    if not paths:
        raise ValueError(
            f"image.background_folder: got {folder!r}, expected a folder of .png or .jpg files"
        )
    for path in paths:
        try:
            Image.open(path).close()
        except (OSError, Image.DecompressionBombError) as error:
            raise ValueError(
                f"image.background_folder: {path} is not readable as an image: {error}"
            ) from None
    return paths
