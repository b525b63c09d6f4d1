"""From records to batches: deterministic, resumable at any step, sharded by process.

Row j of the global batch of step s is record `order[s * B + j]`, where `order` concatenates
permutations of the split, one per epoch. Its random numbers depend on (seed, s, j). So a run that
resumes at step s need not repeat earlier batches, and rows are bit-identical for any number of
threads, worker processes and training processes.

Each batch is made by one thread of this process (decoding mostly releases Python's lock) or, in
training with `num_workers`, by one worker process.
"""

import gc
import itertools
import os
import re
import signal
import sys
from collections.abc import Callable, Generator, Sequence

import grain
import numpy as np
from absl import flags
from grain.multiprocessing import SharedMemoryArray

from psgn_jax.config.data import DEFAULT_DATA, DataConfig
from psgn_jax.data import workers
from psgn_jax.data.batches import ORDER, Batch, EvalBatch, Items, TrainBatch, model_views
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.schema import RecordError
from psgn_jax.system.cores import num_cores
from psgn_jax.system.errors import UserError

MAX_THREADS = 8
"""Largest number of decoding threads of a process; there are no more than cores."""


class WorkerError(UserError):
    """A worker process has ended."""


_CAUSES = {
    -signal.SIGKILL: "it was killed, perhaps for lack of memory",
    -signal.SIGBUS: "there is not enough shared memory (/dev/shm) for the batches; set "
    "data.num_workers=0, or give more of it (docker run --shm-size=1g)",
}


def _open(cfg: DataConfig, folders: tuple[str, ...], split: str) -> RecordReader:
    if os.path.basename(folders[0]) == DEFAULT_DATA and not os.path.isdir(folders[0]):
        raise RecordError(
            f"no data set is named, and there is no {folders[0]}; expected a folder of records, or "
            "a call of psgn_jax.commands.default_data.default_dataset"
        )
    reader = RecordReader(folders, split)
    name = ",".join(dict.fromkeys(folders))
    lacking = f"data set {name!r}: not every record of split {split!r} has "
    if "depth" in cfg.inputs and any("depth" not in shard.fields for shard in reader.shards):
        raise RecordError(lacking + "depth; remove 'depth' from data.inputs")
    if cfg.occupancy and any("occupancy" not in shard.fields for shard in reader.shards):
        raise RecordError(lacking + "a solid volume (occupancy), which the task needs")
    return reader


def _plain(batch: Batch) -> Batch:
    return {k: np.array(v) if isinstance(v, np.ndarray) else v for k, v in batch.items()}


def _iterate(
    numbers: Sequence[int], make: Callable[[int], Batch], num_workers: int = 0
) -> Generator[Batch, None, None]:
    """The batches with these numbers, in order; batches are made before they are asked for."""
    source = grain.MapDataset.source(numbers).map(make)
    if not num_workers:
        threads = min(MAX_THREADS, num_cores())
        read = grain.ReadOptions(num_threads=threads, prefetch_buffer_size=threads + 1)
        yield from source.to_iter_dataset(read)
        return
    read = grain.ReadOptions(num_threads=1, prefetch_buffer_size=1)
    dataset = source.to_iter_dataset(read).mp_prefetch(
        grain.MultiprocessingOptions(num_workers=num_workers, per_worker_buffer_size=2),
        worker_init_fn=workers.end_with_parent,
    )
    iterator, parsed = iter(dataset), flags.FLAGS.is_parsed()
    try:
        # Wait for every worker's first batch: `iterator.close` does not end starting workers.
        first = itertools.islice(iterator, num_workers)
        flags.FLAGS.mark_as_parsed()  # Grain needs this to start workers
        try:
            begun = workers.start_sheltered(lambda: list(map(_plain, first)))
        finally:
            if not parsed:
                flags.FLAGS.unparse_flags()
        while begun:
            yield begun.pop(0)
        # Workers pass arrays in shared memory. Grain frees it although a JAX array on the CPU may
        # still use it, so the consumer gets a copy.
        yield from map(_plain, iterator)
    except RuntimeError as error:
        found = re.search(r"Worker process was terminated .* exit code (-?\d+)", str(error))
        if found is None:
            raise
        cause = _CAUSES.get(int(found[1]), "its messages are above")
        raise WorkerError(
            f"data.num_workers={num_workers}: a worker process ended with exit code {found[1]}; "
            f"{cause}"
        ) from None
    finally:
        iterator.close()
        # Grain holds the unused batches in reference cycles, and frees their shared memory in a
        # thread that may not finish before Python exits.
        del iterator, dataset
        gc.collect()
        pool = getattr(SharedMemoryArray, "_del_thread_pool", None)
        if pool is not None:
            pool.apply(int)  # waits for the pool's single thread


def num_samples(cfg: DataConfig, split: str, *, evaluation: bool = False) -> int:
    """Number of samples of a split; `RecordError` if it is missing."""
    return len(_open(cfg, cfg.eval_folders if evaluation else cfg.folders, split))


def train_batches(
    cfg: DataConfig,
    *,
    batch_size: int,
    seed: int,
    start_step: int,
    process_index: int = 0,
    process_count: int = 1,
) -> Generator[Batch, None, None]:
    """Endless training batches from `start_step` on, augmented as the configuration says.

    Each epoch has a different order and contains every record once, or N times if `data.path` gives
    its folder the factor N.

    Args:
      batch_size: size B of the global batch.
      seed: seed of the order, the points and the augmentations.
      start_step: first step; earlier steps are not replayed.
      process_index: number of this process's contiguous part of each global batch.
      process_count: number of parts; divides B.

    Yields:
      With b = B / process_count: image uint8 [b, H, W, 3]; mask bool [b, H, W]; points float32
      [b, num_points, 3]; intrinsics float32 [b, 3, 3]; extrinsics float32 [b, 3, 4]; depth float32
      [b, H, W] if it is an input; occupancy bool [b, 32, 32, 32] if `cfg.occupancy`. With
      `cfg.train_views`, image and mask have an axis of v views after the batch axis. v is uniform
      in 1 to `train_views`, one number per batch. Views of a model are drawn without replacement;
      the other arrays belong to the first view.

    Raises:
      ValueError: `process_count` does not divide `batch_size`.
      RecordError: the data set is missing or damaged (from the call or the iteration).
      WorkerError: a worker process has ended (from the iteration).
    """
    workers.check_main_guard()
    if batch_size % process_count:
        raise ValueError(
            f"batch_size: got {batch_size}, expected a multiple of the {process_count} processes"
        )
    reader = _open(cfg, cfg.folders, cfg.train_split)
    order_seed = int(np.random.SeedSequence([seed, ORDER]).generate_state(1)[0])
    order = grain.MapDataset.range(len(reader)).seed(order_seed).shuffle().repeat()
    local = batch_size // process_count
    rows = range(process_index * local, (process_index + 1) * local)
    views = cfg.train_views
    several = model_views(reader, views, "voxels.max_views") if views else None
    items = Items(cfg, reader, repeatedly=True)
    make = TrainBatch(cfg, items, order, batch_size, seed, rows, several)
    return _iterate(range(start_step, sys.maxsize // batch_size), make, cfg.num_workers)


def eval_batches(
    cfg: DataConfig,
    *,
    split: str,
    batch_size: int,
    seed: int = 0,
    visible_tolerance: float = 0.0,
    choose: Callable[[int], Sequence[int]] = range,
) -> Generator[Batch, None, None]:
    """Every sample of a split exactly once, in the order of the records, without augmentation.

    Args:
      batch_size: size B; the last batch is padded to it with copies of the last sample.
      seed: seed of the choice of points.
      visible_tolerance: see `data.visibility`; 0 = no visibility.
      choose: maps the number of batches to the numbers of the batches to make.

    Yields:
      the arrays of `train_batches`, with num_eval_points points; also valid bool [B] (False for
      padding), category and model_id (lists of B strings) and view (list of B integers). With a
      `visible_tolerance`, if all records of the split have depth: visible bool
      [B, num_eval_points], whether the depth image shows a point. With `cfg.eval_views` = v, image
      and mask have v views: the sample's view and the next v - 1 of its model, cyclically.

    Raises:
      RecordError: the data set is missing or damaged (from the call or the iteration).
    """
    reader = _open(cfg, cfg.eval_folders, split)
    if any("depth" not in s.fields for s in reader.shards):
        visible_tolerance = 0.0
    views = cfg.eval_views
    several = model_views(reader, views, "voxels.eval_views") if views else None
    items = Items(cfg, reader, visibility=bool(visible_tolerance), repeatedly=views > 0)
    make = EvalBatch(cfg, items, len(reader), batch_size, seed, visible_tolerance, several)
    return _iterate(choose(-(-len(reader) // batch_size)), make)
