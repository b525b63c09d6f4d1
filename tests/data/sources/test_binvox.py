import numpy as np
import pytest

from psgn_jax.data.sources import binvox


def naive_bytes(solid, translate="0 0 0", scale="1"):
    """Cell by cell as the format's page says: index = x * D^2 + z * D + y."""
    dim = len(solid)
    flat = [bool(solid[i // dim**2, i % dim, i // dim % dim]) for i in range(dim**3)]
    out = bytearray()
    for value in flat:
        if out and out[-2] == value and out[-1] < 255:
            out[-1] += 1
        else:
            out += bytes([value, 1])
    header = f"#binvox 1\ndim {dim} {dim} {dim}\ntranslate {translate}\nscale {scale}\ndata\n"
    return header.encode() + bytes(out)


def test_axis_order_and_numbers(tmp_path, rng):
    solid = rng.random((9, 9, 9)) < 0.3
    path = tmp_path / "a.binvox"
    path.write_bytes(naive_bytes(solid, "-0.25 1e-3 7", "0.75"))
    got = binvox.read(path, 9)
    np.testing.assert_array_equal(got.solid, solid)
    np.testing.assert_array_equal(got.translate, [-0.25, 1e-3, 7])
    assert got.scale == 0.75


def test_damaged_files_name_themselves(tmp_path, rng):
    good = naive_bytes(rng.random((8, 8, 8)) < 0.5)
    start = good.index(b"data\n") + 5
    path = tmp_path / "a.binvox"
    for data, message in (
        (b"ply\n", "does not begin with #binvox"),
        (good[:-6], "cut off, .* of 512 cells"),
        (good[: start - 5], "not a line of a binvox header"),
        (good + b"\x00\x09", "too long"),
        (good[:start] + b"\x07" + good[start + 1 :], "a value of 7"),
        (good.replace(b"dim 8 8 8", b"dim 8 8 4"), "expected 8 cells per edge"),
        (good.replace(b"dim 8 8 8", b"dim 99999 99999 99999"), "expected 8 cells"),
        (good.replace(b"dim 8 8 8", b"dim a b c"), "expected finite numbers"),
        (good.replace(b"scale 1", b"scale nan"), "expected finite numbers"),
        (good.replace(b"scale 1", b"scale 0"), "scale 0.0, expected more than 0"),
        (good.replace(b"dim 8 8 8\n", b""), "no line `dim`"),
        (b"#binvox 1\n" + b"dim 8 8 8\n" * 99, "no line `data`"),
    ):
        path.write_bytes(data)
        with pytest.raises(ValueError, match=f"{path}.*{message}"):
            binvox.read(path, 8)
