"""Bodies whose underside is hollowed by a hidden depth: no view from above shows it."""

from collections.abc import Callable, Sequence

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import Kit
from data_gen.catalogues.solids import Solid

RANGE = (0.02, 0.92)
"""Of the hidden depth, as a share of the deepest one."""


def slab(
    kit: Kit,
    name: str,
    outline: Callable[[float], np.ndarray],
    height: float,
    wall: float = 0.03,
) -> Solid:
    """A slab from z = 0 to `height`, hollow from below by the hidden share `name` of its height.

    Args:
      kit: the model in the making.
      name: of the hidden parameter.
      outline: see `solids.tray`.
      height: of the slab.
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
    """A body of outlines at heights (see `solids.stack`), its lowest face hollowed.

    Args:
      kit: the model in the making.
      levels: from the lowest to the highest; the lowest must be seen from its centre.
      deepest: depth of the hollow at most; less than the body's height.
      name: of the hidden parameter, the share of `deepest`.
      share: size of the hollow's outline over that of the lowest one.
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
    """A profile (see `solids.lathe`) whose lowest face is hollowed; the first point is lowest."""
    radius, low = profile[0]
    top = low + kit.hide(name, *RANGE) * deepest
    return solids.lathe([(0.85 * radius, top), (0.85 * radius, low), *profile], sides)
