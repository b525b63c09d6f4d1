import json

import numpy as np
import pytest
from helpers.javascript import data_of
from helpers.refusals import refused

from psgn_jax.data import camera
from psgn_jax.evaluation import report
from psgn_jax.evaluation.report import Collector
from psgn_jax.evaluation.results import Evaluation, SampleName


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
    names = [SampleName(i, ("car", "lamp", "")[i % 3], f"model{i}", 0) for i in range(count)]
    error = rng.permutation(count) * 0.01 + 0.005
    metrics = {"cd_sq_radius2": error, "cd_l1_radius": error**0.5, "fscore": 1 - error}
    evaluation = Evaluation("validation", names, metrics, 0.01, (n, 90))
    return report.Reported(label, evaluation, cases, n // 4)


def test_numbers_and_files_of_two_runs(tmp_path):
    first, second = made(), made(label="second", seed=1)
    first.evaluation.metrics["cd_sq_radius2"][4] = np.nan
    data = data_of(report.write_report(tmp_path, [first, second]))
    assert [case["record"] for case in data["cases"]] == list(range(13))
    assert data["cases"][4]["error"] is None
    assert sum(data["histogram"]["counts"]) == 12
    assert [row[0] for row in data["table"][1:4]] == ["(none)", "car", "lamp"]
    assert len(data["table"][0]) == 2 + 2 * 3
    viewed = data_of(tmp_path / "viewer.html")["cases"]
    assert {case["name"] for case in viewed} == {case["name"] for case in data["cases"]}
    assert len(viewed[0]["samples"]) == 2
    assert viewed[0]["metrics"][1].startswith("second: CD squared")
    with refused(ValueError, "'other'"):
        report.write_report(tmp_path, [first, made(count=12, label="other")])


def test_what_is_collected_is_read_from_disk(tmp_path):
    rng = np.random.default_rng(0)
    shapes = {"image": (6, 8, 3), "points": (90, 3), "intrinsics": (3, 3), "extrinsics": (3, 4)}
    batch = {key: rng.random((4, *shape), np.float32) for key, shape in shapes.items()}
    batch["valid"] = np.array([True, False, True, True])
    preds = rng.random((4, 40, 3), np.float32)
    collector = Collector(tmp_path / "pages")
    for index in range(2):
        collector(index, batch, preds)
    assert len(collector) == 6
    assert not list((tmp_path / "pages").iterdir())  # the file has no name
    case, wanted = collector[4], batch | {"pred": preds}
    for key in ("pred", "image", "extrinsics"):
        np.testing.assert_array_equal(case[key], wanted[key][2])
    np.testing.assert_array_equal(case["points"], batch["points"][2][::2])
    with pytest.raises(IndexError):
        collector[6]


@pytest.mark.slow
def test_in_a_browser(opened, tmp_path):
    """Cases are listed 120 at a time, sorted and chosen, and lead to the viewer."""
    index = report.write_report(tmp_path, [made(count=24)])
    document, text = data_of(index), index.read_text()
    start = text.index('id="data">') + len('id="data">')
    end = text.index("</script>", start)
    more = {**document["cases"][0], "category": "lamp", "pictures": []}
    for i in range(24, 10_000):
        document["cases"].append({**more, "record": i, "name": str(i), "error": i})
    index.write_text(text[:start] + json.dumps(document) + text[end:])
    page = opened(index.as_uri())

    def titles():
        return [a.get_attribute("title") for a in page.locator("#all a").all()]

    assert len(titles()) == 120
    assert titles()[24:] == [str(i) for i in range(24, 120)]
    assert page.text_content("#place") == "1 to 120 of 10000"
    assert page.is_disabled("#back")
    page.click("#on")
    assert titles()[0] == "120"
    page.select_option("#order", "-error")
    assert titles()[0] == "9999"
    page.click("#on")
    page.click("#back")
    assert page.text_content("#place") == "1 to 120 of 10000"
    page.select_option("#only", "car")
    assert len(titles()) == 8
    assert page.text_content("#count") == "8 of 10000"
    assert page.is_hidden("#turn")
    best = page.locator("#best a").first
    name = best.get_attribute("title")
    best.click()
    page.wait_for_selector("#name")
    assert page.text_content("#name") == name
