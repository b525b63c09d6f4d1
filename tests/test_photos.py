"""The photos of the model card, the script that draws them, and cut-outs as samples."""

import io
import pathlib
import types

import numpy as np
import pytest
from bench import cutouts, photos
from PIL import Image

from psgn_jax.data import camera, framing, photo

PHOTOS = sorted(photos.PHOTOS.glob("*.jpg"))


def test_there_are_ten():
    assert len(PHOTOS) == 10


@pytest.mark.parametrize("path", PHOTOS, ids=lambda path: path.stem)
def test_each_photo_is_small_and_has_a_mask_and_a_licence(path):
    read = photo.read_photo(path)
    mask = path.with_name(f"{path.stem}_mask.png")
    assert photo.read_mask(mask, read).shape == read.image.shape[:2]
    assert max(read.size) <= 384
    assert path.stat().st_size + mask.stat().st_size <= 40_000
    (line,) = [
        line for line in (path.parent / "README.md").read_text().splitlines() if path.name in line
    ]
    assert "GPL-2.0-or-later" in line or "public domain" in line


def predict(image, mask):
    """A cloud of five points in the view of the object."""
    view = framing.place(image, mask, move=True)
    return types.SimpleNamespace(points=np.eye(5, 3, dtype=np.float32)[None], view=view)


def test_a_row_of_the_sheet():
    image = np.full((60, 80, 3), 191, np.uint8)
    mask = np.zeros((60, 80), np.bool_)
    mask[20:40, 30:60] = True
    nothing, text = photos.row("nothing", image, mask, predict)
    assert text == "no object found"
    image[mask] = (200, 30, 30)
    something, text = photos.row("box", image, mask, predict)
    assert text == "plain, IoU 1.00"
    assert len(nothing) == len(something) == 7
    picture = Image.open(io.BytesIO(photos.encoded(photos.sheet([nothing, something]))))
    pixels = np.asarray(picture.convert("RGB"))
    assert (pixels[0] == 255).all()
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 20


def test_a_cut_out_stands_on_the_ground(tmp_path):
    pixels = np.zeros((50, 40, 4), np.uint8)
    pixels[5:45, 10:30] = (200, 30, 30, 255)
    pixels[5:20, 10:15, 3] = 0
    Image.fromarray(pixels).save(tmp_path / "a.png")
    sample = cutouts.read(pathlib.Path(tmp_path / "a.png"))
    np.testing.assert_array_equal(sample.mask, pixels[5:45, 10:30, 3] > 0)
    seen, _ = camera.project(sample.points, sample.intrinsics, sample.extrinsics)
    columns, rows = np.floor(seen).astype(int).T
    drawn = np.zeros_like(sample.mask)
    drawn[rows, columns] = True
    np.testing.assert_array_equal(drawn, sample.mask)
    np.testing.assert_allclose(sample.points[:, 0], 0, atol=1e-5)
    assert 0 < sample.points[:, 2].min() < 0.02
    assert 0.7 < np.ptp(sample.points[:, 2]) < 1
