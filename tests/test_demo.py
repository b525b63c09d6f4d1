"""What the demo's controls do, without gradio; and the page itself in a browser, with it."""

import concurrent.futures
import html
import io
import pathlib
import re
import threading
import types
import urllib.parse

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import standin
from PIL import Image

from psgn_jax.config import ConfigError
from psgn_jax.data import framing, photo
from psgn_jax.models import point_out_net
from psgn_jax.prediction import demo_editor, demo_server, example_photos
from psgn_jax.prediction import demo_page as lib
from psgn_jax.prediction.predictor import Predictor

ROOT = pathlib.Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def predictor():
    config = standin.config(
        model__name="vanilla",
        model__widths=(4, 6, 8),
        model__fc_points=50,
        model__fc_widths=(8,),
        model__random_size=3,
        data__image_size=(24, 32),
    )
    model = point_out_net.build(config.model)
    image = jnp.zeros((1, 24, 32, 4))
    params = jax.jit(lambda: model.init(jax.random.key(0), image, jnp.zeros((1, 3))))()["params"]
    return Predictor(config, params)


@pytest.fixture
def demo(predictor, tmp_path):
    return lib.Demo(predictor, tmp_path / "out")


@pytest.fixture
def box(tmp_path):
    """A photo, larger than the editor, of a box on one colour."""
    image = np.full((900, 1200, 3), 230, np.uint8)
    image[300:600, 400:900] = (200, 60, 20)
    path = tmp_path / "box.png"
    Image.fromarray(image).save(path)
    return path


def test_from_photo_to_files(demo, box):
    edited, line = demo.open_photo(str(box), "auto")
    assert "plain background" in line
    assert edited["background"].shape == (600, 800, 3)
    read = photo.read_photo(box)
    mask = demo_editor.painted(edited, read.image.shape)
    assert mask.mean() == pytest.approx(1 / 7.2, rel=0.02)
    shown, files, line = demo.predict(str(box), edited, 2, 5, "auto")
    assert line.startswith("2 clouds of 50 points in ")
    assert shown.startswith("<iframe")
    assert "<script" not in shown  # escaped, within the frame alone
    names = [pathlib.Path(file).name for file in files]
    clouds = [f"box_{k}.{suffix}" for k in (0, 1) for suffix in ("obj", "ply", "xyz")]
    assert sorted(names) == sorted([*clouds, "box.json", "box.npz", "box_view.png"])
    with np.load(next(file for file in files if file.endswith(".npz"))) as archive:
        want = demo.predictor(read.image, mask, samples=2, seed=5).points
        np.testing.assert_array_equal(archive["points"], want)


def test_the_painted_mask_counts(demo, box):
    edited, _ = demo.open_photo(str(box), "auto")
    edited["layers"][0][:, 450:] = 0  # erased
    _, files, _ = demo.predict(str(box), edited, 1, 0, "place")
    with np.load(next(file for file in files if file.endswith(".npz"))) as archive:
        rows, columns = np.nonzero(archive["mask"])
    ratio = np.ptp(columns) / np.ptp(rows)
    assert ratio == pytest.approx((450 - 267) / 200, rel=0.05)


@pytest.mark.parametrize("shape", [(900, 1200), (1100, 300), (40, 1000), (57, 61), (16, 16)])
def test_a_mask_survives_the_editor(shape):
    """Photo -> canvas -> photo: the mask comes back, to within the canvas's pixels."""
    rows, columns = demo_editor.place_in_editor(shape)
    on_canvas = (rows.stop - rows.start, columns.stop - columns.start)
    assert max(on_canvas[0] / 600, on_canvas[1] / 800) == 1  # it fills the canvas one way
    mask = np.zeros(shape, np.bool_)
    mask[shape[0] // 4 : shape[0] // 2, shape[1] // 3 :] = True
    layer = np.zeros((*demo_editor.EDITOR_SIZE, 4), np.uint8)
    layer[rows, columns][photo.resize_mask(mask, on_canvas)] = demo_editor.PAINT
    back = demo_editor.painted({"layers": [layer]}, shape)
    coarse = max(1, shape[0] / on_canvas[0])
    assert back.shape == shape
    assert (back != mask).sum() <= coarse * (2 * mask.any(0).sum() + mask.any(1).sum())
    if coarse == 1:
        np.testing.assert_array_equal(back, mask)


def test_paint_beside_the_photo_and_thin_paint_do_not_count():
    layers = [np.zeros((*demo_editor.EDITOR_SIZE, 4), np.uint8) for _ in range(2)]
    layers[0][:, :200] = demo_editor.PAINT  # the photo lies on columns 250 to 549
    layers[1][300:, :, 3] = 40
    layers[1][:60, 250:400, 3] = 255
    mask = demo_editor.painted({"layers": layers}, (200, 100))
    want = np.zeros((200, 100), np.bool_)
    want[:20, :50] = True
    np.testing.assert_array_equal(mask, want)


def test_examples_are_small_and_give_clouds_at_once(demo):
    paths = example_photos.example_photos()
    assert len(paths) == 6
    assert sum(path.stat().st_size for path in paths) < 300_000
    for number, path in enumerate(paths):
        read = photo.read_photo(path)
        assert read.image.shape == (192, 256, 3)
        assert framing.is_framed(read.image)
        example, edited, line, shown, files, result = demo.open_example(number)
        assert example == str(path)
        assert "transparency" in line
        mask = demo_editor.painted(edited, read.image.shape)
        assert (mask != (read.alpha > 127)).mean() < 0.005
        assert 0.05 < mask.mean() < 0.4
        assert shown.startswith("<iframe")
        assert path.stem in pathlib.Path(files[0]).name
        assert result.startswith("1 cloud of 50 points")


def test_links_lead_to_the_files(tmp_path):
    path = tmp_path / 'a "b" #&?é.npz'
    path.write_bytes(b"12345" * 300)
    (link,) = re.findall(r'href="([^"]*)"', text := lib.links_to([str(path)]))
    served = urllib.parse.unquote(html.unescape(link).removeprefix("gradio_api/file="))
    assert served == str(path)
    assert not set("?# ") & set(link)
    assert "(1,500 bytes)" in text
    assert lib.links_to([]) == ""


def test_what_goes_wrong_is_one_line_without_the_folder(demo, box, tmp_path):
    (tmp_path / "a<b>.png").write_text("no image")
    bad = str(tmp_path / "a<b>.png")
    edited, line = demo.open_photo(bad, "auto")
    assert edited is None
    assert "a&lt;b&gt;.png is not an image of a known format" in line
    assert str(tmp_path) not in line
    blank = tmp_path / "blank.png"
    Image.new("RGB", (80, 80), "blue").save(blank)
    edited, line = demo.open_photo(str(blank), "plain")
    assert edited["background"].shape == (600, 800, 3)
    assert "no object found" in line
    assert "Paint the object" in line
    assert "no mask: paint the object" in demo.predict(str(blank), edited, 1, 0, "auto")[2]
    other = {**edited, "layers": [np.zeros((80, 80, 4), np.uint8)]}
    assert "layer is [80, 80]: accepted: [600, 800]" in demo.predict(str(blank), other)[2]
    for cleared in (None, {"background": None, "layers": []}):  # the mask is looked for, in vain
        assert "no object found" in demo.predict(str(blank), cleared)[2]
    assert "no photo" in demo.predict(None, None, 1, 0, "auto")[2]
    assert demo.open_photo(None, "auto") == (None, "")
    good, _ = demo.open_photo(str(box), "auto")
    for seed in (0.5, None, 2.0**40):
        assert f"seed={seed}: accepted" in demo.predict(str(box), good, 1, seed, "auto")[2].replace(
            "1099511627776", "1099511627776.0"
        )
    assert "samples=0: accepted" in demo.predict(str(box), good, 0, 0, "auto")[2]


def test_old_results_go(demo, box, monkeypatch):
    edited, _ = demo.open_photo(str(box), "auto")
    _, first, _ = demo.predict(str(box), edited, 1, 0, "auto")
    _, second, _ = demo.predict(str(box), edited, 1, 0, "auto")
    assert pathlib.Path(first[0]).exists()
    now = lib.time.time()
    monkeypatch.setattr(lib.time, "time", lambda: now + lib.KEPT_SECONDS + 60)
    _, third, _ = demo.predict(str(box), edited, 1, 0, "auto")
    assert [pathlib.Path(f[0]).exists() for f in (first, second, third)] == [False, False, True]


def test_without_gradio(demo, monkeypatch):
    monkeypatch.setattr(lib.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match="needs the extra 'demo': pip install"):
        lib.launch(demo, None, "127.0.0.1")


def test_photos_that_take_too_much_memory_are_refused_by_their_header(demo, tmp_path, monkeypatch):
    path = tmp_path / "large.png"
    Image.new("L", (300, 400)).save(path)
    monkeypatch.setattr(lib, "MAX_PIXELS", 100_000)
    monkeypatch.setattr(photo, "read_photo", None)  # not reached
    assert "has 120,000 pixels: accepted: up to 100,000" in demo.open_photo(str(path), "auto")[1]
    assert "has 120,000 pixels: accepted: up to 100,000" in demo.predict(str(path), None)[2]
    # A JPEG is decoded smaller.
    Image.new("L", (4200, 4200)).save(path := tmp_path / "large.jpg")
    assert photo.decoded_pixels(path) == 2100**2


def test_large_photos_leave_room_for_others(demo, box, tmp_path, monkeypatch):
    large = tmp_path / "large.png"
    Image.fromarray(np.asarray(Image.open(box))).resize((1400, 1050)).save(large)
    monkeypatch.setattr(lib, "LARGE_PIXELS", 1_200_000)
    reading, go_on = threading.Semaphore(0), threading.Semaphore(0)
    read = photo.read_photo

    def slow(path):
        if str(path) == str(large):
            reading.release()
            assert go_on.acquire(timeout=60)
        return read(path)

    monkeypatch.setattr(photo, "read_photo", slow)
    with concurrent.futures.ThreadPoolExecutor(8) as threads:
        held = [threads.submit(demo.open_photo, str(large), "plain") for _ in range(4)]
        assert reading.acquire(timeout=60)
        assert not reading.acquire(timeout=0.2)  # one at a time
        while True:  # the fifth is not to wait
            edited, line = demo.open_photo(str(large), "plain")
            if "large photos are being read" in line:
                break
        assert edited is None
        assert demo.open_photo(str(box), "plain")[0] is not None
        for _ in held:
            go_on.release()
        assert all("plain background" in future.result()[1] for future in held)
    go_on.release()
    assert demo.open_photo(str(large), "plain")[0] is not None


def picture(size=demo_editor.EDITOR_SIZE):
    stream = io.BytesIO()
    Image.new("RGBA", size[::-1]).save(stream, "png")
    return stream.getvalue()


class Editor:
    """What `bound_editor` changes of gradio's."""

    def __init__(self):
        self.decoded, self.accepted, self.blob_storage = [], [], {}

    def preprocess(self, payload):
        self.decoded.append(payload)
        return {"background": None, "layers": [], "composite": None}

    def accept_blobs(self, data):
        self.accepted.append(data)


def test_the_editors_value_is_checked_before_it_is_decoded(tmp_path):
    editor = Editor()
    demo_editor.bound_editor(editor)
    good, large = picture(), picture((5000, 5000))
    (tmp_path / "good.png").write_bytes(good)
    file = types.SimpleNamespace(path=str(tmp_path / "good.png"))

    def value(layers, background=None, id=None):
        return types.SimpleNamespace(background=background, composite=None, layers=layers, id=id)

    for fine in (None, value([file], file), value([None]), value([], id="gone")):
        assert "refused" not in editor.preprocess(fine)
    assert len(editor.decoded) == 4
    editor.blob_storage["a"] = value([good], good)
    assert "refused" not in editor.preprocess(value([], id="a"))
    for bad, message in (
        (value([large]), r"layer is [5000, 5000]: accepted: [600, 800]"),
        (value([good] * 7), "7 layers of a mask: accepted: up to 4"),
        (value([b"no image"]), "is not an image"),
        (value([file], types.SimpleNamespace(path=str(tmp_path / "none"))), "is not an image"),
    ):
        refused = editor.preprocess(bad)
        assert message in refused["refused"]
        with pytest.raises(photo.PhotoError):
            demo_editor.shows_photo(refused)
    assert len(editor.decoded) == 5
    for number in range(100):
        editor.blob_storage[str(number)] = number
    assert len(editor.blob_storage) == demo_editor.KEPT_VALUES

    def blob(index, content=b"x"):
        return types.SimpleNamespace(data={"index": index}, files=[("file", content)])

    assert editor.accept_blobs._is_server_fn
    for fine in ("null", None, "0", "3"):
        editor.accept_blobs(blob(fine))
    for index in ("4", "1000000000", "-1", "x", "\u0663"):
        with pytest.raises(ValueError, match="layer"):
            editor.accept_blobs(blob(index))
    with pytest.raises(ValueError, match="too large"):
        editor.accept_blobs(blob("0", bytes(demo_editor.MAX_LAYER_BYTES + 1)))
    assert len(editor.accepted) == 4


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # gradio's and its server's own
def test_in_a_browser(page, demo, box, tmp_path, monkeypatch):
    if lib.importlib.util.find_spec("gradio") is None:
        pytest.skip("no gradio")
    monkeypatch.setenv("GRADIO_TEMP_DIR", str(tmp_path / "gradio"))
    listener, address = demo_server.listen("127.0.0.1", 0)
    server = lib.launch(demo, listener, "127.0.0.1")
    requests, errors = [], []
    try:
        assert address.startswith("http://127.0.0.1:")
        page.set_default_timeout(60_000)
        page.on("request", lambda request: requests.append(request.url))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        page.wait_for_selector("#predict[disabled]")
        frame = page.frame_locator("#viewer iframe")
        page.locator("#examples button:has(img)").nth(1).click()
        frame.locator("#prediction").wait_for()
        assert frame.locator("#name").text_content() == example_photos.example_photos()[1].stem
        assert page.get_by_text("1 cloud of 50 points").is_visible()
        page.wait_for_selector("#predict:not([disabled])")
        page.get_by_label("Clear", exact=True).click()
        page.wait_for_selector("#predict[disabled]")
        page.locator("input[type=file]").first.set_input_files(str(box))
        page.wait_for_selector("#predict:not([disabled])")
        assert page.get_by_text("stands out from a plain background").is_visible()
        page.click("#predict")
        frame.locator("#name", has_text="box").wait_for()
        assert frame.locator("#name").text_content() == "box"
        assert page.get_by_text("1 cloud of 50 points").is_visible()
        with page.expect_download() as download:
            page.get_by_role("link", name="box.npz").click()
        with np.load(download.value.path()) as archive:
            assert archive["points"].shape == (1, 50, 3)
    finally:
        server.close()
    assert errors == []
    assert [u for u in requests if not u.startswith((address, "data:", "blob:", "about:"))] == []
