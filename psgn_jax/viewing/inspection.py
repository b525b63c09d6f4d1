"""Describes and checks a data set: a text report and a contact sheet."""

import collections
import pathlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image
from scipy import ndimage

from psgn_jax.data import camera, schema
from psgn_jax.data.codec import field_sizes
from psgn_jax.data.dataset import RecordReader, doubts_of, spread
from psgn_jax.data.manifest import FORMAT, VERSION, load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.viewing import spheres
from psgn_jax.viewing.page import nearest_distances

# We flag a sample if less than this fraction of its points is within `NEAR_PIXELS` pixels of the
# mask: the image does not show the whole object, or the camera is wrong. We flag 2.5 % of the
# authors' samples.
FLAG_BELOW = 0.99
NEAR_PIXELS = 2
_HIGHEST = 512  # height of the pictures on a contact sheet


class Check(NamedTuple):
    """How well image, depth and points of a sample agree; lengths in units."""

    inside: float  # fraction of the points that project into the mask
    near: float  # fraction of the points within `NEAR_PIXELS` pixels of the mask
    depth_median: float  # distance of a back-projected pixel to the nearest point; NaN: no depth
    reach: float  # largest distance of a point from the origin
    lowest: float  # smallest z of a point


def check(sample: schema.Sample) -> Check:
    """Compares a sample's points with its mask and depth."""
    pixels, depth = camera.project(sample.points, sample.intrinsics, sample.extrinsics)
    pixels = np.where(depth[:, None] > 0, pixels, np.inf)
    median = float("nan")
    if sample.depth is not None and (sample.depth > 0).any():
        surface = camera.back_project(sample.depth, sample.intrinsics, sample.extrinsics)
        some = surface[:: max(1, len(surface) // 400)]
        median = float(np.median(nearest_distances(some, sample.points)))
    return Check(
        inside=float(camera.inside_mask(pixels, sample.mask).mean()),
        near=float(camera.inside_mask(pixels, sample.mask, NEAR_PIXELS).mean()),
        depth_median=median,
        reach=float(np.linalg.norm(sample.points, axis=1).max()),
        lowest=float(sample.points[:, 2].min()),
    )


def _report_split(reader: RecordReader, num_checked: int) -> list[str]:
    """Lines about a split; lines about damage begin with `DAMAGED`."""
    shards = reader.shards
    size = sum(s.size for s in shards)
    lines = [
        f"split {reader.split}: {len(reader)} samples in {len(shards)} shards, {size / 1e6:.2f} MB"
        f" ({size / max(1, len(reader)) / 1e3:.1f} kB a sample)"
    ]
    categories = sum((collections.Counter(s.categories) for s in shards), collections.Counter())
    named = ", ".join(f"{name or '(unknown)'} {n}" for name, n in sorted(categories.items()))
    lines.append(f"  categories: {named}")
    try:
        reader.verify()
    except RecordError as error:
        lines.append(f"DAMAGED {error}")
    checks: list[Check] = []
    flagged: list[str] = []
    sizes: dict[str, list[int]] = {}
    for index in spread(len(reader), num_checked):
        try:
            data = reader.read(index)
            sample = schema.validate(reader[index])
        except ValueError as error:
            lines.append(f"DAMAGED {error}")
            continue
        for field, value in field_sizes(data).items():
            sizes.setdefault(field, []).append(value)
        checks.append(check(sample))
        if checks[-1].near < FLAG_BELOW:
            flagged.append(
                f"  flagged: record {index} ({sample.model_id} view {sample.view}): "
                f"{100 * checks[-1].near:.1f} % of its points within {NEAR_PIXELS} pixels"
            )
        if len(checks) == 1:
            optional = [f for f in schema.OPTIONAL_FIELDS if getattr(sample, f) is not None]
            lines.append(
                f"  first sample: image {list(sample.image.shape)}, points "
                f"{list(sample.points.shape)}, optional fields {optional or 'none'}"
            )
    if checks:
        means = (f"{field} {np.mean(values):.0f}" for field, values in sizes.items())
        lines += [f"  bytes of a record, mean: {', '.join(means)}", *_summary(checks)]
    return lines + flagged


def _summary(checks: Sequence[Check]) -> list[str]:
    inside, near, depth, reach, lowest = np.array(checks).T
    lines = [
        f"  {len(checks)} samples checked: points strictly inside the mask {inside.mean():.2%}"
        f" on average (lowest {inside.min():.2%}); {(near >= FLAG_BELOW).sum()} samples have"
        f" at least {FLAG_BELOW:.0%} of their points within {NEAR_PIXELS} pixels"
    ]
    if not np.isnan(depth).all():
        lines.append(
            f"  depth to the cloud: median {np.nanmedian(depth):.4f} of the samples' medians,"
            f" largest {np.nanmax(depth):.4f} (unit: radius of the bounding hemisphere)"
        )
    lines.append(
        f"  farthest point {reach.min():.3f} to {reach.max():.3f} from the origin, lowest z"
        f" {lowest.min():.3f} to {lowest.max():.3f}"
    )
    return lines


def report(path: str | pathlib.Path, num_checked: int = 256) -> tuple[list[str], bool]:
    """Describes and checks a data set: lines of text, and whether there is nothing to complain.

    Raises:
      RecordError: there is no readable manifest.
    """
    manifest = load_manifest(path)
    lines = [
        f"{path}: {FORMAT} version {VERSION}, source {manifest.source!r}",
        f"fields of every sample: {', '.join(manifest.fields())}",
    ]
    readers = {}
    for split in manifest.splits():
        try:
            readers[split] = RecordReader(path, split)
            lines += _report_split(readers[split], num_checked)
        except RecordError as error:
            lines.append(f"DAMAGED {error}")
    whole = not any(line.startswith("DAMAGED") for line in lines)
    if whole:
        doubts = doubts_of(readers, most=1_000_000, compared=num_checked)
        lines += [f"DOUBTFUL {line}" for line in doubts]
        whole = not doubts
    return lines, whole


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
            checked = check(sample)
            label = (
                f"{split} {index}  {sample.category}  {sample.model_id[:16]}  "
                f"{checked.inside:.1%} inside, {checked.near:.1%} within {NEAR_PIXELS} px"
            )
            rows.append((label, _pictures(sample, height)))
    if not rows:
        raise RecordError(f"data set {str(path)!r}: no readable sample")
    return spheres.sheet(rows, columns=2)


def _pictures(sample: schema.Sample, height: int) -> dict[str, np.ndarray]:
    points = sample.points[:: max(1, len(sample.points) // 2048)]
    clouds = spheres.by_height({"": points})
    image, front, side = spheres.panels(vars(sample), clouds, (0, 120), height=height).values()
    small = Image.fromarray(sample.mask).resize(front.shape[1::-1], Image.Resampling.NEAREST)
    mask, front = np.asarray(small), front.copy()
    front[mask & ~ndimage.binary_erosion(mask, border_value=1)] = (230, 40, 40)
    return {"image": image, " ": front, "": side}  # the label takes the place of titles
