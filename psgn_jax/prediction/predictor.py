"""Prediction with a trained network: `psgn_jax.load()(image)`.

The mask of the object is given or found (`prediction.masks`). The object is then cropped and scaled
to the position of training objects (`data.framing`), unless the image is framed like a training
rendering: 4:3, with the renderings' grey along its border.
"""

import dataclasses
import functools
import os
import pathlib
import time
from typing import Any

import jax
import numpy as np
from PIL import Image

from psgn_jax.config.experiment import ConfigError, require_points_task
from psgn_jax.data import camera, framing, photo, resize
from psgn_jax.models import networks
from psgn_jax.prediction import export, masks, sampling
from psgn_jax.prediction.refine import refined
from psgn_jax.prediction.silhouette import largest_share
from psgn_jax.system.files import write_atomic
from psgn_jax.weights.leaves import checksum, named_leaves
from psgn_jax.weights.run_folder import Trained

FC, DECONV = 0, 1

NORMAL_FORMS = ("auto", "yes", "no")

INVERTED = (
    "the mask covers the image's border but not its middle: it is probably inverted (white outside "
    "the object); --invert_mask exchanges object and background"
)


@dataclasses.dataclass(frozen=True, eq=False)
class Prediction:
    """The clouds for an image.

    Attributes:
      points: float32 [k, n, 3] in the project's frame (+z up, +y image right, +x to the camera).
      scale, shift: the network's points are `scale * points + shift`, the transformation of the
        normal form (`data.framing.normal_form`), common to all clouds; 1 and 0 without normal form.
      normalised: whether the clouds have normal form.
      colours: uint8 [k, n, 3], from the image (`prediction.export.colours_from_view`).
      seen: bool [k, n], whether a point is visible in the image.
      stray: bool [k, n], whether a point lies apart from all others
        (`prediction.export.stray_points`).
      branch: uint8 [n], the branch that predicts a point, `FC` or `DECONV`.
      view: the framed view of the object, which is resized to the input of the network, with the
        camera that projects `points` to it (`data.framing.Framed`).
      photo_intrinsics: float64 [3, 3], for the image in its original size, upright (with the
        extrinsics of the view).
      r: float32 [k, random_size], the random inputs; None for a network without random input.
      spread: float32 [n, 3], standard deviation over the clouds of each point along x, y, z (points
        with the same index correspond; unit = radius of the bounding hemisphere).
      mutual: float32 [k, k], `losses.chamfer_sq_mean` between the clouds (unit^2).
      mask: bool [h, w], the given or found mask of the image, which is reduced if it is large
        (`photo.MAX_SIDE`).
      mask_from: the method that produced the mask.
      warnings: probable problems, a line each.
      seconds: duration of each step.
    """

    points: np.ndarray
    scale: float
    shift: np.ndarray
    normalised: bool
    colours: np.ndarray
    seen: np.ndarray
    stray: np.ndarray
    branch: np.ndarray
    view: framing.Framed
    photo_intrinsics: np.ndarray
    r: np.ndarray | None
    spread: np.ndarray
    mutual: np.ndarray
    mask: np.ndarray
    mask_from: str
    warnings: tuple[str, ...]
    seconds: dict[str, float]

    def save(self, path: str | os.PathLike[str], sample: int = 0) -> None:
        """Writes one cloud without its stray points; the suffix is .ply, .xyz, .obj or .glb.

        Raises:
          ValueError: another suffix.
        """
        suffix = pathlib.Path(path).suffix.lower().lstrip(".")
        if suffix not in export.MAKERS:
            accepted = ", ".join(f".{name}" for name in export.MAKERS)
            raise ValueError(f"{path}: accepted: a name that ends in {accepted}")
        kept = ~self.stray[sample]
        content = export.MAKERS[suffix](self.points[sample][kept], self.colours[sample][kept])
        write_atomic(path, content, sync=False)

    def to_trimesh(self, sample: int = 0) -> Any:
        """One cloud as `trimesh.PointCloud` (needs trimesh)."""
        import trimesh

        return trimesh.PointCloud(self.points[sample], colors=self.colours[sample])


class Predictor:
    """A trained network that can be called with images; `weights.opening` opens the run."""

    def __init__(self, run: Trained):
        config = run.config
        require_points_task(config, "a prediction from photos")
        if "depth" in config.data.inputs:
            raise ConfigError(
                f"data.inputs={config.data.inputs!r}: photos have no depth; accepted: a network "
                "with the inputs 'rgb' and 'mask'"
            )
        self.config, self.step = config, run.step
        self.source, self.source_kind = run.source, run.source_kind
        self.checksum = checksum(named_leaves(run.params))
        self._params = jax.device_put(run.params)
        model = networks.build(config.model)
        self._deconv = list(model.branches.deconv)

        def network(params: Any, batch: Any, r: Any, most_outside: Any, refine: bool) -> Any:
            predict = functools.partial(networks.predict, config, model, params)
            if not refine:
                return predict(batch, r)
            return refined(predict, batch, r, most_outside=most_outside)

        self._network = jax.jit(network, static_argnames="refine")
        self._mutual = jax.jit(sampling.mutual_distances)

    def __call__(
        self,
        image: str | os.PathLike[str] | Image.Image | np.ndarray | photo.Photo,
        mask: str | os.PathLike[str] | Image.Image | np.ndarray | None = None,
        *,
        samples: int = 1,
        seed: int = 0,
        frame: str = "auto",
        mask_from: str = "auto",
        invert_mask: bool = False,
        normal_form: str = "auto",
        refine: bool = True,
    ) -> Prediction:
        """Predicts the points of the object in an image.

        Args:
          image: path of an image file, PIL image, uint8 [h, w, 3] RGB, [h, w, 4] RGBA or [h, w]
            grey, or what `photo.read_photo` has read; any size.
          mask: path of a mask file, PIL image, or array [h, w], positive on the object; None =
            automatic.
          samples: number of clouds; more than one needs a network with a random input.
          seed: seed of the random input. The random inputs are the same for every image.
          frame: "place" crops and scales the object (`framing.place`); "keep" keeps the framing
            (the image must be 4:3); "auto" keeps that of training renderings and places other
            images.
          mask_from: one of `masks.METHODS`; ignored if a mask is given.
          invert_mask: whether the given mask is False on the object.
          normal_form: "yes" moves and scales the clouds so that the lowest point is at z = 0 and
            the farthest at distance 1 from the origin (`framing.normal_form`), because a photo does
            not show the size of its object. "no" returns the output of the network. "auto"
            normalises if the image was placed.
          refine: whether to average the cloud with that of the mirror image, and to move points
            that project outside the mask into it (`prediction.refine`); none is moved if more than
            half of them are outside, or in an image that was placed more than a tenth.

        Raises:
          ValueError: an argument is wrong; `photo.PhotoError` if there is no object.
        """
        r = self._sample_latents(samples, seed)
        if frame not in ("auto", "place", "keep"):
            raise ConfigError(f"frame={frame!r}: accepted: auto, place, keep")
        if normal_form not in NORMAL_FORMS:
            raise ConfigError(f"normal_form={normal_form!r}: accepted: {', '.join(NORMAL_FORMS)}")
        if invert_mask and mask is None:
            raise ConfigError("invert_mask: accepted only with a given mask")
        clock = Clock()
        read = photo.as_photo(image)
        rgb = read.image
        if mask is None:
            warning, (mask, mask_source) = "", masks.find_mask(rgb, read.alpha, mask_from)
        else:
            mask, mask_source = photo.as_mask(mask, read) ^ invert_mask, "given"
            warning = INVERTED if masks.looks_inverted(mask) else ""
        clock.lap("mask")
        move = frame == "place" or (frame == "auto" and not framing.is_framed(rgb))
        view = framing.place(rgb, mask, move=move)
        clock.lap("place")
        size = self.config.data.image_size
        batch = {
            "image": resize.resize_image(view.image, size)[None],
            "mask": resize.resize_mask(view.mask, size)[None],
            "intrinsics": camera.scale_intrinsics(view.intrinsics, view.mask.shape, size)[None],
            "extrinsics": view.extrinsics[None],
        }
        most_outside = np.float32(largest_share(view.placed))
        points = np.asarray(
            self._network(
                self._params, batch, None if r is None else r[None], most_outside, refine=refine
            )
        ).reshape(samples, -1, 3)
        mutual = self._mutual(points) if samples > 1 else np.zeros((1, 1), np.float32)
        clock.lap("network")
        if not np.isfinite(points).all():
            raise ConfigError("the network's points are not finite; expected intact weights")
        height, width = rgb.shape[:2]
        enlarged = np.diag([read.size[1] / width, read.size[0] / height, 1.0])
        coloured = [export.colours_from_view(cloud, view) for cloud in points]
        stray = np.stack([export.stray_points(cloud) for cloud in points])
        scale, shift = 1.0, np.zeros(3)
        normalised = normal_form == "yes" or (normal_form == "auto" and view.placed)
        if normalised:
            scale, shift = framing.normal_form(points[~stray])
            points = ((points - shift) / scale).astype(np.float32)
            extrinsics = framing.normalised_extrinsics(view.extrinsics, scale, shift)
            view = dataclasses.replace(view, extrinsics=extrinsics)
            mutual = mutual / np.float32(scale**2)
        clock.lap("colours")
        branch = np.full(points.shape[1], FC, np.uint8)
        branch[self._deconv] = DECONV
        return Prediction(
            points=points,
            scale=scale,
            shift=shift,
            normalised=normalised,
            colours=np.stack([colours for colours, _ in coloured]),
            seen=np.stack([seen for _, seen in coloured]),
            stray=stray,
            branch=branch,
            view=view,
            photo_intrinsics=enlarged @ np.linalg.inv(view.to_view) @ view.intrinsics,
            r=r,
            spread=points.std(axis=0),
            mutual=np.asarray(mutual),
            mask=mask,
            mask_from=mask_source,
            warnings=(warning,) if warning else (),
            seconds=clock.laps,
        )

    def warm_up(self, samples: int = 1, *, refine: bool = True) -> None:
        """Compiles the network for these arguments of a call before the first image."""
        image, mask = np.zeros((96, 128, 3), np.uint8), np.zeros((96, 128), np.bool_)
        mask[24:72, 32:96] = True
        self(image, mask, samples=samples, refine=refine)

    def _sample_latents(self, samples: int, seed: int) -> np.ndarray | None:
        size = self.config.model.random_size
        if samples < 1 or (samples > 1 and not size):
            accepted = "1 or more" if size else "1, as this network has no random input"
            raise ConfigError(f"samples={samples}: accepted: {accepted}")
        if not size:
            return None
        if not -(2**31) <= seed < 2**31:
            raise ConfigError(f"seed={seed}: accepted: an integer of 32 bits")
        # Every image is sample 0, so that its clouds do not depend on other images.
        return np.asarray(sampling.sample_latents(self.config, 0, 1, samples, seed))[0]


class Clock:
    """Measures the seconds between laps."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Stores the seconds since the last lap under a name."""
        now = time.perf_counter()
        self.laps[name], self._last = now - self._last, now
