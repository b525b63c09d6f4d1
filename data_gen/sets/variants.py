"""Draws variants of the objects in records, fast and without a renderer.

    python data_gen/sets/variants.py SRC DST [--variants 8] [--hybrids 0] [--seed 0] [...]
    psgn variants SRC DST [...]

For each model in the split `train` of the records SRC, the command draws images of variants with
other proportions (`catalogues.proportions`), for training. `psgn render --catalogue=records` with
`--option variants=8` does the same with more accurate edges and lights, in 13 times the time. With
`--hybrids 6`, there are also 6 images of hybrids of each model (`sets.hybrids`): a part of it,
joined with a part of one of its 12 most similar models of any category, more often of a more
similar one, with other proportions. It has the category of the model. If five cuts in turn leave
too little of either, the hybrid is left out.

Half of the variants are turned about the vertical by an angle that is uniform, the others by a
normally distributed one of .15 radians. The camera is that of the authors. An image is drawn from
the corners of the surfels (`catalogues.records`): each surfel has a grid of 4x4 samples, and a
pixel shows the nearest sample that is projected into it. A sample has the colour of its point,
multiplied by the ratio of the Lambertian shading of the turned surface under a random light to that
of the original surface under a fixed light, because the colours in the record include the shading.

Objects of records without depth are grey. The images have no depth. Images with fewer than 200
pixels of the object are left out. A model that cannot be drawn is reported and left out; the exit
code is then 1. If the command is started again, it keeps the complete shards and continues after
them. Shards from which a model was left out are drawn again.
"""

import argparse
import contextlib
import dataclasses
import functools
import pathlib
import sys
import zlib
from collections.abc import Iterator, Sequence

if __package__ in (None, ""):  # run as a file: `data_gen` is two folders above
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[2])

import numpy as np
from absl import logging
from jaxtyping import Float

from data_gen.catalogues import records
from data_gen.catalogues.proportions import DEVIATION
from data_gen.mesh import UnusableModelError
from data_gen.sets import hybrids
from psgn_jax.data.camera import default_camera, project
from psgn_jax.data.codec import encode
from psgn_jax.data.conversion import ConvertedRecord, Input, convert_inputs
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.framing import VIEW_SIZE
from psgn_jax.data.manifest import MANIFEST, Manifest, load_manifest
from psgn_jax.data.schema import BACKGROUND_GREY, RecordError, Sample
from psgn_jax.system.files import check_folder, exit_code_of
from psgn_jax.system.untrusted import message_line, one_line

MODELS_PER_SHARD = 200
MOST = 1000
"""Largest number of variants, and of hybrids, of a model with one seed."""

_FEWEST_PIXELS = 200
_KEPT = 200  # surfaces in memory, each up to 2.3 MB: models are partners of several others
_ATTEMPTS = 5  # to cut a hybrid
_NEARER = 1.5  # a larger power prefers more similar partners
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

    @functools.cached_property
    def box(self) -> hybrids.Box:
        """The box of the object; raises `UnusableModelError` if it lies in a vertical plane."""
        return hybrids.Box.around(self.points)

    def hybrid(self, other: "Surface", turn: int, rng: np.random.Generator) -> "Surface | None":
        """A part of this surface joined with one of another, see `hybrids`.

        Args:
          other: a similar object.
          turn: how it is turned, from `hybrids.most_similar`.
          rng: source of the cut.

        Returns:
          The hybrid, with the category of this surface; None if too little of either was left.

        Raises:
          UnusableModelError: the points of one of them lie in a vertical plane.
        """
        boxes = self.box, other.box
        cut = hybrids.random_cut(self.points, other.points, boxes, turn, rng)
        if cut is None:
            return None

        def join(mine: np.ndarray, others: np.ndarray) -> np.ndarray:
            return np.concatenate([mine[cut.first], others[cut.second]])

        return Surface(
            join(self.points, cut.moved(other.points)),
            join(self.corners, cut.moved(other.corners)),
            join(self.colours, other.colours),
            join(self.shading, other.shading),
            self.category,
        )

    def variant(self, name: str, deviation: float, rng: np.random.Generator) -> Sample:
        """An image of a variant, and `_POINTS` of its points.

        Args:
          name: `model_id` of the variant, from which its proportions are drawn.
          deviation: how much it differs, see `catalogues.proportions`.
          rng: source of its turn, light and points.

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
        intrinsics, extrinsics = default_camera(VIEW_SIZE)
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
    variants: int = 8, num_hybrids: int = 0, deviation: float = DEVIATION, seed: int = 0,
) -> tuple[Manifest, list[str]]:  # fmt: skip
    """Draws variants of the training models in `source` into the records `destination`.

    Args:
      source: a folder of records.
      destination: folder of the new records; created if missing.
      variants: number of variants of each model.
      num_hybrids: number of hybrids of each model, after its variants.
      deviation: how much they differ, see `catalogues.proportions`.
      seed: of all random choices; other seeds give other variants.

    Returns:
      The manifest, and a message for each model that was left out.

    Raises:
      ValueError: an argument is out of range, or `source` has no training models.
      RecordError: `destination` contains other records, or variants of other records, or with
        other arguments.
    """
    wrong = not 0 <= variants <= MOST or not 0 <= num_hybrids <= MOST or variants + num_hybrids == 0
    if wrong or seed < 0 or not 0 < deviation <= 1:
        raise ValueError(
            f"--variants={variants} --hybrids={num_hybrids} --seed={seed} --deviation={deviation}: "
            f"expected 0 to {MOST} variants and hybrids, not both 0, a seed of 0 or more, and a "
            "deviation above 0, at most 1"
        )
    source = pathlib.Path(source)

    @functools.lru_cache(_KEPT)
    def surface(index: int) -> Surface:
        return Surface.of(records.reader(str(source), "train")[index])

    @functools.cache
    def partners() -> dict[int, list[tuple[int, int]]]:
        logging.info("comparing %d models", len(training))
        return _partners(records.reader(str(source), "train"), list(training.values()))

    def hybrid(index: int, rng: np.random.Generator) -> Surface | None:
        own = surface(index)
        nearby = partners().get(index)
        if nearby is None:
            raise UnusableModelError("no hybrids: there is no other model that can be used")
        for _ in range(_ATTEMPTS):
            other, turn = nearby[int(len(nearby) * rng.random() ** _NEARER)]
            joined = own.hybrid(surface(other), turn, rng)
            if joined is not None:
                return joined
        return None

    def read(index: int, name: str) -> Iterator[ConvertedRecord]:
        own = surface(index)
        for kind, count, offset in (("variant", variants, 0), ("hybrid", num_hybrids, MOST)):
            for number in range(count):
                rng = np.random.default_rng([seed, index, offset + number])
                changed = own if kind == "variant" else hybrid(index, rng)
                if changed is None:
                    continue
                drawn = changed.variant(f"{name} {kind} {MOST * seed + number}", deviation, rng)
                if drawn.mask.sum() >= _FEWEST_PIXELS:
                    yield "train", encode(drawn), drawn

    models = records.first_records(str(source))
    shards = load_manifest(source).shards
    version = zlib.crc32("".join(f"{s.file}:{s.size}:{s.crc32};" for s in shards).encode())
    training = {name: index for name, (_, split, index) in models.items() if split == "train"}
    hybrid_tag = f"{num_hybrids} hybrids:" if num_hybrids else ""
    inputs = [
        Input(
            f"{name}:{index}:{variants}:{hybrid_tag}{deviation}:{seed}:{version:08x}",
            functools.partial(read, index, name),
        )
        for name, index in training.items()
    ]
    if not inputs:
        raise ValueError(f"SRC {str(source)!r}: the split 'train' is missing")
    destination = pathlib.Path(destination)
    if (destination / MANIFEST).exists():
        made = load_manifest(destination, allow_incomplete=True).shards
        known = {tag for shard in made for tag in shard.inputs}
        if known and known.isdisjoint(each.tag for each in inputs):
            raise RecordError(
                f"DST {str(destination)!r} contains variants of other records, or with other "
                "arguments; give another folder"
            )
    return convert_inputs("variants", source, inputs, destination, MODELS_PER_SHARD)


def _partners(stream: RecordReader, indices: Sequence[int]) -> dict[int, list[tuple[int, int]]]:
    """The most similar models of each usable model, and how they are turned."""
    shapes = {}
    for index in indices:
        with contextlib.suppress(UnusableModelError, RecordError):  # reported when it is drawn
            shapes[index] = hybrids.Shape.of(records.distinct_points(stream[index]))
    if len(shapes) < 2:
        return {}
    usable = list(shapes)
    others, turns = hybrids.most_similar(list(shapes.values()))
    return {
        index: [(usable[other], int(turn)) for other, turn in zip(*row, strict=True)]
        for index, *row in zip(usable, others, turns, strict=True)
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="psgn variants", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("source", metavar="SRC", help="folder of records")
    parser.add_argument("destination", metavar="DST", help="folder for the new records")
    parser.add_argument("--variants", type=int, default=8, help="variants of each model")
    parser.add_argument("--hybrids", type=int, default=0, help="hybrids of each model")
    parser.add_argument("--deviation", type=float, default=DEVIATION, help="how much they differ")
    parser.add_argument("--seed", type=int, default=0, help="other seeds give other variants")
    given = parser.parse_args(argv)
    logging.use_absl_handler()
    logging.set_verbosity(logging.INFO)
    try:
        check_folder(given.destination, "DST")
        manifest, refused = draw_variants(
            given.source, given.destination, variants=given.variants, num_hybrids=given.hybrids,
            deviation=given.deviation, seed=given.seed,
        )  # fmt: skip
    except (ValueError, OSError) as error:
        sys.stderr.write(f"error: {message_line(error)}\n")
        return exit_code_of(error) or 2
    count, size = sum(s.count for s in manifest.shards), sum(s.size for s in manifest.shards)
    sys.stdout.write(f"{count} samples, {size / 1e6:.1f} MB\n")
    for message in refused:
        sys.stderr.write(f"left out: {one_line(message)}\n")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
