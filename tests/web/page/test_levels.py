"""The page reads masks by the rule of the package."""

import shutil

import numpy as np
import pytest
from helpers.commands import PHOTOS
from helpers.javascript import NODE, node
from PIL import Image, ImageFilter

from psgn_jax.data import photo
from psgn_jax.portable import folder
from psgn_jax.web.page.build import STATIC

HEIGHT, WIDTH = 120, 160
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH]
AWAY = np.hypot(ROWS - 60, COLUMNS - 70)
OBJECT, OTHER = AWAY < 25, (ROWS > 95) & (COLUMNS > 130)


def picture(values):
    return Image.fromarray(np.asarray(values).astype(np.uint8))


def outlined(inner, outline):
    shape = (*AWAY.shape, 1)
    colours = np.where((AWAY < 22).reshape(shape), inner, (AWAY < 28).reshape(shape) * outline)
    return picture(np.broadcast_to(colours, (*AWAY.shape, 3)))


WHITE = picture(255 * OBJECT)
RED = np.where(OBJECT[..., None], [255, 0, 0], [0, 0, 0])
RGBA = np.dstack([RED, 255 * OBJECT])
MASKS = {
    "white": WHITE,
    "ones": picture(OBJECT),
    "soft": WHITE.filter(ImageFilter.GaussianBlur(2)),
    "inverted": picture(255 * ~OBJECT),
    "red": picture(RED),
    "red on white": picture(np.where(OBJECT[..., None], [255, 0, 0], [255, 255, 255])),
    "silhouette": picture(RGBA * [0, 0, 0, 1]),
    "outline": outlined(np.array([1, 1, 1]), np.array([255, 255, 255])),
    "VOC": outlined(np.array([192, 0, 0]), np.array([224, 224, 192])),
    "trimap": outlined(np.array([255, 255, 255]), np.array([128, 128, 128])),
    "labels": picture(OBJECT + 2 * OTHER),
    "colours": picture(RED + [0, 255, 0] * OTHER[..., None]),
    "colours on nothing": picture(RGBA + [0, 255, 0, 255] * OTHER[..., None]),
    "empty": picture(0 * OBJECT),
    "full": picture(0 * OBJECT + 255),
    "photo": Image.open(PHOTOS / "car.jpg").resize((WIDTH, HEIGHT)),
    "cut-out": Image.open(PHOTOS / "bottle.jpg").resize((WIDTH, HEIGHT)),
}


def by_python(mask):
    read = photo.read_photo(np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    try:
        found, warnings = photo.open_mask(mask, read)
    except photo.PhotoError as error:
        return str(error).removeprefix("the mask ")
    return found, len(warnings)


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_masks_are_read_or_refused_as_by_python(tmp_path):
    (tmp_path / "package.json").write_text('{"type": "module"}')
    for name in folder.JAVASCRIPT:
        shutil.copy(folder.TEMPLATES / name, tmp_path)
    shutil.copy(STATIC / "levels.js", tmp_path)
    body = """return input.masks.map(rgba => {
  try { return levels.objectIn(rgba, input.width, input.height); }
  catch (error) { return error.message; }
});"""
    masks = [np.asarray(mask.convert("RGBA")) for mask in MASKS.values()]
    results = node(
        body, {"levels": tmp_path / "levels.js"}, masks=masks, width=WIDTH, height=HEIGHT
    )
    for (name, mask), result in zip(MASKS.items(), results, strict=True):
        expected = by_python(mask)
        if isinstance(expected, str):
            assert result.removeprefix("The mask ")[:5] == expected[:5], name
            continue
        found, warned = expected
        if name in ("inverted", "red on white"):
            assert result["doubt"] == " The mask covered the border: it was inverted.", name
            found = ~found
        else:
            assert bool(result["doubt"]) == bool(warned), name
        np.testing.assert_array_equal(np.reshape(result["mask"], found.shape), found, name)
