"""Describes and checks a data set: a text report and a contact sheet."""

import collections
import pathlib

import msgpack
import numpy as np
from PIL import Image
from scipy import ndimage

from psgn_jax.data import schema
from psgn_jax.data.dataset import RecordReader, spread
from psgn_jax.data.doubts import FLAG_BELOW, Doubts, fit
from psgn_jax.data.manifest import FORMAT, VERSION, load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.viewing import spheres

MOST_FLAGGED = 8
"""More samples that do not fit their masks are counted."""

_HIGHEST = 512  # height of the pictures on a contact sheet


def _report_split(reader: RecordReader, num_checked: int, doubts: Doubts) -> list[str]:
    """Lines about a split; lines about damage begin with `DAMAGED`. Adds records to `doubts`."""
    shards = reader.shards
    size = sum(s.size for s in shards)
    lines = [
        f"split {reader.split}: {len(reader)} samples in {len(shards)} shards, {size / 1e6:.2f} MB"
        f" ({size / len(reader) / 1e3:.1f} kB a sample)"
    ]
    categories = sum((collections.Counter(s.categories) for s in shards), collections.Counter())
    named = ", ".join(f"{name or '(unknown)'} {n}" for name, n in sorted(categories.items()))
    lines.append(f"  categories: {named}")
    try:
        reader.verify()
    except RecordError as error:
        lines.append(f"DAMAGED {error}")
    fits: list[float] = []
    flagged: list[str] = []
    sizes: dict[str, list[int]] = {}
    chosen = set(spread(len(reader), num_checked))
    for index in range(len(reader)):
        try:
            sample = schema.validate(reader[index]) if index in chosen else None
            doubts.add(reader.split, stored := reader.unpacked(index), sample)
        except ValueError as error:
            lines.append(f"DAMAGED {error}")
            continue
        if sample is None:
            continue
        for field, value in stored.items():
            sizes.setdefault(field, []).append(len(msgpack.packb(value)))
        fits.append(fit(sample))
        if fits[-1] < FLAG_BELOW:
            flagged.append(
                f"  flagged: record {index} ({sample.model_id} view {sample.view}): fit "
                f"{fits[-1]:.2f}"
            )
        if len(fits) == 1:
            optional = [f for f in schema.OPTIONAL_FIELDS if getattr(sample, f) is not None]
            lines.append(
                f"  first sample: image {list(sample.image.shape)}, points "
                f"{list(sample.points.shape)}, optional fields {optional or 'none'}"
            )
    if fits:
        means = (f"{field} {np.mean(values):.0f}" for field, values in sizes.items())
        lines.append(f"  bytes of a record, mean: {', '.join(means)}")
        lines.append(
            f"  {len(fits)} samples checked: fit of points and mask {np.mean(fits):.3f} on average,"
            f" lowest {min(fits):.3f}"
        )
    if len(flagged) > MOST_FLAGGED:
        flagged[MOST_FLAGGED:] = [f"  flagged: {len(flagged) - MOST_FLAGGED} more records"]
    return lines + flagged


def report(path: str | pathlib.Path, num_checked: int = 256) -> tuple[list[str], bool]:
    """Describes and checks a data set: lines of text, and whether none is `DAMAGED` or `DOUBTFUL`.

    Raises:
      RecordError: there is no readable manifest.
    """
    manifest = load_manifest(path)
    lines = [
        f"{path}: {FORMAT} version {VERSION}, source {manifest.source!r}",
        f"fields of every sample: {', '.join(manifest.fields())}",
    ]
    doubts = Doubts()
    for split in manifest.splits():
        try:
            lines += _report_split(RecordReader(path, split), num_checked, doubts)
        except RecordError as error:
            lines.append(f"DAMAGED {error}")
    lines += [f"DOUBTFUL {line}" for line in doubts.lines()]
    return lines, not any(line.startswith(("DAMAGED", "DOUBTFUL")) for line in lines)


def make_sheet(path: str | pathlib.Path, num_samples: int = 12) -> Image.Image:
    """A contact sheet of undamaged samples.

    Each has three pictures, as high as the first image but at most 512 pixels: the image, its cloud
    with the outline of the mask, and the cloud from another side. If there are other splits, we
    leave out a test split, because nothing should be chosen by looking at it.
    """
    rows: list[tuple[str, dict[str, np.ndarray]]] = []
    every = load_manifest(path).splits()
    splits = [name for name in every if name != "test"] or list(every)
    height = 0
    for split in splits:
        try:
            reader = RecordReader(path, split)
        except RecordError:  # a shard is missing; `report` names it
            continue
        for index in spread(len(reader), -(-num_samples // len(splits))):
            try:
                sample = reader[index]
            except RecordError:
                continue
            height = height or min(len(sample.image), _HIGHEST)
            named = f"{sample.category}  {sample.model_id[:16]}"
            label = f"{split} {index}  {named}  fit {fit(sample):.2f}"
            rows.append((label, _pictures(sample, height)))
    if not rows:
        raise RecordError(f"data set {str(path)!r}: no readable sample")
    return spheres.sheet(rows, columns=2)


def _pictures(sample: schema.Sample, height: int) -> dict[str, np.ndarray]:
    clouds = spheres.by_height({"": sample.points[:: max(1, len(sample.points) // 2048)]})
    image, front, side = spheres.panels(vars(sample), clouds, (0, 120), height=height).values()
    small = Image.fromarray(sample.mask).resize(front.shape[1::-1], Image.Resampling.NEAREST)
    mask, front = np.asarray(small), front.copy()
    front[mask & ~ndimage.binary_erosion(mask, border_value=1)] = (230, 40, 40)
    return {"image": image, " ": front, "": side}  # the label takes the place of titles
