"""A depth map of a model by brute force, a reference for pictures."""

import numpy as np


def _hits(model, azimuth, distance, elevation, size, focal):
    """Hits of all opaque faces: pixel, 1 / z, face, weights / z, sorted from far to near.

    The camera is at `azimuth` degrees from +x toward +y and looks at (0, 0, 0.25).
    """
    turn, tilt = np.radians(-azimuth), np.radians(elevation)
    rotation = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    x, y, z = (model.vertices @ rotation.T - [0, 0, 0.25]).T
    depth = distance - (x * np.cos(tilt) + z * np.sin(tilt))
    rise = -x * np.sin(tilt) + z * np.cos(tilt)
    height, width = size
    pixel = np.stack([width / 2 + focal * y / depth, height / 2 - focal * rise / depth], axis=1)
    opaque = np.array([m.opacity for m in model.materials])[model.face_material] > 0.99
    corner, inverse = pixel[model.faces[opaque]], 1 / depth[model.faces[opaque]]
    low = np.floor(corner.min(axis=1)).astype(int).clip(0)
    high = np.minimum(np.ceil(corner.max(axis=1)).astype(int), [width - 1, height - 1])
    span = (high - low + 1).clip(0)
    count = span.prod(axis=1)
    face = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    column, row = low[face, 0] + number % span[face, 0], low[face, 1] + number // span[face, 0]
    a, b, c = corner[face, 0], corner[face, 1], corner[face, 2]
    p = np.stack([column + 0.5, row + 0.5], axis=1)

    def cross(u, v):
        return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]

    area = cross(b - a, c - a)
    area = np.where(np.abs(area) < 1e-9, np.inf, area)
    one, two = cross(p - a, c - a) / area, cross(b - a, p - a) / area
    inside = (one >= 0) & (two >= 0) & (one + two <= 1) & np.isfinite(area)
    face, one, two = face[inside], one[inside], two[inside]
    pixel_index = row[inside] * width + column[inside]
    weights = inverse[face] * np.stack([1 - one - two, one, two], axis=1)
    order = np.argsort(weights.sum(axis=1), kind="stable")
    number = np.flatnonzero(opaque)[face]
    return pixel_index[order], weights.sum(axis=1)[order], number[order], weights[order]


def inverse_depth(model, azimuth, *, distance=3.6, elevation=20.0, size=(96, 128), focal=200.0):
    """1 / z [H, W] of the model's opaque faces, 0 = background, and the material [H, W] (-1)."""
    pixel, value, face, _ = _hits(model, azimuth, distance, elevation, size, focal)
    result, material = np.zeros(size).ravel(), np.full(size, -1).ravel()
    result[pixel] = value
    material[pixel] = model.face_material[face]
    return result.reshape(size), material.reshape(size)


def texture_coordinates(
    model, azimuth, *, distance=3.6, elevation=20.0, size=(96, 128), focal=200.0
):
    """Texture coordinates [H, W, 2] of the visible surface, 0 = background."""
    pixel, value, face, weights = _hits(model, azimuth, distance, elevation, size, focal)
    result = np.zeros((size[0] * size[1], 2))
    result[pixel] = np.einsum("nk,nkd->nd", weights, model.uv[face]) / value[:, None]
    return result.reshape(*size, 2)
