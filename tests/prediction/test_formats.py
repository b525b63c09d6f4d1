import io
import os

import numpy as np
from helpers.obj_text import zipped
from helpers.refusals import refused

from psgn_jax.prediction.formats import PredictionFileError, read_prediction
from psgn_jax.viewing import viewer

FIELDS = (*viewer.FIELDS, "image")


def arrays(**changes):
    return {
        "points": np.zeros((2, 50, 3), np.float32), "colours": np.zeros((2, 50, 3), np.uint8),
        "seen": np.ones((2, 50), bool), "branch": np.zeros(50, np.uint8),
        "image": np.zeros((48, 64, 3), np.uint8), "intrinsics": np.eye(3),
        "extrinsics": np.eye(3, 4), "photo": np.zeros((30, 40, 3), np.uint8),
        "to_view": np.diag([2.0, 2.0, 1.0]), **changes,
    }  # fmt: skip


def test_a_prediction_is_read(tmp_path):
    np.savez(tmp_path / "a.npz", **arrays(points=np.ones((2, 50, 3), ">f8")))
    read = read_prediction(tmp_path / "a.npz", FIELDS)
    shapes, wanted = ({n: v.shape for n, v in each.items()} for each in (read, arrays()))
    assert shapes == wanted
    assert read["points"].dtype == np.float32
    assert (read["points"] == 1).all()
    np.savez(tmp_path / "b.npz", **arrays(spread=np.ones((2, 50), np.float32)))
    read = read_prediction(tmp_path / "b.npz", FIELDS)
    assert viewer.case_of("b", read).spread.shape == (2, 50)


def header(count):
    """The beginning of an array [1, count, 3] of an NPZ file."""
    text = io.BytesIO()
    shape = {"descr": "<f4", "fortran_order": False, "shape": (1, count, 3)}
    np.lib.format.write_array_header_1_0(text, shape)
    return text.getvalue()


NESTED = b"{'descr': '<f4', 'fortran_order': False, 'shape': " + b"(" * 9000
WHOLE = io.BytesIO()
np.savez(WHOLE, **arrays())
WHOLE = WHOLE.getvalue()


# The content of a file, or arrays that replace those of a prediction; what the error names.
MILLION = {"points": np.zeros((1, 10**6, 3), "f4"), "seen": np.ones((1, 10**6), bool)}
WRONG = {
    "nested": (
        zipped({"points.npy": b"\x93NUMPY\x01\x00" + len(NESTED).to_bytes(2, "little") + NESTED}),
    ),
    "claims": (zipped({"points.npy": header(10**12)}), "points is float32 [1, 1000000000000, 3]"),
    "bomb": (zipped({"points.npy": bytes(140 << 20)}), "points"),
    "text": (b"nothing",),
    "cut": (WHOLE[:3000],),
    "flipped": (WHOLE[:300] + b"x" * 200 + WHOLE[500:],),
    "object": ({"points": np.array([{}, []], object)},),
    "shape": ({"colours": np.zeros((2, 49, 3), np.uint8)}, "colours", "[2, 49, 3]", "uint8 [k, n"),
    "huge": ({"image": np.zeros((2049, 1000, 3), np.uint8)}, "image", "h up to 2048"),
    "million": (MILLION, "k up to 64, n up to 262144"),
    "spread": ({"spread": np.zeros(50)}, "spread", "[50]", "float [k, n]"),
    "nan": ({"points": np.full((2, 50, 3), np.nan)}, "points"),
    "camera": ({"extrinsics": np.ones((3, 4))}, "extrinsics"),
    "version": ({"version": np.int32(2)}, "later version", 2, 1),
    "branch": ({"branch": np.full(50, 2, np.uint8)}, "branch"),
    "shear": ({"to_view": np.ones((3, 3))}, "to_view"),
}


def test_what_is_no_prediction_is_refused_in_one_line(tmp_path):
    table = [("pipe", "a named pipe"), ("folder", "a folder"), ("absent",), ("lacks", "array")]
    os.mkfifo(tmp_path / "pipe.npz")
    (tmp_path / "folder.npz").mkdir()
    np.savez(tmp_path / "lacks.npz", points=np.zeros((1, 5, 3)))
    for name, (given, *names) in WRONG.items():
        if isinstance(given, bytes):
            (tmp_path / f"{name}.npz").write_bytes(given)
        else:
            np.savez(tmp_path / f"{name}.npz", **arrays(**given))
        table.append((name, *names))
    for name, *names in table:
        with refused(PredictionFileError, f"{name}.npz", *names) as error:
            read_prediction(tmp_path / f"{name}.npz", FIELDS)
        assert "pickle" not in str(error.value)
