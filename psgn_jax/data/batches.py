"""Makes a batch from records: decodes, resizes and augments them, and chooses their points.

Row j of the batch of step s is a function of (records, configuration, batch size, seed, s, j) only.
"""

import copy
import dataclasses
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from psgn_jax.config import DataConfig
from psgn_jax.data import augment, camera, photo_effects, resize, schema, visibility
from psgn_jax.data.codec import DepthCodes, PointLattice
from psgn_jax.data.dataset import JoinedReader, RecordReader
from psgn_jax.data.schema import RecordError

Batch = dict[str, Any]

# Each purpose of random numbers has its own stream.
ORDER, _TRAIN, _EVAL, _VIEWS, _PHOTO = 0, 1, 2, 3, 4

CACHE_BYTES = 4 << 30
"""Largest memory that `DataConfig.cache` uses, over all workers of one process. The cache contains
decoded and resized samples with points in their compact form: about 100 kB for a sample of the
authors' data at half size, 250 kB at full size. Samples that do not fit are decoded at each use.
"""


@dataclasses.dataclass(frozen=True, eq=False)
class Item:
    """One record, decoded and resized. It does not depend on the training step."""

    image: np.ndarray
    mask: np.ndarray
    depth: np.ndarray | None
    points: PointLattice
    occupancy: np.ndarray | None
    intrinsics: np.ndarray
    extrinsics: np.ndarray
    category: str
    model_id: str
    view: int
    # Depth at the record's own size and the intrinsics that go with it, for visibility.
    measured: tuple[DepthCodes, np.ndarray] | None

    def nbytes(self) -> int:
        """Size of the arrays."""
        arrays = [self.image, self.mask, self.depth, self.points.codes, self.occupancy]
        if self.measured:
            arrays += [self.measured[0].codes, self.measured[0].valid]
        return sum(a.nbytes for a in arrays if a is not None)


class Items:
    """Maps a record number to its `Item`.

    With `cache`, it keeps items up to `CACHE_BYTES`. If the items are used `repeatedly`, it also
    keeps them without `cache`, provided that all of them fit in `cache_gb`, judged by the size of
    the first one. Of a larger split it keeps nothing, because few items would be used again soon.
    Records of a folder that is listed several times are kept once.
    """

    def __init__(
        self,
        cfg: DataConfig,
        reader: RecordReader | JoinedReader,
        *,
        visibility: bool = False,
        repeatedly: bool = False,
    ) -> None:
        self._reader = reader
        self._size = cfg.image_size[0], cfg.image_size[1]
        self._fields = ["image", "mask", "points"]
        self._depth, self._visibility = "depth" in cfg.inputs, visibility
        if self._depth or self._visibility:
            self._fields.append("depth")
        if cfg.occupancy:
            self._fields.append("occupancy")
        shares = max(1, cfg.num_workers)
        self._bound = CACHE_BYTES // shares if cfg.cache else 0
        keeps_all = repeatedly and not cfg.cache
        self._bound_of_all = int(1e9 * cfg.cache_gb) // shares if keeps_all else 0
        self.__setstate__({})

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k not in ("_kept", "_held", "_lock")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._kept: dict[int, Item] = {}
        self._held = 0
        self._lock = threading.Lock()

    def __getitem__(self, index: int) -> Item:
        number = self._reader.original(index)
        item = self._kept.get(number)
        if item is None:
            item = self._decode(number)
            with self._lock:
                if self._bound_of_all:
                    if item.nbytes() * self._reader.num_distinct <= self._bound_of_all:
                        self._bound = self._bound_of_all
                    self._bound_of_all = 0
                if self._held + item.nbytes() <= self._bound and number not in self._kept:
                    self._kept[number] = item
                    self._held += item.nbytes()
        return item

    def _decode(self, index: int) -> Item:
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
        return Item(
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

    def _lacks(self, index: int, what: str) -> RecordError:
        path, position = self._reader.locate(index)
        return RecordError(f"record {position} of {path} has no {what}")


def _subset(rng: np.random.Generator, available: int, wanted: int) -> np.ndarray | slice:
    """Random indices without replacement; if there are too few, all occur equally often (+-1)."""
    if wanted == available:
        return slice(None)
    whole, rest = divmod(wanted, available)
    # The order of a cloud's points has no meaning, so the choice need not be shuffled.
    part = rng.choice(available, rest, replace=False, shuffle=False)
    return np.concatenate([np.tile(np.arange(available), whole), part]) if whole else part


class Models:
    """Finds, for each record of a split, the other records of the same model.

    The manifest does not name models. Therefore every record is read once, which takes one or two
    milliseconds each.
    """

    def __init__(self, reader: RecordReader | JoinedReader, wanted: int, name: str) -> None:
        members: dict[tuple[str, ...], list[int]] = {}
        for index in range(len(reader)):
            stored = reader.stored(index, ())
            folder = str(reader.locate(index)[0].parent)
            members.setdefault((folder, stored.category, stored.model_id), []).append(index)
        for (folder, _, model), views in members.items():
            if len(views) < wanted:
                raise RecordError(
                    f"data set {folder!r}: model {model!r} has {len(views)} views, expected at "
                    f"least {wanted}, as set by {name}"
                )
        self._views = {view: views for views in members.values() for view in views}

    def others(self, index: int) -> list[int]:
        """The other views of the model of record `index`, beginning with those after it."""
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


def _view(item: Item, rng: np.random.Generator, num_points: int) -> augment.View:
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


def _further_view(item: Item) -> augment.View:
    """A further view of a model. Only its image and mask are used in a batch."""
    nothing = np.zeros((0, 3), np.float32)
    return augment.View(
        item.image, item.mask, None, nothing, item.intrinsics, item.extrinsics, None
    )


def _as_a_photo(cfg: DataConfig, view: augment.View, seeds: Sequence[int]) -> augment.View:
    """A training sample with those effects and framings of photos that are enabled."""
    framed = cfg.place or cfg.reframe_scale or cfg.reframe_shift
    if not framed and not cfg.photo.any():
        return view
    rng = np.random.default_rng(seeds)
    framing_rng, effects_rng = rng.spawn(2)
    if cfg.photo.any():
        image, mask = photo_effects.disturb(view.image, view.mask, effects_rng, cfg.photo)
        depth = None if view.depth is None else np.where(mask, view.depth, np.float32(0))
        view = dataclasses.replace(view, image=image, mask=mask, depth=depth)
    if framed:
        # The framing rule uses the disturbed mask: in a prediction, masks are imperfect too.
        view = augment.reframe(
            view,
            framing_rng,
            place_share=cfg.place,
            scale_deviation=cfg.reframe_scale,
            shift_deviation=cfg.reframe_shift,
        )
    return view


def _fill(batch: Batch, row: int, view: augment.View, further: list[augment.View]) -> None:
    for key in ("image", "mask", "depth", "points", "intrinsics", "extrinsics", "occupancy"):
        if key not in batch:
            continue
        if key in ("image", "mask") and batch["mask"].ndim == 4:
            for number, one in enumerate([view, *further]):
                batch[key][row, number] = getattr(one, key)
        else:
            batch[key][row] = getattr(view, key)


@dataclasses.dataclass(frozen=True, eq=False)
class TrainBatch:
    """Maps a step number to this process's rows of the batch.

    Row j of step s is record `order[s * batch_size + j]`.
    """

    cfg: DataConfig
    items: Items
    order: Sequence[int]
    batch_size: int
    seed: int
    rows: range
    models: Models | None

    def __call__(self, step: int) -> Batch:
        """The rows of one step."""
        cfg = self.cfg
        num_views = 0
        if self.models:
            # One number for the whole batch, so it must be the same in all processes.
            rng = np.random.default_rng([self.seed, _VIEWS, step])
            num_views = int(rng.integers(1, cfg.train_views + 1))
        batch = _empty_batch(cfg, len(self.rows), cfg.num_points, num_views)
        for local, row in enumerate(self.rows):
            rng = np.random.default_rng([self.seed, _TRAIN, step, row])
            index = int(self.order[step * self.batch_size + row])
            views = [_view(self.items[index], rng, cfg.num_points)]
            if self.models and num_views > 1:
                chosen = rng.permutation(self.models.others(index))[: num_views - 1]
                views += [_further_view(self.items[int(i)]) for i in chosen]
            # All views of a model get the same random numbers, so that all or none are mirrored.
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
            # A separate stream, so that these settings do not change the random numbers above.
            seeds = [self.seed, _PHOTO, step, row]
            first = _as_a_photo(cfg, first, seeds)
            further = [_as_a_photo(cfg, view, seeds) for view in further]
            _fill(batch, local, first, further)
        return batch


@dataclasses.dataclass(frozen=True, eq=False)
class EvalBatch:
    """Maps a batch number to the batch of an evaluation.

    The last batch is padded with copies of the last sample.
    """

    cfg: DataConfig
    items: Items
    count: int
    batch_size: int
    seed: int
    visible_tolerance: float
    models: Models | None

    def __call__(self, number: int) -> Batch:
        """The batch of that number."""
        cfg = self.cfg
        start = number * self.batch_size
        filled = min(self.batch_size, self.count - start)
        batch = _empty_batch(cfg, self.batch_size, cfg.num_eval_points, cfg.eval_views)
        if self.visible_tolerance:
            batch["visible"] = np.empty((self.batch_size, cfg.num_eval_points), np.bool_)
        items = []
        for row in range(filled):
            rng = np.random.default_rng([self.seed, _EVAL, start + row])
            item = self.items[start + row]
            others = self.models.others(start + row) if self.models else []
            further = [_further_view(self.items[i]) for i in others[: cfg.eval_views - 1]]
            view = _view(item, rng, cfg.num_eval_points)
            if item.measured:
                # Visibility is computed before the move, which does not change it.
                codes, intrinsics = item.measured
                batch["visible"][row] = visibility.visible_points(
                    view.points,
                    codes.depth(),
                    intrinsics,
                    item.extrinsics,
                    self.visible_tolerance,
                )
            if cfg.eval_frame == "place":
                view = augment.place(view)
            _fill(batch, row, view, further)
            items.append(item)
        for values in batch.values():
            values[filled:] = values[filled - 1]
        batch["valid"] = np.arange(self.batch_size) < filled
        items += items[-1:] * (self.batch_size - filled)
        for key in ("category", "model_id", "view"):
            batch[key] = [getattr(item, key) for item in items]
        return batch
