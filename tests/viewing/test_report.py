"""The gallery of an evaluation: numbers, links and order; the pages work in a browser."""

import json
import weakref

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
from psgn_jax.viewing import page as page_lib
from psgn_jax.viewing import report as lib
from psgn_jax.viewing.collected import Collector, Sample, shown_points

CATEGORIES = ("car", "lamp", "")


def made(count=13, label="first", n=40, seed=0):
    rng = np.random.default_rng(seed)
    intrinsics, extrinsics = camera.default_camera((48, 64))
    image = np.full((48, 64, 3), 191, np.uint8)
    samples = [
        Sample(image, rng.uniform(-0.5, 0.5, (90, 3)), intrinsics, extrinsics) for _ in range(count)
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
    with pytest.raises(ValueError, match="'other' has other samples"):
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


def test_what_is_collected_is_on_disk(tmp_path):
    rng = np.random.default_rng(0)
    batches = [
        {
            "image": rng.integers(0, 255, (4, 6, 8, 3), np.uint8),
            "points": rng.normal(size=(4, 90, 3)).astype(np.float32),
            "intrinsics": rng.normal(size=(4, 3, 3)).astype(np.float32),
            "extrinsics": rng.normal(size=(4, 3, 4)).astype(np.float32),
            "valid": np.array([True, True, True, number < 2]),
        }
        for number in range(3)
    ]
    preds = rng.normal(size=(3, 4, 40, 3)).astype(np.float32)
    collector = Collector(tmp_path / "pages")
    for number, batch in enumerate(batches):
        collector(number, batch, preds[number])
    assert len(collector.samples) == len(collector.preds) == 11
    assert not list((tmp_path / "pages").iterdir())  # the temporary files have no name
    for index in (0, 5, 10, -1, 3):
        place = np.unravel_index(index % 11, (3, 4))
        sample, batch = collector.samples[index], batches[place[0]]
        np.testing.assert_array_equal(collector.preds[index], preds[place])
        np.testing.assert_array_equal(sample.image, batch["image"][place[1]])
        np.testing.assert_array_equal(sample.points, batch["points"][place[1]][::2])
        np.testing.assert_array_equal(sample.extrinsics, batch["extrinsics"][place[1]])
    assert len(collector.preds[2:5]) == len(collector.samples[2:5]) == 3
    with pytest.raises(IndexError):
        collector.preds[11]
    with pytest.raises(ValueError, match="like the first one"):
        collector.preds.append(np.zeros((41, 3), np.float32))


@pytest.mark.parametrize("true", [1, 39, 40, 41, 79, 80, 119, 16384])
def test_shown_points_are_thinned_once(true):
    points = np.arange(3 * true).reshape(true, 3)
    thin = shown_points(points, 40)
    assert min(true, 40) <= len(thin) < 80 or true < 80
    np.testing.assert_array_equal(shown_points(thin, 40), thin)


def test_many_cases_are_not_held(tmp_path, monkeypatch):
    """With many cases, only one case and one page are in memory at a time."""
    alive, most = weakref.WeakSet(), [0]
    original = page_lib._encode

    def counted(case):
        alive.add(case)
        most[0] = max(most[0], len(alive))
        return original(case)

    monkeypatch.setattr(page_lib, "_encode", counted)
    samples, run = made(count=60)
    pages = page_lib.write_pages(
        tmp_path / "p.html",
        (lib._viewer_case(i, str(i), samples[i], [run], [np.zeros(60)]) for i in range(60)),
        max_bytes=46_000,
    )
    assert most[0] <= 2
    files = sorted(set(pages.values()))
    assert len(files) > 1
    assert sorted(tmp_path.iterdir()) == files
    assert [
        case["name"] for p in dict.fromkeys(pages.values()) for case in data_of(p)["cases"]
    ] == [str(i) for i in range(60)]


def test_in_a_browser(page, tmp_path):
    samples, run = made(count=24)
    lib.write_report(tmp_path, samples, [run])
    complaints, requests = [], []
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
    assert page.is_hidden("#turn")
    worst = page.locator("#worst a").first
    name = worst.get_attribute("title")
    worst.click()
    page.wait_for_selector("#name")
    assert page.text_content("#name") == name
    assert complaints == []
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []


def test_many_cases_are_listed_some_at_a_time(page, tmp_path):
    samples, run = made(count=24)
    index = lib.write_report(tmp_path, samples, [run])
    document = data_of(index)
    (case, *_) = document["cases"]
    document["cases"] = [
        {**case, "record": i, "name": str(i), "error": i / 1e5, "pictures": []}
        for i in range(10_000)
    ]
    text = index.read_text()
    start = text.index('id="data">') + len('id="data">')
    index.write_text(text[:start] + json.dumps(document) + text[text.index("</script>", start) :])
    page.goto(index.as_uri())
    assert page.locator("#all a").count() == 120
    assert page.text_content("#place") == "1 to 120 of 10000"
    assert page.is_disabled("#back")
    page.click("#on")
    assert page.locator("#all a").first.get_attribute("title") == "120"
    page.select_option("#order", "-error")
    assert page.locator("#all a").first.get_attribute("title") == "9999"
    page.click("#on")
    page.click("#back")
    assert page.text_content("#place") == "1 to 120 of 10000"
