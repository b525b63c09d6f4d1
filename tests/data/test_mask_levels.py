"""Masks of data sets, editors and networks: the object, or a refusal; never a guess."""

import io
import shutil

import numpy as np
import pytest
from helpers.commands import PHOTOS
from helpers.javascript import NODE, node
from helpers.obj_text import picture
from helpers.refusals import all_refused, refused
from PIL import Image, ImageFilter

from psgn_jax.data import photo
from psgn_jax.portable import folder
from psgn_jax.web.browser.build import STATIC

HEIGHT, WIDTH = 240, 320
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH]
AWAY = np.hypot(ROWS - 120, COLUMNS - 150)
OBJECT = AWAY < 40
OTHER = (ROWS > 190) & (COLUMNS > 270)
READ = photo.read_photo(np.zeros((HEIGHT, WIDTH, 3), np.uint8))


def labels(object_is, other_is=None, rest=0, dtype=np.uint8):
    """Numbers for the object, another object and the rest."""
    other_is = rest if other_is is None else other_is
    return np.where(OBJECT, object_is, np.where(OTHER, other_is, rest)).astype(dtype)


TRIMAP = np.where(AWAY < 36, 255, np.where(AWAY < 44, 128, 0)).astype(np.uint8)


def with_palette(indices, *colours):
    image = Image.fromarray(indices, "P")
    image.putpalette(np.array(colours, np.uint8).tobytes())
    return image


def in_file(image, kind="PNG", **options):
    return io.BytesIO(picture(image, kind, **options))


RED_AND_GREEN = [(0, 0, 0), (255, 0, 0), (0, 255, 0)]
WHITE = Image.fromarray(OBJECT * np.uint8(255))
BLURRED = WHITE.filter(ImageFilter.GaussianBlur(3))
CUT_OUT = np.dstack([np.zeros((HEIGHT, WIDTH, 3), np.uint8), OBJECT * np.uint8(255)])


@pytest.mark.parametrize(
    "mask",
    [
        OBJECT, OBJECT.astype(np.float64), OBJECT[..., None], labels(1), labels(7, rest=3),
        labels(1, rest=-1, dtype=np.float32), labels(26001, rest=7, dtype=np.uint16),
        in_file(OBJECT), in_file(labels(1)), in_file(labels(26001, rest=7, dtype=np.uint16)),
        in_file(labels(1, dtype=np.float32), "TIFF"), in_file(WHITE, "JPEG", quality=30),
        in_file(WHITE, "WEBP", quality=30), in_file(WHITE.convert("LA")), in_file(BLURRED),
        in_file(np.asarray(BLURRED).astype(np.uint16) * 257), in_file(CUT_OUT),
        in_file(with_palette(labels(1), (0, 0, 0), (0, 0, 128))),
        in_file(with_palette(labels(1), (0, 0, 0), (0, 0, 128)), transparency=0),
        in_file(with_palette(labels(1), (0, 0, 0), (128, 64, 0)).convert("RGB"), "JPEG"),
        labels(1e39, dtype=np.float64), labels(1e-46, dtype=np.float64),
        labels(2**62 + 1, rest=2**62, dtype=np.int64), labels(1e308, rest=-1e308, dtype=float),
    ],
)  # fmt: skip
def test_two_levels_are_a_mask_and_their_edge_may_be_soft(mask):
    inside = photo.read_mask(mask, READ)
    assert (inside & OBJECT).sum() > 0.97 * (inside | OBJECT).sum()


@pytest.mark.parametrize(
    ("mask", "label"),
    [
        (labels(1, 2), 1),
        (labels(2, 1), 2),
        (in_file(labels(1, 2)), 1),
        (in_file(labels(26001, 26002, 7, np.uint16)), 26001),
        (labels(26001, 26002, 7, np.int64), (26001,)),
        (in_file(labels(7, 255)), 7),
        (in_file(TRIMAP), None),
        (in_file(labels(255, rest=(ROWS // 20 * 16 + COLUMNS // 20) % 95)), 255),
        (in_file(with_palette(labels(1, 2), *RED_AND_GREEN)), 1),
        (in_file(with_palette(labels(1, 2), *RED_AND_GREEN), transparency=0), 1),
        (in_file(with_palette(labels(1, 2), *[(0, 0, 0)] * 4)), 1),
        (in_file(with_palette(labels(1, 2), *RED_AND_GREEN), "GIF"), None),
        (in_file(with_palette(labels(1, 2), *RED_AND_GREEN).convert("RGB")), (255, 0, 0)),
        (in_file(np.uint8(np.where(ROWS < 200, ROWS // 10 * 7 % 20, labels(24, 255)))), None),
    ],
)
def test_several_labels_are_refused_unless_one_is_named(mask, label):
    with refused(photo.PhotoError, "mask_label"):
        photo.read_mask(mask, READ)
    if label is not None:
        np.testing.assert_array_equal(photo.read_mask(mask, READ, label), OBJECT)
    wrong = (99, "99"), ((1, 2, 3), "1,2,3"), ((1, 2), "1,2")
    all_refused(lambda other: photo.read_mask(mask, READ, other), photo.PhotoError, wrong)


def test_what_is_no_mask_is_refused():
    noise = np.random.default_rng(0).integers(0, 2, OBJECT.shape, np.uint8)
    table = [
        (np.where(OBJECT, np.nan, 0), "not finite"),
        (np.where(OBJECT, np.inf, 0), "not finite"),
        (np.where(OBJECT, "a", "b"), "<U1"),
        (np.where(OBJECT, np.hypot(ROWS, COLUMNS), 0), "mask_label"),  # depth
        (in_file(with_palette(labels(1, 2), *RED_AND_GREEN).convert("RGB"), "JPEG"), "levels"),
        (noise, "2 levels"),
        (COLUMNS % 2, "2 levels"),
        (OBJECT * (COLUMNS % 2) | (ROWS > 120) * noise, "2 levels"),
        (COLUMNS * 255 // WIDTH, "levels"),
    ]
    all_refused(lambda mask: photo.read_mask(mask, READ), photo.PhotoError, table)


@pytest.mark.parametrize("path", sorted(PHOTOS.glob("*.jpg"))[::3], ids=lambda path: path.stem)
@pytest.mark.parametrize("side", [None, 96])
def test_a_photograph_is_no_mask_but_a_soft_mask_is_one(path, side):
    with Image.open(path) as file:
        size = file.size if side is None else (side, round(side * file.height / file.width))
        small = file.resize(size)
    read = photo.read_photo(small)
    with refused(photo.PhotoError, "levels"):
        photo.read_mask(small, read)
    with Image.open(path.with_name(f"{path.stem}_mask.png")) as file:
        mask = file.convert("L").resize(size)
    for deviation in (1, 2):
        soft = photo.read_mask(mask.filter(ImageFilter.GaussianBlur(deviation)), read)
        assert (soft == photo.read_mask(mask, read)).mean() > 0.93


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_the_page_reads_or_refuses_masks_as_python(tmp_path):
    (tmp_path / "package.json").write_text('{"type": "module"}')
    for path in (*(folder.TEMPLATES / name for name in folder.JAVASCRIPT), STATIC / "mask.js"):
        shutil.copy(path, tmp_path)
    red = np.where(OBJECT[..., None], [255, 0, 0], [0, 0, 0])
    accepted = [labels(255), labels(1), np.asarray(BLURRED), labels(0, rest=255), red, CUT_OUT]
    photos = [Image.open(PHOTOS / f"{name}.jpg").resize((WIDTH, HEIGHT)) for name in ("car", "pan")]
    wrong = [labels(1, 2), labels(0), labels(255, rest=255), *photos]
    masks = [Image.fromarray(np.asarray(mask).astype(np.uint8)) for mask in (*accepted, *wrong)]
    body = """return input.masks.map(rgba => {
  try { return levels.objectIn(rgba, input.width, input.height); }
  catch (error) { return error.message; }
});"""
    given = [np.asarray(mask.convert("RGBA")) for mask in masks]
    path = {"levels": tmp_path / "mask.js"}
    results = node(body, path, masks=given, width=WIDTH, height=HEIGHT)
    for i, (mask, result) in enumerate(zip(masks, results, strict=True)):
        if i >= len(accepted):
            assert result.startswith("The mask "), i
            with pytest.raises(photo.PhotoError):
                photo.read_mask(mask, READ)
        else:
            inverted = i == 3
            assert bool(result["doubt"]) == inverted
            expected = photo.read_mask(mask, READ) ^ inverted
            np.testing.assert_array_equal(np.reshape(result["mask"], expected.shape), expected)
