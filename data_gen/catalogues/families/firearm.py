"""Firearms. Lengths in metres, the muzzle toward +x, the bore on z = 0."""

from collections.abc import Callable, Sequence

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import BLACK, CHROME, DARK_GLASS, GOLD, RUBBER, Kit, around, pick, wood
from data_gen.catalogues.solids import Solid, ball, body, box, cylinder, lathe, loft, prism, rod, smooth_path, tube
from data_gen.meshes import Material

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

# --- Pieces -----------------------------------------------------------------------------------


def _round(start: float, end: float, radius: float, z: float = 0.0, y: float = 0.0, sides: int = 14) -> Solid:
    """A round bar along x."""
    return rod((start, y, z), (end, y, z), radius, sides)


def _receiver(kit: Kit, steel: Material, rows: Sequence[tuple[float, float, float, float]], bevel: float = 0.004) -> None:
    """The body of the action. Hidden: how deep it is cut out on its far side.

    Args:
      kit: what it is added to.
      steel: its material.
      rows: x, lowest z, highest z, half width, from the back to the front.
      bevel: of its edges.
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
            (-w, low + b), (-w, high - b), (b - w, high), (w - b, high), (w, high - b), (w, up), (w - d, up),
            (w - d, down), (w, down), (w, low + b), (w - b, low), (b - w, low))])  # fmt: skip
    kit.add(steel, loft(np.array(rings)))
    kit.azimuth = ((-130.0, -50.0),) if side > 0 else ((50.0, 130.0),)


def _grip(kit: Kit, material: Material, x: float, z: float, long: float, deep: float, wide: float, slant: float, flare: float = 1.0) -> None:
    """A pistol grip down from (x, z), leaning backward by `slant` degrees."""
    stations = [(-0.012, wide * 0.9, deep * 0.9, 0), (0.25 * long, wide, deep * 0.85, 0.1 * deep), (0.65 * long, wide * 1.05, deep * 0.95, 0), (long, wide, deep * flare, 0)]
    kit.add(material, body(stations, 2.8, 2, 16).turned("y", 90 + slant).at(x, 0, z))


def _guard(kit: Kit, steel: Material, x: float, z: float, long: float, drop: float, radius: float = 0.003) -> None:
    """Trigger and the bow around it, behind x."""
    bow = [(x, 0, z), (x + 0.002, 0, z - drop * 0.8), (x - 0.3 * long, 0, z - drop), (x - 0.8 * long, 0, z - drop * 0.95), (x - long, 0, z)]
    kit.add(steel, tube(smooth_path(bow, 4), radius, 6))
    kit.add(steel, tube([(x - 0.55 * long, 0, z), (x - 0.45 * long, 0, z - 0.45 * drop), (x - 0.4 * long, 0, z - 0.75 * drop)], 0.8 * radius, 5))


def _stock(kit: Kit, material: Material, steel: Material, kind: str, x: float, z: float, long: float, drop: float, wide: float) -> None:
    """A butt from (x, z) backward.

    Args:
      kit: what it is added to.
      material: of the butt.
      steel: of bars and tubes.
      kind: `classic`, `straight`, `thumbhole`, `skeleton`, `wire`, `tube`, `folded`.
      x: where it begins.
      z: the height of the bore's line there.
      long: its length.
      drop: how far its heel lies below z.
      wide: half width.
    """
    end, tall = x - long, 0.062
    if kind in ("classic", "straight"):
        wrist = 0.018 if kind == "classic" else 0.024
        bend = -0.022 if kind == "classic" else -0.008
        rows = [(x + 0.02, wide, 0.024, z - 0.012), (x - 0.1 * long, wide * 0.85, wrist, z + bend - 0.2 * drop), (x - 0.26 * long, wide * 0.85, wrist * 1.1, z + bend - 0.4 * drop),
                (x - 0.55 * long, wide, tall * 0.68, z - 0.6 * drop - 0.02), (end, wide * 1.05, tall, z - drop - 0.02)]  # fmt: skip
        kit.add(material, body(rows, 2.6, 3, 18))
        kit.add(RUBBER, body([(end, wide * 1.04, tall * 0.99, z - drop - 0.02), (end - 0.018, wide, tall * 0.95, z - drop - 0.02)], 2.6, 1, 18))
        if kind == "classic" and kit.chance("cheek_piece", 0.3):
            kit.add(material, body([(x - 0.4 * long, wide * 0.6, 0.012, z + 0.0 - 0.3 * drop), (x - 0.5 * long, wide * 0.8, 0.02, z + 0.01 - 0.4 * drop), (end + 0.06, wide * 0.8, 0.02, z - 0.6 * drop + 0.02)], 2.6, 2, 14))
    elif kind == "thumbhole":
        profile = [(x, z + 0.01), (x, z - 0.03), (x - 0.06, z - 0.045), (x - 0.085, z - 0.14), (x - 0.125, z - 0.14), (x - 0.115, z - 0.05), (x - 0.17, z - 0.05), (end, z - drop - 0.09), (end - 0.004, z + 0.02), (x - 0.2, z + 0.022), (x - 0.17, z - 0.012), (x - 0.1, z - 0.012)]
        kit.add(material, prism(profile, 2 * wide, 0.008))
        kit.add(RUBBER, box(0.016, 1.9 * wide, 0.11 + drop).at(end - 0.008, 0, z - drop / 2 - 0.035))
    elif kind == "skeleton":
        kit.add(steel, tube([(x, 0, z + 0.012), (end, 0, z + 0.005), (end, 0, z - drop - 0.08), (x, 0, z - 0.025)], 0.009, 8))
        kit.add(RUBBER, box(0.02, 1.7 * wide, drop + 0.11, 0.006).at(end - 0.005, 0, z - drop / 2 - 0.04))
    elif kind == "wire":
        for s in (-1, 1):
            kit.add(steel, tube([(x, s * wide * 0.8, z), (end, s * wide * 0.8, z - 0.3 * drop)], 0.0055, 6))
        kit.add(steel, tube([(end, -wide * 0.8, z - 0.3 * drop), (end - 0.012, 0, z + 0.02), (end, wide * 0.8, z - 0.3 * drop), (end - 0.01, 0, z - drop - 0.07), (end, -wide * 0.8, z - 0.3 * drop)], 0.006, 6))
    elif kind == "tube":
        kit.add(steel, _round(end + 0.02, x, 0.015, z))
        profile = [(end + 0.15, z + 0.022), (end + 0.12, z - 0.022), (end + 0.03, z - drop - 0.075), (end, z - drop - 0.075), (end - 0.006, z + 0.026)]
        kit.add(material, prism(profile, 1.8 * wide, 0.006))
    else:
        kit.add(steel, rod((x, wide * 1.3, z - 0.01), (x + 0.9 * long, wide * 1.5, z - 0.02), 0.008, 8), box(0.02, 0.012, 0.1, 0.003).at(x + 0.9 * long, wide * 1.5, z - 0.03))
        kit.add(steel, box(0.03, 1.6 * wide, 0.05, 0.005).at(x + 0.01, wide * 0.6, z - 0.005))


def _magazine(kit: Kit, material: Material, kind: str, x: float, z: float, deep: float, long: float, wide: float) -> None:
    """A magazine at (x, z): `straight`, `curved`, `drum`, `box`, `pan`, `top`, `side`."""
    if kind in ("straight", "curved", "top"):
        bend = {"straight": 0.0, "curved": kit.uniform("magazine_bend", 0.15, 0.6), "top": 0.4}[kind]
        slant = kit.uniform("magazine_slant", 0.0, 0.15)
        t = np.linspace(0, 1, 6)
        mid = x + long * (slant * t + bend * t**2)
        outline = np.concatenate([np.stack([mid + deep / 2, z - long * t], 1), np.stack([mid - deep / 2, z - long * t * (1 + 0.0)], 1)[::-1]])
        part = prism(outline, 1.5 * wide, 0.003)
        kit.add(material, part.at(0, 0, -z).scaled(1, 1, -1).at(0, 0, z) if kind == "top" else part)
    elif kind == "drum":
        r = kit.uniform("drum", 0.055, 0.085)
        kit.add(material, box(deep, 1.5 * wide, 0.06).at(x, 0, z - 0.02), cylinder(r, kit.uniform("drum_width", 0.05, 0.09), 24, 0.008).turned("x", 90).at(x, 0, z - 0.03 - r))
    elif kind == "box":
        kit.add(material, box(deep * 1.6, 4.5 * wide, long, 0.006).at(x, 0, z - long / 2))
        kit.add(GOLD, *(_round(x - 0.014, x + 0.03, 0.005, z + 0.012 + 0.004 * k, wide * 1.2 + 0.011 * k, 6) for k in range(4)))
    elif kind == "pan":
        kit.add(material, cylinder(kit.uniform("pan", 0.085, 0.13), 0.05, 28, 0.012).at(x, 0, z + 0.03))
    else:
        kit.add(material, box(deep, long, 1.4 * wide, 0.004).at(x, long / 2 + wide * 0.6, z + 0.035))


def _barrel(kit: Kit, steel: Material, start: float, end: float, radius: float, tip: str) -> None:
    """A barrel with a tip: `plain`, `hider`, `brake`, `silencer`, `jacket`, `bell`."""
    kit.add(steel, tube([(start, 0, 0), (start + 0.3 * (end - start), 0, 0), (end, 0, 0)], [radius * 1.35, radius * 1.1, radius], 14))
    if tip == "hider":
        kit.add(BLACK, _round(end - 0.01, end + 0.045, radius * 1.45))
    elif tip == "brake":
        kit.add(BLACK, box(0.075, 4.4 * radius, 2.8 * radius, 0.004).at(end + 0.03), box(0.012, 5.4 * radius, 3.0 * radius).at(end + 0.02), box(0.012, 5.4 * radius, 3.0 * radius).at(end + 0.05))
    elif tip == "silencer":
        kit.add(BLACK, cylinder(kit.uniform("silencer", 0.016, 0.024), kit.uniform("silencer_length", 0.13, 0.25), 18, 0.004).turned("y", 90).at(end + 0.05))
    elif tip == "jacket":
        kit.add(steel, lathe([(radius * 1.5, 0), (radius * 2.3, 0), (radius * 2.3, 0.75 * (end - start)), (radius * 1.5, 0.75 * (end - start))], 16, loop=True).turned("y", 90).at(start))
        for k in range(7):
            kit.both(BLACK, box(0.016, 0.002, 1.8 * radius).at(start + (0.06 + 0.1 * k) * (end - start), 2.22 * radius, 0))
    elif tip == "bell":
        kit.add(steel, lathe([(radius, -0.12), (radius * 1.5, -0.02), (radius * 2.6, 0.04), (radius * 2.2, 0.04), (radius * 0.8, -0.06)], 18).turned("y", 90).at(end))


def _scope(kit: Kit, x: float, z: float, long: float, radius: float) -> None:
    """A telescope on two mounts above z, or a box with a lens where it is short."""
    up = z + radius * 1.6 + 0.014
    if long < 0.1:
        kit.add(BLACK, box(long, radius * 2.2, radius * 2.4, 0.004).at(x, 0, up), box(0.6 * long, radius * 1.6, up - z).at(x, 0, (up + z) / 2))
        kit.add(DARK_GLASS, box(0.004, radius * 1.7, radius * 1.8).at(x + long / 2, 0, up))
        return
    profile = [(0.85 * radius, -0.5), (0.9 * radius, -0.3), (0.6 * radius, -0.22), (0.6 * radius, 0.2), (radius, 0.32), (radius, 0.5)]
    kit.add(BLACK, lathe([(r, t * long) for r, t in profile], 18).turned("y", 90).at(x, 0, up))
    kit.add(DARK_GLASS, _round(x + 0.5 * long - 0.01, x + 0.5 * long + 0.001, 0.85 * radius, up))
    kit.add(BLACK, cylinder(0.45 * radius, radius * 0.9, 12).at(x, 0, up + 0.9 * radius), cylinder(0.4 * radius, radius * 1.8, 12).turned("x", 90).at(x, 0, up))
    for t in (-0.14, 0.14):
        kit.add(BLACK, box(0.02, 1.2 * radius, up - z + 0.3 * radius).at(x + t * long, 0, (up + z) / 2))


def _sights(kit: Kit, steel: Material, rear: float, front: float, z_rear: float, z_front: float, tall: float) -> None:
    kit.add(steel, box(0.014, 0.02, tall * 0.8, 0.002).at(rear, 0, z_rear + 0.3 * tall), box(0.008, 0.006, tall * 1.3).at(front, 0, z_front + 0.45 * tall))


def _bipod(kit: Kit, steel: Material, x: float, z: float, long: float, folded: bool) -> None:
    kit.add(steel, box(0.03, 0.04, 0.02, 0.004).at(x, 0, z))
    foot = (x + 0.92 * long, 0.028, z - 0.02) if folded else (x + 0.12 * long, 0.45 * long, z - 0.85 * long)
    kit.both(steel, tube([(x, 0.015, z), foot], [0.008, 0.006], 8), ball(0.026, 0.022, 0.02, 8).at(*foot))


def _handguard(kit: Kit, material: Material, start: float, end: float, half: float, tall: float, z: float, power: float, holes: int) -> None:
    kit.add(material, body([(start, half, tall, z), (start + 0.5 * (end - start), half * 1.04, tall * 1.04, z), (end, half * 0.86, tall * 0.86, z)], power, 2, 20))
    for k in range(holes):
        x = start + (k + 0.7) / (holes + 0.4) * (end - start)
        kit.both(BLACK, box(0.55 * (end - start) / (holes + 1), 0.004, 0.35 * tall, 0.001).at(x, half * 0.985, z + 0.2 * tall))


# --- Hand guns --------------------------------------------------------------------------------


def _pistol(kit: Kit, steel: Material, grip: Material) -> None:
    form = kit.choose("form", "modern", "modern", "classic", "tapered", "machine", "target")
    w, long = kit.uniform("width", 0.011, 0.016), kit.uniform("length", 0.13, 0.22)
    rear, front, tall = -0.08, -0.08 + long, kit.uniform("slide", 0.011, 0.018)
    if form == "tapered":
        _receiver(kit, steel, [(rear, -0.03, 0.004, w), (0.0, -0.03, 0.016, w), (0.035, -0.028, 0.014, w)], 0.003)
        kit.add(steel, tube([(0.03, 0, 0), (front, 0, 0)], [0.011, 0.007], 12), cylinder(0.014, 2.6 * w, 14).turned("x", 90).at(rear + 0.02, 0, 0.01))
    else:
        _receiver(kit, steel, [(rear, -0.038, -tall, w * 0.9), (0.02, -0.036, -tall, w * 0.9), (front - 0.015, -0.026, -tall, w * 0.9)], 0.003)
        top = 0.006 if form == "machine" else 0.0
        kit.add(steel, prism([(rear - 0.006, -tall), (front, -tall), (front + 0.004, tall * 0.6 + top), (front - 0.006, tall + top), (rear, tall + top)], 2 * w, 0.004))
        for k in range(6):
            kit.both(BLACK, box(0.0022, 0.001, 1.4 * tall).at(rear + 0.012 + 0.0055 * k, w, 0))
    kit.add(BLACK, _round(front - 0.01, front + kit.uniform("muzzle", 0.002, 0.02), 0.0065))
    deep, reach, slant = kit.uniform("grip_depth", 0.02, 0.026), kit.uniform("grip_length", 0.075, 0.115), kit.uniform("slant", 8, 32 if form in ("tapered", "target") else 20)
    _grip(kit, grip, rear + 0.034, -0.034, reach, deep, w * 1.05, slant, kit.uniform("flare", 0.95, 1.15))
    _guard(kit, steel, 0.028, -0.034, 0.058, 0.032)
    _sights(kit, steel, rear + 0.006, front - 0.01, 0.016 if form != "tapered" else 0.01, 0.016 if form != "tapered" else 0.006, 0.008)
    kit.add(steel, prism([(rear + 0.006, 0.004), (rear - 0.012, 0.016), (rear - 0.016, 0.01), (rear, -0.012)], 0.007))
    extra = kit.choose("extra", "none", "none", "silencer", "light", "long_magazine", "sight")
    if form == "machine":
        _magazine(kit, BLACK, "straight", 0.052, -0.03, 0.028, kit.uniform("magazine", 0.08, 0.16), w)
        if kit.chance("butt", 0.5):
            _stock(kit, grip, steel, kit.choose("stock", "wire", "skeleton"), rear, -0.005, 0.2, 0.03, 0.014)
    elif extra == "silencer":
        kit.add(BLACK, cylinder(kit.uniform("silencer", 0.013, 0.018), kit.uniform("silencer_length", 0.1, 0.19), 16, 0.003).turned("y", 90).at(front + 0.07))
    elif extra == "light":
        kit.add(BLACK, box(0.06, 0.024, 0.024, 0.004).at(front - 0.04, 0, -0.04), _round(front - 0.02, front + 0.008, 0.011, -0.04))
    elif extra == "long_magazine":
        kit.add(BLACK, box(0.1, 1.5 * w, 0.03).turned("y", 90 + slant).at(rear + 0.03 - 0.1 * np.sin(np.radians(slant)), 0, -0.05 - reach))
    elif extra == "sight":
        _scope(kit, rear + 0.06, 0.016, 0.05 if kit.rng.random() < 0.5 else 0.13, 0.013)
    if form == "target":
        kit.add(steel, box(long * 0.55, 1.7 * w, 0.022, 0.003).at(front - long * 0.25, 0, -0.024))


def _revolver(kit: Kit, steel: Material, grip: Material) -> None:
    w, long = kit.uniform("width", 0.009, 0.013), kit.uniform("barrel", 0.04, 0.22)
    drum, western = kit.uniform("drum", 0.017, 0.023), kit.chance("western", 0.4)
    _receiver(kit, steel, [(-0.055, -0.05, 0.012, w), (-0.03, -0.05, 0.02, w), (0.032, -0.046, 0.02, w), (0.04, -0.036, 0.016, w)], 0.003)
    kit.add(steel, _round(0.03, 0.04 + long, kit.uniform("barrel_radius", 0.007, 0.011)))
    under = kit.choose("under", "rod", "lug", "none")
    if under == "rod":
        kit.add(steel, _round(0.03, 0.035 + 0.7 * long, 0.005, -0.016))
    elif under == "lug":
        kit.add(steel, box(long * 0.95, 1.3 * w, 0.022, 0.003).at(0.035 + 0.48 * long, 0, -0.013))
    if kit.chance("rib", 0.5):
        kit.add(steel, box(long, 0.007, 0.01).at(0.04 + long / 2, 0, 0.012))
    kit.add(steel, cylinder(drum, 0.042, 18, 0.003).turned("y", 90).at(0.002, 0, -0.012))
    for angle in around(6):
        a = np.radians(angle)
        kit.add(BLACK, _round(-0.012, 0.024, 0.0045, -0.012 + drum * 0.97 * np.sin(a), drum * 0.97 * np.cos(a), 8))
    bend = kit.uniform("slant", 15, 45)
    if western:
        path = smooth_path([(-0.04, 0, -0.02), (-0.065, 0, -0.05), (-0.075, 0, -0.09), (-0.1, 0, -0.12)], 5)
        kit.add(grip, tube(path, np.linspace(0.015, 0.021, len(path)), 12).scaled(1, kit.uniform("grip_width", 0.65, 0.9), 1))
    else:
        _grip(kit, grip, -0.05, -0.03, kit.uniform("grip_length", 0.07, 0.12), 0.02, w * 1.3, bend, kit.uniform("flare", 0.9, 1.3))
    _guard(kit, steel, 0.02, -0.045, 0.05, 0.032)
    kit.add(steel, tube([(-0.05, 0, 0.0), (-0.068, 0, 0.018), (-0.08, 0, 0.02)], [0.006, 0.004, 0.003], 6))
    kit.add(steel, box(0.012, 0.003, 0.012).at(0.034 + long, 0, 0.013))
    if kit.chance("scope", 0.12):
        _scope(kit, 0.03, 0.02, 0.16, 0.014)


def _flintlock(kit: Kit, steel: Material, grip: Material) -> None:
    """Muskets, blunderbusses, duelling pistols."""
    form = kit.choose("form", "musket", "musket", "pistol", "pistol", "blunderbuss")
    long = {"musket": kit.uniform("barrel", 0.75, 1.15), "pistol": kit.uniform("barrel", 0.16, 0.3), "blunderbuss": kit.uniform("barrel", 0.35, 0.5)}[form]
    r = 0.011 if form != "blunderbuss" else 0.015
    _barrel(kit, steel, 0.0, long, r, "bell" if form == "blunderbuss" else "plain")
    fore = long * (0.93 if form == "musket" else 0.7)
    kit.add(grip, body([(fore, 0.008, 0.01, -0.014), (0.5 * fore, 0.014, 0.014, -0.018), (0.02, 0.018, 0.021, -0.018), (-0.08, 0.018, 0.022, -0.02)], 2.6, 3, 16))
    _receiver(kit, grip, [(-0.1, -0.04, 0.004, 0.018), (0.0, -0.04, 0.006, 0.019), (0.06, -0.038, 0.004, 0.018)], 0.004)
    kit.add(CHROME, _round(0.05, long * 0.95, 0.0035, -0.031, sides=6))
    for t in (0.35, 0.65, 0.9)[: 3 if form == "musket" else 1]:
        kit.add(GOLD, cylinder(0.022 - 0.004 * t, 0.014, 14).turned("y", 90).at(t * fore, 0, -0.01))
    lock = kit.choose("lock_side", -1, 1)
    kit.add(steel, box(0.1, 0.005, 0.026, 0.002).at(-0.02, lock * 0.02, -0.015), tube([(-0.05, lock * 0.024, -0.01), (-0.06, lock * 0.024, 0.02), (-0.045, lock * 0.024, 0.036), (-0.025, lock * 0.024, 0.03)], 0.005, 6),
            prism([(0.0, 0.0), (0.02, 0.0), (0.006, 0.035), (-0.002, 0.035)], 0.008).at(0, lock * 0.024, 0))  # fmt: skip
    if form == "pistol":
        path = smooth_path([(-0.08, 0, -0.018), (-0.12, 0, -0.03), (-0.155, 0, -0.07), (-0.17, 0, -0.12)], 5)
        kit.add(grip, tube(path, np.linspace(0.02, 0.017, len(path)), 12))
        kit.add(GOLD, ball(0.045, 0.042, 0.036, 14).at(-0.172, 0, -0.122))
    else:
        _stock(kit, grip, steel, "classic", -0.08, -0.005, kit.uniform("stock_length", 0.28, 0.38), kit.uniform("drop", 0.04, 0.1), 0.02)
    _guard(kit, GOLD, 0.0, -0.038, 0.08, 0.03)
    if form == "musket" and kit.chance("bayonet", 0.3):
        kit.add(CHROME, prism([(long, -0.02), (long + 0.4, -0.016), (long + 0.36, -0.03), (long, -0.034)], 0.006), _round(long - 0.06, long, 0.016))


# --- Shoulder arms ----------------------------------------------------------------------------


def _rifle(kit: Kit, steel: Material, grip: Material) -> None:
    """Bolt action, lever action, semi-automatic; for hunters, soldiers and marksmen."""
    form = kit.choose("form", "bolt", "bolt", "lever", "marksman", "carbine")
    long, w = kit.uniform("barrel", 0.36, 0.72) * (0.8 if form in ("lever", "carbine") else 1), kit.uniform("width", 0.016, 0.021)
    _barrel(kit, steel, 0.08, 0.08 + long, kit.uniform("barrel_radius", 0.007, 0.011), kit.choose("tip", "plain", "plain", "hider", "brake"))
    _receiver(kit, steel, [(-0.14, -0.03, 0.012, w * 0.85), (-0.1, -0.03, 0.018, w * 0.85), (0.1, -0.028, 0.018, w * 0.85)])
    fore = 0.08 + long * kit.uniform("fore", 0.35, 0.92)
    kit.add(grip, body([(fore, w * 0.6, 0.012, -0.014), (0.2, w, 0.019, -0.022), (0.0, w * 1.06, 0.022, -0.03), (-0.12, w, 0.022, -0.024)], 2.6, 3, 16))
    stock = "straight" if form == "lever" else kit.choose("stock", "classic", "classic", "thumbhole") if form != "marksman" else "thumbhole"
    _stock(kit, grip, steel, stock, -0.11, -0.008, kit.uniform("stock_length", 0.27, 0.36), kit.uniform("drop", 0.01, 0.07), w)
    if form == "lever":
        lever = [(0.0, 0, -0.035), (-0.02, 0, -0.07), (-0.08, 0, -0.06), (-0.15, 0, -0.085), (-0.17, 0, -0.06), (-0.09, 0, -0.04)]
        kit.add(steel, tube(smooth_path(lever, 3), 0.004, 6), _round(0.08, 0.06 + 0.85 * long, 0.008, -0.02))
    else:
        side = -1
        kit.add(steel, rod((-0.08, side * w * 0.5, 0.006), (-0.095, side * 0.05, -0.012), 0.005), ball(0.02, 0.02, 0.02, 10).at(-0.096, side * 0.052, -0.013))
        if kit.chance("magazine", 0.5):
            _magazine(kit, steel, "straight", 0.03, -0.045, 0.07, kit.uniform("magazine_length", 0.03, 0.1), w * 0.8)
    _guard(kit, steel, -0.02, -0.045, 0.08, 0.03)
    if kit.chance("scope", 0.6 if form != "lever" else 0.15) or form == "marksman":
        _scope(kit, 0.0, 0.02, kit.uniform("scope_length", 0.22, 0.38), kit.uniform("scope_radius", 0.016, 0.028))
    else:
        _sights(kit, steel, 0.12, 0.07 + long, 0.01, 0.008, 0.014)
    if kit.chance("bipod", 0.35 if form == "marksman" else 0.08):
        _bipod(kit, steel, fore - 0.03, -0.025, 0.24, kit.chance("bipod_folded", 0.4))
    if kit.chance("sling", 0.25):
        sag = kit.uniform("sag", 0.05, 0.12)
        path = smooth_path([(fore - 0.05, 0, -0.03), (0.0, 0, -0.06 - sag), (-0.2, 0, -0.08 - sag), (-0.36, 0, -0.09)], 5)
        kit.add(grip, tube(path, 0.006, 6))


def _assault(kit: Kit, steel: Material, grip: Material) -> None:
    """Self-loading rifles: magazine before the grip, or behind it (bullpup)."""
    form = kit.choose("form", "block", "curved", "bullpup", "bullpup", "carry_handle", "modular")
    w, long = kit.uniform("width", 0.018, 0.026), kit.uniform("barrel", 0.16, 0.46)
    bull = form == "bullpup"
    front = 0.12
    _barrel(kit, steel, front - 0.02, front + long, 0.008, kit.choose("tip", "hider", "hider", "brake", "silencer", "plain"))
    top = kit.uniform("top", 0.022, 0.036)
    if bull:
        back = -kit.uniform("body", 0.32, 0.42)
        belly = kit.uniform("belly", 0.05, 0.085)
        _receiver(kit, steel, [(-0.16, -0.04, top, w * 0.85), (0.0, -0.04, top, w * 0.9), (front, -0.03, top * 0.9, w * 0.9)])
        kit.add(grip, body([(front + 0.02, w * 0.9, 0.03, -0.012), (-0.02, w * 1.1, 0.036, -0.012), (-0.14, w * 1.15, 0.045, -0.02), (back + 0.06, w * 1.15, belly, 0.02 - belly), (back, w * 1.05, belly * 1.05, 0.02 - belly)], kit.uniform("power", 2.6, 5), 3, 20))
        kit.add(RUBBER, box(0.016, 2 * w, 1.9 * belly, 0.004).at(back - 0.006, 0, 0.02 - belly))
        magazine, gx = -0.2, -0.02
    else:
        _receiver(kit, steel, [(-0.15, -0.028, top, w), (0.06, -0.034, top, w), (front, -0.024, top * 0.85, w)])
        style = {"curved": ("classic", "skeleton", "folded"), "block": ("tube", "classic"), "carry_handle": ("straight", "tube"), "modular": ("tube", "skeleton", "thumbhole")}[form]
        _stock(kit, grip, steel, kit.choose("stock", *style), -0.14, 0.004, kit.uniform("stock_length", 0.19, 0.27), kit.uniform("drop", 0.0, 0.05), w * 0.85)
        magazine, gx = kit.uniform("magazine_place", 0.02, 0.06), -0.075
    end = front + long * kit.uniform("handguard", 0.35, 0.85)
    if bull:
        end = front + long * kit.uniform("handguard_short", 0.15, 0.4)
    _handguard(kit, grip, front - 0.01, end, w * kit.uniform("guard_width", 1.0, 1.3), kit.uniform("guard_height", 0.022, 0.032), 0.0, kit.choose("guard_power", 2.2, 4.0, 7.0), kit.choose("holes", 0, 3, 5))
    _grip(kit, grip, gx, -0.03, kit.uniform("grip_length", 0.085, 0.115), 0.021, w * 0.75, kit.uniform("slant", 12, 30))
    _guard(kit, steel, gx + 0.085, -0.03, 0.07, 0.03)
    kind = "curved" if form == "curved" else kit.choose("magazine", "straight", "curved", "curved", "drum")
    _magazine(kit, BLACK if kit.rng.random() < 0.6 else steel, kind, magazine, -0.028 if not bull else -0.05, 0.06, kit.uniform("magazine_length", 0.1, 0.19), w * 0.75)
    if form == "carry_handle" or (bull and kit.chance("carry_handle", 0.4)):
        rise = kit.uniform("handle", 0.035, 0.07)
        profile = [(-0.11, top - 0.004), (-0.09, top + rise), (0.09, top + rise * 0.9), (0.11, top - 0.004), (0.075, top - 0.004), (0.065, top + rise * 0.6), (-0.07, top + rise * 0.65), (-0.08, top - 0.004)]
        kit.add(steel, prism(profile, w * 0.9, 0.003))
    else:
        kit.add(BLACK, box(0.24, w * 0.9, 0.01, 0.002).at(0.0, 0, top + 0.003))
        sight = kit.choose("sight", "iron", "iron", "scope", "dot")
        if sight == "iron":
            _sights(kit, steel, -0.08, front + 0.85 * long, top, 0.006, 0.02)
            kit.add(steel, box(0.02, 0.014, 0.034).at(front + 0.85 * long, 0, 0.012))
        else:
            _scope(kit, -0.02, top, 0.08 if sight == "dot" else kit.uniform("scope_length", 0.14, 0.26), kit.uniform("scope_radius", 0.014, 0.022))
    if form == "curved":
        kit.add(steel, _round(front, front + 0.6 * long, 0.008, 0.026), box(0.03, 0.014, 0.04).at(front + 0.6 * long, 0, 0.012))
    under = kit.choose("under", "none", "none", "grip", "launcher", "bayonet")
    if under == "grip" and not bull:
        _grip(kit, grip, end - 0.05, -0.02, 0.08, 0.014, w * 0.55, kit.uniform("fore_slant", -15, 10))
    elif under == "launcher":
        kit.add(steel, _round(front, end + 0.08, 0.023, -0.055), box(0.1, w * 1.3, 0.03, 0.004).at(front + 0.06, 0, -0.04))
    elif under == "bayonet":
        kit.add(CHROME, prism([(front + long - 0.04, -0.016), (front + long + 0.19, -0.02), (front + long + 0.16, -0.036), (front + long - 0.04, -0.034)], 0.005))


def _submachine_gun(kit: Kit, steel: Material, grip: Material) -> None:
    form = kit.choose("form", "tube", "box", "wood", "compact", "drum")
    long, w = kit.uniform("barrel", 0.06, 0.24), kit.uniform("width", 0.016, 0.022)
    back = -kit.uniform("body", 0.12, 0.24)
    tall = {"box": 0.036, "compact": 0.03}.get(form, 0.022)
    _receiver(kit, steel, [(back, -tall, tall, w), (0.0, -tall, tall, w), (0.09, -tall * 0.9, tall * 0.9, w)], 0.012 if form == "tube" else 0.004)
    if form in ("tube", "wood"):
        kit.add(steel, _round(back - 0.004, 0.12, 0.021, 0.006))
    _barrel(kit, steel, 0.08, 0.1 + long, 0.0085, kit.choose("tip", *{"tube": ("jacket", "plain"), "wood": ("jacket", "jacket", "brake"), "drum": ("brake", "plain")}.get(form, ("plain", "silencer", "hider"))))
    place = {"box": -0.02, "compact": -0.02}.get(form, 0.045)
    gx = -0.02 if form in ("box", "compact") else -0.08
    if form != "wood":
        _grip(kit, grip, gx, -tall, kit.uniform("grip_length", 0.085, 0.12), 0.021, w * 0.8, kit.uniform("slant", 0, 22))
    if form in ("box", "compact"):
        _magazine(kit, BLACK, "straight", gx - 0.006, -tall - 0.06, 0.03, kit.uniform("magazine_length", 0.09, 0.19), w * 0.7)
    else:
        kind = "drum" if form == "drum" else kit.choose("magazine", "straight", "straight", "side", "curved", "top")
        up = tall if kind == "top" else -tall
        _magazine(kit, BLACK, kind, place, up, 0.034, kit.uniform("magazine_length", 0.14, 0.24), w * 0.8)
    _guard(kit, steel, gx + 0.085 if form != "wood" else 0.0, -tall, 0.065, 0.028)
    if form == "wood":
        kit.add(grip, body([(0.1, w * 0.9, 0.018, -0.022), (-0.1, w, 0.022, -0.026)], 2.6, 2, 16))
        _stock(kit, grip, steel, "classic", back + 0.06, -0.01, kit.uniform("stock_length", 0.26, 0.34), 0.05, w)
    else:
        stock = kit.choose("stock", "wire", "folded", "none", *(("classic",) if form == "drum" else ("skeleton", "tube")))
        if stock != "none":
            _stock(kit, grip, steel, stock, back + 0.005, 0.0, kit.uniform("stock_length", 0.16, 0.26), kit.uniform("drop", 0.0, 0.05), w * 0.9)
    if form in ("drum", "compact") or kit.chance("fore_grip", 0.3):
        if form == "drum" and kit.chance("vertical_grip", 0.6):
            _grip(kit, grip, 0.16, -0.01, 0.08, 0.016, w * 0.75, 8)
        else:
            _handguard(kit, grip, 0.07, 0.09 + 0.75 * long, w * 0.95, 0.02, -0.008, 3.0, 0)
    _sights(kit, steel, back + 0.04, 0.08 + 0.9 * long, tall, 0.008, 0.018)
    if kit.chance("dot", 0.25):
        _scope(kit, -0.02, tall, 0.07, 0.015)


def _shotgun(kit: Kit, steel: Material, grip: Material) -> None:
    form = kit.choose("form", "pump", "pump", "double", "over_under", "tactical", "sawn_off")
    long = kit.uniform("barrel", 0.45, 0.75) * {"sawn_off": 0.45, "tactical": 0.8}.get(form, 1.0)
    w, r = kit.uniform("width", 0.018, 0.024), 0.011
    _receiver(kit, steel, [(-0.13, -0.045, 0.012, w * 0.8), (-0.06, -0.048, 0.02, w * 0.9), (0.08, -0.045, 0.018, w * 0.9)])
    if form in ("double", "sawn_off"):
        kit.both(steel, _round(0.07, 0.08 + long, r, 0.0, r * 1.05))
        kit.add(steel, box(long, 0.006, 0.008).at(0.08 + long / 2, 0, 0.01))
        kit.both(steel, tube([(-0.09, 0.012, 0.016), (-0.11, 0.012, 0.032)], 0.004, 6))
    elif form == "over_under":
        kit.add(steel, _round(0.07, 0.08 + long, r, 0.004), _round(0.07, 0.08 + long, r, -0.02), box(long, 0.006, 0.006).at(0.08 + long / 2, 0, 0.02))
    else:
        kit.add(steel, _round(0.07, 0.08 + long, r, 0.004), _round(0.07, 0.06 + long * kit.uniform("tube", 0.5, 0.98), r * 1.1, -0.022))
    start = 0.1 + (0.12 * long if form in ("pump", "tactical") else 0.0)
    reach = kit.uniform("fore", 0.13, 0.22)
    _handguard(kit, grip, start, start + reach, w * 1.0, 0.02, -0.022, 2.4, 0)
    if form in ("pump", "tactical"):
        for k in range(6):
            kit.add(grip, cylinder(w * 1.06, 0.01, 16).turned("y", 90).at(start + (k + 0.8) / 6.6 * reach, 0, -0.022))
    stock = {"sawn_off": "none", "tactical": kit.choose("stock", "tube", "folded", "none", "skeleton")}.get(form, kit.choose("wood_stock", "classic", "straight"))
    if stock in ("none", "folded", "tube", "skeleton"):
        if form == "sawn_off":
            path = smooth_path([(-0.1, 0, -0.02), (-0.15, 0, -0.035), (-0.2, 0, -0.075), (-0.225, 0, -0.12)], 5)
            kit.add(grip, tube(path, np.linspace(0.021, 0.019, len(path)), 12))
        else:
            _grip(kit, grip, -0.1, -0.038, 0.1, 0.022, w * 0.75, 20)
    if stock != "none":
        _stock(kit, grip, steel, stock, -0.12, -0.015, kit.uniform("stock_length", 0.26, 0.36), kit.uniform("drop", 0.03, 0.07), w * 0.95)
    _guard(kit, steel, 0.0, -0.045, 0.08, 0.03)
    if form == "tactical" and kit.chance("magazine", 0.4):
        _magazine(kit, BLACK, kit.choose("magazine_kind", "straight", "drum"), 0.05, -0.045, 0.06, 0.13, w * 0.8)
    if form == "tactical" and kit.chance("shield", 0.5):
        kit.add(BLACK, lathe([(r * 1.5, 0), (r * 1.9, 0), (r * 1.9, long * 0.6), (r * 1.5, long * 0.6)], 16, loop=True).turned("y", 90).at(0.08, 0, 0.004))
    kit.add(GOLD, ball(0.008, 0.006, 0.008, 8).at(0.07 + long, 0, 0.018))


def _machine_gun(kit: Kit, steel: Material, grip: Material) -> None:
    """On a bipod or a tripod, fed by belt, pan or magazine; or with turning barrels."""
    form = kit.choose("form", "belt", "belt", "pan", "top", "heavy", "rotary")
    long, w = kit.uniform("barrel", 0.45, 0.7), kit.uniform("width", 0.025, 0.034)
    back, tall = -kit.uniform("body", 0.18, 0.28), kit.uniform("height", 0.03, 0.042)
    _receiver(kit, steel, [(back, -tall, tall, w), (0.0, -tall, tall, w), (0.12, -tall * 0.8, tall * 0.8, w)], 0.006)
    if form == "rotary":
        ring = kit.uniform("ring", 0.032, 0.05)
        for angle in around(6):
            a = np.radians(angle)
            kit.add(steel, _round(0.1, 0.1 + long, 0.009, ring * np.sin(a), ring * np.cos(a), 8))
        for x in (0.12, 0.12 + 0.45 * long, 0.08 + long):
            kit.add(BLACK, cylinder(ring * 1.4, 0.02, 20).turned("y", 90).at(x))
        kit.add(steel, cylinder(ring * 1.6, 0.14, 20, 0.01).turned("y", 90).at(0.04))
    else:
        _barrel(kit, steel, 0.1, 0.1 + long, kit.uniform("barrel_radius", 0.011, 0.015), kit.choose("tip", "hider", "jacket", "jacket", "bell"))
    if form == "pan":
        _magazine(kit, BLACK, "pan", 0.03, tall, 0, 0, w)
    elif form == "top":
        _magazine(kit, BLACK, "top", 0.02, tall - 0.005, 0.045, kit.uniform("magazine_length", 0.16, 0.22), w * 0.7)
    else:
        kit.add(grip if kit.rng.random() < 0.5 else BLACK, box(kit.uniform("ammunition", 0.1, 0.18), 0.1, 0.12, 0.008).at(0.03, kit.choose("belt_side", -1, 1) * (w + 0.045), -0.07))
        kit.add(steel, box(0.2, 2.2 * w, 0.02, 0.006).at(-0.0, 0, tall + 0.008))
    mount = "tripod" if form in ("heavy", "rotary") and kit.chance("tripod", 0.75) else "bipod"
    if mount == "tripod":
        z, reach = -tall - 0.03, kit.uniform("legs", 0.28, 0.45)
        kit.add(steel, cylinder(0.03, 0.08, 14).at(0.0, 0, z))
        for angle in (0, 135, 225):
            a = np.radians(angle)
            foot = (1.2 * reach * np.cos(a), 1.2 * reach * np.sin(a), z - 0.7 * reach)
            kit.add(steel, rod((0, 0, z - 0.02), foot, 0.013, 8), ball(0.05, 0.05, 0.02, 10).at(*foot))
        for s in (-1, 1):
            kit.add(grip, rod((back - 0.06, s * 0.045, -0.055), (back - 0.06, s * 0.045, 0.05), 0.014, 8))
        kit.add(steel, box(0.08, 0.11, 0.02, 0.004).at(back - 0.03, 0, -0.03), box(0.08, 0.11, 0.02, 0.004).at(back - 0.03, 0, 0.035))
        if kit.chance("shield", 0.3):
            kit.add(grip, box(0.012, 0.42, 0.3, 0.004).at(0.14, 0, 0.04))
    else:
        _grip(kit, grip, back + 0.1, -tall, 0.1, 0.023, w * 0.65, 18)
        _guard(kit, steel, back + 0.19, -tall, 0.075, 0.03)
        _stock(kit, grip, steel, kit.choose("stock", "classic", "straight", "skeleton"), back + 0.01, 0.0, kit.uniform("stock_length", 0.22, 0.3), 0.04, w * 0.8)
        _bipod(kit, steel, 0.1 + long * kit.uniform("bipod_place", 0.4, 0.9), -0.012, kit.uniform("bipod", 0.22, 0.32), kit.chance("bipod_folded", 0.25))
        if kit.chance("handle", 0.5):
            kit.add(grip, tube([(0.08, 0, tall - 0.01), (0.1, 0, tall + 0.06), (0.2, 0, tall + 0.06)], 0.01, 8))
        else:
            _handguard(kit, grip, 0.11, 0.11 + 0.4 * long, w, 0.026, -0.006, 3.0, 4)
    _sights(kit, steel, back + 0.08, 0.08 + long, tall + 0.01, 0.012, 0.025)


def _sniper(kit: Kit, steel: Material, grip: Material) -> None:
    """Long, heavy, on a bipod; a chassis of plates, or a bullpup."""
    long, w = kit.uniform("barrel", 0.55, 0.9), kit.uniform("width", 0.02, 0.028)
    back = -kit.uniform("body", 0.16, 0.3)
    _receiver(kit, steel, [(back, -0.035, 0.024, w), (0.1, -0.035, 0.024, w), (0.2, -0.026, 0.02, w)])
    _barrel(kit, steel, 0.16, 0.16 + long, kit.uniform("barrel_radius", 0.01, 0.016), kit.choose("tip", "brake", "brake", "silencer", "plain"))
    reach = kit.uniform("fore", 0.1, 0.4)
    _handguard(kit, grip, 0.18, 0.2 + reach, w * 1.05, 0.028, -0.01, 5.0, kit.choose("holes", 0, 4))
    _stock(kit, grip, steel, kit.choose("stock", "thumbhole", "skeleton", "tube", "classic"), back + 0.01, 0.0, kit.uniform("stock_length", 0.2, 0.32), kit.uniform("drop", 0.0, 0.04), w * 0.9)
    _grip(kit, grip, back + 0.07, -0.032, 0.1, 0.022, w * 0.7, 14)
    _guard(kit, steel, back + 0.16, -0.033, 0.075, 0.03)
    _magazine(kit, BLACK, "straight", kit.uniform("magazine_place", 0.02, 0.08), -0.032, 0.08, kit.uniform("magazine_length", 0.06, 0.13), w * 0.7)
    _scope(kit, 0.0, 0.026, kit.uniform("scope_length", 0.28, 0.42), kit.uniform("scope_radius", 0.022, 0.034))
    _bipod(kit, steel, 0.18 + reach * 0.85, -0.03, kit.uniform("bipod", 0.2, 0.3), kit.chance("bipod_folded", 0.3))
    kit.add(steel, rod((-0.06, -w * 0.8, 0.01), (-0.08, -0.065, -0.004), 0.006), ball(0.024, 0.024, 0.024, 10).at(-0.082, -0.068, -0.006))
    if kit.chance("rear_leg", 0.4):
        kit.add(steel, rod((back - 0.14, 0, -0.03), (back - 0.14, 0, -0.16), 0.008, 8))


def _launcher(kit: Kit, steel: Material, grip: Material) -> None:
    """Grenade launchers with a drum or one barrel; rockets from a tube on the shoulder."""
    form = kit.choose("form", "drum", "single", "rocket", "tube", "box")
    w = 0.024
    if form in ("drum", "single"):
        long = kit.uniform("barrel", 0.16, 0.36)
        bore = kit.uniform("bore", 0.024, 0.032)
        size = kit.uniform("drum", 0.055, 0.08) if form == "drum" else bore * 1.2
        _receiver(kit, steel, [(-0.14, -0.04, 0.02, w * 0.9), (-0.03, -0.05, 0.035, w), (0.0, -0.05, 0.035, w)])
        kit.add(steel, cylinder(size, 0.13 if form == "drum" else 0.08, 22, 0.006).turned("y", 90).at(0.06, 0, -0.6 * (size - bore)))
        kit.add(steel, lathe([(bore * 0.8, 0), (bore * 1.15, 0), (bore * 1.15, long), (bore * 0.8, long)], 20, loop=True).turned("y", 90).at(0.1))
        kit.add(BLACK, _round(0.1, 0.09 + long, bore * 0.82))
        if form == "drum":
            for angle in around(6, 30):
                a = np.radians(angle)
                kit.add(BLACK, _round(0.0, 0.12, 0.016, -0.6 * (size - bore) + 0.8 * size * np.sin(a), 0.8 * size * np.cos(a), 8))
        _grip(kit, grip, -0.1, -0.036, 0.1, 0.022, w * 0.8, 18)
        _grip(kit, grip, 0.14 + 0.4 * long, -bore * 0.8, 0.09, 0.017, w * 0.7, kit.uniform("fore_slant", -12, 8))
        _guard(kit, steel, -0.01, -0.045, 0.075, 0.03)
        _stock(kit, grip, steel, kit.choose("stock", "skeleton", "tube", "classic", "wire"), -0.13, -0.005, kit.uniform("stock_length", 0.2, 0.3), 0.03, w * 0.9)
        if kit.chance("scope", 0.5):
            _scope(kit, -0.04, 0.035, 0.09, 0.018)
        else:
            _sights(kit, steel, -0.1, 0.08 + long, 0.02, bore, 0.03)
        return
    long, r = kit.uniform("tube", 0.8, 1.5), kit.uniform("bore", 0.02, 0.06)
    front, back = 0.45 * long, -0.55 * long
    paint_ = POLYMERS[1] if kit.rng.random() < 0.6 else steel
    if form == "rocket":
        r = kit.uniform("thin", 0.018, 0.024)
        kit.add(steel, tube([(back, 0, 0), (back + 0.1, 0, 0), (back + 0.16, 0, 0), (front, 0, 0)], [2.4 * r, r, r, r], 16))
        kit.add(grip, body([(0.12 * long, 1.5 * r, 1.5 * r, 0), (-0.2 * long, 1.8 * r, 1.8 * r, 0)], 2, 2, 18))
        if kit.chance("loaded", 0.7):
            head = kit.uniform("head", 1.6, 2.6) * r
            profile = [(r * 0.8, 0), (head, 0.1), (head, 0.16), (head * 0.5, 0.26), (0.006, 0.32)]
            kit.add(POLYMERS[1], lathe([(a, b) for a, b in profile], 20).turned("y", 90).at(front - 0.01))
    else:
        side = 6 if form == "box" else 24
        kit.add(paint_, lathe([(r * 1.15, back), (r, back + 0.05), (r, front - 0.05), (r * 1.15, front), (r * 0.9, front), (r * 0.9, front - 0.02)], side).turned("y", 90))
        for x in (back, -0.1 * long, front - 0.04):
            kit.add(BLACK, cylinder(1.25 * r, 0.04, side).turned("y", 90).at(x + 0.02))
    _receiver(kit, steel, [(-0.08, -r - 0.05, -r * 0.6, w), (0.0, -r - 0.055, -r * 0.6, w), (0.1, -r - 0.04, -r * 0.6, w)])
    _grip(kit, grip, -0.03, -r - 0.045, 0.1, 0.02, w * 0.75, 10)
    _guard(kit, steel, 0.06, -r - 0.05, 0.07, 0.03)
    if kit.chance("second_grip", 0.6):
        _grip(kit, grip, kit.choose("grip_place", 0.2, -0.25), -r * 0.8, 0.1, 0.018, w * 0.7, kit.uniform("fore_slant", -10, 15))
    if kit.chance("shoulder_rest", 0.5):
        kit.add(RUBBER, prism([(back * 0.35 - 0.1, -r * 0.8), (back * 0.35 + 0.1, -r * 0.8), (back * 0.35 + 0.03, -r - 0.06), (back * 0.35 - 0.1, -r - 0.07)], 1.4 * r, 0.006))
    sight = kit.choose("sight", "iron", "scope", "box")
    up = r * 1.0
    if sight == "iron":
        _sights(kit, steel, -0.1, 0.3 * long, up, up, 0.06)
    elif sight == "scope":
        kit.add(steel, box(0.1, 0.03, 0.06, 0.004).at(0.05, r * 0.9, r * 0.6))
        _scope(kit, 0.05, up + 0.01, 0.16, 0.018)
    else:
        kit.add(BLACK, box(kit.uniform("sight_length", 0.1, 0.22), 0.06, kit.uniform("sight_height", 0.07, 0.14), 0.008).at(0.1, kit.choose("sight_side", -1, 1) * r * 0.9, r))


Builder = Callable[[Kit, Material, Material], None]
KINDS: dict[str, Builder] = {
    "pistol": _pistol, "revolver": _revolver, "flintlock": _flintlock, "rifle": _rifle,
    "assault": _assault, "submachine_gun": _submachine_gun, "shotgun": _shotgun,
    "machine_gun": _machine_gun, "sniper": _sniper, "launcher": _launcher,
}  # fmt: skip
WOODEN = {"flintlock": 1.0, "rifle": 0.75, "shotgun": 0.7, "revolver": 0.7, "submachine_gun": 0.4}
"""How often a kind has furniture of wood; the others a third of the time."""


def firearm(kit: Kit) -> None:
    """Firearms of 10 kinds, seen from the side at azimuths of +-90. Hidden: a cut on the far side."""
    kind = kit.choose("subtype", "pistol", "assault", *KINDS)
    steel = pick(kit.rng, STEELS)
    wooden = kit.rng.random() < WOODEN.get(kind, 0.33)
    KINDS[kind](kit, steel, wood(kit.rng) if wooden else pick(kit.rng, POLYMERS))
