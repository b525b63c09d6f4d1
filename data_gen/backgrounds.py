"""What is behind the object: a grey, clouds of two colours, or a picture of a folder."""

import pathlib
from typing import Any

import numpy as np
import scipy.ndimage
from PIL import Image

from data_gen import scene
from data_gen.settings import Settings


def draw_background(rng: np.random.Generator, settings: Settings, pictures: list[str]) -> Any:
    """What is behind the object: a grey, or an image in [0, 1]."""
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
    # Clouds of two colours: noise at several sizes.
    low, high = rng.random((2, 3))
    noise = np.zeros((height, width))
    for cells in (2, 4, 8, 16):
        grid = rng.random((cells + 1, cells + 1))
        zoomed = scipy.ndimage.zoom(grid, (height / cells, width / cells), order=1)
        noise += zoomed[:height, :width] / cells
    noise = (noise - noise.min()) / max(float(np.ptp(noise)), 1e-9)
    return (low + noise[..., None] * (high - low)).astype(np.float32)


def list_pictures(folder: str) -> list[str]:
    """The pictures below a folder, by name.

    Raises:
      ValueError: there is none, or a file that is none.
    """
    found = sorted(
        str(p.resolve()) for p in pathlib.Path(folder).rglob("*")
        if p.suffix.lower() in (".png", ".jpg", ".jpeg")
    )  # fmt: skip
    if not found:
        raise ValueError(f"image.background_folder: {folder!r} has no .png or .jpg file")
    for path in found:
        try:
            Image.open(path).close()
        except (OSError, Image.DecompressionBombError) as error:
            raise ValueError(f"image.background_folder: {path} is no picture: {error}") from None
    return found
