"""The page reads the masks of two levels that the package reads, and refuses levels in between."""

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
OBJECT, OTHER = np.hypot(ROWS - 60, COLUMNS - 70) < 25, (ROWS > 95) & (COLUMNS > 130)


def picture(values):
    return Image.fromarray(np.asarray(values).astype(np.uint8))


WHITE = picture(255 * OBJECT)
MASKS = {
    "white": WHITE,
    "ones": picture(OBJECT),
    "soft": WHITE.filter(ImageFilter.GaussianBlur(2)),
    "inverted": picture(255 * ~OBJECT),
    "red": picture(np.where(OBJECT[..., None], [255, 0, 0], [0, 0, 0])),
    "silhouette": picture(np.dstack([0 * ROWS] * 3 + [255 * OBJECT])),
    "labels": picture(OBJECT + 2 * OTHER),
    "empty": picture(0 * OBJECT),
    "full": picture(0 * OBJECT + 255),
    "photo": Image.open(PHOTOS / "car.jpg").resize((WIDTH, HEIGHT)),
    "cut-out": Image.open(PHOTOS / "bottle.jpg").resize((WIDTH, HEIGHT)),
}


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_masks_are_read_or_refused_as_by_python(tmp_path):
    (tmp_path / "package.json").write_text('{"type": "module"}')
    for path in (*(folder.TEMPLATES / name for name in folder.JAVASCRIPT), STATIC / "levels.js"):
        shutil.copy(path, tmp_path)
    body = """return input.masks.map(rgba => {
  try { return levels.objectIn(rgba, input.width, input.height); }
  catch (error) { return error.message; }
});"""
    masks = [np.asarray(mask.convert("RGBA")) for mask in MASKS.values()]
    path = {"levels": tmp_path / "levels.js"}
    results = node(body, path, masks=masks, width=WIDTH, height=HEIGHT)
    read = photo.read_photo(np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    for (name, mask), result in zip(MASKS.items(), results, strict=True):
        if name in ("labels", "empty", "full", "photo", "cut-out"):
            assert result.startswith("The mask "), name
            with pytest.raises(photo.PhotoError):
                photo.read_mask(mask, read)
            continue
        expected = photo.read_mask(mask, read) ^ (name == "inverted")
        assert bool(result["doubt"]) == (name == "inverted")
        np.testing.assert_array_equal(np.reshape(result["mask"], expected.shape), expected, name)
