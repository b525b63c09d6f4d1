"""Settings of the renderer: frozen dataclasses, from nested mappings by `parse`."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from data_gen.cameras import CameraSettings, Range
from data_gen.lights import LightSettings
from data_gen.surroundings import GROUNDS
from psgn_jax.config import structured
from psgn_jax.config.structured import Bounds, Fraction, Size, Within


@dataclasses.dataclass(frozen=True)
class ImageSettings:
    """Shading, background and ground of images.

    Attributes:
      shading: "local" as in the paper, or "photo": Mitsuba traces paths, with shadows, light from
        other surfaces, reflections and ground, and a film develops the image.
      samples: samples along the edge of a pixel; 0 = the centre.
      soft_edges: whether to antialias edges, as "photo" shading always does. The authors' images
        have hard edges.
      background: "grey" as in the authors' images, or "surroundings", the environment map.
      ground: "none", a kind in `surroundings.GROUNDS`, or "random": a kind that fits the
        surroundings. Mask and depth do not show the ground, and no ground is above the camera.
      rays: paths per pixel, for "photo" shading.
      missing: fraction of the models that lose some of their faces in the images.
    """

    shading: Literal["local", "photo"] = "local"
    samples: Annotated[int, Bounds(0, 16)] = 3
    soft_edges: bool = False
    background: Literal["grey", "surroundings"] = "grey"
    ground: Literal[("none", "random", *GROUNDS)] = "none"  # type: ignore[valid-type]
    rays: Annotated[int, Bounds(1, 65536)] = 16
    missing: Fraction = 0.0


@dataclasses.dataclass(frozen=True)
class FilmSettings:
    """The response of a camera, for "photo" shading: ranges of uniform distributions.

    Attributes:
      exposure: deviation from automatic exposure, in stops.
      white_balance: fraction of the light's colour that we remove.
      contrast: of the tone curve; 0 = linear, 1 = film.
      saturation: factor of the distance of colours from grey.
      vignette: relative darkening of the corners.
      blur: of the lens, standard deviation in pixels.
      grain: of the sensor; the standard deviation at middle grey is about half of it (white is 1).
    """

    exposure: Annotated[Range, Within(-10, 10)] = (-0.6, 0.5)
    white_balance: Annotated[Range, Within(0, 1)] = (0.6, 1.0)
    contrast: Annotated[Range, Within(0, 1)] = (0.7, 1.0)
    saturation: Annotated[Range, Within(0, 4)] = (0.9, 1.25)
    vignette: Annotated[Range, Within(0, 1)] = (0.0, 0.25)
    blur: Annotated[Range, Within(0, 10)] = (0.3, 0.6)
    grain: Annotated[Range, Within(0, 1)] = (0.0, 0.02)


@dataclasses.dataclass(frozen=True)
class CheckSettings:
    """Checks of each view. We refuse a model if one of its views fails a check.

    Attributes:
      coverage: smallest fraction of the image that the object covers.
      inside: smallest fraction of the points that project into the mask, dilated by a pixel. Parts
        thinner than a pixel may be between the centres of pixels.
      depth: largest median distance of back-projected pixels from the nearest surface point.
      luminance: smallest mean brightness of the object's pixels, 0 to 255.
    """

    coverage: Fraction = 0.005
    inside: Fraction = 0.9
    depth: Annotated[float, Bounds(0, 100)] = 0.03
    luminance: Annotated[float, Bounds(0, 255)] = 2.0


@dataclasses.dataclass(frozen=True)
class JobSettings:
    """Processes and limits of a job. Samples depend on the rounding of the variant only.

    Attributes:
      workers: number of processes; 0 = the number of cores.
      models_per_worker: number of models before we replace a process, because its memory grows.
      seconds_per_model: largest time of a model; we refuse models that take longer.
      megabytes_per_worker: largest memory of a process, on Linux; we refuse models that take more.
      variant: of Mitsuba: "llvm", "scalar", or "auto" = LLVM if it works.
    """

    workers: Annotated[int, Bounds(0, 4096)] = 0
    models_per_worker: Size = 200
    seconds_per_model: Annotated[float, Bounds(1, 1e6)] = 300.0
    megabytes_per_worker: Annotated[int, Bounds(300, 1_000_000)] = 4000
    variant: Literal["auto", "llvm", "scalar"] = "auto"


@dataclasses.dataclass(frozen=True)
class Settings:
    """All settings.

    Attributes:
      seed: of all random choices; a model's seed depends on it and on the model's name.
      views: number of images of each model.
      centre: the point of a model that moves to x = y = 0: "bounds" or "vertices", see
        `frame.recentre`.
      num_points: number of surface points of each sample.
      point_bits: resolution of the stored points, see `psgn_jax.data.codec`.
      models_per_shard: number of models in a file of records.
      camera, light, image, film, checks, job: see their classes.
    """

    seed: Annotated[int, Bounds(0, 2**63)] = 0
    views: Annotated[int, Bounds(1, 10_000)] = 4
    centre: Literal["bounds", "vertices"] = "bounds"
    num_points: Annotated[int, Bounds(1, 1 << 20)] = 16384
    point_bits: Annotated[int, Bounds(1, 16)] = 12
    models_per_shard: Annotated[int, Bounds(1, 100_000)] = 128
    camera: CameraSettings = dataclasses.field(default_factory=CameraSettings)
    light: LightSettings = dataclasses.field(default_factory=LightSettings)
    image: ImageSettings = dataclasses.field(default_factory=ImageSettings)
    film: FilmSettings = dataclasses.field(default_factory=FilmSettings)
    checks: CheckSettings = dataclasses.field(default_factory=CheckSettings)
    job: JobSettings = dataclasses.field(default_factory=JobSettings)

    def __post_init__(self) -> None:
        """Refuses settings that contradict each other or, by `EFFECTS`, have no effect."""
        local, image, light = self.image.shading == "local", self.image, self.light
        structured.check_used(self, EFFECTS)
        structured.check_rules(self, [
            ("light.folder", light.source == "folder" and not light.folder,
             "a folder of .hdr and .exr files"),
            ("image.background", image.background == "surroundings" and local,
             "'grey' with image.shading='local'"),
        ])  # fmt: skip


EFFECTS: tuple[structured.Need, ...] = (
    ("image.shading='photo'", lambda s: s.image.shading == "photo",
     ("image.rays", "image.ground", *(f"film.{f.name}" for f in dataclasses.fields(FilmSettings)))),
    ("image.shading='local'", lambda s: s.image.shading == "local",
     ("image.samples", "image.soft_edges", "light.count", "light.ambient", "light.exposure",
      "light.saturation", "light.darkest")),
    ("image.samples > 0", lambda s: s.image.samples > 0, ("image.soft_edges",)),
    ("image.background='surroundings'", lambda s: s.image.background == "surroundings",
     ("image.ground",)),
    ("light.source is 'folder' or 'mixed'", lambda s: s.light.source in ("folder", "mixed"),
     ("light.folder",)),
    ("camera.focal differs from 400", lambda s: s.camera.focal != (400.0, 400.0),
     ("camera.keep_size",)),
)  # fmt: skip


# As in photographs taken by hand: lenses of 28 to 105 mm on 35 mm film, many elevations, a slight
# roll, the object off centre.
_HAND_HELD: dict[str, Any] = {
    "elevation": (-5.0, 60.0), "distance": (3.5, 4.8), "focal": (230.0, 840.0),
    "roll": (-4.0, 4.0), "keep_size": True, "off_centre": 0.7,
}  # fmt: skip

# Choy et al. 2016: 137 x 137 pixels, elevation 25 to 30 degrees, a 35 mm lens on a 32 mm sensor.
# The distance is 0.65 to 1 times 1.75, for objects with a longest side of 1.
_R2N2: dict[str, Any] = {
    "image_size": (137, 137), "elevation": (25.0, 30.0), "distance": (2.0, 3.07),
    "focal": (210.0, 210.0), "aim": (0.3, 0.3),
}  # fmt: skip

PRESETS: dict[str, Mapping[str, Mapping[str, Any]]] = {
    "authors": {},
    "r2n2": {"camera": _R2N2},
    "angles": {"camera": _HAND_HELD},
    "level": {"camera": {**_HAND_HELD, "elevation": (-8.0, 10.0)}},
    "photo": {
        "camera": _HAND_HELD,
        "light": {"source": "mixed"},
        "image": {"shading": "photo", "background": "surroundings", "ground": "random"},
    },
}
"""The settings of each preset that differ from the defaults, by section."""


def parse(values: Mapping[str, Any]) -> Settings:
    """Settings from a nested mapping; ValueError if a field is unknown or invalid."""
    return structured.build(Settings, values)
