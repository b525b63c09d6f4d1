import base64
import dataclasses
import io
import json
import shutil

import numpy as np
import pytest
import trimesh
from helpers.javascript import data_of
from helpers.refusals import all_refused, check_message
from PIL import Image

from psgn_jax.commands import view
from psgn_jax.data import camera
from psgn_jax.prediction.surface import ClosedMesh, glb, textured
from psgn_jax.viewing import viewer as lib
from psgn_jax.viewing.surface_file import SurfaceFileError, read_surface


def make_case(name="chair 1", samples=3, n=300, seed=0):
    rng = np.random.default_rng(seed)
    points = rng.uniform((-0.3, -0.6, 0), (0.3, 0.6, 0.8), (samples, n, 3)).astype(np.float32)
    image = np.full((96, 128, 3), 191, np.uint8)
    image[20:70, 30:100] = (180, 60, 40)
    return lib.Case(
        name=name,
        image=image,
        samples=points,
        truth=points[0, ::-1] + np.float32(0.01),
        num_fc=n // 4,
        colours=rng.integers(0, 255, points.shape, np.uint8),
        spread=rng.uniform(0, 0.4, (samples, n)).astype(np.float32),
        about="chair",
        metrics=tuple(f"CD {k}" for k in range(samples)),
    )


def test_coordinates_come_back(tmp_path):
    case = make_case()
    case.samples[2, 5:9] = np.nan  # a diverged network can be looked at
    lib.write_pages(tmp_path / "p.html", [case])
    data = data_of(tmp_path / "p.html")
    stored = np.frombuffer(base64.b64decode(data["cases"][0]["samples"][1]), "<i2")
    back = stored.reshape(-1, 3) / 32767 * data["extent"]
    np.testing.assert_allclose(back, case.samples[1], atol=1e-4)
    errors = np.frombuffer(base64.b64decode(data["cases"][0]["errors"][0]), np.uint8)
    expected = np.linalg.norm(case.samples[0][:, None] - case.truth, axis=2).min(axis=1)
    np.testing.assert_allclose(errors / 255 * 0.2, np.minimum(expected, 0.2), atol=1e-3)


def test_a_page_of_cases_is_small_and_split_at_the_limit(tmp_path, monkeypatch):
    cases = [make_case(f"case {i}", samples=1, n=1024, seed=i) for i in range(16)]
    pages = lib.write_pages(tmp_path / "p.html", cases)
    assert set(pages.values()) == {tmp_path / "p.html"}
    assert (tmp_path / "p.html").stat().st_size < 16 / 64 * 5_000_000
    monkeypatch.setattr(lib, "MAX_BYTES", 200_000)
    pages = lib.write_pages(tmp_path / "q.html", cases)
    files = sorted(set(pages.values()))
    assert len(files) > 2
    assert all(file.stat().st_size < 200_000 for file in files)
    names = [case["name"] for file in files for case in data_of(file)["cases"]]
    assert sorted(names) == sorted(case.name for case in cases)
    links = [link["file"] for file in files for link in data_of(file)["pages"]]
    assert sorted(set(links)) == [file.name for file in files]


@pytest.fixture
def predicted(tmp_path):
    """The arrays of a prediction, an ellipsoid, with its files `a.npz` and `a_surface.glb`."""
    intrinsics, extrinsics = camera.default_camera((96, 128))
    ball = trimesh.creation.icosphere(subdivisions=3)
    points = ball.vertices[None] * (0.2, 0.6, 0.3) + (0, 0, 0.3)
    points[..., 0] += 0.5 * points[..., 1]  # not symmetric
    n = points.shape[1]
    image = np.full((96, 128, 3), (180, 60, 40), np.uint8)  # red, on the right blue
    image[:, 64:] = (40, 60, 180)
    arrays = {"points": points.astype(np.float32), "photo": image, "to_view": np.eye(3)}
    arrays |= {"colours": np.full((1, n, 3), 90, np.uint8), "seen": np.ones((1, n), bool)}
    arrays |= {"intrinsics": intrinsics, "extrinsics": extrinsics}
    arrays |= {"branch": (np.arange(n) >= 75).astype(np.uint8)}
    np.savez(tmp_path / "a.npz", **arrays)
    surface = ClosedMesh(points[0].astype(np.float32), np.array(ball.faces))
    mesh = textured(surface, image, image[..., 0] > 0, intrinsics, extrinsics)
    mesh.metadata["unit"] = 2.5  # metres
    mesh.apply_scale(2.5)
    (tmp_path / "a_surface.glb").write_bytes(glb(mesh))
    return arrays


def test_the_command(predicted, tmp_path, capsys):
    out = tmp_path / "p.html"
    (tmp_path / "other").mkdir()
    shutil.copy(tmp_path / "a.npz", tmp_path / "other")  # of another network
    both = [str(tmp_path / "a.npz"), str(tmp_path / "other" / "a.npz")]
    assert view.main([*both, f"--out={out}"]) == 0
    shown = [(c["name"], c["fc"], len(c["samples"])) for c in data_of(out)["cases"]]
    assert shown == [(name, 75, 1) for name in both]
    out.unlink()
    capsys.readouterr()
    before = (tmp_path / "a.npz").read_bytes()
    for arguments, *names in (
        ([both[0], both[0], f"--out={out}"], both[0], "twice"),
        (["--out", *both], both[0], ".html"),  # as a shell writes --out out/*.npz
    ):
        assert view.main(arguments) == 2
        check_message(capsys.readouterr().err, *names)
    assert (tmp_path / "a.npz").read_bytes() == before
    assert not out.exists()


@pytest.fixture
def opened_cases(opened, tmp_path):
    def open_page(cases, fragment=""):
        lib.write_pages(tmp_path / "page.html", cases)
        size = {"width": 1200, "height": 640}
        page = opened((tmp_path / "page.html").as_uri() + fragment, viewport=size, has_touch=True)
        page.wait_for_timeout(150)
        return page

    return open_page


def pixels(page, name="prediction"):
    page.wait_for_timeout(120)
    return picture_of(page.locator(f"#{name}"))


def picture_of(element):
    with Image.open(io.BytesIO(element.screenshot())) as picture:
        return np.asarray(picture.convert("RGB")).astype(int)


def differs(shot, other):
    return (np.abs(shot - other).max(axis=2) > 20).mean() > 0.01


def test_it_draws_turns_and_shows_samples_and_colours(opened_cases):
    page = opened_cases([make_case()])
    first, truth = pixels(page), pixels(page, "truth")
    assert (first < 200).any(axis=2).mean() > 0.02
    assert (truth < 200).any(axis=2).mean() > 0.02
    box = page.locator("#prediction").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 120, y, steps=4)
    page.mouse.up()
    assert differs(pixels(page), first)
    assert differs(pixels(page, "truth"), truth)
    page.click("#reset")
    np.testing.assert_array_equal(pixels(page), first)
    page.locator("#prediction").press("ArrowLeft")
    assert (pixels(page) != first).any()
    page.mouse.wheel(0, -400)
    assert (pixels(page) != first).any()
    page.click("#reset")
    session = page.context.new_cdp_session(page)
    for kind, at in (("Start", 0), ("Move", 30), ("Move", 90)):
        touch = {"type": f"touch{kind}", "touchPoints": [{"x": x + at, "y": y}]}
        session.send("Input.dispatchTouchEvent", touch)
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    shots = [pixels(page)]
    assert differs(shots[0], first)
    assert page.text_content("#metrics") == "CD 0"
    page.locator("#sample").fill("2")
    assert page.text_content("#metrics") == "CD 2"
    assert page.text_content("#which") == "3 of 3"
    shots.append(pixels(page))
    assert differs(*shots)
    for colour in ("branch", "error", "spread", "height"):
        page.select_option("#colour", colour)
        shots.append(pixels(page))
        assert all(differs(shots[-1], shot) for shot in shots[1:-1])


def test_right_is_right_and_up_is_up(opened_cases):
    ball = np.random.default_rng(0).normal(0, 0.02, (100, 3))
    places = {"right": (0, 0.7, 0.3), "up": (0, 0, 0.9)}
    cases = [
        lib.Case(name, np.zeros((9, 12, 3), np.uint8), (ball + at)[None].astype(np.float32))
        for name, at in places.items()
    ]
    page = opened_cases(cases)
    rows, columns = np.nonzero(np.ptp(pixels(page), axis=2) > 60)
    height, width = pixels(page).shape[:2]
    assert columns.mean() > 0.6 * width
    page.locator("#strip button").nth(1).click()
    assert page.text_content("#name") == "up"
    rows, columns = np.nonzero(np.ptp(pixels(page), axis=2) > 60)
    assert rows.mean() < 0.42 * height
    assert abs(columns.mean() - width / 2) < 0.03 * width


def test_the_photo_is_behind_the_cloud_until_it_is_turned(opened_cases):
    page = opened_cases([dataclasses.replace(make_case(), camera=camera.default_camera((96, 128)))])

    def seen(shot=None):
        shot = pixels(page) if shot is None else shot
        return np.nonzero((np.abs(shot - (180, 60, 40)) < 12).all(axis=2))[0] / len(shot)

    # Both panels show the same part of the image, whose rows 20 to 70 are red.
    rows, red = seen(), seen(picture_of(page.locator(".box").first))
    assert (rows.min(), rows.max()) == pytest.approx((red.min(), red.max()), abs=0.02)
    assert rows.max() - rows.min() > 0.6
    page.uncheck("#photo")
    assert len(seen()) == 0
    page.check("#photo")
    assert len(seen()) == len(rows)
    page.locator("#prediction").press("ArrowRight")
    assert len(seen()) == 0


def test_links_and_hostile_names(opened_cases):
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    bare = lib.Case("a", np.zeros((9, 12, 3), np.uint8), np.zeros((1, 50, 3), np.float32))
    page = opened_cases([bare, make_case(evil)], "#a")
    assert page.text_content("#name") == "a"
    # Only what is there is offered.
    assert page.locator("#beside").is_hidden()
    assert page.locator("#sampling").is_hidden()
    assert page.locator("#colour option").all_text_contents() == ["height"]
    page.locator("#strip button").nth(1).click()
    assert page.text_content("#name") == evil
    for fragment in ("#a", "#100%"):
        page.evaluate("hash => { location.hash = hash; }", fragment)
        page.wait_for_timeout(100)
        assert page.text_content("#name") == "a"


def test_the_surface_has_the_photos_colours_and_turns_as_the_points(predicted, opened, tmp_path):
    command = [str(tmp_path / "a.npz"), f"--out={tmp_path / 'p.html'}"]
    (tmp_path / "a.json").write_text('{"earlier_files": ["a_surface.glb"]}')
    assert view.main(command) == 0
    assert "surfaces" not in data_of(tmp_path / "p.html")["cases"][0]  # of an earlier prediction
    (tmp_path / "a.json").unlink()
    assert view.main(command) == 0
    page = opened((tmp_path / "p.html").as_uri(), viewport={"width": 1200, "height": 640})
    canvas, middle = page.locator("#prediction"), None
    for turns, name in ((0, "front"), (12, "side"), (18, "back")):  # 6 degrees each
        for _ in range(turns):
            canvas.press("ArrowLeft")
        shot = pixels(page)[8:-8, 8:-8]
        assert canvas.get_attribute("aria-label").startswith("predicted surface")
        page.click("text=show the points")
        page.uncheck("#photo")
        points = (pixels(page)[8:-8, 8:-8] < 200).all(axis=2)
        page.click("text=show the surface")
        inside = np.ptp(shot, axis=2) > 30
        assert (inside & points).sum() > 0.75 * (inside | points).sum(), name
        columns = np.arange(shot.shape[1])
        middle = middle or np.nonzero(inside)[1].mean()
        for part, colour in ((columns < middle, (180, 60, 40)), (columns > middle, (40, 60, 180))):
            found = np.median(shot[inside & (part if name == "front" else ~part)], axis=0)
            assert name == "side" or np.abs(found - colour).max() < 25
        assert 8 < shot[inside].max(axis=1).std() < 25  # lit softly
    page.add_init_script(
        "HTMLCanvasElement.prototype.getContext = (get => function (kind) {"
        "return kind === '2d' ? get.call(this, kind) : null;"
        "})(HTMLCanvasElement.prototype.getContext)"
    )
    page.reload()
    assert page.locator("#shape").is_disabled()
    assert differs(pixels(page)[8:-8, 8:-8], shot)
    assert page.locator("#colour").is_visible()


def test_damaged_surfaces_are_refused(predicted, tmp_path):
    path = tmp_path / "a_surface.glb"
    good = path.read_bytes()
    end = 20 + int.from_bytes(good[12:16], "little")
    assert np.ptp(read_surface(path).vertices[:, 1]) == pytest.approx(1.2, rel=1e-4)

    def read(content):
        if isinstance(content, tuple):
            kind, index, key, value = content
            (document := json.loads(good[20:end]))[kind][index][key] = value
            text = json.dumps(document).encode()
            content = good[:12] + len(text).to_bytes(4, "little") + b"JSON" + text + good[end:]
        path.write_bytes(content)
        read_surface(path)

    table = [(content, path) for content in (b"", b"glTF" + bytes(99), good[: len(good) // 2])]
    table.append((bytes(17 << 20), path, 17 << 20))
    for key, value in (("count", -3), ("count", 1 << 30), ("byteOffset", -4), ("bufferView", 99)):
        table.append((("accessors", 0, key, value), path))
    table.append((("accessors", 1, "count", 3), path, 3))  # faces with other vertices
    table.append((("accessors", 0, "componentType", 5126), path))  # floats
    table.append((("bufferViews", 2, "byteLength", 9), path))  # half of a picture
    table += [(("meshes", 0, "extras", {"unit": unit}), path) for unit in (0, "x", 1e-40, None)]
    all_refused(read, SurfaceFileError, table)
