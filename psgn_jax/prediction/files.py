"""Predicts clouds for image files and writes the results as files.

For each image NAME.*, these are the cloud as PLY, XYZ, OBJ and NPZ (`prediction.formats`); the view
that the network saw, `NAME_input.png`; and `NAME.json` with camera, configuration, checkpoint and
times. If the mask is not certain, there are also the found mask, `NAME_mask.png`, and the photo in
blue outside it, `NAME_overlay.png`; if it is not used, there are only these two. With surfaces,
`NAME_surface.glb` (`prediction.surface`).
"""

import contextlib
import dataclasses
import json
import os
import pathlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from absl import logging
from PIL import Image, ImageOps

from psgn_jax.config.experiment import ConfigError, to_dict
from psgn_jax.data import photo, resample
from psgn_jax.prediction import masks
from psgn_jax.prediction.cloud import FC, Prediction
from psgn_jax.prediction.formats import DEFAULT_FORMATS, FORMATS, VERSION
from psgn_jax.prediction.photo_files import images_named, is_result, result_png
from psgn_jax.prediction.predictor import Clock, Predictor
from psgn_jax.prediction.surface import SurfaceError, glb
from psgn_jax.system.errors import exit_code_of, is_disk_full
from psgn_jax.system.files import local_path, same_name, write_atomic
from psgn_jax.system.untrusted import read_json

SURFACE = "surface"
_PROPOSAL = ("overlay", "mask")
_FORMAT = "psgn_jax prediction"


def predict_files(
    open_predictor: Callable[[], Predictor],
    images: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    mask: str | None = None,
    mask_options: masks.MaskOptions | None = None,
    formats: Sequence[str] = DEFAULT_FORMATS,
    surface: bool = False,
    height: float | None = None,
    **options: Any,
) -> Iterator[tuple[pathlib.Path, Prediction | Exception]]:
    """Predicts clouds for files and folders of images, one by one, and writes them to `out`.

    In a folder, we leave out masks, HEIC files with a converted copy, and the results of earlier
    runs. We overwrite only files that a `NAME.json` of the same photo lists, and its proposals of
    masks; otherwise we number the new ones. `earlier_files` in it are results of runs before, with
    other formats or another number of samples.

    Args:
      open_predictor: returns the network; called after the first image and its mask were read or
        found, so that wrong files are reported before a network is compiled. Its errors end the
        iteration.
      mask: file of the mask (for one image), or folder of masks: of `NAME.jpg`, an image
        `NAME_mask.*` or another `NAME.*`. None = automatic (`masks.find_mask`).
      mask_options: how masks are found or read.
      formats: of the clouds, some of `formats.FORMATS`.
      surface: whether to write `NAME_surface.glb` (`Prediction.surface`).
      height: of the objects in metres, for the surfaces; None = the unit of the clouds.
      options: of `Predictor.__call__`.

    Yields:
      The path of each image, with its prediction or the error.
    """
    if not formats or not set(formats) <= set(FORMATS):
        raise ConfigError(f"formats={','.join(formats)}: accepted: any of {', '.join(FORMATS)}")
    how, kinds = mask_options or {}, (*formats, *[SURFACE] * surface)
    paths, out = _expand(images), pathlib.Path(local_path(out, "out"))
    if not paths:
        raise ConfigError(f"no image in {', '.join(map(str, images)) or 'the arguments'}")
    count = sum(path.suffix.lower() not in photo.HEIC for path in paths)  # the others are refused
    if mask is not None and not os.path.isdir(mask) and count > 1:
        raise ConfigError(f"mask={mask}: accepted for {count} images: a folder of masks")
    for name in ("box", "point"):
        if count > 1 and how.get(name) is not None:
            raise ConfigError(
                f"{name}: accepted for one image, not {count}; its numbers have commas, no spaces"
            )
    masks.check_method(how.get("mask_from", "auto"))

    predictor: Any = None
    taken: set[str] = set()
    used: dict[pathlib.Path, pathlib.Path] = {}  # masks, and the first photo of each

    def prepare(path: pathlib.Path) -> tuple[photo.Photo, masks.FoundMask, pathlib.Path, Clock]:
        clock = Clock()
        image = photo.read_photo(path)
        start = _free_start(path, out, taken, kinds, options.get("samples", 1))
        given = None if mask is None else _mask_of(path, mask)
        if given and not (other := used.setdefault(given, path)).parent.samefile(path.parent):
            raise photo.PhotoError(
                f"mask={given}: accepted for photos of one folder; {other} has it"
            )
        clock.lap("read")
        try:
            found = masks.find_mask(image, given, **how)
        except masks.UncertainMaskError as error:
            file = _propose(error.mask, image, start)
            proposal = f"; its proposal is {file}" if is_result(file) else ""
            raise masks.UncertainMaskError(f"{error}{proposal}", error.mask) from None
        # The proposal of an earlier run would show another mask.
        if found.doubtful or (given is None and is_result(_with(start, "_mask.png"))):
            _propose(found.mask, image, start)
        clock.lap("mask")
        return image, found, start, clock

    def predict(
        image: photo.Photo, found: masks.FoundMask, start: pathlib.Path, clock: Clock
    ) -> Prediction:
        result, again = predictor(image, found, **options), Clock()
        warnings, surfaces = [*result.warnings], {}
        for name, k in _files(start.name, [SURFACE] * surface, len(result.points)).items():
            try:
                surfaces[name] = glb(result.surface(k, height))
            except SurfaceError as error:
                warnings.append(f"{name} was not written: {error}")
        if surface:
            again.lap("surface")
        seconds = clock.laps | result.seconds | again.laps
        result = dataclasses.replace(result, warnings=tuple(warnings), seconds=seconds)
        _write(predictor, result, start, formats, surfaces, options.get("seed", 0))
        return result

    for path in paths:
        result: Any = _tried(path, prepare, path)
        if not isinstance(result, Exception):
            predictor = predictor or open_predictor()
            result = _tried(path, predict, *result)
        yield path, result


def _tried(path: pathlib.Path, function: Callable[..., Any], *arguments: Any) -> Any:
    """The result of a call, or its error if it concerns only the image `path`."""
    try:
        return function(*arguments)
    except Exception as error:
        if is_disk_full(error):
            raise
        if not isinstance(error, ValueError) and exit_code_of(error) is None:
            logging.error("%s", path, exc_info=error)
        return error


def _with(start: pathlib.Path, end: str) -> pathlib.Path:
    return start.with_name(start.name + end)


def _propose(mask: np.ndarray, read: photo.Photo, start: pathlib.Path) -> pathlib.Path:
    """Writes a found mask in the photo's full size, and the photo with it; returns the mask's file.

    A mask that was mended stays.
    """
    side = min(max(*read.image.shape, 512), 1024)
    image = ImageOps.contain(Image.fromarray(read.image), (side, side))
    overlay = masks.with_mask(np.asarray(image), resample.smooth_mask(mask, image.size[::-1]))
    full = resample.smooth_mask(mask, read.size) * np.uint8(255)
    for kind, picture in zip(_PROPOSAL, (overlay, full), strict=True):
        file = _with(start, f"_{kind}.png")
        if not file.exists() or is_result(file):
            write_atomic(file, result_png(picture, read.path), sync=False)
    return file


def _write(
    predictor: Predictor,
    result: Prediction,
    start: pathlib.Path,
    formats: Sequence[str],
    surfaces: dict[str, bytes],
    seed: int,
) -> None:
    """Writes the results for an image."""
    clouds = _files(start.name, formats, len(result.points))
    view = _with(start, "_input.png")
    files, folder, record = [*clouds, *surfaces, view.name], start.parent, _with(start, ".json")
    before = sorted(_results(record, result.photo.path) - {*files})
    earlier = [name for name in before if os.path.exists(folder / name)]
    document = _record(predictor, result, files, earlier, seed)
    # First, because it marks the others as results if we are killed.
    write_atomic(record, json.dumps(document, indent=2, allow_nan=False) + "\n", sync=False)
    for name, k in clouds.items():
        result.save(folder / name, k)
    for name, content in surfaces.items():
        write_atomic(folder / name, content, sync=False)
    write_atomic(view, result_png(result.view.image, result.photo.path), sync=False)


def _files(name: str, kinds: Sequence[str], samples: int) -> dict[str, int]:
    """The files of clouds and surfaces, with the number of the sample; NPZ has all samples."""
    files = {}
    for kind in kinds:
        several = samples > 1 and kind != "npz"
        end = "_surface.glb" if kind == SURFACE else f".{kind}"
        for k in range(samples if several else 1):
            files[f"{name}_{k}{end}" if several else f"{name}{end}"] = k
    return files


def _record(
    predictor: Predictor, result: Prediction, files: list[str], earlier: list[str], seed: int
) -> dict[str, Any]:
    """The contents of `NAME.json`."""
    view, camera = result.view, result.camera()
    return {
        "format": f"{_FORMAT} {VERSION}",
        "image": os.path.abspath(str(result.photo.path)),
        "image_size": list(result.photo.size),
        "files": files,
        "earlier_files": earlier,
        "frame": "right-handed, +z up, +y image right, +x toward the camera, origin on the ground",
        "unit": "radius of the object's bounding hemisphere",
        "mask_from": result.mask_from,
        "placed": view.placed,
        "warnings": list(result.warnings),
        "normal_form": {
            "meaning": "lowest point at z = 0, farthest at distance 1 from the origin; the "
            "network's points are scale * points + shift",
            "scale": result.scale,
            "shift": result.shift.tolist(),
        },
        "num_samples": len(result.points),
        "num_points": result.points.shape[1],
        "num_outliers": int(result.outlier.sum()),
        "num_fc_points": int((result.branch == FC).sum()),
        "seed": seed,
        "seen_fraction": round(float(result.seen.mean()), 4),
        "cameras": {
            "conventions": "x right, y down, z forward; (0, 0) is the outer corner of a pixel",
            "view": {
                "size": list(view.mask.shape),
                "intrinsics": view.intrinsics.tolist(),
                "extrinsics": view.extrinsics.tolist(),
            },
            "image": {
                "intrinsics": camera.intrinsics.tolist(),
                "extrinsics": camera.extrinsics.tolist(),
            },
        },
        "checkpoint": {
            predictor.source_kind: predictor.source,
            "step": predictor.step,
            "sha256": predictor.checksum,
        },
        "seconds": {part: round(value, 4) for part, value in result.seconds.items()},
        "config": to_dict(predictor.config),
    }


def _expand(images: Sequence[str | os.PathLike[str]]) -> list[pathlib.Path]:
    """The files, and the images in the folders, without repetition, masks and earlier results."""
    paths: list[pathlib.Path] = []
    for image in images:
        if "://" in os.fspath(image):
            raise ConfigError(f"{image}: expected a file or a folder; download it first")
        path = pathlib.Path(image)
        paths += _images_in(path) if os.path.isdir(path) else [path]
    if paths[1:] or paths != list(map(pathlib.Path, images)):  # a file alone is always meant
        listed = {(p.parent, same_name(p.stem)) for p in paths}
        paths = [
            p
            for p in paths
            if not _is_mask(p, listed) and not (p.suffix == ".png" and is_result(p))
        ]
    return list(dict.fromkeys(paths))


def _is_mask(path: pathlib.Path, listed: set[tuple[pathlib.Path, str]]) -> bool:
    """Whether a file is the mask of a photo that is listed or beside it."""
    stem, folder = path.stem[: -len("_mask")], path.parent
    return same_name(path.stem).endswith("_mask") and (
        (folder, same_name(stem)) in listed or bool(images_named(folder, stem))
    )


def _images_in(folder: pathlib.Path) -> list[pathlib.Path]:
    """The images of a folder by their suffix, and HEIC files that have no converted copy there."""
    files = [p for p in folder.iterdir() if p.name[0] != "." and p.is_file()]
    images = [p for p in files if p.suffix.lower() in photo.SUFFIXES]
    copied = {same_name(p.stem) for p in images}
    others = (p for p in files if same_name(p.stem) not in copied)
    return sorted([*images, *(p for p in others if p.suffix.lower() in photo.HEIC)])


def _results(record: pathlib.Path, image: pathlib.Path | None) -> set[str]:
    """The names of the files that a `NAME.json` lists as results of this image."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        stated = read_json(record)
        same = os.path.abspath(stated["image"]) == os.path.abspath(str(image))
        if same and stated["format"].startswith(_FORMAT):
            names = [*stated["files"], *stated.get("earlier_files", [])]
            return {name for name in names if isinstance(name, str)}
    return set()


def _free_start(
    path: pathlib.Path, out: pathlib.Path, taken: set[str], kinds: Sequence[str], samples: int
) -> pathlib.Path:
    """Folder and name of the results, to which suffixes are added; unique if case is ignored."""
    name, number = path.stem or "image", 1
    while True:
        record = out / f"{name}.json"
        earlier = _results(record, path)
        files = {*_files(name, kinds, samples), f"{name}_input.png"} - earlier
        there = any((out / file).exists() for file in files)
        foreign = (record.exists() and not earlier) or any(
            is_result(out / f"{name}_{kind}.png", other_than=path) for kind in _PROPOSAL
        )
        if same_name(name) not in taken and not there and not foreign:
            taken.add(same_name(name))
            return out / name
        number += 1
        name = f"{path.stem}-{number}"


def _mask_of(path: pathlib.Path, mask: str) -> pathlib.Path:
    folder = pathlib.Path(mask)
    if not folder.is_dir():
        return folder
    for stem in (f"{path.stem}_mask", path.stem):
        for found in images_named(folder, stem):
            if not found.samefile(path) and not is_result(found, other_than=path):
                return found
    raise photo.PhotoError(
        f"mask={mask}: expected an image named {path.stem}_mask.* or {path.stem}.* there, besides "
        "the photo itself"
    )
