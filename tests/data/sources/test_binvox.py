import numpy as np
from helpers.refusals import all_refused
from helpers.shapenet_trees import write_binvox

from psgn_jax.data.sources import binvox


def test_axis_order_and_numbers(tmp_path, rng):
    solid = rng.random((9, 9, 9)) < 0.3
    path = tmp_path / "a.binvox"
    header = b"#binvox 1\ndim 9 9 9\ntranslate -0.25 1e-3 7\nscale 0.75\ndata\n"
    # As the format's page says: index = x * D^2 + z * D + y. These are runs of one cell.
    cells = solid.transpose(0, 2, 1).flatten()
    path.write_bytes(header + np.stack([cells, np.ones(9**3)], 1).astype(np.uint8).tobytes())
    got = binvox.read(path, 9)
    np.testing.assert_array_equal(got.cells, solid)
    np.testing.assert_array_equal(got.low, [-0.25, 1e-3, 7])
    assert got.size == 0.75


def test_damaged_files_name_themselves(tmp_path, rng):
    path = tmp_path / "a.binvox"
    write_binvox(path, binvox.Grid(rng.random((8, 8, 8)) < 0.5, np.zeros(3), 1.0))
    good = path.read_bytes()
    start = good.index(b"data\n") + 5

    def read(data):
        path.write_bytes(data)
        binvox.read(path, 8)

    all_refused(read, ValueError, [
        (b"ply\n", path, "#binvox"),
        (good[:-6], path, "cut off", 512),
        (good[: start - 5], path, "header"),
        (good + b"\x00\x09", path, "too long"),
        (good[:start] + b"\x07" + good[start + 1 :], path, 7),
        (good.replace(b"dim 8 8 8", b"dim 99999 99999 99999"), path, "8 cells"),
        (good.replace(b"scale 1", b"scale nan"), path, "scale nan"),
        (good.replace(b"scale 1", b"scale 0"), path, "scale 0"),
        (good.replace(b"dim 8 8 8\n", b""), path, "`dim`"),
        (b"#binvox 1\n" + b"dim 8 8 8\n" * 99, path, "`data`"),
    ])  # fmt: skip
