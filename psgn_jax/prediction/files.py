"""Predicts clouds for image files and writes the results as files.

For each image, the files are: the cloud as PLY, XYZ, OBJ and NPZ (`prediction.export` describes
frame and colours); the framed view of the object as `NAME_view.png`; and `NAME.json` with camera,
configuration, checkpoint and times. The NPZ file also contains the spread of each point over the
samples and the mutual distances of the clouds.
"""

import dataclasses
import io
import json
import os
import pathlib
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from absl import logging
from PIL import Image

from psgn_jax.config.experiment import ConfigError, to_dict
from psgn_jax.data import photo
from psgn_jax.prediction import export
from psgn_jax.prediction.predictor import FC, Clock, Prediction, Predictor
from psgn_jax.system.errors import UserError
from psgn_jax.system.files import is_disk_full, write_atomic

_LONGEST_NAME = 220
"""File names have up to 255 bytes; results add a suffix, temporary files the process as well."""


def predict_files(
    open_predictor: Callable[[], Predictor],
    images: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    mask: str | None = None,
    **options: Any,
) -> Iterator[tuple[pathlib.Path, Prediction | Exception]]:
    """Predicts clouds for files and folders of images, one by one, and writes them to `out`.

    Args:
      open_predictor: returns the network. It is called once, when the first image and its mask
        have been read, so that wrong files are reported before a network is compiled.
      mask: file of the mask (for one image), or folder of masks. There the mask of `NAME.jpg` is
        `NAME_mask.*`, or another file `NAME.*`.
      **options: arguments of `predict_photo`.

    Yields:
      The path of each image, with its prediction or the error.
    """
    paths = _expand(images)
    if not paths:
        raise ConfigError(f"no image in {', '.join(map(str, images)) or 'the arguments'}")
    if mask is not None and not os.path.isdir(mask) and len(paths) > 1:
        raise ConfigError(f"--mask={mask}: accepted for {len(paths)} images: a folder of masks")
    predictor: Predictor | None = None
    for path, name in zip(paths, _names(paths), strict=True):
        try:
            if len(os.fsencode(name)) > _LONGEST_NAME:
                raise ConfigError(
                    f"the name has {len(os.fsencode(name))} bytes; accepted for the names of the "
                    f"results: up to {_LONGEST_NAME}; rename the image"
                )
            clock = Clock()
            read = photo.read_photo(path)
            given = None
            if mask is not None:
                mask_path = _mask_of(path, mask)
                given = photo.read_mask(mask_path, read)
                logging.info("%s: mask %s", path, mask_path)
            clock.lap("read")
            options["seconds"] = clock.laps
        except Exception as error:
            yield path, _continued(path, error)
            continue
        predictor = predictor or open_predictor()
        try:
            result = predict_photo(predictor, read, given, path, name, pathlib.Path(out), **options)
        except Exception as error:
            yield path, _continued(path, error)
        else:
            yield path, result


def _continued(path: pathlib.Path, error: Exception) -> Exception:
    """The error of one image, after which the others are processed; a full disk is raised."""
    if is_disk_full(error):
        raise error
    if not isinstance(error, UserError | ValueError | OSError):
        logging.error("%s", path, exc_info=error)
    return error


def predict_photo(
    predictor: Predictor,
    read: photo.Photo,
    mask: np.ndarray | None,
    path: pathlib.Path,
    name: str,
    out: pathlib.Path,
    formats: tuple[str, ...] = export.DEFAULT_FORMATS,
    *,
    seconds: Mapping[str, float] = types.MappingProxyType({}),
    **options: Any,
) -> Prediction:
    """Predicts clouds for a photo and writes the results to `out`.

    Args:
      mask: bool [h, w] of the size of `read.image`, True on the object; None = automatic.
      name: NAME of the results.
      seconds: times of earlier steps, for `NAME.json`.
    """
    result = predictor(read, mask, **options)
    clock = Clock()
    view = result.view
    arrays = {n: getattr(result, n) for n in ("stray", "seen", "branch", "spread", "mutual")}
    arrays |= {n: getattr(view, n) for n in ("image", "mask", "intrinsics", "extrinsics")}
    files = export.write_clouds(
        out, name, result.points, result.colours, formats, drawn=~result.stray, **arrays
    )
    picture = io.BytesIO()
    Image.fromarray(view.image).save(picture, "png", compress_level=1)
    files.append(out / f"{name}_view.png")
    write_atomic(files[-1], picture.getvalue(), sync=False)
    clock.lap("write")
    seconds = {**seconds, **result.seconds, "write": clock.laps["write"]}
    document = _record(predictor, read, result, path, files, seconds, options.get("seed", 0))
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    write_atomic(out / f"{name}.json", text, sync=False)
    return dataclasses.replace(result, seconds=seconds)


def _record(
    predictor: Predictor,
    read: photo.Photo,
    result: Prediction,
    path: pathlib.Path,
    files: Sequence[pathlib.Path],
    seconds: Mapping[str, float],
    seed: int,
) -> dict[str, Any]:
    """The contents of `NAME.json`."""
    view = result.view
    return {
        "image": str(path),
        "image_size": list(read.size),
        "files": [file.name for file in files],
        "frame": "right-handed, +z up, +y image right, +x toward the camera, origin on the ground",
        "unit": "radius of the object's bounding hemisphere",
        "mask_from": result.mask_from,
        "placed": view.placed,
        "warnings": list(result.warnings),
        "normal_form": {
            "applied": result.normalised,
            "meaning": "lowest point at z = 0, farthest at distance 1 from the origin; the "
            "network's points are scale * points + shift",
            "scale": result.scale,
            "shift": result.shift.tolist(),
        },
        "num_samples": len(result.points),
        "num_points": result.points.shape[1],
        "num_strays": int(result.stray.sum()),
        "num_fc_points": int((result.branch == FC).sum()),
        "seed": seed,
        "seen_fraction": round(float(result.seen.mean()), 4),
        "camera": {
            "conventions": "x right, y down, z forward; (0, 0) is the outer corner of a pixel",
            "extrinsics": view.extrinsics.tolist(),
            "view_size": list(view.mask.shape),
            "intrinsics": view.intrinsics.tolist(),
            "image_intrinsics": result.photo_intrinsics.tolist(),
        },
        "checkpoint": {
            predictor.source_kind: predictor.source,
            "step": predictor.step,
            "sha256": predictor.checksum,
        },
        "seconds": {part: round(value, 4) for part, value in seconds.items()},
        "config": to_dict(predictor.config),
    }


def _expand(images: Sequence[str | os.PathLike[str]]) -> list[pathlib.Path]:
    """The files, and the images in the folders, without repetition and without their masks."""
    paths: list[pathlib.Path] = []
    for image in map(pathlib.Path, images):
        if not image.is_dir():
            paths.append(image)
            continue
        inside = sorted(p for p in image.iterdir() if p.suffix.lower() in photo.SUFFIXES)
        masks = {f"{p.stem}_mask" for p in inside}
        paths += [p for p in inside if p.is_file() and p.name[0] != "." and p.stem not in masks]
    return list(dict.fromkeys(paths))


def _names(paths: Sequence[pathlib.Path]) -> list[str]:
    """A name for the results of each image; unique even if case is ignored."""
    taken: set[str] = set()
    names = []
    for path in paths:
        name, number = path.stem or "image", 1
        while name.lower() in taken:
            number += 1
            name = f"{path.stem}-{number}"
        taken.add(name.lower())
        names.append(name)
    return names


def _mask_of(path: pathlib.Path, mask: str) -> pathlib.Path:
    """The mask of an image: the file itself, or `NAME_mask.*` or another `NAME.*` in the folder."""
    folder = pathlib.Path(mask)
    if not folder.is_dir():
        return folder
    inside = [p for p in sorted(folder.iterdir()) if p.is_file() and not p.samefile(path)]
    for stem in (f"{path.stem}_mask", path.stem):
        if found := [p for p in inside if p.stem == stem]:
            return found[0]
    raise photo.PhotoError(
        f"--mask={mask}: expected a file named {path.stem}_mask.* or {path.stem}.* there, besides "
        "the image itself"
    )
