import io
import json
import os
import struct

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.commands import python
from helpers.obj_text import GREY, png_header, scene
from helpers.refusals import all_refused, refused
from PIL import Image, ImageCms

from psgn_jax.data import framing, photo, resample


def saved(tmp_path, image, name="photo.png", **options):
    path = tmp_path / name
    (image if isinstance(image, Image.Image) else Image.fromarray(image)).save(path, **options)
    return path


def test_a_large_image_is_reduced_and_accepts_masks_of_both_sizes(tmp_path):
    mask = np.zeros((4100, 40), bool)
    mask[500:900, 10:30] = True
    colours = np.repeat(mask[..., None] * np.uint8(200), 3, axis=2)
    read = photo.read_photo(saved(tmp_path, colours, "large.jpg"))
    assert read.size == (4100, 40)
    assert read.image.shape == (2050, 20, 3)
    np.testing.assert_array_equal(read.image[..., 0] > 100, mask[::2, ::2])
    for given in (mask, mask[::2, ::2], Image.fromarray(mask)):
        np.testing.assert_array_equal(photo.read_mask(given, read), mask[::2, ::2])
    with refused(photo.PhotoError, "40x10", "40x4100"):
        photo.read_mask(mask[:10], read)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_honoured_for_image_and_mask(tmp_path, orientation):
    image, mask = scene()
    image[:20, :30] = (0, 0, 255)  # distinguishes all eight orientations
    # Pillow's numbers of the operations that turn an upright picture into the stored one.
    undo = {2: 0, 3: 3, 4: 1, 5: 5, 6: 2, 7: 6, 8: 4}.get(orientation)

    def as_stored(pixels):
        picture = Image.fromarray(pixels)
        return picture if undo is None else picture.transpose(undo)

    exif = Image.Exif()
    exif[0x0112] = orientation
    path = saved(tmp_path, as_stored(image), exif=exif)
    read = photo.read_photo(path)
    np.testing.assert_array_equal(read.image, image)
    assert read.size == (120, 160)
    turned = as_stored(mask)
    turned.getexif()[0x0112] = orientation
    np.testing.assert_array_equal(photo.read_mask(turned, read), mask)
    np.testing.assert_array_equal(photo.read_mask(mask, read), mask)
    if orientation > 4:  # a mask drawn over the pixels as stored
        np.testing.assert_array_equal(photo.read_mask(as_stored(mask), read), mask)


@pytest.mark.parametrize("mode", ["L", "1", "P", "CMYK", "LA", "RGBA", "PA", "YCbCr", "I;16", "F"])
def test_modes(tmp_path, mode):
    image, _ = scene(back=(255, 255, 255), colour=(0, 0, 0))
    rgb = Image.fromarray(image)
    grey = np.asarray(rgb.convert("L"))
    not_convertible = {
        "I;16": Image.fromarray(grey.astype(np.uint16) * 257),
        "F": Image.fromarray(grey.astype(np.float32) / 255),
        "PA": rgb.convert("RGBA").quantize(),
    }
    picture = not_convertible.get(mode) or rgb.convert(mode)
    name = {"CMYK": "a.jpg", "YCbCr": "a.jpg", "F": "a.tif"}.get(mode, "a.png")
    read = photo.read_photo(saved(tmp_path, picture, name))
    assert read.image.dtype == np.uint8
    assert np.abs(read.image.astype(int) - image).mean() < 3
    assert read.alpha is None


def test_hostile_files_end_in_one_line(tmp_path):
    whole = saved(tmp_path, np.random.default_rng(0).integers(0, 255, (99, 99, 3), np.uint8))
    (tmp_path / "cut.png").write_bytes(whole.read_bytes()[:9_000])
    with Image.open(tmp_path / "cut.png") as cut, refused(photo.PhotoError, "the image"):
        photo.read_photo(cut)
    (tmp_path / "text.png").write_text("no image")
    saved(tmp_path, np.zeros((1, 1, 3), np.uint8), "one.png")
    (tmp_path / "bomb.png").write_bytes(png_header(40_000, 40_000))
    (tmp_path / "large.png").write_bytes(png_header(13_000, 13_000))
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "lfs.jpg").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0")
    (tmp_path / "page.jpg").write_text(" <!DOCTYPE html><title>Sign in</title>")
    table = [
        ("cut.png", "cut.png"),
        ("text.png", "PNG, JPEG", "HEIC"),
        ("one.png", "1x1", "16"),
        ("bomb.png", "150,000,000"),
        ("large.png", "13000x13000", "150,000,000"),
        ("absent.png", "absent.png"),
        (".", "a folder"),
        ("pipe.png", "a named pipe"),
        ("lfs.jpg", "git lfs pull"),
        ("page.jpg", "web page"),
    ]
    all_refused(lambda name: photo.read_photo(tmp_path / name), photo.PhotoError, table)


def test_colours_with_a_profile_become_srgb(tmp_path):
    image, _ = scene()
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    swapped = profile.replace("sRGB".encode("utf-16-be"), "xRGB".encode("utf-16-be"))
    for tag in (b"XYZ", b"TRC"):  # red and blue
        swapped = swapped.replace(b"r" + tag, b"-" + tag, 1).replace(b"b" + tag, b"r" + tag, 1)
        swapped = swapped.replace(b"-" + tag, b"b" + tag, 1)
    alpha = np.where(image[..., :1] == 200, 255, 0).astype(np.uint8)
    for given, expected in ((profile, image), (swapped, image[..., ::-1]), (b"junk", image)):
        for pixels in (image, np.concatenate([image, alpha], axis=2)):
            read = photo.read_photo(saved(tmp_path, pixels, icc_profile=given))
            assert np.abs(read.image.astype(int) - expected).max() <= 2
            assert (read.alpha is None) == (pixels is image)
            assert bool(read.warnings) == (given == b"junk")


def test_masks_of_other_sizes_and_of_mode_1():
    image, mask = scene()
    read = photo.read_photo(image)
    half = Image.fromarray(mask).resize((80, 60))
    assert (photo.read_mask(half, read) == mask).mean() > 0.99
    ones = mask.astype(np.uint8)  # 0 and 1, not 255
    np.testing.assert_array_equal(photo.read_mask(ones, read), mask)
    table = [
        (ones[:, :120], "120x120", "160x120"),
        (np.zeros((120, 160), np.uint8), "empty"),
        (np.full((120, 160), 255, np.uint8), "whole image"),
        (image, "(120, 160, 3)", "(height, width)"),
    ]
    all_refused(lambda wrong: photo.read_mask(wrong, read), photo.PhotoError, table)
    # Pillow's mode "1" gives a bool array whose True is the byte 255.
    of_pillow = np.array(Image.fromarray(mask))
    assert of_pillow.view(np.uint8).max() == 255
    want, got = framing.place(image, mask), framing.place(image, of_pillow)
    np.testing.assert_array_equal(got.mask, want.mask)
    np.testing.assert_array_equal(got.image, want.image)
    small, other = (resample.resize_mask(each, (55, 70)) for each in (mask, of_pillow))
    np.testing.assert_array_equal(other, small)


def test_open_files_and_arrays_of_jax_are_read_and_a_list_is_refused(tmp_path):
    image, mask = scene()
    stream = io.BytesIO(saved(tmp_path, image).read_bytes())
    stream.read()  # somebody has looked at it
    read = photo.read_photo(stream)
    np.testing.assert_array_equal(read.image, image)
    with saved(tmp_path, mask, "mask.png").open("rb") as file:
        np.testing.assert_array_equal(photo.read_mask(file, read), mask)
    np.testing.assert_array_equal(photo.read_photo(jnp.asarray(image)).image, image)
    np.testing.assert_array_equal(photo.read_mask(jnp.asarray(mask), read), mask)
    table = [([image], "a list"), (3, "int", "a path"), (np.zeros((50, 50)), "float64", "uint8")]
    table += [(io.StringIO("P1"), "StringIO", "binary")]
    all_refused(photo.read_photo, ValueError, table)
    with refused(ValueError, "the mask", "a list"):
        photo.read_mask([mask], read)


def test_the_focal_length_comes_from_exif(tmp_path):
    image, _ = scene(240, 360)
    assert photo.read_photo(image).focal is None
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 28
    for orientation in 1, 6:
        exif[0x0112] = orientation
        path = saved(tmp_path, image, "a.jpg", exif=exif)
        assert photo.read_photo(path).focal == pytest.approx(280)


@pytest.mark.parametrize("size", [(20, 90), (300, 150)])
def test_the_box_is_where_training_objects_are(size):
    high, wide = size
    image, mask = scene(400, 500, (7, 7 + high, 300, 300 + wide))
    view = framing.place(image, mask)
    rows, columns = np.flatnonzero(view.mask.any(1)), np.flatnonzero(view.mask.any(0))
    h, w = rows[-1] + 1 - rows[0], columns[-1] + 1 - columns[0]
    assert (w / 223) ** 4 + (h / 124) ** 4 == pytest.approx(1, abs=0.08)
    assert w / h == pytest.approx(wide / high, rel=0.06)
    assert (columns[0] + columns[-1] + 1) / 2 == pytest.approx(128, abs=1)
    assert (rows[0] + rows[-1] + 1) / 2 == pytest.approx(63 + 0.224 * w, abs=1)
    assert (view.image[~view.mask] == GREY).all()
    assert np.abs(view.image[view.mask].astype(int) - [200, 60, 20]).max() <= 4


_PEAK = """
import json, resource, sys
import numpy as np
from PIL import Image, ImageCms
from psgn_jax.data import framing, photo
from psgn_jax.prediction import masks
for width, height, mode in json.loads(sys.argv[1]):
    picture = Image.new(mode, (width, height), (255,) * len(mode))
    box = (width // 4, height // 4, width - width // 4, height - height // 4)
    picture.paste((60,) * len(mode), box)
    picture.save("photo.png", compress_level=1)
    read = photo.read_photo("photo.png")
    mask = Image.new("L", (width, height))
    mask.paste(255, box)
    mask.save("mask.png", compress_level=1)
    masks.find_mask(read)
    try:
        framing.place(read.image, photo.read_mask("mask.png", read))
    except photo.PhotoError as error:
        assert "vanishes" in str(error) and min(width, height) < 0.01 * max(width, height), error
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


def test_no_shape_of_40_megapixels_takes_more_than_one_and_a_half_gb(tmp_path):
    """A small file can have any shape, and a thin object needs a view that is much larger."""
    shapes = [(16, 65_500, "RGB"), (65_500, 260, "RGB"), (610, 65_500, "RGB")]
    shapes += [(20_000, 2_000, "RGB"), (6_300, 6_300, "RGBA")]
    assert int(python(_PEAK, json.dumps(shapes), cwd=tmp_path).stdout) < 1.5e9


def orientation_as(kind, data, count=1):
    """EXIF with an orientation of this type."""
    entry = struct.pack(">HHI", 0x0112, kind, count)
    entry += data.ljust(4, b"\0") if len(data) <= 4 else struct.pack(">I", 26)
    head = b"MM\0*" + struct.pack(">IH", 8, 1)
    return b"Exif\0\0" + head + entry + bytes(4) + (data if len(data) > 4 else b"")


@pytest.mark.parametrize(
    "exif",
    [
        *(orientation_as(*entry) for entry in (
            (2, b"junk\0", 5), (3, b"\0\x09"), (4, b"\xff" * 4), (5, bytes(8)), (7, b"\6"),
            (12, struct.pack(">d", float("nan"))), (99, b"\6"), (3, b"", 0),
        )),
        b"junk", b"Exif\0\0II*\0\xff\xff\xff\xff",
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:Corrupt EXIF")  # where the test opens the file itself
def test_odd_orientations_are_read_as_upright(tmp_path, exif):
    image, mask = scene()
    for name in ("a.jpg", "a.png", "a.webp"):
        path = saved(tmp_path, image, name, exif=exif)
        read = photo.read_photo(path)
        assert (read.size, read.orientation) == ((120, 160), 1)
        with Image.open(path) as file:
            assert photo.read_photo(file).orientation == 1
    mask_file = saved(tmp_path, mask, "mask.png", exif=exif)
    np.testing.assert_array_equal(photo.read_mask(mask_file, read), mask)
    path = saved(tmp_path, image, "a.png", exif=orientation_as(3, b"\0\6"))
    assert photo.read_photo(path).orientation == 6


def test_training_renderings_keep_their_frame():
    image, mask = scene(192, 256, (60, 150, 60, 200))
    assert framing.is_framed(image)
    view = framing.place(image, mask, move=False)
    np.testing.assert_array_equal(view.image, image)
    np.testing.assert_array_equal(view.mask, mask)
    assert not framing.is_framed(image[:, :200])
    assert not framing.is_framed(np.where(mask[..., None], image, np.uint8(180)))
    with refused(photo.PhotoError, "4:3"):
        framing.place(image[:, :200], mask[:, :200], move=False)


def test_placing_lets_nothing_bleed_in_and_refuses_wrong_masks():
    image, mask = scene(600, 800, (100, 500, 200, 600), colour=(0, 0, 0), back=(255, 255, 255))
    view = framing.place(image, mask)
    assert view.image[view.mask].max() <= 2
    image, mask = scene()
    dot = np.zeros_like(mask)
    dot[5, 5] = True
    table = [(np.zeros_like(mask), "empty"), (np.ones_like(mask), "whole image"), (dot, "1x1", "8")]
    all_refused(lambda wrong: framing.place(image, wrong), photo.PhotoError, table)
