"""What a loaded model looks like, for tests of readers."""

import numpy as np

from data_gen.mesh import face_areas, texels

RED, BLUE, GREY = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.6, 0.6)

WHITE = (1.0, 1.0, 1.0)


def area(model):
    """The area, relative to the square of the largest extent."""
    extent = np.ptp(model.vertices, axis=0).max()
    return float(face_areas(model.vertices, model.faces).sum() / extent**2)


def colours(model):
    """The colour at the centre of each face."""
    result = []
    for uv, owner in zip(model.uv.mean(axis=1), model.face_material, strict=True):
        material = model.materials[owner]
        texture = np.full((1, 1, 4), 255) if material.texture is None else material.texture
        shown = texels(texture, uv[None])[0, :3] / 255 * material.diffuse
        result.append(tuple(np.round(shown, 2).tolist()))
    return result
