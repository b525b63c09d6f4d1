"""The data stage's settings: frozen dataclasses with their checks, to and from plain mappings."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from data_gen import cameras, frame, grounds
from data_gen.cameras import CameraSettings
from data_gen.lights import LightSettings
from data_gen.photo.film import FilmSettings
from psgn_jax import structured

SHADINGS = ("local", "path", "photo")
BACKGROUNDS = ("grey", "random", "folder", "surroundings")
GROUNDS = ("none", "random", *grounds.KINDS)
VARIANTS = ("auto", "llvm", "scalar")


def _between(name: str, value: Any, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ValueError(f"{name}: got {value}, expected {low:g} to {high:g}")


def _one_of(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ValueError(f"{name}: got {value!r}, expected one of {list(choices)}")


@dataclasses.dataclass(frozen=True)
class ImageSettings:
    """How pictures are made.

    Attributes:
      shading: "local" as in the paper; "path" with shadows and interreflection, by Mitsuba;
        "photo" with soft shadows, light from other surfaces, reflections and ground, at a tenth of
        the cost, see `data_gen.photo`.
      samples: samples along the edge of a pixel, 0 = its centre alone.
      soft_edges: whether edges are smoothed. The authors' images have hard ones.
      path_samples: per pixel of a path-traced image.
      background: "grey" as in the authors' images; "random" colours and gradients; a random image
        of a "folder"; what the environment map shows: "surroundings", for "photo" shading.
      background_folder: of .png and .jpg files.
      ground: what the object stands on, for "photo" shading: "none", one of `grounds.KINDS`, or
        "random" = one that fits the surroundings. It is in the image alone, never in mask or
        depth, and left out where the camera is below it.
      rays: that light is looked for with at each pixel, for "photo" shading.
    """

    shading: str = "local"
    samples: int = 3
    soft_edges: bool = False
    path_samples: int = 64
    background: str = "grey"
    background_folder: str = ""
    ground: str = "none"
    rays: int = 16

    def __post_init__(self) -> None:
        """Checks the fields."""
        _one_of("image.shading", self.shading, SHADINGS)
        _between("image.samples", self.samples, 0, 16)
        _between("image.path_samples", self.path_samples, 1, 65536)
        _one_of("image.background", self.background, BACKGROUNDS)
        if self.soft_edges and not self.samples and self.shading == "local":
            raise ValueError("image.soft_edges: got True, which has no effect with image.samples=0")
        if self.background == "folder" and not self.background_folder:
            raise ValueError("image.background_folder: got '', expected a folder of pictures")
        if self.background != "folder" and self.background_folder:
            raise ValueError(
                f"image.background_folder: got {self.background_folder!r}, which has no effect "
                f"without image.background=folder (it is {self.background!r})"
            )
        _one_of("image.ground", self.ground, GROUNDS)
        _between("image.rays", self.rays, 4, 1024)
        if self.shading != "photo":
            for name, value, without in (
                ("background", self.background == "surroundings", "grey"),
                ("ground", self.ground != "none", "none"),
            ):
                if value:
                    raise ValueError(
                        f"image.{name}: got {getattr(self, name)!r}, which has an effect with "
                        f"image.shading 'photo' alone; expected {without!r}"
                    )


@dataclasses.dataclass(frozen=True)
class CheckSettings:
    """What a view must hold to; a model with a view that does not is refused.

    Attributes:
      coverage: least part of the image that the object covers.
      inside: least part of the points that project into the mask grown by one pixel. Parts much
        thinner than a pixel, such as the strings of a racket, fall between the pixels' centres.
      depth: largest median distance of back-projected pixels from the nearest surface point, unit
        of the frame.
      luminance: least mean brightness of the object's pixels, 0 to 255.
    """

    coverage: float = 0.005
    inside: float = 0.9
    depth: float = 0.03
    luminance: float = 2.0

    def __post_init__(self) -> None:
        """Checks the fields."""
        for name, high in (("coverage", 1), ("inside", 1), ("depth", 100), ("luminance", 255)):
            _between(f"checks.{name}", getattr(self, name), 0, high)


@dataclasses.dataclass(frozen=True)
class JobSettings:
    """How the work is done; none of it changes the data.

    Attributes:
      workers: processes, 0 = one per processor.
      models_per_worker: after as many models a worker process is replaced: long-lived ones grow.
      seconds_per_model: more and the worker is ended, the model refused.
      megabytes_per_worker: more and the worker is ended, the model refused.
      variant: "llvm", "scalar", or the better one of those that work.
    """

    workers: int = 0
    models_per_worker: int = 200
    seconds_per_model: float = 300.0
    megabytes_per_worker: int = 4000
    variant: str = "auto"

    def __post_init__(self) -> None:
        """Checks the fields."""
        _between("job.workers", self.workers, 0, 4096)
        _between("job.models_per_worker", self.models_per_worker, 1, 1_000_000)
        _between("job.seconds_per_model", self.seconds_per_model, 1, 1e6)
        _between("job.megabytes_per_worker", self.megabytes_per_worker, 300, 1_000_000)
        _one_of("job.variant", self.variant, VARIANTS)


@dataclasses.dataclass(frozen=True)
class Settings:
    """All settings.

    Attributes:
      seed: of everything random; a model's own seed is made of this and its name.
      views: images of each model.
      centre: what of a model comes to x = y = 0: "bounds" or "vertices", see `frame.recentre`.
      num_points: surface points of each sample.
      point_bits: resolution of the stored points, see `psgn_jax.data.codec`.
      models_per_shard: models in one file of records.
      camera, light, image, film, checks, job: see their classes.
    """

    seed: int = 0
    views: int = 4
    centre: str = "bounds"
    num_points: int = 16384
    point_bits: int = 12
    models_per_shard: int = 128
    camera: CameraSettings = dataclasses.field(default_factory=CameraSettings)
    light: LightSettings = dataclasses.field(default_factory=LightSettings)
    image: ImageSettings = dataclasses.field(default_factory=ImageSettings)
    film: FilmSettings = dataclasses.field(default_factory=FilmSettings)
    checks: CheckSettings = dataclasses.field(default_factory=CheckSettings)
    job: JobSettings = dataclasses.field(default_factory=JobSettings)

    def __post_init__(self) -> None:
        """Checks the fields."""
        _between("seed", self.seed, 0, 2**63)
        _between("views", self.views, 1, 10_000)
        _one_of("centre", self.centre, frame.CENTRES)
        _between("num_points", self.num_points, 1, 1 << 20)
        _between("point_bits", self.point_bits, 1, 16)
        _between("models_per_shard", self.models_per_shard, 1, 100_000)


PRESETS: dict[str, Mapping[str, Mapping[str, Any]]] = {
    **{name: {"camera": camera} for name, camera in cameras.PRESETS.items()},
    "photo": {
        "camera": cameras.PRESETS["photo"],
        "light": {"source": "mixed"},
        "image": {
            "shading": "photo",
            "samples": 3,
            "soft_edges": True,
            "background": "surroundings",
            "ground": "random",
        },
    },
}
"""Named sets of settings that differ from the defaults, section by section."""


def to_dict(settings: Any) -> dict[str, Any]:
    """Nested dicts of a settings object, the form that configurations have."""
    return dataclasses.asdict(settings)


def parse(values: Mapping[str, Any]) -> Settings:
    """Settings from nested mappings (an `ml_collections.ConfigDict`, too); what lacks is default.

    Raises:
      ValueError: names the field that is unknown or wrong, its value, and what is accepted.
    """
    return structured.build(Settings, values)
