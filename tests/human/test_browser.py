"""The page in a real browser: a table of five boxes is modelled, saved, restored and scored."""

import json

import numpy as np
import pytest
from helpers.human_study import LEG, LEGS, PART, TOP, TURN, UNNAMED, table_sample

from psgn_jax.human import score
from psgn_jax.human.answers import read_answers
from psgn_jax.human.records import open_cases, read_study
from psgn_jax.human.solids import solids_of


@pytest.fixture
def opened(browser, study_folder, tmp_path):
    """Opens the page as a file; checks at the end that it logged nothing and sent no requests."""
    complaints, requests, contexts = [], [], []

    def open_page(**options):
        context = browser.new_context(
            **{"viewport": {"width": 1000, "height": 640}, "reduced_motion": "reduce", **options}
        )
        context.set_default_timeout(120_000)
        contexts.append(context)
        context.on("request", lambda request: requests.append(request.url))
        page = context.new_page()
        page.on(
            "console",
            lambda m: complaints.append(m.text) if "GL Driver Message" not in m.text else None,
        )
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto((study_folder / "index.html").as_uri())
        page.get_by_role("button", name="Start").click()
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert complaints == []
    assert [url for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []
    assert {url for url in requests if url.startswith("file:")} == {
        (study_folder / "index.html").as_uri()
    }


def model_of(page):
    return page.evaluate("JSON.parse(JSON.stringify(human.study.model))")


def state_of(page):
    return page.evaluate("JSON.parse(JSON.stringify(human.study))")


def part_of(page, number=-1):
    return model_of(page)["parts"][number]


def fill(page, label, value):
    field = page.get_by_label(label, exact=True)
    field.fill(str(value))
    field.press("Tab")


def add_box(page, middle, size):
    """Adds a box with the fields for position and size."""
    page.get_by_role("button", name="Box", exact=True).click()
    for axis, place, extent in zip(("front", "right", "up"), middle, size, strict=True):
        fill(page, f"Position, {axis}", place)
        fill(page, f"Size, {axis}", extent)


def insert(page, *parts, turn=0):
    """Adds parts without using the controls, for tests of other features."""
    page.evaluate(
        """([parts, turn]) => {
          human.study.model.turn = turn;
          parts.forEach(part => human.editor.insert(part));
        }""",
        [parts, turn],
    )


def model_table(page):
    """Models the table: the top, and one leg, which is mirrored twice."""
    fill(page, "Direction of the object in degrees, as a number", TURN)
    add_box(page, *TOP)
    add_box(page, (LEG[0][0], LEG[0][1], 0.6), LEG[1])
    page.get_by_role("button", name="To ground").click()
    page.get_by_role("button", name="Mirror left and right").click()
    page.get_by_role("button", name="Mirror front and back").click()


def saved(page, button, path):
    with page.expect_download() as download:
        page.get_by_role("button", name=button, exact=True).click()
    download.value.save_as(path)
    return path


def drag(page, start, by):
    page.mouse.move(*start)
    page.mouse.down()
    for share in (0.5, 1):
        page.mouse.move(start[0] + share * by[0], start[1] + share * by[1])
    page.mouse.up()


_HANDLE = """([view, kind, axis, sign]) => {
  const same = h => h.kind === kind && h.axis === axis && (sign === null || h.sign === sign);
  const found = human.views[view].handles().find(same);
  const box = human.views[view].top.getBoundingClientRect();
  // On a ring, a point that is not on another ring.
  const p = found.at ?? (kind === "turn" ? found.path[6] : found.path.at(-1));
  return [box.left + p[0], box.top + p[1]];
}"""

_PIXEL = """([view, point]) => {
  const box = human.views[view].top.getBoundingClientRect(), c = human.views[view].camera();
  const [x, y, z] = [0, 1, 2].map(r => c.shift[r]
    + point.reduce((sum, value, k) => sum + c.rotation[3 * r + k] * value, 0));
  const [column, row] = [c.focal[0] * x + c.skew * y, c.focal[1] * y].map(v => v / z);
  return [box.left + column + c.centre[0], box.top + row + c.centre[1]];
}"""

_FRAME = """(() => {
  const { root } = human.views[0], box = root.getBoundingClientRect();
  const { scale, corner } = human.views[0].frame(root.clientWidth, root.clientHeight);
  return { scale, corner, left: box.left, top: box.top };
})()"""


def handle(page, view, kind, axis, sign=None):
    """Position of a handle's end in the window."""
    return np.array(page.evaluate(_HANDLE, [view, kind, axis, sign]))


def pixel_of(page, view, point):
    """Position of a point of the record's frame in the window."""
    return np.array(page.evaluate(_PIXEL, [view, [float(c) for c in point]]))


# --- a session ---------------------------------------------------------------------------------


def test_a_table_of_five_boxes_is_modelled_kept_saved_and_scored(opened, study_folder, tmp_path):
    page = opened()
    model_table(page)
    assert [p["mirror"] for p in model_of(page)["parts"]] == ["", "xy"]
    page.get_by_role("button", name="Separate copies").click()
    assert len(model_of(page)["parts"]) == 5
    page.keyboard.press("Control+z")
    assert len(model_of(page)["parts"]) == 2
    page.keyboard.press("Control+Shift+z")
    assert len(model_of(page)["parts"]) == 5
    page.get_by_role("button", name="Done, next case").click()
    assert page.text_content("#case-name") == "Case 2 of 2"

    before = state_of(page)
    page.reload()
    after = state_of(page)
    for case, kept in zip(before["cases"], after["cases"], strict=True):
        assert 0 <= kept.pop("seconds") - case.pop("seconds") < 60
    assert after == before
    assert page.text_content("#case-name") == "Case 2 of 2"
    page.get_by_role("button", name="Previous case").click()
    obj = saved(page, "OBJ", tmp_path / "case.obj").read_text()
    path = saved(page, "Save all", tmp_path / "human.json")

    study = read_study(study_folder)
    answers = read_answers(path, study)
    assert [len(answer.parts) for answer in answers] == [5, 0]
    assert answers[0].done
    assert_same_obj(obj, answers[0])
    scored = score.score(study, answers, open_cases(study), {})
    metrics = scored[0].metrics["person"]
    # The mean squared distance to the nearest of n random points on an area A is A / (pi n). This
    # is 0.00094 for the 1,024 points of the model, and an eighth of it for the 8,192 true points.
    assert metrics["cd_sq_radius2"] < 0.002
    assert metrics["emd_radius"] < 0.1


def assert_same_obj(text, answer):
    """The page's OBJ file contains the mesh that Python builds."""
    lines = [line.split() for line in text.splitlines()]
    vertices = np.array([line[1:] for line in lines if line[0] == "v"], float)
    faces = np.array([line[1:] for line in lines if line[0] == "f"], int) - 1
    meshes = [solid.mesh for solid in solids_of(answer)]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    np.testing.assert_allclose(
        vertices, np.concatenate([mesh.vertices for mesh in meshes]), atol=2e-5
    )
    expected = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    np.testing.assert_array_equal(faces, np.concatenate(expected))


def test_every_primitive_is_the_same_mesh_in_python(opened, study_folder, tmp_path):
    page = opened()
    pose = {"size": [0.4, 0.3, 0.9], "turn": [20, -35, 80], "at": [0.1, -0.2, 0.3], "mirror": "x"}
    kinds = {"box": 0.3, "cylinder": 0.3, "cone": 0, "sphere": 1, "prism": 1}
    solids = [{**PART, **pose, "kind": kind, "taper": taper} for kind, taper in kinds.items()]
    insert(page, *solids, turn=-70)
    draw_outline(page)
    page.get_by_role("button", name="Mirror left and right").click()
    obj = saved(page, "OBJ", tmp_path / "case.obj").read_text()
    path = saved(page, "Save all", tmp_path / "human.json")
    (answer, _) = read_answers(path, read_study(study_folder))
    assert [part.kind for part in answer.parts] == [
        "box", "cylinder", "cone", "sphere", "prism", "outline"
    ]  # fmt: skip
    assert_same_obj(obj, answer)
    # After splitting, the copies have the same surface; only the order of their corners differs.
    page.get_by_role("button", name="Separate copies").click()
    split = saved(page, "OBJ", tmp_path / "split.obj").read_text()
    corners = [
        np.array([line.split()[1:] for line in text.splitlines() if line.startswith("v ")], float)
        for text in (obj, split)
    ]
    rows = [c[np.lexsort(np.round(c.T, 3))] for c in corners]
    np.testing.assert_allclose(*rows, atol=2e-4)


def draw_outline(page):
    """An L is clicked in the image."""
    page.get_by_role("button", name="Outline", exact=True).click()
    corners = [(0, 0), (0.5, 0), (0.5, 0.2), (0.2, 0.2), (0.2, 0.6), (0, 0.6), (0, 0)]
    turn = np.deg2rad(model_of(page)["turn"])
    depth = page.evaluate("human.editor.outline.depth")
    for y, z in corners:
        point = (
            np.cos(turn) * depth - np.sin(turn) * y,
            np.sin(turn) * depth + np.cos(turn) * y,
            z,
        )
        page.mouse.click(*pixel_of(page, 0, point))


# --- the mouse ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "view", [pytest.param(0, id="image"), pytest.param(1, id="3D", marks=pytest.mark.slow)]
)
def test_handles_move_turn_and_resize(opened, view):
    page = opened()
    page.get_by_role("button", name="Snap").click()
    page.get_by_role("button", name="Box", exact=True).click()
    start = part_of(page)
    drag(page, handle(page, view, "move", 2), [0, -40])
    moved = part_of(page)
    assert moved["at"][2] > start["at"][2] + 0.1
    assert moved["at"][:2] == start["at"][:2]

    page.keyboard.press("s")
    drag(page, handle(page, view, "size", 2, 1), [0, -30])
    sized = part_of(page)
    assert sized["size"][2] > moved["size"][2] + 0.05
    assert sized["size"][:2] == moved["size"][:2]
    bottoms = [p["at"][2] - p["size"][2] / 2 for p in (sized, moved)]
    assert bottoms[0] == pytest.approx(bottoms[1], abs=1e-6)

    page.keyboard.press("t")
    page.get_by_role("button", name="Snap").click()
    drag(page, handle(page, view, "turn", 2), [60, -20])
    turned = part_of(page)
    assert turned["turn"][2] % 5 == 0
    assert abs(turned["turn"][2]) >= 5
    assert turned["turn"][:2] == pytest.approx([0, 0], abs=1e-6)
    for expected in (sized, moved, start):
        page.get_by_role("button", name="Undo").click()
        assert part_of(page) == expected


def test_a_drag_follows_the_pointer_and_snaps_to_the_ground(opened):
    page = opened()
    page.get_by_role("button", name="Box", exact=True).click()
    # Dragging the part itself along the ground: the grabbed point stays under the pointer.
    start, end = pixel_of(page, 0, (0.2, -0.15, 0.1)), pixel_of(page, 0, (0.2, 0.25, 0.1))
    drag(page, start, end - start)
    assert part_of(page)["at"] == pytest.approx([0, 0.4, 0.2], abs=0.01)
    drag(page, handle(page, 0, "move", 2), [0, -60])
    height = part_of(page)["at"][2]
    assert height > 0.3
    drag(page, handle(page, 0, "move", 2), [0, 58])
    assert part_of(page)["at"][2] == pytest.approx(0.2, abs=1e-6)


@pytest.mark.slow
def test_a_click_selects_and_empty_space_selects_nothing(opened):
    page = opened()
    insert(page, *({**PART, "at": [0, y, 0.2], "size": [0.3, 0.3, 0.4]} for y in (-0.5, 0.5)))
    page.mouse.click(*pixel_of(page, 1, (0, -0.5, 0.2)))
    assert page.evaluate("human.editor.selected") == 0
    orbit = page.evaluate("human.views[1].orbit.turn")
    box = page.locator("#free-view .top").bounding_box()
    corner = (box["x"] + 20, box["y"] + 20)
    page.mouse.click(*corner)
    assert page.evaluate("human.editor.selected") == -1
    drag(page, corner, (90, 20))
    assert page.evaluate("human.views[1].orbit.turn") != orbit
    assert len(model_of(page)["parts"]) == 2


def test_the_overlay_lies_on_the_image(opened):
    """A box in place of the table's top covers the pixels of the top in the image."""
    page = opened()
    parts = [{**PART, "at": at, "size": size} for at, size in (TOP, *LEGS)]
    insert(page, *parts, turn=TURN)
    corner = pixel_of(page, 0, (0, 0, 0))
    frame = page.evaluate(_FRAME)
    sample = table_sample()
    homogeneous = sample.intrinsics @ sample.extrinsics[:, 3]
    expected = homogeneous[:2] / homogeneous[2] * frame["scale"] + frame["corner"]
    expected += [frame["left"], frame["top"]]
    np.testing.assert_allclose(corner, expected, atol=0.01)
    # The silhouette: the ray through a pixel meets the model if the pixel is in the mask.
    rows, columns = np.nonzero(sample.mask)
    hits = page.evaluate(
        "points => points.map(p => human.views[0].pick(p) !== null)",
        [((np.array([c, r]) + 0.5) * frame["scale"] + frame["corner"]).tolist()
         for r, c in zip(rows[::9], columns[::9], strict=True)],
    )  # fmt: skip
    assert np.mean(hits) > 0.9


@pytest.mark.slow
def test_a_second_window_takes_over(opened):
    """An old window does not overwrite newer work; numbers stay within their bounds."""
    page = opened()
    insert(page, PART)
    page.evaluate("human.study.save()")  # otherwise it is saved 250 ms later
    second = page.context.new_page()
    second.goto(page.url)
    insert(second, {**PART, "at": [0, 0, 3.99]})
    second.locator("#free-view .top").press("Shift+ArrowUp")
    assert part_of(second)["at"][2] == 4
    second.evaluate("human.study.save()")
    page.locator("#problem").wait_for(state="visible")
    assert "is open in another window" in page.text_content("#problem")
    insert(page, PART, PART, PART)
    page.evaluate("human.study.save()")
    page.reload()
    assert len(model_of(page)["parts"]) == 2


# --- keys, small windows, hostile files --------------------------------------------------------


def test_the_keyboard_alone_builds_a_part(opened):
    page = opened()
    page.get_by_role("button", name="Cylinder").press("Enter")
    page.locator("#image-view .top").press("ArrowRight")
    page.keyboard.press("Shift+ArrowUp")
    page.keyboard.press("PageDown")
    assert part_of(page)["at"] == pytest.approx([0.01, 0.01, 0.25])
    page.keyboard.press("s")
    page.keyboard.press("ArrowUp")
    assert part_of(page)["size"][2] == pytest.approx(0.41)
    page.keyboard.press("g")
    assert part_of(page)["at"][2] == pytest.approx(0.205)
    page.keyboard.press("Control+d")
    assert len(model_of(page)["parts"]) == 2
    page.keyboard.press("Delete")
    assert len(model_of(page)["parts"]) == 1
    page.get_by_role("button", name="Cylinder 1").press("Enter")
    field = page.get_by_label("Size, front", exact=True)
    field.press("ArrowUp")
    assert part_of(page)["size"][0] == pytest.approx(0.41)
    assert page.text_content("#status")


def test_everything_has_a_name(opened):
    page = opened()
    page.get_by_role("button", name="Prism").click()
    unnamed = page.evaluate(UNNAMED)
    assert unnamed == []
    assert page.locator("#status").get_attribute("role") == "status"
    assert page.get_by_role("application").count() == 2


def test_a_phone_sized_window(opened):
    page = opened(viewport={"width": 390, "height": 780}, has_touch=True, is_mobile=True)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.get_by_role("button", name="Box", exact=True).tap()
    page.get_by_role("button", name="Mirror left and right").tap()
    assert part_of(page)["mirror"] == "y"
    view = page.locator("#image-view .top")
    view.scroll_into_view_if_needed()
    session = page.context.new_cdp_session(page)
    x, y = (float(c) for c in handle(page, 0, "move", 2))
    for kind, up in (("Start", 0), ("Move", 20), ("Move", 50)):
        touch = {"type": f"touch{kind}", "touchPoints": [{"x": x, "y": y - up}]}
        session.send("Input.dispatchTouchEvent", touch)
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    assert part_of(page)["at"][2] > 0.25


def parts(document, value):
    first, *others = document["cases"]
    return {**document, "cases": [{**first, "parts": value}, *others]}


HOSTILE = [
    (lambda d: "no json", "is not JSON"),
    (lambda d: {**d, "study": "other"}, "belongs to another study"),
    (lambda d: {**d, "format": "x"}, "was not saved by this page"),
    (lambda d: {**d, "cases": d["cases"][:1]}, "expected 2 cases"),
    (lambda d: parts(d, [PART] * 201), "0 to 200 parts"),
    (lambda d: parts(d, [{**PART, "size": [1, 1, 1e9]}]), "size of part 1 of Case 1"),
    (lambda d: parts(d, [{**PART, "kind": "<img src=x>"}]), "kind of part 1"),
    (lambda d: parts(d, [{**PART, "kind": "outline", "outline": [[0, 0]]}]), "outline of part"),
    (lambda d: [1, 2], "was not saved by this page"),
]


def test_hostile_files_are_refused_in_a_sentence(opened, tmp_path):
    page = opened()
    insert(page, PART)
    document = state_of(page)
    values = [change(document) for change, _ in HOSTILE]
    texts = [value if isinstance(value, str) else json.dumps(value) for value in values]
    said = page.evaluate(
        "texts => texts.map(t => { try { human.study.read(t); } catch (e) { return e.message; } })",
        texts,
    )
    for text, (_, message) in zip(said, HOSTILE, strict=True):
        assert message in text
        assert text.endswith(".")
    (tmp_path / "file.json").write_text(texts[-1])
    page.set_input_files("#open", str(tmp_path / "file.json"))
    page.locator("#problem").wait_for(state="visible")
    assert page.text_content("#problem") == said[-1]
    assert len(model_of(page)["parts"]) == 1
    good = parts(document, [PART, {**PART, "kind": "sphere"}])
    (tmp_path / "file.json").write_text(json.dumps(good))
    page.set_input_files("#open", str(tmp_path / "file.json"))
    page.get_by_role("button", name="Sphere 2").wait_for()
    page.get_by_role("button", name="Undo").click()
    assert len(model_of(page)["parts"]) == 1


def test_the_page_has_no_points(study_folder):
    text = (study_folder / "index.html").read_text()
    data = json.loads(text.split('id="data">')[1].split("</script>")[0])
    assert set(data) == {"id", "cases"}
    fields = {"name", "image", "width", "height", "intrinsics", "extrinsics"}
    assert all(set(case) == fields for case in data["cases"])
    assert "known" not in text
