"""A split in the accelerator's memory has the samples and augmentations of the host's loader."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import drawn_solids as solids
from helpers import standin
from jax.sharding import Mesh

from psgn_jax.config import DataConfig
from psgn_jax.data import augment, camera, device_augment, loader, on_device, schema
from psgn_jax.data.dataset import write_dataset
from psgn_jax.data_config import PhotoEffects
from psgn_jax.training.checkpoint import Checkpoints
from psgn_jax.training.loop import train

SIZE = (24, 32)
KEYS = ("image", "mask", "depth", "points", "intrinsics", "extrinsics")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("on_device") / "data"
    splits = {
        "train": solids.samples(13, seed=0, image_size=SIZE),
        "validation": solids.samples(5, seed=1, image_size=SIZE),
    }
    write_dataset(folder, splits, source="solids", records_per_shard=5)
    return folder


def config(folder, **changes):
    return DataConfig(
        path=str(folder),
        image_size=SIZE,
        inputs=("rgb", "mask", "depth"),
        num_points=changes.pop("num_points", 64),
        **changes,
    )


def mesh():
    return Mesh(np.asarray(jax.devices()), ("data",))


def take(count, cfg, **changes):
    arguments = {"batch_size": 4, "seed": 7, "start_step": 0} | changes
    batches = on_device.train_batches(cfg, mesh(), keys=KEYS, **arguments)
    return [jax.tree.map(np.asarray, next(batches)) for _ in range(count)]


def views(category="box", *, photo=False, seed=0):
    """The same sample for the host and for the device; `photo` adds a background."""
    rng = np.random.default_rng(seed)
    s = solids.draw(solids.random_solid(category, rng), rng, image_size=(48, 64))
    image = s.image.copy()
    if photo:
        rows, columns = np.mgrid[:48, :64]
        background = np.stack([3 * rows, 2 * columns, rows + columns], axis=-1).astype(np.uint8)
        image[~s.mask] = background[~s.mask]
    host = augment.View(image, s.mask, s.depth, s.points, s.intrinsics, s.extrinsics)
    device = device_augment.View(*(getattr(host, f.name) for f in dataclasses.fields(host)))
    return host, jax.tree.map(jnp.asarray, device)


def assert_same(host, device, pixels=0.0, level=0):
    """Compares views.

    Up to a fraction `pixels` of the pixels may differ in mask, or by more than `level` in colour.
    """
    mask = np.asarray(device.mask)
    assert (mask != host.mask).mean() <= pixels
    both = mask == host.mask
    difference = np.abs(np.asarray(device.image).astype(int) - host.image)[both]
    assert (difference > level).mean() <= pixels
    # Where two pixels are equally near, rounding decides which depth is taken.
    assert (np.abs(device.depth - host.depth) > 1e-6).mean() <= 6 * pixels
    for name in ("points", "intrinsics", "extrinsics"):
        mine, theirs = getattr(device, name), getattr(host, name)
        np.testing.assert_allclose(mine, theirs, rtol=1e-5, atol=2e-5, err_msg=name)


def test_flip():
    host, device = views()
    assert_same(augment.flip(host), device_augment.flip(device))


@pytest.mark.parametrize("photo", [False, True])
@pytest.mark.parametrize("factor", [0.75, 0.9, 1.0, 1.2])
def test_stretch(factor, photo):
    host, device = views(photo=photo)
    changed = device_augment.stretch(device, jnp.float32(factor))
    assert_same(augment.stretch(host, factor), changed, pixels=2e-3, level=1)


@pytest.mark.parametrize("photo", [False, True])
@pytest.mark.parametrize(
    ("factor", "shift"), [(0.7, (3, -4)), (0.9, (-2.5, 1.5)), (1.0, (0, 0)), (1.6, (20, 20))]
)
def test_recrop(factor, shift, photo):
    host, device = views(photo=photo)
    changed = device_augment.recrop(device, jnp.float32(factor), jnp.array(shift, jnp.float32))
    assert_same(augment.recrop(host, factor, shift), changed, pixels=4e-3, level=1)


def test_recrop_without_an_object():
    host, device = views()
    host = dataclasses.replace(host, mask=np.zeros_like(host.mask))
    device = device._replace(mask=jnp.zeros_like(device.mask))
    changed = device_augment.recrop(device, jnp.float32(1.5), jnp.zeros(2))
    np.testing.assert_array_equal(changed.intrinsics, augment.recrop(host, 1.5, (0, 0)).intrinsics)


def test_colour_jitter():
    host, device = views()

    class Fixed:
        def uniform(self, low, high, count):
            return np.array([[0.2, -0.1], [0.1, -0.2, 0.05]][count - 2])

    expected = augment.colour_jitter(host, Fixed(), 0.3)
    gains = 1 + jnp.array([0.1, -0.2, 0.05]) / 2
    changed = device_augment.colour_jitter(device, jnp.float32(0.2), jnp.float32(-0.1), gains)
    assert_same(expected, changed, level=1)
    assert not np.array_equal(expected.image, host.image)


def test_all_augmentations_keep_the_sample_consistent():
    cfg = DataConfig(flip=True, stretch=0.2, zoom=0.1, shift=0.05, colour_jitter=0.3)
    _, device = views("ellipsoid")
    keys = jax.random.split(jax.random.key(0), 16)
    many = jax.vmap(
        lambda key: device_augment.augment(cfg, device, device_augment.draw(key), jnp.array(True))
    )(keys)
    assert len(np.unique(np.abs(many.points[..., 1]).max(axis=1))) > 8
    assert len(np.unique(np.asarray(many.intrinsics)[:, 0, 2])) > 8
    for row in range(len(keys)):
        view = jax.tree.map(lambda a, row=row: np.asarray(a[row]), many)
        schema.check_camera(view.intrinsics, view.extrinsics)
        pixels, _ = camera.project(view.points, view.intrinsics, view.extrinsics)
        assert camera.inside_mask(pixels, view.mask, 1).mean() > 0.98


@pytest.mark.parametrize(("count", "wanted"), [(40, 10), (40, 40), (40, 100), (50, 50)])
def test_points_are_chosen_evenly(count, wanted):
    chosen = on_device.choose_points(jax.random.key(1), jnp.int32(count), 50, wanted)
    times = np.bincount(np.asarray(chosen), minlength=50)
    assert times[:count].max() - times[:count].min() <= 1
    assert not times[count:].any()
    assert times.sum() == wanted
    if wanted == count:
        np.testing.assert_array_equal(chosen, np.arange(count))


def test_without_augmentation_batches_are_those_of_the_host(folder):
    cfg = config(folder, num_points=solids.NUM_POINTS)
    host = loader.train_batches(cfg, batch_size=4, seed=7, start_step=2)
    for batch in take(3, cfg, start_step=2):
        expected = next(host)
        for name in ("image", "mask", "depth", "intrinsics", "extrinsics"):
            np.testing.assert_array_equal(batch[name], expected[name], err_msg=name)
        np.testing.assert_allclose(batch["points"], expected["points"], atol=1e-6)


def test_points_are_of_the_record(folder):
    (batch,) = take(1, config(folder))
    whole = next(
        loader.train_batches(
            config(folder, num_points=solids.NUM_POINTS), batch_size=4, seed=7, start_step=0
        )
    )
    for some, every in zip(batch["points"], whole["points"], strict=True):
        gaps = np.abs(some[:, None] - every).max(axis=2).min(axis=1)
        assert gaps.max() < 1e-6
        assert len(np.unique(some, axis=0)) > 60


def test_a_batch_depends_on_seed_and_step_alone(folder):
    cfg = config(folder, flip=True, stretch=0.2, colour_jitter=0.3)
    batches = take(4, cfg)
    later = take(1, cfg, start_step=3)[0]
    parts = [take(1, cfg, start_step=3, process_index=i, process_count=2)[0] for i in (0, 1)]
    for name in KEYS:
        np.testing.assert_array_equal(later[name], batches[3][name])
        np.testing.assert_array_equal(np.concatenate([p[name] for p in parts]), later[name])
    assert not np.array_equal(take(1, cfg, seed=8)[0]["points"], batches[0]["points"])
    assert not np.array_equal(batches[0]["points"], batches[1]["points"])


def test_a_folder_that_counts_twice_is_kept_once(folder, caplog):
    twice = config(f"{folder}*2")
    reader, _ = loader.train_order(twice, 0)
    assert len(reader) == 26
    once, _ = loader.train_order(config(folder), 0)
    assert on_device._bytes_needed(twice, reader) == on_device._bytes_needed(config(folder), once)
    host = loader.train_batches(twice, batch_size=4, seed=7, start_step=0)
    np.testing.assert_array_equal(take(1, twice)[0]["image"], next(host)["image"])


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"place": 0.5}, "data.place=0.5 is not supported"),
        ({"reframe_shift": 0.1}, "data.reframe_shift=0.1 is not supported"),
        ({"photo": PhotoEffects(blur=1.0)}, "data.photo is not supported"),
    ],
)
def test_the_host_takes_over_with_a_line(folder, changes, line, caplog):
    assert on_device.train_batches(
        config(folder, **changes), mesh(), keys=KEYS, batch_size=4, seed=0, start_step=0
    ) is None  # fmt: skip
    assert f"data.on_device: {line}; batches are made by the host" in caplog.text


def test_the_host_takes_over_where_the_split_does_not_fit(folder, caplog, monkeypatch):
    monkeypatch.setattr(on_device, "_bytes_allowed", lambda device: 1000.0)
    assert on_device.train_batches(
        config(folder), mesh(), keys=KEYS, batch_size=4, seed=0, start_step=0
    ) is None  # fmt: skip
    (record,) = caplog.records
    assert "the split takes 0.00 GB, more than the 0.00 GB allowed" in record.getMessage()


def test_the_estimate_is_what_is_kept(folder):
    cfg = config(folder)
    reader, _ = loader.train_order(cfg, 0)
    sharding = jax.sharding.NamedSharding(mesh(), jax.sharding.PartitionSpec())
    split, _ = on_device._load(cfg, reader, sharding)
    kept = sum(array.nbytes for array in split.values())
    assert on_device._bytes_needed(cfg, reader) == pytest.approx(kept, rel=0.01)


def test_a_run_resumes_to_the_same_bits(folder, tmp_path):
    def run(name, steps):
        settings = standin.config(
            model__name="vanilla",
            model__widths=(4, 6, 8),
            data__path=str(folder),
            data__on_device=True,
            data__flip=True,
            data__stretch=0.1,
            train__steps=steps,
            train__eval_every=0,
        )
        train(settings, tmp_path / name)
        return Checkpoints(tmp_path / name / "checkpoints", read_only=True).restore_newest()

    whole = run("whole", 9)
    run("parts", 4)
    resumed = run("parts", 9)
    assert whole.step == resumed.step == 9
    for name, leaf in whole.leaves.items():
        np.testing.assert_array_equal(resumed.leaves[name], leaf, err_msg=name)
