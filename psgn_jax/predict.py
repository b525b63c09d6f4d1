"""Points from photos: `python -m psgn_jax.predict IMAGE... --workdir W --out DIR`.

Images are files of any usual format, or folders of them. The object's mask comes from `--mask`,
from the file's transparency, or is found (`data.masks`); then the object is cropped and scaled to
where training objects sit (`data.photo`), unless the image already is framed so: 4:3 on the grey of
the training renderings.

For each image: the cloud as PLY, XYZ, OBJ and NPZ (`prediction.export`: frame, colours), what the
network saw as `NAME_view.png`, and `NAME.json` with camera, configuration, checkpoint and times.
With several samples the NPZ also tells each point's spread and the clouds' mutual distances. One
bad image does not stop the others. Exit code: 0 all came out, 1 some failed, 2 none did or a wrong
argument.

In a notebook: `Predictor.from_workdir(workdir)(image)`, with arrays.
"""

import contextlib
import dataclasses
import hashlib
import io
import json
import os
import pathlib
import platform
import sys
import tempfile
import time
import types
import zlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from absl import app, flags, logging
from PIL import Image

from psgn_jax import registry
from psgn_jax.config import Config, ConfigError, UserError, check_points, to_dict
from psgn_jax.data import masks, photo, resize
from psgn_jax.data.default import cache_folder
from psgn_jax.evaluate import load_config, load_params
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.metrics import samples as sample_metrics
from psgn_jax.models.point_out_net import branch_of_point
from psgn_jax.prediction import export, sampling
from psgn_jax.training import step as step_lib
from psgn_jax.training.log import exit_on_user_error, log_to_terminal, parse_flags, write_atomic
from psgn_jax.training.state import named_leaves

FC, DECONV = 0, 1


@dataclasses.dataclass(frozen=True, eq=False)
class Prediction:
    """Clouds for one image.

    Attributes:
      points: float32 [k, n, 3] in the project's frame (+z up, +y image right, +x to the camera).
      colours: uint8 [k, n, 3] from the image, `prediction.export.UNSEEN` for points it does not
      show.
      seen: bool [k, n].
      branch: uint8 [n], which branch predicts a point, `FC` or `DECONV`.
      view: what the network saw, with the camera (`data.photo.View`).
      photo_intrinsics: float64 [3, 3], for the image as given (with the view's extrinsics).
      r: float32 [k, random_size], the random inputs, or None for a network without.
      spread: float32 [n, 3], standard deviation over the clouds of each point along x, y, z (point
        i is the same output in all; unit = radius of the bounding hemisphere).
      mutual: float32 [k, k], squared Chamfer distance of every two clouds, both directions' means
        added (unit^2).
      mask_from: how the mask was found.
      seconds: time of each part.
    """

    points: np.ndarray
    colours: np.ndarray
    seen: np.ndarray
    branch: np.ndarray
    view: photo.View
    photo_intrinsics: np.ndarray
    r: np.ndarray | None
    spread: np.ndarray
    mutual: np.ndarray
    mask_from: str
    seconds: dict[str, float]


class Predictor:
    """A trained network, ready to be called with images.

    Args:
      config: of its run.
      params: its parameters.
      step: of the checkpoint, for the record.
      source: where it comes from, for the record.
    """

    def __init__(self, config: Config, params: Any, *, step: int = 0, source: str = ""):
        check_points(config, "a prediction from photos")
        if "depth" in config.data.inputs:
            raise ConfigError(
                f"data.inputs={config.data.inputs!r}: the network reads depth, photos lack it; "
                "accepted: a network of 'rgb' and 'mask'"
            )
        self.config, self.step, self.source = config, step, source
        self.checksum = _checksum(params)
        self._params = jax.device_put(params)
        model = registry.build_model(config.model)

        def network(params: Any, image: Any, mask: Any, r: Any) -> Any:
            return step_lib.predict(config, model, params, {"image": image, "mask": mask}, r)

        def mutual(points: Any) -> Any:
            return sample_metrics.mutual_distances(points, chamfer_sq_mean)

        self._network = jax.jit(network)
        self._mutual = jax.jit(mutual)

    @classmethod
    def from_workdir(cls, workdir: str | os.PathLike[str], checkpoint: str = "best") -> "Predictor":
        """The best (or "last") checkpoint of a run.

        Raises:
          ConfigError, CheckpointError: no run or no checkpoint there.
        """
        config = load_config(pathlib.Path(workdir))
        step, params = load_params(pathlib.Path(workdir), checkpoint)
        return cls(config, params, step=step, source=str(workdir))

    def __call__(
        self,
        image: np.ndarray,
        mask: np.ndarray | None = None,
        *,
        samples: int = 1,
        seed: int = 0,
        frame: str = "auto",
        mask_from: str = "auto",
    ) -> Prediction:
        """Predicts the points of the object in an image.

        Args:
          image: uint8 [h, w, 3] RGB, [h, w, 4] RGBA or [h, w] grey, any size.
          mask: bool [h, w], True on the object; None to find it.
          samples: clouds to draw; more than one wants a network with a random input.
          seed: of the random input. The draws are the same for every image.
          frame: "place" crops and scales the object (`photo.place`), "keep" takes the image as
            framed (4:3), "auto" keeps only what looks like a training rendering.
          mask_from: one of `masks.METHODS`; without effect if a mask is given.

        Raises:
          ValueError: what does not fit; `photo.PhotoError` if no object is found.
        """
        r = self._draw(samples, seed)
        clock = _Clock()
        rgb, alpha = photo.as_rgb_and_alpha(image)
        found = "given"
        if mask is None:
            mask, found = masks.find_mask(rgb, alpha, mask_from)
        clock.lap("mask")
        if frame not in ("auto", "place", "keep"):
            raise ConfigError(f"frame={frame!r}: accepted: auto, place, keep")
        move = frame == "place" or (frame == "auto" and not photo.is_framed(rgb))
        view = photo.place(rgb, mask, move=move)
        clock.lap("place")
        size = self.config.data.image_size
        small = resize.resize_image(view.image, size)[None]
        small_mask = resize.resize_mask(view.mask, size)[None]
        points = np.asarray(
            self._network(self._params, small, small_mask, None if r is None else r[None])
        ).reshape(samples, -1, 3)
        mutual = self._mutual(points) if samples > 1 else np.zeros((1, 1), np.float32)
        clock.lap("network")
        if not np.isfinite(points).all():
            raise ConfigError("the network's points are not finite: a damaged or diverged training")
        coloured = [export.colours_from_view(cloud, view) for cloud in points]
        clock.lap("colours")
        branch = np.full(points.shape[1], FC, np.uint8)
        branch[list(branch_of_point(self.config.model).deconv)] = DECONV
        return Prediction(
            points=points,
            colours=np.stack([colours for colours, _ in coloured]),
            seen=np.stack([seen for _, seen in coloured]),
            branch=branch,
            view=view,
            photo_intrinsics=np.linalg.inv(view.to_view) @ view.intrinsics,
            r=r,
            spread=points.std(axis=0),
            mutual=np.asarray(mutual),
            mask_from=found,
            seconds=clock.laps,
        )

    def warm_up(self, samples: int = 1) -> None:
        """Compiles the network for so many samples, so that the first image need not wait."""
        r = self._draw(samples, 0)
        mask = np.zeros((1, *self.config.data.image_size), np.bool_)
        image = np.zeros((*mask.shape, 3), np.uint8)
        points = self._network(self._params, image, mask, None if r is None else r[None])
        if samples > 1:
            self._mutual(np.asarray(points).reshape(samples, -1, 3))
        jax.block_until_ready(points)

    def _draw(self, samples: int, seed: int) -> np.ndarray | None:
        size = self.config.model.random_size
        if samples < 1 or (samples > 1 and not size):
            accepted = "1 or more" if size else "1, as this network has no random input"
            raise ConfigError(f"samples={samples}: accepted: {accepted}")
        if not size:
            return None
        if not -(2**31) <= seed < 2**31:
            raise ConfigError(f"seed={seed}: accepted: a whole number of 32 bits")
        # An image is the first sample of its own batch: its clouds do not depend on the others.
        return np.asarray(sampling.draw_many(self.config, 0, 1, samples, seed))[0]


def predict_files(
    predictor: Predictor,
    images: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    mask: str | None = None,
    formats: tuple[str, ...] = export.FORMATS,
    **options: Any,
) -> Iterator[tuple[pathlib.Path, Prediction | Exception]]:
    """Predicts files and folders of images and writes the results into `out`, one after the other.

    Args:
      predictor: the network.
      images: files, and folders whose images are taken by name.
      out: folder for the results.
      mask: a mask's file (for one image), or a folder with a file of each image's name.
      formats: any of `prediction.export.FORMATS`.
      **options: of `Predictor.__call__`.

    Yields:
      each image's path with its prediction or with what went wrong.

    Raises:
      ConfigError: no image named, a mask's file for several.
    """
    paths = _expand(images)
    if not paths:
        raise ConfigError(f"no image in {', '.join(map(str, images)) or 'the arguments'}")
    if mask is not None and not os.path.isdir(mask) and len(paths) > 1:
        raise ConfigError(f"--mask={mask}: accepted for {len(paths)} images: a folder of masks")
    for path, name in zip(paths, _names(paths), strict=True):
        try:
            result = _predict_file(predictor, path, name, pathlib.Path(out), mask, formats, options)
        except Exception as error:  # the other images of the batch are to come out
            if not isinstance(error, UserError | ValueError | OSError):
                logging.exception("%s", path)
            yield path, error
        else:
            yield path, result


def use_compile_cache() -> None:
    """Keeps compiled networks in the cache folder: a second start compiles nothing.

    By kind of processor: what is compiled for one may not run on another that shares the folder.
    """
    try:
        text = pathlib.Path("/proc/cpuinfo").read_text()
        flags_line = next(line for line in text.splitlines() if line.startswith(("flags", "Feat")))
    except (OSError, StopIteration):
        flags_line = platform.processor()
    kind = f"{platform.machine()}-{zlib.crc32(flags_line.encode()):08x}"
    folder = cache_folder() / "compiled" / kind
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


def _predict_file(
    predictor: Predictor,
    path: pathlib.Path,
    name: str,
    out: pathlib.Path,
    mask: str | None,
    formats: tuple[str, ...],
    options: dict[str, Any],
) -> Prediction:
    clock = _Clock()
    read = photo.read_photo(path)
    given = None if mask is None else photo.read_mask(_mask_of(path, mask), read)
    clock.lap("read")
    return predict_photo(
        predictor, read, given, path, name, out, formats, seconds=clock.laps, **options
    )


def predict_photo(
    predictor: Predictor,
    read: photo.Photo,
    mask: np.ndarray | None,
    path: pathlib.Path,
    name: str,
    out: pathlib.Path,
    formats: tuple[str, ...] = export.FORMATS,
    *,
    seconds: Mapping[str, float] = types.MappingProxyType({}),
    **options: Any,
) -> Prediction:
    """Predicts a photo that was read and writes the results into `out`.

    Args:
      predictor: the network.
      read: the photo.
      mask: bool [h, w] of `read.image`'s size, True on the object; None to find it.
      path: where the photo comes from, for the record.
      name: of the results, without suffix.
      out: folder for the results.
      formats: any of `prediction.export.FORMATS`.
      seconds: of what was done before, for the record.
      **options: of `Predictor.__call__`.

    Raises:
      ValueError: as `Predictor.__call__`.
    """
    image = read.image if read.alpha is None else np.dstack([read.image, read.alpha])
    result = predictor(image, mask, **options)
    clock = _Clock()
    view = result.view
    branch, seen = result.branch, result.seen
    files = export.write_clouds(
        out,
        name,
        result.points,
        result.colours,
        formats,
        seen=seen,
        branch=branch,
        spread=result.spread,
        mutual=result.mutual,
        image=view.image,
        mask=view.mask,
        intrinsics=view.intrinsics,
        extrinsics=view.extrinsics,
    )
    picture = io.BytesIO()
    Image.fromarray(view.image).save(picture, "png", compress_level=1)
    write_atomic(out / f"{name}_view.png", picture.getvalue(), sync=False)
    clock.lap("write")
    seconds = {**seconds, **result.seconds, "write": clock.laps["write"]}
    document = {
        "image": str(path),
        "image_size": list(read.size),
        "files": [file.name for file in files] + [f"{name}_view.png"],
        "frame": "right-handed, +z up, +y image right, +x toward the camera, origin on the ground",
        "unit": "radius of the object's bounding hemisphere",
        "mask_from": result.mask_from,
        "placed": view.placed,
        "num_samples": len(result.points),
        "num_points": result.points.shape[1],
        "num_fc_points": int((branch == FC).sum()),
        "seed": options.get("seed", 0),
        "seen_fraction": round(float(seen.mean()), 4),
        "camera": {
            "conventions": "x right, y down, z forward; (0, 0) is the outer corner of a pixel",
            "extrinsics": view.extrinsics.tolist(),
            "view_size": list(view.mask.shape),
            "intrinsics": view.intrinsics.tolist(),
            "image_intrinsics": (
                _scale(read.image.shape[:2], read.size) @ result.photo_intrinsics
            ).tolist(),
        },
        "checkpoint": {
            "workdir": predictor.source,
            "step": predictor.step,
            "sha256": predictor.checksum,
        },
        "seconds": {part: round(value, 4) for part, value in seconds.items()},
        "config": to_dict(predictor.config),
    }
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    write_atomic(out / f"{name}.json", text, sync=False)
    result.seconds.clear()
    result.seconds.update(seconds)
    return result


@contextlib.contextmanager
def without_lines_about(source: str) -> Iterator[None]:
    """Leaves out lines of native code on standard error that name `source`.

    XLA writes two tuning preferences of its own into what it compiles, takes them for features that
    the processor lacks when it reads them back, and says so in 3,000 characters each.
    """
    sys.stderr.flush()
    saved = os.dup(2)
    try:
        with tempfile.TemporaryFile() as caught:
            os.dup2(caught.fileno(), 2)
            try:
                yield
            finally:
                os.dup2(saved, 2)
                caught.seek(0)
                for line in caught:
                    if source.encode() not in line:
                        os.write(2, line)
    finally:
        os.close(saved)


def _scale(old: tuple[int, ...], new: tuple[int, ...]) -> np.ndarray:
    return np.diag([new[1] / old[1], new[0] / old[0], 1.0])


def _expand(images: Sequence[str | os.PathLike[str]]) -> list[pathlib.Path]:
    """Files as named, folders as the images in them; each once."""
    paths: list[pathlib.Path] = []
    for image in map(pathlib.Path, images):
        if image.is_dir():
            inside = [p for p in image.iterdir() if p.suffix.lower() in photo.SUFFIXES]
            paths += sorted(p for p in inside if p.is_file() and not p.name.startswith("."))
        else:
            paths.append(image)
    return list(dict.fromkeys(paths))


def _names(paths: Sequence[pathlib.Path]) -> list[str]:
    """A name for the results of each image; no two alike, whatever the case."""
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
    folder = pathlib.Path(mask)
    if not folder.is_dir():
        return folder
    found = [p for p in sorted(folder.iterdir()) if p.stem in (path.stem, f"{path.stem}_mask")]
    if not found:
        raise photo.PhotoError(f"--mask={mask}: no file there is named {path.stem} or *_mask")
    return found[0]


def _checksum(params: Any) -> str:
    """SHA-256 over names, shapes and values of the parameters."""
    digest = hashlib.sha256()
    for name, leaf in sorted(named_leaves(params).items()):
        array = np.ascontiguousarray(leaf)
        digest.update(f"{name} {array.dtype} {array.shape}\n".encode())
        digest.update(array.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


class _Clock:
    """Seconds between laps."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name], self._last = now - self._last, now


def _main(argv: Sequence[str]) -> None:
    log_to_terminal()
    values = flags.FLAGS
    done, failed = 0, 0
    with exit_on_user_error():
        formats = tuple(values.formats)
        if not formats or not set(formats) <= set(export.FORMATS):
            raise ConfigError(
                f"--formats={','.join(formats)}: accepted: any of {', '.join(export.FORMATS)}"
            )
        if not argv[1:]:
            raise ConfigError("no image: name files or folders")
        use_compile_cache()
        predictor = Predictor.from_workdir(values.workdir, values.checkpoint)
        with without_lines_about("cpu_aot_loader"):
            predictor.warm_up(values.samples)
        results = predict_files(
            predictor,
            argv[1:],
            values.out,
            mask=values.mask,
            formats=formats,
            samples=values.samples,
            seed=values.seed,
            frame=values.frame,
            mask_from=values.mask_from,
        )
        for path, result in results:
            if isinstance(result, Exception):
                failed += 1
                line = " ".join(str(result).split()) or type(result).__name__
                sys.stderr.write(f"failed: {path}: {line}\n")
                continue
            done += 1
            milliseconds = 1000 * sum(result.seconds.values())
            sys.stdout.write(
                f"{path}: {len(result.points)} x {result.points.shape[1]} points, mask "
                f"{result.mask_from}, {milliseconds:.0f} ms\n"
            )
            sys.stdout.flush()
    if failed:
        sys.stderr.write(f"{done} of {done + failed} images came out, in {values.out}\n")
    sys.exit(0 if not failed else 1 if done else 2)


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of the run.", required=True)
    flags.DEFINE_string("out", None, "Folder for the results.", required=True)
    flags.DEFINE_enum("checkpoint", "best", ["best", "last"], "Which checkpoint.")
    flags.DEFINE_string("mask", None, "File of the mask, or folder with one for each image.")
    flags.DEFINE_enum("mask_from", "auto", list(masks.METHODS), "How to find a mask.")
    flags.DEFINE_enum("frame", "auto", ["auto", "place", "keep"], "Crop the object, or keep.")
    flags.DEFINE_integer("samples", 1, "Clouds for each image.")
    flags.DEFINE_integer("seed", 0, "Seed of the random input.")
    flags.DEFINE_list("formats", list(export.FORMATS), "Formats of the clouds.")
    app.run(_main, flags_parser=parse_flags)
