"""Makes batches from records: decodes, resizes and augments samples, and draws their points.

Row j of step s depends only on the records, the configuration, the batch size, the seed, s and j.
"""

import copy
import dataclasses
import threading
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from psgn_jax.config.data import DataConfig
from psgn_jax.data import augment, camera, framing, resample, schema, visibility
from psgn_jax.data.augment import View
from psgn_jax.data.codec import DepthCodes, QuantisedPoints
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.schema import RecordError

Batch = dict[str, Any]
# Record number -> the number of its first copy (a folder may count N times), and the numbers of all
# views of its model.
ModelViews = dict[int, tuple[int, list[int]]]

# Streams of random numbers, one for each purpose.
ORDER, _TRAIN, _EVAL, _VIEWS, _PHOTO = 0, 1, 2, 3, 4

_LOCK = threading.Lock()  # for the kept samples; global, because a lock cannot be pickled


@dataclasses.dataclass(frozen=True, eq=False)
class Item:
    """One record, decoded and resized, independent of the training step."""

    view: View  # without points
    points: QuantisedPoints  # all points of the record
    labels: dict[str, Any]  # category, model_id and view
    # Depth at its original size, and the intrinsics for that size, to compute visibility.
    measured: tuple[DepthCodes, np.ndarray] | None

    def nbytes(self) -> int:
        arrays = [self.view.image, self.view.mask, self.view.depth, self.view.occupancy]
        arrays += [self.measured[0].codes, self.measured[0].valid] if self.measured else []
        return self.points.codes.nbytes + sum(a.nbytes for a in arrays if a is not None)

    def view_with_points(self, rng: np.random.Generator, wanted: int) -> View:
        """The view with random points: distinct, or if too few, each equally often (+-1)."""
        available = len(self.points.codes)
        index: np.ndarray | slice = slice(None)
        if wanted != available:
            whole, rest = divmod(wanted, available)
            # The order of points has no meaning, so the choice need not be shuffled.
            index = rng.choice(available, rest, replace=False, shuffle=False)
            if whole:
                index = np.concatenate([np.tile(np.arange(available), whole), index])
        return dataclasses.replace(self.view, points=self.points.points(index))


def _further_view(item: Item) -> View:
    """The view without the fields that a batch has for the first view of a model only."""
    return dataclasses.replace(item.view, depth=None, occupancy=None)


class Items:
    """Maps a record number to its `Item`; keeps up to `cache_gb` of them if used `repeatedly`."""

    def __init__(
        self, cfg: DataConfig, reader: RecordReader, *, visibility: bool = False,
        repeatedly: bool = False,
    ) -> None:  # fmt: skip
        self._reader = reader
        self._size = cfg.image_size[0], cfg.image_size[1]
        self._depth, self._visibility = "depth" in cfg.inputs, visibility
        self._fields = ["image", "mask", "points"]
        self._fields += ["depth"] if self._depth or visibility else []
        self._fields += ["occupancy"] if cfg.occupancy else []
        self._bound = 1e9 * cfg.cache_gb / max(1, cfg.num_workers) if repeatedly else 0
        self._kept: dict[Any, Item] = {}
        self._held = 0

    def __getitem__(self, index: int) -> Item:
        key = self._reader.locate(index)
        item = self._kept.get(key)
        if item is None:
            item = self._decode(index)
            with _LOCK:
                if self._held + item.nbytes() <= self._bound and key not in self._kept:
                    self._kept[key] = item
                    self._held += item.nbytes()
        return item

    def _decode(self, index: int) -> Item:
        stored = self._reader.stored(index, self._fields)
        for field in self._fields:
            if getattr(stored, field) is None:
                path, position = self._reader.locate(index)
                raise RecordError(f"record {position} of {path} has no {field}")
        around, depth = framing.padding(stored.image.shape[:2], self._size), stored.depth
        image = _padded(stored.image, around, schema.BACKGROUND_GREY)
        mask = resample.resize_mask(_padded(stored.mask, around), self._size)
        measured = _padded(depth.depth(), around) if depth and self._depth else None
        (above, _), (left, _) = around
        moved = stored.intrinsics + np.array([[0, 0, left], [0, 0, above], [0, 0, 0]], np.float32)
        view = View(
            image=resample.resize_image(image, self._size),
            mask=mask,
            depth=None if measured is None else resample.resize_depth(measured, mask),
            points=np.zeros((0, 3), np.float32),
            intrinsics=camera.scale_intrinsics(moved, image.shape[:2], self._size),
            extrinsics=stored.extrinsics,
            occupancy=stored.occupancy,
        )
        labels = {name: getattr(stored, name) for name in ("category", "model_id", "view")}
        seen = (depth, stored.intrinsics) if depth and self._visibility else None
        return Item(view, stored.points, labels, seen)


def _padded(plane: np.ndarray, around: Sequence[tuple[int, int]], value: int = 0) -> np.ndarray:
    if not any(map(any, around)):
        return plane
    return np.pad(plane, (*around, (0, 0))[: plane.ndim], constant_values=value)


def model_views(reader: RecordReader, wanted: int, name: str) -> ModelViews:
    """The `ModelViews` of all records; reads every record once."""
    members: dict[tuple[str, ...], list[int]] = {}
    first: dict[Any, int] = {}
    firsts = [first.setdefault(reader.locate(index), index) for index in range(len(reader))]
    for index in first.values():
        stored = reader.stored(index, ())
        folder = str(reader.locate(index)[0].parent)
        members.setdefault((folder, stored.category, stored.model_id), []).append(index)
    for (folder, _, model), views in members.items():
        if len(views) < wanted:
            raise RecordError(
                f"data set {folder!r}: model {model!r} has {len(views)} views, expected at least "
                f"{wanted}, as set by {name}"
            )
    views_of = {index: views for views in members.values() for index in views}
    return {number: (index, views_of[index]) for number, index in enumerate(firsts)}


def _after(index: int, views: list[int]) -> list[int]:
    """The other views in cyclic order, beginning after `index`."""
    at = views.index(index)
    return views[at + 1 :] + views[:at]


def _stack(rows: Iterable[Sequence[View]], count: int, *, several: bool) -> Batch:
    """A batch from the views of each row; if `several`, image and mask have an axis of views.

    Each row is copied when it is made, while it is in the processor's cache.
    """
    batch: Batch = {}
    for number, views in enumerate(rows):
        for field, value in vars(views[0]).items():
            if value is None:
                continue
            if several and field in ("image", "mask"):
                value = np.stack([getattr(view, field) for view in views])
            if field not in batch:
                batch[field] = np.empty((count, *value.shape), value.dtype)
            batch[field][number] = value
    return batch


@dataclasses.dataclass(frozen=True, eq=False)
class TrainBatch:
    """Maps a step s to this process's rows; row j is record `order[s * batch_size + j]`."""

    cfg: DataConfig
    items: Items
    order: Sequence[int]
    batch_size: int
    seed: int
    rows: range
    model_views: ModelViews | None

    def __call__(self, step: int) -> Batch:
        cfg = self.cfg
        num_views = 0
        if self.model_views:
            # The number of views is the same in all rows and processes.
            rng = np.random.default_rng([self.seed, _VIEWS, step])
            num_views = int(rng.integers(1, cfg.train_views + 1))
        rows = (self._views(step, row, num_views) for row in self.rows)
        return _stack(rows, len(self.rows), several=num_views > 0)

    def _views(self, step: int, row: int, num_views: int) -> list[View]:
        cfg = self.cfg
        rng = np.random.default_rng([self.seed, _TRAIN, step, row])
        index = int(self.order[step * self.batch_size + row])
        views = [self.items[index].view_with_points(rng, cfg.num_points)]
        if self.model_views and num_views > 1:
            chosen = rng.permutation(_after(*self.model_views[index]))[: num_views - 1]
            views += [_further_view(self.items[int(i)]) for i in chosen]
        # All views of a model get the same random numbers: all or none are mirrored.
        seeds = [self.seed, _PHOTO, step, row]
        return [augment.augment(view, cfg, copy.deepcopy(rng), seeds) for view in views]


@dataclasses.dataclass(frozen=True, eq=False)
class EvalBatch:
    """Maps a number to an evaluation batch; the last batch is padded with its last sample."""

    cfg: DataConfig
    items: Items
    count: int
    batch_size: int
    seed: int
    visible_tolerance: float
    model_views: ModelViews | None

    def __call__(self, number: int) -> Batch:
        cfg = self.cfg
        numbers = np.arange(number * self.batch_size, (number + 1) * self.batch_size)
        rows: list[Any] = []
        visible: list[Any] = []
        items: list[Any] = []
        for index in numbers[numbers < self.count].tolist():
            rng = np.random.default_rng([self.seed, _EVAL, index])
            item = self.items[index]
            others = _after(*self.model_views[index]) if self.model_views else []
            others = others[: cfg.eval_views - 1]
            view = item.view_with_points(rng, cfg.num_eval_points)
            if item.measured:
                # Computed before the move, which does not change visibility.
                depth, intrinsics = item.measured
                seen = view.points, depth.depth(), intrinsics, view.extrinsics
                visible.append(visibility.visible_points(*seen, self.visible_tolerance))
            if cfg.eval_frame == "place":
                view = augment.place(view)
            rows.append([view, *(_further_view(self.items[i]) for i in others)])
            items.append(item)
        for values in (rows, visible, items):
            values += values[-1:] * (self.batch_size - len(values))
        batch = _stack(rows, self.batch_size, several=self.model_views is not None)
        if visible:
            batch["visible"] = np.stack(visible)
        batch["valid"] = numbers < self.count
        return batch | {key: [item.labels[key] for item in items] for key in items[0].labels}
