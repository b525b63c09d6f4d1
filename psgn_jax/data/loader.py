"""Records to batches: deterministic, resumable at any step, sharded by process.

The batch of step s depends on (records, configuration, batch size, seed, s) alone. Row j of the
global batch is record `order[s * B + j]`, where `order` is an endless concatenation of
permutations of the split, one per epoch; its randomness comes from the seeds (seed, s, j). So a
run that resumes at step s replays nothing, and neither the number of threads, of worker processes
nor of training processes changes a bit of any row.

A batch is decoded as one unit of work: by threads in this process (decoding releases Python's
lock most of the time), or by `num_workers` processes.
"""

import copy
import dataclasses
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import grain
import numpy as np
from absl import flags

from psgn_jax.config import DataConfig
from psgn_jax.data import augment, camera, records, resize, schema, visibility

Batch = dict[str, Any]

# Streams of random numbers that must not meet.
_ORDER, _TRAIN, _EVAL, _VIEWS = 0, 1, 2, 3

MAX_THREADS = 8
"""Decoding threads in one process, at most; no more than there are cores."""

CACHE_BYTES = 4 << 30
"""What `DataConfig.cache` may hold, over all workers of one process. Samples decoded and resized,
points in their compact form: about 100 kB a sample of the authors' data at half size, 250 kB at
full size. What does not fit is decoded each time."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Item:
    """One record decoded and resized: what does not depend on the step."""

    image: np.ndarray
    mask: np.ndarray
    depth: np.ndarray | None
    points: records.PointLattice
    occupancy: np.ndarray | None
    intrinsics: np.ndarray
    extrinsics: np.ndarray
    category: str
    model_id: str
    view: int
    # Depth at the record's own size and the intrinsics that go with it, where visibility is asked.
    measured: tuple[records.DepthCodes, np.ndarray] | None

    def nbytes(self) -> int:
        arrays = [self.image, self.mask, self.depth, self.points.codes, self.occupancy]
        if self.measured:
            arrays += [self.measured[0].codes, self.measured[0].valid]
        return sum(a.nbytes for a in arrays if a is not None)


class _Items:
    """Record number to `_Item`; keeps items if asked to, up to a bound."""

    def __init__(
        self,
        cfg: DataConfig,
        reader: records.RecordReader | records.JoinedReader,
        *,
        visibility: bool = False,
    ) -> None:
        self._reader = reader
        self._size = cfg.image_size[0], cfg.image_size[1]
        self._fields = ["image", "mask", "points"]
        self._depth, self._visibility = "depth" in cfg.inputs, visibility
        if self._depth or self._visibility:
            self._fields.append("depth")
        if cfg.occupancy:
            self._fields.append("occupancy")
        self._bound = CACHE_BYTES // max(1, cfg.num_workers) if cfg.cache else 0
        self.__setstate__({})

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k not in ("_kept", "_held", "_lock")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._kept: dict[int, _Item] = {}
        self._held = 0
        self._lock = threading.Lock()

    def __getitem__(self, index: int) -> _Item:
        item = self._kept.get(index)
        if item is None:
            item = self._decode(index)
            with self._lock:
                if self._held + item.nbytes() <= self._bound and index not in self._kept:
                    self._kept[index] = item
                    self._held += item.nbytes()
        return item

    def _decode(self, index: int) -> _Item:
        stored = self._reader.stored(index, self._fields)
        if stored.image is None or stored.mask is None or stored.points is None:
            raise self._lacks(index, "image, mask or points")
        if "occupancy" in self._fields and stored.occupancy is None:
            raise self._lacks(index, "occupancy")
        mask = resize.resize_mask(stored.mask, self._size)
        depth = measured = None
        if "depth" in self._fields:
            if stored.depth is None:
                raise self._lacks(index, "depth")
            if self._depth:
                depth = resize.resize_depth(stored.depth.depth(), mask)
            if self._visibility:
                measured = stored.depth, stored.intrinsics
        return _Item(
            image=resize.resize_image(stored.image, self._size),
            mask=mask,
            depth=depth,
            points=stored.points,
            occupancy=stored.occupancy,
            intrinsics=camera.scale_intrinsics(
                stored.intrinsics, stored.image.shape[:2], self._size
            ),
            extrinsics=stored.extrinsics,
            category=stored.category,
            model_id=stored.model_id,
            view=stored.view,
            measured=measured,
        )

    def _lacks(self, index: int, what: str) -> records.RecordError:
        path, position = self._reader.locate(index)
        return records.RecordError(f"record {position} of {path} has no {what}")


def _subset(rng: np.random.Generator, available: int, wanted: int) -> np.ndarray | slice:
    """Random indices without replacement; each index equally often (+-1) where too few exist."""
    if wanted == available:
        return slice(None)
    whole, rest = divmod(wanted, available)
    # The order of a cloud's points carries no meaning: shuffling the choice would be wasted.
    part = rng.choice(available, rest, replace=False, shuffle=False)
    return np.concatenate([np.tile(np.arange(available), whole), part]) if whole else part


class _Models:
    """Which records of a split are views of the same model.

    Reads every record once (a millisecond or two each): the manifest names no models.
    """

    def __init__(
        self, reader: records.RecordReader | records.JoinedReader, wanted: int, name: str
    ) -> None:
        members: dict[tuple[str, ...], list[int]] = {}
        for index in range(len(reader)):
            stored = reader.stored(index, ())
            folder = str(reader.locate(index)[0].parent)
            members.setdefault((folder, stored.category, stored.model_id), []).append(index)
        for (folder, _, model), views in members.items():
            if len(views) < wanted:
                raise records.RecordError(
                    f"data set {folder!r}: model {model!r} has {len(views)} views of the {wanted} "
                    f"that {name} asks for"
                )
        self._views = {view: views for views in members.values() for view in views}

    def others(self, index: int) -> list[int]:
        """The other views, beginning with those after this one."""
        views = self._views[index]
        at = views.index(index)
        return views[at + 1 :] + views[:at]


def _empty_batch(cfg: DataConfig, rows: int, num_points: int, num_views: int = 0) -> Batch:
    height, width = cfg.image_size
    axes = (rows, num_views) if num_views else (rows,)
    batch: Batch = {
        "image": np.empty((*axes, height, width, 3), np.uint8),
        "mask": np.empty((*axes, height, width), np.bool_),
        "points": np.empty((rows, num_points, 3), np.float32),
        "intrinsics": np.empty((rows, 3, 3), np.float32),
        "extrinsics": np.empty((rows, 3, 4), np.float32),
    }
    if "depth" in cfg.inputs:
        batch["depth"] = np.empty((rows, height, width), np.float32)
    if cfg.occupancy:
        batch["occupancy"] = np.empty((rows, *(schema.OCCUPANCY_SIZE,) * 3), np.bool_)
    return batch


def _view(item: _Item, rng: np.random.Generator, num_points: int) -> augment.View:
    chosen = _subset(rng, len(item.points.codes), num_points)
    return augment.View(
        item.image,
        item.mask,
        item.depth,
        item.points.points(chosen),
        item.intrinsics,
        item.extrinsics,
        item.occupancy,
    )


def _further_view(item: _Item) -> augment.View:
    """One of several views: its picture counts, the rest is the first one's."""
    nothing = np.zeros((0, 3), np.float32)
    return augment.View(
        item.image, item.mask, None, nothing, item.intrinsics, item.extrinsics, None
    )


def _fill(batch: Batch, row: int, view: augment.View, further: list[augment.View]) -> None:
    for key in ("image", "mask", "depth", "points", "intrinsics", "extrinsics", "occupancy"):
        if key not in batch:
            continue
        if key in ("image", "mask") and batch["mask"].ndim == 4:
            for number, one in enumerate([view, *further]):
                batch[key][row, number] = getattr(one, key)
        else:
            batch[key][row] = getattr(view, key)


class _TrainBatch:
    """Step number to the local rows of its batch."""

    def __init__(
        self,
        cfg: DataConfig,
        items: _Items,
        count: int,
        batch_size: int,
        seed: int,
        rows: range,
        models: _Models | None,
    ) -> None:
        self._cfg, self._items, self._seed, self._models = cfg, items, seed, models
        self._batch_size, self._rows = batch_size, rows
        order_seed = int(np.random.SeedSequence([seed, _ORDER]).generate_state(1)[0])
        self._order = grain.MapDataset.range(count).seed(order_seed).shuffle().repeat()

    def __call__(self, step: int) -> Batch:
        cfg = self._cfg
        num_views = 0
        if self._models:
            # One number for the batch, whatever part of it is made here.
            rng = np.random.default_rng([self._seed, _VIEWS, step])
            num_views = int(rng.integers(1, cfg.train_views + 1))
        batch = _empty_batch(cfg, len(self._rows), cfg.num_points, num_views)
        for local, row in enumerate(self._rows):
            rng = np.random.default_rng([self._seed, _TRAIN, step, row])
            index = int(self._order[step * self._batch_size + row])
            views = [_view(self._items[index], rng, cfg.num_points)]
            if self._models and num_views > 1:
                chosen = rng.permutation(self._models.others(index))[: num_views - 1]
                views += [_further_view(self._items[int(i)]) for i in chosen]
            # The same draws for every view of a model: a mirrored object is so in all of them.
            first, *further = (
                augment.augment(
                    view,
                    copy.deepcopy(rng) if len(views) > 1 else rng,
                    flip_half=cfg.flip,
                    stretch_range=cfg.stretch,
                    jitter=cfg.colour_jitter,
                    zoom_range=cfg.zoom,
                    shift_range=cfg.shift,
                )
                for view in views
            )
            _fill(batch, local, first, further)
        return batch


class _EvalBatch:
    """Batch number to the batch, padded with copies of the last sample."""

    def __init__(
        self,
        cfg: DataConfig,
        items: _Items,
        count: int,
        batch_size: int,
        seed: int,
        visible_tolerance: float,
        models: _Models | None,
    ) -> None:
        self._cfg, self._items, self._count, self._models = cfg, items, count, models
        self._batch_size, self._seed = batch_size, seed
        self._visible_tolerance = visible_tolerance

    def __call__(self, number: int) -> Batch:
        cfg = self._cfg
        start = number * self._batch_size
        filled = min(self._batch_size, self._count - start)
        batch = _empty_batch(cfg, self._batch_size, cfg.num_eval_points, cfg.eval_views)
        if self._visible_tolerance:
            batch["visible"] = np.empty((self._batch_size, cfg.num_eval_points), np.bool_)
        items = []
        for row in range(filled):
            rng = np.random.default_rng([self._seed, _EVAL, start + row])
            item = self._items[start + row]
            others = self._models.others(start + row) if self._models else []
            further = [_further_view(self._items[i]) for i in others[: cfg.eval_views - 1]]
            _fill(batch, row, _view(item, rng, cfg.num_eval_points), further)
            if item.measured:
                codes, intrinsics = item.measured
                batch["visible"][row] = visibility.visible_points(
                    batch["points"][row],
                    codes.depth(),
                    intrinsics,
                    item.extrinsics,
                    self._visible_tolerance,
                )
            items.append(item)
        for values in batch.values():
            values[filled:] = values[filled - 1]
        batch["valid"] = np.arange(self._batch_size) < filled
        items += items[-1:] * (self._batch_size - filled)
        for key in ("category", "model_id", "view"):
            batch[key] = [getattr(item, key) for item in items]
        return batch


def _open(cfg: DataConfig, split: str) -> records.RecordReader | records.JoinedReader:
    folders = cfg.folders
    if not folders:
        from psgn_jax.data import default

        folders = (default.default_dataset(),)
    reader = records.open_split(folders, split)
    name = ",".join(folders)
    if not len(reader):
        raise records.RecordError(f"data set {name!r}: split {split!r} is empty")
    if "depth" in cfg.inputs and any("depth" not in s.fields for s in reader.shards):
        raise records.RecordError(
            f"data set {name!r}: data.inputs asks for depth, which not every record of split "
            f"{split!r} has; remove 'depth' from data.inputs"
        )
    if cfg.occupancy and any("occupancy" not in s.fields for s in reader.shards):
        raise records.RecordError(
            f"data set {name!r}: the task wants solid volumes (occupancy), which not every record "
            f"of split {split!r} has"
        )
    return reader


def _models(
    cfg: DataConfig, reader: records.RecordReader | records.JoinedReader, *, train: bool
) -> _Models | None:
    wanted = cfg.train_views if train else cfg.eval_views
    name = "voxels.max_views" if train else "voxels.eval_views"
    return _Models(reader, wanted, name) if wanted else None


def _num_cores() -> int:
    if hasattr(os, "sched_getaffinity"):  # what this process may use; Linux alone knows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _leave_interrupts_to_the_trainer(*_: int) -> None:
    """Ctrl-C goes to every process of a terminal; the trainer ends the workers when it is done."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _plain(batch: Batch) -> Batch:
    return {k: np.array(v) if isinstance(v, np.ndarray) else v for k, v in batch.items()}


def _iterate(
    cfg: DataConfig, start: int, stop: int, make: Callable[[int], Batch]
) -> Iterator[Batch]:
    """Batches start, start + 1, ... stop - 1 in order, made ahead of their use."""
    numbers = grain.MapDataset.range(start, stop).map(make)
    if cfg.num_workers:
        # Grain hands absl flags to its workers and fails where nobody has parsed any: in a
        # notebook, in a test, in a program without absl.
        if not flags.FLAGS.is_parsed():
            flags.FLAGS.mark_as_parsed()
        read = grain.ReadOptions(num_threads=1, prefetch_buffer_size=1)
        dataset = numbers.to_iter_dataset(read).mp_prefetch(
            grain.MultiprocessingOptions(num_workers=cfg.num_workers, per_worker_buffer_size=2),
            worker_init_fn=_leave_interrupts_to_the_trainer,
        )
    else:
        threads = min(MAX_THREADS, _num_cores())
        read = grain.ReadOptions(num_threads=threads, prefetch_buffer_size=threads + 1)
        dataset = numbers.to_iter_dataset(read)
    iterator = iter(dataset)
    try:
        for batch in iterator:
            # Workers hand arrays over in shared memory, which must not outlive the iterator (and a
            # device may alias a host array): the consumer gets its own copy.
            yield _plain(batch) if cfg.num_workers else batch
            del batch
    finally:
        close = getattr(iterator, "close", None)
        if close is not None:
            close()


def _check_positive(name: str, value: int) -> None:
    if value < 1:
        raise ValueError(f"{name}: got {value}, expected 1 or more")


def num_samples(cfg: DataConfig, split: str) -> int:
    """Number of samples in a split.

    Raises:
      RecordError: there is no such data set or split.
    """
    return len(_open(cfg, split))


def train_batches(
    cfg: DataConfig,
    *,
    batch_size: int,
    seed: int,
    start_step: int,
    process_index: int = 0,
    process_count: int = 1,
) -> Iterator[Batch]:
    """Endless training batches, beginning with that of `start_step`.

    Within an epoch no sample comes twice; each epoch has its own order. Augmentations are those of
    the configuration.

    Args:
      cfg: where the samples come from and what a batch holds.
      batch_size: B of the global batch.
      seed: of the order, the choice of points and the augmentations.
      start_step: first step; earlier ones are not replayed.
      process_index: which contiguous part of each global batch is yielded.
      process_count: number of parts; divides B.

    Yields:
      image uint8 [b, H, W, 3]; mask bool [b, H, W]; points float32 [b, num_points, 3]; intrinsics
      float32 [b, 3, 3]; extrinsics float32 [b, 3, 4]; depth float32 [b, H, W] if among the inputs;
      occupancy bool [b, 32, 32, 32] if `cfg.occupancy`; b = B / process_count. With
      `cfg.train_views` image and mask have an axis of v views after the first, v uniform in 1 to
      so many and the same for a whole batch; all else is of the first of them, the others are drawn
      from the other views of its model, without replacement.

    Raises:
      ValueError: an argument is out of range.
      RecordError: the data set is missing or damaged, from the call or while iterating.
    """
    _check_positive("batch_size", batch_size)
    if seed < 0 or start_step < 0:
        raise ValueError(f"seed {seed} and start_step {start_step}: expected 0 or more")
    if not 0 <= process_index < process_count:
        raise ValueError(f"process_index: got {process_index}, expected 0 to {process_count - 1}")
    if batch_size % process_count:
        raise ValueError(
            f"batch_size: got {batch_size}, expected a multiple of the {process_count} processes"
        )
    reader = _open(cfg, cfg.train_split)
    local = batch_size // process_count
    rows = range(process_index * local, (process_index + 1) * local)
    models = _models(cfg, reader, train=True)
    make = _TrainBatch(cfg, _Items(cfg, reader), len(reader), batch_size, seed, rows, models)
    return _iterate(cfg, start_step, sys.maxsize // batch_size, make)


def eval_batches(
    cfg: DataConfig,
    *,
    split: str,
    batch_size: int,
    seed: int = 0,
    visible_tolerance: float = 0.0,
) -> Iterator[Batch]:
    """Every sample of a split exactly once, in the order of the records, never augmented.

    Args:
      cfg: where the samples come from and what a batch holds.
      split: name of the split.
      batch_size: B; the last batch is padded to it with copies of the last sample.
      seed: of the choice of points.
      visible_tolerance: see `data.visibility`; 0 = visibility is not asked for.

    Yields:
      as `train_batches` with num_eval_points points, and valid bool [B] (False on padding),
      category and model_id (lists of B strings), view (list of B integers); with a
      `visible_tolerance`, if all records of the split have depth, visible bool
      [B, num_eval_points], which points their depth images show. With `cfg.eval_views` so many
      views, the others those that follow in the records, cyclically: as many as all models have.

    Raises:
      ValueError: an argument is out of range.
      RecordError: the data set is missing or damaged, from the call or while iterating.
    """
    _check_positive("batch_size", batch_size)
    reader = _open(cfg, split)
    if any("depth" not in s.fields for s in reader.shards):
        visible_tolerance = 0.0
    items = _Items(cfg, reader, visibility=bool(visible_tolerance))
    models = _models(cfg, reader, train=False)
    make = _EvalBatch(cfg, items, len(reader), batch_size, seed, visible_tolerance, models)
    return _iterate(cfg, 0, -(-len(reader) // batch_size), make)
