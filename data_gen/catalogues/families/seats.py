"""Chairs, benches and couches. Lengths in metres, the front toward +x."""
# fmt: off
# We format by hand, because the formatter would put each coordinate in a line.

import functools
from typing import NamedTuple

import numpy as np

from data_gen.catalogues.families import materials as m
from data_gen.catalogues.families.kit import Kit, column, four_legs
from data_gen.catalogues.shapes import (
    block,
    box,
    cylinder,
    pillow,
    prism,
    rod,
    rounded,
    sheet,
    smooth_path,
    stack,
    superellipse,
    tube,
)
from data_gen.mesh import Material


class _Seat(NamedTuple):
    """Size of a seat, the height of its top, and the materials of frame and upholstery."""

    depth: float
    width: float
    top: float
    frame: Material
    soft: Material


def _back(kit: Kit, seat: _Seat, style: str, high: float, lean: float) -> None:
    """A back at the rear edge of a seat, `high` above its top."""
    start, half, low, top = len(kit.parts), seat.width / 2, seat.top, seat.top + high
    post, frame = kit.uniform(0.025, 0.05), seat.frame
    if style == "soft":
        thick = kit.uniform(0.06, 0.15)
        kit.add(seat.soft, pillow(thick, 2 * half, high + 0.05, kit.uniform(0.2, 0.5) * thick)
                .at(-thick / 2, 0, low + high / 2 - 0.025))
    elif style == "shell":
        t, s = np.mgrid[0:1:9j, -1:1:13j]
        power, narrow, curve = kit.uniform(1.6, 6), kit.uniform(0, 0.3), kit.uniform(0.0, 0.6)
        outline = (1 - np.abs(s) ** power) ** (1 / power) * 0.45 + 0.55
        grid = [curve * half * s**2, s * half * (1 - narrow * (1 - t)), t * (high + 0.03) * outline]
        kit.add(seat.soft, sheet(np.stack(grid, axis=-1), kit.uniform(0.015, 0.05))
                .at(-0.02, 0, low - 0.03))
    elif style == "hoop":
        path = [(0, 0.9 * half, low - 0.02), (-0.01, half, low + 0.55 * high),
                (-0.02, 0.6 * half, top - 0.02), (-0.02, 0, top)]
        path = [*path, *(np.array(path[-2::-1]) * [1, -1, 1])]
        kit.add(frame, tube(smooth_path(path, 5), kit.uniform(0.01, 0.02)))
        for y in np.linspace(-0.6, 0.6, kit.choose(3, 5, 7)):
            kit.add(frame, rod((0, 0.8 * y * half, low - 0.02),
                               (-0.015, y * half, top - 0.015 - 0.25 * high * y**2), 0.008))
    else:
        rail, crest = kit.uniform(0.04, 0.14), kit.choose(0.0, 0.0, kit.uniform(0.02, 0.08))
        kit.both(frame, block((-post, 0), (half - post, half), (low - 0.06, top), 0.006))
        edge = [(-half, 0), (half, 0), (half, rail), (0, rail + crest), (-half, rail)]
        kit.add(frame, prism(edge, 0.03).turned("z", 90).at(-post / 2, 0, top - rail))
        flat = (-0.8 * post, -0.2 * post)
        if style == "panel":
            gap = kit.choose(-0.02, kit.uniform(0.05, 0.3) * high)
            kit.add(kit.choose(frame, seat.soft), block(flat, (-half, half), (low + gap, top)))
        elif style == "ladder":
            for z in np.linspace(low + kit.uniform(0, 0.1), top, kit.choose(2, 3, 4, 5))[:-1]:
                kit.add(frame, block(flat, (-half, half), (z, z + 0.05), 0.004))
        else:  # slats
            count = max(2, int(2 * half / kit.uniform(0.06, 0.14)))
            wide = kit.choose(0.016, kit.uniform(0.2, 0.75) * 2 * half / count)
            for y in (np.arange(count) + 0.5) / count * 2 * half - half:
                kit.add(frame, block(flat, (y - wide / 2, y + wide / 2), (low - 0.03, top)))
    # Points above the seat move backward.
    kit.change(start, lambda part: part.bent(
        lambda v: v + [0.03 - seat.depth / 2, 0, 0] - np.maximum(v[:, 2:] - low, 0) * [lean, 0, 0]))


def _arms(kit: Kit, seat: _Seat, style: str, floor: float) -> None:
    """Arms on both sides of a seat; solid arms begin at z = `floor`."""
    x, y, high = seat.depth / 2, seat.width / 2, kit.uniform(0.15, 0.28)
    low, top = seat.top - 0.05, seat.top + high
    if style == "posts":
        kit.both(seat.frame, block((x - 0.15, x - 0.11), (y - 0.01, y + 0.03), (low, top)),
                 block((-x - 0.05, x - 0.06), (y - 0.02, y + 0.05), (top - 0.02, top + 0.015),
                       0.008))
    elif style == "loops":
        path = [(0.5 * x, y, low + 0.02), (0.7 * x, y + 0.04, seat.top + 0.6 * high),
                (0.5 * x, y + 0.04, top), (-0.5 * x, y + 0.04, top), (-x, y, top - 0.02)]
        kit.both(seat.frame, tube(smooth_path(path, 4), kit.uniform(0.012, 0.022)))
    elif style == "pads":
        kit.both(seat.frame, block((-0.03, 0.03), (y - 0.01, y + 0.03), (low - 0.01, top)),
                 block((-0.03, 0.03), (y - 0.12, y + 0.03), (low - 0.01, low + 0.03)))
        kit.both(m.BLACK, pillow(0.26, 0.08, 0.035, 0.015).at(0.02, y + 0.01, top))
    else:
        wide, slope = kit.uniform(0.05, 0.2), kit.choose(0.0, 0.0, kit.uniform(0.1, 0.6)) * high
        side = pillow(2 * x + 0.02, wide, top - floor, kit.uniform(0.1, 0.5) * wide)
        side = side.bent(lambda v: v - np.outer((v[:, 2] > 0) * (v[:, 0] + x),
            [0, 0, slope / x / 2]))
        kit.both(seat.soft, side.at(0, y + wide / 2 - 0.01, (top + floor) / 2))


def _base(kit: Kit, seat: _Seat, style: str, under: float) -> None:
    """The base of a seat, below z = `under`."""
    x, y, top, frame = seat.depth / 2 - 0.03, seat.width / 2 - 0.03, under + 0.005, seat.frame
    thick = kit.uniform(0.01, 0.018)
    if style in ("legs", "rockers"):
        four_legs(kit, frame, x, y, top, kit.uniform(0.025, 0.06),
                  "" if style == "legs" else "round")
        if style == "rockers":
            angle = np.linspace(-0.9, 0.9, 9)
            arc = [0.75 * seat.depth * np.sin(angle), 0 * angle + y,
                   0.77 * seat.depth * (1 - np.cos(angle))]
            kit.both(frame, tube(np.stack(arc, axis=1), 0.02))
        elif kit.chance(0.5):
            rail = (top - kit.uniform(0.03, 0.08), top)
            kit.both(frame, block((-x, x), (y - 0.01, y + 0.01), rail))
            kit.add(frame, *(block((s * x - 0.01, s * x + 0.01), (-y, y), rail) for s in (-1, 1)))
    elif style == "sled":
        lift = kit.choose(0.0, kit.uniform(0.0, 0.15))
        kit.both(frame, tube([(x - lift, y, top), (x, y, thick), (-x, y, thick),
                              (lift - x, y, top)], thick))
        kit.add(frame, rod((-x, -y, thick), (-x, y, thick), thick))
    elif style == "cantilever":
        kit.both(frame, tube([(-x, y, top - thick), (x - 0.06, y, top - thick), (x, y, top - 0.06),
                              (x, y, 0.06), (x - 0.06, y, thick), (-x, y, thick)], thick))
        kit.add(frame, rod((-x, -y, thick), (-x, y, thick), thick))
    elif style in ("disc", "star", "casters"):
        reach = min(seat.depth, seat.width) * kit.uniform(0.4, 0.58)
        column(kit, frame, reach, top, kit.uniform(0.02, 0.05), style)
    elif style == "cross":
        kit.both(frame, rod((x, y, 0), (-x, y, top), thick), rod((-x, y, 0), (x, y, top), thick))
        kit.add(frame, rod((0, -y, top / 2), (0, y, top / 2), thick))
    elif style == "panels":
        kit.both(frame, block((-x, x), (y - kit.uniform(0.02, 0.07), y + 0.02), (0, top)))
        kit.add(frame, block((-0.02, 0.02), (-y, y), (0.6 * top, top)))
    else:
        kit.add(frame, block((-x, x), (-y, y), (0, top), 0.01))


CHAIRS: dict[str, tuple[str, str, str, str]] = {
    # Bases, backs, arms, seats; "-" = none.
    "dining": ("legs", "slats ladder panel hoop shell soft", "- - posts", "slab pad round"),
    "armchair": ("legs block", "soft", "solid", "cushion"),
    "office": ("casters casters star", "shell soft", "pads loops -", "cushion pad"),
    "modern": ("sled cantilever legs disc star", "shell shell panel", "- loops", "slab pad round"),
    "stool": ("legs disc star block cross", "-", "-", "slab round pad cushion"),
    "bar": ("legs disc sled", "shell ladder hoop", "-", "round pad"),
    "rocking": ("rockers", "slats ladder", "posts", "slab pad"),
    "folding": ("cross", "panel ladder shell", "- posts", "slab pad"),
    "lounge": ("legs sled star block", "shell soft", "- posts solid", "cushion pad"),
    "cube": ("panels block", "panel soft", "solid -", "cushion slab"),
}


def chair(kit: Kit, kind: str) -> None:
    """Chairs of the kinds in `CHAIRS`: a base, a seat, a back and arms that fit together."""
    base, back, arms, style = (kit.choose(*options.split()) for options in CHAIRS[kind])
    wide = kind in ("armchair", "lounge", "cube")
    top, high, lean = kit.uniform(0.4, 0.5), kit.uniform(0.3, 0.65), kit.uniform(0.0, 0.25)
    depth, width = kit.uniform(0.38, 0.52), kit.uniform(0.38, 0.54)
    if kind in ("stool", "bar"):
        top, high, depth = kit.uniform(0.35, 0.8), kit.uniform(0.12, 0.35), kit.uniform(0.3, 0.45)
        width = depth * kit.uniform(0.95, 1.4)
    elif wide:
        top, high, lean = kit.uniform(0.34, 0.44), kit.uniform(0.3, 0.8), kit.uniform(0.1, 0.45)
        depth, width = kit.uniform(0.5, 0.7), kit.uniform(0.5, 0.85)
    wooden = base in ("legs", "rockers", "block", "panels")
    frame = kit.draw(m.wood, m.wood, m.lacquer) if wooden else kit.draw(m.metal, m.metal, m.lacquer)
    soft = frame
    if wide or kind == "office" or kit.chance(0.6):
        soft = kit.draw(m.fabric, m.fabric, m.leather, m.plastic, m.perforated)
    seat = _Seat(depth, width, top, frame, soft)
    thick = kit.uniform(0.015, 0.05) if style == "slab" else kit.uniform(0.03, 0.08)
    if style == "cushion":
        thick = kit.uniform(0.08, 0.2)
    if style == "round":
        flat = superellipse(depth, width, kit.choose(2.0, 2.0, 3.0))
        kit.add(soft, stack([(0.9 * flat, top - thick), (flat, top - 0.7 * thick),
                             (flat, top - 0.2 * thick), (0.94 * flat, top)]))
    elif style == "slab":
        flat = rounded(depth, width, kit.choose(0.005, 0.03, 0.1))
        flat[:, 1] *= 1 + kit.choose(0.0, 0.0, kit.uniform(0.05, 0.25)) * (flat[:, 0] / depth - 0.5)
        kit.add(kit.choose(frame, soft), stack([(flat, top - thick), (flat, top)]))
    else:
        edge = kit.uniform(0.25, 0.5) * thick
        kit.add(soft, pillow(depth, width, thick, edge).at(z=top - thick / 2))
    _base(kit, seat, base, top - thick)
    if back != "-":
        _back(kit, seat._replace(width=width * kit.uniform(0.85, 1.0)), back, high, lean)
    if arms != "-":
        _arms(kit, seat, arms, 0.02 if kind == "armchair" and base == "block" else top - thick)


BENCHES = ("plain", "plain", "garden", "garden", "park", "pew", "picnic", "stone", "box",
           "upholstered")


def bench(kit: Kit, kind: str) -> None:
    """Benches of 1 to 2.3 metres, with and without a back; picnic tables."""
    depth, width, seat = kit.uniform(0.3, 0.5), kit.uniform(0.9, 2.3), kit.uniform(0.38, 0.5)
    frame = kit.draw(m.wood, m.wood, m.lacquer, m.metal) if kind != "stone" else kit.draw(m.stone)
    top = frame if kind == "stone" or kit.chance(0.5) else kit.draw(m.wood, m.lacquer)
    soft = kit.draw(m.fabric, m.leather) if kind == "upholstered" else top
    size = _Seat(depth, width, seat, frame, soft)
    x, y = depth / 2, width / 2
    if kind in ("stone", "box", "upholstered"):
        thick = kit.uniform(0.06, 0.16) if kind != "box" else 0.03
        shape, edge = (pillow, 0.4 * thick) if kind == "upholstered" else (box, 0.01)
        kit.add(soft, shape(depth, width, thick, edge).at(z=seat - thick / 2))
        under = seat - thick + 0.01
        if kind == "stone":
            inner, wide = kit.uniform(0.2, 0.42) * width, kit.uniform(0.06, 0.2)
            kit.both(frame, block((-0.8 * x, 0.8 * x), (inner - wide, inner), (0, under), 0.015))
        else:
            _base(kit, size, "box" if kind == "box" else kit.choose("legs", "sled", "panels"),
                  under)
    else:
        thick, count = kit.uniform(0.02, 0.06), kit.choose(1, 2, 3, 4, 6)
        share = kit.uniform(0.75, 0.95) if count > 1 else 1.0
        for k in range(count):
            kit.add(top, box(depth / count * share, width, thick, 0.004)
                    .at((k + 0.5) / count * depth - x, 0, seat - thick / 2))
        under = seat - thick - 0.02
        for at in np.array([-0.4, 0, 0.4]) * width:
            kit.add(frame, block((-x, x), (at - 0.03, at + 0.03),
                                 (under - 0.02, seat - thick + 0.005)))
    if kind == "picnic":
        high, wide, reach = kit.uniform(0.68, 0.78), kit.uniform(0.3, 0.45), kit.uniform(0.55, 0.75)
        kit.change(0, lambda part: part.at(reach))
        kit.parts += [(part.scaled(-1, 1, 1), material) for part, material in kit.parts]
        for k in range(5):
            kit.add(top, box(0.38 * wide, width, 0.04).at((k - 2) * 0.4 * wide, 0, high))
        side = (0.34 * width, 0.38 * width)
        kit.both(frame, block((-reach - 0.1, reach + 0.1), side, (under - 0.06, under + 0.02)),
                 block((-0.9 * wide, 0.9 * wide), side, (high - 0.1, high)))
        kit.four(frame, rod((0.6 * wide, 0.36 * width, high - 0.03),
                            (0.85 * reach, 0.36 * width, 0), 0.04, 4))
        return
    if kind in ("plain", "pew"):
        style = "panels" if kind == "pew" else kit.choose("legs", "panels", "sled", "cross")
        _base(kit, size, style, under + 0.02)
    elif kind in ("garden", "park"):
        for at in np.linspace(-0.8, 0.8, 2 if width < 1.6 else 3) * y:
            arch = [(x, at, 0), (0.7 * x, at, 0.5 * seat), (0, at, 0.8 * seat),
                    (-0.8 * x, at, 0.5 * seat), (-1.1 * x, at, 0)]
            if kind == "park":
                kit.add(frame, tube(smooth_path(arch, 4), 0.022),
                        rod((0, at, 0.75 * seat), (0, at, under), 0.02))
            else:
                kit.add(frame, *(block((s * 0.85 * x - 0.03, s * 0.85 * x + 0.03),
                                       (at - 0.03, at + 0.03), (0, under))
                                 for s in (-1, 1)))
    if kind in ("garden", "park", "pew") or (kind != "box" and kit.chance(0.35)):
        style = kit.choose("slats", "ladder", "ladder", "panel")
        _back(kit, size, style, kit.uniform(0.3, 0.55), kit.uniform(0.0, 0.35))
    if kind != "stone" and kit.chance(0.45):
        _arms(kit, size, "solid" if kind == "upholstered" else "posts", under)


COUCHES = ("sofa", "sofa", "loveseat", "corner", "chaise", "chesterfield", "daybed", "armless")


def couch(kit: Kit, kind: str) -> None:
    """Couches of 1 to 4 seats: straight, with a corner or a chaise longue."""
    seats = {"loveseat": 2, "daybed": 1}.get(kind, kit.choose(2, 3, 3, 4))
    width = seats * kit.uniform(0.5, 0.75) * (2.6 if seats == 1 else 1)
    depth = kit.uniform(0.75, 1.05)
    seat, high = kit.uniform(0.34, 0.48), kit.uniform(0.25, 0.55)
    legs = kit.choose(0.03, kit.uniform(0.04, 0.2))
    soft, frame = kit.draw(m.fabric, m.fabric, m.leather), kit.draw(m.wood, m.metal, m.lacquer)
    other = soft if kit.chance(0.6) else kit.draw(m.fabric)
    thick, back, arm = kit.uniform(0.1, 0.2), kit.uniform(0.14, 0.28), kit.uniform(0.08, 0.3)
    x, y, low, edge = depth / 2, width / 2, seat - thick, min(kit.uniform(0.02, 0.07), 0.4 * thick)
    padded = functools.partial(block, shape=pillow)
    kit.add(soft, block((-x, x - 0.02), (-y, y), (legs, low + 0.01), 0.02))
    kit.four(frame, cylinder(0.03, legs + 0.02, 10).at(x - 0.1, y - 0.06, legs / 2 + 0.01))
    crown = seat + high * (1 if kind in ("chesterfield", "daybed") else kit.uniform(0.5, 0.95))
    if kind != "daybed" or kit.chance(0.5):
        kit.add(soft, padded((-x - 0.05, 0.6 * back - x), (-y, y), (legs, crown), 0.3 * back))
    count, lean = kit.choose(1, seats, seats), kit.uniform(0.05, 0.3)
    for k in range(count):
        left, right = k * width / count - y + 0.002, (k + 1) * width / count - y - 0.002
        kit.add(other, padded((0.6 * back - x - 0.03, x), (left, right), (low, seat), edge))
        if kind not in ("daybed", "chesterfield"):
            cushion = padded((-0.4 * back, 0.4 * back), (left, right), (-0.02, high), 0.35 * back)
            kit.add(other, cushion.turned("y", -30 * lean).at(0.7 * back - x, 0, seat))
    sides = {"armless": (), "chaise": kit.choose((-1,), (1,)),
             "corner": kit.choose((-1,), (1,))}.get(kind, (-1, 1))
    arm_top, style = seat + kit.uniform(0.08, 0.3), kit.choose("square", "round", "slope")
    if kind == "chesterfield":
        arm_top = crown
        kit.add(soft, cylinder(0.5 * back, width + arm, 16).turned("x", 90)
                .at(0.1 * back - x, 0, crown - 0.2 * back))
    drop = kit.uniform(0.1, 0.5) * (arm_top - seat) / depth if style == "slope" else 0
    for side in sides:
        part = pillow(depth, arm, arm_top - legs, 0.02 if style == "square" else 0.45 * arm)
        part = part.bent(lambda v: v - np.outer((v[:, 2] > 0) * (v[:, 0] + x), [0, 0, drop]))
        kit.add(soft, part.at(0, side * (y + arm / 2 - 0.01), (arm_top + legs) / 2))
        if kind == "chesterfield":
            kit.add(soft, cylinder(0.6 * arm, depth, 16).turned("y", 90)
                    .at(0, side * (y + 0.55 * arm), arm_top - 0.4 * arm))
    if kind in ("corner", "chaise"):
        side, reach, wide = -sides[0], x + kit.uniform(0.5, 1.3), kit.uniform(0.65, 0.95)
        inner = y if kind == "corner" else y - wide
        near = -x if kind == "corner" else x - 0.05
        span = sorted((side * inner, side * (inner + wide)))
        kit.add(soft, block((near, reach), tuple(span), (legs, low + 0.012), 0.02))
        kit.add(other, padded((near + 0.01, reach), tuple(span), (low, seat), edge))
        for at in (0.9 * span[0] + 0.1 * span[1], 0.1 * span[0] + 0.9 * span[1]):
            kit.add(frame, cylinder(0.03, legs + 0.02, 10).at(reach - 0.1, at, legs / 2 + 0.01))
        if kind == "corner":
            outer = sorted((side * (inner + wide - 0.7 * back), side * (inner + wide)))
            kit.add(soft, padded((-x, reach), tuple(outer), (legs, seat + 0.9 * high), 0.3 * back),
                    padded((-x - 0.05, 0.6 * back - x), tuple(span), (legs, seat + 0.9 * high),
                           0.3 * back))
