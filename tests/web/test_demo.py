"""What the demo's controls do, without gradio; and its page in a browser, with it."""

import os
import pathlib
import re
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest
from helpers import weights as helper
from PIL import Image

from psgn_jax.config import ConfigError
from psgn_jax.data import photo, resize
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.web import demo as lib
from psgn_jax.weights.run_folder import Run

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def predictor():
    config = helper.config(model__fc_points=50, model__random_size=3, data__image_size=(24, 32))
    return Predictor(Run(config, 0, helper.random_params(config), {}))


@pytest.fixture
def demo(predictor, tmp_path):
    return lib.Demo(predictor, tmp_path / "out")


@pytest.fixture
def box(tmp_path):
    """A photo, larger than the editor, of a box on one colour; and a mask of its left half."""
    image = np.full((900, 1200, 3), 230, np.uint8)
    image[300:600, 400:900] = (200, 60, 20)
    Image.fromarray(image).save(tmp_path / "box.png")
    mask = np.zeros((900, 1200), np.uint8)
    mask[300:600, 400:650] = 255
    Image.fromarray(mask).save(tmp_path / "half.png")
    return str(tmp_path / "box.png"), str(tmp_path / "half.png")


def test_from_photo_to_files(demo, box):
    edited, line = demo.open_photo(box[0], None)
    assert "plain" in line
    read = photo.read_photo(box[0])
    mask = lib.painted(edited["layers"], read.image.shape)
    assert mask.mean() == pytest.approx(1 / 7.2, rel=0.02)
    shown, files, line = demo.predict(box[0], edited, 2, 5, "auto")
    assert line.startswith("2 x 50 points in ")
    assert "<script" not in shown  # escaped, within the frame alone
    names = {pathlib.Path(file).name for file in files}
    assert {"box_0.ply", "box_1.ply", "box.json", "box.npz", "box_view.png"} <= names
    with np.load(next(file for file in files if file.endswith(".npz"))) as archive:
        want = demo.predictor(read.image, mask, samples=2, seed=5).points
        np.testing.assert_array_equal(archive["points"], want)


def test_a_mask_file_counts(demo, box):
    edited, line = demo.open_photo(*box)
    assert "the given file" in line
    _, files, _ = demo.predict(box[0], edited, 1, 0, "place")
    with np.load(next(file for file in files if file.endswith(".npz"))) as archive:
        rows, columns = np.nonzero(archive["mask"])
    assert np.ptp(columns) / np.ptp(rows) == pytest.approx(250 / 300, rel=0.05)


@pytest.mark.parametrize("shape", [(900, 1200), (1100, 300), (40, 1000), (16, 16)])
def test_a_mask_survives_the_editor(shape):
    rows, columns = lib.place_in_editor(shape)
    on_canvas = (rows.stop - rows.start, columns.stop - columns.start)
    mask = np.zeros(shape, np.bool_)
    mask[shape[0] // 4 : shape[0] // 2, shape[1] // 3 :] = True
    layer = np.zeros((*lib.EDITOR_SIZE, 4), np.uint8)
    layer[rows, columns][resize.smooth_mask(mask, on_canvas)] = lib.PAINT
    back = lib.painted([layer], shape)
    coarse = max(1, shape[0] / on_canvas[0])
    assert (back != mask).sum() <= coarse * (2 * mask.any(0).sum() + mask.any(1).sum())


def test_what_goes_wrong_is_one_line_without_the_folder(demo, box, tmp_path):
    bad = tmp_path / "a<b>.png"
    bad.write_text("no image")
    edited, line = demo.open_photo(str(bad), None)
    assert edited is None
    assert "a&lt;b&gt;.png is not an image of a known format" in line
    assert str(tmp_path) not in line
    edited, _ = demo.open_photo(box[0], None)
    edited["layers"][0][:] = 0
    assert "no mask: paint the object" in demo.predict(box[0], edited, 1, 0, "auto")[2]
    edited["layers"] = [np.zeros((80, 80, 4), np.uint8)]
    assert "accepted: [600, 800, 4]" in demo.predict(box[0], edited, 1, 0, "auto")[2]
    assert "no photo" in demo.predict(None, None, 1, 0, "auto")[2]
    good, _ = demo.open_photo(box[0], None)
    assert "expected an integer" in demo.predict(box[0], good, 1, 0.5, "auto")[2]


def test_old_results_and_folders_of_killed_demos_are_removed(demo, box, monkeypatch, tmp_path):
    edited, _ = demo.open_photo(box[0], None)
    _, first, _ = demo.predict(box[0], edited, 1, 0, "auto")
    os.utime(pathlib.Path(first[0]).parent, (0, 0))
    _, second, _ = demo.predict(box[0], edited, 1, 0, "auto")
    assert [pathlib.Path(f[0]).exists() for f in (first, second)] == [False, True]
    monkeypatch.setattr(lib.tempfile, "tempdir", str(tmp_path))
    left = tmp_path / "psgn-demo-999999999-x"
    left.mkdir()
    own, another = lib.temporary_folder(), lib.temporary_folder()
    assert own.is_dir()
    assert another.is_dir()
    assert not left.exists()


def test_without_gradio(monkeypatch):
    monkeypatch.setattr(lib.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match="needs the extra 'demo': pip install"):
        lib.import_gradio()


@pytest.mark.slow
def test_the_page_in_a_browser(page, tmp_path):
    pytest.importorskip("gradio", reason="the extra `demo` is not installed")
    command = [sys.executable, "-m", "psgn_jax.commands.psgn", "demo", "--port=0"]
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment
    ) as process:
        address = process.stdout.readline().strip()
        page.goto(address)
        page.set_input_files("#photo input[type=file]", str(ROOT / "docs/photos/chair.jpg"))
        page.set_input_files("#mask input[type=file]", str(ROOT / "docs/photos/chair_mask.png"))
        page.wait_for_function("document.querySelector('#line').innerText.includes('given file')")
        page.click("#predict")
        page.wait_for_function("document.querySelector('#files').innerText.includes('chair.ply')")
        assert re.match(r"1 x 1,024 points", page.inner_text("#line"))
        request = urllib.request.Request(address, headers={"Host": "evil.example"})
        with pytest.raises(urllib.error.HTTPError, match="400"):
            urllib.request.urlopen(request)
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
    assert not list(tmp_path.glob("psgn-demo-*"))
