import dataclasses
import json
import os
import pickle
import random
import resource
import zlib

import msgpack
import numpy as np
import pytest
from helpers.refusals import all_refused, refused

from psgn_jax.data import codec, schema
from psgn_jax.data.codec import decode, decode_stored, encode
from psgn_jax.data.dataset import RecordReader, ShardWriter, shard_name, write_dataset
from psgn_jax.data.manifest import MANIFEST, load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.system.locks import TakenError, lock_part


def test_round_trip_of_every_field(sample):
    extra = '{"seed": 3, "name": "café"}'
    sample = dataclasses.replace(sample, extra=extra, view=np.int64(3))
    back = decode(encode(sample))
    schema.validate(back)
    for field in ("image", "mask", "occupancy", "intrinsics", "extrinsics"):
        np.testing.assert_array_equal(getattr(back, field), getattr(sample, field))
    for field in ("category", "model_id", "view", "source", "extra"):
        assert getattr(back, field) == getattr(sample, field)
    span = sample.depth[sample.mask].max() - sample.depth[sample.mask].min()
    np.testing.assert_allclose(back.depth, sample.depth, atol=span / 131070 + 1e-6)
    assert (back.depth > 0).tolist() == sample.mask.tolist()
    with refused(ValueError, "model 'm1', view 3", "'extra'", "JSON object"):
        encode(dataclasses.replace(sample, extra="[1]"))
    names = ("depth", "points", "intrinsics", "extrinsics")
    swapped = {name: getattr(sample, name).astype(">f4") for name in names}
    assert encode(dataclasses.replace(sample, **swapped)) == encode(sample)


def test_each_wrong_field_is_named(sample):
    def check(change):
        schema.validate(dataclasses.replace(sample, **change))

    all_refused(check, ValueError, [
        ({field: value}, f"'{field}'", "got", "expected")
        for field, value in (
            ("image", np.zeros((24, 32, 3), np.float32)),
            ("image", np.zeros((4097, 1, 3), np.uint8)),
            ("mask", np.zeros((24, 31), np.bool_)),
            ("depth", np.full((24, 32), -1, np.float32)),
            ("depth", np.full((24, 32), np.nan, np.float32)),
            ("depth", np.full((24, 32), 2e9, np.float32)),
            ("points", np.full((200, 3), -2e9, np.float32)),
            ("points", np.zeros((0, 3), np.float32)),
            ("points", np.full((200, 3), np.inf, np.float32)),
            ("points", np.zeros((200, 3), ">f8")),
            ("points", np.ma.masked_less(np.ones((200, 3), np.float32), 2)),
            ("occupancy", np.zeros((16, 16, 16), np.bool_)),
            ("intrinsics", np.diag([-1, 1, 1]).astype(np.float32)),
            ("extrinsics", np.eye(3, 4, dtype=np.float32) * np.float32([[-1], [1], [1]])),
            ("category", None),
            ("model_id", "caf\udce9"),
            ("view", 1.5),
        )
    ])  # fmt: skip


def test_point_error_is_half_a_step(sample):
    for bits in (8, 9, 16):
        points = codec.quantised(sample.points, bits)
        step = np.ptp(sample.points, axis=0) / (2**bits - 1)
        assert (np.abs(points.points() - sample.points) <= step / 2 * (1 + 1e-4) + 1e-6).all()
        stored = decode_stored(encode(sample, point_bits=bits)).points.codes
        rows = (codes[np.lexsort(codes.T)] for codes in (stored, points.codes))
        np.testing.assert_array_equal(*rows)


def test_data_set_round_trip(dataset):
    train = RecordReader(dataset, "train")
    assert len(train) == 37
    assert [s.count for s in train.shards] == [10, 10, 10, 7]
    assert [train[i].model_id for i in (9, 10)] == ["prism-0-00009", "box-0-00010"]
    assert train.locate(29) == (dataset / "train-00002.arrayrecord", 9)
    train.verify()
    with pytest.raises(IndexError):
        train.read(37)
    copy = pickle.loads(pickle.dumps(train))
    assert copy.read(20) == train.read(20)
    manifest = load_manifest(dataset)
    assert "depth" in manifest.fields()
    assert "occupancy" not in manifest.fields()


def edit(folder, change):
    """Changes the content of a manifest, which then has no checksum."""
    content = json.loads((folder / MANIFEST).read_text())
    del content["crc32"]
    change(content)
    (folder / MANIFEST).write_text(json.dumps(content))


def test_wrong_manifests(copied):
    text = (copied / MANIFEST).read_text()

    def read(change):
        if callable(change):
            (copied / MANIFEST).write_text(text)
            edit(copied, change)
        else:
            (copied / MANIFEST).write_bytes(change.encode("latin1"))
        RecordReader(copied, "train")

    name = "train-00000.arrayrecord"
    all_refused(read, RecordError, [
        (text.replace('"train"', '"validation"', 1), MANIFEST, "checksum"),
        *((wrong, MANIFEST) for wrong in ("[" * 200_000, '{"format": ', "[]", "\xff")),
        (lambda c: c.update(version=99), MANIFEST, "99", "version 1"),
        (lambda c: c.update(format="other"), MANIFEST, "'other'"),
        (lambda c: c.update(complete=False), copied, "incomplete"),
        (lambda c: c.update(complete=1), MANIFEST, "complete"),
        (lambda c: c.update(shards=[5]), MANIFEST, "shards[0]"),
        (lambda c: c.update(shards=[{"file": "a"}]), MANIFEST, "'split'"),
        (lambda c: c["shards"].append(c["shards"][0]), MANIFEST, name, "twice"),
        (lambda c: c["shards"][0].update(count=10**30), MANIFEST, "count"),
        (lambda c: c["shards"][0].update(count=0), MANIFEST, "count"),
        (lambda c: c["shards"][0].update(split="train\nfake"), MANIFEST, "split"),
        (lambda c: c["shards"][0].update(categories={"x" * 10**6: 1}), MANIFEST, "category"),
        (lambda c: c["shards"][0].update(file=f"../{name}"), MANIFEST, "file"),
    ])  # fmt: skip


def test_missing_data_and_shards_are_refused_by_name(dataset, tmp_path, copied, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").mkdir()
    all_refused(lambda where: RecordReader(*where), RecordError, [
        ((tmp_path / "missing", "train"), tmp_path / "missing"),
        (("missing", "train"), "'missing'", tmp_path, "--data", "data.path"),
        ((tmp_path / "meshes", "train"), MANIFEST, "psgn render", "psgn convert"),
        ((dataset, "test"), "'test'", "'train', 'validation'", "data.eval_split", "fractions="),
    ])  # fmt: skip
    shard = copied / "train-00001.arrayrecord"
    size = shard.stat().st_size
    shard.write_bytes(shard.read_bytes()[:-1])
    with refused(RecordError, shard, size, size - 1):
        RecordReader(copied, "train")
    shard.unlink()
    with refused(RecordError, shard, "missing"):
        RecordReader(copied, "train")
    for name in (shard.name, MANIFEST):
        (copied / name).unlink(missing_ok=True)
        os.mkfifo(copied / name)
        with refused(RecordError, name, "named pipe"):
            RecordReader(copied, "train")


def test_another_shard_of_the_same_size_is_refused(make, copied, tmp_path, rng):
    samples = [make.sample(rng, model_id=f"m{i}") for i in range(8)]
    for name, last in (("one", 3), ("two", 4)):  # both begin with the same record
        splits = {"train": [*samples[:3], samples[last]], "test": samples[5:]}
        write_dataset(tmp_path / name, splits, source="test", records_per_shard=4)
    own, other = (tmp_path / name / "train-00000.arrayrecord" for name in ("one", "two"))
    for source, target in (
        (other, own),  # another set
        (tmp_path / "one" / "test-00000.arrayrecord", own),
        (copied / "train-00001.arrayrecord", copied / "train-00002.arrayrecord"),
        (tmp_path / "two" / MANIFEST, tmp_path / "one" / MANIFEST),
    ):
        before = target.read_bytes()
        assert target.name == MANIFEST or source.stat().st_size == len(before)
        target.write_bytes(source.read_bytes())
        with refused(RecordError, "train-0000"):
            RecordReader(target.parent, "train")
        target.write_bytes(before)
        RecordReader(target.parent, "train")
    edit(copied, lambda c: [shard.pop("ends") for shard in c["shards"]])  # an older set
    assert RecordReader(copied, "train")[36].model_id == "cone-0-00036"


def test_too_many_open_files_are_no_damage(dataset):
    reader, limit = RecordReader(dataset, "train"), resource.RLIMIT_NOFILE
    soft, hard = resource.getrlimit(limit)
    resource.setrlimit(limit, (3, hard))
    try:
        with refused(RecordError, "ulimit -n"):
            reader[0]
    finally:
        resource.setrlimit(limit, (soft, hard))
    assert reader[0].view == 0


def test_no_damage_goes_unseen_or_ends_the_process(copied):
    shard = copied / "train-00003.arrayrecord"
    data = shard.read_bytes()
    want = [RecordReader(copied, "train").read(i) for i in range(30, 37)]
    choose = random.Random(0)
    for trial in range(60):
        bad = bytearray(data)
        at = choose.randrange(len(bad))
        if trial % 3 == 0:  # zeros at the end; the size stays valid
            bad[at:] = bytes(len(bad) - at)
        elif trial % 3 == 1:
            bad[at] ^= 1 << choose.randrange(8)
        else:
            bad[at : at + 4096] = choose.randbytes(len(bad[at : at + 4096]))
        shard.write_bytes(bad)
        for i, record in enumerate(want, 30):
            try:
                reader = RecordReader(copied, "train")
                reader.stored(i)
                good = reader.read(i) == record
            except RecordError as error:
                good = shard.name in str(error)
            assert good, (trial, i)


def test_failed_writing_leaves_nothing_and_a_data_set_is_not_overwritten(tmp_path, sample, copied):
    def fail():
        with ShardWriter(tmp_path, "train", 0) as writer:
            writer.write(encode(sample))
            raise RuntimeError("stop")

    with refused(RuntimeError, "stop"):
        fail()
    with refused(ValueError, "split", "'../train'"):
        shard_name("../train", 0)
    with refused(RecordError, copied):
        write_dataset(copied, {"train": [sample]}, source="test")
    assert len(RecordReader(copied, "train")) == 37
    good = {"splits": {"train": [sample]}, "source": "test", "records_per_shard": 2}
    all_refused(lambda wrong: write_dataset(tmp_path / "none", **good | wrong), ValueError, [
        ({"splits": {"train": [sample], "Test": [sample]}}, "'Test'"),
        ({"splits": {"train": [sample], "validation": []}}, "'validation'"),
        ({"splits": {}}, "splits"),
        ({"source": copied}, "source"),
        ({"records_per_shard": 0}, "records_per_shard 0"),
    ])  # fmt: skip
    assert list(tmp_path.iterdir()) == [copied]
    folder = tmp_path / "set"
    late = [*[sample] * 3, dataclasses.replace(sample, view=-1)]
    for wrong, name in ((late, "'view'"), ([], "'validation'")):
        splits = {"train": iter([sample] * 5), "validation": iter(wrong)}
        with refused(ValueError, name):
            write_dataset(folder, **good | {"splits": splits})
        assert not list(folder.iterdir())
    (folder / "train-00007.arrayrecord").write_bytes(b"of a call that was killed")
    with refused(RecordError, "train-00007.arrayrecord"):
        write_dataset(folder, **good)
    (folder / "train-00007.arrayrecord").unlink()
    with lock_part(folder / ".work", (0, 1)), refused(TakenError, folder):
        write_dataset(folder, **good)
    write_dataset(folder, **good)
    assert {path.name for path in folder.iterdir()} == {"train-00000.arrayrecord", MANIFEST}


def crafted(content, **changes):
    body = msgpack.packb(content | changes)
    return zlib.crc32(body).to_bytes(4, "little") + body


def test_records_with_a_wrong_field_are_refused_wherever_they_are_decoded(sample):
    content = msgpack.unpackb(encode(sample)[4:])
    for read in (decode, decode_stored, lambda data: decode_stored(data, ("points",))):
        all_refused(lambda wrong, read=read: read(crafted(content, **wrong)), ValueError, [
            ({name: value}, name)
            for name, value in (
                ("category", 5), ("category", None), ("model_id", {"a": 1}), ("source", [1]),
                ("category", "x" * 1_000_000), ("model_id", "x" * 1001), ("source", "x" * 1001),
                ("extra", 3), ("view", "3"), ("view", True), ("view", 1 << 40),
                ("intrinsics", np.full(9, np.nan, "<f4").tobytes()),
                ("extrinsics", np.ones(12, "<f4").tobytes()),
            )
        ])  # fmt: skip


def webp(width, height):
    """The header of a lossless WebP of this size."""
    bits = (width - 1) | (height - 1) << 14
    chunk = b"\x2f" + bits.to_bytes(4, "little") + bytes(3)
    body = b"WEBPVP8L" + len(chunk).to_bytes(4, "little") + chunk
    return b"RIFF" + len(body).to_bytes(4, "little") + body


def test_fields_out_of_range_are_refused_before_they_take_memory(sample):
    content = msgpack.unpackb(encode(sample)[4:])
    points, depth, image = (content[name] for name in ("points", "depth", "image"))
    # Points of the second matrix are too far, though it is within the limit.
    huge, far, near = (size * np.eye(3, 4, dtype="<f8") for size in (1e306, 1e8, 1e9 / 65535))
    nan = np.full((3, 4), np.nan)
    bomb = zlib.compress(bytes(50_000_000))
    all_refused(lambda changes: decode(crafted(content, **changes)), ValueError, [
        ({"mask": bomb}, "'mask'"),
        ({"points": points | {"steps": bomb}}, "'points'"),
        ({"points": points | {"count": 1 << 40}}, "number of points"),
        *(({"points": points | {"matrix": m.tobytes()}}, "points") for m in (huge, -far, nan)),
        ({"points": points | {"bits": "a\nb"}}, r"points of 'a\nb' bits"),
        ({"points": 5}, "field"),
        ({"depth": depth | {"offset": -100.0}}, "depth"),
        ({"depth": depth | {"scale": float("nan")}}, "depth"),
        ({"image": image | {"size": [1 << 30, 1 << 30]}}, "height of the image"),
        ({"image": image | {"size": [32, 24]}}, "image"),
        ({"image": image | {"webp": b"no image"}}, "image"),
        ({"image": image | {"webp": webp(10_000, 10_000)}}, "image"),
        ({"image": image | {"webp": webp(16_383, 16_383)}}, "image"),
    ])  # fmt: skip
    # The normals of older records are skipped.
    changes = {"points": points | {"matrix": near.tobytes()}, "normals": {"bits": 8, "codes": b"x"}}
    largest = decode(crafted(content, **changes))
    assert np.abs(largest.points).max() <= schema.MAX_COORDINATE
