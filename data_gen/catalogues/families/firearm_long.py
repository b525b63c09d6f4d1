"""Shoulder arms and machine guns. Lengths in metres, the muzzle toward +x."""

import numpy as np

from data_gen.catalogues.bodies import body
from data_gen.catalogues.families.firearm_parts import (
    POLYMERS,
    add_barrel,
    add_bipod,
    add_grip,
    add_guard,
    add_handguard,
    add_magazine,
    add_receiver,
    add_scope,
    add_sights,
    add_stock,
    bar,
)
from data_gen.catalogues.families.kit import BLACK, CHROME, GOLD, RUBBER, Kit, around
from data_gen.catalogues.solids import ball, box, cylinder, lathe, prism, rod, smooth_path, tube
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

def rifle(kit: Kit, steel: Material, grip: Material) -> None:
    """Rifles: bolt action, lever action, semi-automatic."""
    form = kit.choose("form", "bolt", "bolt", "lever", "marksman", "carbine")
    long, w = kit.uniform("barrel", 0.36, 0.72) * (0.8 if form in ("lever", "carbine")
                                                   else 1), kit.uniform("width", 0.016, 0.021)
    add_barrel(kit, steel, 0.08, 0.08 + long, kit.uniform("barrel_radius", 0.007, 0.011),
               kit.choose("tip", "plain", "plain", "hider", "brake"))
    add_receiver(kit, steel, [(-0.14, -0.03, 0.012, w * 0.85), (-0.1, -0.03, 0.018, w * 0.85),
                              (0.1, -0.028, 0.018, w * 0.85)])
    fore = 0.08 + long * kit.uniform("fore", 0.35, 0.92)
    kit.add(grip, body([(fore, w * 0.6, 0.012, -0.014), (0.2, w, 0.019, -0.022),
                        (0.0, w * 1.06, 0.022, -0.03), (-0.12, w, 0.022, -0.024)], 2.6, 3, 16))
    stock = "straight" if form == "lever" else kit.choose("stock", "classic", "classic",
        "thumbhole") if form != "marksman" else "thumbhole"
    add_stock(kit, grip, steel, stock, -0.11, -0.008, kit.uniform("stock_length", 0.27, 0.36),
              kit.uniform("drop", 0.01, 0.07), w)
    if form == "lever":
        lever = [(0.0, 0, -0.035), (-0.02, 0, -0.07), (-0.08, 0, -0.06), (-0.15, 0, -0.085),
                 (-0.17, 0, -0.06), (-0.09, 0, -0.04)]
        kit.add(steel, tube(smooth_path(lever, 3), 0.004, 6),
                bar(0.08, 0.06 + 0.85 * long, 0.008, -0.02))
    else:
        side = -1
        kit.add(steel, rod((-0.08, side * w * 0.5, 0.006), (-0.095, side * 0.05, -0.012), 0.005),
                ball(0.02, 0.02, 0.02, 10).at(-0.096, side * 0.052, -0.013))
        if kit.chance("magazine", 0.5):
            add_magazine(kit, steel, "straight", 0.03, -0.045, 0.07,
                         kit.uniform("magazine_length", 0.03, 0.1), w * 0.8)
    add_guard(kit, steel, -0.02, -0.045, 0.08, 0.03)
    if kit.chance("scope", 0.6 if form != "lever" else 0.15) or form == "marksman":
        add_scope(kit, 0.0, 0.02, kit.uniform("scope_length", 0.22, 0.38),
                  kit.uniform("scope_radius", 0.016, 0.028))
    else:
        add_sights(kit, steel, 0.12, 0.07 + long, 0.01, 0.008, 0.014)
    if kit.chance("bipod", 0.35 if form == "marksman" else 0.08):
        add_bipod(kit, steel, fore - 0.03, -0.025, 0.24, kit.chance("bipod_folded", 0.4))
    if kit.chance("sling", 0.25):
        sag = kit.uniform("sag", 0.05, 0.12)
        path = smooth_path([(fore - 0.05, 0, -0.03), (0.0, 0, -0.06 - sag), (-0.2, 0, -0.08 - sag),
                            (-0.36, 0, -0.09)], 5)
        kit.add(grip, tube(path, 0.006, 6))


def assault(kit: Kit, steel: Material, grip: Material) -> None:
    """Assault rifles: magazine in front of the grip or behind it (bullpup)."""
    form = kit.choose("form", "block", "curved", "bullpup", "bullpup", "carry_handle", "modular")
    w, long = kit.uniform("width", 0.018, 0.026), kit.uniform("barrel", 0.16, 0.46)
    bull = form == "bullpup"
    front = 0.12
    add_barrel(kit, steel, front - 0.02, front + long, 0.008,
               kit.choose("tip", "hider", "hider", "brake", "silencer", "plain"))
    top = kit.uniform("top", 0.022, 0.036)
    if bull:
        back = -kit.uniform("body", 0.32, 0.42)
        belly = kit.uniform("belly", 0.05, 0.085)
        add_receiver(kit, steel, [(-0.16, -0.04, top, w * 0.85), (0.0, -0.04, top, w * 0.9),
                                  (front, -0.03, top * 0.9, w * 0.9)])
        kit.add(grip, body([(front + 0.02, w * 0.9, 0.03, -0.012), (-0.02, w * 1.1, 0.036, -0.012),
                            (-0.14, w * 1.15, 0.045, -0.02),
                            (back + 0.06, w * 1.15, belly, 0.02 - belly),
                            (back, w * 1.05, belly * 1.05, 0.02 - belly)],
                           kit.uniform("power", 2.6, 5), 3, 20))
        kit.add(RUBBER, box(0.016, 2 * w, 1.9 * belly, 0.004).at(back - 0.006, 0, 0.02 - belly))
        magazine, gx = -0.2, -0.02
    else:
        add_receiver(kit, steel, [(-0.15, -0.028, top, w), (0.06, -0.034, top, w),
                                  (front, -0.024, top * 0.85, w)])
        style = {"curved": ("classic", "skeleton", "folded"), "block": ("tube", "classic"),
                 "carry_handle": ("straight", "tube"),
                 "modular": ("tube", "skeleton", "thumbhole")}[form]
        add_stock(kit, grip, steel, kit.choose("stock", *style), -0.14, 0.004,
                  kit.uniform("stock_length", 0.19, 0.27), kit.uniform("drop", 0.0, 0.05), w * 0.85)
        magazine, gx = kit.uniform("magazine_place", 0.02, 0.06), -0.075
    end = front + long * kit.uniform("handguard", 0.35, 0.85)
    if bull:
        end = front + long * kit.uniform("handguard_short", 0.15, 0.4)
    add_handguard(kit, grip, front - 0.01, end, w * kit.uniform("guard_width", 1.0, 1.3),
                  kit.uniform("guard_height", 0.022, 0.032), 0.0,
                  kit.choose("guard_power", 2.2, 4.0, 7.0), kit.choose("holes", 0, 3, 5))
    add_grip(kit, grip, gx, -0.03, kit.uniform("grip_length", 0.085, 0.115), 0.021, w * 0.75,
             kit.uniform("slant", 12, 30))
    add_guard(kit, steel, gx + 0.085, -0.03, 0.07, 0.03)
    kind = "curved" if form == "curved" else kit.choose("magazine", "straight", "curved", "curved",
                                                        "drum")
    add_magazine(kit, BLACK if kit.rng.random() < 0.6 else steel, kind, magazine,
                 -0.028 if not bull else -0.05, 0.06, kit.uniform("magazine_length", 0.1, 0.19),
                 w * 0.75)
    if form == "carry_handle" or (bull and kit.chance("carry_handle", 0.4)):
        rise = kit.uniform("handle", 0.035, 0.07)
        profile = [(-0.11, top - 0.004), (-0.09, top + rise), (0.09, top + rise * 0.9),
                   (0.11, top - 0.004), (0.075, top - 0.004), (0.065, top + rise * 0.6),
                   (-0.07, top + rise * 0.65), (-0.08, top - 0.004)]
        kit.add(steel, prism(profile, w * 0.9, 0.003))
    else:
        kit.add(BLACK, box(0.24, w * 0.9, 0.01, 0.002).at(0.0, 0, top + 0.003))
        sight = kit.choose("sight", "iron", "iron", "scope", "dot")
        if sight == "iron":
            add_sights(kit, steel, -0.08, front + 0.85 * long, top, 0.006, 0.02)
            kit.add(steel, box(0.02, 0.014, 0.034).at(front + 0.85 * long, 0, 0.012))
        else:
            add_scope(kit, -0.02, top, 0.08 if sight == "dot"
                      else kit.uniform("scope_length", 0.14, 0.26),
                      kit.uniform("scope_radius", 0.014, 0.022))
    if form == "curved":
        kit.add(steel, bar(front, front + 0.6 * long, 0.008, 0.026),
                box(0.03, 0.014, 0.04).at(front + 0.6 * long, 0, 0.012))
    under = kit.choose("under", "none", "none", "grip", "launcher", "bayonet")
    if under == "grip" and not bull:
        add_grip(kit, grip, end - 0.05, -0.02, 0.08, 0.014, w * 0.55,
                 kit.uniform("fore_slant", -15, 10))
    elif under == "launcher":
        kit.add(steel, bar(front, end + 0.08, 0.023, -0.055),
                box(0.1, w * 1.3, 0.03, 0.004).at(front + 0.06, 0, -0.04))
    elif under == "bayonet":
        kit.add(CHROME, prism([(front + long - 0.04, -0.016), (front + long + 0.19, -0.02),
                               (front + long + 0.16, -0.036), (front + long - 0.04, -0.034)],
                              0.005))


def submachine_gun(kit: Kit, steel: Material, grip: Material) -> None:
    """Submachine guns, with the magazine in front of the grip, in it, above or beside."""
    form = kit.choose("form", "tube", "box", "wood", "compact", "drum")
    long, w = kit.uniform("barrel", 0.06, 0.24), kit.uniform("width", 0.016, 0.022)
    back = -kit.uniform("body", 0.12, 0.24)
    tall = {"box": 0.036, "compact": 0.03}.get(form, 0.022)
    add_receiver(kit, steel, [(back, -tall, tall, w), (0.0, -tall, tall, w),
                              (0.09, -tall * 0.9, tall * 0.9, w)],
                 0.012 if form == "tube" else 0.004)
    if form in ("tube", "wood"):
        kit.add(steel, bar(back - 0.004, 0.12, 0.021, 0.006))
    add_barrel(kit, steel, 0.08, 0.1 + long, 0.0085,
               kit.choose("tip", *{"tube": ("jacket", "plain"),
                                   "wood": ("jacket", "jacket", "brake"),
                                   "drum": ("brake", "plain")}.get(form,
                                                                   ("plain", "silencer", "hider"))))
    place = {"box": -0.02, "compact": -0.02}.get(form, 0.045)
    gx = -0.02 if form in ("box", "compact") else -0.08
    if form != "wood":
        add_grip(kit, grip, gx, -tall, kit.uniform("grip_length", 0.085, 0.12), 0.021, w * 0.8,
                 kit.uniform("slant", 0, 22))
    if form in ("box", "compact"):
        add_magazine(kit, BLACK, "straight", gx - 0.006, -tall - 0.06, 0.03,
                     kit.uniform("magazine_length", 0.09, 0.19), w * 0.7)
    else:
        kind = "drum" if form == "drum" else kit.choose("magazine", "straight", "straight", "side",
                                                        "curved", "top")
        up = tall if kind == "top" else -tall
        add_magazine(kit, BLACK, kind, place, up, 0.034,
                     kit.uniform("magazine_length", 0.14, 0.24), w * 0.8)
    add_guard(kit, steel, gx + 0.085 if form != "wood" else 0.0, -tall, 0.065, 0.028)
    if form == "wood":
        kit.add(grip, body([(0.1, w * 0.9, 0.018, -0.022), (-0.1, w, 0.022, -0.026)], 2.6, 2, 16))
        add_stock(kit, grip, steel, "classic", back + 0.06, -0.01,
                  kit.uniform("stock_length", 0.26, 0.34), 0.05, w)
    else:
        stock = kit.choose("stock", "wire", "folded", "none",
                           *(("classic",) if form == "drum" else ("skeleton", "tube")))
        if stock != "none":
            add_stock(kit, grip, steel, stock, back + 0.005, 0.0,
                      kit.uniform("stock_length", 0.16, 0.26), kit.uniform("drop", 0.0, 0.05),
                      w * 0.9)
    if form in ("drum", "compact") or kit.chance("fore_grip", 0.3):
        if form == "drum" and kit.chance("vertical_grip", 0.6):
            add_grip(kit, grip, 0.16, -0.01, 0.08, 0.016, w * 0.75, 8)
        else:
            add_handguard(kit, grip, 0.07, 0.09 + 0.75 * long, w * 0.95, 0.02, -0.008, 3.0, 0)
    add_sights(kit, steel, back + 0.04, 0.08 + 0.9 * long, tall, 0.008, 0.018)
    if kit.chance("dot", 0.25):
        add_scope(kit, -0.02, tall, 0.07, 0.015)


def shotgun(kit: Kit, steel: Material, grip: Material) -> None:
    """Shotguns: pump action, two barrels side by side or one above the other, sawn-off."""
    form = kit.choose("form", "pump", "pump", "double", "over_under", "tactical", "sawn_off")
    long = kit.uniform("barrel", 0.45, 0.75) * {"sawn_off": 0.45, "tactical": 0.8}.get(form, 1.0)
    w, r = kit.uniform("width", 0.018, 0.024), 0.011
    add_receiver(kit, steel, [(-0.13, -0.045, 0.012, w * 0.8), (-0.06, -0.048, 0.02, w * 0.9),
                              (0.08, -0.045, 0.018, w * 0.9)])
    if form in ("double", "sawn_off"):
        kit.both(steel, bar(0.07, 0.08 + long, r, 0.0, r * 1.05))
        kit.add(steel, box(long, 0.006, 0.008).at(0.08 + long / 2, 0, 0.01))
        kit.both(steel, tube([(-0.09, 0.012, 0.016), (-0.11, 0.012, 0.032)], 0.004, 6))
    elif form == "over_under":
        kit.add(steel, bar(0.07, 0.08 + long, r, 0.004), bar(0.07, 0.08 + long, r, -0.02),
                box(long, 0.006, 0.006).at(0.08 + long / 2, 0, 0.02))
    else:
        kit.add(steel, bar(0.07, 0.08 + long, r, 0.004),
                bar(0.07, 0.06 + long * kit.uniform("tube", 0.5, 0.98), r * 1.1, -0.022))
    start = 0.1 + (0.12 * long if form in ("pump", "tactical") else 0.0)
    reach = kit.uniform("fore", 0.13, 0.22)
    add_handguard(kit, grip, start, start + reach, w * 1.0, 0.02, -0.022, 2.4, 0)
    if form in ("pump", "tactical"):
        for k in range(6):
            kit.add(grip, cylinder(w * 1.06, 0.01, 16).turned("y",
                90).at(start + (k + 0.8) / 6.6 * reach, 0, -0.022))
    stock = {"sawn_off": "none", "tactical": kit.choose("stock", "tube", "folded", "none",
        "skeleton")}.get(form, kit.choose("wood_stock", "classic", "straight"))
    if stock in ("none", "folded", "tube", "skeleton"):
        if form == "sawn_off":
            path = smooth_path([(-0.1, 0, -0.02), (-0.15, 0, -0.035), (-0.2, 0, -0.075),
                                (-0.225, 0, -0.12)], 5)
            kit.add(grip, tube(path, np.linspace(0.021, 0.019, len(path)).tolist(), 12))
        else:
            add_grip(kit, grip, -0.1, -0.038, 0.1, 0.022, w * 0.75, 20)
    if stock != "none":
        add_stock(kit, grip, steel, stock, -0.12, -0.015, kit.uniform("stock_length", 0.26, 0.36),
                  kit.uniform("drop", 0.03, 0.07), w * 0.95)
    add_guard(kit, steel, 0.0, -0.045, 0.08, 0.03)
    if form == "tactical" and kit.chance("magazine", 0.4):
        add_magazine(kit, BLACK, kit.choose("magazine_kind", "straight", "drum"), 0.05, -0.045,
                     0.06, 0.13, w * 0.8)
    if form == "tactical" and kit.chance("shield", 0.5):
        kit.add(BLACK, lathe([(r * 1.5, 0), (r * 1.9, 0), (r * 1.9, long * 0.6),
                              (r * 1.5, long * 0.6)], 16, loop=True).turned("y", 90).at(0.08, 0,
                                                                                        0.004))
    kit.add(GOLD, ball(0.008, 0.006, 0.008, 8).at(0.07 + long, 0, 0.018))


def machine_gun(kit: Kit, steel: Material, grip: Material) -> None:
    """Machine guns on a bipod or tripod, with belt, pan or magazine; or with rotating barrels."""
    form = kit.choose("form", "belt", "belt", "pan", "top", "heavy", "rotary")
    long, w = kit.uniform("barrel", 0.45, 0.7), kit.uniform("width", 0.025, 0.034)
    back, tall = -kit.uniform("body", 0.18, 0.28), kit.uniform("height", 0.03, 0.042)
    add_receiver(kit, steel, [(back, -tall, tall, w), (0.0, -tall, tall, w),
                              (0.12, -tall * 0.8, tall * 0.8, w)], 0.006)
    if form == "rotary":
        ring = kit.uniform("ring", 0.032, 0.05)
        for angle in around(6):
            a = np.radians(angle)
            kit.add(steel, bar(0.1, 0.1 + long, 0.009, ring * np.sin(a), ring * np.cos(a), 8))
        for x in (0.12, 0.12 + 0.45 * long, 0.08 + long):
            kit.add(BLACK, cylinder(ring * 1.4, 0.02, 20).turned("y", 90).at(x))
        kit.add(steel, cylinder(ring * 1.6, 0.14, 20, 0.01).turned("y", 90).at(0.04))
    else:
        add_barrel(kit, steel, 0.1, 0.1 + long, kit.uniform("barrel_radius", 0.011, 0.015),
                   kit.choose("tip", "hider", "jacket", "jacket", "bell"))
    if form == "pan":
        add_magazine(kit, BLACK, "pan", 0.03, tall, 0, 0, w)
    elif form == "top":
        add_magazine(kit, BLACK, "top", 0.02, tall - 0.005, 0.045,
                     kit.uniform("magazine_length", 0.16, 0.22), w * 0.7)
    else:
        kit.add(grip if kit.rng.random() < 0.5 else BLACK,
                box(kit.uniform("ammunition", 0.1, 0.18), 0.1, 0.12, 0.008).at(0.03,
                    kit.choose("belt_side", -1, 1) * (w + 0.045), -0.07))
        kit.add(steel, box(0.2, 2.2 * w, 0.02, 0.006).at(-0.0, 0, tall + 0.008))
    mount = "tripod" if form in ("heavy", "rotary") and kit.chance("tripod", 0.75) else "bipod"
    if mount == "tripod":
        z, reach = -tall - 0.03, kit.uniform("legs", 0.28, 0.45)
        kit.add(steel, cylinder(0.03, 0.08, 14).at(0.0, 0, z))
        for angle in (0, 135, 225):
            a = np.radians(angle)
            foot = (1.2 * reach * np.cos(a), 1.2 * reach * np.sin(a), z - 0.7 * reach)
            kit.add(steel, rod((0, 0, z - 0.02), foot, 0.013, 8),
                    ball(0.05, 0.05, 0.02, 10).at(*foot))
        for s in (-1, 1):
            kit.add(grip, rod((back - 0.06, s * 0.045, -0.055), (back - 0.06, s * 0.045, 0.05),
                              0.014, 8))
        kit.add(steel, box(0.08, 0.11, 0.02, 0.004).at(back - 0.03, 0, -0.03),
                box(0.08, 0.11, 0.02, 0.004).at(back - 0.03, 0, 0.035))
        if kit.chance("shield", 0.3):
            kit.add(grip, box(0.012, 0.42, 0.3, 0.004).at(0.14, 0, 0.04))
    else:
        add_grip(kit, grip, back + 0.1, -tall, 0.1, 0.023, w * 0.65, 18)
        add_guard(kit, steel, back + 0.19, -tall, 0.075, 0.03)
        add_stock(kit, grip, steel, kit.choose("stock", "classic", "straight", "skeleton"),
                  back + 0.01, 0.0, kit.uniform("stock_length", 0.22, 0.3), 0.04, w * 0.8)
        add_bipod(kit, steel, 0.1 + long * kit.uniform("bipod_place", 0.4, 0.9), -0.012,
                  kit.uniform("bipod", 0.22, 0.32), kit.chance("bipod_folded", 0.25))
        if kit.chance("handle", 0.5):
            kit.add(grip, tube([(0.08, 0, tall - 0.01), (0.1, 0, tall + 0.06),
                                (0.2, 0, tall + 0.06)], 0.01, 8))
        else:
            add_handguard(kit, grip, 0.11, 0.11 + 0.4 * long, w, 0.026, -0.006, 3.0, 4)
    add_sights(kit, steel, back + 0.08, 0.08 + long, tall + 0.01, 0.012, 0.025)


def sniper(kit: Kit, steel: Material, grip: Material) -> None:
    """Sniper rifles: long, heavy, on a bipod; with a chassis, or a bullpup."""
    long, w = kit.uniform("barrel", 0.55, 0.9), kit.uniform("width", 0.02, 0.028)
    back = -kit.uniform("body", 0.16, 0.3)
    add_receiver(kit, steel, [(back, -0.035, 0.024, w), (0.1, -0.035, 0.024, w),
                              (0.2, -0.026, 0.02, w)])
    add_barrel(kit, steel, 0.16, 0.16 + long, kit.uniform("barrel_radius", 0.01, 0.016),
               kit.choose("tip", "brake", "brake", "silencer", "plain"))
    reach = kit.uniform("fore", 0.1, 0.4)
    add_handguard(kit, grip, 0.18, 0.2 + reach, w * 1.05, 0.028, -0.01, 5.0,
                  kit.choose("holes", 0, 4))
    add_stock(kit, grip, steel, kit.choose("stock", "thumbhole", "skeleton", "tube", "classic"),
              back + 0.01, 0.0, kit.uniform("stock_length", 0.2, 0.32),
              kit.uniform("drop", 0.0, 0.04), w * 0.9)
    add_grip(kit, grip, back + 0.07, -0.032, 0.1, 0.022, w * 0.7, 14)
    add_guard(kit, steel, back + 0.16, -0.033, 0.075, 0.03)
    add_magazine(kit, BLACK, "straight", kit.uniform("magazine_place", 0.02, 0.08), -0.032, 0.08,
                 kit.uniform("magazine_length", 0.06, 0.13), w * 0.7)
    add_scope(kit, 0.0, 0.026, kit.uniform("scope_length", 0.28, 0.42),
              kit.uniform("scope_radius", 0.022, 0.034))
    add_bipod(kit, steel, 0.18 + reach * 0.85, -0.03, kit.uniform("bipod", 0.2, 0.3),
              kit.chance("bipod_folded", 0.3))
    kit.add(steel, rod((-0.06, -w * 0.8, 0.01), (-0.08, -0.065, -0.004), 0.006),
            ball(0.024, 0.024, 0.024, 10).at(-0.082, -0.068, -0.006))
    if kit.chance("rear_leg", 0.4):
        kit.add(steel, rod((back - 0.14, 0, -0.03), (back - 0.14, 0, -0.16), 0.008, 8))


def launcher(kit: Kit, steel: Material, grip: Material) -> None:
    """Grenade launchers with a drum or one barrel; shoulder-fired rocket launchers."""
    form = kit.choose("form", "drum", "single", "rocket", "tube", "box")
    w = 0.024
    if form in ("drum", "single"):
        long = kit.uniform("barrel", 0.16, 0.36)
        bore = kit.uniform("bore", 0.024, 0.032)
        size = kit.uniform("drum", 0.055, 0.08) if form == "drum" else bore * 1.2
        add_receiver(kit, steel, [(-0.14, -0.04, 0.02, w * 0.9), (-0.03, -0.05, 0.035, w),
                                  (0.0, -0.05, 0.035, w)])
        kit.add(steel, cylinder(size, 0.13 if form == "drum" else 0.08, 22, 0.006).turned("y",
            90).at(0.06, 0, -0.6 * (size - bore)))
        kit.add(steel, lathe([(bore * 0.8, 0), (bore * 1.15, 0), (bore * 1.15, long),
                              (bore * 0.8, long)], 20, loop=True).turned("y", 90).at(0.1))
        kit.add(BLACK, bar(0.1, 0.09 + long, bore * 0.82))
        if form == "drum":
            for angle in around(6, 30):
                a = np.radians(angle)
                kit.add(BLACK, bar(0.0, 0.12, 0.016, -0.6 * (size - bore) + 0.8 * size * np.sin(a),
                                   0.8 * size * np.cos(a), 8))
        add_grip(kit, grip, -0.1, -0.036, 0.1, 0.022, w * 0.8, 18)
        add_grip(kit, grip, 0.14 + 0.4 * long, -bore * 0.8, 0.09, 0.017, w * 0.7,
                 kit.uniform("fore_slant", -12, 8))
        add_guard(kit, steel, -0.01, -0.045, 0.075, 0.03)
        add_stock(kit, grip, steel, kit.choose("stock", "skeleton", "tube", "classic", "wire"),
                  -0.13, -0.005, kit.uniform("stock_length", 0.2, 0.3), 0.03, w * 0.9)
        if kit.chance("scope", 0.5):
            add_scope(kit, -0.04, 0.035, 0.09, 0.018)
        else:
            add_sights(kit, steel, -0.1, 0.08 + long, 0.02, bore, 0.03)
        return
    long, r = kit.uniform("tube", 0.8, 1.5), kit.uniform("bore", 0.02, 0.06)
    front, back = 0.45 * long, -0.55 * long
    paint_ = POLYMERS[1] if kit.rng.random() < 0.6 else steel
    if form == "rocket":
        r = kit.uniform("thin", 0.018, 0.024)
        kit.add(steel, tube([(back, 0, 0), (back + 0.1, 0, 0), (back + 0.16, 0, 0), (front, 0, 0)],
                            [2.4 * r, r, r, r], 16))
        kit.add(grip, body([(0.12 * long, 1.5 * r, 1.5 * r, 0),
                            (-0.2 * long, 1.8 * r, 1.8 * r, 0)], 2, 2, 18))
        if kit.chance("loaded", 0.7):
            head = kit.uniform("head", 1.6, 2.6) * r
            profile = [(r * 0.8, 0), (head, 0.1), (head, 0.16), (head * 0.5, 0.26), (0.006, 0.32)]
            kit.add(POLYMERS[1], lathe([(a, b) for a, b in profile], 20).turned("y",
                90).at(front - 0.01))
    else:
        side = 6 if form == "box" else 24
        kit.add(paint_, lathe([(r * 1.15, back), (r, back + 0.05), (r, front - 0.05),
                               (r * 1.15, front), (r * 0.9, front), (r * 0.9, front - 0.02)],
                              side).turned("y", 90))
        for x in (back, -0.1 * long, front - 0.04):
            kit.add(BLACK, cylinder(1.25 * r, 0.04, side).turned("y", 90).at(x + 0.02))
    add_receiver(kit, steel, [(-0.08, -r - 0.05, -r * 0.6, w), (0.0, -r - 0.055, -r * 0.6, w),
                              (0.1, -r - 0.04, -r * 0.6, w)])
    add_grip(kit, grip, -0.03, -r - 0.045, 0.1, 0.02, w * 0.75, 10)
    add_guard(kit, steel, 0.06, -r - 0.05, 0.07, 0.03)
    if kit.chance("second_grip", 0.6):
        add_grip(kit, grip, kit.choose("grip_place", 0.2, -0.25), -r * 0.8, 0.1, 0.018, w * 0.7,
                 kit.uniform("fore_slant", -10, 15))
    if kit.chance("shoulder_rest", 0.5):
        kit.add(RUBBER, prism([(back * 0.35 - 0.1, -r * 0.8), (back * 0.35 + 0.1, -r * 0.8),
                               (back * 0.35 + 0.03, -r - 0.06), (back * 0.35 - 0.1, -r - 0.07)],
                              1.4 * r, 0.006))
    sight = kit.choose("sight", "iron", "scope", "box")
    up = r * 1.0
    if sight == "iron":
        add_sights(kit, steel, -0.1, 0.3 * long, up, up, 0.06)
    elif sight == "scope":
        kit.add(steel, box(0.1, 0.03, 0.06, 0.004).at(0.05, r * 0.9, r * 0.6))
        add_scope(kit, 0.05, up + 0.01, 0.16, 0.018)
    else:
        kit.add(BLACK, box(kit.uniform("sight_length", 0.1, 0.22), 0.06,
                           kit.uniform("sight_height", 0.07, 0.14), 0.008).at(0.1,
                               kit.choose("sight_side", -1, 1) * r * 0.9, r))
