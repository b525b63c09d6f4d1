import dataclasses
import itertools
import multiprocessing
import os
import signal

import numpy as np
import pytest
from helpers import drawn_solids as solids

from psgn_jax.config.experiment import DataConfig
from psgn_jax.data import batches, camera, loader, visibility
from psgn_jax.data.codec import decode
from psgn_jax.data.dataset import RecordReader, write_dataset
from psgn_jax.data.schema import RecordError
from psgn_jax.system.errors import UserError


@pytest.fixture(scope="module")
def cfg(dataset):
    return DataConfig(
        path=str(dataset),
        image_size=(24, 32),
        inputs=("rgb", "mask", "depth"),
        num_points=100,
        num_eval_points=150,
        flip=True,
        stretch=0.1,
        colour_jitter=0.2,
    )


def take(count, cfg, **options):
    options = {"batch_size": 6, "seed": 7, "start_step": 0} | options
    batches = loader.train_batches(cfg, **options)
    try:
        return list(itertools.islice(batches, count))
    finally:
        batches.close()


def assert_same(a, b):
    assert a.keys() == b.keys()
    for key in a:
        np.testing.assert_array_equal(a[key], b[key], err_msg=key)


@pytest.fixture(scope="module")
def whole(cfg):
    """The first batches of a training."""
    return take(20, cfg)


def test_shapes_and_types(cfg, whole):
    assert {k: (v.dtype.name, v.shape) for k, v in whole[0].items()} == {
        "image": ("uint8", (6, 24, 32, 3)),
        "mask": ("bool", (6, 24, 32)),
        "depth": ("float32", (6, 24, 32)),
        "points": ("float32", (6, 100, 3)),
        "intrinsics": ("float32", (6, 3, 3)),
        "extrinsics": ("float32", (6, 3, 4)),
    }
    (batch,) = take(1, dataclasses.replace(cfg, inputs=("rgb", "mask")))
    assert "depth" not in batch


def test_batches_are_consistent(whole):
    for batch in whole[:3]:
        for row in range(6):
            pixels, _ = camera.project(
                *(batch[k][row] for k in ("points", "intrinsics", "extrinsics"))
            )
            assert camera.inside_mask(pixels, batch["mask"][row], 1).mean() > 0.97
            assert (batch["depth"][row] > 0).tolist() == batch["mask"][row].tolist()


def assert_all_same(got, want):
    for one, other in zip(got, want, strict=True):
        assert_same(one, other)


def test_resume_replays_nothing_and_changes_nothing(cfg, whole):
    for start in (1, 7, 19):
        assert_all_same(take(20 - start, cfg, start_step=start), whole[start:])
    # Even far into a run this is immediate, because nothing is replayed.
    take(1, cfg, start_step=10**7)


def _identity(batch):
    return [image.tobytes() for image in batch["image"]]


def test_each_epoch_holds_every_sample_once_in_a_new_order(cfg):
    plain = dataclasses.replace(cfg, flip=False, stretch=0.0, colour_jitter=0.0)
    rows = list(itertools.chain.from_iterable(map(_identity, take(19, plain))))  # 114 rows
    epochs = [rows[i : i + 37] for i in (0, 37, 74)]
    assert len(set(epochs[0])) == 37
    assert all(set(e) == set(epochs[0]) for e in epochs)
    assert epochs[0] != epochs[1] != epochs[2]


def test_processes_get_parts_of_the_same_batch(cfg, whole):
    for step in (0, 8):
        for count in (2, 3, 6):
            parts = [
                take(1, cfg, start_step=step, process_index=i, process_count=count)[0]
                for i in range(count)
            ]
            joined = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}
            assert_same(joined, whole[step])


@pytest.mark.parametrize("cache_gb", [0.0, 1e-4])
def test_keeping_samples_changes_nothing(cfg, whole, cache_gb):
    assert_all_same(take(15, dataclasses.replace(cfg, cache_gb=cache_gb)), whole[:15])


@pytest.mark.parametrize(("cache_gb", "kept"), [(0.0, 0), (1e-5, 0), (1e-4, 3), (0.01, 37)])
def test_a_training_keeps_samples_up_to_a_size(cfg, cache_gb, kept):
    cfg = dataclasses.replace(cfg, cache_gb=cache_gb)
    reader = RecordReader(cfg.path, "train")
    items = batches.Items(cfg, reader, repeatedly=True)
    first = [items[i] for i in range(37)]
    same = [item for i, item in enumerate(first) if items[i] is item]
    assert len(same) == kept
    assert sum(item.nbytes() for item in same) <= 1e9 * cache_gb
    once = batches.Items(cfg, reader)  # as in an evaluation
    assert once[0] is not once[0]


def test_worker_processes_equal_threads(cfg, whole):
    got = take(5, dataclasses.replace(cfg, num_workers=2), start_step=4)
    assert_all_same(got, whole[4:9])
    for batch in got:
        assert all(type(v) is np.ndarray for v in batch.values())  # no shared memory is handed out


def test_a_worker_without_shared_memory_is_an_error_that_says_so(cfg):
    batches = loader.train_batches(
        dataclasses.replace(cfg, num_workers=1), batch_size=4, seed=0, start_step=0
    )
    next(batches)
    for worker in multiprocessing.active_children():
        os.kill(worker.pid, signal.SIGBUS)  # what a write beyond the end of /dev/shm causes
    with pytest.raises(
        UserError, match=r"data\.num_workers=1: a worker process ended .* not enough shared memory"
    ):
        list(itertools.islice(batches, 20))


def test_evaluation_sees_every_sample_once(cfg, dataset):
    names = [s.model_id for s in RecordReader(dataset, "validation")]
    for batch_size in (1, 4, 11, 16):
        seen, categories = [], []
        for batch in loader.eval_batches(cfg, split="validation", batch_size=batch_size):
            assert batch["image"].shape == (batch_size, 24, 32, 3)
            assert batch["points"].shape == (batch_size, 150, 3)
            assert batch["valid"].shape == (batch_size,)
            assert np.isfinite(batch["points"]).all()
            seen += [n for n, v in zip(batch["model_id"], batch["valid"], strict=True) if v]
            categories += [n for n, v in zip(batch["category"], batch["valid"], strict=True) if v]
            assert all(isinstance(c, str) for c in batch["category"])
        assert seen == names
        assert categories == [n.split("-")[0] for n in names]
    options = {"split": "validation", "batch_size": 4}
    (last,) = loader.eval_batches(cfg, **options, choose=lambda number: [number - 1])
    assert last["model_id"][:3] == names[8:]
    assert not list(loader.eval_batches(cfg, **options, choose=lambda number: []))


def test_subsets(tmp_path, rng):
    """Fewer points than the record has are distinct; more are equally frequent."""
    points = np.stack([np.arange(10), np.zeros(10), np.zeros(10)], axis=1).astype(np.float32)
    (sample,) = solids.samples(1, seed=0, image_size=(24, 32))
    sample = dataclasses.replace(sample, points=points, normals=None, occupancy=None)
    write_dataset(tmp_path, {"train": [sample], "validation": [sample]}, source="test")
    for wanted, frequent in ((6, {0, 1}), (10, {1}), (34, {3, 4})):
        cfg = DataConfig(path=str(tmp_path), image_size=(24, 32), num_points=wanted)
        (batch,) = take(1, cfg, batch_size=1)
        counts = np.bincount(np.rint(batch["points"][0, :, 0]).astype(int), minlength=10)
        assert counts.sum() == wanted
        assert set(counts.tolist()) == frequent


def test_missing_data_fail_at_the_call(cfg, make, rng, tmp_path):
    with pytest.raises(ValueError, match="multiple of the 2 processes"):
        loader.train_batches(cfg, batch_size=7, seed=0, start_step=0, process_count=2)
    with pytest.raises(RecordError, match="no split 'test'"):
        loader.eval_batches(cfg, split="test", batch_size=2)
    with pytest.raises(RecordError, match="no such folder"):
        loader.num_samples(dataclasses.replace(cfg, path="/nowhere"), "train")
    write_dataset(tmp_path, {"train": [make.sample(rng, optional=False)]}, source="test")
    bare = dataclasses.replace(cfg, path=str(tmp_path))
    with pytest.raises(RecordError, match=r"remove 'depth' from data\.inputs"):
        loader.train_batches(bare, batch_size=1, seed=0, start_step=0)


@pytest.mark.parametrize("num_workers", [0, 1])
def test_a_damaged_record_is_named_while_iterating(make, cfg, dataset, tmp_path, num_workers):
    for path in dataset.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    shard = tmp_path / "validation-00000.arrayrecord"
    make.damage(shard, RecordReader(tmp_path, "validation").read(5))
    cfg = dataclasses.replace(cfg, path=str(tmp_path), num_workers=num_workers)
    batches = loader.eval_batches(cfg, split="validation", batch_size=4)
    next(batches)
    with pytest.raises(ValueError, match=r"record 5 of .*validation-00000\.arrayrecord is damaged"):
        list(batches)


def test_visibility_is_that_of_the_records_own_depth(cfg, dataset):
    plain = dataclasses.replace(cfg, inputs=("rgb", "mask"))
    batches = list(
        loader.eval_batches(plain, split="validation", batch_size=4, visible_tolerance=0.03)
    )
    assert [b["visible"].shape for b in batches] == [(4, 150)] * 3
    assert all("depth" not in b for b in batches)
    reader = RecordReader(dataset, "validation")
    for number in (0, 10):
        batch, row = batches[number // 4], number % 4
        s = decode(reader.read(number))
        want = visibility.visible_points(
            batch["points"][row], s.depth, s.intrinsics, s.extrinsics, 0.03
        )
        np.testing.assert_array_equal(batch["visible"][row], want)
        assert 0 < want.mean() < 1
    np.testing.assert_array_equal(batches[2]["visible"][2], batches[2]["visible"][3])  # padding
    small = dataclasses.replace(plain, image_size=(12, 16))
    again = list(
        loader.eval_batches(small, split="validation", batch_size=11, visible_tolerance=0.03)
    )
    np.testing.assert_array_equal(again[0]["visible"][:4], batches[0]["visible"])
    (unasked,) = loader.eval_batches(plain, split="validation", batch_size=11)
    assert "visible" not in unasked


def test_several_folders_are_joined_and_count_several_times_in_training(
    cfg, dataset, tmp_path, make, rng
):
    """The second folder has no validation split; its records follow those of the first folder."""
    extra = [make.sample(rng, num_points=120, model_id=f"extra{i}") for i in range(3)]
    write_dataset(tmp_path / "more", {"train": extra}, source="test")
    joined = dataclasses.replace(cfg, path=f"{dataset}, {tmp_path / 'more'}")
    assert loader.num_samples(joined, "train") == 40
    assert loader.num_samples(joined, "validation") == 11
    reader = RecordReader(joined.folders, "train")
    assert [reader[i].model_id for i in (37, 38, 39)] == ["extra0", "extra1", "extra2"]
    assert reader[36].model_id == RecordReader(dataset, "train")[36].model_id
    assert reader.locate(38) == (tmp_path / "more" / "train-00000.arrayrecord", 1)
    assert [batch["points"].shape for batch in take(8, joined)] == [(6, 100, 3)] * 8
    with pytest.raises(RecordError, match="no split 'test'"):
        loader.num_samples(joined, "test")
    other = tmp_path / "other"
    write_dataset(other, {"train": extra, "validation": extra[:2]}, source="test")
    weighted = dataclasses.replace(cfg, path=f"{dataset},{other}*5")
    assert weighted.folders == (str(dataset), *[str(other)] * 5)
    assert loader.num_samples(weighted, "train") == 37 + 15
    assert loader.num_samples(weighted, "validation", evaluation=True) == 11 + 2
