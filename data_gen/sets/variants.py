"""Draws variants of the objects in records, fast and without a renderer.

    python data_gen/sets/variants.py SRC DST [--variants 8] [--cameras authors] [--seed 0] [...]
    psgn variants SRC DST [...]

For each model in the split `train` of the records SRC, the command draws images of variants with
other proportions (`catalogues.proportions`), for training. `psgn render --catalogue=records` with
`--option variants=8` does the same with more accurate edges and lights, in 13 times the time.

Half of the variants are turned about the vertical by an angle that is uniform, the others by a
normally distributed one of .15 radians. The camera is that of the authors; `--cameras=angles` or
`level` draws a camera of this preset of the renderer for each image (`data_gen.settings`). An image
is drawn from the corners of the surfels (`catalogues.records`): each surfel has a grid of 4x4
samples, and a pixel shows the nearest sample that is projected into it. A sample has the colour of
its point, multiplied by the ratio of the Lambertian shading of the turned surface under a random
light to that of the original surface under a fixed light, because the colours in the record include
the shading.

Objects of records without depth are grey. The images have no depth. Images with fewer than 200
pixels of the object are left out. A model that cannot be drawn is reported and left out; the exit
code is then 1. If the command is started again, it keeps the complete shards and continues after
them. Shards from which a model was left out are drawn again.
"""

import dataclasses
import functools
import pathlib
import sys
import zlib
from collections.abc import Iterator, Sequence

if __package__ in (None, ""):  # run as a file: `data_gen` is two folders above
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[2])

import numpy as np
from jaxtyping import Float

from data_gen import cameras, settings
from data_gen.catalogues import records
from data_gen.catalogues.proportions import DEVIATION
from psgn_jax.config.command_line import Flags
from psgn_jax.data.camera import default_camera, project
from psgn_jax.data.codec import encode
from psgn_jax.data.conversion import ConvertedRecord, convert
from psgn_jax.data.framing import VIEW_SIZE
from psgn_jax.data.manifest import Manifest, load_manifest
from psgn_jax.data.schema import BACKGROUND_GREY, Sample
from psgn_jax.data.shards import Tag
from psgn_jax.system.files import check_folder
from psgn_jax.system.processes import start_command
from psgn_jax.system.untrusted import one_line

MODELS_PER_SHARD = 200
CAMERAS = ("authors", "angles", "level")
"""Presets of the renderer whose cameras can draw variants."""

MOST = 1000
"""Largest number of variants of a model with one seed."""

_FEWEST_PIXELS = 200
_POINTS = 4096  # of a variant, drawn with probabilities proportional to the areas of the surfels
_GRID = 4  # samples along each side of a surfel
_TURN = 0.15  # standard deviation in radians of the small turns
_AMBIENT, _DIFFUSE = 0.55, 0.6
_LIGHT = np.array([0.5, 0.0, 0.8])  # direction to the light
_LIGHT_DEVIATION = np.array([0.1, 0.3, 0.1])
_RATIOS = 0.5, 1.7  # limits of the ratio of two shadings


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """Surfels of an object, with their colours."""

    points: Float[np.ndarray, "n 3"]
    corners: Float[np.ndarray, "n 4 3"]
    colours: Float[np.ndarray, "n 3"]  # 0 to 255
    shading: Float[np.ndarray, "n"]  # which the colours include
    category: str

    @classmethod
    def of(cls, sample: Sample) -> "Surface":
        """The surface of a sample.

        Raises:
          UnusableModelError: the sample has too few different points.
        """
        points = records.distinct_points(sample)
        colours, origin = records.appearance(sample, points)
        corners, normals = records.rectangles(points)
        eye = -sample.extrinsics[:, :3].T @ sample.extrinsics[:, 3]
        shading = _shading(_facing(normals, points, eye), _LIGHT)
        # Grey includes no shading.
        shading = np.ones(len(points)) if origin is None else shading[origin]
        return cls(points, corners, colours.astype(np.float32), shading, sample.category)

    def variant(
        self, name: str, deviation: float, rng: np.random.Generator, preset: str = "authors"
    ) -> Sample:
        """An image of a variant, and `_POINTS` of its points.

        Args:
          name: `model_id` of the variant, from which its proportions are drawn.
          deviation: how much it differs, see `catalogues.proportions`.
          rng: source of its turn, camera, light and points.
          preset: one of `CAMERAS`.

        Raises:
          UnusableModelError: the points lie in a vertical plane.
        """
        move = records.variation(self.points, name, deviation)
        angle = rng.uniform(-np.pi, np.pi) if rng.random() < 0.5 else _TURN * rng.normal()
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]).T
        points = move(self.points) @ turn
        corners = (move(self.corners.reshape(-1, 3)) @ turn).reshape(-1, 4, 3)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
        area = np.linalg.norm(across, axis=1)
        intrinsics, extrinsics = _camera(preset, corners.reshape(-1, 3), rng)
        eye = -extrinsics[:, :3].T @ extrinsics[:, 3]
        normals = _facing(across / (area[:, None] + 1e-12), points, eye)
        light = _LIGHT + rng.normal(size=3) * _LIGHT_DEVIATION
        ratio = np.clip(_shading(normals, light) / self.shading, *_RATIOS)
        colours = np.clip(self.colours * ratio[:, None], 0, 255).astype(np.uint8)
        image, mask = _drawn(corners, colours, intrinsics, extrinsics)
        # The largest of log(area) + Gumbel noise: a sample without replacement.
        order = np.argsort(-np.log(area + 1e-12) - rng.gumbel(size=len(area)), kind="stable")
        return Sample(
            image=image,
            mask=mask,
            points=points[order[:_POINTS]].astype(np.float32),
            intrinsics=intrinsics,
            extrinsics=extrinsics,
            category=self.category,
            model_id=name,
            source="variants",
        )


def _camera(
    preset: str, points: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Intrinsics and extrinsics of a camera of one of `CAMERAS`; the object is not turned."""
    if preset == "authors":
        return default_camera(VIEW_SIZE)
    chosen = settings.parse(settings.PRESETS[preset]).camera
    camera = cameras.draw(rng, dataclasses.replace(chosen, azimuth=(0.0, 0.0)), points)
    return camera.intrinsics.astype(np.float32), camera.extrinsics.astype(np.float32)


def _facing(normals: np.ndarray, points: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """The normals, each with the sign that makes it point to the side of the eye."""
    towards = np.einsum("ni,ni->n", normals, eye - points)
    return normals * np.where(towards < 0, -1, 1)[:, None]


def _shading(normals: np.ndarray, light: np.ndarray) -> np.ndarray:
    return _AMBIENT + _DIFFUSE * np.maximum(normals @ light / np.linalg.norm(light), 0)


def _drawn(
    corners: np.ndarray, colours: np.ndarray, intrinsics: np.ndarray, extrinsics: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Image and mask of rectangles [n, 4, 3] with colours [n, 3], seen by a camera."""
    height, width = VIEW_SIZE
    at = (np.arange(_GRID) + 0.5) / _GRID
    u, v = (x.reshape(-1, 1) for x in np.meshgrid(at, at))
    weights = np.concatenate([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)
    samples = (weights.astype(np.float32) @ corners.astype(np.float32)).reshape(-1, 3)
    places, depth = project(samples, intrinsics, extrinsics)
    pixels = np.floor(places).astype(np.int64)
    shown = ((pixels >= 0) & (pixels < [width, height])).all(axis=1)
    # The smallest code of a pixel belongs to the nearest sample; its low bits are the surfel.
    bits = len(corners).bit_length()
    surfel = np.arange(len(samples)) // _GRID**2
    codes = (depth * 65536).astype(np.int64) << bits | surfel
    nearest = np.full(height * width, np.iinfo(np.int64).max)
    np.minimum.at(nearest, (pixels @ [1, width])[shown], codes[shown])
    mask = nearest < np.iinfo(np.int64).max
    image = np.full((height * width, 3), BACKGROUND_GREY, np.uint8)
    image[mask] = colours[nearest[mask] & ((1 << bits) - 1)]
    return image.reshape(height, width, 3), mask.reshape(height, width)


def draw_variants(
    source: str | pathlib.Path, destination: str | pathlib.Path, *,
    variants: int = 8, deviation: float = DEVIATION, preset: str = "authors", seed: int = 0,
) -> tuple[Manifest, list[str]]:  # fmt: skip
    """Draws variants of the training models in `source` into the records `destination`.

    Args:
      source: a folder of records.
      destination: folder of the new records; created if missing.
      variants: number of variants of each model.
      deviation: how much they differ, see `catalogues.proportions`.
      preset: one of `CAMERAS`.
      seed: of all random choices; other seeds give other variants.

    Returns:
      The manifest, and a message for each model that was left out.

    Raises:
      ValueError: an argument is out of range, or `source` has no training models.
      OtherSettingsError: `destination` contains other records, or variants of other records, or
        with other arguments.
    """
    if not 1 <= variants <= MOST or seed < 0 or not 0 < deviation <= 1 or preset not in CAMERAS:
        raise ValueError(
            f"--variants={variants} --seed={seed} --deviation={deviation} --cameras={preset}: "
            f"expected 1 to {MOST} variants, a seed of 0 or more, a deviation above 0, at most 1, "
            f"and one of {', '.join(CAMERAS)}"
        )
    source = pathlib.Path(source)

    def read(index: int, name: str) -> Iterator[ConvertedRecord]:
        surface = Surface.of(records.reader(str(source), "train")[index])
        for number in range(variants):
            rng = np.random.default_rng([seed, index, number])
            variant = f"{name} variant {MOST * seed + number}"
            drawn = surface.variant(variant, deviation, rng, preset)
            if drawn.mask.sum() >= _FEWEST_PIXELS:
                yield "train", encode(drawn), drawn

    manifest, models = load_manifest(source), records.first_records(str(source))
    version = zlib.crc32("".join(f"{s.file}:{s.size}:{s.crc32};" for s in manifest.shards).encode())
    statement = {
        "source": "variants", "records": f"{version:08x}", "variants": variants, "seed": seed,
        "deviation": deviation, "cameras": preset,
    }  # fmt: skip
    inputs = [
        (Tag(name, category, split), functools.partial(read, index, name))
        for name, (category, split, index) in models.items()
        if split == "train"
    ]
    if not inputs:
        raise ValueError(f"SRC {str(source)!r}: the split 'train' is missing")
    return convert(statement, source, inputs, pathlib.Path(destination), MODELS_PER_SHARD)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    flags = Flags("psgn variants SRC DST", __doc__)
    flags.integer("variants", 8, "Variants of each model.")
    flags.float("deviation", DEVIATION, "How much they differ.")
    flags.enum("cameras", "authors", list(CAMERAS), "Preset of the cameras.")
    flags.integer("seed", 0, "Other seeds give other variants.")
    return flags.run(_main, argv, wrong_input=(ValueError,))


def _main(flags: Flags) -> int:
    values, (source, destination) = flags.values, flags.arguments
    check_folder(destination, "DST")
    manifest, refused = draw_variants(
        source, destination, variants=values.variants, deviation=values.deviation,
        preset=values.cameras, seed=values.seed,
    )  # fmt: skip
    count, size = sum(s.count for s in manifest.shards), sum(s.size for s in manifest.shards)
    sys.stdout.write(f"{count} samples, {size / 1e6:.1f} MB\n")
    for message in refused:
        sys.stderr.write(f"left out: {one_line(message)}\n")
    return 1 if refused else 0


if __name__ == "__main__":
    start_command()
    sys.exit(main())
