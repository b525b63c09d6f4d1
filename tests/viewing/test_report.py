"""The gallery of an evaluation: its numbers, its links, its order; pages that work in a browser."""

import json
import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import standin
from PIL import Image

from psgn_jax.config import ConfigError, to_json
from psgn_jax.data import camera
from psgn_jax.metrics.evaluation import Evaluation, SampleName
from psgn_jax.models import point_out_net
from psgn_jax.tasks.runs import report_runs
from psgn_jax.training.checkpoint import Checkpoints
from psgn_jax.training.state import named_leaves
from psgn_jax.viewing import report as lib

CATEGORIES = ("car", "lamp", "")
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


def made(count=13, label="first", n=40, seed=0):
    rng = np.random.default_rng(seed)
    intrinsics, extrinsics = camera.default_camera((48, 64))
    image = np.full((48, 64, 3), 191, np.uint8)
    samples = [
        lib.Sample(image, rng.uniform(-0.5, 0.5, (90, 3)), intrinsics, extrinsics)
        for _ in range(count)
    ]
    names = [SampleName(i, CATEGORIES[i % 3], f"model{i}", 0) for i in range(count)]
    error = rng.permutation(count) * 0.01 + 0.005
    metrics = {"cd_sq_radius2": error, "cd_l1_radius": error**0.5, "fscore": 1 - error}
    evaluation = Evaluation("validation", names, metrics, 0.01, (n, 90))
    preds = [rng.uniform(-0.5, 0.5, (n, 3)).astype(np.float32) for _ in range(count)]
    return samples, lib.Run(label, evaluation, preds, n // 4)


def data_of(path):
    text = path.read_text()
    return json.loads(text.split('<script type="application/json" id="data">')[1].split("</")[0])


def test_numbers_and_files(tmp_path):
    samples, run = made()
    run.evaluation.metrics["cd_sq_radius2"][4] = np.nan
    index = lib.write_report(tmp_path, samples, [run])
    data = data_of(index)
    assert [case["record"] for case in data["cases"]] == list(range(13))
    assert data["cases"][4]["error"] is None
    assert sum(data["histogram"]["counts"]) == 12
    assert data["table"][0][:3] == ["category", "samples", "CD squared [radius^2]"]
    assert [row[0] for row in data["table"][1:4]] == ["(none)", "car", "lamp"]
    viewer = {case["name"] for case in data_of(tmp_path / "viewer.html")["cases"]}
    assert viewer == {case["name"] for case in data["cases"]}
    for name in ("sheet.png", "extremes.png"):
        with Image.open(tmp_path / name) as picture:
            assert picture.size[0] > 300


def test_two_runs_share_the_viewer_and_the_sheet(tmp_path):
    samples, first = made()
    _, second = made(label="second", seed=1)
    lib.write_report(tmp_path, samples, [first, second])
    (case, *_) = data_of(tmp_path / "viewer.html")["cases"]
    assert len(case["samples"]) == 2
    assert case["metrics"][1].startswith("second: CD squared")
    assert len(data_of(tmp_path / "index.html")["table"][0]) == 2 + 2 * 3


def test_refusals(tmp_path):
    samples, run = made()
    with pytest.raises(ValueError, match="0 runs over 13 samples: accepted: 1 or 2"):
        lib.write_report(tmp_path, samples, [])
    _, other = made(count=12, label="other")
    with pytest.raises(ValueError, match="'other' saw other samples"):
        lib.write_report(tmp_path, samples, [run, other])


@pytest.mark.parametrize("errors", [[0.5], [0.0, 0.0], [np.nan], [1e-9, 1.0, np.inf]])
def test_histogram_of_odd_errors(errors):
    found = lib._histogram(np.array(errors))
    assert sum(found["counts"]) == np.isfinite(errors).sum()
    assert (np.diff(found["edges"]) > 0).all()


def test_from_a_run(tmp_path, monkeypatch):
    standin.install(monkeypatch)
    small = {"model__name": "vanilla", "model__widths": (4, 6, 8), "model__random_size": 0}
    config = standin.config(**small)
    model = point_out_net.build(config.model)
    image = jnp.zeros((1, *config.model.image_size, 4))
    params = jax.jit(lambda: model.init(jax.random.key(0), image, None))()["params"]
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.json").write_text(to_json(config))
    checkpoints = Checkpoints(tmp_path / "run" / "checkpoints")
    checkpoints.save(1, named_leaves({"params": params}), {})
    checkpoints.close()
    found = report_runs(tmp_path / "pages", [tmp_path / "run"], checkpoint="last")
    data = data_of(tmp_path / "pages" / "index.html")
    errors = [case["error"] for case in data["cases"]]
    np.testing.assert_allclose(errors, found.metrics["cd_sq_radius2"])
    with pytest.raises(ConfigError, match="no run there"):
        report_runs(tmp_path / "pages", [tmp_path / "none"])


def test_in_a_browser(tmp_path):
    api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    samples, run = made(count=24)
    lib.write_report(tmp_path, samples, [run])
    complaints, requests = [], []
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto((tmp_path / "index.html").as_uri())

        def listed():
            words = page.locator("#all a span:first-of-type > span").all_text_contents()
            return [float(word) for word in words]

        assert listed() == sorted(listed())
        assert len(listed()) == 24
        page.select_option("#order", "-error")
        assert listed() == sorted(listed(), reverse=True)
        page.select_option("#only", "car")
        assert len(listed()) == 8
        assert page.text_content("#count") == "8 of 24"
        worst = page.locator("#worst a").first
        name = worst.get_attribute("title")
        worst.click()
        page.wait_for_selector("#name")
        assert page.text_content("#name") == name
        browser.close()
    assert complaints == []
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []
