"""Path tracing of a scene with Mitsuba."""

from typing import Any

import numpy as np
from jaxtyping import Float

from data_gen import engine
from data_gen.scene import Scene


def path_trace(
    scene: Scene, radiance: Float[np.ndarray, "h w 3"], *, samples: int, seed: int
) -> Float[np.ndarray, "h w 4"]:
    """Premultiplied colours with shadows and interreflection, and opacity.

    Deliberately one function: the description of a scene for Mitsuba, from top to bottom.

    Each material becomes a material of Mitsuba. Mitsuba therefore compiles every scene, which takes
    some seconds per model.

    Args:
      scene: the scene; its directional lights are ignored.
      radiance: the environment map, in the view-aligned frame.
      samples: number of samples per pixel.
      seed: seed of the samples.
    """
    surfaces, camera = scene.surfaces, scene.camera
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6, "hide_emitters": True},
    }
    corners = surfaces.corners @ camera.rotation.T.astype(np.float32)
    normals = surfaces.normals @ camera.rotation.T.astype(np.float32)
    for number in np.unique(surfaces.material):
        own = np.flatnonzero(surfaces.material == number)
        height, width = (int(s) for s in surfaces.texture_size[number])
        begin = int(surfaces.texture_start[number])
        texels = surfaces.texels[begin : begin + height * width].view(np.uint8)
        texture = texels.reshape(height, width, 4).astype(np.float32) / 255
        # Mitsuba computes with linear RGB.
        linear = (texture[..., :3] * surfaces.diffuse[number]) ** 2.2
        alpha = texture[..., 3:] * surfaces.opacity[number]

        def bitmap(values: np.ndarray) -> dict[str, Any]:
            return {
                "type": "bitmap",
                "bitmap": engine.mi.Bitmap(np.ascontiguousarray(values, np.float32)),
                "raw": True,
                "filter_type": "nearest" if values.size < 16 else "bilinear",
            }

        strength = float(np.clip(surfaces.specular[number].mean() * scene.lights.specular, 0, 1))
        bsdf = {
            "type": "principled",
            "base_color": bitmap(linear),
            "roughness": float(np.clip((2 / (surfaces.shininess[number] + 2)) ** 0.25, 0.1, 1)),
            "specular": strength,
        }
        mesh = engine.mi.Mesh(
            f"part{number}", 3 * len(own), len(own), has_vertex_normals=True,
            has_vertex_texcoords=True,
            props=_properties({"type": "mask", "opacity": bitmap(alpha),
                               "bsdf": {"type": "twosided", "bsdf": bsdf}}),
        )  # fmt: skip
        values = engine.mi.traverse(mesh)
        values["vertex_positions"] = np.ascontiguousarray(corners[own]).ravel()
        values["vertex_normals"] = np.ascontiguousarray(normals[own]).ravel()
        # In Mitsuba, v increases downward from the first row of an image, here upward.
        uv = surfaces.uv[own] * np.array([1, -1], np.float32) + np.array([0, 1], np.float32)
        values["vertex_texcoords"] = np.ascontiguousarray(uv, np.float32).ravel()
        values["faces"] = np.arange(3 * len(own), dtype=np.uint32)
        values.update()
        parts[f"part{number}"] = mesh
    # In Mitsuba's maps +y is up, and column u shows the direction with atan2(x, -z) = 2 pi u. Our
    # map is passed with its columns reversed. Our direction (x, y, z) is then Mitsuba's direction
    # (-y, z, -x), and this rotation maps it back.
    turn = np.eye(4)
    turn[:3, :3] = [[0, 0, -1], [-1, 0, 0], [0, 1, 0]]
    parts["light"] = {
        "type": "envmap",
        "bitmap": engine.mi.Bitmap(np.ascontiguousarray(radiance[:, ::-1], np.float32)),
        "to_world": engine.mi.ScalarTransform4f(turn),
    }
    height, width = camera.image_size
    to_world = np.eye(4)
    to_world[:3, :3] = camera.extrinsics[:, :3].T @ np.diag([-1, -1, 1])
    to_world[:3, 3] = camera.position
    sensor = engine.mi.load_dict(
        {
            "type": "perspective",
            "fov": float(2 * np.rad2deg(np.arctan(width / 2 / camera.intrinsics[0, 0]))),
            "fov_axis": "x",
            "to_world": engine.mi.ScalarTransform4f(to_world),
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "pixel_format": "rgba",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent", "sample_count": samples},
        }
    )
    image = engine.mi.render(engine.mi.load_dict(parts), sensor=sensor, spp=samples, seed=seed)
    values = np.nan_to_num(np.array(image, np.float32))
    opacity = np.clip(values[..., 3:], 0, 1)
    linear = values[..., :3] / np.maximum(opacity, 1e-3)
    return np.concatenate([np.clip(linear, 0, 1) ** (1 / 2.2) * opacity, opacity], axis=-1)


def _properties(bsdf: dict[str, Any]) -> Any:
    properties = engine.mi.Properties()
    properties["mesh_bsdf"] = engine.mi.load_dict(bsdf)
    return properties
