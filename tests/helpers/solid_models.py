"""Models of plain solids."""

import numpy as np

from data_gen.catalogues import solids
from data_gen.mesh import build_model


def model_of(solid, **kwargs):
    return build_model(solid.vertices, solid.faces, **kwargs)


def cube(size=1.0):
    return solids.box(size, size, size)


def sphere(sides=32):
    return solids.ball(2, 2, 2, sides)


def joined(*solids_):
    """Several solids as one, as arrays."""
    sizes = np.cumsum([0, *(len(p.vertices) for p in solids_)])
    return (
        np.concatenate([p.vertices for p in solids_]),
        np.concatenate([p.faces + n for p, n in zip(solids_, sizes[:-1], strict=True)]),
    )
