"""Parts of boats and ships. Lengths in metres, the bow toward +x."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import BLACK, CHROME, DARK_GLASS, Kit
from data_gen.catalogues.solids import cylinder, loft, pane, rod, tube
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

ROPE = Material((0.3, 0.26, 0.2), name="rope")

GREY = Material((0.48, 0.51, 0.54), (0.1,) * 3, 20.0, name="grey")

HULLS = ((0.45, 0.13, 0.11), (0.12, 0.2, 0.36), (0.13, 0.14, 0.15), (0.16, 0.33, 0.24),
         (0.7, 0.32, 0.12),
         (0.85, 0.85, 0.83))


class Hull(NamedTuple):
    """Dimensions of a hull, used to place parts on it."""

    rail: np.ndarray  # [N, 3], from the stern to the bow, on +y
    deck: np.ndarray  # [N], height of the deck there
    long: float  # half length
    beam: float  # half width
    depth: float  # amidships

    def half_width(self, x: float) -> float:
        """The half width of the hull at its rail."""
        return float(np.interp(x, self.rail[:, 0], self.rail[:, 1]))

    def deck_at(self, x: float) -> float:
        """Height of the deck."""
        return float(np.interp(x, self.rail[:, 0], self.deck))


def make_hull(kit: Kit, skin: Material, long: float, beam: float, depth: float, *,
              sheer: float = 0.15,
              stern: float = 0.75, bow: float = 2.4, belly: float = 2.2, rake: float = 0.12,
          rise: float = 0.5, aft_rise: float = 0.15, aft_sheer: float = 0.3, bulwark: float = 0.08,
              wall: float = 0.06, deck: Material | None = None, trim: Material | None = None,
              y: float = 0.0) -> Hull:
    """A hull. Hidden: the depth of the recess in its bottom.

    Args:
      kit: the model.
      skin: material of the sides.
      long: half length at the rail, without the rake of the bow.
      beam: half width.
      depth: from keel to rail amidships.
      sheer: rise of the rail at the bow / depth.
      stern: width of the transom / beam; 0 = pointed like the bow.
      bow: exponent of the taper of the bow: 1.5 = slim, 5 = full.
      belly: exponent of the section: 1 = V, 4 = box.
      rake: overhang of the top of the bow / half length.
      rise: rise of the keel at the bow / depth.
      aft_rise: rise of the keel at the stern / depth.
      aft_sheer: rise of the rail at the stern, as a fraction of `sheer`.
      bulwark: height of the rail above the deck / depth; 0.6 and more for open boats.
      wall: thickness of the side at the rail / beam.
      deck: material of the deck, None = `skin`.
      trim: material of a rubbing strake along the rail, None = no strake.
      y: y of the centre plane.
    """
    hollow = kit.hidden.get("keel_hollow")
    hollow = kit.hide("keel_hollow", 0.02, 0.5) if hollow is None else hollow
    rings, rails, decks = [], [], []
    levels = np.array([0.12, 0.3, 0.5, 0.75, 1.0])
    places = np.concatenate([np.linspace(-1, 0.4, 12), np.linspace(0.5, 1, 9)])
    if stern == 0:
        places = np.concatenate([np.linspace(-1, -0.5, 9), np.linspace(-0.35, 0.4, 8), places[12:]])
    for t in places:
        if t > 0:
            full = 1 - t**bow * 0.99
        else:
            full = 1 - (1 - stern) * (-t) ** (2.2 if stern else bow) * 0.99
        top = depth * (1 + sheer * (t**2 if t > 0 else aft_sheer * t**2))
        keel = depth * (rise * max(0, (t - 0.35) / 0.65) ** 2.2
                        + aft_rise * max(0, (-t - 0.4) / 0.6) ** 2)
        keel = min(keel, 0.85 * top)
        width = beam * full
        flat = 0.2 * width
        side = flat + (width - flat) * levels ** (1 / belly)
        z = keel + (top - keel) * levels
        # Where the keel rises, a camera in front of or behind the boat would see into the recess.
        end = np.clip((1 - abs(t)) / 0.25, 0, 1) * (keel < 0.03 * depth)
        roof = keel + max(hollow * end, 0.01) * 0.6 * (depth * (1 - min(bulwark,
                                                                        0.85)) - keel * end)
        roof = max(min(roof, top - depth * bulwark - 0.05 * depth), keel)
        floor = max(top - depth * bulwark, keel + 0.1 * (top - keel), roof + 0.02 * depth)
        floor = min(floor, top - 0.005 * depth)
        inner = max(width - wall * beam, 0.3 * width)
        ys = np.concatenate([[0, 0.9 * flat, flat], side,
                             [inner, 0.97 * inner if bulwark < 0.3 else 0.8 * inner, 0]])
        zs = np.concatenate([[roof, roof, keel], z, [top, floor, floor]])
        xs = long * t + rake * long * max(t, 0) ** 3 * (zs - keel) / max(top - keel, 1e-6)
        right = np.stack([xs, ys, zs], axis=1)
        rings.append(np.concatenate([right, (right * [1, -1, 1])[-2:0:-1]]))
        rails.append((xs[7], width, top))
        decks.append(floor)
    hull = loft(np.array(rings)).at(y=y)
    size, sections = len(rings[0]), len(rings) - 1
    chosen = np.zeros((sections, size), bool)
    chosen[:, [9, size - 10]] = True
    faces = np.repeat(chosen.reshape(-1), 2)
    faces = np.pad(faces, (0, len(hull.faces) - len(faces)))
    planks, shell = solids.split(hull, faces)
    kit.add(skin, shell)
    kit.add(deck or skin, planks)
    rail = np.array(rails)
    if trim is not None:
        for s in (-1, 1):
            kit.add(trim, tube(rail * [1, s * 1.004, 1] + [0, y, 0], 0.008 * long, 6))
    return Hull(rail, np.array(decks), long, beam, depth)


def house_outline(back: float, front: float, half: float, nose: float) -> np.ndarray:
    """Outline [N, 2] of a deckhouse: square at the rear, rounded at the front by `nose`."""
    side = np.linspace(-1, 1, 7)
    curve = np.stack([front - nose * side**2, half * side], axis=1)
    return np.concatenate([[(back, half), (back, -half)], curve])


def add_house(kit: Kit, skin: Material, back: float, front: float, half: float, low: float,
              high: float, *,
              nose: float = 0.0, lean: tuple[float, float] = (0.0, 0.0), inset: float = 0.06,
              glass: tuple[float, float] | None = (0.45, 0.8)) -> None:
    """A deckhouse between two heights.

    Args:
      kit: the model.
      skin: material.
      back: x of the rear.
      front: x of the front.
      half: half width.
      low: z of the lower edge.
      high: z of the roof.
      nose: length of the rounded front.
      lean: inward inclination of front and rear.
      inset: inward inclination of the sides / half width.
      glass: lower and upper edge of a band of windows, both / height; None = no windows.
    """

    def level(t: float, grow: float = 0.0) -> tuple[np.ndarray, float]:
        outline = house_outline(back + lean[1] * t - grow, front - lean[0] * t + grow,
                                half * (1 - inset * t) + grow, nose)
        return outline, low + t * (high - low)

    kit.add(skin, solids.stack([level(0.0), level(1.0)]))
    if glass is not None:
        grow = 0.006 * (front - back) + 0.003 * half
        kit.add(DARK_GLASS, solids.stack([level(glass[0], grow), level(glass[1], grow)]))


def add_sail(kit: Kit, cloth: Material, corners: Sequence[Sequence[float]], belly: float,
             curve: float = 0.0) -> None:
    """A sail between tack, clew and head (and peak), curved toward +y, with a round leech."""
    tack, clew, head, *rest = (np.asarray(c, float) for c in corners)
    peak = rest[0] if rest else head + 0.04 * (clew - tack)
    grid = []
    for s in np.linspace(0, 1, 9):
        luff, leech = tack + s * (head - tack), clew + s * (peak - clew)
        leech = leech + np.sin(np.pi * s) * curve * (clew - tack)
        u = np.linspace(0, 1, 8)[:, None]
        line = luff + u * (leech - luff)
        line[:, 1] += belly * np.sin(np.pi * u[:, 0] ** 0.8) * np.sin(np.pi * (0.15 + 0.8 * s))
        grid.append(line)
    kit.add(cloth, pane(np.array(grid), 0.02))


def add_railing(kit: Kit, hull: Hull, start: float, high: float) -> None:
    """A railing along the edge from x = `start` to the bow."""
    line = hull.rail[hull.rail[:, 0] > start][:-1] * [1, 0.94, 1]
    if len(line) < 3:
        return
    radius = 0.004 * hull.long
    kit.both(CHROME, tube(line + np.array([0, 0, high]), radius, 5))
    for x, y, z in line[::2]:
        kit.both(CHROME, rod((x, y, z - 0.02 * hull.depth), (x, y, z + high), radius, 5))


def add_mast(kit: Kit, material: Material, x: float, z: float, high: float, radius: float) -> None:
    """A pole from the deck."""
    kit.add(material, tube([(x, 0, z), (x, 0, z + high)], [radius, 0.55 * radius], 8))


def add_funnel(kit: Kit, skin: Material, band: Material, x: float, y: float, z: float, high: float,
               radius: float, slant: float) -> None:
    """An oval funnel with a band and a dark top."""
    oval = solids.superellipse(3.2 * radius, 2 * radius, 2.3, 20)
    levels = [np.column_stack([oval * s - [slant * t, 0], np.full(20, t * high)]) for t,
              s in ((0, 1), (0.65, 0.93), (0.65, 0.96), (0.85, 0.93), (1, 0.9))]
    kit.add(skin, loft(levels[:2]).at(x, y, z))
    kit.add(band, loft(levels[2:4]).at(x, y, z))
    kit.add(BLACK, loft(levels[3:]).at(x, y, z))


def add_turret(kit: Kit, skin: Material, x: float, z: float, size: float, aim: int, barrels: int,
               reach: float) -> None:
    """A gun turret with barrels; `aim` is 1 for forward, -1 for aft."""
    kit.add(skin, cylinder(0.8 * size, 0.3 * size, 18).at(x, 0, z + 0.1 * size))
    shape = [(-0.9, 0.7, 0.3), (-0.8, 0.9, 0.6), (0.3, 0.8, 0.6), (0.9, 0.5, 0.3)]
    rings = [np.array([(a, w, 0.2), (a, 0.85 * w, h + 0.2), (a, -0.85 * w, h + 0.2), (a, -w, 0.2)])
             for a, w, h in shape]
    kit.add(skin, loft(np.array(rings) * size).scaled(aim, 1, 1).at(x, 0, z))
    for y in (np.arange(barrels) - (barrels - 1) / 2) * 0.45 * size:
        kit.add(BLACK, rod((x + 0.6 * aim * size, y, z + 0.5 * size),
                           (x + aim * reach, y, z + 0.62 * size + 0.1 * reach), 0.09 * size))
