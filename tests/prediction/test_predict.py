import json

import jax
import numpy as np
import pytest
import trimesh
from helpers import standin
from helpers.commands import psgn_each
from helpers.obj_text import scene
from helpers.refusals import all_refused, check_message, refused
from helpers.weights import random_params, write_run
from PIL import Image

from psgn_jax.config.experiment import ConfigError
from psgn_jax.data import camera
from psgn_jax.data.photo import PhotoError
from psgn_jax.prediction import mask_networks, masks
from psgn_jax.prediction.cloud import DECONV, FC, Prediction
from psgn_jax.prediction.files import predict_files
from psgn_jax.prediction.formats import read_prediction
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.weights.run_folder import Trained

CONFIG = standin.config(model__widths=(4, 6, 8), model__fc_points=5, data__image_size=(24, 32))


@pytest.fixture(scope="module")
def predictor():
    return Predictor(Trained(CONFIG, 7, random_params(CONFIG), {}, "runs/x"))


BOX, _ = scene(90, 120, (22, 67, 40, 80))
MASK = np.uint8(255) * scene(90, 120, (30, 60, 40, 80))[1]


def save(path, image=None, **options):
    """Writes an image, by default a photo of a box."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(BOX if image is None else image).save(path, **options)
    return path


def test_arrays_in_arrays_out(predictor):
    result = predictor(BOX, samples=2, seed=1)
    n = 5 + 12 * 16
    assert result.points.shape == result.colours.shape == (2, n, 3)
    assert result.branch.tolist() == [FC] * 5 + [DECONV] * (n - 5)
    assert result.mask_from == "plain"
    assert np.abs(predictor(BOX, samples=2, seed=2).points - result.points).max() > 0
    assert np.abs(result.points[0] - result.points[1]).max() > 0
    alpha = (BOX[..., :1] != 191) * np.uint8(255)
    rgba = np.concatenate([BOX, alpha], axis=2)
    with jax.numpy_dtype_promotion("strict"):  # of the caller
        rgba = predictor(rgba, samples=2, seed=1)
    # Behind a transparent photo, pages show the background of the renderings.
    assert (rgba.arrays()["photo"][0, 0] == 191).all()
    assert rgba.mask_from == "alpha"
    np.testing.assert_array_equal(rgba.points, result.points)


def test_what_was_placed_has_normal_form_and_projects_as_before(predictor):
    raw = predictor(BOX, frame="place", samples=2, normal_form="no")
    result = predictor(BOX, frame="place", samples=2)
    flat = result.points.reshape(-1, 3)
    assert flat[:, 2].min() == pytest.approx(0, abs=1e-6)
    assert np.linalg.norm(flat, axis=1).max() == pytest.approx(1, abs=1e-5)
    np.testing.assert_allclose(result.scale * result.points + result.shift, raw.points, atol=1e-5)
    for one, other in zip(result.points, raw.points, strict=True):
        seen, _ = camera.project(one, result.view.intrinsics, result.view.extrinsics)
        before, _ = camera.project(other, raw.view.intrinsics, raw.view.extrinsics)
        np.testing.assert_allclose(seen, before, atol=1e-2)
    np.testing.assert_array_equal(result.colours, raw.colours)
    assert predictor(BOX, frame="keep").scale == 1
    assert predictor(BOX, frame="keep", normal_form="yes").scale != 1


@pytest.mark.parametrize(
    ("high", "wide", "top"), [(16, 16, 15), (30, 30, 15), (60, 60, 15), (20, 40, 70), (16, 90, 74)]
)
def test_an_inverted_mask_is_turned_and_that_is_said(predictor, high, wide, top):
    """Of an object of 2.4 to 33 % of the photo, in the middle or at its border."""
    _, mask = scene(90, 120, (top, top + high, 20, 20 + wide))
    turned = predictor(BOX, ~mask)
    assert turned.warnings[0] == "the mask covers the border: it was inverted"
    assert len(turned.warnings) == 1 + (top + high == 90)  # cut off
    for right in predictor(BOX, mask), predictor(BOX, ~mask, invert_mask=True):
        assert right.warnings == turned.warnings[1:]
        np.testing.assert_array_equal(right.points, turned.points)
    np.testing.assert_array_equal(predictor(BOX, ~mask, invert_mask=False).mask, ~mask)


def test_what_a_mask_shows_of_an_object_is_told(predictor):
    for rows, columns, message in (
        ((20, 60), (0, 50), "border cuts the object off (left)"),
        ((0, 90), (30, 120), "border cuts the object off (top, bottom, right)"),
        ((20, 60), (10, 25), ""),
    ):
        _, mask = scene(90, 120, (*rows, *columns))
        assert message in "".join(predictor(BOX, mask).warnings)
        assert bool(message) == bool(predictor(BOX, mask).warnings)
    mask[70:75, 80:85] = True  # a speck
    assert not predictor(BOX, mask).warnings
    mask[60:80, 80:95] = True
    assert "two large parts" in predictor(BOX, mask).warnings[0]
    cropped = np.zeros((90, 120, 4), np.uint8)  # a cut-out
    cropped[:, 10:110] = cropped[20:60] = (200, 60, 20, 255)
    assert predictor(cropped).mask_from == "alpha"
    assert not predictor(cropped).warnings


def test_wrong_arguments(predictor):
    depth = standin.config(data__inputs=("rgb", "mask", "depth"))
    with refused(ConfigError, "data.inputs", "'rgb' and 'mask'"):
        Predictor(Trained(depth, 7, {}, {}))
    table = [
        ({"samples": 65}, "samples=65", "1 to 64"),  # `psgn view` reads no more
        ({"samples": True}, "samples=True", "1 to 64"),
        ({"seed": 2**31}, "seed=2147483648"),
        ({"first": "x"}, "first='x'", "zero, mean"),
        ({"frame": "x"}, "frame='x'", "auto, place, keep"),
        ({"normal_form": "x"}, "normal_form='x'", "auto, yes, no"),
    ]
    all_refused(lambda options: predictor(BOX, **options), ConfigError, table)
    fixed = Predictor(Trained(standin.config(model__random_size=0), 7, {}, {}))
    table = [({"samples": 2}, "samples=2"), ({"seed": 1}, "seed=1")]
    all_refused(lambda options: fixed(BOX, **options), ConfigError, table)


def test_files_and_folders(predictor, tmp_path):
    folder, out = tmp_path / "in", tmp_path / "out"
    for name in ("a.png", "b.jpg", "A.bmp", ".hidden.png", "deep/a.png"):
        save(folder / name)
    (folder / "notes.txt").write_text("no image")
    images = [folder, folder / "deep" / "a.png", folder / "a.png"]
    results = list(predict_files(lambda: predictor, images, out, samples=2, seed=5))
    assert [path.name for path, _ in results] == ["A.bmp", "a.png", "b.jpg", "a.png"]
    alone = predictor(BOX, samples=2, seed=5)
    # The clouds do not depend on the other images.
    np.testing.assert_array_equal(results[1][1].points, alone.points)
    names = {p.name for p in out.iterdir()}
    assert len(names) == 4 * 9
    assert {"A.json", "a-2.json", "b.json", "a-3.json", "b_0.ply", "b_1.obj", "b.npz"} <= names
    document = json.loads((out / "b.json").read_text())
    assert document["checkpoint"]["sha256"] == predictor.checksum
    assert (document["seed"], document["num_samples"], document["num_fc_points"]) == (5, 2, 5)
    assert set(document["files"]) | {"b.json"} == {n for n in names if n.startswith("b")}
    points = results[2][1].points
    np.testing.assert_array_equal(read_prediction(out / "b.npz", ["points"])["points"], points)
    np.testing.assert_array_equal(trimesh.load(out / "b_1.ply").vertices, points[1])


@pytest.mark.parametrize("brand", ["heic", "mif1"])
def test_heic_is_refused_with_advice_unless_a_copy_is_beside_it(brand, predictor, tmp_path):
    for name in ("a.HEIC", "b.heic"):
        (tmp_path / name).write_bytes(b"\0\0\0\x18ftyp" + brand.encode() + bytes(64))
    save(tmp_path / "b.jpg")
    save(tmp_path / "masks" / "mask.png", MASK)
    for images in ([tmp_path], [tmp_path / "a.HEIC", tmp_path / "b.jpg"]):
        for given in (None, str(tmp_path / "masks" / "mask.png")):
            results = predict_files(lambda: predictor, images, tmp_path / "out", mask=given)
            (path, error), (other, result) = results
            assert (path.name, other.name) == ("a.HEIC", "b.jpg")
            check_message(str(error), "HEIC", "PNG")
            assert isinstance(result, Prediction)
    (tmp_path / "a.HEIC").rename(tmp_path / "b_mask.heic")
    ((_, error),) = predict_files(lambda: predictor, [tmp_path], tmp_path / "out")
    check_message(str(error), "b_mask.heic", "HEIC")


def test_masks_by_name(predictor, tmp_path):
    images, folder = tmp_path / "in", tmp_path / "masks"
    for name in "abcd":
        save(images / f"{name}.png")
    save(folder / "a.PNG", MASK)
    (folder / "a.json").write_text("{}")  # of a program that labels images
    save(folder / "b_mask.png", MASK[::2, ::2])
    save(folder / "c.png", 0 * MASK)

    def predicted(mask=None, images=images, **how):
        given = {"mask": mask, "mask_options": how}
        found = predict_files(lambda: predictor, [images], tmp_path / "out", **given)
        return {path.stem: result for path, result in found}

    a, b, c, d = predicted(str(folder)).values()
    assert a.mask_from == b.mask_from == "given"
    check_message(str(c), "c.png")
    check_message(str(d), "d_mask.*", "d.*")
    with refused(ConfigError, "mask="):
        predicted(str(folder / "a.PNG"))
    # Beside the images: a mask is no image to predict, and an image is not its own mask.
    save(images / "A_Mask.PNG", MASK)
    results = predicted(str(images))
    assert list(results) == list("abcd")
    np.testing.assert_array_equal(results["a"].mask, MASK > 0)
    check_message(str(results["b"]), "b_mask.*")
    results = predicted()
    assert (results["a"].mask_from, results["b"].mask_from) == ("A_Mask.PNG", "plain")
    assert predictor(images / "a.png", mask_from="plain").mask_from == "plain"
    others = [images / "a.png", save(tmp_path / "other" / "a.png")]  # photos of one name
    _, (_, other) = predict_files(lambda: predictor, others, tmp_path / "out", mask=str(folder))
    assert isinstance(other, PhotoError)
    check_message(str(other), folder / "a.PNG", others[0])
    labelled = np.where(MASK > 0, 7, 3).astype(np.uint8)
    labelled[:10, :10] = 9
    save(images / "A_Mask.PNG", labelled)
    for label in (7, [7]):
        result = predicted(images=images / "a.png", mask_label=label)["a"]
        np.testing.assert_array_equal(result.mask, MASK > 0)


@pytest.mark.parametrize("length", [230, 251])
def test_a_long_name_ends_no_run(predictor, tmp_path, length):
    for name in ("a" * (length - 4) + ".png", "b.png"):
        save(tmp_path / name)
    long, short = predict_files(lambda: predictor, [tmp_path], tmp_path / "out", formats=["ply"])
    assert isinstance(short[1], Prediction)
    assert isinstance(long[1], Prediction if length == 230 else OSError)
    assert ".tmp" not in str(long[1])


def test_results_never_replace_other_files_and_are_no_inputs(predictor, tmp_path, monkeypatch):
    names = ("chair.jpg", "chair_input.png", "lamp.jpg", "pot.jpg")
    for name in names:
        save(tmp_path / name)
    for name in ("pot.obj", "lamp_1.ply"):
        (tmp_path / name).write_text("a mesh")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for _ in range(2):
        results = dict(predict_files(lambda: predictor, [tmp_path], tmp_path))
        assert [path.name for path in results] == list(names)
        assert all(isinstance(result, Prediction) for result in results.values())
        assert {name: (tmp_path / name).read_bytes() for name in before} == before
        written = {path.stem for path in tmp_path.glob("*.json")}
        assert written == {"chair-2", "chair_input", "lamp", "pot-2"}
    lamp = [tmp_path / "lamp.jpg"]
    next(predict_files(lambda: predictor, lamp, tmp_path, samples=2))
    assert (tmp_path / "lamp_1.ply").read_bytes() == before["lamp_1.ply"]
    assert (tmp_path / "lamp-2_1.ply").exists()
    # Clouds that are not written again stay results.
    for formats in (["obj"], ["ply"]):
        next(predict_files(lambda: predictor, lamp, tmp_path, formats=formats))
    record = json.loads((tmp_path / "lamp.json").read_text())
    assert record["files"] == ["lamp.ply", "lamp_input.png"]
    assert "lamp.obj" in record["earlier_files"]
    assert not (tmp_path / "lamp-3.json").exists()
    record["earlier_files"] += [3, None, "x" * 300]  # damaged
    (tmp_path / "lamp.json").write_text(json.dumps(record))
    ((_, result),) = predict_files(lambda: predictor, lamp, tmp_path, formats=["ply"])
    assert isinstance(result, Prediction)
    # Of two photos with the same name, also if one path is absolute.
    monkeypatch.chdir(tmp_path)
    for path in ("p1/cup.jpg", "p2/cup.jpg", str(tmp_path / "p1" / "cup.jpg")):
        save(tmp_path / path)
        next(predict_files(lambda: predictor, [path], "out", formats=["ply"]))
    for name, path in (("cup", "p1/cup.jpg"), ("cup-2", "p2/cup.jpg")):
        record = json.loads((tmp_path / "out" / f"{name}.json").read_text())
        assert record["image"] == str(tmp_path / path)
    assert len(list((tmp_path / "out").glob("*.json"))) == 2
    listed = sorted([*tmp_path.glob("*.jpg"), *tmp_path.glob("*.png")])  # as a shell expands p/*
    results = dict(predict_files(lambda: predictor, listed, tmp_path))
    assert sorted(path.name for path in results) == list(names)


def test_a_mask_that_is_not_certain_is_proposed(predictor, tmp_path, monkeypatch):
    p = np.full((8, 8), 0.01, np.float32)
    p[2:6, 3:6] = 0.7
    monkeypatch.setattr(mask_networks, "probabilities", lambda image, box, **_: p)
    noise = np.random.default_rng(0).integers(0, 255, (80, 80, 3), np.uint8)
    image, out = tmp_path / "a.png", tmp_path / "out"
    save(image, noise)

    def predicted(folder=out, accept=False, mask=None):
        options = {"mask": mask, "mask_options": {"accept_mask": accept}}
        ((_, result),) = predict_files(lambda: predictor, [image], folder, **options)
        return result

    uncertain = predicted()
    assert isinstance(uncertain, masks.UncertainMaskError)
    check_message(str(uncertain), "67%", "accept_mask", f"{out}/a_mask.png")
    assert {path.name for path in out.iterdir()} == {"a_mask.png", "a_overlay.png"}
    proposed = np.asarray(Image.open(out / "a_mask.png")) > 0
    np.testing.assert_array_equal(proposed, uncertain.mask)
    with Image.open(out / "a_overlay.png") as overlay:
        assert max(overlay.size) >= 512
    accepted = predicted(accept=True)
    assert accepted.mask_from == "network, 67% certain"
    busy = tmp_path / "busy"
    save(busy / "a_input.png", noise)  # a photo, so the view is a-2_input.png
    (warning,) = predicted(busy, accept=True).warnings
    assert (busy / "a-2_mask.png").exists()
    assert json.loads((busy / "a-2.json").read_text())["warnings"] == [warning]
    np.testing.assert_array_equal(accepted.mask, proposed)
    np.testing.assert_array_equal(predicted(mask=str(out)).points, accepted.points)
    # Beside the photo, a proposal is used only after it was mended, and then it is not replaced.
    for hint in ("", "; a_mask.png, beside the photo, is an unchanged proposal"):
        uncertain = predicted(tmp_path)
        assert isinstance(uncertain, masks.UncertainMaskError)
        check_message(str(uncertain), f"(accept_mask){hint}", "_mask.png")
    mended = proposed.copy()
    mended[40:60, 10:20] = True
    save(tmp_path / "a_mask.png", mended)
    assert predicted(tmp_path).mask_from == "a_mask.png"
    (tmp_path / "a_mask.png").replace(out / "a_mask.png")
    uncertain = predicted()
    assert isinstance(uncertain, masks.UncertainMaskError)
    assert str(out) not in str(uncertain)  # its file is no proposal any more
    np.testing.assert_array_equal(np.asarray(Image.open(out / "a_mask.png")), mended)
    # The proposals for two photos of one name, in two runs.
    for accept in (False, True):
        both = tmp_path / f"both{accept}"
        predicted(both)
        before = {path: path.read_bytes() for path in both.iterdir()}
        save(tmp_path / "p2" / "a.png", noise[::-1])
        options = {"mask_options": {"accept_mask": accept}}
        next(predict_files(lambda: predictor, [tmp_path / "p2" / "a.png"], both, **options))
        assert {path: path.read_bytes() for path in before} == before
        assert {"a-2_mask.png", "a-2_overlay.png"} <= {path.name for path in both.iterdir()}
        predicted(both, accept=True)
        assert {path: path.read_bytes() for path in before} == before
        assert (both / "a.json").exists()


def test_a_mask_in_stored_orientation_is_turned(predictor, tmp_path, monkeypatch):
    """Of a square photo, or one turned by 180 degrees, the proportions do not tell."""
    image, upright = scene(90, 90, (10, 40, 50, 80))
    found = upright.astype(np.float32)
    monkeypatch.setattr(mask_networks, "probabilities", lambda image, box, **_: found)
    exif = Image.Exif()
    exif[0x0112] = 6
    save(tmp_path / "a.png", np.rot90(image), exif=exif)
    save(tmp_path / "stored.png", np.rot90(upright))
    save(tmp_path / "upright.png", upright)
    stored = predictor(tmp_path / "a.png", tmp_path / "stored.png")
    assert "EXIF" in stored.warnings[0]
    right = predictor(tmp_path / "a.png", tmp_path / "upright.png")
    assert right.warnings == ()
    for cloud in stored, right:
        np.testing.assert_array_equal(cloud.mask, upright)


def test_the_command_goes_on_after_a_bad_file(tmp_path):
    workdir, out, folder = (tmp_path / name for name in ("run", "out", "in"))
    write_run(workdir, CONFIG, {"params": random_params(CONFIG)})
    save(folder / "good.png")
    Image.fromarray(BOX).convert("CMYK").save(folder / "cmyk.jpg")
    save(folder / "one.png", MASK[:1, :1])
    save(folder / "blank.png", np.full((80, 80, 3), (0, 0, 255), np.uint8))
    (folder / "text.png").write_text("no image")
    flags = (f"--workdir={workdir}", f"--out={out}", "--norefine")
    some, nothing = psgn_each(
        ["predict", folder, *flags, "--samples=2"],
        ["predict", folder / "text.png", *flags],
        imports=["psgn_jax.prediction.files", "psgn_jax.weights.opening"],
        PSGN_CACHE=str(tmp_path),
    )
    assert some.returncode == 1, some.stderr
    assert {p.stem for p in out.glob("*.json")} == {"good", "cmyk"}
    assert len([line for line in some.stderr.splitlines() if line.startswith("failed: ")]) == 3
    assert "Traceback" not in some.stderr
    assert "2 of 5 images" in some.stderr
    assert nothing.returncode == 2
    # Compiled programs are cached, so that later runs start quickly.
    assert list((tmp_path / "compiled").rglob("*"))
