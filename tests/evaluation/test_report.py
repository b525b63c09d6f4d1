"""The gallery of an evaluation: numbers, links and order; the pages work in a browser."""

import json

import numpy as np
import pytest

from psgn_jax.data import camera
from psgn_jax.evaluation import report
from psgn_jax.evaluation.report import Collector
from psgn_jax.evaluation.results import Evaluation, SampleName

CATEGORIES = ("car", "lamp", "")


def made(count=13, label="first", n=40, seed=0):
    rng = np.random.default_rng(seed)
    intrinsics, extrinsics = camera.default_camera((48, 64))
    image = np.full((48, 64, 3), 191, np.uint8)
    cases = [
        {"image": image, "intrinsics": intrinsics, "extrinsics": extrinsics,
         "points": rng.uniform(-0.5, 0.5, (90, 3)),
         "pred": rng.uniform(-0.5, 0.5, (n, 3)).astype(np.float32)}
        for _ in range(count)
    ]  # fmt: skip
    names = [SampleName(i, CATEGORIES[i % 3], f"model{i}", 0) for i in range(count)]
    error = rng.permutation(count) * 0.01 + 0.005
    metrics = {"cd_sq_radius2": error, "cd_l1_radius": error**0.5, "fscore": 1 - error}
    evaluation = Evaluation("validation", names, metrics, 0.01, (n, 90))
    return report.Reported(label, evaluation, cases, n // 4)


def data_of(path):
    text = path.read_text()
    return json.loads(text.split('<script type="application/json" id="data">')[1].split("</")[0])


def test_numbers_and_files(tmp_path):
    run = made()
    run.evaluation.metrics["cd_sq_radius2"][4] = np.nan
    index = report.write_report(tmp_path, [run])
    data = data_of(index)
    assert [case["record"] for case in data["cases"]] == list(range(13))
    assert data["cases"][4]["error"] is None
    assert sum(data["histogram"]["counts"]) == 12
    assert data["table"][0][:3] == ["category", "samples", "CD squared [radius^2]"]
    assert [row[0] for row in data["table"][1:4]] == ["(none)", "car", "lamp"]
    viewer = {case["name"] for case in data_of(tmp_path / "viewer.html")["cases"]}
    assert viewer == {case["name"] for case in data["cases"]}


def test_two_runs_share_the_viewer(tmp_path):
    first = made()
    second = made(label="second", seed=1)
    report.write_report(tmp_path, [first, second])
    (case, *_) = data_of(tmp_path / "viewer.html")["cases"]
    assert len(case["samples"]) == 2
    assert case["metrics"][1].startswith("second: CD squared")
    assert len(data_of(tmp_path / "index.html")["table"][0]) == 2 + 2 * 3
    with pytest.raises(ValueError, match="'other' has other samples"):
        report.write_report(tmp_path, [first, made(count=12, label="other")])


def test_what_is_collected_is_read_from_disk(tmp_path):
    rng = np.random.default_rng(0)
    batch = {
        "image": rng.integers(0, 255, (4, 6, 8, 3), np.uint8),
        "points": rng.normal(size=(4, 90, 3)).astype(np.float32),
        "intrinsics": rng.normal(size=(4, 3, 3)).astype(np.float32),
        "extrinsics": rng.normal(size=(4, 3, 4)).astype(np.float32),
        "valid": np.array([True, False, True, True]),
    }
    preds = rng.normal(size=(4, 40, 3)).astype(np.float32)
    collector = Collector(tmp_path / "pages")
    collector(0, batch, preds)
    collector(1, batch, preds)
    assert len(collector) == 6
    assert not list((tmp_path / "pages").iterdir())  # the file has no name
    case = collector[4]
    np.testing.assert_array_equal(case["pred"], preds[2])
    np.testing.assert_array_equal(case["image"], batch["image"][2])
    np.testing.assert_array_equal(case["points"], batch["points"][2][::2])
    np.testing.assert_array_equal(case["extrinsics"], batch["extrinsics"][2])
    with pytest.raises(IndexError):
        collector[6]


@pytest.mark.slow
def test_in_a_browser(opened, tmp_path):
    run = made(count=24)
    page = opened(report.write_report(tmp_path, [run]).as_uri())

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


@pytest.mark.slow
def test_many_cases_are_listed_some_at_a_time(page, tmp_path):
    run = made(count=24)
    index = report.write_report(tmp_path, [run])
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
