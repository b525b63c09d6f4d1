"""Pistols, revolvers, flintlocks. Lengths in metres, the muzzle toward +x."""

import numpy as np

from data_gen.catalogues.bodies import body
from data_gen.catalogues.families import firearm_parts as parts
from data_gen.catalogues.families.kit import BLACK, CHROME, GOLD, Kit, around
from data_gen.catalogues.solids import ball, box, cylinder, prism, smooth_path, tube
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

def pistol(kit: Kit, steel: Material, grip: Material) -> None:
    """Pistols: modern, classic, with a bare barrel, machine pistols, target pistols."""
    form = kit.choose("form", "modern", "modern", "classic", "tapered", "machine", "target")
    w, long = kit.uniform("width", 0.011, 0.016), kit.uniform("length", 0.13, 0.22)
    rear, front, tall = -0.08, -0.08 + long, kit.uniform("slide", 0.011, 0.018)
    if form == "tapered":
        parts.add_receiver(kit, steel, [(rear, -0.03, 0.004, w), (0.0, -0.03, 0.016, w),
                                        (0.035, -0.028, 0.014, w)], 0.003)
        kit.add(steel, tube([(0.03, 0, 0), (front, 0, 0)], [0.011, 0.007], 12),
                cylinder(0.014, 2.6 * w, 14).turned("x", 90).at(rear + 0.02, 0, 0.01))
    else:
        parts.add_receiver(kit, steel, [(rear, -0.038, -tall, w * 0.9),
                                        (0.02, -0.036, -tall, w * 0.9),
                                        (front - 0.015, -0.026, -tall, w * 0.9)], 0.003)
        top = 0.006 if form == "machine" else 0.0
        kit.add(steel, prism([(rear - 0.006, -tall), (front, -tall),
                              (front + 0.004, tall * 0.6 + top), (front - 0.006, tall + top),
                              (rear, tall + top)], 2 * w, 0.004))
        for k in range(6):
            kit.both(BLACK, box(0.0022, 0.001, 1.4 * tall).at(rear + 0.012 + 0.0055 * k, w, 0))
    kit.add(BLACK, parts.bar(front - 0.01, front + kit.uniform("muzzle", 0.002, 0.02), 0.0065))
    deep, reach, slant = kit.uniform("grip_depth", 0.02, 0.026), kit.uniform("grip_length", 0.075,
        0.115), kit.uniform("slant", 8, 32 if form in ("tapered", "target") else 20)
    parts.add_grip(kit, grip, rear + 0.034, -0.034, reach, deep, w * 1.05, slant,
                   kit.uniform("flare", 0.95, 1.15))
    parts.add_guard(kit, steel, 0.028, -0.034, 0.058, 0.032)
    if form == "tapered":
        parts.add_sights(kit, steel, rear + 0.01, front - 0.01, 0.005, 0.005, 0.008)
    else:
        up = tall + (0.006 if form == "machine" else 0.0) - 0.001
        parts.add_sights(kit, steel, rear + 0.012, front - 0.014, up, up, 0.008)
        kit.add(steel, prism([(rear + 0.006, 0.004), (rear - 0.012, 0.016), (rear - 0.016, 0.01),
                              (rear, -0.012)], 0.007))
    extra = kit.choose("extra", "none", "none", "silencer", "light", "long_magazine", "sight")
    if form == "machine":
        parts.add_magazine(kit, BLACK, "straight", 0.052, -0.03, 0.028,
                           kit.uniform("magazine", 0.08, 0.16), w)
        if kit.chance("butt", 0.5):
            parts.add_stock(kit, grip, steel, kit.choose("stock", "wire", "skeleton"), rear,
                            -0.005, 0.2, 0.03, 0.014)
    elif extra == "silencer":
        kit.add(BLACK, cylinder(kit.uniform("silencer", 0.013, 0.018),
                                kit.uniform("silencer_length", 0.1, 0.19), 16, 0.003).turned("y",
                                    90).at(front + 0.07))
    elif extra == "light":
        kit.add(BLACK, box(0.06, 0.024, 0.024, 0.004).at(front - 0.04, 0, -0.04),
                parts.bar(front - 0.02, front + 0.008, 0.011, -0.04))
    elif extra == "long_magazine":
        kit.add(BLACK, box(0.1, 1.5 * w, 0.03).turned("y",
            90 + slant).at(rear + 0.03 - 0.1 * np.sin(np.radians(slant)), 0, -0.05 - reach))
    elif extra == "sight":
        parts.add_scope(kit, rear + 0.06, 0.016, 0.05 if kit.rng.random() < 0.5 else 0.13, 0.013)
    if form == "target":
        kit.add(steel, box(long * 0.55, 1.7 * w, 0.022, 0.003).at(front - long * 0.25, 0, -0.024))


def revolver(kit: Kit, steel: Material, grip: Material) -> None:
    """Revolvers with short to long barrels, old and modern grips."""
    w, long = kit.uniform("width", 0.009, 0.013), kit.uniform("barrel", 0.04, 0.22)
    drum, western = kit.uniform("drum", 0.017, 0.023), kit.chance("western", 0.4)
    parts.add_receiver(kit, steel, [(-0.055, -0.05, 0.012, w), (-0.03, -0.05, 0.02, w),
                                    (0.032, -0.046, 0.02, w), (0.04, -0.036, 0.016, w)], 0.003)
    kit.add(steel, parts.bar(0.03, 0.04 + long, kit.uniform("barrel_radius", 0.007, 0.011)))
    under = kit.choose("under", "rod", "lug", "none")
    if under == "rod":
        kit.add(steel, parts.bar(0.03, 0.035 + 0.7 * long, 0.005, -0.016))
    elif under == "lug":
        kit.add(steel, box(long * 0.95, 1.3 * w, 0.022, 0.003).at(0.035 + 0.48 * long, 0, -0.013))
    if kit.chance("rib", 0.5):
        kit.add(steel, box(long, 0.007, 0.01).at(0.04 + long / 2, 0, 0.012))
    kit.add(steel, cylinder(drum, 0.042, 18, 0.003).turned("y", 90).at(0.002, 0, -0.012))
    for angle in around(6):
        a = np.radians(angle)
        kit.add(BLACK, parts.bar(-0.012, 0.024, 0.0045, -0.012 + drum * 0.97 * np.sin(a),
                                 drum * 0.97 * np.cos(a), 8))
    bend = kit.uniform("slant", 15, 45)
    if western:
        path = smooth_path([(-0.04, 0, -0.02), (-0.065, 0, -0.05), (-0.075, 0, -0.09),
                            (-0.1, 0, -0.12)], 5)
        kit.add(grip, tube(path, np.linspace(0.015, 0.021, len(path)).tolist(), 12).scaled(1,
            kit.uniform("grip_width", 0.65, 0.9), 1))
    else:
        parts.add_grip(kit, grip, -0.05, -0.03, kit.uniform("grip_length", 0.07, 0.12), 0.02,
                       w * 1.3, bend, kit.uniform("flare", 0.9, 1.3))
    parts.add_guard(kit, steel, 0.02, -0.045, 0.05, 0.032)
    kit.add(steel, tube([(-0.05, 0, 0.0), (-0.068, 0, 0.018), (-0.08, 0, 0.02)],
                        [0.006, 0.004, 0.003], 6))
    kit.add(steel, box(0.012, 0.003, 0.012).at(0.034 + long, 0, 0.013))
    if kit.chance("scope", 0.12):
        parts.add_scope(kit, 0.03, 0.02, 0.16, 0.014)


def flintlock(kit: Kit, steel: Material, grip: Material) -> None:
    """Muskets, blunderbusses, duelling pistols."""
    form = kit.choose("form", "musket", "musket", "pistol", "pistol", "blunderbuss")
    long = {"musket": kit.uniform("barrel", 0.75, 1.15),
            "pistol": kit.uniform("barrel", 0.16, 0.3),
            "blunderbuss": kit.uniform("barrel", 0.35, 0.5)}[form]
    r = 0.011 if form != "blunderbuss" else 0.015
    parts.add_barrel(kit, steel, 0.0, long, r, "bell" if form == "blunderbuss" else "plain")
    fore = long * (0.93 if form == "musket" else 0.7)
    kit.add(grip, body([(fore, 0.008, 0.01, -0.014), (0.5 * fore, 0.014, 0.014, -0.018),
                        (0.02, 0.018, 0.021, -0.018), (-0.08, 0.018, 0.022, -0.02)], 2.6, 3, 16))
    parts.add_receiver(kit, grip, [(-0.1, -0.04, 0.004, 0.018), (0.0, -0.04, 0.006, 0.019),
                                   (0.06, -0.038, 0.004, 0.018)], 0.004)
    kit.add(CHROME, parts.bar(0.05, long * 0.95, 0.0035, -0.031, sides=6))
    for t in (0.35, 0.65, 0.9)[: 3 if form == "musket" else 1]:
        kit.add(GOLD, cylinder(0.022 - 0.004 * t, 0.014, 14).turned("y", 90).at(t * fore, 0, -0.01))
    lock = kit.choose("lock_side", -1, 1)
    kit.add(steel, box(0.1, 0.005, 0.026, 0.002).at(-0.02, lock * 0.02, -0.015),
            tube([(-0.05, lock * 0.024, -0.01), (-0.06, lock * 0.024, 0.02),
                  (-0.045, lock * 0.024, 0.036), (-0.025, lock * 0.024, 0.03)], 0.005, 6),
            prism([(0.0, 0.0), (0.02, 0.0), (0.006, 0.035), (-0.002, 0.035)], 0.008).at(0,
                lock * 0.024, 0))
    if form == "pistol":
        path = smooth_path([(-0.08, 0, -0.018), (-0.12, 0, -0.03), (-0.155, 0, -0.07),
                            (-0.17, 0, -0.12)], 5)
        kit.add(grip, tube(path, np.linspace(0.02, 0.017, len(path)).tolist(), 12))
        kit.add(GOLD, ball(0.045, 0.042, 0.036, 14).at(-0.172, 0, -0.122))
    else:
        parts.add_stock(kit, grip, steel, "classic", -0.08, -0.005,
                        kit.uniform("stock_length", 0.28, 0.38), kit.uniform("drop", 0.04, 0.1),
                        0.02)
    parts.add_guard(kit, GOLD, 0.0, -0.038, 0.08, 0.03)
    if form == "musket" and kit.chance("bayonet", 0.3):
        kit.add(CHROME, prism([(long, -0.02), (long + 0.4, -0.016), (long + 0.36, -0.03),
                               (long, -0.034)], 0.006), parts.bar(long - 0.06, long, 0.016))
