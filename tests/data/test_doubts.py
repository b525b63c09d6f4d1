"""Data sets in other conventions than the schema's are named; right ones are not."""

import dataclasses
import re

import numpy as np
import pytest
from helpers import drawn_solids as solids
from helpers.commands import ROOT
from scipy.spatial.transform import Rotation

from psgn_jax.commands import inspect_records as inspect
from psgn_jax.data import camera, framing
from psgn_jax.data.dataset import RecordReader, doubts_of, write_dataset

OPENGL, PYTORCH3D = np.diag([1, -1, -1]), np.diag([-1, -1, 1])
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # z becomes y


def samples(count=6, down=4, right=9):
    """Solids away from the middle of the image, so that its sides differ."""
    for number, sample in enumerate(solids.samples(count, seed=3, image_size=(96, 128))):
        moved = {name: np.roll(getattr(sample, name), (down, right), (0, 1)) for name in IMAGES}
        intrinsics = sample.intrinsics + np.float32([[0, 0, right], [0, 0, down], [0, 0, 0]])
        yield dataclasses.replace(sample, **moved, intrinsics=intrinsics, model_id=f"{number}")


IMAGES = ("image", "mask", "depth")


def outer(change):
    return lambda s: dataclasses.replace(s, extrinsics=np.float32(change(s.extrinsics)))


def inner(change):
    return lambda s: dataclasses.replace(s, intrinsics=np.float32(change(s.intrinsics)))


def images(change):
    def changed(s):
        new = {name: np.ascontiguousarray(change(getattr(s, name))) for name in IMAGES}
        return dataclasses.replace(s, **new)

    return changed


def depth(change):
    return lambda s: dataclasses.replace(s, depth=np.float32(change(s.depth, s.mask)))


def points(change):
    return lambda s: dataclasses.replace(s, points=np.float32(change(s.points)))


def framed(turn):
    """Points and camera in another frame."""
    return lambda s: outer(lambda e: np.column_stack([e[:, :3] @ turn.T, e[:, 3]]))(
        points(lambda p: p @ turn.T)(s)
    )


def inverse(extrinsics):
    return np.linalg.inv(np.vstack([extrinsics, [0, 0, 0, 1]]))[:3]


def about_z(degrees):
    return Rotation.from_euler("z", degrees, degrees=True).as_matrix()


CONVENTIONS = {
    "opengl": (outer(lambda e: OPENGL @ e), ["OpenGL", "negate rows 2 and 3"]),
    "pytorch3d": (
        outer(lambda e: np.column_stack([(PYTORCH3D @ e[:, :3]).T, PYTORCH3D @ e[:, 3]])),
        ["PyTorch3D", "transpose", "negate rows 1 and 2"],
    ),
    "to world": (outer(inverse), ["camera to world", "invert"]),
    "blender": (
        outer(lambda e: inverse(OPENGL @ e)), ["camera to world", "Blender", "negate rows 2 and 3"]
    ),
    "transposed": (outer(lambda e: np.column_stack([e[:, :3].T, e[:, 3]])), ["transpose"]),
    "position": (outer(lambda e: np.column_stack([e[:, :3], inverse(e)[:, 3]])), ["-R @ C"]),
    "in 0..1": (inner(lambda k: np.diag([1 / 128, 1 / 96, 1]) @ k), ["0..1", "width", "height"]),
    "of another size": (inner(lambda k: np.diag([2, 2, 1]) @ k), ["another image size"]),
    "swapped": (inner(lambda k: k[[1, 0, 2]][:, [1, 0, 2]]), ["cx and cy"]),
    "mirrored": (images(lambda a: a[:, ::-1]), ["left to right", "flip"]),
    "upside down": (images(lambda a: a[::-1]), ["upside down", "flip"]),
    "turned": (images(lambda a: a[::-1, ::-1]), ["180 degrees"]),
    "rolled": (images(lambda a: np.roll(a, 50, axis=1)), ["onto the mask", "docs/data.md"]),
    "background": (
        lambda s: dataclasses.replace(s, mask=~s.mask, depth=None), ["mask", "background", "invert"]
    ),
    "own frame": (
        lambda s: framed(about_z(50 * int(s.model_id) + 50))(s), ["own frame", "about z"]
    ),
    "y up": (framed(Y_UP), ["+y is up", "[:, [0, 2, 1]] * [1, -1, 1]"]),
    "x up": (framed(np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])), ["+x is up", "[2, 1, 0]"]),
    "points y up": (points(lambda p: p @ Y_UP.T), ["points", "[0, 2, 1]] * [1, -1, 1]"]),
    "millimetres": (depth(lambda d, _: 1000 * d), ["depth", "unit", "divide"]),
    "inverse": (depth(lambda d, m: np.where(m, 5 / np.where(m, d, 1), 0)), ["inverse depth"]),
    "far": (depth(lambda d, m: np.where(m, d, 1e8)), ["depth outside of the mask"]),
    "large": (points(lambda p: 1000 * p), ["farthest point", "radius"]),
    "lifted": (
        lambda s: outer(lambda e: np.column_stack([e[:, :3], e[:, 3] - e[:, 2] / 2]))(
            points(lambda p: p + np.array([0, 0, 0.5]))(s)
        ),
        ["lowest point", "0.5", "origin"],
    ),
    "in one place": (points(lambda p: 0 * p + 0.1), ["6 of 6", "in one place"]),
    "no mask": (lambda s: dataclasses.replace(s, mask=0 * s.mask > 0, depth=None), ["empty mask"]),
}  # fmt: skip


def found(tmp_path, caplog, **splits):
    """The lines that reading gives. Those that writing logs are the same, up to counts."""
    caplog.clear()
    write_dataset(tmp_path, splits, source="test")
    lines = doubts_of({name: RecordReader(tmp_path, name) for name in splits})
    logged = [record.getMessage().partition(": ")[2] for record in caplog.records]
    assert [line.split(" ", 3)[3] for line in logged] == [line.split(" ", 3)[3] for line in lines]
    return lines


@pytest.mark.parametrize("name", CONVENTIONS)
def test_each_convention_is_named_with_its_remedy(name, tmp_path, caplog):
    change, words = CONVENTIONS[name]
    moved = (0, 0) if name == "of another size" else (4, 9)
    lines = found(tmp_path, caplog, train=map(change, samples(6, *moved)))
    if name == "large":  # they do not project onto the masks either
        assert len(lines) == 2
    else:
        assert len(lines) == 1, lines
    assert all(word in lines[-1] for word in words), lines


def test_faults_of_camera_and_frame_are_named_together(tmp_path, caplog):
    def wrong(sample):
        own = framed(Y_UP @ about_z(70 * int(sample.model_id)))(sample)
        return outer(lambda e: inverse(OPENGL @ e))(own)

    camera_line, frame_line = found(tmp_path, caplog, train=map(wrong, samples()))
    assert "Blender" in camera_line
    assert "+y is up" in frame_line
    assert "turn_to_view" in frame_line


def test_right_records_and_few_that_do_not_fit_give_no_word(tmp_path, caplog, capsys):
    right = list(samples(40))
    shown = outer(lambda e: OPENGL @ e)(right[7]), *right[8:]
    assert not found(tmp_path / "right", caplog, train=[*right[:7], *shown])
    assert inspect.main([str(tmp_path / "right"), "--samples=1"]) == 0
    found(tmp_path / "wrong", caplog, train=map(outer(lambda e: OPENGL @ e), right))
    assert inspect.main([str(tmp_path / "wrong"), "--samples=1"]) == 1
    assert "DOUBTFUL 40 of 40 samples" in capsys.readouterr().out


def test_models_and_clouds_in_two_splits_are_named(tmp_path, caplog):
    one, two, three = samples(3)
    other = dataclasses.replace(one, category="other", points=two.points[::-1])
    for number, (splits, words) in enumerate((
        ({"train": [one, one], "validation": [two]}, []),
        ({"train": [one], "duplicate": [one]}, []),
        ({"train": [one], "validation": [one, two], "test": [two]}, ["2 models", "'0' (box)"]),
        ({"train": [two], "validation": [three, other]}, ["cloud", "'0' (other)"]),
    )):  # fmt: skip
        lines = found(tmp_path / str(number), caplog, **splits)
        lines = [line for line in lines if "project" not in line]
        assert len(lines) == bool(words)
        assert all(word in lines[0] for word in words)


def test_the_authors_records_give_no_word(authors_batches, tmp_path, caplog):
    """Of all 1,759, .6 % do not fit; no convention is named and no depth is doubted."""
    from psgn_jax.data.sources import authors

    entries = authors.read_batch(authors_batches / "15.gz")
    assert not found(tmp_path, caplog, train=[entry.sample for entry in entries])


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
    gl, three = np.diag([1, -1, -1, 1]) @ world, PYTORCH3D @ right
    quaternion = Rotation.from_matrix(right[:, :3]).as_quat()[[3, 0, 1, 2]]

    def seen(turn):
        turned = np.column_stack([right[:, :3] @ turn.T, right[:, 3]])
        return {"points": points @ turn.T, "extrinsics": turned}

    given = {
        "OpenCV: world": {"R": right[:, :3], "t": right[:, 3]},
        "OpenCV: camera": {"M": np.linalg.inv(world)},
        "COLMAP": {"qvec": quaternion, "tvec": right[:, 3]},
        "OpenGL": {"M": gl},
        "Blender": {"M": np.linalg.inv(gl)},
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
