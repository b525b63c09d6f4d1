"""Intersection of rays with a mesh in Mitsuba.

A model is one merged mesh. Models differ only in their data, so nothing is recompiled.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from data_gen import cameras, engine
from data_gen.cameras import Camera
from data_gen.scene import RayHits, Surfaces


class Mesh:
    """A mesh for ray intersection."""

    def __init__(self, corners: Float[np.ndarray, "f 3 3"]) -> None:
        """Builds the search structure of the triangles."""
        count = len(corners)
        mesh = engine.mi.Mesh("model", 3 * count, count, has_vertex_texcoords=True)
        values = engine.mi.traverse(mesh)
        values["vertex_positions"] = np.ascontiguousarray(corners, np.float32).ravel()
        values["faces"] = np.arange(3 * count, dtype=np.uint32)
        # With these, the texture coordinates of a hit are its barycentric coordinates.
        values["vertex_texcoords"] = np.tile(np.array([0, 0, 1, 0, 0, 1], np.float32), count)
        values.update()
        self._corners = corners
        self._scene = engine.mi.load_dict({"type": "scene", "model": mesh})

    def cast(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> RayHits:
        """The first hit of each ray; `t` is in units of the length of its direction."""
        count = len(directions)
        if not count:
            return RayHits(np.zeros(0, np.int64), np.zeros((0, 3), np.float32), np.zeros(0))
        if engine.mi.variant().startswith("scalar"):
            return self._cast_one_by_one(origins, directions)
        columns = [np.ascontiguousarray(a[:, k], np.float32) for a in (origins, directions)
                   for k in range(3)]  # fmt: skip
        ray = engine.mi.Ray3f(
            engine.mi.Point3f(*(engine.mi.Float(c) for c in columns[:3])),
            engine.mi.Vector3f(*(engine.mi.Float(c) for c in columns[3:])),
        )
        hits = self._scene.ray_intersect_preliminary(ray, coherent=True)
        engine.dr.eval(hits.t, hits.prim_index, hits.prim_uv)
        t = np.array(hits.t, np.float32)
        face = np.where(np.isfinite(t), np.array(hits.prim_index).astype(np.int64), -1)
        # The values of rays that hit nothing are arbitrary.
        one, two = np.where(face >= 0, np.array(hits.prim_uv, np.float32).reshape(2, count), 0)
        return RayHits(face, np.stack([1 - one - two, one, two], axis=1), t)

    def _cast_one_by_one(self, origins: np.ndarray, directions: np.ndarray) -> RayHits:
        face = np.full(len(directions), -1, np.int64)
        uv = np.zeros((len(directions), 2), np.float32)
        t = np.full(len(directions), np.inf, np.float32)
        scene, ray_of = self._scene, engine.mi.Ray3f
        for number, (origin, direction) in enumerate(
            zip(origins.tolist(), directions.tolist(), strict=True)
        ):
            hit = scene.ray_intersect_preliminary(ray_of(origin, direction), coherent=True)
            if hit.is_valid():
                face[number] = hit.prim_index
                uv[number] = hit.prim_uv
                t[number] = hit.t
        return RayHits(face, np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1), t)

    def cast_grid(self, camera: Camera, window: "Window", side: int) -> RayHits:
        """The first hits of all samples of a window; faster than `cast` in scalar mode."""
        height, width = camera.image_size
        to_model = np.eye(4)
        to_model[:3, :3] = (camera.extrinsics[:, :3] @ camera.rotation).T @ np.diag([-1, -1, 1])
        to_model[:3, 3] = camera.rotation.T @ camera.position
        sensor = engine.mi.load_dict(
            {
                "type": "perspective",
                "fov": float(2 * np.rad2deg(np.arctan(width / 2 / camera.intrinsics[0, 0]))),
                "fov_axis": "x",
                "near_clip": 1e-3,
                "far_clip": 1e4,
                "to_world": engine.mi.ScalarTransform4f(to_model),
                "film": {
                    "type": "hdrfilm",
                    "width": width * side,
                    "height": height * side,
                    "crop_offset_x": window.left * side,
                    "crop_offset_y": window.top * side,
                    "crop_width": window.width * side,
                    "crop_height": window.height * side,
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "stratified", "sample_count": 1, "jitter": False},
            }
        )
        integrator = engine.mi.load_dict({"type": "aov", "aovs": "p:position,i:prim_index,b:uv"})
        integrator.render(self._scene, sensor, 0, 1)
        values = np.array(sensor.film().bitmap(), np.float32)[..., -6:].reshape(-1, 6)
        place, uv = values[:, :3].astype(np.float64), values[:, 4:6]
        hit = np.abs(values).max(axis=1) > 0
        t = (place @ camera.rotation.T) @ camera.extrinsics[2, :3] + camera.extrinsics[2, 3]
        return RayHits(
            np.where(hit, values[:, 3].round().astype(np.int64), -1),
            np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1),
            np.where(hit, t, np.inf).astype(np.float32),
        )


@dataclasses.dataclass(frozen=True)
class Window:
    """A part of the image that contains the whole object."""

    top: int
    left: int
    height: int
    width: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slices of the rows and columns of the image."""
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)


def window_of(surfaces: Surfaces, camera: Camera) -> Window:
    """The smallest window that contains all vertices, plus a border of one pixel."""
    points = surfaces.vertices @ camera.rotation.T
    pixels, _ = cameras.project(points, camera)
    height, width = camera.image_size
    low = np.floor(np.nanmin(pixels, axis=0)).astype(int) - 1
    high = np.ceil(np.nanmax(pixels, axis=0)).astype(int) + 1
    left, right = np.clip([low[0], high[0]], 0, width)
    top, bottom = np.clip([low[1], high[1]], 0, height)
    return Window(int(top), int(left), max(int(bottom - top), 1), max(int(right - left), 1))


def camera_rays(camera: Camera, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Directions of rays, float32 [n, 3], in the view-aligned frame; depth 1 along the axis."""
    k = camera.intrinsics
    y = (rows - k[1, 2]) / k[1, 1]
    x = (columns - k[0, 2] - k[0, 1] * y) / k[0, 0]
    rays = np.stack([x, y, np.ones_like(x)], axis=1) @ camera.extrinsics[:, :3]
    return rays.astype(np.float32)
