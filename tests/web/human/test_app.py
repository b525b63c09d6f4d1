import re

import numpy as np
import pytest
from helpers.human_study import LEG, LEGS, TOP, TURN, corners, turn
from scipy.spatial import ConvexHull

from psgn_jax.web.human.cases import read_answers, read_study


@pytest.fixture
def page(opened, study_folder):
    size = {"width": 1200, "height": 700}
    return opened((study_folder / "index.html").as_uri(), viewport=size)


def model_of(page):
    return page.evaluate("JSON.parse(JSON.stringify(human.model()))")


def button(page, name):
    return page.get_by_role("button", name=name, exact=True)


def fill(page, label, value):
    page.get_by_label(label, exact=True).fill(str(value))
    page.keyboard.press("Tab")


def add_box(page, middle, size):
    button(page, "Box").click()
    for axis, place, extent in zip(("front", "right", "up"), middle, size, strict=True):
        fill(page, f"Position, {axis}", place)
        fill(page, f"Size, {axis}", extent)


def drag_handle(page, view, axis, by):
    """Drags the handle of an axis in a view; returns how a unit along the axis looks there."""
    handle = page.evaluate(
        """([view, axis]) => {
          const { canvas } = human.views[view], box = canvas.getBoundingClientRect();
          const { to, way } = human.views[view].handles(human.views[view].camera())[axis];
          return [box.left + to[0], box.top + to[1], ...way];
        }""",
        [view, axis],
    )
    page.mouse.move(*handle[:2])
    page.mouse.down()
    page.mouse.move(handle[0] + by[0], handle[1] + by[1], steps=4)
    page.mouse.up()
    return np.array(handle[2:])


def test_a_table_is_modelled_saved_and_restored(page, study_folder, tmp_path):
    address, untouched = page.url, page.context.new_page()
    untouched.goto(address)
    page.bring_to_front()
    fill(page, "Direction of the object, degrees", TURN)
    add_box(page, *TOP)
    add_box(page, (LEG[0][0], LEG[0][1], 0.6), LEG[1])
    button(page, "To ground").click()
    page.get_by_label("Mirror left and right").check()
    page.get_by_label("Mirror front and back").check()
    model = model_of(page)
    assert model["turn"] == TURN
    np.testing.assert_allclose(model["parts"][1]["at"], LEG[0], atol=1e-9)
    assert model["parts"][1]["mirror"] == "xy"
    page.click("#done")
    assert page.text_content("#case-name") == "Case 2 of 2"
    with page.expect_download() as download:
        page.click("#save")
    assert download.value.suggested_filename == "human.json"
    download.value.save_as(tmp_path / "human.json")
    answers = read_answers(tmp_path / "human.json", read_study(study_folder))
    assert [(a.done, a.parts, len(a.solids)) for a in answers] == [(True, 2, 5), (False, 0, 0)]
    boxes = [np.unique(np.round(turn(corners(*box)), 4), axis=0) for box in (TOP, *LEGS)]
    found = [np.unique(np.round(solid, 4), axis=0) for solid in answers[0].solids]
    found, boxes = (sorted(map(np.ravel, each), key=tuple) for each in (found, boxes))
    np.testing.assert_allclose(found, boxes, atol=2e-4)
    page.goto("about:blank")
    untouched.goto("about:blank")  # a tab that is left last replaces nothing
    page.wait_for_timeout(500)  # until the browser's processes have what the tabs stored
    page.goto(address)
    assert model_of(page) == model
    page.evaluate("localStorage.clear(); human.state.entries.forEach(e => { e.model.parts = []; })")
    page.set_input_files("#open", str(tmp_path / "human.json"))
    page.wait_for_function("human.state.entries[0].model.parts.length === 2")
    page.get_by_text(re.compile("2 box . 4")).wait_for()
    assert model_of(page) == model
    later = (tmp_path / "human.json").read_text().replace('"version":1', '"version":2')
    (tmp_path / "later.json").write_text(later)
    page.set_input_files("#open", str(tmp_path / "later.json"))
    page.get_by_text("This file cannot be used: its version is 2, this page reads 1.").wait_for()


def test_handles_move_resize_and_turn(page):
    add_box(page, (0, 0, 0.3), (0.4, 0.6, 0.2))
    for view in (0, 1):
        before = model_of(page)["parts"][0]["at"]
        way = drag_handle(page, view, 1, (30, 0))
        at = model_of(page)["parts"][0]["at"]
        moved = 30 * way[0] / (way @ way)
        np.testing.assert_allclose(at, np.add(before, [0, moved, 0]), atol=1e-6)
        button(page, "Undo").click()
        assert model_of(page)["parts"][0]["at"] == before
    button(page, "Size").click()
    drag_handle(page, 0, 2, (0, -20))
    resized = model_of(page)["parts"][0]
    assert resized["size"][2] > 0.21
    assert resized["at"][2] - resized["size"][2] / 2 == pytest.approx(0.2)  # the lower side
    page.focus("#free-view")
    page.keyboard.press("t")
    drag_handle(page, 0, 2, (40, 0))
    turn = model_of(page)["parts"][0]["turn"]
    assert turn[:2] == [0, 0]
    assert abs(turn[2]) == pytest.approx(20, abs=2)
    page.keyboard.press("Control+d")
    assert len(model_of(page)["parts"]) == 2
    page.keyboard.press("Control+z")
    assert len(model_of(page)["parts"]) == 1
    # A click selects the part there; one beside all parts, none.
    box = page.locator("#free-view").bounding_box()
    page.mouse.click(box["x"] + 5, box["y"] + 5)
    assert page.evaluate("human.state.selected") == -1
    x, y, _ = page.evaluate(
        """human.project(
          human.views[1].camera(), human.toWorld(human.model(), human.model().parts[0].at))"""
    )
    page.mouse.click(box["x"] + x, box["y"] + y)
    assert page.evaluate("human.state.selected") == 0


CIRCLE = 24 * np.sin(2 * np.pi / 24) / 8  # area of 24 corners in a circle of diameter 1


def test_primitives_have_their_volumes(page):
    for fields, volume, error in (
        ({"kind": "box"}, 1, 1e-6),
        ({"kind": "box", "taper": 0.25}, (1 + 0.25 + 0.25**2) / 3, 1e-6),
        ({"kind": "cylinder"}, CIRCLE, 1e-6),
        ({"kind": "cone", "taper": 0}, CIRCLE / 3, 1e-6),
        ({"kind": "prism", "sides": 3}, 0.5, 1e-6),
        ({"kind": "sphere"}, np.pi / 6, 0.04),
    ):
        place = {"size": [0.7, 0.4, 0.9], "at": [0.1, 0.2, 0.5], "turn": [30, -50, 110]}
        part = {"mirror": "x", "taper": 1, "sides": 5, **place, **fields}
        page.evaluate("part => { human.model().parts = []; human.insert(part); }", part)
        for mesh in page.evaluate("human.meshesOf(human.model())"):
            found = ConvexHull(mesh["corners"]).volume
            assert found == pytest.approx(0.7 * 0.4 * 0.9 * volume, rel=error), fields
