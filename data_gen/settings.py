"""Settings of the data stage: frozen dataclasses that check their fields.

They can be converted to and from nested mappings.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

from data_gen import cameras, frame, grounds
from data_gen.cameras import CameraSettings
from data_gen.field_checks import check_between, check_one_of
from data_gen.lights import LightSettings
from data_gen.photo.film import FilmSettings
from psgn_jax import structured

SHADINGS = ("local", "path", "photo")
BACKGROUNDS = ("grey", "random", "folder", "surroundings")
GROUNDS = ("none", "random", *grounds.KINDS)
VARIANTS = ("auto", "llvm", "scalar")


@dataclasses.dataclass(frozen=True)
class ImageSettings:
    """How images are rendered.

    Attributes:
      shading: "local" as in the paper; "path" with shadows and interreflection, by Mitsuba;
        "photo" with soft shadows, light from other surfaces, reflections and ground, at a tenth of
        the cost of "path" (described in `data_gen.photo`).
      samples: samples along the edge of a pixel, 0 = only its centre.
      soft_edges: whether edges are antialiased. The authors' images have hard edges.
      path_samples: samples per pixel of a path-traced image.
      background: "grey" as in the authors' images; "random", noise in two random colours; "folder",
        a random image of `background_folder`; "surroundings", the environment map (for "photo"
        shading).
      background_folder: folder of .png and .jpg files.
      ground: the ground under the object, for "photo" shading: "none", one of `grounds.KINDS`, or
        "random" = one that fits the surroundings. It appears only in the image, not in mask and
        depth. It is left out if the camera is below it.
      rays: rays per pixel that sample the light, for "photo" shading.
      missing: fraction of the models that are rendered without some of their faces, see
        `data_gen.missing_faces`.
    """

    shading: str = "local"
    samples: int = 3
    soft_edges: bool = False
    path_samples: int = 64
    background: str = "grey"
    background_folder: str = ""
    ground: str = "none"
    rays: int = 16
    missing: float = 0.0

    def __post_init__(self) -> None:
        """Checks the fields."""
        check_one_of("image.shading", self.shading, SHADINGS)
        check_between("image.samples", self.samples, 0, 16)
        check_between("image.path_samples", self.path_samples, 1, 65536)
        check_one_of("image.background", self.background, BACKGROUNDS)
        if self.soft_edges and not self.samples and self.shading == "local":
            raise ValueError("image.soft_edges: got True, which has no effect with image.samples=0")
        if self.background == "folder" and not self.background_folder:
            raise ValueError("image.background_folder: got '', expected a folder of pictures")
        if self.background != "folder" and self.background_folder:
            raise ValueError(
                f"image.background_folder: got {self.background_folder!r}, which has no effect "
                f"without image.background=folder (it is {self.background!r})"
            )
        check_one_of("image.ground", self.ground, GROUNDS)
        check_between("image.rays", self.rays, 4, 1024)
        check_between("image.missing", self.missing, 0, 1)
        if self.shading != "photo":
            for name, value, without in (
                ("background", self.background == "surroundings", "grey"),
                ("ground", self.ground != "none", "none"),
            ):
                if value:
                    raise ValueError(
                        f"image.{name}: got {getattr(self, name)!r}, which has an effect only with "
                        f"image.shading 'photo'; expected {without!r}"
                    )


@dataclasses.dataclass(frozen=True)
class CheckSettings:
    """Checks of every view; a model with a view that fails one of them is refused.

    Attributes:
      coverage: smallest fraction of the image that the object covers.
      inside: smallest fraction of the points that project into the mask dilated by one pixel. It is
        below 1 because parts much thinner than a pixel, such as the strings of a racket, lie
        between the centres of the pixels.
      depth: largest median distance of back-projected pixels from the nearest surface point, in
        units of the frame.
      luminance: smallest mean brightness of the object's pixels, 0 to 255.
    """

    coverage: float = 0.005
    inside: float = 0.9
    depth: float = 0.03
    luminance: float = 2.0

    def __post_init__(self) -> None:
        """Checks the fields."""
        for name, high in (("coverage", 1), ("inside", 1), ("depth", 100), ("luminance", 255)):
            check_between(f"checks.{name}", getattr(self, name), 0, high)


@dataclasses.dataclass(frozen=True)
class JobSettings:
    """How the job runs.

    None of these settings changes the samples of a model, except that the images of the two
    variants of Mitsuba differ by rounding. `seconds_per_model` and `megabytes_per_worker` decide
    which models are refused.

    Attributes:
      workers: number of processes, 0 = one per processor.
      models_per_worker: a worker process is replaced after this many models, because its memory
        grows.
      seconds_per_model: a model that takes longer is refused and its worker is stopped.
      megabytes_per_worker: a model that needs more memory is refused and its worker is stopped.
      variant: "llvm", "scalar", or "auto" = LLVM if it works.
    """

    workers: int = 0
    models_per_worker: int = 200
    seconds_per_model: float = 300.0
    megabytes_per_worker: int = 4000
    variant: str = "auto"

    def __post_init__(self) -> None:
        """Checks the fields."""
        check_between("job.workers", self.workers, 0, 4096)
        check_between("job.models_per_worker", self.models_per_worker, 1, 1_000_000)
        check_between("job.seconds_per_model", self.seconds_per_model, 1, 1e6)
        check_between("job.megabytes_per_worker", self.megabytes_per_worker, 300, 1_000_000)
        check_one_of("job.variant", self.variant, VARIANTS)


@dataclasses.dataclass(frozen=True)
class Settings:
    """All settings.

    Attributes:
      seed: seed of all random choices; the seed of a model is computed from it and the name.
      views: number of images of each model.
      centre: the point of a model that is moved to x = y = 0: "bounds" or "vertices", see
        `frame.recentre`.
      num_points: number of surface points of each sample.
      point_bits: resolution of the stored points, see `psgn_jax.data.codec`.
      models_per_shard: number of models in a file of records.
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
        check_between("seed", self.seed, 0, 2**63)
        check_between("views", self.views, 1, 10_000)
        check_one_of("centre", self.centre, frame.CENTRES)
        check_between("num_points", self.num_points, 1, 1 << 20)
        check_between("point_bits", self.point_bits, 1, 16)
        check_between("models_per_shard", self.models_per_shard, 1, 100_000)


PRESETS: dict[str, Mapping[str, Mapping[str, Any]]] = {
    **{name: {"camera": camera} for name, camera in cameras.PRESETS.items()},
    "angles": {"camera": cameras.PRESETS["photo"]},
    "level": {"camera": {**cameras.PRESETS["photo"], "elevation": (-8.0, 10.0)}},
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
"""Presets: the settings that differ from the defaults, by section."""


def to_dict(settings: Any) -> dict[str, Any]:
    """A settings object as nested dicts, the form of a configuration."""
    return dataclasses.asdict(settings)


def parse(values: Mapping[str, Any]) -> Settings:
    """Settings from nested mappings, such as an `ml_collections.ConfigDict`.

    Fields that are missing keep their defaults.

    Raises:
      ValueError: a field is unknown or invalid; the message says what was expected.
    """
    return structured.build(Settings, values)
