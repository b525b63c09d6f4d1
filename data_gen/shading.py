"""Local shading of ray hits: Blinn-Phong under directional lights, in numpy.

As in the paper's images, there are no shadows and no interreflection. We compute with display
values (sRGB), without a transfer curve.
"""

import numpy as np
from jaxtyping import Float, Int

from data_gen.lights import Lights
from data_gen.mesh import EXISTS
from data_gen.scene import Surfaces


def look_up(
    surfaces: Surfaces, face: Int[np.ndarray, " n"], weights: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Diffuse colour and opacity at points of faces; opacities below `EXISTS` become 0.

    We read the nearest texel, because samples within a pixel antialias textures.
    """
    owner = surfaces.material[face]
    colour = surfaces.diffuse[owner]
    opacity = surfaces.opacity[owner]
    textured = np.flatnonzero(surfaces.texture_start[owner])
    if len(textured):
        which = owner[textured]
        uv = np.einsum("nk,nkd->nd", weights[textured], surfaces.uv[face[textured]])
        uv -= np.floor(uv)
        height, width = surfaces.texture_size[which].T
        column = np.minimum((uv[:, 0] * width).astype(np.int64), width - 1)
        row = np.minimum(((1 - uv[:, 1]) * height).astype(np.int64), height - 1)
        index = surfaces.texture_start[which] + row * width + column
        texel = surfaces.texels[index].view(np.uint8).reshape(-1, 4).astype(np.float32) / 255
        colour[textured] *= texel[:, :3]
        opacity[textured] *= texel[:, 3]
    return colour, np.where(opacity < EXISTS, 0, opacity)


def shading_normals(
    surfaces: Surfaces,
    face: Int[np.ndarray, " n"],
    weights: Float[np.ndarray, "n 3"],
    rotation: Float[np.ndarray, "3 3"],
    rays: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 3"]:
    """Unit normals of hits on the viewer's side, in the view-aligned frame.

    `rotation` maps the model's frame to the view-aligned frame. `rays` point away from the camera.
    """
    turn = rotation.astype(np.float32).T
    normal = np.einsum("nk,nkd->nd", weights, surfaces.normals[face]) @ turn
    flat = surfaces.face_normals[face] @ turn
    # We shade both sides of a face, with the normal of the visible side.
    away = np.einsum("nd,nd->n", flat, rays) > 0
    normal = np.where(away[:, None], -normal, normal)
    length = np.sqrt(np.einsum("nd,nd->n", normal, normal))
    bad = length < 1e-6
    if bad.any():
        normal[bad] = np.where(away[bad, None], -flat[bad], flat[bad])
        length[bad] = 1
    return normal / length[:, None]


def blinn_phong(
    surfaces: Surfaces,
    lights: Lights,
    owner: Int[np.ndarray, " n"],
    colour: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
    view: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 3"]:
    """Display colours in [0, 1] of points with materials `owner` and diffuse colours `colour`.

    `c = d (a(n) + sum_i L_i max(n l_i, 0)) + s sum_i L_i max(n h_i, 0)^e [n l_i > 0]`, with the
    diffuse colour d, the ambient light a interpolated between ground and sky, the specular colour
    s with exponent e, and h_i halfway between the light l_i and the viewer (Blinn 1977).
    """
    rise = (normal[:, 2:3] + 1) / 2
    light = lights.ground * (1 - rise) + lights.sky * rise
    facing = np.maximum(normal @ lights.directions.T, 0)
    result = np.maximum(colour, lights.darkest) * (light + facing @ lights.colours)
    # Table look-ups and matrix products are faster than sums over axes of length 3.
    lit = facing @ np.ones(len(lights.directions), np.float32) > 0
    glossy: np.ndarray = np.any(surfaces.specular > 1e-3, axis=1)
    shiny = np.flatnonzero(glossy[owner] & lit)
    if lights.specular > 0 and len(shiny):
        which = owner[shiny]
        exponent = surfaces.shininess[which]
        gloss = np.zeros((len(shiny), 3), np.float32)
        for direction, strength, share in zip(
            lights.directions, lights.colours, facing[shiny].T, strict=True
        ):
            half = view[shiny] + direction
            cosine = np.einsum("nd,nd->n", normal[shiny], half) / np.sqrt(
                np.maximum(np.einsum("nd,nd->n", half, half), 1e-12)
            )
            glint = np.where(share > 0, np.maximum(cosine, 0) ** exponent, 0)
            gloss += glint[:, None] * strength
        result[shiny] += lights.specular * surfaces.specular[which] * gloss
    return np.clip(result, 0, 1)
