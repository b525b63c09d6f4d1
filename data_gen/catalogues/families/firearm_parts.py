"""Parts of firearms. Lengths in metres, the muzzle toward +x, the bore at z = 0."""

from collections.abc import Sequence

import numpy as np

from data_gen.catalogues.bodies import body
from data_gen.catalogues.families.kit import BLACK, DARK_GLASS, GOLD, RUBBER, Kit
from data_gen.catalogues.solids import (
    Solid,
    ball,
    box,
    cylinder,
    lathe,
    loft,
    prism,
    rod,
    smooth_path,
    tube,
)
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

STEELS = (
    Material((0.16, 0.16, 0.17), (0.4,) * 3, 40.0, name="gunmetal"),
    Material((0.3, 0.31, 0.33), (0.5,) * 3, 50.0, name="steel"),
    Material((0.55, 0.56, 0.58), (0.6,) * 3, 60.0, name="stainless"),
    Material((0.2, 0.21, 0.26), (0.5,) * 3, 50.0, name="blued steel"),
)

POLYMERS = (
    BLACK,
    Material((0.35, 0.36, 0.26), name="olive"),
    Material((0.6, 0.52, 0.38), name="sand"),
    Material((0.3, 0.3, 0.31), name="grey"),
)


def bar(start: float, end: float, radius: float, z: float = 0.0, y: float = 0.0,
        sides: int = 14) -> Solid:
    """A round bar along x."""
    return rod((start, y, z), (end, y, z), radius, sides)


def add_receiver(kit: Kit, steel: Material, rows: Sequence[tuple[float, float, float, float]],
                 bevel: float = 0.004) -> None:
    """The receiver. Hidden: the depth of a cut-out on its far side.

    Args:
      kit: the model.
      steel: material.
      rows: x, lowest z, highest z and half width, from the back to the front.
      bevel: bevel of the edges.
    """
    side = kit.choose("far_side", -1, 1)
    depth = kit.hide("far_cut_depth", 0.1, 1.6)
    low_share = kit.hide("far_cut_low", 0.2, 0.5)
    start, end = rows[0][0], rows[-1][0]
    cut = (start + 0.2 * (end - start), start + 0.8 * (end - start))
    places = sorted({*(r[0] for r in rows), *cut, cut[0] + 1e-4, cut[1] - 1e-4})
    table = np.asarray(rows)
    rings = []
    for x in places:
        low, high, w = (float(np.interp(x, table[:, 0], table[:, k])) for k in (1, 2, 3))
        b = min(bevel, 0.3 * w, 0.3 * (high - low))
        d = depth * w if cut[0] < x < cut[1] else 0.0
        up, down = low + 0.8 * (high - low), low + low_share * (high - low)
        rings.append([(x, side * y, z) for y, z in (
            (-w, low + b), (-w, high - b), (b - w, high), (w - b, high), (w, high - b), (w, up),
                (w - d, up),
            (w - d, down), (w, down), (w, low + b), (w - b, low), (b - w, low))])
    kit.add(steel, loft(np.array(rings)))
    kit.azimuth = ((-130.0, -50.0),) if side > 0 else ((50.0, 130.0),)


def add_grip(kit: Kit, material: Material, x: float, z: float, long: float, deep: float,
             wide: float, slant: float, flare: float = 1.0) -> None:
    """A pistol grip below (x, z), tilted backward by `slant` degrees."""
    stations = [(-0.012, wide * 0.9, deep * 0.9, 0), (0.25 * long, wide, deep * 0.85, 0.1 * deep),
                (0.65 * long, wide * 1.05, deep * 0.95, 0), (long, wide, deep * flare, 0)]
    kit.add(material, body(stations, 2.8, 2, 16).turned("y", 90 + slant).at(x, 0, z))


def add_guard(kit: Kit, steel: Material, x: float, z: float, long: float, drop: float,
              ) -> None:
    """Trigger and trigger guard behind x."""
    bow = [(x, 0, z), (x + 0.002, 0, z - drop * 0.8), (x - 0.3 * long, 0, z - drop),
           (x - 0.8 * long, 0, z - drop * 0.95), (x - long, 0, z)]
    kit.add(steel, tube(smooth_path(bow, 4), 0.003, 6))
    kit.add(steel, tube([(x - 0.55 * long, 0, z), (x - 0.45 * long, 0, z - 0.45 * drop),
                         (x - 0.4 * long, 0, z - 0.75 * drop)], 0.8 * 0.003, 5))


def add_stock(kit: Kit, material: Material, steel: Material, kind: str, x: float, z: float,
              long: float, drop: float, wide: float) -> None:
    """A stock from (x, z) backward.

    Args:
      kit: the model.
      material: material of the stock.
      steel: material of bars and tubes.
      kind: `classic`, `straight`, `thumbhole`, `skeleton`, `wire`, `tube`, `folded`.
      x: x of its front end.
      z: z of the bore.
      long: length.
      drop: distance of the heel below z.
      wide: half width.
    """
    end, tall = x - long, 0.062
    if kind in ("classic", "straight"):
        wrist = 0.018 if kind == "classic" else 0.024
        bend = -0.022 if kind == "classic" else -0.008
        rows = [(x + 0.02, wide, 0.024, z - 0.012),
                (x - 0.1 * long, wide * 0.85, wrist, z + bend - 0.2 * drop),
                (x - 0.26 * long, wide * 0.85, wrist * 1.1, z + bend - 0.4 * drop),
                (x - 0.55 * long, wide, tall * 0.68, z - 0.6 * drop - 0.02),
                (end, wide * 1.05, tall, z - drop - 0.02)]
        kit.add(material, body(rows, 2.6, 3, 18))
        kit.add(RUBBER, body([(end, wide * 1.04, tall * 0.99, z - drop - 0.02),
                              (end - 0.018, wide, tall * 0.95, z - drop - 0.02)], 2.6, 1, 18))
        if kind == "classic" and kit.chance("cheek_piece", 0.3):
            kit.add(material, body([(x - 0.4 * long, wide * 0.6, 0.012, z + 0.0 - 0.3 * drop),
                                    (x - 0.5 * long, wide * 0.8, 0.02, z + 0.01 - 0.4 * drop),
                                    (end + 0.06, wide * 0.8, 0.02, z - 0.6 * drop + 0.02)], 2.6, 2,
                                   14))
    elif kind == "thumbhole":
        profile = [(x, z + 0.01), (x, z - 0.03), (x - 0.06, z - 0.045), (x - 0.085, z - 0.14),
                   (x - 0.125, z - 0.14), (x - 0.115, z - 0.05), (x - 0.17, z - 0.05),
                   (end, z - drop - 0.09), (end - 0.004, z + 0.02), (x - 0.2, z + 0.022),
                   (x - 0.17, z - 0.012), (x - 0.1, z - 0.012)]
        kit.add(material, prism(profile, 2 * wide, 0.008))
        kit.add(RUBBER, box(0.016, 1.9 * wide, 0.11 + drop).at(end - 0.008, 0,
                                                               z - drop / 2 - 0.035))
    elif kind == "skeleton":
        kit.add(steel, tube([(x, 0, z + 0.012), (end, 0, z + 0.005), (end, 0, z - drop - 0.08),
                             (x, 0, z - 0.025)], 0.009, 8))
        kit.add(RUBBER, box(0.02, 1.7 * wide, drop + 0.11, 0.006).at(end - 0.005, 0,
                                                                     z - drop / 2 - 0.04))
    elif kind == "wire":
        for s in (-1, 1):
            kit.add(steel, tube([(x, s * wide * 0.8, z), (end, s * wide * 0.8, z - 0.3 * drop)],
                                0.0055, 6))
        kit.add(steel, tube([(end, -wide * 0.8, z - 0.3 * drop), (end - 0.012, 0, z + 0.02),
                             (end, wide * 0.8, z - 0.3 * drop), (end - 0.01, 0, z - drop - 0.07),
                             (end, -wide * 0.8, z - 0.3 * drop)], 0.006, 6))
    elif kind == "tube":
        kit.add(steel, bar(end + 0.02, x, 0.015, z))
        profile = [(end + 0.15, z + 0.022), (end + 0.12, z - 0.022),
                   (end + 0.03, z - drop - 0.075), (end, z - drop - 0.075),
                   (end - 0.006, z + 0.026)]
        kit.add(material, prism(profile, 1.8 * wide, 0.006))
    else:
        kit.add(steel, rod((x, wide * 1.3, z - 0.01), (x + 0.9 * long, wide * 1.5, z - 0.02),
                           0.008, 8), box(0.02, 0.012, 0.1, 0.003).at(x + 0.9 * long, wide * 1.5,
                                                                      z - 0.03))
        kit.add(steel, box(0.03, 1.6 * wide, 0.05, 0.005).at(x + 0.01, wide * 0.6, z - 0.005))


def add_magazine(kit: Kit, material: Material, kind: str, x: float, z: float, deep: float,
                 long: float, wide: float) -> None:
    """A magazine at (x, z): `straight`, `curved`, `drum`, `box`, `pan`, `top`, `side`."""
    if kind in ("straight", "curved", "top"):
        bend = {"straight": 0.0, "curved": kit.uniform("magazine_bend", 0.15, 0.6),
                "top": 0.4}[kind]
        slant = kit.uniform("magazine_slant", 0.0, 0.15)
        t = np.linspace(0, 1, 6)
        mid = x + long * (slant * t + bend * t**2)
        outline = np.concatenate([np.stack([mid + deep / 2, z - long * t], 1),
                                  np.stack([mid - deep / 2, z - long * t * (1 + 0.0)], 1)[::-1]])
        part = prism(outline.tolist(), 1.5 * wide, 0.003)
        kit.add(material, part.at(0, 0, -z).scaled(1, 1, -1).at(0, 0, z) if kind == "top" else part)
    elif kind == "drum":
        r = kit.uniform("drum", 0.055, 0.085)
        kit.add(material, box(deep, 1.5 * wide, 0.06).at(x, 0, z - 0.02),
                cylinder(r, kit.uniform("drum_width", 0.05, 0.09), 24, 0.008).turned("x", 90).at(x,
                    0, z - 0.03 - r))
    elif kind == "box":
        kit.add(material, box(deep * 1.6, 4.5 * wide, long, 0.006).at(x, 0, z - long / 2))
        kit.add(GOLD, *(bar(x - 0.014, x + 0.03, 0.005, z + 0.012 + 0.004 * k,
                            wide * 1.2 + 0.011 * k, 6) for k in range(4)))
    elif kind == "pan":
        kit.add(material, cylinder(kit.uniform("pan", 0.085, 0.13), 0.05, 28, 0.012).at(x, 0,
                                                                                        z + 0.03))
    else:
        kit.add(material, box(deep, long, 1.4 * wide, 0.004).at(x, long / 2 + wide * 0.6,
                                                                z + 0.035))


def add_barrel(kit: Kit, steel: Material, start: float, end: float, radius: float,
               tip: str) -> None:
    """A barrel with a tip: `plain`, `hider`, `brake`, `silencer`, `jacket`, `bell`."""
    kit.add(steel, tube([(start, 0, 0), (start + 0.3 * (end - start), 0, 0), (end, 0, 0)],
                        [radius * 1.35, radius * 1.1, radius], 14))
    if tip == "hider":
        kit.add(BLACK, bar(end - 0.01, end + 0.045, radius * 1.45))
    elif tip == "brake":
        kit.add(BLACK, box(0.075, 4.4 * radius, 2.8 * radius, 0.004).at(end + 0.03),
                box(0.012, 5.4 * radius, 3.0 * radius).at(end + 0.02),
                box(0.012, 5.4 * radius, 3.0 * radius).at(end + 0.05))
    elif tip == "silencer":
        kit.add(BLACK, cylinder(kit.uniform("silencer", 0.016, 0.024),
                                kit.uniform("silencer_length", 0.13, 0.25), 18, 0.004).turned("y",
                                    90).at(end + 0.05))
    elif tip == "jacket":
        kit.add(steel, lathe([(radius * 1.5, 0), (radius * 2.3, 0),
                              (radius * 2.3, 0.75 * (end - start)),
                              (radius * 1.5, 0.75 * (end - start))], 16, loop=True).turned("y",
                                  90).at(start))
        for k in range(7):
            kit.both(BLACK, box(0.016, 0.002, 1.8 * radius).at(start
                + (0.06 + 0.1 * k) * (end - start), 2.22 * radius, 0))
    elif tip == "bell":
        kit.add(steel, lathe([(radius, -0.12), (radius * 1.5, -0.02), (radius * 2.6, 0.04),
                              (radius * 2.2, 0.04), (radius * 0.8, -0.06)], 18).turned("y",
                                                                                       90).at(end))


def add_scope(kit: Kit, x: float, z: float, long: float, radius: float) -> None:
    """A telescopic sight on two mounts above z, or a box with a lens if it is short."""
    up = z + radius * 1.6 + 0.014
    if long < 0.1:
        kit.add(BLACK, box(long, radius * 2.2, radius * 2.4, 0.004).at(x, 0, up),
                box(0.6 * long, radius * 1.6, up - z).at(x, 0, (up + z) / 2))
        kit.add(DARK_GLASS, box(0.004, radius * 1.7, radius * 1.8).at(x + long / 2, 0, up))
        return
    profile = [(0.85 * radius, -0.5), (0.9 * radius, -0.3), (0.6 * radius, -0.22),
               (0.6 * radius, 0.2), (radius, 0.32), (radius, 0.5)]
    kit.add(BLACK, lathe([(r, t * long) for r, t in profile], 18).turned("y", 90).at(x, 0, up))
    kit.add(DARK_GLASS, bar(x + 0.5 * long - 0.01, x + 0.5 * long + 0.001, 0.85 * radius, up))
    kit.add(BLACK, cylinder(0.45 * radius, radius * 0.9, 12).at(x, 0, up + 0.9 * radius),
            cylinder(0.4 * radius, radius * 1.8, 12).turned("x", 90).at(x, 0, up))
    for t in (-0.14, 0.14):
        kit.add(BLACK, box(0.02, 1.2 * radius, up - z + 0.3 * radius).at(x + t * long, 0,
                                                                         (up + z) / 2))


def add_sights(kit: Kit, steel: Material, rear: float, front: float, z_rear: float, z_front: float,
               tall: float) -> None:
    """Iron sights: a notch at x = `rear` and a post at `front`."""
    kit.add(steel, box(0.014, 0.02, tall * 0.8, 0.002).at(rear, 0, z_rear + 0.3 * tall),
            box(0.008, 0.006, tall * 1.3).at(front, 0, z_front + 0.45 * tall))


def add_bipod(kit: Kit, steel: Material, x: float, z: float, long: float, folded: bool) -> None:
    """Two legs, down or folded forward."""
    kit.add(steel, box(0.03, 0.04, 0.02, 0.004).at(x, 0, z))
    foot = (x + 0.92 * long, 0.028, z - 0.02) if folded else (x + 0.12 * long, 0.45 * long,
                                                              z - 0.85 * long)
    kit.both(steel, tube([(x, 0.015, z), foot], [0.008, 0.006], 8),
             ball(0.026, 0.022, 0.02, 8).at(*foot))


def add_handguard(kit: Kit, material: Material, start: float, end: float, half: float, tall: float,
                  z: float, power: float, holes: int) -> None:
    """A handguard, with `holes` slots on each side."""
    kit.add(material, body([(start, half, tall, z),
                            (start + 0.5 * (end - start), half * 1.04, tall * 1.04, z),
                            (end, half * 0.86, tall * 0.86, z)], power, 2, 20))
    for k in range(holes):
        x = start + (k + 0.7) / (holes + 0.4) * (end - start)
        kit.both(BLACK, box(0.55 * (end - start) / (holes + 1), 0.004, 0.35 * tall, 0.001).at(x,
            half * 0.985, z + 0.2 * tall))
