"""Keeps a whole split in the memory of the accelerator, which makes the batches there.

Images are kept as bytes, masks as bits and points on their lattice. The batch of step s holds the
same records in the same rows as that of `data.loader`; the random choices of points and
augmentations are made with JAX keys derived from (seed, s, row), so they differ from the loader's.
Every device has the whole split and makes its share of a batch, so a batch depends neither on the
number of devices nor on that of processes.
"""

import concurrent.futures
import os
from collections.abc import Generator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from absl import logging
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from psgn_jax.config import DataConfig
from psgn_jax.data import augment, device_augment, loader, schema
from psgn_jax.data.batches import Item, Items
from psgn_jax.data.dataset import JoinedReader, RecordReader
from psgn_jax.types import Array, PRNGKey

MEMORY_SHARE = 0.6
"""Largest part of an accelerator's memory for the split; the training needs the rest."""

# Purpose of random keys; 0 to 3 are those of `training.state`.
_PURPOSE = 4
_MANY = 256  # records that are decoded at a time


def train_batches(
    cfg: DataConfig,
    mesh: Mesh,
    *,
    keys: Sequence[str],
    batch_size: int,
    seed: int,
    start_step: int,
    process_index: int = 0,
    process_count: int = 1,
) -> Generator[dict[str, jax.Array], None, None] | None:
    """Endless training batches on the devices of `mesh`, like those of `loader.train_batches`.

    Args:
      cfg: the section `data` of the configuration.
      mesh: mesh of all devices of all processes, with one axis `data`.
      keys: names of the arrays that a batch contains.
      batch_size: size of the global batch.
      seed: seed of all random numbers.
      start_step: first step; earlier steps are not replayed.
      process_index: index of this process.
      process_count: number of processes.

    Returns:
      The batches; None if the split does not fit into the device's memory, or if the device does
      not support an augmentation or several views of a model. The reason is logged.

    Raises:
      RecordError: the data set is missing or damaged.
    """
    if reason := _not_computed(cfg):
        logging.warning("data.on_device: %s; batches are made by the host", reason)
        return None
    reader, order = loader.train_order(cfg, seed)
    devices = [d for d in mesh.devices.flat if d.process_index == jax.process_index()]
    needed, allowed = _bytes_needed(cfg, reader), _bytes_allowed(devices[0])
    if needed > allowed:
        logging.warning(
            "data.on_device: the split takes %.2f GB, more than the %.2f GB allowed (%.0f %% of "
            "the device's memory); batches are made by the host",
            needed / 1e9,
            allowed / 1e9,
            100 * MEMORY_SHARE,
        )
        return None
    local = Mesh(np.asarray(devices), ("data",))
    split, slots = _load(cfg, reader, NamedSharding(local, P()))
    logging.info("data.on_device: %d samples in %.2f GB", len(reader), needed / 1e9)
    make = _compile(cfg, local, keys, seed)
    share = batch_size // process_count
    rows = np.arange(process_index * share, (process_index + 1) * share, dtype=np.int32)

    def generate() -> Generator[dict[str, jax.Array], None, None]:
        step = start_step
        while True:
            chosen = np.array(
                [slots[int(order[step * batch_size + r])] for r in rows.tolist()], np.int32
            )
            yield _spread(make(split, chosen, rows, np.int32(step)), mesh, batch_size)
            step += 1

    return generate()


def _not_computed(cfg: DataConfig) -> str:
    """The reason why the devices cannot make the batches of a configuration; "" if they can."""
    if cfg.train_views:
        return "several views of a model are not supported"
    for name in ("place", "reframe_scale", "reframe_shift"):
        if value := getattr(cfg, name):
            return f"data.{name}={value!r} is not supported"
    return "data.photo is not supported" if cfg.photo.any() else ""


def _bytes_needed(cfg: DataConfig, reader: RecordReader | JoinedReader) -> int:
    """Memory of the split, estimated from the first record of each shard."""
    pixels = cfg.image_size[0] * cfg.image_size[1]
    ends = np.cumsum([shard.count for shard in reader.shards])
    firsts = {int(end) - shard.count for end, shard in zip(ends, reader.shards, strict=True)}
    lattices = [reader.stored(first, ["points"]).points for first in sorted(firsts)]
    points = max(lattice.codes.nbytes for lattice in lattices if lattice is not None)
    each = 3 * pixels + -(-pixels // 8) + points + 4 * (12 + 9 + 12 + 1) + 1
    each += 4 * pixels if "depth" in cfg.inputs else 0
    each += schema.OCCUPANCY_SIZE**3 // 8 if cfg.occupancy else 0
    return each * reader.num_distinct


def _bytes_allowed(device: jax.Device) -> float:
    """Memory of a device that a split may use."""
    statistics = device.memory_stats() if device.platform != "cpu" else None
    if statistics and "bytes_limit" in statistics:
        return MEMORY_SHARE * float(statistics["bytes_limit"])
    return MEMORY_SHARE * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _load(
    cfg: DataConfig, reader: RecordReader | JoinedReader, sharding: NamedSharding
) -> tuple[dict[str, jax.Array], np.ndarray]:
    """The arrays of a split, and for each record the number of its row in them.

    The arrays have one row for each distinct record, because a folder may be listed twice.
    """
    originals = [reader.original(index) for index in range(len(reader))]
    distinct, slots = np.unique(originals, return_inverse=True)
    items = Items(cfg, reader)
    arrays: dict[str, np.ndarray] = {}
    codes: list[np.ndarray] = []
    threads = concurrent.futures.ThreadPoolExecutor(loader.num_threads())
    with threads:
        for begin in range(0, len(distinct), _MANY):
            part = distinct[begin : begin + _MANY].tolist()
            for row, item in enumerate(threads.map(items.__getitem__, part), begin):
                for name, value in _stored(item).items():
                    if name not in arrays:
                        arrays[name] = np.empty((len(distinct), *value.shape), value.dtype)
                    arrays[name][row] = value
                codes.append(item.points.codes)
    arrays["count"] = np.array([len(one) for one in codes], np.int32)
    wide = np.result_type(*{one.dtype for one in codes})
    arrays["codes"] = np.zeros((len(codes), arrays["count"].max(), 3), wide)
    for row, one in enumerate(codes):
        arrays["codes"][row, : len(one)] = one
    return {name: jax.device_put(array, sharding) for name, array in arrays.items()}, slots.astype(
        np.int32
    )


def _stored(item: Item) -> dict[str, np.ndarray]:
    """The arrays of a record that are kept on the device, except the codes of its points."""
    camera_only = augment.View(
        item.image, item.mask, None, np.zeros((0, 3)), item.intrinsics, item.extrinsics
    )
    fields = {
        "image": item.image,
        "mask": np.packbits(item.mask),
        "matrix": item.points.matrix.astype(np.float32),
        "intrinsics": item.intrinsics,
        "extrinsics": item.extrinsics,
        "can_stretch": np.array(augment.can_stretch(camera_only)),
    }
    if item.depth is not None:
        fields["depth"] = item.depth
    if item.occupancy is not None:
        fields["occupancy"] = np.packbits(item.occupancy)
    return fields


def choose_points(key: PRNGKey, count: Array, available: int, wanted: int) -> Array:
    """Random indices below `count`, without replacement.

    If `count` is less than `wanted`, all indices occur equally often (+-1).

    Args:
      key: key of the draw.
      count: number of points, at most `available`.
      available: static upper bound of `count`.
      wanted: number of indices.
    """
    ranks = jax.random.bits(key, (available,)) >> 1
    order = jnp.argsort(jnp.where(jnp.arange(available) < count, ranks, jnp.uint32(2**32 - 1)))
    i = jnp.arange(wanted)
    repeated = (wanted // count) * count
    rest = order[jnp.clip(i - repeated, 0, available - 1)]
    return jnp.where(i < repeated, i % count, rest)


def _compile(cfg: DataConfig, mesh: Mesh, keys: Sequence[str], seed: int) -> Any:
    """Compiled (split, slots [b], rows [b], step) -> batch.

    `slots` are rows of the split's arrays. `rows` are rows of the global batch, from which the
    random keys are derived.
    """
    size = cfg.image_size

    def sample(split: dict[str, Array], slot: Array, row: Array, step: Array) -> dict[str, Array]:
        key = jax.random.fold_in(jax.random.key(seed), _PURPOSE)
        key = jax.random.fold_in(jax.random.fold_in(key, step), row)
        points_key, draws_key = jax.random.split(key)
        record = {name: array[slot] for name, array in split.items()}
        index = choose_points(points_key, record["count"], len(record["codes"]), cfg.num_points)
        view = device_augment.View(
            record["image"],
            _unpacked(record["mask"], size),
            record.get("depth"),
            _points(record["codes"][index], record["matrix"]),
            record["intrinsics"],
            record["extrinsics"],
            _unpacked(record["occupancy"], (schema.OCCUPANCY_SIZE,) * 3)
            if "occupancy" in record
            else None,
        )
        draws = device_augment.draw(draws_key)
        view = device_augment.augment(cfg, view, draws, record["can_stretch"])
        return {name: getattr(view, name) for name in keys}

    batch = jax.vmap(sample, in_axes=(None, 0, 0, None))
    sharded = jax.shard_map(
        batch, mesh=mesh, in_specs=(P(), P("data"), P("data"), P()), out_specs=P("data")
    )
    return jax.jit(sharded)


def _unpacked(bits: Array, shape: tuple[int, ...]) -> Array:
    return jnp.unpackbits(bits, count=int(np.prod(shape))).reshape(shape).astype(bool)


def _points(codes: Array, matrix: Array) -> Array:
    """Points of lattice codes; no matrix product, which a GPU would round to TF32."""
    x, y, z = jnp.split(codes.astype(jnp.float32), 3, axis=1)
    a, b, c, offset = (matrix[None, :, column] for column in range(4))
    return x * a + y * b + z * c + offset


def _spread(local: dict[str, jax.Array], mesh: Mesh, batch_size: int) -> dict[str, jax.Array]:
    """The rows of this process as its shards of the global arrays."""
    if jax.process_count() == 1:
        return local
    sharding = NamedSharding(mesh, P("data"))
    return {
        name: jax.make_array_from_single_device_arrays(
            (batch_size, *array.shape[1:]),
            sharding,
            [shard.data for shard in array.addressable_shards],
        )
        for name, array in local.items()
    }
