import dataclasses
import itertools
import multiprocessing
import os
import signal

import numpy as np
import pytest
from helpers import drawn_solids as solids
from helpers.refusals import refused

from psgn_jax.config.data import DataConfig
from psgn_jax.data import batches, camera, loader, visibility
from psgn_jax.data.codec import decode
from psgn_jax.data.dataset import RecordReader, write_dataset
from psgn_jax.data.schema import RecordError
from psgn_jax.system.errors import UserError


@pytest.fixture(scope="module")
def cfg(dataset):
    return DataConfig(
        path=str(dataset), image_size=(24, 32), inputs=("rgb", "mask", "depth"), num_points=100,
        num_eval_points=150, flip=True, stretch=0.1, colour_jitter=0.2,
    )  # fmt: skip


def take(count, cfg, **options):
    options = {"batch_size": 6, "seed": 7, "start_step": 0} | options
    batches = loader.train_batches(cfg, **options)
    try:
        return list(itertools.islice(batches, count))
    finally:
        batches.close()


@pytest.fixture(scope="module")
def whole(cfg):
    """The first batches of a training."""
    return take(12, cfg)


def test_batches_are_as_described_and_consistent(cfg, whole):
    assert {k: (v.dtype.name, v.shape) for k, v in whole[0].items()} == {
        "image": ("uint8", (6, 24, 32, 3)),
        "mask": ("bool", (6, 24, 32)),
        "depth": ("float32", (6, 24, 32)),
        "points": ("float32", (6, 100, 3)),
        "intrinsics": ("float32", (6, 3, 3)),
        "extrinsics": ("float32", (6, 3, 4)),
    }
    for row in range(6):
        points, *cameras = (whole[0][k][row] for k in ("points", "intrinsics", "extrinsics"))
        pixels, _ = camera.project(points, *cameras)
        assert camera.inside_mask(pixels, whole[0]["mask"][row], 1).mean() > 0.97
        assert (whole[0]["depth"][row] > 0).tolist() == whole[0]["mask"][row].tolist()


def test_resuming_and_several_processes_change_nothing(cfg, whole):
    np.testing.assert_equal(take(5, cfg, start_step=7), whole[7:])
    # Even far into a run this is immediate, because nothing is replayed.
    take(1, cfg, start_step=10**7)
    parts = [take(1, cfg, start_step=8, process_index=i, process_count=3)[0] for i in range(3)]
    np.testing.assert_equal({k: np.concatenate([p[k] for p in parts]) for k in parts[0]}, whole[8])


def test_each_epoch_holds_every_sample_once_in_a_new_order(cfg):
    plain = dataclasses.replace(cfg, flip=False, stretch=0.0, colour_jitter=0.0)
    rows = [image.tobytes() for batch in take(13, plain) for image in batch["image"]]  # 78 rows
    epochs = rows[:37], rows[37:74]
    assert len(set(epochs[0])) == 37
    assert set(epochs[0]) == set(epochs[1])
    assert epochs[0] != epochs[1]


@pytest.mark.parametrize(("cache_gb", "kept"), [(0.0, 0), (1e-4, 3), (0.01, 37)])
def test_a_training_keeps_samples_up_to_a_size_and_they_change_nothing(cfg, whole, cache_gb, kept):
    cfg = dataclasses.replace(cfg, cache_gb=cache_gb)
    items = batches.Items(cfg, RecordReader(cfg.path, "train"), repeatedly=True)
    first = [items[i] for i in range(37)]
    same = [item for i, item in enumerate(first) if items[i] is item]
    assert len(same) == kept
    assert sum(item.nbytes() for item in same) <= 1e9 * cache_gb
    np.testing.assert_equal(take(12, cfg), whole)


def test_worker_processes_equal_threads_and_their_end_is_an_error_that_says_why(cfg, whole):
    cfg = dataclasses.replace(cfg, num_workers=2)
    batches = loader.train_batches(cfg, batch_size=6, seed=7, start_step=4)
    got = list(itertools.islice(batches, 5))
    np.testing.assert_equal(got, whole[4:9])
    for batch in got:
        assert all(type(v) is np.ndarray for v in batch.values())  # no shared memory is handed out
    for worker in multiprocessing.active_children():
        os.kill(worker.pid, signal.SIGBUS)  # what a write beyond the end of /dev/shm causes
    with refused(UserError, "data.num_workers=2", "shared memory"):
        list(itertools.islice(batches, 20))


def test_evaluation_sees_every_sample_once(cfg, dataset):
    names = [s.model_id for s in RecordReader(dataset, "validation")]
    for batch_size in (4, 16):
        seen, categories = [], []
        for batch in loader.eval_batches(cfg, split="validation", batch_size=batch_size):
            assert batch["image"].shape == (batch_size, 24, 32, 3)
            assert batch["points"].shape == (batch_size, 150, 3)
            valid = np.flatnonzero(batch["valid"])
            seen += [batch["model_id"][i] for i in valid]
            categories += [batch["category"][i] for i in valid]
        assert seen == names
        assert categories == [n.split("-")[0] for n in names]
    options = {"split": "validation", "batch_size": 4}
    (last,) = loader.eval_batches(cfg, **options, choose=lambda number: [number - 1])
    assert last["model_id"][:3] == names[8:]


@pytest.mark.parametrize(("rows", "columns"), [(32, 0), (0, 60)])
def test_images_that_are_not_4_to_3_are_padded_and_the_camera_follows(rows, columns, tmp_path):
    """The object is not squeezed, as in a prediction."""
    (sample,) = solids.samples(1, seed=1, image_size=(96, 128))
    around, more = ((rows // 2,) * 2, (columns // 2,) * 2), {"intrinsics": sample.intrinsics.copy()}
    more["intrinsics"][:2, 2] += [columns // 2, rows // 2]
    for name in ("image", "mask", "depth"):
        plane = getattr(sample, name)
        more[name] = np.pad(plane, (*around, (0, 0))[: plane.ndim], mode="edge")
    write_dataset(tmp_path, {"train": [dataclasses.replace(sample, **more)]}, source="test")
    fields = {"image_size": (72, 96), "inputs": ("rgb", "depth"), "num_points": 900}
    (batch,) = take(1, DataConfig(path=str(tmp_path), **fields), batch_size=1)
    image, mask, k = (batch[name][0] for name in ("image", "mask", "intrinsics"))
    assert k[0, 0] == pytest.approx(k[1, 1], rel=0.01)
    pixels, _ = camera.project(batch["points"][0], k, batch["extrinsics"][0])
    assert camera.inside_mask(pixels, mask, 1).mean() > 0.99
    assert ((batch["depth"][0] > 0) == mask).all()
    assert (image[[0, -1]] == 191).all() or (image[:, [0, -1]] == 191).all()


def test_subsets(tmp_path):
    """Fewer points than the record has are distinct; more are equally frequent."""
    points = np.stack([np.arange(10), np.zeros(10), np.zeros(10)], axis=1).astype(np.float32)
    (sample,) = solids.samples(1, seed=0, image_size=(24, 32))
    sample = dataclasses.replace(sample, points=points, occupancy=None)
    write_dataset(tmp_path, {"train": [sample]}, source="test")
    for wanted, frequent in ((6, {0, 1}), (10, {1}), (34, {3, 4})):
        cfg = DataConfig(path=str(tmp_path), image_size=(24, 32), num_points=wanted)
        (batch,) = take(1, cfg, batch_size=1)
        counts = np.bincount(np.rint(batch["points"][0, :, 0]).astype(int), minlength=10)
        assert counts.sum() == wanted
        assert set(counts.tolist()) == frequent


def test_missing_data_fail_at_the_call(cfg, make, rng, tmp_path):
    with refused(ValueError, "batch_size", 7, "2 processes"):
        take(1, cfg, batch_size=7, process_count=2)
    with refused(RecordError, cfg.path, "'test'"):
        loader.eval_batches(cfg, split="test", batch_size=2)
    write_dataset(tmp_path, {"train": [make.sample(rng, depth=None)]}, source="test")
    with refused(RecordError, tmp_path, "depth", "data.inputs"):
        take(1, dataclasses.replace(cfg, path=str(tmp_path)))


def test_visibility_is_that_of_the_records_own_depth(cfg, dataset):
    plain = dataclasses.replace(cfg, inputs=("rgb", "mask"))
    options = {"split": "validation", "batch_size": 12}
    (batch,) = loader.eval_batches(plain, **options, visible_tolerance=0.03)
    assert "depth" not in batch
    reader = RecordReader(dataset, "validation")
    for row in (0, 10):
        s = decode(reader.read(row))
        case = s.depth, s.intrinsics, s.extrinsics
        want = visibility.visible_points(batch["points"][row], *case, 0.03)
        np.testing.assert_array_equal(batch["visible"][row], want)
        assert 0 < want.mean() < 1
    small = dataclasses.replace(plain, image_size=(12, 16))
    (again,) = loader.eval_batches(small, **options, visible_tolerance=0.03)
    np.testing.assert_array_equal(again["visible"], batch["visible"])


def test_several_folders_are_joined_and_count_several_times(cfg, dataset, tmp_path, make, rng):
    """`more` has no validation split; its records follow those of the first folder."""
    extra = [make.sample(rng, num_points=120, model_id=f"extra{i}") for i in range(3)]
    more, other = tmp_path / "more", tmp_path / "other"
    write_dataset(more, {"train": extra}, source="test")
    write_dataset(other, {"train": extra, "validation": extra[:2]}, source="test")
    joined = dataclasses.replace(cfg, path=f"{dataset}, {more}")
    assert loader.num_samples(joined, "train") == 40
    assert loader.num_samples(joined, "validation") == 11
    reader = RecordReader(joined.folders, "train")
    assert [reader[i].model_id for i in (36, 37, 39)] == ["cone-0-00036", "extra0", "extra2"]
    assert reader.locate(38) == (more / "train-00000.arrayrecord", 1)
    assert [batch["points"].shape for batch in take(8, joined)] == [(6, 100, 3)] * 8
    weighted = dataclasses.replace(cfg, path=f"{dataset},{other}*5")
    assert loader.num_samples(weighted, "train") == 37 + 15
    assert loader.num_samples(weighted, "validation", evaluation=True) == 11 + 2
