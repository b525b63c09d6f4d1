"""Boats and ships. Lengths in metres, the bow toward +x, the keel on z = 0."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    LIGHT,
    WHITE,
    Kit,
    around,
    fabric,
    paint,
    pick,
    shade_of,
    wood,
)
from data_gen.catalogues.solids import (
    ball,
    body,
    box,
    cylinder,
    lathe,
    loft,
    pillow,
    rod,
    sheet,
    smooth_path,
    tube,
)
from data_gen.meshes import Material

ROPE = Material((0.3, 0.26, 0.2), name="rope")
GREY = Material((0.48, 0.51, 0.54), (0.1,) * 3, 20.0, name="grey")
HULLS = ((0.45, 0.13, 0.11), (0.12, 0.2, 0.36), (0.13, 0.14, 0.15), (0.16, 0.33, 0.24), (0.7, 0.32, 0.12),
         (0.85, 0.85, 0.83))  # fmt: skip

# --- Pieces -----------------------------------------------------------------------------------


class Hull(NamedTuple):
    """What stands on a hull is placed by this."""

    rail: np.ndarray  # [N, 3], from the stern to the bow, on +y
    deck: np.ndarray  # [N], height of the deck there
    long: float  # half length
    beam: float  # half width
    depth: float  # amidships

    def half_width(self, x: float) -> float:
        """Of the hull at its rail."""
        return float(np.interp(x, self.rail[:, 0], self.rail[:, 1]))

    def deck_at(self, x: float) -> float:
        """Height of the deck."""
        return float(np.interp(x, self.rail[:, 0], self.deck))


def _hull(kit: Kit, skin: Material, long: float, beam: float, depth: float, *, sheer: float = 0.15,
          stern: float = 0.75, bow: float = 2.4, belly: float = 2.2, rake: float = 0.12,
          rise: float = 0.5, aft_rise: float = 0.15, aft_sheer: float = 0.3, bulwark: float = 0.08,
          wall: float = 0.06, deck: Material | None = None, trim: Material | None = None,
          y: float = 0.0) -> Hull:  # fmt: skip
    """A hull. Hidden: how far its bottom is hollow.

    Args:
      kit: what it is added to.
      skin: of the sides.
      long: half length at the rail, without the bow's rake.
      beam: half width.
      depth: from keel to rail amidships.
      sheer: how much higher the rail is at the bow, in depths.
      stern: width of the transom / beam; 0 = pointed like the bow.
      bow: how late the bow narrows: 1.5 slim, 5 full.
      belly: section: 1 = V, 4 = box.
      rake: how far the bow's top leans forward, in half lengths.
      rise: how far the keel rises to the bow, in depths.
      aft_rise: the same at the stern.
      aft_sheer: `sheer` at the stern, as a share of it.
      bulwark: how far the deck lies below the rail, in depths; open boats have .6 and more.
      wall: thickness of the side at the rail, in beams.
      deck: material of the deck, None = `skin`.
      trim: of a rubbing strake along the rail, None = none.
      y: of the middle.
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
        keel = depth * (rise * max(0, (t - 0.35) / 0.65) ** 2.2 + aft_rise * max(0, (-t - 0.4) / 0.6) ** 2)
        keel = min(keel, 0.85 * top)
        width = beam * full
        flat = 0.2 * width
        side = flat + (width - flat) * levels ** (1 / belly)
        z = keel + (top - keel) * levels
        end = np.clip((1 - abs(t)) / 0.25, 0, 1)
        roof = keel + max(hollow * end, 0.01) * 0.6 * (depth * (1 - min(bulwark, 0.85)) - keel * end)
        roof = max(min(roof, top - depth * bulwark - 0.05 * depth), keel)
        floor = max(top - depth * bulwark, keel + 0.1 * (top - keel), roof + 0.02 * depth)
        floor = min(floor, top - 0.005 * depth)
        inner = max(width - wall * beam, 0.3 * width)
        ys = np.concatenate([[0, 0.9 * flat, flat], side, [inner, 0.97 * inner if bulwark < 0.3 else 0.8 * inner, 0]])
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


def _outline(back: float, front: float, half: float, nose: float) -> np.ndarray:
    """A house from above [N, 2]: square behind, its front pulled forward by `nose` at the middle."""
    side = np.linspace(-1, 1, 7)
    curve = np.stack([front - nose * side**2, half * side], axis=1)
    return np.concatenate([[(back, half), (back, -half)], curve])


def _house(kit: Kit, skin: Material, back: float, front: float, half: float, low: float, high: float, *,
           nose: float = 0.0, lean: tuple[float, float] = (0.0, 0.0), inset: float = 0.06,
           glass: tuple[float, float] | None = (0.45, 0.8)) -> None:  # fmt: skip
    """A deckhouse between two heights.

    Args:
      kit: what it is added to.
      skin: its material.
      back: x of its back.
      front: x of its front.
      half: half width.
      low: height of its foot.
      high: height of its roof.
      nose: how far its front is round.
      lean: how far front and back lean inward.
      inset: how far the sides lean inward, in half widths.
      glass: where a band of windows goes around, in heights; None = none.
    """

    def level(t: float, grow: float = 0.0) -> tuple[np.ndarray, float]:
        outline = _outline(back + lean[1] * t - grow, front - lean[0] * t + grow,
                           half * (1 - inset * t) + grow, nose)  # fmt: skip
        return outline, low + t * (high - low)

    kit.add(skin, solids.stack([level(0.0), level(1.0)]))
    if glass is not None:
        grow = 0.006 * (front - back) + 0.003 * half
        kit.add(DARK_GLASS, solids.stack([level(glass[0], grow), level(glass[1], grow)]))


def _sail(kit: Kit, cloth: Material, corners: Sequence[Sequence[float]], belly: float, curve: float = 0.0) -> None:
    """Cloth between tack, clew, head (and peak), bellied toward +y; its leech rounds out by `curve`."""
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
    kit.add(cloth, sheet(np.array(grid), 0.02))


def _railing(kit: Kit, hull: Hull, start: float, high: float) -> None:
    """A rail on posts along the edge from x = `start` to the bow."""
    line = hull.rail[hull.rail[:, 0] > start][:-1] * [1, 0.94, 1]
    if len(line) < 3:
        return
    radius = 0.004 * hull.long
    kit.both(CHROME, tube(line + [0, 0, high], radius, 5))
    for x, y, z in line[::2]:
        kit.both(CHROME, rod((x, y, z - 0.02 * hull.depth), (x, y, z + high), radius, 5))


def _mast(kit: Kit, material: Material, x: float, z: float, high: float, radius: float) -> None:
    kit.add(material, tube([(x, 0, z), (x, 0, z + high)], [radius, 0.55 * radius], 8))


def _funnel(kit: Kit, skin: Material, band: Material, x: float, y: float, z: float, high: float, radius: float, slant: float) -> None:
    oval = solids.superellipse(3.2 * radius, 2 * radius, 2.3, 20)
    levels = [np.column_stack([oval * s - [slant * t, 0], np.full(20, t * high)]) for t, s in ((0, 1), (0.65, 0.93), (0.65, 0.96), (0.85, 0.93), (1, 0.9))]
    kit.add(skin, loft(levels[:2]).at(x, y, z))
    kit.add(band, loft(levels[2:4]).at(x, y, z))
    kit.add(BLACK, loft(levels[3:]).at(x, y, z))


def _turret(kit: Kit, skin: Material, x: float, z: float, size: float, aim: int, barrels: int, reach: float) -> None:
    kit.add(skin, cylinder(0.8 * size, 0.3 * size, 18).at(x, 0, z + 0.1 * size))
    shape = [(-0.9, 0.7, 0.3), (-0.8, 0.9, 0.6), (0.3, 0.8, 0.6), (0.9, 0.5, 0.3)]
    rings = [np.array([(a, w, 0.2), (a, 0.85 * w, h + 0.2), (a, -0.85 * w, h + 0.2), (a, -w, 0.2)]) for a, w, h in shape]
    kit.add(skin, loft(np.array(rings) * size).scaled(aim, 1, 1).at(x, 0, z))
    for y in (np.arange(barrels) - (barrels - 1) / 2) * 0.45 * size:
        kit.add(BLACK, rod((x + 0.6 * aim * size, y, z + 0.5 * size), (x + aim * reach, y, z + 0.62 * size + 0.1 * reach), 0.09 * size))


# --- Under sail and oar -----------------------------------------------------------------------


def _sailing_yacht(kit: Kit, skin: Material, trim: Material) -> None:
    rig = kit.choose("rig", "sloop", "sloop", "ketch", "cutter", "catboat", "gaff", "schooner")
    long = kit.uniform("half_length", 3.5, 9.0)
    beam, depth = long * kit.uniform("beam", 0.24, 0.38), long * kit.uniform("freeboard", 0.2, 0.3)
    keel = kit.chance("fin_keel", 0.45)
    lift = depth * kit.uniform("draught", 0.6, 1.4) if keel else 0.0
    deck = wood(kit.rng)
    hull = _hull(kit, skin, long, beam, depth, sheer=kit.uniform("sheer", 0.1, 0.45), stern=kit.uniform("stern", 0.3, 0.85), bow=kit.uniform("bow", 1.7, 2.6),
                 belly=kit.uniform("belly", 1.6, 2.6), rake=kit.uniform("rake", 0.05, 0.2), rise=0.75, aft_rise=0.6, deck=deck, trim=trim)  # fmt: skip
    z = hull.deck_at(0)
    _house(kit, skin, -0.2 * long, 0.38 * long, beam * 0.55, z - 0.02, z + depth * kit.uniform("cabin", 0.25, 0.5), nose=0.1 * long, lean=(0.12 * long, 0))
    kit.add(BLACK, pillow(0.42 * long, beam * 0.8, depth * 0.1, 0.03 * long, 2).at(-0.55 * long, 0, z))
    mast, high = long * kit.uniform("mast_place", 0.1, 0.3) + (0.4 * long if rig == "catboat" else 0), long * kit.uniform("mast", 1.9, 2.9)
    spar = wood(kit.rng) if rig in ("gaff", "schooner") else CHROME
    masts = [(mast, high, 0.75)]
    if rig == "ketch":
        masts.append((-0.62 * long, 0.62 * high, 0.45))
    elif rig == "schooner":
        masts = [(0.35 * long, 0.75 * high, 0.42), (-0.2 * long, 0.85 * high, 0.65)]
    up, cloth = kit.chance("sails_up", 0.65), WHITE if kit.rng.random() < 0.65 else fabric(kit.rng)
    wind = kit.uniform("wind", 0.04, 0.16) * long * kit.choose("tack", -1, 1)
    swing = np.radians(kit.uniform("swing", 3, 22)) * np.sign(wind)
    for x, tall, reach in masts:
        _mast(kit, spar, x, z - 0.05, tall, 0.016 * long)
        boom = z + 0.28 * depth + 0.12 * long
        end = np.array([x - reach * long * np.cos(swing), reach * long * np.sin(swing), boom])
        kit.add(spar, rod((x, 0, boom), end, 0.011 * long))
        if up:
            head = (x - 0.01 * long, 0, z + tall * (0.97 if rig not in ("gaff", "schooner") else 0.7))
            corners = [(x - 0.02 * long, 0, boom), end + [0, 0, 0.01], head]
            if rig in ("gaff", "schooner"):
                peak = (x - 0.62 * reach * long, 0.3 * end[1], z + tall * 0.97)
                kit.add(spar, rod(head, peak, 0.01 * long))
                corners.append(peak)
            _sail(kit, cloth, corners, wind, 0.1)
        else:
            kit.add(fabric(kit.rng), tube([(x, 0, boom + 0.02 * long), (end + [x, 0, boom + 0.02 * long]) / [2, 2, 1] * [1, 1, 0.5] + [0, 0, boom / 2], end], [0.035 * long, 0.03 * long, 0.015 * long], 8))
    tip = hull.rail[-1]
    if up and rig != "catboat":
        x, tall, _ = masts[0]
        for k in range(2 if rig == "cutter" else 1):
            clew = (x + (0.05 - 0.3 * kit.rng.random() * (k == 0)) * long, 0.2 * beam * np.sign(wind), z + 0.2 * depth)
            _sail(kit, cloth, [(tip[0] - 0.35 * long * k, 0, tip[2]), clew, (x + 0.06 * long - 0.03 * k * long, 0, z + tall * (0.9 - 0.15 * k))], wind)
    x, tall, _ = masts[0]
    wire = 0.0035 * long
    kit.add(ROPE, rod((x, 0, z + 0.97 * tall), tuple(tip), wire, 5), rod((masts[-1][0], 0, z + 0.97 * masts[-1][1]), (-0.97 * long, 0, hull.rail[0, 2]), wire, 5))
    for x, tall, _ in masts:
        kit.both(ROPE, rod((x, 0, z + 0.85 * tall), (x - 0.03 * long, hull.half_width(x) * 0.95, z), wire, 5))
        kit.both(spar, rod((x, 0, z + 0.55 * tall), (x, 0.3 * beam, z + 0.55 * tall), wire * 1.5, 5))
    if kit.chance("railing", 0.4):
        _railing(kit, hull, -0.9 * long, 0.22 * depth + 0.15)
    if keel:
        root = 0.25 * long
        kit.add(BLACK, solids.wing([(root, 0, 0.3 * depth, 0.5 * long), (root - 0.12 * long, 0, -lift, 0.3 * long)], 0.1, fin=True),
                ball(0.4 * long, 0.09 * long, 0.09 * long, 14).at(-0.02 * long, 0, -lift),
                solids.wing([(-0.7 * long, 0, 0.7 * depth, 0.15 * long), (-0.74 * long, 0, -0.6 * lift, 0.1 * long)], 0.1, fin=True))  # fmt: skip


def _galleon(kit: Kit, skin: Material, trim: Material) -> None:
    """Square-rigged ships: castles at the ends or flush decks, two to four masts."""
    long = kit.uniform("half_length", 12, 22)
    castles = kit.uniform("castles", 0.0, 1.0)
    beam, depth = long * kit.uniform("beam", 0.2, 0.32), long * kit.uniform("freeboard", 0.24, 0.36)
    oak = wood(kit.rng)
    hull = _hull(kit, oak, long, beam, depth, sheer=0.15 + 0.3 * castles, stern=0.65, bow=kit.uniform("bow", 2.2, 3.6), belly=2.6, rake=0.16, rise=0.5, aft_rise=0.4, aft_sheer=0.9,
                 bulwark=0.12, deck=wood(kit.rng), trim=trim)  # fmt: skip
    tall = depth * (0.15 + 0.5 * castles)
    for share, (back, front) in ((1.0, (-1.0, -0.45)), (0.9, (-1.0, -0.7)), (0.75, (0.55, 0.82)))[: 3 if castles > 0.4 else 1]:
        base = hull.deck_at((back + front) / 2 * long) + (tall if back == -1.0 and front == -0.7 else 0)
        half = min(hull.half_width(back * long), hull.half_width(front * long)) * 0.98 * share
        _house(kit, oak, back * long, front * long, half, base - 0.05 * depth, base + tall, inset=0.1, glass=None)
    kit.add(DARK_GLASS, *(box(0.1, beam * 0.16, depth * 0.16).at(-1.005 * long, y * beam, depth * 0.9) for y in (-0.36, -0.12, 0.12, 0.36)))
    stripe = hull.rail * [1, 1.0, 0.72]
    for k in range(kit.choose("guns", 0, 5, 8)):
        x = (-0.6 + 1.15 * k / 7) * long
        kit.both(BLACK, box(0.04 * long, 0.05 * beam, 0.06 * depth).at(x, np.interp(x, stripe[:, 0], stripe[:, 1]) * 0.975, 0.72 * depth))
    bowsprit = hull.rail[-1]
    tip = bowsprit + [0.35 * long, 0, 0.16 * long]
    kit.add(oak, rod(bowsprit - [0.2 * long, 0, 0.02 * long], tip, 0.016 * long))
    count, high = kit.choose("masts", 2, 3, 3, 4), long * kit.uniform("mast", 1.2, 1.7)
    up = kit.chance("sails_up", 0.75)
    cloth = WHITE if kit.rng.random() < 0.5 else Material(shade_of((0.85, 0.78, 0.62), kit.rng), name="canvas")
    belly, turn = long * kit.uniform("belly", 0.04, 0.12), kit.uniform("brace", -30, 30)
    rows = kit.choose("rows", 2, 3, 4)
    lateen = kit.chance("lateen_mizzen", 0.6)
    last = high
    for k, x in enumerate(np.linspace(-0.66, 0.55, count) * long):
        tall = high * (0.75 if k == 0 else 1 if k < count - 1 or count == 2 else 0.88)
        z = hull.deck_at(x)
        _mast(kit, oak, x, z - 0.1 * depth, tall, 0.018 * long)
        last = tall
        if k == 0 and lateen:
            low, top = np.array([x + 0.25 * long, 0.1 * beam, z + 0.2 * tall]), np.array([x - 0.28 * long, 0.1 * beam, z + 0.95 * tall])
            kit.add(oak, rod(low, top, 0.01 * long))
            if up:
                _sail(kit, cloth, [low, (x - 0.3 * long, 0.3 * beam, z + 0.15 * tall), top], belly)
        else:
            edges = np.linspace(0.18, 0.95, rows + 1) if rows > 2 else np.array([0.2, 0.62, 0.95])
            for a, b in zip(edges[:-1], edges[1:], strict=True):
                w0, w1 = (beam * 1.75 * (1 - 0.55 * e) for e in (a, b))
                yard = rod((0.03 * long, -w1, 0), (0.03 * long, w1, 0), 0.009 * long)
                kit.add(oak, yard.turned("z", turn).at(x, 0, z + b * tall))
                if up:
                    u, v = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(0, 1, 6))
                    width = w0 * 0.95 + (w1 * 0.95 - w0 * 0.95) * v
                    grid = np.stack([0.05 * long + belly * (1 - u**2) * np.sin(np.pi * (0.1 + 0.85 * v)), u * width, (a + 0.02 + v * (b - a - 0.03)) * tall], -1)
                    part = sheet(grid, 0.04)
                    kit.add(cloth, part.turned("z", turn).at(x, 0, z))
        if k < 3:
            kit.add(oak, cylinder(0.05 * long, 0.03 * long, 12).at(x, 0, z + 0.6 * tall))
        for dx in (-0.05, 0.0, 0.05):
            kit.both(ROPE, rod((x, 0, z + 0.6 * tall), (x + (dx - 0.03) * long, hull.half_width(x) * 0.98, z), 0.003 * long, 4))
    x = 0.55 * long
    kit.add(ROPE, rod((x, 0, hull.deck_at(x) + 0.9 * last), tip, 0.003 * long, 4))
    if up:
        for s in (0.35, 0.95):
            _sail(kit, cloth, [bowsprit + s * (tip - bowsprit), (x + 0.1 * long, 0, bowsprit[2] + 0.1 * high * s), (x + 0.05 * long, 0, hull.deck_at(x) + last * (0.5 + 0.35 * s))], belly * 0.5)
    kit.add(trim, box(0.2 * long, 0.01 * long, 0.09 * long).at(-0.77 * long, 0, hull.deck_at(-0.6 * long) + 0.8 * high + 0.1 * depth))


def _rowing(kit: Kit, skin: Material, trim: Material) -> None:
    """Open boats: rowing boat, canoe, kayak, gondola, longship, inflatable."""
    form = kit.choose("form", "dinghy", "canoe", "kayak", "longship", "punt", "inflatable")
    shapes = {  # half length, beam / it, depth / it, sheer, stern, bow, belly, rake, bulwark
        "dinghy": ((1.3, 2.6), (0.32, 0.45), 0.25, 0.25, 0.7, 2.3, 2.2, 0.1, 0.72),
        "canoe": ((2.0, 3.0), (0.15, 0.2), 0.14, 0.5, 0.0, 2.6, 3.0, 0.05, 0.85),
        "kayak": ((1.6, 2.8), (0.1, 0.16), 0.11, 0.25, 0.0, 2.0, 2.4, 0.1, 0.02),
        "longship": ((8, 12), (0.17, 0.24), 0.14, 1.4, 0.0, 2.3, 1.8, 0.12, 0.7),
        "punt": ((2.0, 4.0), (0.18, 0.3), 0.13, 0.2, 0.8, 6.0, 5.0, 0.02, 0.8),
    }
    blade_wood = wood(kit.rng)
    if form == "inflatable":
        long, wide, r = kit.uniform("half_length", 1.2, 2.4), 0.0, kit.uniform("tube", 0.2, 0.28)
        wide = long * kit.uniform("beam", 0.38, 0.5)
        path = [(-long, wide, r), (0.3 * long, wide, r), (0.8 * long, wide * 0.7, r * 1.25), (1.05 * long, 0, r * 1.5), (0.8 * long, -wide * 0.7, r * 1.25), (0.3 * long, -wide, r), (-long, -wide, r)]
        line = smooth_path(path, 5)
        radii = np.full(len(line), r)
        radii[[0, -1]] = 0.3 * r
        kit.add(skin, tube(line, radii, 14))
        hull = _hull(kit, trim, long * 0.85, wide * 0.95, r * 1.2, sheer=0.2, stern=0.9, bulwark=0.4, belly=2.0)
        kit.add(trim, box(0.08, wide * 1.9, r * 1.9).at(-0.86 * long, 0, r * 1.0))
        for x in (-0.4, 0.2):
            kit.add(blade_wood, box(0.24, wide * 1.9, 0.05).at(x * long, 0, 1.5 * r))
        if kit.chance("outboard", 0.6):
            _outboard(kit, -0.95 * long, 0, 2.2 * r)
        return
    span, beam_, depth_, sheer, stern, bow, belly, rake, bulwark = shapes[form]
    long = kit.uniform("half_length", *span)
    beam, depth = long * kit.uniform("beam", *beam_), long * depth_ * kit.uniform("freeboard", 0.85, 1.2)
    hull = _hull(kit, skin if form != "longship" else blade_wood, long, beam, depth, sheer=sheer, stern=stern, bow=bow, belly=belly, rake=rake, rise=0.75,
                 aft_rise=0.75 if not stern else 0.2, aft_sheer=1.0 if not stern else 0.3, bulwark=bulwark, wall=0.05, deck=wood(kit.rng), trim=trim)  # fmt: skip
    if form == "kayak":
        kit.add(BLACK, ball(0.4 * long, beam * 1.2, depth * 0.5, 16).at(-0.1 * long, 0, depth))
        kit.add(CHROME, rod((0.05 * long, -1.1, depth * 1.8), (0.05 * long, 1.1, depth * 2.4), 0.02))
        for s in (-1, 1):
            kit.add(trim, ball(0.16, 0.4, 0.05, 12).turned("x", 15).at(0.05 * long, 1.2 * s, depth * (2.1 + 0.33 * s)))
        return
    for x in np.linspace(-0.6, 0.55, 3 if form != "longship" else 9) * long:
        kit.add(blade_wood, box(0.06 * min(long, 3), 1.88 * hull.half_width(x), 0.05 * depth).at(x, 0, 0.86 * depth))
    if form == "dinghy" and kit.chance("outboard", 0.35):
        _outboard(kit, -1.0 * long, 0, depth * 1.15)
    if form == "longship":
        mast = long * kit.uniform("mast", 0.8, 1.1)
        if kit.chance("mast_up", 0.7):
            _mast(kit, blade_wood, 0, 0.2 * depth, mast, 0.014 * long)
            if kit.chance("sail_up", 0.6):
                u, v = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(0, 1, 6))
                grid = np.stack([0.1 + 0.1 * long * (1 - u**2) * np.sin(np.pi * v), u * 0.55 * long, 1.3 * depth + v * (mast - 1.25 * depth)], -1)
                kit.add(fabric(kit.rng), sheet(grid, 0.04))
            kit.add(blade_wood, rod((0.1, -0.6 * long, mast + 0.1 * depth), (0.1, 0.6 * long, mast + 0.1 * depth), 0.01 * long))
        for end in (1, -1):
            tip = hull.rail[-1 if end > 0 else 0]
            curl = [(tip[0] - 0.1 * long * end, 0, tip[2] * 0.75), tuple(tip), (tip[0] + 0.04 * long * end, 0, tip[2] + 0.16 * long), (tip[0] - 0.03 * long * end, 0, tip[2] + 0.24 * long)]
            kit.add(blade_wood, tube(smooth_path(curl, 5), 0.02 * long, 8))
        shields = [paint(kit.rng) for _ in range(2)]
        for k, x in enumerate(np.linspace(-0.6, 0.6, 9) * long):
            disc = ball(0.09 * long, 0.03 * long, 0.09 * long, 14)
            kit.both(shields[k % 2], disc.at(x, hull.half_width(x), float(np.interp(x, hull.rail[:, 0], hull.rail[:, 2]))))
    oars = {"longship": 7, "dinghy": 1, "punt": 0, "canoe": 0}[form]
    reach = 2.2 * beam + 0.3
    for x in np.linspace(-0.45, 0.5, oars) * long if oars > 1 else [0.1 * long] * oars:
        if form == "dinghy" and kit.rng.random() < 0.3:
            continue
        size = 0.01 * long + 0.01
        oar = tube([(0, 0.3 * beam, 1.25 * depth), (0, reach, 0.35 * depth)], size, 6)
        blade = box(0.12 * beam + 0.05, 0.35 * beam, 0.02, 0.005).turned("x", -15).at(0, reach, 0.35 * depth)
        kit.both(blade_wood, oar.at(x), blade.at(x))


def _outboard(kit: Kit, x: float, y: float, z: float) -> None:
    size = max(0.12 * z, 0.3)
    kit.add(BLACK, pillow(1.2 * size, 0.7 * size, 0.9 * size, 0.25 * size, 2).at(x - 0.4 * size, y, z + 0.5 * size),
            box(0.35 * size, 0.2 * size, z * 0.9, 0.03).at(x - 0.4 * size, y, z * 0.55),
            ball(0.9 * size, 0.2 * size, 0.25 * size, 12).at(x - 0.4 * size, y, 0.2 * z))  # fmt: skip


# --- Small craft with engines -----------------------------------------------------------------


def _speedboat(kit: Kit, skin: Material, trim: Material) -> None:
    long = kit.uniform("half_length", 2.2, 6.0)
    beam, depth = long * kit.uniform("beam", 0.24, 0.42), long * kit.uniform("freeboard", 0.2, 0.32)
    form = kit.choose("form", "open", "open", "cuddy", "console", "racer")
    bulwark = {"racer": 0.03, "cuddy": 0.06, "open": 0.45, "console": 0.5}[form]
    hull = _hull(kit, skin, long, beam * (0.75 if form == "racer" else 1), depth, sheer=kit.uniform("sheer", -0.05, 0.25), stern=kit.uniform("stern", 0.75, 0.95), bow=kit.uniform("bow", 1.6, 2.8),
                 belly=kit.uniform("belly", 1.2, 2.0), rake=kit.uniform("rake", 0.1, 0.3), rise=0.7, bulwark=bulwark, wall=0.12, deck=wood(kit.rng), trim=trim)  # fmt: skip
    z, floor = depth, hull.deck_at(0)
    seats = fabric(kit.rng)
    if form in ("open", "cuddy", "racer"):
        nose = [(0.95 * long, 0.1, 0.02, z), (0.6 * long, hull.half_width(0.6 * long) * 0.85, 0.08 * depth, z), (0.15 * long, beam * 0.9, 0.2 * depth, z)]
        if form == "cuddy":
            nose = [(0.8 * long, 0.1, 0.02, z), (0.55 * long, beam * 0.5, 0.35 * depth, z), (0.1 * long, beam * 0.75, kit.uniform("cuddy", 0.5, 0.9) * depth, z)]
        kit.add(skin, body(nose, 2.4, 3, 18))
    ys = np.linspace(-1, 1, 9)
    x, rise, rake = 0.14 * long, kit.uniform("screen", 0.25, 0.6) * depth, 0.16 * long
    if form != "console":
        base = z + (0.3 if form != "cuddy" else 0.6) * 0.3 * depth
        grid = np.array([[(x - rake * t - 0.2 * long * y**2, beam * 0.78 * y * (1 - 0.1 * t), base + rise * t) for y in ys] for t in (0, 0.5, 1)])
        kit.add(DARK_GLASS, sheet(grid, 0.02))
        kit.add(CHROME, tube(grid[-1], 0.012 * depth + 0.01, 6))
    else:
        kit.add(skin, pillow(0.24 * long, 0.6 * beam, 1.0 * depth, 0.05 * long, 2).at(0, 0, floor + 0.5 * depth))
        kit.add(DARK_GLASS, box(0.02 * long, 0.55 * beam, 0.35 * depth).turned("y", -20).at(0.08 * long, 0, floor + 1.15 * depth))
        if kit.chance("t_top", 0.6):
            top = floor + 2.0 * depth
            kit.add(trim, pillow(0.6 * long, 1.2 * beam, 0.1 * depth, 0.04 * depth, 2).at(-0.03 * long, 0, top))
            for dx in (-0.2, 0.15):
                kit.both(CHROME, rod((dx * long, 0.45 * beam, floor), (dx * long, 0.42 * beam, top), 0.012 * long, 6))
    for row in range(kit.choose("rows", 1, 2)):
        sx = -0.12 * long - 0.34 * long * row
        base = floor if bulwark > 0.3 else z - 0.1 * depth
        kit.both(seats, pillow(0.18 * long, beam * 0.62, 0.4 * depth, 0.05 * depth, 2).at(sx, 0.4 * beam, base + 0.2 * depth),
                 pillow(0.06 * long, beam * 0.62, 0.75 * depth, 0.05 * depth, 2).at(sx - 0.1 * long, 0.4 * beam, base + 0.45 * depth))  # fmt: skip
    back = kit.choose("engine", "outboard", "two", "pad", "arch")
    if back in ("outboard", "two"):
        for y in (0,) if back == "outboard" else (-0.3 * beam, 0.3 * beam):
            _outboard(kit, -1.0 * long, y, 1.1 * depth)
    else:
        kit.add(seats, pillow(0.3 * long, beam * 1.3, 0.3 * depth, 0.1 * depth, 2).at(-0.76 * long, 0, z))
    if back == "arch":
        w = hull.half_width(-0.4 * long) * 0.92
        bow = [(-0.55 * long, -w, z * 0.95), (-0.45 * long, -w * 0.9, z + 1.1 * depth), (-0.4 * long, 0, z + 1.25 * depth), (-0.45 * long, w * 0.9, z + 1.1 * depth), (-0.55 * long, w, z * 0.95)]
        kit.add(trim, tube(smooth_path(bow, 3), 0.025 * long, 6))


def _jet_ski(kit: Kit, skin: Material, trim: Material) -> None:
    long = kit.uniform("half_length", 1.2, 1.7)
    beam, depth = long * kit.uniform("beam", 0.32, 0.4), long * 0.3
    _hull(kit, skin, long, beam, depth, sheer=0.3, stern=0.85, bow=2.3, belly=1.8, rake=0.12, rise=0.7, bulwark=0.1, deck=BLACK)
    kit.add(skin, body([(0.95 * long, 0.1, 0.05, depth * 1.2), (0.6 * long, beam * 0.6, 0.4 * depth, depth * 1.2), (0.2 * long, beam * 0.5, 0.75 * depth, depth * 1.25), (0.0, beam * 0.3, 0.4 * depth, depth * 1.1)], 2.4))
    kit.add(BLACK, body([(0.05 * long, beam * 0.35, 0.5 * depth, depth * 1.1), (-0.25 * long, beam * 0.5, 0.65 * depth, depth * 1.1), (-0.6 * long, beam * 0.45, 0.8 * depth, depth * 1.15), (-0.85 * long, beam * 0.3, 0.4 * depth, depth)], 3.0))
    kit.add(trim, body([(0.3 * long, 0.1, 0.12, depth * 2.1), (0.12 * long, 0.16, 0.16, depth * 2.2)], 3.0))
    kit.add(BLACK, rod((0.15 * long, -0.42, depth * 2.3), (0.15 * long, 0.42, depth * 2.3), 0.025), rod((0.3 * long, 0, depth * 1.7), (0.15 * long, 0, depth * 2.3), 0.04))
    if kit.chance("rider", 0.4):
        cloth = fabric(kit.rng)
        kit.add(cloth, body([(-0.1, 0.2, 0.16, 0), (0.3, 0.25, 0.18, 0), (0.55, 0.1, 0.1, 0)], 2.4).turned("y", -70).at(-0.35 * long, 0, depth * 2.0), ball(0.25, 0.22, 0.28, 12).at(-0.22 * long, 0, depth * 2 + 0.75))
        kit.both(cloth, tube([(-0.27 * long, 0.25, depth * 2 + 0.45), (-0.1 * long, 0.36, depth * 2.1 + 0.2), (0.14 * long, 0.36, depth * 2.3)], 0.05, 6), tube([(-0.4 * long, 0.12, depth * 2), (0.0, 0.28, depth * 1.9), (-0.1 * long, 0.3, depth)], 0.08, 6))


def _motor_yacht(kit: Kit, skin: Material, trim: Material) -> None:
    long = kit.uniform("half_length", 5, 30)
    beam, depth = long * kit.uniform("beam", 0.19, 0.32), long * kit.uniform("freeboard", 0.16, 0.28)
    hull = _hull(kit, skin, long, beam, depth, sheer=kit.uniform("sheer", 0.1, 0.5), stern=kit.uniform("stern", 0.75, 0.95), bow=kit.uniform("bow", 1.8, 3.0), belly=1.9,
                 rake=kit.uniform("rake", 0.08, 0.25), rise=0.6, bulwark=0.12, deck=wood(kit.rng), trim=trim)  # fmt: skip
    decks, z = kit.choose("decks", 1, 2, 2, 3), hull.deck_at(0)
    back, front, half = -kit.uniform("house_back", 0.45, 0.8) * long, kit.uniform("house_front", 0.15, 0.55) * long, beam * kit.uniform("house", 0.7, 0.88)
    tall = depth * kit.uniform("storey", 0.45, 0.75)
    lean = kit.uniform("lean", 0.2, 1.6) * tall
    for k in range(decks):
        half = min(half, hull.half_width(front - 0.1 * long) * 0.95)
        _house(kit, skin, back, front, half, z - 0.03 * depth, z + tall, nose=0.5 * half, lean=(lean, 0.1 * tall), inset=0.12, glass=(0.35, 0.82))
        over = 0.12 * (front - back) * kit.rng.uniform(0.3, 1.6)
        kit.add(skin, solids.stack([(_outline(back - over, front - lean * 0.85, half * 0.98, 0.5 * half), z + 0.93 * tall), (_outline(back - over, front - lean * 0.85, half * 0.98, 0.5 * half), z + 1.06 * tall)]))
        kit.both(CHROME, rod((back - over * 0.9, half * 0.9, z), (back - over * 0.9, half * 0.9, z + tall), 0.01 * long, 6))
        z, back, front, half = z + 1.05 * tall, back + 0.18 * long * kit.rng.uniform(0.3, 1.2), front - lean - 0.12 * long * kit.rng.uniform(0.4, 1.3), half * 0.86
        if front - back < 0.25 * long:
            break
    top = kit.choose("top", "mast", "arch", "flybridge")
    if top == "arch":
        bow = [(back, -half, z - 0.1), (back + 0.1 * long, -half * 0.8, z + 0.8 * tall), (back + 0.1 * long, half * 0.8, z + 0.8 * tall), (back, half, z - 0.1)]
        kit.add(skin, tube(bow, 0.03 * long, 6))
        kit.add(WHITE, ball(0.1 * beam + 0.3, 0.1 * beam + 0.3, 0.4, 12).at(back + 0.1 * long, 0, z + 0.9 * tall))
    elif top == "mast":
        _mast(kit, CHROME, (back + front) / 2, z - 0.1, depth * 1.1, 0.015 * long)
        kit.add(WHITE, box(0.02 * long, 0.12 * long, 0.02 * long).at((back + front) / 2, 0, z + 0.7 * depth))
    else:
        grid = np.array([[(front - 0.04 * long - 0.05 * long * t - 0.06 * long * y**2, half * y, z - 0.02 + 0.35 * tall * t) for y in np.linspace(-1, 1, 7)] for t in (0, 1)])
        kit.add(DARK_GLASS, sheet(grid, 0.004 * long))
        kit.both(fabric(kit.rng), pillow(0.1 * long, half * 0.6, 0.35 * tall, 0.02 * long, 2).at((back + front) / 2, half * 0.45, z + 0.12 * tall))
    kit.both(DARK_GLASS, *(ball(0.09 * long, 0.02 * beam, 0.18 * depth, 12).at(x * long, hull.half_width(x * long) * 0.955, depth * 0.68) for x in (-0.3, 0.0, 0.3)))
    _railing(kit, hull, -0.1 * long, 0.25 * depth)


def _catamaran(kit: Kit, skin: Material, trim: Material) -> None:
    """Two hulls or three, under sail or power."""
    long = kit.uniform("half_length", 3.5, 12)
    apart, slim = long * kit.uniform("apart", 0.38, 0.55), long * kit.uniform("slim", 0.07, 0.12)
    depth = long * kit.uniform("freeboard", 0.18, 0.26)
    tri, small = kit.chance("trimaran", 0.3), kit.chance("beach", 0.3)
    hull = None
    for y in (-apart, apart):
        hull = _hull(kit, skin, long * (0.7 if tri else 1), slim * (0.7 if tri else 1), depth * (0.7 if tri else 1), sheer=0.1, stern=0.6 if not tri else 0.0, bow=2.0, belly=2.2, rake=kit.uniform("rake", -0.06, 0.1), rise=0.6,
                     aft_rise=0.4, bulwark=0.02, trim=trim, y=y)  # fmt: skip
    if tri:
        hull = _hull(kit, skin, long, slim * 1.6, depth, sheer=0.2, stern=0.5, bow=2.0, belly=2.2, rake=0.08, rise=0.6, bulwark=0.05, trim=trim)
        for x in (0.3, -0.25):
            kit.both(skin, tube(smooth_path([(x * long, 0, depth * 0.85), (x * long, apart * 0.5, depth * 1.05), (x * long, apart, depth * 0.62)], 4), 0.035 * long, 8))
    else:
        kit.add(fabric(kit.rng) if small else skin, box(1.1 * long, 2 * apart, 0.12 * depth if not small else 0.02 * long, 0.02).at(-0.15 * long, 0, depth * 0.93))
        kit.add(CHROME, rod((0.85 * long, -apart, depth * 0.97), (0.85 * long, apart, depth * 0.97), 0.015 * long))
        kit.add(trim, box(0.6 * long, 0.02 * long + 1.2 * apart, 0.01 * long).at(0.55 * long, 0, depth * 0.95))
    top = depth * 1.0
    if not small and not tri:
        high = depth * kit.uniform("house", 0.55, 1.0)
        _house(kit, skin, -0.55 * long, 0.28 * long, apart * kit.uniform("house_width", 0.7, 1.05), top - 0.05, top + high, nose=0.25 * long, lean=(0.25 * long * kit.rng.uniform(0.4, 1.2), 0), inset=0.15)
        kit.add(skin, box(0.7 * long, 1.5 * apart, 0.06 * depth, 0.02).at(-0.4 * long, 0, top + high))
    if kit.chance("sail", 0.7) or small or tri:
        mast, high = 0.15 * long, long * kit.uniform("mast", 1.7, 2.5)
        _mast(kit, CHROME, mast, top * 0.9, high, 0.014 * long)
        boom = top + (0.3 if small or tri else 0.85) * depth + 0.05 * long
        kit.add(CHROME, rod((mast, 0, boom), (-0.7 * long, 0, boom), 0.011 * long))
        wind = kit.uniform("wind", 0.05, 0.18) * long
        if kit.chance("sails_up", 0.8):
            _sail(kit, WHITE, [(mast - 0.02 * long, 0, boom), (-0.68 * long, 0.05 * long, boom), (mast - 0.01, 0, top + 0.88 * high)], wind, 0.18)
            _sail(kit, trim if kit.rng.random() < 0.3 else WHITE, [(0.85 * long, 0, top), (mast, 0.1 * long, top + 0.1 * high), (mast + 0.03 * long, 0, top + 0.78 * high)], wind)
        kit.both(ROPE, rod((mast, 0, top + 0.8 * high), (mast - 0.1 * long, apart, depth * (0.7 if tri else 1)), 0.004 * long, 5))
    else:
        _mast(kit, CHROME, -0.2 * long, top, depth * 1.9, 0.012 * long)


def _submarine(kit: Kit, skin: Material, trim: Material) -> None:
    long = kit.uniform("half_length", 25, 80)
    r = long * kit.uniform("radius", 0.075, 0.12)
    old = kit.chance("old", 0.4)
    dark = Material(shade_of((0.2, 0.22, 0.24), kit.rng, 0.3), (0.2,) * 3, 20.0, name="dark hull") if kit.rng.random() < 0.7 else skin
    if old:
        hull = _hull(kit, dark, long, r * 1.0, r * 1.9, sheer=0.1, stern=0.0, bow=2.4, belly=2.6, rake=0.06, rise=0.45, aft_rise=0.5, bulwark=0.01)
        top = hull.deck_at(0)
        kit.both(dark, body([(0.6 * long, 0.1, 0.1, r), (0.4 * long, r * 0.5, r * 0.6, r), (-0.4 * long, r * 0.5, r * 0.6, r), (-0.7 * long, 0.1, 0.1, r)]).at(0, r * 0.7, 0))
        kit.add(BLACK, rod((0.25 * long, 0, top), (0.25 * long, 0, top + 0.5 * r), 0.2 * r), rod((0.25 * long, 0, top + 0.5 * r), (0.36 * long, 0, top + 0.7 * r), 0.08 * r))
        kit.add(ROPE, rod((0.08 * long, 0, top + 1.5 * r), (0.98 * long, 0, hull.deck_at(0.95 * long) + 0.1), 0.03 * r, 4))
    else:
        depth = kit.hide("keel_hollow", 0.02, 0.5)
        rings = []
        for t in np.linspace(-1, 1, 33):
            if t > 0.6:
                w = np.sqrt(max(1 - ((t - 0.6) / 0.4) ** 2, 0.0))
            else:
                w = 1.0 if t > -0.3 else max(1 - ((-0.3 - t) / 0.7) ** 1.7, 0.03)
            oval = solids.superellipse(2 * r * w, 2 * r * w, 2.0, 24)
            slot = np.repeat(oval, [2 if k in (17, 19) else 1 for k in range(24)], axis=0)
            slot[18:21, 1] += depth * r if abs(t) < 0.3 else 0
            rings.append(np.column_stack([np.full(len(slot), t * long), slot[:, 0], slot[:, 1] + r]))
        kit.add(dark, loft(np.array(rings)))
        top = 2 * r
        fins = kit.choose("tail", 90, 45)
        for angle in (0, 90, 180, 270):
            kit.add(dark, solids.wing([(-0.8 * long, 0, 0.2 * r, 0.14 * long), (-0.84 * long, 0, 1.25 * r, 0.09 * long)], 0.1, fin=True).turned("x", angle + (45 if fins == 45 else 0)).at(0, 0, r))
        for angle in around(7):
            kit.add(trim, box(0.02 * long, 0.1 * r, 0.75 * r).turned("z", 35).at(0, 0, 0.4 * r).turned("x", angle).at(-1.0 * long, 0, r))
        if kit.chance("missile_deck", 0.4):
            kit.add(dark, body([(0.05 * long, 0.1, 0.1, 1.9 * r), (-0.02 * long, r * 0.7, r * 0.45, 1.85 * r), (-0.4 * long, r * 0.7, r * 0.45, 1.85 * r), (-0.62 * long, 0.1, 0.1, 1.6 * r)], 3.5))
    sail = kit.uniform("sail_place", -0.05, 0.4) * long
    tall = r * kit.uniform("sail", 0.9, 1.6)
    kit.add(dark, solids.wing([(sail + 0.1 * long, 0, top - 0.3 * r, 0.24 * long, 0.3), (sail + 0.09 * long, 0, top + tall, 0.2 * long, 0.26)], fin=True))
    if kit.chance("sail_planes", 0.5):
        kit.both(dark, solids.wing([(sail + 0.06 * long, 0, top + 0.5 * tall, 0.07 * long), (sail + 0.04 * long, 1.2 * r, top + 0.5 * tall, 0.05 * long)], 0.12))
    for k in range(kit.choose("masts", 1, 3)):
        x = sail + (0.04 - 0.035 * k) * long
        kit.add(CHROME, rod((x, 0, top + tall), (x, 0, top + tall + r * kit.rng.uniform(0.4, 1.2)), 0.07 * r))


def _hovercraft(kit: Kit, skin: Material, trim: Material) -> None:
    long = kit.uniform("half_length", 3, 14)
    beam, skirt = long * kit.uniform("beam", 0.42, 0.6), long * kit.uniform("skirt", 0.12, 0.2)
    rubber = Material((0.14, 0.14, 0.15), name="skirt")
    depth = kit.hide("keel_hollow", 0.02, 0.5)

    def edge(grow: float) -> np.ndarray:
        outline = solids.rounded(2 * (long + grow), 2 * (beam + grow), 0.7 * beam, 6)
        return outline * np.where(outline[:, :1] > 0, [1.0, 1.0], [1.0, 1.0])

    kit.add(rubber, solids.stack([(edge(-0.5 * skirt), depth * skirt), (edge(-0.5 * skirt), 0.0), (edge(-0.2 * skirt), 0.0), (edge(0.1 * skirt), 0.35 * skirt), (edge(0.12 * skirt), 0.7 * skirt), (edge(-0.05 * skirt), skirt)]))
    kit.add(skin, solids.stack([(edge(-0.02 * skirt), skirt), (edge(-0.02 * skirt), 1.25 * skirt), (edge(-0.25 * skirt), 1.4 * skirt)]))
    z, high = 1.35 * skirt, long * kit.uniform("house", 0.16, 0.3)
    _house(kit, skin, -kit.uniform("house_back", 0.2, 0.6) * long, 0.6 * long, beam * kit.uniform("house_width", 0.5, 0.8), z, z + high, nose=0.15 * long, lean=(high * 0.9, 0.1 * high), inset=0.1)
    if long > 7:
        _house(kit, skin, 0.1 * long, 0.36 * long, beam * 0.35, z + high, z + 1.5 * high, lean=(0.3 * high, 0), nose=0.05 * long)
    fan = kit.uniform("fan", 0.2, 0.3) * long
    for y in (0.0,) if kit.chance("one_fan", 0.35) else (-0.48 * beam, 0.48 * beam):
        up = z + 1.08 * fan
        ring = lathe([(fan, 0.12 * long), (1.08 * fan, 0.06 * long), (1.03 * fan, -0.12 * long), (0.97 * fan, -0.12 * long)], 24, loop=True)
        kit.add(trim, ring.turned("y", 90).at(-0.78 * long, y, up))
        for angle in around(4, kit.rng.uniform(0, 90)):
            kit.add(BLACK, box(0.02 * long, 0.14 * fan, 0.95 * fan).turned("z", 35).at(z=0.47 * fan).turned("x", angle).at(-0.78 * long, y, up))
        kit.add(BLACK, cylinder(0.2 * fan, 0.25 * long, 14).turned("y", 90).at(-0.72 * long, y, up), box(0.06 * long, 0.12 * fan, fan).at(-0.72 * long, y, up - 0.5 * fan))
        for dy in (-0.4, 0.4):
            kit.add(skin, box(0.14 * long, 0.03 * fan, 1.7 * fan).at(-0.98 * long, y + dy * fan, up), box(0.1 * long, 0.03 * fan, 0.3 * fan).at(-0.9 * long, y + dy * fan, z + 0.1 * fan))


# --- Ships ------------------------------------------------------------------------------------


def _bridge(kit: Kit, x: float, long: float, beam: float, z: float, tower: float, funnel: Material) -> None:
    """The white tower of a merchant ship, its wings and its funnel."""
    _house(kit, WHITE, x - long, x + long, beam * 0.82, z, z + tower * 0.85, inset=0.02, glass=None)
    for k in range(1, 5):
        level = z + 0.85 * tower * k / 5
        kit.add(DARK_GLASS, box(2.02 * long, beam * 1.4, 0.05 * tower).at(x, 0, level))
    _house(kit, WHITE, x - 0.5 * long, x + 1.1 * long, beam * 0.98, z + tower * 0.85, z + tower, inset=-0.02, glass=(0.4, 0.85))
    _mast(kit, WHITE, x, z + tower, 0.35 * tower, 0.06 * long)
    _funnel(kit, WHITE, funnel, x - 1.7 * long, 0, z, tower * 0.8, 0.32 * long, 0.0)


def _cargo_ship(kit: Kit, skin: Material, trim: Material) -> None:
    """Container ships, tankers, bulk carriers, gas carriers, coasters."""
    load = kit.choose("load", "containers", "containers", "tanker", "bulk", "gas", "coaster", "feeder")
    long = kit.uniform("half_length", 25, 45) if load in ("coaster", "feeder") else kit.uniform("half_length", 60, 170)
    beam, depth = long * kit.uniform("beam", 0.13, 0.19), long * kit.uniform("freeboard", 0.1, 0.18) * (1.5 if load == "coaster" else 1)
    paint_ = Material(pick(kit.rng, HULLS), (0.2,) * 3, 30.0, name="hull")
    floor = Material(shade_of((0.42, 0.3, 0.26), kit.rng, 0.3), name="deck")
    hull = _hull(kit, paint_, long, beam, depth, sheer=kit.uniform("sheer", 0.1, 0.45), stern=0.75, bow=kit.uniform("bow", 4.0, 8.0), belly=4.5, rake=kit.uniform("rake", 0.02, 0.08), rise=0.25,
                 aft_rise=0.5, aft_sheer=0.1, bulwark=0.06, deck=floor, trim=None)  # fmt: skip
    z = hull.deck_at(0)
    tower = kit.uniform("tower", 0.14, 0.26) * long
    place = kit.choose("bridge", -0.78, -0.78, -0.55, 0.55 if load == "feeder" else -0.8) * long
    _bridge(kit, place, 0.055 * long, beam, hull.deck_at(place) - 0.02 * depth, tower, trim)
    kit.add(paint_, ball(0.12 * long, 0.5 * beam, 0.5 * beam, 14).at(0.97 * long, 0, 0.2 * depth + 0.25 * beam))
    low, high = (-0.62 * long, 0.82 * long) if place < -0.6 * long else (-0.4 * long, 0.82 * long) if place < 0 else (-0.92 * long, 0.4 * long)
    if load in ("containers", "feeder"):
        colours = [paint(kit.rng) for _ in range(5)]
        bays, across = kit.choose("bays", 6, 8, 10), kit.choose("across", 4, 5, 6)
        pitch, wide, tall = (high - low) / bays, 1.84 * beam / across, 0.028 * long * kit.uniform("container", 0.8, 1.3)
        most = kit.choose("most", 2, 4, 6)
        for i in range(bays):
            x = low + pitch * (i + 0.5)
            full = kit.rng.integers(1, most + 1)
            for j in range(across):
                y = (j - (across - 1) / 2) * wide
                levels = max(0, full - int(kit.rng.integers(0, 2)))
                if levels and abs(y) + wide / 2 < hull.half_width(x + pitch / 2) * 1.01:
                    cut = int(kit.rng.integers(1, levels + 1))
                    for start, end in ((0, cut), (cut, levels)):
                        if end > start:
                            kit.add(pick(kit.rng, colours), box(0.93 * pitch, 0.95 * wide, (end - start) * tall).at(x, y, z + (start + end) / 2 * tall))
    elif load == "tanker":
        for y in (-0.25, 0, 0.25):
            kit.add(trim, rod((low, y * beam, z + 0.08 * depth), (high, y * beam, z + 0.08 * depth), 0.025 * beam, 6))
        for x in np.linspace(low, high, 7)[1:-1]:
            kit.add(trim, box(0.02 * long, 1.3 * beam, 0.12 * depth).at(x, 0, z + 0.06 * depth), cylinder(0.1 * beam, 0.2 * depth, 12).at(x + 0.07 * long, 0.5 * beam, z))
        for x in ((low + high) / 2,):
            kit.both(WHITE, rod((x, 0.5 * beam, z), (x, 0.5 * beam, z + 0.9 * depth), 0.04 * beam), rod((x, 0.5 * beam, z + 0.7 * depth), (x + 0.14 * long, 0.5 * beam, z + 0.9 * depth), 0.025 * beam))
    elif load == "gas":
        count = kit.choose("tanks", 3, 4, 5)
        size = min((high - low) / count * 0.94, 2.2 * beam)
        for x in low + (np.arange(count) + 0.5) * (high - low) / count:
            kit.add(trim, ball(size, min(size, 2 * beam), size, 22).at(x, 0, z + 0.1 * size))
    else:
        holds, crane = kit.choose("holds", 4, 5, 7), kit.chance("cranes", 0.6)
        pitch = (high - low) / holds
        for k in range(holds):
            x = low + pitch * (k + 0.5)
            kit.add(trim, box(0.68 * pitch, 1.35 * beam, 0.16 * depth, 0.02 * depth).at(x, 0, z + 0.06 * depth))
            if crane and k < holds - 1:
                at, up = x + 0.5 * pitch, kit.uniform("crane", 0.7, 1.1) * depth
                kit.add(WHITE, cylinder(0.12 * beam, up, 12).at(at, 0, z + up / 2), box(0.25 * beam, 0.3 * beam, 0.25 * depth).at(at, 0, z + up),
                        rod((at, 0, z + up), (at + 0.9 * pitch, 0, z + 1.5 * up), 0.04 * beam))  # fmt: skip
    _mast(kit, WHITE, 0.92 * long, hull.deck_at(0.92 * long), 0.6 * depth, 0.05 * beam)


def _tug(kit: Kit, skin: Material, trim: Material) -> None:
    """Tugs and fishing boats: short, deep, high in the bow."""
    long = kit.uniform("half_length", 6, 16)
    beam, depth = long * kit.uniform("beam", 0.26, 0.4), long * kit.uniform("freeboard", 0.26, 0.4)
    paint_ = Material(pick(kit.rng, HULLS), (0.2,) * 3, 30.0, name="hull") if kit.rng.random() < 0.6 else skin
    hull = _hull(kit, paint_, long, beam, depth, sheer=kit.uniform("sheer", 0.35, 0.8), stern=kit.uniform("stern", 0.55, 0.85), bow=kit.uniform("bow", 2.4, 4.0), belly=2.4, rake=0.1, rise=0.4, aft_rise=0.5,
                 aft_sheer=0.25, bulwark=0.25, deck=wood(kit.rng), trim=BLACK)  # fmt: skip
    fishing = kit.chance("fishing", 0.5)
    x = kit.uniform("house_place", -0.5 if fishing else 0.0, 0.3) * long
    z, tall = hull.deck_at(x), depth * kit.uniform("storey", 0.55, 0.85)
    half = beam * kit.uniform("house", 0.5, 0.7)
    _house(kit, WHITE, x - 0.32 * long, x + 0.22 * long, half, z - 0.05 * depth, z + tall, nose=0.3 * half, glass=(0.45, 0.75))
    _house(kit, trim if kit.rng.random() < 0.5 else WHITE, x - 0.12 * long, x + 0.18 * long, half * 0.85, z + tall, z + 1.9 * tall, nose=0.4 * half, lean=(-0.05 * tall, 0), inset=-0.06, glass=(0.35, 0.85))
    kit.add(WHITE, box(0.4 * long, 1.9 * half, 0.08 * tall, 0.02).at(x + 0.02 * long, 0, z + 1.92 * tall))
    if fishing:
        far = -0.55 * long if x > -0.15 * long else 0.5 * long
        base = hull.deck_at(far)
        _mast(kit, CHROME, far, base, 2.4 * depth, 0.02 * long)
        kit.add(CHROME, rod((far, 0, base + 0.5 * depth), (far - np.sign(far) * 0.4 * long, 0, base + 2.0 * depth), 0.014 * long), rod((far, 0, base + 2.3 * depth), (far - np.sign(far) * 0.4 * long, 0, base + 2.0 * depth), 0.004 * long, 4))
        if kit.chance("outriggers", 0.5):
            kit.both(CHROME, rod((far, 0, base + 0.4 * depth), (far, 1.6 * beam, base + 2.4 * depth), 0.012 * long))
        kit.add(fabric(kit.rng), pillow(0.3 * long, 1.0 * beam, 0.3 * depth, 0.1 * depth, 2).at(-0.75 * long, 0, hull.deck_at(-0.75 * long) + 0.15 * depth))
    else:
        _funnel(kit, trim, BLACK, x - 0.22 * long, 0, z + tall, 1.1 * tall, 0.13 * beam + 0.2, 0.05 * long)
        kit.add(BLACK, cylinder(0.1 * beam, 0.5 * depth, 12).at(-0.55 * long, 0, hull.deck_at(-0.55 * long) + 0.2 * depth))
        rubber = hull.rail[hull.rail[:, 0] > 0.4 * long]
        kit.both(BLACK, tube(rubber * [1, 1.02, 0.96], 0.045 * long, 8))
    for tx in (-0.4, 0.0, 0.4):
        tyre = lathe([(0.04 * long, -0.02 * long), (0.07 * long, -0.02 * long), (0.07 * long, 0.02 * long), (0.04 * long, 0.02 * long)], 14, loop=True)
        kit.both(BLACK, tyre.turned("x", 90).at(tx * long, hull.half_width(tx * long) * 1.02, 0.72 * depth))
    _mast(kit, CHROME, x, z + 1.9 * tall, 1.2 * depth, 0.014 * long)


def _liner(kit: Kit, skin: Material, trim: Material) -> None:
    """Cruise ships, ferries, old liners, river boats with paddles."""
    form = kit.choose("form", "cruise", "ferry", "old", "paddle")
    long = kit.uniform("half_length", 20, 40) if form == "paddle" else kit.uniform("half_length", 45, 150)
    beam, depth = long * kit.uniform("beam", 0.13, 0.22), long * kit.uniform("freeboard", 0.1, 0.17) * (0.6 if form == "paddle" else 1)
    dark = Material(pick(kit.rng, HULLS), (0.2,) * 3, 30.0, name="hull") if form in ("old", "ferry") else WHITE
    hull = _hull(kit, dark, long, beam, depth, sheer=kit.uniform("sheer", 0.05, 0.35), stern=0.3 if form == "old" else 0.85, bow=kit.uniform("bow", 2.6, 4.5), belly=3.5, rake=kit.uniform("rake", 0.06, 0.16),
                 rise=0.3, aft_rise=0.3, bulwark=0.04, deck=wood(kit.rng))  # fmt: skip
    decks = kit.choose("decks", *{"cruise": (5, 7, 8), "ferry": (3, 4), "old": (3, 4), "paddle": (2, 3)}[form])
    tall = kit.uniform("storey", 0.026, 0.034) * long * {"paddle": 2.2, "ferry": 1.5}.get(form, 1.0)
    back, front, z = -0.92 * long, kit.uniform("house_front", 0.5, 0.72) * long, hull.deck_at(0) - 0.02 * depth
    step = kit.uniform("step", 0.01, 0.06)
    half = min(hull.half_width(front - 0.12 * long), beam) * 0.97
    for k in range(decks):
        _house(kit, WHITE, back, front, half, z, z + 0.86 * tall, nose=0.3 * half, inset=0.0, glass=(0.4, 0.75))
        kit.add(WHITE if form != "paddle" else trim, solids.stack([(_outline(back - 0.01 * long, front, half * 1.04, 0.3 * half), z + 0.86 * tall), (_outline(back - 0.01 * long, front, half * 1.04, 0.3 * half), z + tall)]))
        if form == "paddle":
            for x in np.linspace(back, front - 0.3 * half, 7):
                kit.both(WHITE, rod((x, half * 1.02, z), (x, half * 1.02, z + tall), 0.006 * long, 6))
            half *= 0.94
        z, back, front = z + tall, back + step * long * kit.rng.uniform(0.2, 2), front - step * long * kit.rng.uniform(0.3, 1.6)
    if form in ("cruise", "ferry"):
        for x in np.linspace(-0.5, 0.4, kit.choose("lifeboats", 4, 6, 9)) * long:
            kit.both(Material((0.85, 0.45, 0.12), name="lifeboat"), ball(0.07 * long, 0.03 * long, 0.03 * long, 12).at(x, half * 1.06, hull.deck_at(0) + tall * (1.4 if form == "cruise" else 1.1)))
    count = {"old": kit.choose("funnels", 2, 3, 4), "paddle": 2}.get(form, 1)
    up = long * {"old": 0.17, "paddle": 0.28, "cruise": 0.1, "ferry": 0.1}[form]
    for k, x in enumerate(np.linspace(-0.35, 0.35, count) * long if count > 1 else [-kit.uniform("funnel_place", 0.1, 0.6) * long]):
        if form == "paddle":
            kit.both(BLACK, cylinder(0.03 * long, up, 14).at(0.3 * long, 0.45 * half, z + up / 2)) if k == 0 else None
        else:
            _funnel(kit, trim, WHITE if form != "old" else BLACK, x, 0, z, up, 0.022 * long if form == "old" else 0.035 * long, 0.03 * long)
    if form == "paddle":
        stern = kit.chance("stern_wheel", 0.5)
        size = depth * 1.1
        for y in (0,) if stern else (-beam * 1.1, beam * 1.1):
            x, wide = (-1.03 * long, 1.5 * beam) if stern else (-0.05 * long, 0.35 * beam)
            for angle in around(10):
                kit.add(trim, box(0.3 * size, wide, 0.05 * size).at(0.85 * size, 0, 0).turned("y", angle).at(x, y, size))
            kit.add(trim, *(lathe([(0.92 * size, -0.04 * beam), (size, -0.04 * beam), (size, 0.04 * beam), (0.92 * size, 0.04 * beam)], 20, loop=True).turned("x", 90).at(x, y + s * wide / 2, size) for s in (-1, 1)))
            if not stern:
                kit.add(WHITE, cylinder(1.12 * size, 0.06 * beam, 24).turned("x", 90).at(x, y * 1.19, 1.15 * size))
        _house(kit, WHITE, 0.32 * long, 0.44 * long, half * 0.45, z, z + tall, glass=(0.3, 0.8))
    else:
        _mast(kit, WHITE, 0.3 * long if form != "old" else 0.75 * long, z if form != "old" else hull.deck_at(0.7 * long), 0.14 * long if form != "old" else 0.35 * long, 0.006 * long)
        if form == "old":
            _mast(kit, WHITE, -0.8 * long, hull.deck_at(-0.8 * long), 0.35 * long, 0.006 * long)


def _warship(kit: Kit, skin: Material, trim: Material) -> None:
    """Destroyers, battleships, patrol boats, aircraft carriers, landing craft."""
    form = kit.choose("form", "destroyer", "battleship", "carrier", "patrol", "stealth", "landing")
    grey = Material(shade_of((0.48, 0.51, 0.54), kit.rng, 0.25), (0.1,) * 3, 20.0, name="grey")
    floor = Material(shade_of((0.32, 0.34, 0.36), kit.rng, 0.2), name="deck")
    long = {"patrol": 12.0, "landing": 12.0}.get(form, 70.0) * kit.uniform("size", 0.8, 1.4)
    slim = {"destroyer": 0.115, "battleship": 0.15, "carrier": 0.13, "patrol": 0.22, "stealth": 0.13, "landing": 0.26}[form]
    beam, depth = long * slim * kit.uniform("beam", 0.9, 1.15), long * slim * kit.uniform("freeboard", 0.8, 1.15) * (1.35 if form == "carrier" else 1)
    hull = _hull(kit, grey, long, beam, depth, sheer=kit.uniform("sheer", 0.1, 0.5) * (0 if form in ("carrier", "landing") else 1), stern=0.75, bow=2.2 if form not in ("carrier", "landing") else 5.0,
                 belly=2.6 if form != "stealth" else 1.3, rake=0.1 if form != "stealth" else -0.08, rise=0.4, bulwark=0.03 if form != "landing" else 0.55, deck=floor)  # fmt: skip
    z = hull.deck_at(0)
    if form == "carrier":
        flare = kit.uniform("flight_deck", 1.5, 2.0)
        outline = np.array([(-1.02, 0.9), (-1.02, -0.9), (-0.3, -1.0), (0.35, -1.0), (0.75, -0.62), (1.04, -0.55), (1.04, 0.5), (0.4, 0.75), (0.1, 1.35), (-0.5, 1.35)]) * [long, beam * flare / 1.35]
        kit.add(floor, solids.stack([(outline * 0.97, z - 0.1 * depth), (outline, z + 0.1 * depth), (outline, z + 0.2 * depth)]))
        z += 0.2 * depth
        y, start = -beam * 0.95, kit.num_parts
        _house(kit, grey, -0.1 * long, 0.2 * long, 0.2 * beam, z, z + 0.9 * depth, glass=(0.6, 0.85))
        _house(kit, grey, 0.0, 0.15 * long, 0.22 * beam, z + 0.9 * depth, z + 1.4 * depth, glass=(0.4, 0.8))
        _mast(kit, grey, 0.05 * long, z + 1.4 * depth, 1.0 * depth, 0.01 * long)
        kit.move_from(start, y)
        for _ in range(kit.choose("planes", 0, 4, 8)):
            px, py = kit.rng.uniform(-0.85, 0.7) * long, kit.rng.uniform(-0.1, 0.8) * beam
            size = 0.035 * long
            jet = body([(size, 0.02 * size, 0.02 * size, 0), (0.4 * size, 0.13 * size, 0.13 * size, 0), (-size, 0.1 * size, 0.1 * size, 0)], 2, 1, 8)
            kit.add(GREY, jet.at(px, py, z + 0.2 * size), solids.wing([(-0.9 * size, 0, 0, 0.3 * size), (-0.9 * size, 0, 0.6 * size, 0.15 * size)], 0.1, fin=True).at(px + 0.5 * size, py, z + 0.2 * size),
                    *(solids.wing([(0.3 * size, 0, 0, 0.9 * size), (-0.5 * size, s * 0.7 * size, 0, 0.2 * size)], 0.05).at(px, py, z + 0.2 * size) for s in (-1, 1)))  # fmt: skip
        return
    if form == "landing":
        _house(kit, grey, -0.92 * long, -0.55 * long, 0.6 * beam, z, depth * 1.5, glass=(0.6, 0.85))
        kit.add(grey, box(0.06 * long, 1.0 * beam, 1.1 * depth, 0.01 * long).turned("y", 25).at(0.98 * long, 0, 0.75 * depth))
        crate = paint(kit.rng)
        for x in (-0.2, 0.3):
            if kit.rng.random() < 0.7:
                kit.add(crate, box(0.35 * long, 0.9 * beam, 0.6 * depth, 0.03).at(x * long, 0, z + 0.3 * depth), box(0.15 * long, 0.7 * beam, 0.4 * depth, 0.03).at((x - 0.05) * long, 0, z + 0.7 * depth))
        _mast(kit, grey, -0.72 * long, 1.5 * depth, 0.8 * depth, 0.012 * long)
        return
    tall = depth * kit.uniform("storey", 0.4, 0.6)
    lean = 0.9 * tall if form == "stealth" else 0.15 * tall
    back, front, half = -kit.uniform("house_back", 0.3, 0.6) * long, kit.uniform("house_front", 0.15, 0.35) * long, beam * 0.72
    for k in range(kit.choose("levels", 2, 3, 4)):
        _house(kit, grey, back, front, half, z - 0.03 * depth, z + tall, lean=(lean, lean), inset=0.25 if form == "stealth" else 0.05, glass=None)
        z, back, front, half = z + tall, back + long * kit.rng.uniform(0.05, 0.2), front - lean - 0.02 * long, half * 0.85
        if front - back < 0.12 * long:
            break
    back = min(back, front - 0.1 * long)
    _house(kit, grey, front - 0.1 * long, front, half, z, z + tall, lean=(0.1 * tall, 0), inset=0.1, glass=(0.5, 0.8))
    tower = depth * kit.uniform("mast", 1.2, 2.6)
    if form in ("stealth", "destroyer") and kit.chance("pyramid", 0.5):
        kit.add(grey, solids.stack([(solids.superellipse(0.12 * long, 0.8 * half, 8, 16), 0.0), (solids.superellipse(0.04 * long, 0.3 * half, 8, 16), tower)]).at(front - 0.14 * long, 0, z))
    else:
        _mast(kit, grey, front - 0.12 * long, z, tower, 0.012 * long)
        for t in (0.5, 0.75):
            kit.add(grey, box(0.015 * long, 1.3 * half * (1.2 - t), 0.015 * long).at(front - 0.12 * long, 0, z + t * tower))
        kit.both(grey, rod((front - 0.2 * long, 0.3 * half, z), (front - 0.12 * long, 0, z + 0.7 * tower), 0.007 * long))
    if form != "stealth":
        for x in ((back + front) / 2 - 0.15 * long, back - 0.02 * long)[: kit.choose("funnels", 1, 2)]:
            _funnel(kit, grey, grey, x, 0, hull.deck_at(x), 2.2 * tall + 0.4 * depth, 0.17 * beam, 0.02 * long)
    size = beam * {"battleship": 0.62, "patrol": 0.3}.get(form, 0.4)
    barrels = kit.choose("barrels", 2, 3) if form == "battleship" else 1
    spots = [(0.62, 1, 0.0), (0.44, 1, 0.7), (-0.72, -1, 0.0)][: 3 if form == "battleship" else kit.choose("turrets", 1, 2)]
    for x, aim, step in spots:
        base = hull.deck_at(x * long)
        if step and form == "battleship":
            kit.add(grey, cylinder(0.8 * size, step * size, 18).at(x * long, 0, base + step * size / 2))
            base += step * size
        _turret(kit, grey, x * long, base, size, aim, barrels, (2.6 if form == "battleship" else 2.0) * size)
    if form in ("destroyer", "stealth") and kit.chance("helipad", 0.6):
        kit.add(grey, box(0.2 * long, 1.4 * beam, 1.1 * tall, 0.02 * beam).at(-0.5 * long, 0, hull.deck_at(-0.5 * long) + 0.5 * tall))
        kit.add(WHITE, cylinder(0.5 * beam, 0.02 * depth, 20).at(-0.8 * long, 0, hull.deck_at(-0.8 * long) + 0.01 * depth))
    else:
        kit.both(grey, box(0.12 * long, 0.2 * beam, 0.25 * depth).turned("y", -15).at(-0.5 * long, 0.55 * beam, hull.deck_at(-0.5 * long) + 0.2 * depth))
    _railing(kit, hull, 0.3 * long, 0.14 * depth)
    kit.add(LIGHT, ball(0.02 * long, 0.02 * long, 0.02 * long, 8).at(front, 0, z + 1.05 * tall))


Builder = Callable[[Kit, Material, Material], None]
KINDS: dict[str, Builder] = {
    "sailing_yacht": _sailing_yacht, "galleon": _galleon, "rowing": _rowing,
    "speedboat": _speedboat, "jet_ski": _jet_ski, "motor_yacht": _motor_yacht,
    "catamaran": _catamaran, "submarine": _submarine, "hovercraft": _hovercraft,
    "cargo_ship": _cargo_ship, "tug": _tug, "liner": _liner, "warship": _warship,
}  # fmt: skip


def watercraft(kit: Kit) -> None:
    """Boats and ships of 13 kinds. Hidden: how far the bottom is hollow."""
    kind = kit.choose("subtype", "sailing_yacht", "warship", "cargo_ship", "rowing", "liner", *KINDS)
    skin = WHITE if kit.rng.random() < 0.45 else wood(kit.rng) if kit.rng.random() < 0.2 else paint(kit.rng)
    KINDS[kind](kit, skin, paint(kit.rng))

