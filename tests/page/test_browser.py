"""The page in a real browser: it predicts the same points as Python, and shows errors.

The page's content security policy forbids `eval`, which Playwright's `wait_for_function` needs.
Tests therefore evaluate expressions repeatedly.
"""

import json
import pathlib
import re
import shutil
import struct
import time
import zlib

import numpy as np
import pytest
from helpers import drawn_solids
from PIL import Image, ImageDraw

from psgn_jax.data import masks
from psgn_jax.prediction import export
from psgn_jax.prediction.predictor import Predictor

SECONDS = 120


@pytest.fixture(scope="module")
def address(site, serve):
    return serve(site)


@pytest.fixture
def opened(browser, address):
    """Opens the page; checks at the end that it logged nothing and used only its own server."""
    complaints, requests, contexts = [], [], []

    def open_page(at=address, complain=True, **options):
        context = browser.new_context(
            **{"viewport": {"width": 1200, "height": 860}, "reduced_motion": "reduce", **options}
        )
        context.set_default_timeout(1000 * SECONDS)
        contexts.append(context)
        context.on("request", lambda request: requests.append(request.url))
        page = context.new_page()
        if complain:
            page.on("console", lambda message: complaints.append(message.text))
            page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(at)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert complaints == []
    outside = ("blob:", "data:", "http://127.0.0.1:")
    assert [url for url in requests if not url.startswith(outside)] == []


def wait(page, expression):
    """Waits until an expression is true."""
    end = time.monotonic() + SECONDS
    while not page.evaluate(expression):
        assert time.monotonic() < end, (expression, status(page), problem(page))
        page.wait_for_timeout(40)


def status(page):
    return page.text_content("#status")


def problem(page):
    return page.text_content("#problem") if page.is_visible("#problem") else ""


SETTLED = (
    "/points in|No object/.test(document.getElementById('status').textContent)"
    " || !document.getElementById('problem').hidden"
)


def give(page, path):
    """Chooses a file and waits for points or an error."""
    page.evaluate("document.getElementById('status').textContent = ''")
    page.evaluate("document.getElementById('problem').hidden = true")
    page.set_input_files("#file", str(path))
    wait(page, SETTLED)


def predict_again(page, action):
    """Performs an action and waits for points or an error."""
    page.evaluate("document.getElementById('status').textContent = ''")
    action()
    wait(page, SETTLED)


def clouds(page):
    """Points float32 [k, n, 3] and colours uint8 [k, n, 3]."""
    state = page.evaluate(
        "psgn.state.clouds.map(c => [Array.from(c.points), Array.from(c.colours)])"
    )
    points = np.array([p for p, _ in state], np.float32)
    colours = np.array([c for _, c in state], np.uint8)
    return points.reshape(len(state), -1, 3), colours.reshape(len(state), -1, 3)


def mask_of(page, shape):
    return np.reshape(page.evaluate("Array.from(psgn.editor.mask)"), shape).astype(bool)


def cut_out(path, size=(300, 220)):
    """Writes a PNG of a coloured object on a transparent background; returns its array."""
    rng = np.random.default_rng(0)
    rgba = rng.integers(0, 256, (size[1] // 4, size[0] // 4, 4), dtype=np.uint8).repeat(4, 0)
    rgba = rgba.repeat(4, 1)
    rgba[..., 3] = 0
    rgba[60:190, 40:130, 3] = 255
    rgba[60:90, 130:250, 3] = 255
    rgba[rgba[..., 3] == 0, :3] = 0
    Image.fromarray(rgba).save(path)
    return rgba


def on_a_plain_ground(path, **options):
    """Writes an image of an object on white; returns its array."""
    picture = Image.new("RGB", (320, 240), (250, 250, 250))
    drawing = ImageDraw.Draw(picture)
    drawing.rectangle((80, 60, 200, 180), fill=(180, 60, 40))
    drawing.ellipse((180, 90, 280, 190), fill=(40, 90, 170))
    picture.save(path, **options)
    return np.asarray(picture)


@pytest.fixture(scope="module")
def predictor(run):
    return Predictor.from_run(run)


# --- photo to points ---------------------------------------------------------------------------


def test_points_and_files_are_those_of_python(opened, predictor, tmp_path):
    rgba = cut_out(tmp_path / "my chair.png")
    expected = predictor(rgba, samples=8, seed=0)
    page = opened()
    give(page, tmp_path / "my chair.png")
    assert "from its transparency" in status(page)
    points, colours = clouds(page)
    assert points.shape == expected.points.shape
    np.testing.assert_allclose(points, expected.points, atol=1e-3)
    assert (colours != expected.colours).any(axis=-1).mean() < 0.01
    assert page.text_content("#which") == "1 of 8"
    page.locator("#sample").fill("3")
    assert page.text_content("#which") == "4 of 8"
    writers = {"ply": export.ply, "obj": export.obj, "xyz": export.xyz}
    for name, write in writers.items():
        with page.expect_download() as download:
            page.click(f"[data-format={name}]")
        assert download.value.suggested_filename == f"my_chair_3.{name}"
        written = write(points[3], colours[3])
        own = pathlib.Path(download.value.path()).read_bytes()
        if name == "ply":
            assert own == written
        else:
            assert own.replace(b"-0.000000", b"0.000000") == written.replace(
                b"-0.000000", b"0.000000"
            )
    with page.expect_download() as download:
        page.click("#picture")
    with Image.open(download.value.path()) as picture:
        assert np.ptp(np.asarray(picture.convert("L"))) > 80


def test_a_training_rendering_is_taken_as_framed(opened, predictor, tmp_path):
    sample = next(iter(drawn_solids.samples(1, seed=2, image_size=(192, 256))))
    Image.fromarray(sample.image).save(tmp_path / "a.png")
    expected = predictor(sample.image, samples=8)
    assert not expected.view.placed
    page = opened()
    give(page, tmp_path / "a.png")
    np.testing.assert_array_equal(mask_of(page, (192, 256)), masks.plain(sample.image))
    np.testing.assert_allclose(clouds(page)[0], expected.points, atol=1e-3)


def test_a_photo_on_a_plain_ground(opened, predictor, tmp_path):
    image = on_a_plain_ground(tmp_path / "a.png")
    page = opened()
    give(page, tmp_path / "a.png")
    assert "on a plain background" in status(page)
    np.testing.assert_array_equal(mask_of(page, (240, 320)), masks.plain(image))
    expected = predictor(image, samples=8)
    np.testing.assert_allclose(clouds(page)[0], expected.points, atol=1e-3)


def test_a_photo_is_turned_upright(opened, tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    on_a_plain_ground(tmp_path / "a.jpg", quality=95, subsampling=0, exif=exif)
    page = opened()
    give(page, tmp_path / "a.jpg")
    assert page.evaluate("[psgn.editor.photo.width, psgn.editor.photo.height]") == [240, 320]
    rows, columns = np.nonzero(mask_of(page, (320, 240)))
    assert (rows.min(), columns.max()) == pytest.approx((80, 240 - 60), abs=9)


def test_an_object_among_other_things_is_found_and_corrected(opened, tmp_path):
    rng = np.random.default_rng(1)
    rows, columns = np.mgrid[:240, :320]
    discs = [(rows - 120) ** 2 + (columns - c) ** 2 < 45**2 for c in (90, 230)]
    image = np.where((discs[0] | discs[1])[..., None], (200, 60, 40), (60, 120, 170))
    image = (image + rng.normal(0, 14, image.shape)).clip(0, 255).astype(np.uint8)
    Image.fromarray(image).save(tmp_path / "a.png")
    page = opened()
    give(page, tmp_path / "a.png")
    assert "by its colours" in status(page)
    both = mask_of(page, discs[0].shape)
    assert (both & (discs[0] | discs[1])).sum() / (both | discs[0] | discs[1]).sum() > 0.95
    before = clouds(page)[0]
    page.check("input[value=remove]", force=True)
    box = page.locator("#photo").bounding_box()
    scale = box["width"] / 320

    def stroke():  # over most of the second disc
        path = [(195, 85), (265, 85), (265, 110), (195, 110), (195, 135), (265, 135), (265, 155)]
        page.mouse.move(box["x"] + 195 * scale, box["y"] + 155 * scale)
        page.mouse.down()
        for x, y in path[::-1]:
            page.mouse.move(box["x"] + x * scale, box["y"] + y * scale, steps=4)
        page.mouse.up()

    page.locator("#brush").fill("60")
    predict_again(page, stroke)
    one = mask_of(page, discs[0].shape)
    assert (one & discs[1]).sum() < 0.05 * discs[1].sum()
    assert (one & discs[0]).sum() > 0.9 * discs[0].sum()
    assert np.abs(clouds(page)[0] - before).max() > 1e-3
    predict_again(page, lambda: page.click("#undo"))
    np.testing.assert_array_equal(mask_of(page, discs[0].shape), both)
    np.testing.assert_allclose(clouds(page)[0], before, atol=1e-6)


# --- tools -------------------------------------------------------------------------------------


def test_brush_fill_invert_and_clear(opened, tmp_path):
    on_a_plain_ground(tmp_path / "a.png")
    page = opened()
    give(page, tmp_path / "a.png")
    shape = (240, 320)
    first = mask_of(page, shape)
    box = page.locator("#photo").bounding_box()
    at = {"x": 30 * box["width"] / 320, "y": 30 * box["width"] / 320}
    page.check("input[value=brush]", force=True)
    predict_again(page, lambda: page.click("#photo", position=at))
    painted = mask_of(page, shape)
    assert painted[30, 30]
    assert 20 < (painted & ~first).sum() < 2000
    page.check("input[value=fill]", force=True)
    page.check("input[value=remove]", force=True)
    inside = {"x": 100 * box["width"] / 320, "y": 100 * box["width"] / 320}
    predict_again(page, lambda: page.click("#photo", position=inside))
    filled = mask_of(page, shape)
    assert not filled[70:170, 90:170].any()
    assert filled[140, 260]
    predict_again(page, lambda: page.click("#invert"))
    np.testing.assert_array_equal(mask_of(page, shape), ~filled)
    page.click("#clear")
    wait(page, "!document.getElementById('problem').hidden")
    assert problem(page) == "The mask is empty: paint the object first."
    assert page.locator("[data-format=ply]").is_disabled()
    predict_again(page, lambda: page.click("#find"))
    assert problem(page) == ""
    np.testing.assert_array_equal(mask_of(page, shape), first)


def test_all_of_it_by_keyboard(opened, tmp_path):
    on_a_plain_ground(tmp_path / "a.png")
    page = opened()
    give(page, tmp_path / "a.png")
    reached = []
    page.evaluate("document.activeElement.blur()")
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.append(page.evaluate("document.activeElement.id || document.activeElement.value"))
    wanted = {"photo", "cloud", "brush", "undo", "find", "sample", "turning", "reset", "picture"}
    assert wanted <= set(reached)
    before = mask_of(page, (240, 320))
    page.check("input[value=brush]", force=True)
    page.focus("#photo")
    for key in ["Shift+ArrowLeft"] * 7 + ["ArrowUp", "Shift+ArrowUp"]:
        page.keyboard.press(key)
    predict_again(page, lambda: page.keyboard.press("Space"))
    after = mask_of(page, (240, 320))
    assert (after & ~before).sum() > 20
    assert np.nonzero(after & ~before)[1].max() < 80
    predict_again(page, lambda: page.keyboard.press("Control+z"))
    np.testing.assert_array_equal(mask_of(page, (240, 320)), before)
    view = page.evaluate("({...psgn.viewer.view})")
    page.focus("#cloud")
    for key in ("ArrowLeft", "ArrowUp", "+"):
        page.keyboard.press(key)
    turned = page.evaluate("({...psgn.viewer.view})")
    assert all(turned[name] != view[name] for name in view)
    page.keyboard.press("Home")
    assert page.evaluate("({...psgn.viewer.view})") == view


def test_every_control_has_a_name(opened, tmp_path):
    on_a_plain_ground(tmp_path / "a.png")
    page = opened()
    give(page, tmp_path / "a.png")
    tree = page.locator("body").aria_snapshot()
    controls = re.findall(r"- (button|slider|checkbox|radio|textbox|application)(.*)", tree)
    assert len(controls) > 15
    assert [control for control in controls if not re.match(r' ".+"', control[1])] == []
    assert 'heading "Photo to points"' in tree
    assert page.evaluate("document.documentElement.lang") == "en"


def test_a_phone(opened, predictor, tmp_path):
    rgba = cut_out(tmp_path / "a.png")
    phone = {"viewport": {"width": 375, "height": 700}, "has_touch": True, "is_mobile": True}
    page = opened(device_scale_factor=2, **phone)
    assert page.evaluate("document.documentElement.scrollWidth") <= 375
    give(page, tmp_path / "a.png")
    assert page.evaluate("document.documentElement.scrollWidth") <= 375
    expected = predictor(rgba, samples=8)
    np.testing.assert_allclose(clouds(page)[0], expected.points, atol=1e-3)
    page.locator("#cloud").scroll_into_view_if_needed()
    box = page.locator("#cloud").bounding_box()
    session = page.context.new_cdp_session(page)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    view = page.evaluate("psgn.viewer.view.turn")
    for kind, by in (("Start", 0), ("Move", 30), ("Move", 80)):
        touch = {"type": f"touch{kind}", "touchPoints": [{"x": x + by, "y": y}]}
        session.send("Input.dispatchTouchEvent", touch)
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    assert page.evaluate("psgn.viewer.view.turn") > view + 0.3


# --- errors ------------------------------------------------------------------------------------


def png_header(width, height):
    """A PNG whose header states this size, without pixels."""
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + head
    crc = struct.pack(">I", zlib.crc32(chunk))
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", len(head)) + chunk + crc


HOSTILE = {
    "empty.png": (b"", "This file is empty."),
    "notes.txt": (b"no picture at all", "not an image; expected a photo such as JPEG, PNG"),
    "text.jpg": (b"<html>" * 50, "not an image; expected a photo such as JPEG, PNG or WebP"),
    "drawing.svg": (b'<?xml version="1.0"?><svg xmlns="x"></svg>', "SVG drawings cannot be used"),
    "phone.heic": (b"\0\0\0\x18ftypheic" + b"\0" * 300, "read HEIC photos; save the photo as JPEG"),
    "scan.tif": (b"II*\0" + b"\0" * 300, "This browser cannot read TIFF images"),
    "huge.png": (png_header(30_000, 30_000), "30000 x 30000 pixels; up to 100 million"),
    "cut.png": (png_header(300, 300), "This image is damaged and cannot be decoded."),
    "broken.jpg": (b"\xff\xd8\xff\xe0" + b"\x11" * 500, "damaged and cannot be decoded"),
}


def test_hostile_files_end_in_a_sentence_and_the_page_goes_on(opened, tmp_path):
    on_a_plain_ground(tmp_path / "good.png")
    Image.new("RGB", (5, 900)).save(tmp_path / "ribbon.png")
    Image.new("RGBA", (90, 90)).save(tmp_path / "nothing.png")
    files = {"ribbon.png": "at least 16 per side", "nothing.png": "fully transparent"}
    for name, (content, sentence) in HOSTILE.items():
        (tmp_path / name).write_bytes(content)
        files[name] = sentence
    page = opened()
    for name, sentence in files.items():
        give(page, tmp_path / name)
        assert sentence in problem(page), name
        assert len(problem(page)) < 200
        assert page.locator("#problem").get_attribute("role") == "alert"
    give(page, tmp_path / "good.png")
    assert problem(page) == ""
    assert "points in" in status(page)


def test_a_large_photo_is_reduced(opened, tmp_path):
    picture = Image.new("RGB", (5000, 3000), (240, 240, 240))
    ImageDraw.Draw(picture).rectangle((1500, 800, 3500, 2600), fill=(90, 40, 30))
    picture.save(tmp_path / "large.jpg")
    page = opened()
    give(page, tmp_path / "large.jpg")
    assert page.evaluate("[psgn.editor.photo.width, psgn.editor.photo.height]") == [1600, 960]
    assert "points in" in status(page)


def test_dropped_text_is_no_file(opened):
    page = opened()
    page.evaluate(
        "document.body.dispatchEvent(new DragEvent('drop', "
        "{ bubbles: true, dataTransfer: new DataTransfer() }))"
    )
    wait(page, "!document.getElementById('problem').hidden")
    assert "not a file" in problem(page)


DAMAGE = {
    "one byte of the weights": ("network.onnx", lambda b: b[:5000] + b"\x55\xaa" + b[5002:]),
    "half of the weights": ("network.onnx", lambda b: b[: len(b) // 2]),
    "another network's description": ("network.json", lambda b: b.replace(b"psgn_jax", b"other")),
    "other numbers in the description": ("network.json", lambda b: b.replace(b"223", b"200")),
    "no description": ("network.json", lambda b: b"<!DOCTYPE html>"),
    "a graph that does not run": ("network.onnx", None),
    "weights that are gone": ("network.onnx", lambda b: None),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_wrong_or_damaged_weights_are_refused(name, opened, site, serve, tmp_path):
    import hashlib

    copy = shutil.copytree(site, tmp_path / "site")
    file, change = DAMAGE[name]
    content = (copy / file).read_bytes()
    if change is None:  # not a network, but with the right checksum
        content = b"\x08\x08" + b"\x00" * 100
        about = json.loads((copy / "network.json").read_text())
        digest = hashlib.sha256(content).hexdigest()
        about["files"][file] |= {"bytes": len(content), "sha256": digest}
        description = json.dumps(about).encode()
        (copy / "network.json").write_bytes(description)
        (copy / "network.sha256").write_text(hashlib.sha256(description).hexdigest())
    else:
        content = change(content)
    if content is None:
        (copy / file).unlink()
    else:
        (copy / file).write_bytes(content)
    page = opened(serve(copy), complain=False)
    wait(page, "!document.getElementById('problem').hidden")
    expected = {
        "weights that are gone": "The page is incomplete: network.onnx is missing.",
        "a graph that does not run": "This browser cannot run the network",
    }.get(name, "The network's file is damaged or belongs to another page")
    assert problem(page).startswith(expected)
    on_a_plain_ground(tmp_path / "a.png")
    page.set_input_files("#file", str(tmp_path / "a.png"))
    wait(page, "psgn.editor.photo && psgn.editor.mask.includes(1)")
    page.wait_for_timeout(300)
    assert problem(page).startswith(expected)
    assert page.evaluate("psgn.state.clouds.length") == 0


def test_the_example_of_an_export(browser, run, runtime, serve, tmp_path, predictor):
    """The page in the folder of `psgn export`, with the runtime beside it."""
    from psgn_jax.page.browser_runtime import runtime_files
    from psgn_jax.portable.folder import write_folder

    write_folder(run, tmp_path, weights=("float32",), stablehlo=False)
    for name, content in runtime_files(runtime).items():
        (tmp_path / name).write_bytes(content)
    rgba = cut_out(tmp_path / "photo.png")
    page = browser.new_page()
    page.goto(serve(tmp_path) + "example.html")
    page.wait_for_function("!document.querySelector('input').disabled", timeout=1000 * SECONDS)
    page.set_input_files("input", str(tmp_path / "photo.png"))
    wait_for = "document.querySelector('output').textContent.includes('points')"
    end = time.monotonic() + SECONDS
    while not page.evaluate(wait_for):
        assert time.monotonic() < end
        page.wait_for_timeout(50)
    text = page.text_content("output")
    numbers = [float(v) for v in re.findall(r"at (.*)", text)[0].split(",")]
    np.testing.assert_allclose(numbers, predictor(rgba).points[0, 0], atol=1e-3)
    page.close()
