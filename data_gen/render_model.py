"""Renders the samples of a model and checks each view."""

import dataclasses
import hashlib
import json
import pathlib
import time
import zlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import scipy.ndimage
import scipy.spatial
from jaxtyping import Float

from data_gen import cameras, lights, surroundings
from data_gen.catalogues.entry import Entry
from data_gen.engine import Variant
from data_gen.frame import outline, recentre
from data_gen.mesh import Model, UnusableModelError, face_areas, face_normals
from data_gen.photograph import photograph
from data_gen.picture import Mesh, Picture, Scene, render
from data_gen.settings import Settings
from data_gen.solid import solid_occupancy
from data_gen.surface import sample_surface
from psgn_jax.data import schema
from psgn_jax.data.codec import encode
from psgn_jax.system.files import file_crc32

_COVERAGE = 0.0003  # `checks.coverage` of a model with missing faces

# Makes the random numbers of missing faces independent of the other random numbers of a seed.
_STREAM = zlib.crc32(b"missing faces")

_NO_OBJECT = 1e6  # not NaN, which is not JSON


def model_seed(seed: int, source: str, model_id: str) -> int:
    """The seed of a model, independent of the order and the number of models."""
    text = f"{seed}/{source}/{model_id}".encode("utf-8", "surrogatepass")
    return int.from_bytes(hashlib.sha256(text).digest()[:8], "big") >> 1


def line_of(entry: Entry, status: str, reason: str) -> dict[str, Any]:
    """The line of `models.jsonl` of a model, so far without samples."""
    names = {"model_id": entry.model_id, "category": entry.category, "split": entry.split}
    crc = checksum(entry.find_file) if status == "refused" else None
    stated = {} if crc is None else {"file_crc32": crc}
    return {**names, "status": status, "reason": reason, "samples": 0, **stated}


def checksum(find_file: Callable[[], pathlib.Path | None] | None) -> int | None:
    """The CRC-32 of a model's file; None if the file is missing or not readable."""
    path = find_file() if find_file else None
    try:
        return None if path is None else file_crc32(path)
    except OSError:
        return None


@dataclasses.dataclass(frozen=True, eq=False)
class Context:
    """The data of a job that workers need, apart from the models."""

    settings: Settings
    source: str
    variant: Variant
    maps: np.ndarray | None


def render_model(entry: Entry, context: Context) -> tuple[list[bytes], dict[str, Any]]:
    """All samples of a model as records, and its line of `models.jsonl`.

    The status in the line is "ok"; or "refused", "unreadable" or "memory" with a reason and without
    samples.
    """
    settings = context.settings
    seed = model_seed(settings.seed, context.source, entry.model_id)
    started = time.perf_counter()
    line = {**line_of(entry, "ok", ""), "seed": seed}
    done: list[bytes] = []
    views = []
    try:
        model = recentre(entry.load(), settings.centre)
        counts = {"faces": len(model.faces), "materials": len(model.materials)}
        line |= {**counts, "warnings": list(model.warnings)}
        surface = sample_surface(model, settings.num_points, seed)
        # An unbalanced tree takes less time to build, and a view makes only a few hundred queries.
        tree = scipy.spatial.cKDTree(surface, compact_nodes=False, balanced_tree=False)
        drawn, settings = without_faces(model, settings, seed)
        extremes = outline(model)
        mesh = Mesh(drawn)
        parameters = _rounded(model.parameters)
        for view in range(settings.views):
            rng = np.random.default_rng([seed, view])
            camera = cameras.draw(rng, settings.camera, extremes)
            around = surroundings.draw(
                rng, settings.light, context.maps, camera, detail=settings.image.shading == "photo"
            )
            light = lights.draw(rng, settings.light, around.radiance)
            shown = Scene(mesh, camera, light)
            if settings.image.shading == "local":
                image = settings.image
                picture = render(shown, side=image.samples, soft_edges=image.soft_edges)
            else:
                picture = photograph(shown, around, settings, rng)
            points = (surface @ camera.rotation.T).astype(np.float32)
            checks = check_view(picture, camera, points, tree)
            views.append({"view": view, **camera.parameters(), **checks})
            if objection := objection_to(checks, settings):
                raise UnusableModelError(f"view {view}: {objection}")
            occupancy = solid_occupancy(model, camera.rotation)
            extra = {
                "seed": seed, "camera": camera.parameters(), "parameters": parameters,
                # Rotates a point from the model's frame to the sample's.
                "rotation": np.round(camera.rotation, 9).tolist(),
            }  # fmt: skip
            sample = schema.Sample(
                image=picture.image, mask=picture.mask, depth=picture.depth, points=points,
                occupancy=occupancy, intrinsics=camera.intrinsics.astype(np.float32),
                extrinsics=camera.extrinsics.astype(np.float32), category=entry.category,
                model_id=entry.model_id, view=view, source=context.source,
                extra=json.dumps(extra, sort_keys=True, allow_nan=False),
            )  # fmt: skip
            done.append(encode(sample, point_bits=settings.point_bits))
    except UnusableModelError as error:
        line, done = line | line_of(entry, error.status, str(error)), []
    except MemoryError:
        line, done = line | line_of(entry, "memory", "it needs more memory than is available"), []
    seconds = round(time.perf_counter() - started, 3)
    return done, line | {"samples": len(done), "views": views, "seconds": seconds}


def without_faces(model: Model, settings: Settings, seed: int) -> tuple[Model, Settings]:
    """The part of a model for images, and settings with checks that accept it.

    The authors' images show parts of some objects of ShapeNet: faces that point inward, or without
    a readable material, are missing. The points cover the whole object. In .8 % of the images, more
    than a tenth of the points project outside the mask.

    A fraction `settings.image.missing` of the models loses faces: on a side (a random direction, in
    half of the cases up), or outside or inside of a ball around a point of the surface with a
    log-uniform radius in [.05, .8].
    """
    rng = np.random.default_rng([_STREAM, seed])
    if rng.random() >= settings.image.missing:
        return model, settings
    kind = rng.integers(4)
    if kind == 0:
        direction = rng.normal(size=3)
        if rng.random() < 0.5:
            direction = np.array([0.0, 0.0, 1.0])
        cosine = face_normals(model.vertices, model.faces) @ direction / np.linalg.norm(direction)
        kept = cosine < rng.uniform(0.0, 0.7)
    else:
        areas = face_areas(model.vertices, model.faces)
        centres = model.corners().mean(axis=1)
        chosen = rng.choice(len(areas), p=areas / areas.sum())
        radius = np.exp(rng.uniform(*np.log((0.05, 0.8))))
        near = np.linalg.norm(centres - centres[chosen], axis=1) <= radius
        kept = ~near if kind == 3 else near
    if not kept.any():
        return model, settings
    fields = ("faces", "normals", "uv", "face_material")
    part = dataclasses.replace(model, **{name: getattr(model, name)[kept] for name in fields})
    checks = dataclasses.replace(
        settings.checks, inside=0.0, coverage=min(_COVERAGE, settings.checks.coverage)
    )
    return part, dataclasses.replace(settings, checks=checks)


def check_view(
    picture: Picture,
    camera: cameras.Camera,
    points: Float[np.ndarray, "n 3"],
    tree: scipy.spatial.cKDTree,
) -> dict[str, float]:
    """The values of a view for `CheckSettings`, and `edge`: the number of mask pixels at the edge.

    `points` are in the view-aligned frame, the points of the search `tree` in the model's frame.
    """
    mask = picture.mask
    height, width = mask.shape
    pixels, z = cameras.project(points, camera)
    cells = np.floor(pixels).astype(int)
    here = ((cells >= 0) & (cells < [width, height])).all(axis=1) & (z > 0)
    column, row = cells[here].T
    grown = scipy.ndimage.binary_dilation(mask, np.ones((3, 3)))
    median = _NO_OBJECT
    rows, columns = np.nonzero(mask)
    if len(rows):
        some = slice(None, None, max(1, len(rows) // 400))
        rows, columns = rows[some], columns[some]
        pixel = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))]).T
        rays = pixel @ np.linalg.inv(camera.intrinsics).T
        inside = rays * picture.depth[rows, columns][:, None] - camera.extrinsics[:, 3]
        world = inside @ camera.extrinsics[:, :3] @ camera.rotation
        median = float(np.median(tree.query(world)[0]))
    return {
        "coverage": round(float(mask.mean()), 5),
        "edge": int(mask.sum() - mask[1:-1, 1:-1].sum()),
        "luminance": round(float(picture.image[mask].mean()) if mask.any() else 0.0, 2),
        "inside": round(float(grown[row, column].sum() / len(points)), 6),
        "depth": round(median, 5),
    }


def objection_to(checks: Mapping[str, float], settings: Settings) -> str:
    """The reason to refuse a view, or ""."""
    limits = settings.checks
    if checks["edge"]:
        return f"{checks['edge']} pixels of the object touch the border of the image, expected none"
    for name, text in (
        ("coverage", "the object covers {:.5f} of the image"),
        ("inside", "{:.4f} of the points project into the dilated mask"),
        ("depth", "the median distance of depth from points is {:.4f}"),
        ("luminance", "the object's brightness is {:.1f}"),
    ):
        value, limit = checks[name], getattr(limits, name)
        if value > limit if name == "depth" else value < limit:
            bound = "most" if name == "depth" else "least"
            return f"{text.format(value)}, expected at {bound} {limit}"
    return ""


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [_rounded(item) for item in value]
    return round(value, 9) if isinstance(value, float) else value
