"""Renders the samples of a model."""

import dataclasses
import hashlib
import json
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.spatial

from data_gen import cameras, lights, missing_faces, scene, surroundings
from data_gen.backgrounds import draw_background
from data_gen.catalogues.entry import Entry
from data_gen.frame import outline, recentre
from data_gen.mesh import UnusableModelError
from data_gen.mitsuba_setup import Variant
from data_gen.path_trace import path_trace
from data_gen.photo.backdrop import draw_ground
from data_gen.photo.photograph import photograph
from data_gen.picture import Picture, compose, render
from data_gen.ray_mesh import Mesh
from data_gen.settings import Settings
from data_gen.surface import sample_surface
from data_gen.view_checks import check_view, objection_to
from data_gen.voxelise import solid_occupancy
from psgn_jax.data import schema
from psgn_jax.data.codec import encode


def model_seed(seed: int, source: str, model_id: str) -> int:
    """The seed of a model. It does not depend on the order or number of models."""
    text = f"{seed}/{source}/{model_id}".encode("utf-8", "surrogatepass")
    return int.from_bytes(hashlib.sha256(text).digest()[:8], "big") >> 1


@dataclasses.dataclass(frozen=True, eq=False)
class Context:
    """Data of a job that workers need besides the models."""

    settings: Settings
    source: str
    variant: Variant
    maps: np.ndarray | None
    pictures: list[str]


class _Laps:
    """Seconds of each step, summed over the views of a model."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._clock = time.perf_counter()

    def end(self, name: str) -> None:
        """Adds the time since the previous step to this step."""
        now = time.perf_counter()
        self.seconds[name] = round(self.seconds.get(name, 0.0) + now - self._clock, 4)
        self._clock = now


def render_model(entry: Entry, context: Context) -> tuple[list[bytes], dict[str, Any]]:
    """All samples of a model as records, and its line in `models.jsonl`.

    Deliberately one function: the steps from mesh to records in order, each with its time in the
    report.

    The `status` of the line is "ok", or "refused" with a `reason`; a refused model has no samples.
    """
    settings = context.settings
    seed = model_seed(settings.seed, context.source, entry.model_id)
    laps = _Laps()
    line: dict[str, Any] = {
        "model_id": entry.model_id,
        "category": entry.category,
        "split": entry.split,
        "status": "refused",
        "reason": "",
        "seed": seed,
        "samples": 0,
    }
    done: list[bytes] = []
    views = []
    try:
        model = recentre(entry.load(), settings.centre)
        laps.end("load")
        line |= {
            "faces": len(model.faces),
            "materials": len(model.materials),
            "warnings": list(model.warnings),
        }
        surface = sample_surface(model, settings.num_points, seed)
        # Unbalanced, which is faster to build; there are only a few hundred queries per view.
        tree = scipy.spatial.cKDTree(surface.points, compact_nodes=False, balanced_tree=False)
        laps.end("points")
        drawn, settings = missing_faces.draw(model, settings, seed)
        surfaces = scene.flatten(drawn)
        extremes = outline(model)
        mesh = Mesh(surfaces.corners)
        laps.end("mesh")
        parameters = _plain(model.parameters)
        for view in range(settings.views):
            rng = np.random.default_rng([seed, view])
            camera = cameras.draw(rng, settings.camera, extremes)
            light, around = surroundings.draw(rng, settings.light, context.maps)
            behind = draw_background(rng, settings, context.pictures)
            shown = scene.Scene(surfaces, camera, light, behind)
            laps.end("light")
            picture = _picture_of(mesh, shown, around, settings, rng, seed + view)
            laps.end("render")
            points = (surface.points @ camera.rotation.T).astype(np.float32)
            checks = check_view(picture, camera, points, tree)
            views.append({"view": view, **camera.parameters(), **checks})
            objection = objection_to(checks, settings)
            laps.end("check")
            if objection:
                raise UnusableModelError(f"view {view}: {objection}")
            normals = (surface.normals @ camera.rotation.T).astype(np.float32)
            occupancy = solid_occupancy(model, camera.rotation)
            laps.end("occupancy")
            sample = schema.Sample(
                image=picture.image,
                mask=picture.mask,
                depth=picture.depth,
                points=points,
                normals=normals,
                occupancy=occupancy,
                intrinsics=camera.intrinsics.astype(np.float32),
                extrinsics=camera.extrinsics.astype(np.float32),
                category=entry.category,
                model_id=entry.model_id,
                view=view,
                source=context.source,
                extra=_extra(seed, camera, parameters),
            )
            done.append(encode(sample, point_bits=settings.point_bits))
            laps.end("encode")
        line["status"] = "ok"
    except UnusableModelError as error:
        line["reason"], done = str(error), []
    except MemoryError:
        line["reason"], done = "it needs more memory than is available", []
    line["samples"] = len(done)
    line["views"] = views
    line["seconds"] = laps.seconds
    line["megabytes"] = round(peak_megabytes())
    return done, line


def _extra(seed: int, camera: cameras.Camera, parameters: Any) -> str:
    """The field `extra` of a record, as JSON."""
    extra = {
        "seed": seed,
        # Rotates a point from the model's frame to that of the sample.
        "rotation": np.round(camera.rotation, 9).tolist(),
        "camera": camera.parameters(),
        "parameters": parameters,
    }
    return json.dumps(extra, sort_keys=True, allow_nan=False)


def _picture_of(
    mesh: Mesh,
    shown: scene.Scene,
    around: surroundings.Surroundings,
    settings: Settings,
    rng: np.random.Generator,
    seed: int,
) -> Picture:
    """The picture of a view, with the shading of the settings."""
    photographed = settings.image.shading == "photo"
    picture = render(
        mesh,
        shown,
        side=0 if photographed else settings.image.samples,
        soft_edges=settings.image.soft_edges,
    )
    if settings.image.shading == "path":
        return _traced(picture, shown, around.radiance, settings, seed)
    if photographed:
        return _photographed(picture, mesh, shown, around, settings, rng)
    return picture


def _traced(
    picture: Picture, shown: scene.Scene, radiance: np.ndarray, settings: Settings, seed: int
) -> Picture:
    """The picture with path-traced colours."""
    # Scaled so that a white surface in full light is as bright as with local shading.
    strength = shown.lights.colours.sum() + 3 * shown.lights.sky.mean()
    radiance = lights.shrink(radiance)
    flux = (radiance * lights.solid_angles(lights.MAP_SIZE)[..., None]).sum()
    colours = path_trace(
        shown,
        radiance * (strength * np.pi / max(flux, 1e-9)),
        samples=settings.image.path_samples,
        seed=seed % 2**31,
    )
    if not settings.image.soft_edges:
        # Hard edges: a pixel whose centre shows the object has only the object's colour.
        opacity = np.where(picture.mask, picture.opacity, 0)[..., None]
        colours = np.concatenate(
            [colours[..., :3] / np.maximum(colours[..., 3:], 1e-3) * opacity, opacity], axis=-1
        )
    return picture._replace(image=compose(colours, shown.background))


def _photographed(
    picture: Picture,
    mesh: Mesh,
    shown: scene.Scene,
    around: surroundings.Surroundings,
    settings: Settings,
    rng: np.random.Generator,
) -> Picture:
    """The picture with the colours of a photograph."""
    image = photograph(
        mesh,
        shown,
        picture,
        around,
        draw_ground(rng, settings.image.ground, around, shown.camera),
        film=settings.film,
        side=settings.image.samples,
        soft_edges=settings.image.soft_edges,
        rays=settings.image.rays,
        show_surroundings=settings.image.background == "surroundings",
        rng=rng,
    )
    return picture._replace(image=image)


def _plain(value: Any) -> Any:
    """A value in the types of JSON."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return round(value, 9) if np.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int)) else str(value)


def peak_megabytes() -> float:
    """Peak memory of this process in MB."""
    try:
        with open("/proc/self/status") as file:
            for text in file:
                if text.startswith("VmHWM"):
                    return int(text.split()[1]) / 1024
    except OSError:
        pass
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
