"""Cars, vans, buses, lorries. Lengths in metres, the front toward +x, wheels on z = 0."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from data_gen.catalogues import bodies, solids
from data_gen.catalogues.bodies import through
from data_gen.catalogues.families.car_work import buggy, formula, lorry, vintage
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    LIGHT,
    RED_LIGHT,
    WHITE,
    Kit,
    fabric,
    metal,
    paint,
    pick,
)
from data_gen.catalogues.families.wheels import wheel
from data_gen.catalogues.solids import (
    ball,
    box,
    cylinder,
    loft,
    pane,
    pillow,
    prism,
    rod,
    smooth_path,
    tube,
)
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

Span = tuple[float, float]


class Form(NamedTuple):
    """Ranges of the parameters of a car body. In comments, `a / b` is the ratio of a to b."""

    length: Span
    width: Span
    height: Span
    wheel: Span
    clearance: Span
    hood: Span  # from the nose to the foot of the windscreen / length
    boot: Span  # from the tail to the foot of the rear window / length
    rake: Span  # of the windscreen: horizontal / vertical
    back: Span  # of the rear window: horizontal / vertical
    belt: Span  # height of the window sill / height
    nose: Span  # height of the nose / belt
    round: Span  # setback of the corners behind the nose / width
    panes: int  # on each side


FORMS = {
    "hatchback": Form((3.4, 4.2), (1.6, 1.8), (1.38, 1.56), (0.28, 0.33), (0.14, 0.2), (0.18, 0.26),
                      (0.005, 0.02), (0.6, 1.0), (0.15, 0.7), (0.58, 0.66), (0.72, 0.9),
                      (0.08, 0.2), 2),
    "saloon": Form((4.2, 5.3), (1.7, 1.9), (1.35, 1.52), (0.3, 0.35), (0.13, 0.2), (0.22, 0.29),
                   (0.12, 0.2), (0.6, 1.0), (0.5, 0.9), (0.6, 0.68), (0.72, 0.95), (0.06, 0.18), 2),
    "estate": Form((4.4, 5.1), (1.7, 1.9), (1.4, 1.6), (0.3, 0.35), (0.14, 0.22), (0.22, 0.28),
                   (0.005, 0.02), (0.6, 0.9), (0.15, 0.5), (0.6, 0.66), (0.75, 0.92),
                   (0.06, 0.16), 3),
    "coupe": Form((3.9, 4.9), (1.7, 1.95), (1.15, 1.36), (0.31, 0.36), (0.1, 0.16), (0.28, 0.42),
                  (0.03, 0.14), (0.7, 1.1), (0.9, 1.5), (0.6, 0.7), (0.66, 0.85), (0.12, 0.24), 1),
    "supercar": Form((4.2, 4.7), (1.9, 2.08), (1.02, 1.18), (0.33, 0.37), (0.09, 0.13),
                     (0.16, 0.24), (0.18, 0.34), (1.0, 1.4), (0.5, 1.2), (0.62, 0.74), (0.4, 0.6),
                     (0.15, 0.3), 1),
    "roadster": Form((3.4, 4.4), (1.55, 1.85), (1.15, 1.3), (0.29, 0.35), (0.1, 0.17), (0.32, 0.45),
                     (0.15, 0.25), (0.3, 0.5), (0.1, 0.2), (0.62, 0.72), (0.65, 0.9),
                     (0.12, 0.28), 1),
    "suv": Form((4.1, 5.2), (1.8, 2.05), (1.62, 1.98), (0.35, 0.43), (0.2, 0.34), (0.18, 0.28),
                (0.005, 0.02), (0.35, 0.8), (0.1, 0.5), (0.58, 0.66), (0.8, 0.97), (0.04, 0.14), 3),
    "jeep": Form((3.2, 4.1), (1.55, 1.8), (1.65, 1.9), (0.36, 0.46), (0.25, 0.4), (0.3, 0.4),
               (0.01, 0.03), (0.08, 0.2), (0.04, 0.1), (0.55, 0.64), (0.92, 1.0), (0.01, 0.04), 2),
    "microcar": Form((2.2, 3.2), (1.4, 1.6), (1.42, 1.6), (0.24, 0.29), (0.12, 0.18), (0.08, 0.18),
                     (0.01, 0.1), (0.5, 0.8), (0.1, 0.6), (0.52, 0.62), (0.75, 0.95),
                     (0.1, 0.3), 1),
    "van": Form((4.3, 6.6), (1.8, 2.1), (1.85, 2.75), (0.31, 0.37), (0.16, 0.24), (0.06, 0.16),
              (0.003, 0.01), (0.5, 0.95), (0.03, 0.15), (0.48, 0.58), (0.7, 0.9), (0.05, 0.15), 3),
    "bus": Form((7.0, 13.0), (2.35, 2.55), (2.8, 3.4), (0.45, 0.52), (0.25, 0.35), (0.003, 0.006),
                (0.002, 0.004), (0.08, 0.35), (0.05, 0.2), (0.42, 0.52), (0.98, 1.0),
                (0.02, 0.08), 7),
    "double_decker": Form((8.5, 11.5), (2.45, 2.55), (4.1, 4.5), (0.48, 0.52), (0.25, 0.32),
                          (0.003, 0.006), (0.002, 0.004), (0.08, 0.35), (0.05, 0.15), (0.28, 0.32),
                          (0.98, 1.0), (0.02, 0.06), 7),
    "pickup": Form((4.7, 5.9), (1.75, 2.05), (1.6, 1.95), (0.34, 0.43), (0.22, 0.36), (0.2, 0.28),
                   (0.3, 0.45), (0.45, 0.85), (0.08, 0.2), (0.58, 0.66), (0.82, 0.97),
                   (0.03, 0.12), 2),
}


class Shell(NamedTuple):
    """Dimensions of the finished body, used to place the details."""

    front: float
    rear: float
    half: float  # half width
    belt: float
    height: float
    low: float  # the sill
    screen: float  # x of the lower edge of the windscreen
    back: float  # x of the lower edge of the rear window
    shift: float  # setback of the corners behind the middle of the nose


def _at(table: Sequence[Span], places: np.ndarray) -> np.ndarray:
    """One column of `through`, with positions in any order."""
    return np.asarray(through(sorted(table), places)[:, 0])


def _shell(kit: Kit, form: Form, kind: str, skin: Material) -> Shell:
    """Adds the body with wheel arches, windows and doors, and the wheels.

    Sections perpendicular to x go from the middle of the floor around the sill, the arch, the side,
    the window and the roof. Faces between them are selected as glass or as gaps.
    """
    draw = {name: kit.uniform(name, *span) for name, span in form._asdict().items()
            if name != "panes"}
    length, half, height = draw["length"], draw["width"] / 2, draw["height"]
    radius, low, belt = draw["wheel"], draw["clearance"], draw["belt"] * height
    front, rear = length / 2, -length / 2
    screen, back = front - draw["hood"] * length, rear + draw["boot"] * length
    roof_front, roof_rear = screen - draw["rake"], back + draw["back"]
    if kind == "pickup":
        cab = kit.choose("cab", 1.5, 2.0, 2.6)
        back = max(screen - cab, rear + 1.1)
        roof_rear = back + draw["back"]
    nose, tail = draw["nose"] * belt, kit.uniform("tail", 0.88, 1.04) * belt
    crown = kit.uniform("crown", 0.01, 0.07) * height
    slope = kit.uniform("roof_slope", 0.0, 0.09)
    tumble = kit.uniform("tumblehome", 0.74, 0.95 if belt < 0.6 * height else 0.84)
    swell = kit.uniform("swell", 0.9, 1.0)
    shift = draw["round"] * half
    pit = kind in ("roadster", "jeep") or kind == "pickup"
    floor = low + 0.28 if kind != "pickup" else 0.62 * belt

    overhang = kit.uniform("overhang", 1.35, 1.8) * radius
    axles = [front - overhang - 0.5 * shift, rear + overhang * kit.uniform("tail_end", 1.0, 1.4)]
    if kind in ("bus", "double_decker"):
        axles = [front - 0.22 * length, rear + 0.27 * length]
    arch = 1.13 * radius

    panes = form.panes if kind != "pickup" else (1 if cab < 2 else 2)
    blind = kind == "van" and kit.chance("panel_van", 0.5)
    a, b = screen - 0.2 * draw["rake"], back + 0.3 * (roof_rear - back) + 0.12
    pillars = np.linspace(b, a, panes + 1)
    doors = [p for p in pillars[1:-1] if low < p + 10] if not blind else [pillars[-2]]

    cuts = [front, front - 0.04, front - 0.15, screen + 0.02, screen, rear, rear + 0.05,
            rear + 0.2, back, roof_front, roof_rear, *np.linspace(screen, roof_front, 5),
            *np.linspace(back, roof_rear, 4), *np.linspace(rear + 0.3, front - 0.25, 9),
            *(pillars + 0.04), *(pillars - 0.04), *(d + 0.012 for d in doors)]
    if kind in ("roadster", "jeep"):
        pit_front, pit_rear = screen - 0.12, max(back - 0.1, rear + 0.06)
        pit_rear = pit_rear if kind == "jeep" else max(screen - 1.6, back)
    elif kind == "pickup":
        pit_front, pit_rear = back - 0.06, rear + 0.07
    if pit:
        cuts += [pit_front, pit_front + 0.01, pit_rear, pit_rear - 0.01]
    for x in axles:
        cuts += [x + side * arch * c for c in (1.001, 1.0, 0.92, 0.7, 0.38, 0)
                 for side in (-1, 1)]
    places = np.unique(np.round(cuts, 4))

    deck = _at([(front, nose * 0.8), (front - 0.05, nose * 0.97), (front - 0.2, nose),
                (screen, belt * kit.uniform("scuttle", 0.93, 1.0)), ((screen + back) / 2, belt),
                (min(back, screen - 0.6), (belt + tail) / 2 if back > rear + 0.3 else tail),
                (rear + 0.06, tail * 0.97), (rear, tail * 0.82)], places)
    if kind in ("bus", "double_decker", "van"):
        deck = np.maximum(deck, _at([(rear, belt * 0.97), (screen - 0.2, belt), (front, 0)],
                                    places))
    glass = np.where((places > back) & (places < screen), 1.0, 0.0)
    if kind in ("roadster", "jeep"):
        glass[:] = 0
    top_z = height - crown - belt
    rise = _at([(screen, 0.0), ((screen + roof_front) / 2, 0.57 * top_z),
                (roof_front, 0.94 * top_z),
                (0.75 * roof_front + 0.25 * roof_rear, top_z),
                (roof_rear + 0.01, top_z * (1 - slope)), ((roof_rear + back) / 2, 0.56 * top_z),
                (back, 0.0)], places)
    top = deck + glass * np.maximum(rise, 0)
    if pit:
        hole = (places > pit_rear - 1e-3) & (places < pit_front + 1e-3)
        top = np.where(hole, floor, top)
    ends = np.abs(places / front)
    wide = half * (1 - kit.uniform("taper", 0.03, 0.1) * ends**4 - 0.06 * ends**16)
    sill = low + 0.12 * ends**10 + np.where(places > 0, kit.uniform("chin", 0, 0.08) * ends**4, 0)
    bows = np.full(len(places), -1.0)
    for x in axles:
        bows = np.maximum(bows, radius + np.sqrt(np.maximum(arch**2 - (places - x) ** 2, 0))
                          * np.where(np.abs(places - x) <= arch, 1, 0)
                          - np.where(np.abs(places - x) <= arch * 1.0005, 0, 9))
    bows = np.minimum(np.maximum(bows, sill), deck - 0.06)
    recess = kit.hide("floor_recess", 0.01, 0.2)
    inside = np.clip(np.minimum(places - rear, front - places) - 0.1, 0, 0.3) / 0.3
    tyre = kit.uniform("tyre", 0.5, 0.72) * radius
    rings = []
    for k in range(len(places)):
        w, s, t, d, p = wide[k], sill[k], top[k], deck[k], bows[k]
        inner = half - tyre - 0.05
        h = t - d
        f = np.array([0, 0.06, 0.86, 0.95, 1, 1, 1])
        if h >= 0:
            lean = 1 - (1 - tumble) * h / max(top_z, 0.2)
            y = w * np.array([0.91, 0.9, 0.9 * lean, 0.87 * lean, 0.78 * lean, 0.4 * lean, 0])
            z = d + f * h + crown * (1 - (y / w) ** 2)
        else:
            y = w * np.array([0.93, 0.9, 0.89, 0.88, 0.8, 0.4, 0])
            z = d + np.array([0, 0, 0.5, 0.97, 1, 1, 1]) * h
        up = s + recess * inside[k]
        side = p + np.array([0.32, 0.7]) * (d - p)
        y = np.concatenate([[0, inner * 0.8, inner, inner, w * 0.97, w, w * (1 + swell) / 2,
                             w * swell * 0.98], y * swell])
        z = np.concatenate([[up, up, s, p, p, *side, d - 0.02], z])
        ring = np.concatenate(
            [np.stack([y, z], 1), np.stack([-y, z], 1)[len(y) - 2 : 0 : -1]]
        )
        bow = shift * np.sign(places[k]) * ends[k] ** 3 if places[k] > 0 else (
            0.5 * shift * -(ends[k] ** 3))
        if h > 0 and places[k] > roof_front:
            bow += 0.12 * (places[k] - roof_front) / draw["rake"]
        x = places[k] - bow * (ring[:, 0] / half) ** 2
        rings.append(np.column_stack([x, ring]))
    hull = loft(np.array(rings))

    # Which faces are glass and which are gaps between doors, by section and point.
    size, middle = len(rings[0]), (places[1:] + places[:-1]) / 2
    masks = np.zeros((2, len(places) - 1, size), bool)

    def paint_faces(mask: int, where: Any, first: int, last: int) -> None:
        for j in range(first, last):
            masks[mask, where, j] = masks[mask, where, size - 1 - j] = True

    cabin = (middle > back) & (middle < screen)
    if kind not in ("roadster", "jeep"):
        panes_on = cabin & (middle < a) & (middle > b)
        for p in pillars:
            panes_on &= np.abs(middle - p) > 0.035
        if blind:
            panes_on &= middle > pillars[-2]
        paint_faces(0, panes_on, 9, 10)
        rake = screen - roof_front
        paint_faces(0, (middle < screen - 0.04 * rake) & (middle > roof_front + 0.06 * rake), 11,
                    14)
        if not blind:
            rake = roof_rear - back
            paint_faces(0, (middle > back + 0.12 * rake) & (middle < roof_rear - 0.1 * rake), 11,
                        14)
    for d in doors:
        paint_faces(1, (middle > d - 0.002) & (middle < d + 0.013), 4, 8)
    bumper = kit.chance("dark_bumpers", 0.4)
    if bumper:
        paint_faces(1, (middle > front - 0.12) | (middle < rear + 0.08), 2, 5)
    tri = np.repeat(masks[:, :, :].reshape(2, -1), 2, axis=1)
    tri = np.pad(tri, [(0, 0), (0, len(hull.faces) - tri.shape[1])])
    glass_part, rest = solids.split(hull, tri[0])
    dark_part, rest = solids.split(rest, tri[1][~tri[0]])
    kit.add(DARK_GLASS, glass_part)
    kit.add(BLACK, dark_part)
    kit.add(skin, rest)

    hub = pick(kit.rng, (CHROME, metal(kit.rng), BLACK))
    spokes = kit.choose("spokes", 5, 6, 7, 10)
    if kind in ("bus", "double_decker") and length > 10.5 and kit.chance("third_axle", 0.5):
        axles.append(axles[1] - 2.1 * radius if axles[1] - 3.2 * radius > rear else axles[1])
        axles = axles[:2] + ([axles[2]] if axles[2] != axles[1] else [])
    for k, x in enumerate(axles[:2]):
        x -= shift * (0.9 if k == 0 else -0.45) * abs(x / front) ** 3
        for material, part in wheel(radius, tyre, spokes, hub):
            kit.both(material, part.at(x, half - tyre / 2 - 0.03, radius))
    return Shell(front, rear, half * swell, belt, height, low, screen, back, shift)


def _fittings(kit: Kit, form: Shell, kind: str, skin: Material, trim: Material) -> None:
    """Adds lamps, grille, plates, mirrors, spoiler, rails, and the interior of an open body."""
    front, rear, half, belt = form.front, form.rear, form.half, form.belt
    nose = kit.visible["nose"] * belt
    lamp_z, y = (nose + form.low) * 0.56, half * 0.66
    corner = front - form.shift * 0.44
    size = 0.06 * form.height if kind in ("bus", "double_decker") else 0.1 * form.height
    shape = kit.choose("lamps", "round", "wide", "tall")
    if shape == "round":
        lamp = cylinder(size, 0.16, 18, 0.03).turned("y", 90)
    else:
        lamp = pillow(0.22, *((0.5 * half, size) if shape == "wide" else (size, 1.7 * size)), 0.04,
                      2)
    kit.both(LIGHT, lamp.at(corner - 0.06, y, lamp_z))
    grille = kit.uniform("grille", 0.4, 1.1) * half, kit.uniform("grille_height", 0.08, 0.28) * nose
    kit.add(trim, box(0.16, *grille, 0.02).at(front - 0.065, 0, lamp_z))
    kit.add(BLACK, box(0.06, half * 1.1, 0.1 * nose, 0.02).at(front - 0.02, 0, form.low + 0.2))
    kit.both(RED_LIGHT, pillow(0.12, half * 0.3, belt * 0.14, 0.03, 2)
             .at(rear + 0.04 + 0.2 * form.shift, half * 0.7, belt * 0.78))
    kit.add(
        WHITE,
        box(0.08, 0.4, 0.1).at(rear + 0.025, 0, belt * 0.5),
        box(0.06, 0.4, 0.09).at(front - 0.008, 0, form.low + 0.2),
    )
    reach = 0.5 if kind == "bus" else 0.12
    if kind not in ("double_decker",):
        kit.both(skin, ball(0.14, 0.24, 0.15, 12).at(form.screen - 0.32, half + 0.06, belt + 0.1))
        kit.both(BLACK, rod((form.screen - 0.32, half * 0.93, belt - 0.05),
                            (form.screen - 0.32, half + reach * 0.3, belt + 0.08), 0.02, 6))
    kit.both(BLACK, cylinder(0.035, 0.2, 10).turned("y", 90).at(rear + 0.02, half * 0.6,
                                                                form.low + 0.1))
    if kind in ("coupe", "supercar", "saloon", "hatchback") and kit.chance(
        "spoiler", 0.6 if kind in ("coupe", "supercar") else 0.15
    ):
        high = kit.uniform("spoiler_height", 0.08, 0.3)
        kit.add(skin, bodies.wing([(rear + 0.3, -half * 0.9, belt + high, 0.3),
                                   (rear + 0.3, half * 0.9, belt + high, 0.3)], 0.1))
        kit.both(BLACK, box(0.1, 0.03, high + 0.12).at(rear + 0.2, half * 0.6,
                                                       belt + high / 2 - 0.06))
    if kind in ("suv", "estate", "van") and kit.chance("roof_load", 0.45):
        z, x = form.height - 0.05, (form.screen + form.back) / 2 - 0.1
        long = 0.45 * (form.screen - form.back)
        load = kit.choose("load", "rails", "box", "rack")
        if load == "box":
            kit.add(BLACK, pillow(1.6, 0.8, 0.34, 0.15).at(x, 0, z + 0.22))
            kit.add(BLACK, box(0.06, 1.1, 0.12).at(x - 0.4, 0, z),
                    box(0.06, 1.1, 0.12).at(x + 0.4, 0, z))
        else:
            ys = (-0.62, 0.62) if load == "rails" else (-0.6, -0.3, 0, 0.3, 0.6)
            for share in ys:
                kit.add(trim, box(long, 0.04, 0.04).at(x, share * half, z + 0.12))
            for at in (-0.45, 0, 0.45):
                kit.add(trim, box(0.05, 1.24 * half, 0.05).at(x + at * long, 0, z + 0.08),
                        *(box(0.05, 0.04, 0.2).at(x + at * long, s * 0.6 * half, z)
                          for s in (-1, 1)))
    if kind == "double_decker" or kind == "bus":
        _bus_windows(kit, form, kind, skin)
    if kind in ("roadster", "jeep"):
        _cockpit(kit, form, kind, skin)
    if kind == "pickup":
        load = kit.choose("load", "none", "none", "cover", "canopy", "bars")
        long, x = form.back - rear, (form.back + rear) / 2
        if load == "cover":
            kit.add(BLACK, box(long - 0.12, half * 1.78, 0.05, 0.01).at(x, 0, belt))
        elif load == "canopy":
            high = (form.height - belt) * kit.uniform("canopy", 0.85, 1.15)
            kit.add(skin, prism([(rear + 0.05, belt - 0.03), (form.back - 0.02, belt - 0.03),
                                 (form.back - 0.02, belt + high), (rear + 0.2, belt + high)],
                                half * 1.72, 0.08))
            kit.both(DARK_GLASS, box(long * 0.7, 0.02, high * 0.5).at(x, half * 0.86,
                                                                      belt + high * 0.5))
        elif load == "bars":
            for at in (0.1, 0.5, 0.9):
                bow = [(0, -half * 0.85, belt - 0.02), (0, -half * 0.8, form.height - 0.15),
                       (0, half * 0.8, form.height - 0.15), (0, half * 0.85, belt - 0.02)]
                kit.add(BLACK, tube(bow, 0.03, 6).at(rear + 0.05 + at * (long - 0.15)))


def _bus_windows(kit: Kit, form: Shell, kind: str, skin: Material) -> None:
    """Adds the windows of the upper deck, the destination sign, and equipment on the roof."""
    length = form.front - form.rear
    if kind == "double_decker":
        z, high = form.height * 0.76, form.height * 0.15
        width = 0.9 * 2 * form.half * kit.visible["tumblehome"]
        kit.add(DARK_GLASS, box(length * 0.93, width + 0.14, high, 0.02).at(0, 0, z))
        for x in np.linspace(-0.36, 0.36, 6) * length:
            kit.both(BLACK, box(0.1, 0.02, high).at(x, width / 2 + 0.075, z))
        kit.add(skin, box(length * 0.985, width + 0.2, 0.12 * form.height, 0.03).at(0, 0,
            0.6 * form.height))
    elif kit.chance("roof_units", 0.6):
        for x in (-0.22, 0.2):
            kit.add(WHITE, pillow(0.17 * length, 1.6, 0.3, 0.12, 2).at(x * length, 0, form.height))
    kit.add(BLACK, box(0.06, 1.5, 0.25).at(form.screen - 0.28, 0, form.height * 0.93))


def _cockpit(kit: Kit, form: Shell, kind: str, skin: Material) -> None:
    """Adds seats, steering wheel, a free-standing windscreen, a roll bar and a spare wheel."""
    half, belt, floor = form.half, form.belt, form.low + 0.28
    leather = fabric(kit.rng)
    x = form.screen - 1.0
    rows = (x,) if kind == "roadster" else (x, x - 0.85)
    for at in rows:
        if at - 0.35 < form.back and kind == "jeep":
            continue
        high = belt + 0.12 - floor
        kit.both(leather, pillow(0.5, half * 0.62, 0.24, 0.08, 2).at(at + 0.1, half * 0.42,
                                                                     floor + 0.12),
                 pillow(0.18, half * 0.6, high, 0.08, 2).turned("y", -12)
                 .at(at - 0.2, half * 0.42, floor + high / 2))
    ring = [(0.18 * np.cos(a), 0.18 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 15)]
    kit.add(BLACK, tube([(0.5 * u, half * 0.42 + v, 0.8 * u) for u, v in ring], 0.02, 6)
            .at(form.screen - 0.45, 0, belt - 0.02),
            rod((form.screen - 0.45, half * 0.42, belt - 0.02),
                (form.screen - 0.05, half * 0.42, belt - 0.12), 0.03, 6))
    rake, rise = kit.visible["rake"], form.height - belt if kind == "jeep" else 0.38
    ys = np.linspace(-1, 1, 7) * half * 0.82
    glass = np.array([[(form.screen - 0.06 - rake * t - 0.25 * form.shift * (y / half) ** 2,
                       y * (1 - 0.08 * t), belt * 0.97 + t * rise) for y in ys]
                     for t in (0, 0.5, 1)])
    kit.add(DARK_GLASS, pane(glass, 0.025))
    for line in (glass[:, 0], glass[:, -1], glass[-1]):
        kit.add(BLACK if kind == "jeep" else CHROME, tube(line, 0.025, 6))
    if kind == "jeep":
        roof = kit.choose("top", "none", "bars", "soft", "bars")
        rear = max(form.back, form.rear + 0.12)
        legs = [(rear + 0.1, belt), (x - 0.15, belt)]
        if roof in ("bars", "soft"):
            for at, z in legs:
                bow = [(at, -half * 0.84, z - 0.1), (at, -half * 0.78, form.height - 0.03),
                       (at, half * 0.78, form.height - 0.03), (at, half * 0.84, z - 0.1)]
                kit.add(BLACK, tube(bow, 0.03, 6))
            kit.both(BLACK, rod((rear + 0.1, half * 0.78, form.height - 0.03),
                                (glass[-1, 0, 0], half * 0.75, form.height - 0.03), 0.03, 6))
        if roof == "soft":
            long = glass[-1, 0, 0] - rear
            kit.add(leather, pillow(long, half * 1.66, 0.1, 0.04, 2).at(rear + long / 2, 0,
                                                                        form.height))
        if kit.chance("spare_wheel", 0.7):
            for material, part in wheel(kit.visible["wheel"], 0.24, 5, BLACK):
                kit.add(material, part.turned("z", 90).at(form.rear - 0.12, 0, belt * 0.85))
    elif kit.chance("roll_bars", 0.4):
        for s in (-1, 1):
            bow = [(0, -0.22, 0), (0, -0.18, 0.28), (0, 0.18, 0.28), (0, 0.22, 0)]
            kit.add(CHROME, tube(smooth_path(bow, 4), 0.03, 6).at(x - 0.42, s * half * 0.45,
                                                                  belt - 0.05))


def car(kit: Kit) -> None:
    """Cars of 17 subtypes. Hidden: the depth of the recess in the underside."""
    kind = kit.choose("subtype", *FORMS, "lorry", "lorry", "formula", "vintage", "buggy")
    skin, accent = paint(kit.rng), paint(kit.rng)
    if kind == "lorry":
        lorry(kit, skin)
    elif kind == "formula":
        formula(kit, skin, accent)
    elif kind == "vintage":
        vintage(kit, skin, BLACK if kit.rng.random() < 0.5 else accent)
    elif kind == "buggy":
        buggy(kit, skin, accent)
    else:
        shell = _shell(kit, FORMS[kind], kind, skin)
        _fittings(kit, shell, kind, skin, BLACK if kit.rng.random() < 0.6 else CHROME)
