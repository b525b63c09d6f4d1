import dataclasses
import re

import numpy as np
import pytest
from helpers import drawn_solids as solids
from helpers.commands import ROOT
from helpers.refusals import check_message
from scipy.spatial.transform import Rotation

from psgn_jax.commands import inspect_records as inspect
from psgn_jax.data import camera, framing
from psgn_jax.data.dataset import RecordReader, doubts_of, write_dataset
from psgn_jax.data.doubts import fit

GL, PYTORCH3D = np.diag([1, -1, -1, 1]), np.diag([-1, -1, 1])
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # z becomes y
X_UP = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
X_TO_VIEWER = np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])  # level, but the objects lie
IMAGES = ("image", "mask", "depth")


def samples(count=6):
    """Solids away from the middle of the image, so that its sides differ."""
    for number, sample in enumerate(solids.samples(count, seed=3, image_size=(96, 128))):
        yield dataclasses.replace(moved(sample, 4, 9), model_id=f"{number}")


def moved(sample, down, right):
    """The image is moved, and its camera."""
    shifted = of(lambda plane: np.roll(plane, (down, right), (0, 1)), *IMAGES)(sample)
    return inner(lambda k: k + centre(right, down))(shifted)


def of(change, *fields):
    """Changes these fields of a sample."""

    def changed(sample):
        old = {name: getattr(sample, name) for name in fields}
        new = {name: np.ascontiguousarray(change(old[name]), old[name].dtype) for name in fields}
        return dataclasses.replace(sample, **new)

    return changed


def outer(change):
    return of(lambda e: change(np.vstack([e, [0, 0, 0, 1]]))[:3], "extrinsics")


def inner(change):
    return of(change, "intrinsics")


def framed(turn):
    """Points and camera in another frame."""
    camera_of = outer(lambda e: e @ np.vstack([np.pad(turn.T, ((0, 0), (0, 1))), [0, 0, 0, 1]]))
    return lambda sample: camera_of(of(lambda p: p @ turn.T, "points")(sample))


def centre(right, down):
    return np.array([[0, 0, right], [0, 0, down], [0, 0, 0]])


def with_volume(sample, change=np.asarray):
    """The cells of the points are occupied."""
    occupancy = np.zeros((32, 32, 32), np.bool_)
    cells = np.floor(np.add(sample.points, [1, 1, 0]) * 16).astype(int).clip(0, 31)
    occupancy[tuple(cells.T)] = True
    return dataclasses.replace(sample, occupancy=change(occupancy))


def cut(sample):
    """The image ends in the middle of the object."""
    middle = int(np.argwhere(sample.mask)[:, 0].mean())
    return of(lambda plane: plane[:middle], *IMAGES)(sample)


def rolled(sample):
    """The camera is rolled by 30 degrees."""
    turn, (height, width) = about_z(30), sample.mask.shape
    pixels = np.mgrid[0.5:height, 0.5:width].reshape(2, -1)[::-1].T - sample.intrinsics[:2, 2]
    columns, rows = np.floor(pixels @ turn[:2, :2] + sample.intrinsics[:2, 2]).astype(int).T
    index = rows.clip(0, height - 1), columns.clip(0, width - 1)
    image = of(lambda plane: plane[index].reshape(plane.shape), *IMAGES)
    return image(outer(lambda e: np.vstack([turn @ e[:3], e[3]]))(sample))


def hung(height):
    camera_of = outer(lambda e: e + e[:, 2:3] * [0, 0, 0, -height])
    return lambda sample: camera_of(of(lambda p: p + np.array([0, 0, height]), "points")(sample))


def about_z(degrees):
    return Rotation.from_euler("z", degrees, degrees=True).as_matrix()


def own_frame(sample):
    return framed(about_z(50 * int(sample.model_id) + 50))(sample)


CONVENTIONS = [
    (outer(lambda e: GL @ e), "OpenGL", "negate rows 2 and 3"),
    (outer(lambda e: np.column_stack([(PYTORCH3D @ e[:3, :3]).T, PYTORCH3D @ e[:3, 3]])),
     "PyTorch3D", "transpose", "negate rows 1 and 2"),
    (outer(np.linalg.inv), "camera to world", "invert"),
    (outer(lambda e: np.linalg.inv(GL @ e)), "camera to world", "Blender", "negate rows 2 and 3"),
    (outer(lambda e: np.column_stack([e[:3, :3].T, e[:3, 3]])), "transpose"),
    (outer(lambda e: np.column_stack([e[:3, :3], np.linalg.inv(e)[:3, 3]])), "-R @ C"),
    (inner(lambda k: np.diag([1 / 128, 1 / 96, 1]) @ k), "0..1", "width", "height"),
    (lambda s: inner(lambda k: np.diag([2, 2, 1]) @ k)(moved(s, -4, -9)), "another image size"),
    (inner(lambda k: k[[1, 0, 2]][:, [1, 0, 2]]), "cx and cy"),
    (inner(lambda k: np.diag([1 / 64, 1 / 48, 1]) @ (k - centre(64, 48))), "-1..1", "cx and cy"),
    (inner(lambda k: k - centre(64, 48)), "centre", "add half the width"),
    (lambda s: dataclasses.replace(s, points=camera.to_camera(s.points, s.extrinsics)),
     "points in the camera's frame", "@ extrinsics[:, :3]"),
    (of(lambda plane: plane[:, ::-1], *IMAGES), "left to right", "flip"),
    (of(lambda plane: plane[::-1], *IMAGES), "upside down", "flip"),
    (of(lambda plane: plane[::-1, ::-1], *IMAGES), "180 degrees"),
    (of(lambda plane: np.roll(plane, 50, axis=1), *IMAGES), "onto the mask", "docs/data.md"),
    (of(lambda mask: ~mask, "mask"), "mask of the background", "invert"),
    (inner(lambda k: k * [[1.33, 1, 1], [1, 1.33, 1], [1, 1, 1]]), "1.3", "focal length"),
    (lambda s: with_volume(s, np.transpose), "volume", "[x, y, z]"),
    (of(lambda plane: plane[::-1], "depth"), "depth upside down", "flip"),
    (own_frame, "own frame", "about z"),
    (framed(Y_UP), "+y is up", "[:, [0, 2, 1]] * [1, -1, 1]"),
    (framed(X_UP), "+x is up", "[2, 1, 0]"),
    (framed(X_TO_VIEWER), "+x is up", "[2, 1, 0]"),
    (of(lambda p: p @ Y_UP.T, "points"), "points", "[0, 2, 1]] * [1, -1, 1]"),
    (of(lambda d: 50 * d, "depth"), "depth", "unit", "divide"),
    (of(lambda d: np.where(d > 0, 5 / np.maximum(d, 1), 0), "depth"), "inverse depth"),
    (of(lambda d: np.where(d > 0, d, 1e8), "depth"), "depth outside of the mask"),
    (hung(0.5), "lowest point", "0.5", "origin"),
    (of(lambda p: 0 * p + 0.1, "points"), "6 of 6", "in one place"),
    (of(lambda plane: 0 * plane, "mask", "depth"), "empty mask"),
]  # fmt: skip


def found(tmp_path, caplog, **splits):
    """The lines that reading gives. Those that writing logs are the same, up to counts."""
    caplog.clear()
    write_dataset(tmp_path, splits, source="test")
    lines = doubts_of({name: RecordReader(tmp_path, name) for name in splits})
    logged = [record.getMessage().partition(": ")[2] for record in caplog.records]
    assert [line.split(" ", 3)[3] for line in logged] == [line.split(" ", 3)[3] for line in lines]
    return lines


@pytest.mark.parametrize("number", range(len(CONVENTIONS)))
def test_each_convention_is_named_with_its_remedy(number, tmp_path, caplog):
    change, *words = CONVENTIONS[number]
    (line,) = found(tmp_path, caplog, train=map(change, samples()))
    check_message(line, *words)


def test_faults_of_camera_and_frame_are_named_together(tmp_path, caplog):
    def wrong(sample):
        return outer(lambda e: np.linalg.inv(GL @ e))(framed(Y_UP)(own_frame(sample)))

    camera_line, frame_line = found(tmp_path, caplog, train=map(wrong, samples()))
    check_message(camera_line, "Blender")
    check_message(frame_line, "+y is up", "turn_to_view")
    large = of(lambda p: 1000 * p, "points")
    _, radius_line = found(tmp_path / "2", caplog, train=map(large, samples()))
    check_message(radius_line, "farthest", "radius")


def test_right_records_and_few_that_do_not_fit_give_no_word(tmp_path, caplog, capsys):
    right = list(samples(40))
    gl = outer(lambda e: GL @ e)
    unusual = [gl(right[0]), hung(0.3)(right[1]), *map(with_volume, right[2:9])]
    assert not found(tmp_path / "right", caplog, train=[*unusual, *right[9:]])
    assert fit(inner(lambda k: k + centre(0, 30))(cut(right[0]))) == 0  # no point is in the image
    for number, change in enumerate((cut, rolled)):
        assert not found(tmp_path / str(number), caplog, train=map(change, right[:8]))
    assert inspect.main([str(tmp_path / "right"), "--samples=1"]) == 0
    found(tmp_path / "wrong", caplog, train=map(gl, right))
    assert inspect.main([str(tmp_path / "wrong"), "--samples=1"]) == 1
    assert "DOUBTFUL 40 of 40 samples" in capsys.readouterr().out


def test_models_and_clouds_in_two_splits_are_named(tmp_path, caplog):
    one, two, three = samples(3)
    again = {"category": "other", "model_id": one.model_id, "points": two.points[::-1]}
    other = dataclasses.replace(two, **again)
    for number, (splits, *words) in enumerate((
        ({"train": [one, one], "validation": [two]},),
        ({"train": [one], "duplicate": [one]},),
        ({"train": [one], "validation": [one, two], "test": [two]}, "2 models", "'0' (box)"),
        ({"train": [two], "validation": [three, other]}, "cloud", "'0' (other)"),
    )):  # fmt: skip
        lines = found(tmp_path / str(number), caplog, **splits)
        assert len(lines) == bool(words)
        check_message("".join(lines), *words)


def conventions():
    """What one has and the line of code, in the tables of the page."""
    text = (ROOT / "docs/data.md").read_text().partition("### Conventions")[2].partition("\n## ")[0]
    return re.findall(r"^\| ([^|]+) \| `([^|]+)` \|$", text, re.MULTILINE)


def test_the_lines_of_the_page_make_the_schemas_camera_and_points():
    (sample,) = solids.samples(1, seed=3, image_size=(96, 128))
    scale, shift = framing.normal_form(sample.points)
    points, k = (sample.points - shift) / scale, sample.intrinsics.astype(float)
    right = framing.normalised_extrinsics(sample.extrinsics, scale, shift).astype(float)
    want = {"points": points, "extrinsics": right, "intrinsics": k}
    names = {"np": np, "Rotation": Rotation, "turn_to_view": camera.turn_to_view, **vars(framing)}
    world = np.vstack([right, [0, 0, 0, 1]])
    three = PYTORCH3D @ right
    quaternion = Rotation.from_matrix(right[:, :3]).as_quat()[[3, 0, 1, 2]]

    def seen(turn):
        turned = np.column_stack([right[:, :3] @ turn.T, right[:, 3]])
        return {"points": points @ turn.T, "extrinsics": turned}

    given = {
        "OpenCV: world": {"R": right[:, :3], "t": right[:, 3]},
        "OpenCV: camera": {"M": np.linalg.inv(world)},
        "COLMAP": {"qvec": quaternion, "tvec": right[:, 3]},
        "OpenGL": {"M": GL @ world},
        "Blender": {"M": np.linalg.inv(GL @ world)},
        "PyTorch3D": {"R": three[:, :3].T, "T": three[:, 3]},
        "intrinsics": {"intrinsics": np.diag([1 / 128, 1 / 96, 1]) @ k, "width": 128, "height": 96},
        "OpenCV: (0, 0)": {"intrinsics": k - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]},
        "ShapeNet": seen(Y_UP),
        "the object's": seen(about_z(130)),
        "another": {
            "points": 5 * points + [1, 2, 3],
            "extrinsics": framing.normalised_extrinsics(right, 0.2, -np.array([1, 2, 3]) / 5),
        },
    }
    lines = conventions()
    assert len(lines) == len(given)
    for (what, line), (name, values) in zip(lines, given.items(), strict=True):
        assert what.startswith(name)
        exec(line, scope := names | values)
        changed = [name for name in want if name in line]
        for name in changed:
            np.testing.assert_allclose(scope[name], want[name], atol=1e-5, err_msg=what)
        assert changed
