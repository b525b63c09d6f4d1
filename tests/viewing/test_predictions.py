"""Prediction files are read; other files are refused."""

import io
import os
import zipfile

import numpy as np
import pytest

from psgn_jax.commands import spheres as spheres_command
from psgn_jax.commands import view
from psgn_jax.viewing.predictions import PredictionFileError, read_prediction

ALL = ("points", "colours", "branch", "image", "intrinsics", "extrinsics")


def arrays(**changes):
    return {
        "points": np.zeros((2, 50, 3), np.float32),
        "colours": np.zeros((2, 50, 3), np.uint8),
        "branch": np.zeros(50, np.uint8),
        "image": np.zeros((48, 64, 3), np.uint8),
        "intrinsics": np.eye(3),
        "extrinsics": np.eye(3, 4),
        **changes,
    }


def test_a_prediction_is_read(tmp_path):
    np.savez(tmp_path / "a.npz", **arrays())
    read = read_prediction(tmp_path / "a.npz", ALL)
    assert {name: value.shape for name, value in read.items()} == {
        name: value.shape for name, value in arrays().items()
    }


def header(count):
    """The beginning of an array [1, count, 3] of an NPZ file."""
    text = io.BytesIO()
    shape = {"descr": "<f4", "fortran_order": False, "shape": (1, count, 3)}
    np.lib.format.write_array_header_1_0(text, shape)
    return text.getvalue()


def hostile(folder):
    """Writes unusable files; returns the name of each, with its error message."""
    (folder / "text.npz").write_text("nothing")
    os.mkfifo(folder / "pipe.npz")
    np.savez(folder / "lacks.npz", points=np.zeros((1, 5, 3)))
    np.savez(folder / "object.npz", **arrays(points=np.array([{}, []], object)))
    np.savez(folder / "shape.npz", **arrays(colours=np.zeros((2, 49, 3), np.uint8)))
    np.savez(folder / "none.npz", **arrays(points=np.zeros((0, 50, 3))))
    np.savez(folder / "nan.npz", **arrays(points=np.full((2, 50, 3), np.nan)))
    np.savez(folder / "camera.npz", **arrays(extrinsics=np.ones((3, 4))))
    np.savez(folder / "whole.npz", **arrays())
    data = (folder / "whole.npz").read_bytes()
    (folder / "cut.npz").write_bytes(data[: len(data) // 2])
    (folder / "flipped.npz").write_bytes(data[:300] + b"x" * 200 + data[500:])
    with (
        zipfile.ZipFile(folder / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("points.npy", "w", force_zip64=True) as member,
    ):
        member.write(header(1 << 28))
        for _ in range(300):
            member.write(bytes(1 << 20))
    with zipfile.ZipFile(folder / "claims.npz", "w") as archive:
        archive.writestr("points.npy", header(10**12))
    return {
        "claims.npz": r"points is float32 \[1, 1000000000000, 3\] in [0-9]+ bytes",
        "text.npz": "is not a prediction: expected a file NAME.npz",
        "pipe.npz": "it is a named pipe, expected a file",
        ".": "it is a folder, expected a file",
        "absent.npz": "no such file",
        "lacks.npz": "it has no array",
        "object.npz": "damaged, or not a prediction",
        "shape.npz": r"colours is uint8 \[2, 49, 3\], expected uint8 \[k, n, 3\]",
        "none.npz": r"points is float64 \[0, 50, 3\]",
        "camera.npz": "extrinsics",
        "nan.npz": "points is not finite",
        "cut.npz": "is not a prediction",
        "flipped.npz": "damaged, or not a prediction",
        "bomb.npz": "points takes [0-9]+ bytes, expected at most",
    }


def test_what_is_no_prediction_is_refused_in_one_line(tmp_path, capsys):
    for name, message in hostile(tmp_path).items():
        with pytest.raises(PredictionFileError, match=message) as error:
            read_prediction(tmp_path / name, ALL)
        assert "pickle" not in str(error.value).replace(name, ""), name
        assert "\n" not in str(error.value)
        for command in (view.main, spheres_command.main):
            if name in ("shape.npz", "camera.npz"):  # one of the readers does not read that field
                continue
            assert command([str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
            assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_camera_from_straight_above_is_drawn(tmp_path):
    np.savez(tmp_path / "a.npz", **arrays(points=np.full((1, 50, 3), [0, 0, 2], np.float32)))
    assert spheres_command.main([str(tmp_path / "a.npz"), "--out", str(tmp_path / "a.png")]) == 0
