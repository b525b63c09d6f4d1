import io
import sys
import types

import numpy as np
import pytest
from helpers.commands import PHOTOS
from helpers.obj_text import picture
from helpers.refusals import all_refused, refused
from PIL import Image

from psgn_jax.config.experiment import ConfigError
from psgn_jax.data import photo
from psgn_jax.data.resample import box_of, smooth_mask
from psgn_jax.prediction import mask_networks, masks, photo_files


def test_alpha_and_a_plain_background_come_before_the_network():
    rows, columns = np.mgrid[:180, :240]
    away = (rows - 90) ** 2 + (columns - 120) ** 2
    mask = (away < 50**2) & (away > 15**2)  # the background is visible through a hole
    image = np.full((180, 240, 3), 255, np.uint8)
    image[mask] = (150, 30, 40)
    found = masks.find_mask(image)
    assert found.method == "plain"
    np.testing.assert_array_equal(found.mask, mask)
    found = masks.find_mask(io.BytesIO(picture(image, "JPEG", quality=75)))
    assert found.method == "plain"
    assert masks.mask_iou(found.mask, mask) > 0.9
    found = masks.find_mask(np.dstack([image, np.uint8(255) * (away < 100)]))
    assert found.method == "alpha"
    np.testing.assert_array_equal(found.mask, away < 100)
    glass = np.uint8(60) * mask + np.uint8(180) * (away > 2400) * mask  # only its edge is opaque
    np.testing.assert_array_equal(masks.find_mask(np.dstack([image, glass])).mask, mask)


def test_the_network_finds_objects_or_a_mask_is_asked_for(rng):
    for name in ("bottle", "cup", "pan"):
        read = photo.read_photo(PHOTOS / f"{name}.jpg")
        given = photo.read_mask(PHOTOS / f"{name}_mask.png", read)
        found = masks.find_mask(read.image)
        assert found.method.startswith("network, ")
        assert masks.mask_iou(found.mask, given) > 0.85
    for image in (np.full((64, 64, 3), 90, np.uint8), rng.integers(0, 255, (64, 90, 3), np.uint8)):
        with refused(photo.PhotoError):
            masks.find_mask(image)
    with refused(photo.PhotoError, "mask_from=plain"):
        masks.find_mask(rng.integers(0, 255, (64, 64, 3), np.uint8), mask_from="plain")


@pytest.mark.parametrize(
    ("p", "top", "warns"), [(0.852, 20, True), (0.972, 20, False), (0.972, 2, True)]
)
def test_a_doubtful_mask_is_used_with_a_warning(monkeypatch, p, top, warns):
    seen = given_by({"whole": [(20, top, 80, 80)]}, p)
    monkeypatch.setattr(mask_networks, "probabilities", seen)
    found = masks.find_mask(np.zeros((100, 100, 3), np.uint8), mask_from="network")
    assert masks.mask_iou(found.mask, square(20, top, 80, 80)) > 0.95
    assert found.method == f"network, {int(100 * p)}% certain"
    assert bool(found.warnings) == found.doubtful == warns
    assert all("_overlay.png" in each and "box=x0" in each for each in found.warnings)
    # A hint is an answer if the mask is only near the border.
    hinted = masks.find_mask(np.zeros((100, 100, 3), np.uint8), mask_from="network", point=(50, 50))
    assert (bool(hinted.warnings), hinted.doubtful) == (p < 0.9, warns)
    assert all("box=x0" in each and "point" not in each for each in hinted.warnings)


def test_in_a_box_a_less_certain_mask_is_used_with_a_warning(monkeypatch):
    seen = given_by({key: [(20, 20, 80, 80)] for key in ("whole", "part")}, 0.7)
    monkeypatch.setattr(mask_networks, "probabilities", seen)
    image = np.zeros((100, 100, 3), np.uint8)
    with refused(masks.UncertainMaskError, "box=x0,y0,x1,y1", "accept_mask"):
        masks.find_mask(image, mask_from="network")
    found = masks.find_mask(image, mask_from="network", box=(10, 10, 90, 90))
    assert found.doubtful
    assert "point=x,y" in found.warnings[0]
    assert "box=" not in found.warnings[0]


def given_by(squares, p=0.99):
    """Stands in for the network: it sees squares in the whole image and in parts of it."""

    def found(image, box, **_):
        left, top, right, bottom = box
        whole = (left, top, right, bottom) == (0, 0, image.shape[1], image.shape[0])
        mask = np.zeros(image.shape[:2], bool)
        for each in squares["whole" if whole else "part"]:
            mask |= square(*each)
        part = mask[top:bottom, left:right]
        return np.where(smooth_mask(part, (320, 320)), np.float32(p), np.float32(0))

    return found


def test_a_box_in_the_mirror_image_gives_the_mirrored_mask():
    read = photo.read_photo(PHOTOS / "cup.jpg")
    top, bottom, left, right = box_of(photo.read_mask(PHOTOS / "cup_mask.png", read))
    image, width = read.image, read.image.shape[1]
    mask = masks.find_mask(image, mask_from="network", box=(left, top, right, bottom)).mask
    other = (width - right, top, width - left, bottom)
    mirrored = masks.find_mask(image[:, ::-1], mask_from="network", box=other).mask
    assert masks.mask_iou(mask, mirrored[:, ::-1]) > 0.998


def square(left, top, right, bottom):
    mask = np.zeros((100, 100), bool)
    mask[top:bottom, left:right] = True
    return mask


BESIDE, MIDDLE, SMALL = (5, 5, 35, 40), (50, 45, 75, 70), (40, 52, 43, 55)


@pytest.mark.parametrize(
    ("hints", "chosen"),
    [
        ({}, MIDDLE),  # not the largest, and not the small one, which is nearer to the middle
        ({"point": (10, 10)}, BESIDE),
        ({"point": (41, 53)}, SMALL),
        ({"box": (0, 0, 48, 60)}, BESIDE),
        ({"box": (0, 0, 20, 60)}, (5, 5, 20, 40)),  # nothing outside the box
        ({"box": (0, 0, 90, 90), "point": (60, 60)}, MIDDLE),
        ({"point": (90, 88)}, (85, 85, 95, 92)),  # found only in a part of the photo
    ],
)
def test_of_several_parts_one_is_chosen(monkeypatch, hints, chosen):
    seen = [BESIDE, MIDDLE, SMALL]
    squares = {"whole": seen, "part": [*seen, (85, 85, 95, 92)]}
    monkeypatch.setattr(mask_networks, "probabilities", given_by(squares))
    image = np.zeros((100, 100, 3), np.uint8)
    found = masks.find_mask(image, mask_from="network", accept_mask=True, **hints)
    assert masks.mask_iou(found.mask, square(*chosen)) > 0.8
    alpha = np.uint8(255) * (square(*BESIDE) | square(*MIDDLE))
    if hints and chosen in (BESIDE, MIDDLE):
        alone = masks.find_mask(np.dstack([image, alpha]), **hints).mask
        np.testing.assert_array_equal(alone, square(*chosen))


def test_hints_are_pixels_of_the_photo_in_its_full_size(monkeypatch, tmp_path):
    monkeypatch.setattr(photo, "MAX_SIDE", 100)
    network = given_by({"whole": [BESIDE, MIDDLE], "part": []})
    monkeypatch.setattr(mask_networks, "probabilities", network)
    Image.new("RGB", (300, 300)).save(tmp_path / "a.png")
    Image.fromarray(square(*MIDDLE)).save(tmp_path / "a_mask.png")
    read = photo.read_photo(tmp_path / "a.png")
    assert read.image.shape == (100, 100, 3)
    found = masks.find_mask(read, mask_from="network", point=(30, 30))
    assert masks.mask_iou(found.mask, square(*BESIDE)) > 0.9
    assert masks.find_mask(read).method == "a_mask.png"
    with refused(photo.PhotoError):
        masks.find_mask(read, box=(0, 0, 60, 60))  # the mask beside the photo is not used


def test_wrong_options_are_named(monkeypatch):
    table = [
        ({"box": (1, 2, 3)}, "box=1,2,3", "x0,y0,x1,y1"),
        ({"box": (50, 10, 20, 90)}, "box=50,10,20,90", "16 pixels"),
        ({"box": (50, 10, 90, 103)}, "box=50,10,90,103", "100x100"),
        ({"point": (np.nan, 2)}, "point=nan,2", "x,y"),
        ({"point": (10, 100)}, "point=10,100"),
        ({"point": (1, 2), "mask": square(*MIDDLE)}, "point"),
        ({"mask_from": "netwrok"}, "mask_from='netwrok'", *masks.METHODS),
        ({"mask_from": "plain:x"}, "mask_from='plain:x'", "rembg:MODEL"),
        ({"mask_from": "rembg:isnet"}, "rembg:isnet", "pip install"),
        ({"invert_mask": True}, "invert_mask"),
        ({"invert_mask": 1, "mask": square(*MIDDLE)}, "invert_mask=1"),
        ({"mask_label": 7}, "mask_label"),
    ]
    monkeypatch.setitem(sys.modules, "rembg", None)
    image = np.zeros((100, 100, 3), np.uint8)
    all_refused(lambda options: masks.find_mask(image, **options), ConfigError, table)


def test_the_masks_of_an_installed_rembg_are_taken(monkeypatch):
    rembg, sessions = types.ModuleType("rembg"), types.ModuleType("rembg.sessions")
    sessions.sessions_names = ["u2net", "u2netp"]
    seen = square(*BESIDE) | square(*MIDDLE)
    rembg.remove = lambda image, **_: np.uint8(255) * seen[: len(image), : image.shape[1]]

    def new_session(model, **_):
        if model == "u2net":
            raise OSError("no\nnetwork")

    rembg.new_session = new_session
    monkeypatch.setitem(sys.modules, "rembg", rembg)
    monkeypatch.setitem(sys.modules, "rembg.sessions", sessions)
    found = masks.find_mask(np.zeros((100, 100, 3), np.uint8), mask_from="rembg:u2netp")
    assert found[1:] == ("rembg:u2netp", (), False)
    np.testing.assert_array_equal(found.mask, square(*MIDDLE))
    table = [
        ("rembg:wide", "rembg:wide", "u2net, u2netp"),
        ("rembg", "rembg:u2net", "(no network)"),
    ]
    all_refused(masks.check_method, ConfigError, table)


def test_names_that_people_take_for_the_same_one_are_paired(tmp_path):
    chair, upper, lower = "stuhl_\u0061\u0308_MASK.png", "IMG_1_mask.PNG", "img_1_Mask.png"
    for name in (chair, upper, lower, "a_mask.heic", "b.png"):
        (tmp_path / name).touch()
    for stem, expected in (
        ("stuhl_\u00e4_mask", [chair]),
        ("img_1_Mask", [lower, upper]),
        ("A_mask", ["a_mask.heic"]),
        ("c_mask", []),
    ):
        assert [file.name for file in photo_files.images_named(tmp_path, stem)] == expected
    assert photo_files.images_named(tmp_path / "absent", "a") == []
