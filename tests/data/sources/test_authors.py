import re
import resource
import zlib

import numpy as np
from helpers.processes import without_room
from helpers.refusals import all_refused, check_message

from psgn_jax.commands import convert
from psgn_jax.data import camera, schema
from psgn_jax.data.codec import _point_keys, decode_stored, unpack
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.doubts import Doubts, fit
from psgn_jax.data.sources import authors, duplicates
from psgn_jax.system.locks import lock_part


def test_own_batch_file(authors_file, make):
    content = make.content()
    entries = list(authors.read_batch(authors_file))
    assert len(entries) == 32
    entry = entries[3]
    schema.validate(entry.sample)
    assert entry.sample.image[entry.sample.mask][0].tolist() == [200, 20, 10]  # RGB
    assert (entry.sample.image[~entry.sample.mask] == schema.BACKGROUND_GREY).all()
    assert entry.sample.model_id == content["names"].decode().split("\n")[3]
    points, *cameras = (getattr(entry.sample, n) for n in ("points", "intrinsics", "extrinsics"))
    pixels, _ = camera.project(points, *cameras)
    assert camera.inside_mask(pixels, entry.sample.mask).all()  # each point was drawn as a pixel
    assert abs(points[:, 2].min()) < 0.006  # stands on the ground, up to the 8-bit lattice
    doubts = Doubts()
    doubts.add("train", unpack(entry.encode()), entry.sample)
    assert not list(doubts.lines())
    # Nothing is lost in a record.
    stored = decode_stored(entry.encode())
    keys = [np.sort(_point_keys(x)) for x in (stored.points.codes, content["points"][3])]
    np.testing.assert_array_equal(*keys)
    np.testing.assert_array_equal(stored.depth.codes, content["depth"][3])
    np.testing.assert_array_equal(stored.image, entry.sample.image)


def test_hostile_files_are_refused_in_bounded_memory(make, tmp_path):
    good = make.content_bytes(make.content())
    packed = zlib.compress(good, 1)
    turned = make.content() | {"rotation": np.ones((32, 3, 3), np.float32)}
    files = (
        (packed[: len(packed) // 2], "truncated"),
        (b"hello world" * 100, "zlib"),
        (packed + b"x", "after the end"),
        (zlib.compress(good[:-20000], 1), "inflates"),
        (zlib.compress(bytes(400_000_000), 1), "inflates"),
        (zlib.compress(good[:-200], 1), "names"),
        (zlib.compress(good[:-2] + b"\xff\xff", 1), "ASCII"),
        (zlib.compress(make.content_bytes(turned), 1), "rotation"),
    )
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    path = tmp_path / "0.gz"

    def read(data):
        path.write_bytes(data)
        next(authors.read_batch(path))

    all_refused(read, ValueError, [(data, path, what) for data, what in files])
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
    assert grown < 100_000  # kB; the bomb inflates to 400 MB


def test_conversion(make, tmp_path, capsys):
    """A damaged file, bad samples, and a training sample with the shape of a held-out object.

    The held-out objects are one torus; the sample's is turned otherwise and sampled anew.
    """
    source, target = tmp_path / "src", tmp_path / "dst"
    source.mkdir()
    training, held, known = make.content(0), make.content(1, True), make.content(2, True)
    for field in ("rotation", "points", "depth", "colour"):
        training[field][4] = known[field][4]
    held["depth"][3] = 0
    held["points"][5] = 7
    (source / "3.gz").write_bytes(zlib.compress(make.content_bytes(training), 1))
    (source / "11.gz").write_bytes(zlib.compress(make.content_bytes(held), 1))
    (source / "10.gz").write_bytes(b"damaged")
    assert convert.main(["authors", str(source), str(target)]) == 1
    streams = capsys.readouterr()
    for line in ("duplicate: 1 samples", "validation: 30 samples", "train: 31 samples"):
        assert line in streams.out
    for name in ("10.gz", "00000003, view 0", "00000005, view 0", "3 files"):
        assert name in streams.err
    (left_out,) = RecordReader(target, "duplicate")
    assert left_out.model_id.endswith("0004")
    kept = [int(s.model_id[-2:], 16) for s in RecordReader(target, "validation")]
    assert kept == [i for i in range(32) if i not in (3, 5)]
    assert authors.split_of(target / "48.gz", "a1") == "test"


def test_a_mirrored_and_turned_shape_is_the_same_and_another_is_not(rng):
    def sampled(stretch=1.0):
        """Points on an asymmetrical object: four blocks."""
        low = np.array([[0, 0, 0], [0, 0, 0.5], [0.3, 0.6, 0], [0.9, 0, 0.2]])
        high = np.array([[0.9, 0.2, 0.5], [0.3, 0.2, 1.2], [0.5, 0.9, 0.3], [1.0, 0.1, 0.9]])
        box, face = rng.integers(4, size=16384), rng.integers(6, size=16384)
        points = low[box] + rng.random((16384, 3)) * (high - low)[box]
        rows = np.arange(16384)
        points[rows, face % 3] = np.where(face < 3, low[box, face % 3], high[box, face % 3])
        return points * [1, stretch, 1]

    turn = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
    held = duplicates.HeldOut([sampled()])
    assert held.has(sampled() * [1, -1, 1] @ turn * 1.3 + [0.2, 0.1, 0])
    assert not held.has(sampled(stretch=1.25))


def test_another_conversion_or_a_full_disk_ends_one_that_goes_on(authors_file, tmp_path, capsys):
    target = tmp_path / "target"
    command = ["authors", str(authors_file.parent), str(target)]
    with lock_part(target / ".work", (0, 1)):
        assert convert.main(command) == 2
    assert "another process (pid " in capsys.readouterr().err
    with without_room(20_000):
        assert convert.main(command) == 5
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"error: {target}")
    assert not list(target.glob("*.arrayrecord"))
    assert convert.main(command) == 0
    names = sorted(re.sub("-[0-9a-f]{8}", "", p.name) for p in target.iterdir())
    assert names == ["job.json", "manifest.json", "models.jsonl", "train-00000.arrayrecord"]
    before = {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in target.glob("*.array*")}
    assert convert.main(command) == 0  # nothing left to do
    after = {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in target.glob("*.array*")}
    assert after == before
    (tmp_path / "less").mkdir()
    (tmp_path / "less" / "1.gz").write_bytes(authors_file.read_bytes())
    assert convert.main([command[0], str(tmp_path / "less"), str(target)]) == 2
    check_message(capsys.readouterr().err.splitlines()[-1], target, authors_file.name, "another")
    assert {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in target.glob("*.a*")} == before


def test_conversion_refuses_wrong_folders(dataset, tmp_path, authors_file, capsys):
    (tmp_path / "other.txt").write_text("mine")
    good, new = authors_file.parent, tmp_path / "dst"
    for source, target, *names in (
        (tmp_path / "none", new, tmp_path / "none"),
        (tmp_path, new, tmp_path, "*.gz"),
        (good, dataset, dataset, "'solids'"),
        (good, tmp_path, tmp_path, "not empty"),
    ):
        assert convert.main(["authors", str(source), str(target)]) == 2
        check_message(capsys.readouterr().err, *names)


def test_real_batches(authors_batches):
    """All 1,504 samples: 94.7 % of the points inside the mask; the fit is above .99 in 98 %."""
    found, sizes, doubts = [], [], Doubts()
    for name, split in (("15.gz", "validation"), ("3.gz", "train")):
        for number, entry in enumerate(authors.read_batch(authors_batches / name)):
            assert authors.split_of(authors_batches / name, entry.sample.model_id) == split
            if number % 4 == 0:
                sample = entry.sample
                pixels, _ = camera.project(sample.points, sample.intrinsics, sample.extrinsics)
                inside = camera.inside_mask(pixels, sample.mask).mean()
                found.append((inside, fit(sample), np.linalg.norm(sample.points, axis=1).max()))
                sizes.append(len(record := entry.encode()))
                doubts.add(name, unpack(record), sample)
            schema.check_content(entry.sample)
            colour = (entry.sample.image != schema.BACKGROUND_GREY).any(axis=2)
            assert (colour != entry.sample.mask).mean() < 1e-2  # some objects have grey pixels
    assert not list(doubts.lines())
    inside, fits, reach = np.array(found).T
    assert inside.mean() > 0.93
    assert (fits > 0.99).mean() > 0.95
    assert reach.max() < 1.02
    # Of all 1,504 samples, the mean is 22 kB; a few with finely textured images exceed 60 kB.
    assert np.mean(sizes) < 30_000
    assert np.percentile(sizes, 90) < 60_000
