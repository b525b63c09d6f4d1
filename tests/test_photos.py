"""The photos of the model card."""

import pathlib

from psgn_jax.data import photo

PHOTOS = sorted((pathlib.Path(__file__).resolve().parents[1] / "docs/photos").glob("*.jpg"))


def test_each_photo_is_small_and_has_a_mask_and_a_licence():
    assert len(PHOTOS) == 10
    licences = PHOTOS[0].with_name("README.md").read_text().splitlines()
    for path in PHOTOS:
        read = photo.read_photo(path)
        mask = path.with_name(f"{path.stem}_mask.png")
        assert photo.read_mask(mask, read).shape == read.image.shape[:2]
        assert path.stat().st_size + mask.stat().st_size <= 40_000
        (line,) = [line for line in licences if path.name in line]
        assert "GPL-2.0-or-later" in line or "public domain" in line
