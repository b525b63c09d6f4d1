"""Prediction files are read; other files are refused."""

import io
import os
import zipfile

import numpy as np
import pytest

from psgn_jax.commands import spheres as spheres_command
from psgn_jax.commands import view
from psgn_jax.viewing import page
from psgn_jax.viewing.predictions import PredictionFileError, read_prediction

ALL = page.FIELDS


def arrays(**changes):
    return {
        "points": np.zeros((2, 50, 3), np.float32),
        "colours": np.zeros((2, 50, 3), np.uint8),
        "seen": np.ones((2, 50), bool),
        "branch": np.zeros(50, np.uint8),
        "image": np.zeros((48, 64, 3), np.uint8),
        "intrinsics": np.eye(3),
        "extrinsics": np.eye(3, 4),
        "photo": np.zeros((30, 40, 3), np.uint8),
        "to_view": np.diag([2.0, 2.0, 1.0]),
        **changes,
    }


def test_a_prediction_is_read(tmp_path):
    np.savez(tmp_path / "a.npz", **arrays(points=np.ones((2, 50, 3), ">f8")))
    read = read_prediction(tmp_path / "a.npz", ALL)
    assert {name: value.shape for name, value in read.items()} == {
        name: value.shape for name, value in arrays().items()
    }
    assert read["points"].dtype == np.float32
    assert (read["points"] == 1).all()


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
    np.savez(folder / "wide.npz", **arrays(colours=np.zeros((2, 50, 3), np.uint16)))
    np.savez(folder / "swapped.npz", **arrays(image=np.zeros((48, 64, 3), ">u2")))
    np.savez(folder / "huge.npz", **arrays(image=np.zeros((2049, 1000, 3), np.uint8)))
    np.savez(folder / "branch.npz", **arrays(branch=np.full(50, 2, np.uint8)))
    np.savez(folder / "shear.npz", **arrays(to_view=np.ones((3, 3))))
    million = {"points": np.zeros((1, 10**6, 3), np.float32), "seen": np.ones((1, 10**6), bool)}
    np.savez(folder / "million.npz", **arrays(**million))
    for name, depth in (("nested.npz", 3000), ("deeper.npz", 9000)):
        text = b"{'descr': '<f4', 'fortran_order': False, 'shape': " + b"(" * depth
        magic = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little")
        with zipfile.ZipFile(folder / name, "w") as archive:
            archive.writestr("points.npy", magic + text)
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
    for name, data in {
        "claims.npz": header(10**12), "negative.npz": header(-1), "no_array.npz": b"hello",
    }.items():  # fmt: skip
        with zipfile.ZipFile(folder / name, "w") as archive:
            archive.writestr("points.npy", data)
    np.savez(folder / "strings.npz", **arrays(points=np.array(["abc"])))
    return {
        "claims.npz": r"points is float32 \[1, 1000000000000, 3\] in [0-9]+ bytes",
        "negative.npz": r"points is float32 \[1, -1, 3\] in [0-9]+ bytes",
        "no_array.npz": "cannot be read as a prediction",
        "strings.npz": r"points is <U3 \[1\] in 140 bytes",
        "text.npz": "as a prediction: expected a file NAME.npz",
        "pipe.npz": "it is a named pipe, expected a file",
        ".": "it is a folder, expected a file",
        "absent.npz": "no such file",
        "lacks.npz": "it has no array",
        "object.npz": "cannot be read as a prediction",
        "shape.npz": r"colours is uint8 \[2, 49, 3\], expected uint8 \[k, n, 3\]",
        "none.npz": r"points is float64 \[0, 50, 3\]",
        "wide.npz": r"colours is uint16 \[2, 50, 3\], expected uint8",
        "swapped.npz": r"image is >u2 \[48, 64, 3\], expected uint8",
        "huge.npz": r"image is uint8 \[2049, 1000, 3\], expected uint8 \[h, w, 3\] with h up to",
        "branch.npz": "branch is 2, expected 0 or 1",
        "shear.npz": "to_view is no scale and shift",
        "million.npz": "with k up to 64, n up to 16384",
        "nested.npz": "cannot be read as a prediction",
        "deeper.npz": "cannot be read as a prediction",
        "camera.npz": "extrinsics",
        "nan.npz": "points is not finite",
        "cut.npz": "as a prediction: expected a file NAME.npz",
        "flipped.npz": "cannot be read as a prediction",
        "bomb.npz": "points takes [0-9]+ bytes, expected at most",
    }


def test_what_is_no_prediction_is_refused_in_one_line(tmp_path, capsys):
    for name, message in hostile(tmp_path).items():
        with pytest.raises(PredictionFileError, match=message) as error:
            read_prediction(tmp_path / name, ALL)
        assert "pickle" not in str(error.value).replace(name, ""), name
        assert "\n" not in str(error.value)
        for command in (view.main, spheres_command.main):
            if name == "shear.npz" and command is spheres_command.main:
                continue  # it does not read that field
            assert command([str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
            assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_camera_from_straight_above_is_drawn(tmp_path):
    np.savez(tmp_path / "a.npz", **arrays(points=np.full((2, 50, 3), [0, 0, 2], np.float32)))
    assert spheres_command.main([str(tmp_path / "a.npz"), "--out", str(tmp_path / "a.png")]) == 0
