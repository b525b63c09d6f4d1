"""Bodies with a recess of hidden depth in the underside, which is not visible from above."""

from collections.abc import Callable, Sequence

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import Kit
from data_gen.catalogues.solids import Solid

RANGE = (0.02, 0.92)
"""Range of the hidden depth, as a fraction of the largest depth."""


def slab(
    kit: Kit,
    name: str,
    outline: Callable[[float], np.ndarray],
    height: float,
    wall: float = 0.03,
) -> Solid:
    """A slab from z = 0 to `height` with a recess in its underside.

    Args:
      kit: the model.
      name: hidden parameter, the depth of the recess as a fraction of the height.
      outline: see `solids.tray`.
      height: height of the slab.
      wall: thickness of the rim.
    """
    return solids.tray(outline, height, wall, kit.hide(name, *RANGE) * height)


def body(
    kit: Kit,
    levels: Sequence[tuple[np.ndarray, float]],
    deepest: float,
    name: str = "base_recess",
    share: float = 0.85,
) -> Solid:
    """A body through outlines at given heights (`solids.stack`), with a recess in its lowest face.

    Args:
      kit: the model.
      levels: outlines from the lowest to the highest; the lowest must be star-shaped.
      deepest: largest depth of the recess; less than the height of the body.
      name: hidden parameter, the depth of the recess as a fraction of `deepest`.
      share: size of the outline of the recess / size of the lowest outline.
    """
    lowest, low = levels[0]
    centre = lowest.mean(axis=0)
    inner = centre + (lowest - centre) * share
    top = low + kit.hide(name, *RANGE) * deepest
    return solids.stack([(inner, top), (inner, low), *levels])


def turned(
    kit: Kit,
    profile: Sequence[tuple[float, float]],
    sides: int = 24,
    deepest: float = 0.02,
    name: str = "base_recess",
) -> Solid:
    """A body of revolution (`solids.lathe`) with a recess; the profile's first point is lowest."""
    radius, low = profile[0]
    top = low + kit.hide(name, *RANGE) * deepest
    return solids.lathe([(0.85 * radius, top), (0.85 * radius, low), *profile], sides)
