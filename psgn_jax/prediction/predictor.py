"""Prediction with a trained network: `psgn_jax.load()(image)`.

The mask of the object is given or found (`prediction.masks`). We crop and scale the object to the
place of training objects (`data.framing`), unless the image is framed like a training rendering:
4:3, with the renderings' grey along its border.
"""

import dataclasses
import functools
import time
from typing import Any, Unpack

import jax
import numpy as np

from psgn_jax.config.experiment import Config, ConfigError, require_points_task
from psgn_jax.data import framing, photo
from psgn_jax.models import networks
from psgn_jax.models.cpu_convolution import convolutions_for
from psgn_jax.prediction import draws, masks
from psgn_jax.prediction.cloud import DECONV, FC, Prediction, colours_from_view, find_outliers
from psgn_jax.prediction.formats import MOST_CLOUDS
from psgn_jax.prediction.refine import predicted
from psgn_jax.weights.leaves import checksum, named_leaves
from psgn_jax.weights.run_folder import Trained

FRAMES = ("auto", "place", "keep")
NORMAL_FORMS = ("auto", "yes", "no")


def require_photos(config: Config, what: str) -> None:
    """Raises `ConfigError` if a network does not predict points from images and masks alone."""
    require_points_task(config, what)
    if "depth" in config.data.inputs:
        raise ConfigError(
            f"data.inputs={config.data.inputs!r}: {what} expects a network with the inputs 'rgb' "
            "and 'mask'"
        )


class Predictor:
    """A trained network that can be called with images; `weights.opening` opens the run."""

    def __init__(self, run: Trained):
        config = run.config
        require_photos(config, "a prediction from photos")
        self.config, self.step = config, run.step
        self.source, self.source_kind = run.source, run.source_kind
        self.checksum = checksum(named_leaves(run.params))
        self._params, self._run = jax.device_put(run.params), run._replace(params=None)
        model = networks.build(config.model)
        self._deconv = list(model.branches.deconv)

        network = functools.partial(predicted, config, model)
        options = ("samples", "first", "refine", "placed")
        self._network = jax.jit(convolutions_for("storing")(network), static_argnames=options)

    def __reduce__(self) -> Any:
        """Pickles the trained network, for Ray, joblib and spawned processes; they compile anew."""
        return Predictor, (self._run._replace(params=jax.device_get(self._params)),)

    def __call__(
        self,
        image: photo.Source | photo.Photo,
        mask: photo.Source | masks.FoundMask | None = None,
        *,
        samples: int = 1,
        seed: int = 0,
        frame: str = "auto",
        normal_form: str = "auto",
        refine: bool = True,
        first: draws.First = "zero",
        **mask_options: Unpack[masks.MaskOptions],
    ) -> Prediction:
        """Predicts the points of the object in an image.

        Args:
          image: a path, an open file, a PIL image, an array uint8 [h, w, 3] (RGB), [h, w, 4]
            (RGBA) or [h, w] (grey), or what `photo.read_photo` has read; any size.
          mask: a path, an open file, a PIL image, or an array [h, w], bright on the object; None =
            automatic (`masks.find_mask`).
          samples: number of clouds, up to 64; more than one needs a network with a random input r.
            All but the first are draws that differ (`draws.ranked`).
          seed: seed of the random input, which is the same for every image.
          frame: "place" crops and scales the object (`framing.place`); "keep" keeps the framing of
            an image of 4:3; "auto" keeps training renderings and places other images.
          normal_form: "yes" puts the lowest point at z = 0 and the farthest at distance 1 from the
            origin (`framing.normal_form`), because a photo does not show the size of its object;
            "no" does not; "auto" does if the image was placed.
          refine: whether to average the first cloud with the mirror image's (`prediction.refine`)
            and to fit all to the mask (`prediction.silhouette`).
          first: the first cloud, with a random input r: "zero" is the prediction for r = 0, "mean"
            the mean of all draws (`draws.with_first`).
          mask_options: `mask_from`, `invert_mask`, `accept_mask`, `mask_label`, `box` and `point`,
            see `masks.MaskOptions`.

        Raises:
          ValueError: an argument is wrong.
          photo.PhotoError: the photo or the mask cannot be used, or no object was found.
          masks.UncertainMaskError: the mask network is not certain; `mask` is its proposal.
        """
        r = self._latents(samples, seed)
        for name, value, accepted in (
            ("frame", frame, FRAMES),
            ("normal_form", normal_form, NORMAL_FORMS),
            ("refine", refine, (True, False)),
            ("first", first, draws.FIRST),
        ):
            if value not in accepted:
                shown = ", ".join(map(str, accepted))
                raise ConfigError(f"{name}={value!r}: accepted: {shown}")
        clock = Clock()
        read, found = photo.read_photo(image), mask
        if not isinstance(found, masks.FoundMask):
            found = masks.find_mask(read, found, **mask_options)
            clock.lap("mask")
        move = frame == "place" or (frame == "auto" and not framing.is_framed(read.image))
        view = framing.place(read.image, found.mask, self.config.data.image_size, move=move)
        clock.lap("frame")
        fields = ("image", "mask", "intrinsics", "extrinsics")
        batch = {name: getattr(view, name)[None] for name in fields}
        options = {"refine": refine, "placed": view.placed, "samples": samples, "first": first}
        with jax.numpy_dtype_promotion("standard"):  # the caller may have set "strict"
            fitted, clouds = self._network(self._params, batch, r, **options)
        points = np.asarray(fitted.points)[0]
        view = dataclasses.replace(view, extrinsics=np.asarray(fitted.extrinsics)[0])
        clock.lap("network")
        if not np.isfinite(points).all():
            raise ConfigError("the network's points are not finite; expected intact weights")
        colours, seen = zip(*(colours_from_view(cloud, view) for cloud in points), strict=True)
        outlier = np.stack([find_outliers(cloud) for cloud in points])
        scale, shift = 1.0, np.zeros(3)
        if normal_form == "yes" or (normal_form == "auto" and view.placed):
            scale, shift = framing.normal_form(points[~outlier])
            points = ((points - shift) / scale).astype(np.float32)
            extrinsics = framing.normalised_extrinsics(view.extrinsics, scale, shift)
            view = dataclasses.replace(view, extrinsics=extrinsics)
        clock.lap("colours")
        branch = np.full(points.shape[1], FC, np.uint8)
        branch[self._deconv] = DECONV
        return Prediction(
            points=points,
            colours=np.stack(colours),
            mask=found.mask,
            warnings=(*read.warnings, *found.warnings),
            outlier=outlier,
            seen=np.stack(seen),
            branch=branch,
            mask_from=found.method,
            photo=read,
            view=view,
            scale=scale,
            shift=shift,
            seconds=clock.laps,
            draws=None if r is None else np.asarray(clouds)[0],
        )

    def warm_up(self, samples: int = 1, **options: Any) -> None:
        """Compiles the network for these arguments of a call."""
        image, mask = np.zeros((96, 128, 3), np.uint8), np.zeros((96, 128), np.bool_)
        mask[24:72, 32:96] = True
        self(image, mask, samples=samples, **options)

    def _latents(self, samples: int, seed: int) -> np.ndarray | None:
        size = self.config.model.random_size
        most = MOST_CLOUDS if size else 1
        integer = isinstance(samples, int | np.integer) and samples is not True
        if not integer or not 1 <= samples <= most:
            accepted = f"1 to {most}" if size else "1, as this network has no random input"
            raise ConfigError(f"samples={samples}: accepted: {accepted}")
        if not size:
            if seed:
                raise ConfigError(f"seed={seed}: accepted: 0, as this network has no random input")
            return None
        if not isinstance(seed, int | np.integer) or not -(2**31) <= seed < 2**31:
            raise ConfigError(f"seed={seed}: accepted: an integer of 32 bits")
        return draws.image_latents(self.config, draws.num_draws(samples), int(seed))[None]


class Clock:
    """Seconds between laps."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Stores the seconds since the last lap."""
        now = time.perf_counter()
        self.laps[name], self._last = now - self._last, now
