"""Cars, vans, buses, lorries. Lengths in metres, the front toward +x, wheels on z = 0."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    LIGHT,
    RED_LIGHT,
    WHITE,
    Kit,
    disc,
    fabric,
    metal,
    paint,
    pick,
    rect,
    wood,
)
from data_gen.catalogues.families.wheels import wheel
from data_gen.catalogues.solids import (
    Solid,
    ball,
    body,
    box,
    cylinder,
    loft,
    pillow,
    prism,
    rod,
    sheet,
    smooth_path,
    through,
    tube,
)
from data_gen.meshes import Material

Span = tuple[float, float]


class Form(NamedTuple):
    """What a car with a pressed body is drawn from; shares are those of what stands behind `/`."""

    length: Span
    width: Span
    height: Span
    wheel: Span
    clearance: Span
    hood: Span  # from the nose to the foot of the windscreen / length
    boot: Span  # from the tail to the foot of the rear window / length
    rake: Span  # of the windscreen, lengthwise
    back: Span  # of the rear window, lengthwise
    belt: Span  # height of the window sill / height
    nose: Span  # height of the nose / belt
    round: Span  # how far the corners lie behind the nose / width
    panes: int  # on each side


_S = Form
FORMS = {
    "hatchback": _S((3.4, 4.2), (1.6, 1.8), (1.38, 1.56), (0.28, 0.33), (0.14, 0.2), (0.18, 0.26),
                    (0.005, 0.02), (0.6, 1.0), (0.15, 0.7), (0.58, 0.66), (0.72, 0.9),
                    (0.08, 0.2), 2),
    "saloon": _S((4.2, 5.3), (1.7, 1.9), (1.35, 1.52), (0.3, 0.35), (0.13, 0.2), (0.22, 0.29),
                 (0.12, 0.2), (0.6, 1.0), (0.5, 0.9), (0.6, 0.68), (0.72, 0.95), (0.06, 0.18), 2),
    "estate": _S((4.4, 5.1), (1.7, 1.9), (1.4, 1.6), (0.3, 0.35), (0.14, 0.22), (0.22, 0.28),
                 (0.005, 0.02), (0.6, 0.9), (0.15, 0.5), (0.6, 0.66), (0.75, 0.92),
                 (0.06, 0.16), 3),
    "coupe": _S((3.9, 4.9), (1.7, 1.95), (1.15, 1.36), (0.31, 0.36), (0.1, 0.16), (0.28, 0.42),
                (0.03, 0.14), (0.7, 1.1), (0.9, 1.5), (0.6, 0.7), (0.66, 0.85), (0.12, 0.24), 1),
    "supercar": _S((4.2, 4.7), (1.9, 2.08), (1.02, 1.18), (0.33, 0.37), (0.09, 0.13),
                   (0.16, 0.24), (0.18, 0.34), (1.0, 1.4), (0.5, 1.2), (0.62, 0.74), (0.4, 0.6),
                   (0.15, 0.3), 1),
    "roadster": _S((3.4, 4.4), (1.55, 1.85), (1.15, 1.3), (0.29, 0.35), (0.1, 0.17), (0.32, 0.45),
                   (0.15, 0.25), (0.3, 0.5), (0.1, 0.2), (0.62, 0.72), (0.65, 0.9),
                   (0.12, 0.28), 1),
    "suv": _S((4.1, 5.2), (1.8, 2.05), (1.62, 1.98), (0.35, 0.43), (0.2, 0.34), (0.18, 0.28),
              (0.005, 0.02), (0.35, 0.8), (0.1, 0.5), (0.58, 0.66), (0.8, 0.97), (0.04, 0.14), 3),
    "jeep": _S((3.2, 4.1), (1.55, 1.8), (1.65, 1.9), (0.36, 0.46), (0.25, 0.4), (0.3, 0.4),
               (0.01, 0.03), (0.08, 0.2), (0.04, 0.1), (0.55, 0.64), (0.92, 1.0), (0.01, 0.04), 2),
    "microcar": _S((2.2, 3.2), (1.4, 1.6), (1.42, 1.6), (0.24, 0.29), (0.12, 0.18), (0.08, 0.18),
                   (0.01, 0.1), (0.5, 0.8), (0.1, 0.6), (0.52, 0.62), (0.75, 0.95),
                   (0.1, 0.3), 1),
    "van": _S((4.3, 6.6), (1.8, 2.1), (1.85, 2.75), (0.31, 0.37), (0.16, 0.24), (0.06, 0.16),
              (0.003, 0.01), (0.5, 0.95), (0.03, 0.15), (0.48, 0.58), (0.7, 0.9), (0.05, 0.15), 3),
    "bus": _S((7.0, 13.0), (2.35, 2.55), (2.8, 3.4), (0.45, 0.52), (0.25, 0.35), (0.003, 0.006),
              (0.002, 0.004), (0.08, 0.35), (0.05, 0.2), (0.42, 0.52), (0.98, 1.0),
              (0.02, 0.08), 7),
    "double_decker": _S((8.5, 11.5), (2.45, 2.55), (4.1, 4.5), (0.48, 0.52), (0.25, 0.32),
                        (0.003, 0.006), (0.002, 0.004), (0.08, 0.35), (0.05, 0.15), (0.28, 0.32),
                        (0.98, 1.0), (0.02, 0.06), 7),
    "pickup": _S((4.7, 5.9), (1.75, 2.05), (1.6, 1.95), (0.34, 0.43), (0.22, 0.36), (0.2, 0.28),
                 (0.3, 0.45), (0.45, 0.85), (0.08, 0.2), (0.58, 0.66), (0.82, 0.97),
                 (0.03, 0.12), 2),
}  # fmt: skip
OPEN = ("roadster", "jeep", "pickup")
"""With a pit: for the passengers, or for the load."""


class Shell(NamedTuple):
    """A finished body: what the details are placed by."""

    front: float
    rear: float
    half: float  # half width
    belt: float
    height: float
    low: float  # the sill
    screen: float  # x of the windscreen's foot
    back: float  # x of the rear window's foot
    shift: float  # how far the corners lie behind the middle of the nose


def _at(table: Sequence[Span], places: np.ndarray) -> np.ndarray:
    """One column of `through`, its places in any order."""
    return np.asarray(through(sorted(table), places)[:, 0])


def _shell(kit: Kit, form: Form, kind: str, skin: Material) -> Shell:
    """The body with wheel arches, windows, doors; adds the wheels, too.

    Sections across x run from the middle of the floor round the sill, the arch, the side, the
    window and the roof; what is glass and what is a gap is chosen among the faces between them.
    """
    draw = {name: kit.uniform(name, *span) for name, span in form._asdict().items()
            if name != "panes"}  # fmt: skip
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

    places = [front, front - 0.04, front - 0.15, screen + 0.02, screen, rear, rear + 0.05,
              rear + 0.2, back, roof_front, roof_rear, *np.linspace(screen, roof_front, 5),
              *np.linspace(back, roof_rear, 4), *np.linspace(rear + 0.3, front - 0.25, 9),
              *(pillars + 0.04), *(pillars - 0.04), *(d + 0.012 for d in doors)]  # fmt: skip
    if kind in ("roadster", "jeep"):
        pit_front, pit_rear = screen - 0.12, max(back - 0.1, rear + 0.06)
        pit_rear = pit_rear if kind == "jeep" else max(screen - 1.6, back)
    elif kind == "pickup":
        pit_front, pit_rear = back - 0.06, rear + 0.07
    if pit:
        places += [pit_front, pit_front + 0.01, pit_rear, pit_rear - 0.01]
    for x in axles:
        places += [x + side * arch * c for c in (1.001, 1.0, 0.92, 0.7, 0.38, 0) for side in (-1, 1)]
    places = np.unique(np.round(places, 4))

    deck = _at([(front, nose * 0.8), (front - 0.05, nose * 0.97), (front - 0.2, nose),
                (screen, belt * kit.uniform("scuttle", 0.93, 1.0)), ((screen + back) / 2, belt),
                (min(back, screen - 0.6), (belt + tail) / 2 if back > rear + 0.3 else tail),
                (rear + 0.06, tail * 0.97), (rear, tail * 0.82)], places)  # fmt: skip
    if kind in ("bus", "double_decker", "van"):
        deck = np.maximum(deck, _at([(rear, belt * 0.97), (screen - 0.2, belt), (front, 0)], places))
    glass = np.where((places > back) & (places < screen), 1.0, 0.0)
    if kind in ("roadster", "jeep"):
        glass[:] = 0
    top_z = height - crown - belt
    rise = _at([(screen, 0.0), ((screen + roof_front) / 2, 0.57 * top_z), (roof_front, 0.94 * top_z),
                (0.75 * roof_front + 0.25 * roof_rear, top_z),
                (roof_rear + 0.01, top_z * (1 - slope)), ((roof_rear + back) / 2, 0.56 * top_z),
                (back, 0.0)], places)  # fmt: skip
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
                          - np.where(np.abs(places - x) <= arch * 1.0005, 0, 9))  # fmt: skip
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
                             w * swell * 0.98], y * swell])  # fmt: skip
        z = np.concatenate([[up, up, s, p, p, *side, d - 0.02], z])
        ring = np.concatenate(
            [np.stack([y, z], 1), np.stack([-y, z], 1)[len(y) - 2 : 0 : -1]]
        )
        bow = shift * np.sign(places[k]) * ends[k] ** 3 if places[k] > 0 else (
            0.5 * shift * -(ends[k] ** 3))  # fmt: skip
        if h > 0 and places[k] > roof_front:
            bow += 0.12 * (places[k] - roof_front) / draw["rake"]
        x = places[k] - bow * (ring[:, 0] / half) ** 2
        rings.append(np.column_stack([x, ring]))
    hull = loft(np.array(rings))

    # Which faces are glass, which are gaps between doors: numbered by section and point.
    size, middle = len(rings[0]), (places[1:] + places[:-1]) / 2
    masks = np.zeros((2, len(places) - 1, size), bool)

    def paint_faces(mask: int, where: np.ndarray, first: int, last: int) -> None:
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
        paint_faces(0, (middle < screen - 0.04 * rake) & (middle > roof_front + 0.06 * rake), 11, 14)
        if not blind:
            rake = roof_rear - back
            paint_faces(0, (middle > back + 0.12 * rake) & (middle < roof_rear - 0.1 * rake), 11, 14)
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
    """Lamps, grille, plates, mirrors, spoiler, rails, and what stands in an open body."""
    front, rear, half, belt = form.front, form.rear, form.half, form.belt
    nose = kit.visible["nose"] * belt
    lamp_z, y = (nose + form.low) * 0.56, half * 0.66
    corner = front - form.shift * 0.44
    size = 0.06 * form.height if kind in ("bus", "double_decker") else 0.1 * form.height
    shape = kit.choose("lamps", "round", "wide", "tall")
    if shape == "round":
        lamp = cylinder(size, 0.16, 18, 0.03).turned("y", 90)
    else:
        lamp = pillow(0.22, *((0.5 * half, size) if shape == "wide" else (size, 1.7 * size)), 0.04, 2)
    kit.both(LIGHT, lamp.at(corner - 0.06, y, lamp_z))
    grille = kit.uniform("grille", 0.4, 1.1) * half, kit.uniform("grille_height", 0.08, 0.28) * nose
    kit.add(trim, box(0.06, *grille, 0.02).at(front - 0.015, 0, lamp_z))
    kit.add(BLACK, box(0.06, half * 1.1, 0.1 * nose, 0.02).at(front - 0.02, 0, form.low + 0.2))
    kit.both(RED_LIGHT, pillow(0.12, half * 0.3, belt * 0.14, 0.03, 2)
             .at(rear + 0.04 + 0.2 * form.shift, half * 0.7, belt * 0.78))  # fmt: skip
    kit.add(
        WHITE,
        box(0.02, 0.4, 0.1).at(rear - 0.005, 0, belt * 0.5),
        box(0.02, 0.4, 0.09).at(front + 0.012, 0, form.low + 0.2),
    )
    reach = 0.5 if kind == "bus" else 0.12
    if kind not in ("double_decker",):
        kit.both(skin, ball(0.14, 0.24, 0.15, 12).at(form.screen - 0.32, half + 0.06, belt + 0.1))
        kit.both(BLACK, rod((form.screen - 0.32, half * 0.84, belt + 0.03),
                            (form.screen - 0.32, half + reach * 0.3, belt + 0.08), 0.02, 6))  # fmt: skip
    kit.both(BLACK, cylinder(0.035, 0.2, 10).turned("y", 90).at(rear + 0.02, half * 0.6, form.low + 0.1))
    if kind in ("coupe", "supercar", "saloon", "hatchback") and kit.chance(
        "spoiler", 0.6 if kind in ("coupe", "supercar") else 0.15
    ):
        high = kit.uniform("spoiler_height", 0.08, 0.3)
        kit.add(skin, solids.wing([(rear + 0.3, -half * 0.9, belt + high, 0.3),
                                   (rear + 0.3, half * 0.9, belt + high, 0.3)], 0.1))  # fmt: skip
        kit.both(BLACK, box(0.1, 0.03, high + 0.12).at(rear + 0.2, half * 0.6, belt + high / 2 - 0.06))
    if kind in ("suv", "estate", "van") and kit.chance("roof_load", 0.45):
        z, x = form.height - 0.05, (form.screen + form.back) / 2 - 0.1
        long = 0.45 * (form.screen - form.back)
        load = kit.choose("load", "rails", "box", "rack")
        if load == "box":
            kit.add(BLACK, pillow(1.6, 0.8, 0.34, 0.15).at(x, 0, z + 0.22))
            kit.add(BLACK, box(0.06, 1.1, 0.12).at(x - 0.4, 0, z), box(0.06, 1.1, 0.12).at(x + 0.4, 0, z))
        else:
            ys = (-0.62, 0.62) if load == "rails" else (-0.6, -0.3, 0, 0.3, 0.6)
            for share in ys:
                kit.add(trim, box(long, 0.04, 0.04).at(x, share * half, z + 0.12))
            for at in (-0.45, 0, 0.45):
                kit.add(trim, box(0.05, 1.24 * half, 0.05).at(x + at * long, 0, z + 0.08),
                        *(box(0.05, 0.04, 0.2).at(x + at * long, s * 0.6 * half, z)
                          for s in (-1, 1)))  # fmt: skip
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
                                half * 1.72, 0.08))  # fmt: skip
            kit.both(DARK_GLASS, box(long * 0.7, 0.02, high * 0.5).at(x, half * 0.86, belt + high * 0.5))
        elif load == "bars":
            for at in (0.1, 0.5, 0.9):
                bow = [(0, -half * 0.85, belt - 0.02), (0, -half * 0.8, form.height - 0.15),
                       (0, half * 0.8, form.height - 0.15), (0, half * 0.85, belt - 0.02)]  # fmt: skip
                kit.add(BLACK, tube(bow, 0.03, 6).at(rear + 0.05 + at * (long - 0.15)))


def _bus_windows(kit: Kit, form: Shell, kind: str, skin: Material) -> None:
    """The upper deck's windows, the destination sign, what stands on the roof."""
    length = form.front - form.rear
    if kind == "double_decker":
        z, high = form.height * 0.76, form.height * 0.15
        width = 0.9 * 2 * form.half * kit.visible["tumblehome"]
        kit.add(DARK_GLASS, box(length * 0.93, width + 0.14, high, 0.02).at(0, 0, z))
        for x in np.linspace(-0.36, 0.36, 6) * length:
            kit.both(BLACK, box(0.1, 0.02, high).at(x, width / 2 + 0.075, z))
        kit.add(skin, box(length * 0.985, width + 0.2, 0.12 * form.height, 0.03).at(0, 0, 0.6 * form.height))
    elif kit.chance("roof_units", 0.6):
        for x in (-0.22, 0.2):
            kit.add(WHITE, pillow(0.17 * length, 1.6, 0.3, 0.12, 2).at(x * length, 0, form.height))
    kit.add(BLACK, box(0.06, 1.5, 0.25).at(form.screen - 0.28, 0, form.height * 0.93))


def _cockpit(kit: Kit, form: Shell, kind: str, skin: Material) -> None:
    """Seats, wheel, a windscreen that stands alone, a roll bar, a spare wheel."""
    half, belt, floor = form.half, form.belt, form.low + 0.28
    leather = fabric(kit.rng)
    x = form.screen - 1.0
    rows = (x,) if kind == "roadster" else (x, x - 0.85)
    for at in rows:
        if at - 0.35 < form.back and kind == "jeep":
            continue
        high = belt + 0.12 - floor
        kit.both(leather, pillow(0.5, half * 0.62, 0.24, 0.08, 2).at(at + 0.1, half * 0.42, floor + 0.12),
                 pillow(0.18, half * 0.6, high, 0.08, 2).turned("y", -12)
                 .at(at - 0.2, half * 0.42, floor + high / 2))  # fmt: skip
    ring = [(0.18 * np.cos(a), 0.18 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 15)]
    kit.add(BLACK, tube([(0.5 * u, half * 0.42 + v, 0.8 * u) for u, v in ring], 0.02, 6)
            .at(form.screen - 0.45, 0, belt - 0.02))  # fmt: skip
    rake, rise = kit.visible["rake"], form.height - belt if kind == "jeep" else 0.38
    ys = np.linspace(-1, 1, 7) * half * 0.82
    pane = np.array([[(form.screen - 0.06 - rake * t - 0.25 * form.shift * (y / half) ** 2,
                       y * (1 - 0.08 * t), belt * 0.97 + t * rise) for y in ys]
                     for t in (0, 0.5, 1)])  # fmt: skip
    kit.add(DARK_GLASS, sheet(pane, 0.025))
    for line in (pane[:, 0], pane[:, -1], pane[-1]):
        kit.add(BLACK if kind == "jeep" else CHROME, tube(line, 0.025, 6))
    if kind == "jeep":
        roof = kit.choose("top", "none", "bars", "soft", "bars")
        rear = max(form.back, form.rear + 0.12)
        legs = [(rear + 0.1, belt), (x - 0.15, belt)]
        if roof in ("bars", "soft"):
            for at, z in legs:
                bow = [(at, -half * 0.84, z - 0.1), (at, -half * 0.78, form.height - 0.03),
                       (at, half * 0.78, form.height - 0.03), (at, half * 0.84, z - 0.1)]  # fmt: skip
                kit.add(BLACK, tube(bow, 0.03, 6))
            kit.both(BLACK, rod((rear + 0.1, half * 0.78, form.height - 0.03),
                                (pane[-1, 0, 0], half * 0.75, form.height - 0.03), 0.03, 6))  # fmt: skip
        if roof == "soft":
            long = pane[-1, 0, 0] - rear
            kit.add(leather, pillow(long, half * 1.66, 0.1, 0.04, 2).at(rear + long / 2, 0, form.height))
        if kit.chance("spare_wheel", 0.7):
            for material, part in wheel(kit.visible["wheel"], 0.24, 5, BLACK):
                kit.add(material, part.turned("z", 90).at(form.rear - 0.12, 0, belt * 0.85))
    elif kit.chance("roll_bars", 0.4):
        for s in (-1, 1):
            bow = [(0, -0.22, 0), (0, -0.18, 0.28), (0, 0.18, 0.28), (0, 0.22, 0)]
            kit.add(CHROME, tube(smooth_path(bow, 4), 0.03, 6).at(x - 0.42, s * half * 0.45, belt - 0.05))


def _underside(kit: Kit, long: float, wide: float, low: float, high: float, material: Material,
               x: float = 0.0) -> None:  # fmt: skip
    """A chassis between two heights that is hollow from below. Hidden: how deep."""
    share = kit.hide("chassis_recess", 0.02, 0.6)
    tray = solids.tray(rect(long, wide, 0.02), high - low, 0.06, share * (high - low))
    kit.add(material, tray.at(x, 0, low))


def _lorry(kit: Kit, skin: Material) -> None:
    """A cab on a chassis with a box, a flat bed, a tank, a tipper or a semi-trailer."""
    length, half = kit.uniform("length", 5.5, 11.0), kit.uniform("width", 2.1, 2.55) / 2
    radius = kit.uniform("wheel", 0.4, 0.54)
    load = kit.choose("load", "box", "box", "flatbed", "tank", "tipper", "mixer", "semitrailer", "none")
    if load == "semitrailer":
        length = kit.uniform("trailer_length", 12.0, 16.5)
    frame, front, rear = 2.1 * radius, length / 2, -length / 2
    hooded = kit.chance("hooded", 0.35)
    hood = kit.uniform("hood", 0.9, 1.6) if hooded else 0.0
    cab, tall = kit.uniform("cab", 1.5, 2.4), kit.uniform("height", 2.4, 3.7)
    chassis = Material((0.13, 0.13, 0.14), (0.2,) * 3, 20.0, name="chassis")
    _underside(kit, length - 0.3, half * 0.9, radius * 1.2, frame, chassis)
    # Cab: side profile, extruded; sloping windscreen.
    low, back = radius * 0.9, front - hood - cab
    waist, rake = frame + (tall - frame) * 0.38, kit.uniform("rake", 0.05, 0.4)
    kit.add(skin, prism([(front, low), (front, waist * 0.92), (front - hood, waist),
                         (front - hood - rake, tall), (back, tall), (back, low * 1.3),
                         (front - hood - 1.2 * radius, low * 1.3)] if not hooded else
                        [(front, low), (front, waist * 0.86), (front - 0.15, waist * 0.92),
                         (front - hood, waist), (front - hood - rake, tall), (back, tall),
                         (back, low * 1.3)], 2 * half * (0.94 if not hooded else 0.86), 0.08))  # fmt: skip
    z, high = (waist + tall) / 2, (tall - waist) * 0.66
    lean = np.degrees(np.arctan2(rake, tall - waist))
    wide = 2 * half * (0.8 if not hooded else 0.72)
    kit.add(DARK_GLASS, box(0.06, wide, high, 0.02).turned("y", -lean).at(front - hood - rake / 2, 0, z))
    side = half * (0.94 if not hooded else 0.86)
    kit.both(DARK_GLASS, box(cab * 0.42, 0.03, high * 0.9).at(front - hood - cab * 0.42, side, z))
    kit.add(CHROME if kit.rng.random() < 0.5 else BLACK,
            box(0.06, half, (waist - low) * 0.45, 0.02).at(front + 0.005, 0, low + 0.55 * (waist - low)),
            box(0.16, half * 1.9, 0.3, 0.04).at(front, 0, low))  # fmt: skip
    kit.both(LIGHT, cylinder(0.13, 0.1, 14, 0.02).turned("y", 90).at(front - 0.01, half * 0.75, low + 0.35))
    kit.both(BLACK, box(0.08, 0.22, 0.5, 0.02).at(front - hood - 0.1, half + 0.08, z),
             rod((front - hood - 0.1, side - 0.02, z + 0.1), (front - hood - 0.1, half + 0.1, z + 0.1), 0.03, 6))  # fmt: skip
    if kit.chance("spoiler", 0.4) and load in ("box", "semitrailer"):
        kit.add(skin, prism([(front - hood - rake, tall - 0.02), (back, tall - 0.02), (back, tall + 0.6)],
                            half * 1.5, 0.05))  # fmt: skip
    if kit.chance("stack", 0.3):
        kit.both(CHROME, rod((back - 0.12, half * 0.8, frame), (back - 0.12, half * 0.8, tall + 0.4), 0.09, 10))
    start = back - 0.25
    long, middle = start - rear, (start + rear) / 2
    cover = pick(kit.rng, (paint, lambda _: WHITE, lambda _: WHITE, metal))(kit.rng)
    deck = frame + 0.12
    if load in ("box", "semitrailer"):
        if load == "semitrailer" and kit.chance("trailer_tank", 0.35):
            r = kit.uniform("tank", 0.8, 1.15)
            kit.add(cover, cylinder(r, long - 0.3, 28, 0.25).turned("y", 90).scaled(1, half / r * 0.96, 1)
                    .at(middle, 0, deck + r))  # fmt: skip
        else:
            high = kit.uniform("box_height", 1.5, 4.1 - deck)
            kit.add(cover, box(long, 2 * half, high, 0.05).at(middle, 0, deck + high / 2))
            for x in np.linspace(rear + 0.3, start - 0.3, int(kit.choose("ribs", 2, 6, 12))):
                kit.both(cover, box(0.07, 0.04, high - 0.1).at(x, half + 0.015, deck + high / 2))
    elif load == "flatbed":
        kit.add(wood(kit.rng), box(long, 2 * half, 0.14, 0.02).at(middle, 0, deck))
        side_height = kit.uniform("sides", 0.15, 0.6)
        kit.both(cover, box(long, 0.06, side_height, 0.01).at(middle, half - 0.03, deck + side_height / 2))
        kit.add(cover, box(0.06, 2 * half, side_height * 1.6).at(start - 0.03, 0, deck + side_height * 0.8))
        timber = wood(kit.rng)
        for k in range(kit.choose("logs", 0, 0, 3, 6)):
            y, up = ((k % 3) - 1) * 0.62 * half, 0.32 + 0.5 * (k // 3)
            kit.add(timber, cylinder(0.28, long * 0.9, 14).turned("y", 90).at(middle, y, deck + up))
    elif load == "tank":
        r = kit.uniform("tank", 0.75, 1.15)
        kit.add(cover, body([(rear, r * 0.6, r * 0.6, deck + r), (rear + 0.3, r, r, deck + r),
                             (start - 0.3, r, r, deck + r), (start, r * 0.6, r * 0.6, deck + r)],
                            2.0, 4, 28).scaled(1, half / r * 0.97, 1))  # fmt: skip
        for x in (0.25, 0.5, 0.75):
            kit.add(BLACK, cylinder(0.25, 0.2, 14).at(rear + x * long, 0, deck + 2 * r))
        kit.both(chassis, box(long * 0.8, 0.3, 0.3).at(middle, half * 0.55, deck + 0.05))
    elif load == "tipper":
        high = kit.uniform("tipper", 0.8, 1.4)
        rise = kit.choose("tipped", 0, 0, 30) * 1.0
        outline = [rect(long, 2 * half * 0.98), rect(long * 0.92, 2 * half * 0.84)]
        tub = solids.stack([(outline[1](0.0), 0.0), (outline[0](0.0), high), (outline[0](0.08), high),
                            (outline[1](0.08), 0.12)]).at(long / 2)  # fmt: skip
        kit.add(cover, tub.turned("y", -rise).at(rear, 0, deck))
    elif load == "mixer":
        drum = [(0, 0.35, 0.35, 0.5), (0.25 * long, 0.9, 0.9, 0.25), (0.65 * long, 1.05, 1.05, 0.1),
                (0.95 * long, 0.5, 0.5, 0)]  # fmt: skip
        kit.add(cover, body(drum, 2.0, 3, 24).at(rear + 0.05, 0, deck + 1.15))
        kit.add(BLACK, box(0.3, half, 1.0).at(start - 0.15, 0, deck + 0.5),
                box(0.2, half, 1.2).at(rear + 0.4, 0, deck + 0.55))  # fmt: skip
    hub = pick(kit.rng, (CHROME, metal(kit.rng), BLACK))
    axles = [front - (1.3 if not hooded else 0.9) - 0.3 * radius]
    rows = kit.choose("rear_axles", 1, 2) if length < 8 else kit.choose("rear_axles", 2, 3)
    axles += [rear + 1.3 * radius + 0.05 + k * 2.25 * radius for k in range(rows)]
    if load == "semitrailer":
        axles += [back - 0.2, back - 0.2 - 2.2 * radius]
    for k, x in enumerate(axles):
        for material, part in wheel(radius, 0.32 if k == 0 else 0.5, 6, hub):
            kit.both(material, part.at(x, half - (0.18 if k == 0 else 0.27), radius))
    kit.add(RED_LIGHT, *(box(0.05, 0.3, 0.12).at(rear + 0.1, s * half * 0.7, frame - 0.1) for s in (-1, 1)))
    kit.both(chassis, box(0.9, 0.4, 0.5, 0.05).at(back - 0.7, half * 0.65, frame - 0.35))


def _formula(kit: Kit, skin: Material, accent: Material) -> None:
    """A single-seater: slim body, wings, free wheels."""
    length, half = kit.uniform("length", 4.2, 5.6), kit.uniform("width", 1.6, 2.0) / 2
    front, rear = length / 2, -length / 2
    old = kit.chance("old", 0.35)  # a cigar without wings
    radius = kit.uniform("wheel", 0.3, 0.36)
    wide, high = kit.uniform("body", 0.3, 0.42), kit.uniform("height", 0.26, 0.36)
    z = high + 0.1
    nose = 0.12 if not old else 0.3
    fat = wide * (1.0 if old else kit.uniform("pods", 1.7, 2.1))
    stations = [(front - 0.25, 0.04, 0.04 + 0.3 * (nose - 0.1), z - 0.05 + (0.1 if old else -0.08)),
                (front - 0.5, nose * 0.8, nose, z - 0.05), (front - 1.3, wide * 0.75, high * 0.8, z - 0.03),
                (front - 0.4 * length, wide, high, z), (0.0, fat, high * 0.92, z - 0.02),
                (-0.2 * length, fat * 0.9, high * 0.95, z), (rear + 0.6, wide * 0.5, high * 0.8, z),
                (rear + 0.3, wide * 0.3, high * 0.6, z)]  # fmt: skip
    kit.add(skin, body(stations, 2.8 if not old else 2.0, 3, 20))
    seat = 0.08 * length
    kit.add(BLACK, pillow(0.9, wide * 1.3, 0.2, 0.1, 2).at(seat, 0, z + high * 0.93))
    kit.add(accent, ball(0.28, 0.26, 0.3, 14).at(seat - 0.05, 0, z + high + 0.18))
    kit.add(DARK_GLASS, ball(0.2, 0.24, 0.09, 12).at(seat + 0.03, 0, z + high + 0.19))
    if not old:
        kit.add(skin, body([(seat - 0.3, 0.12, 0.16, z + high + 0.25), (seat - 0.8, 0.13, 0.2, z + high + 0.1),
                            (rear + 0.7, 0.05, 0.1, z + 0.6 * high)], 2.2, 3, 14))  # fmt: skip
        kit.add(BLACK, ball(0.1, 0.18, 0.2, 12).at(seat - 0.3, 0, z + high + 0.27))
        for x, chord, up, span in ((front, 0.45, 0.14, 0.96), (rear + 0.4, 0.42, 0.85, 0.6)):
            for k in range(2):
                kit.add(accent, solids.wing([(x - 0.24 * k, -half * span, up + 0.08 * k, chord * (1 - 0.3 * k)),
                                             (x - 0.24 * k, half * span, up + 0.08 * k, chord * (1 - 0.3 * k))],
                                            0.09).at())  # fmt: skip
            kit.both(accent, box(chord * 1.3, 0.025, 0.3).at(x - chord * 0.6, half * span, up + 0.06))
        kit.add(BLACK, box(0.2, 0.06, 0.6).at(rear + 0.25, 0, 0.6))
        kit.add(skin, box(0.3, 0.12, 0.12).at(front - 0.3, 0, 0.2))
        if kit.chance("halo", 0.5):
            bow = [(seat + 0.75, 0, z + high * 0.8), (seat + 0.6, 0, z + high + 0.3)]
            ring = [(seat - 0.3, -0.3, z + high * 0.9), (seat, -0.3, z + high + 0.3), (seat + 0.6, 0, z + high + 0.32),
                    (seat, 0.3, z + high + 0.3), (seat - 0.3, 0.3, z + high * 0.9)]  # fmt: skip
            kit.add(BLACK, tube(bow, 0.035, 6), tube(smooth_path(ring, 4), 0.035, 6))
    else:
        kit.both(CHROME, tube(smooth_path([(0, wide, z), (-0.3, wide + 0.12, z - 0.05), (rear + 0.3, wide + 0.05, z - 0.05)], 4), 0.05, 8))
    hub = pick(kit.rng, (CHROME, BLACK, metal(kit.rng)))
    for x, tyre, r in ((front - 0.95, 0.28 if not old else 0.16, radius),
                       (rear + 0.55, 0.38 if not old else 0.18, radius * 1.08)):  # fmt: skip
        for material, part in wheel(r, tyre, 10 if old else 5, hub):
            kit.both(material, part.at(x, half - tyre / 2, r))
        for dx in (-0.15, 0.15):
            kit.both(BLACK, rod((x + 2 * dx, wide * 0.3, z), (x, half - tyre * 0.8, r + 0.05), 0.025, 6),
                     rod((x + 2 * dx, wide * 0.3, z - 0.12), (x, half - tyre * 0.8, r - 0.08), 0.025, 6))  # fmt: skip
    kit.both(BLACK, rod((rear + 0.6, 0, radius), (rear + 0.55, half - 0.2, radius), 0.03, 6))
    _underside(kit, length * 0.55, wide * 1.2, 0.08, z - high * 0.6, BLACK, -0.1)


def _vintage(kit: Kit, skin: Material, accent: Material) -> None:
    """A car of the twenties: long hood, upright cabin or open seats, mudguards, running boards."""
    length, half = kit.uniform("length", 3.3, 5.0), kit.uniform("width", 1.35, 1.75) / 2
    front, rear = length / 2, -length / 2
    radius = kit.uniform("wheel", 0.34, 0.46)
    frame, belt = radius * 1.0, radius * 1.0 + kit.uniform("belt", 0.55, 0.7)
    axle, back_axle = front - radius * 1.05, rear + radius * 1.4
    narrow = half * 0.62
    cabin = front - length * kit.uniform("hood", 0.36, 0.5)
    _underside(kit, length * 0.92, narrow * 1.5, frame * 0.75, frame + 0.05, BLACK)
    # The hood grows toward the cabin.
    hood = [(axle + 0.25, narrow * 0.52, (belt - frame) * 0.46, (belt + frame) / 2),
            (axle + 0.1, narrow * 0.58, (belt - frame) * 0.5, (belt + frame) / 2),
            (cabin, narrow, (belt - frame) * 0.52, (belt + frame) / 2)]  # fmt: skip
    kit.add(skin, body(hood, 4.0, 3, 20))
    kit.add(CHROME, body([(axle + 0.33, narrow * 0.5, (belt - frame) * 0.5, (belt + frame) / 2),
                          (axle + 0.24, narrow * 0.56, (belt - frame) * 0.55, (belt + frame) / 2)],
                         3.0, 1, 20))  # fmt: skip
    kind = kit.choose("cabin", "closed", "closed", "open", "half")
    tail = rear + length * kit.uniform("tail", 0.06, 0.2)
    wide = half * 0.8
    tub = [(cabin, narrow, (belt - frame) * 0.5), (cabin - 0.35, wide, (belt - frame) * 0.52),
           (tail + 0.5, wide, (belt - frame) * 0.52), (tail, wide * 0.8, (belt - frame) * 0.4)]  # fmt: skip
    kit.add(skin, body([(x, w, h, (belt + frame) / 2) for x, w, h in tub], 5.0, 3, 20))
    high = kit.uniform("cabin_height", 0.55, 0.8)
    end = tail + 0.15 if kind != "half" else (cabin + tail) / 2
    if kind == "open":
        leather = fabric(kit.rng)
        for x in (cabin - 0.75, tail + 0.55):
            kit.add(leather, pillow(0.2, wide * 1.6, 0.5, 0.08, 2).turned("y", -10).at(x - 0.2, 0, belt + 0.12),
                    pillow(0.5, wide * 1.6, 0.2, 0.08, 2).at(x, 0, belt))  # fmt: skip
        kit.add(DARK_GLASS, box(0.03, wide * 1.6, 0.4).turned("y", -8).at(cabin - 0.1, 0, belt + 0.2))
        if kit.chance("hood_up", 0.4):
            kit.add(leather, pillow(1.2, wide * 1.9, 0.12, 0.05, 2).at(tail + 0.7, 0, belt + high))
            kit.both(BLACK, rod((tail + 0.2, wide, belt - 0.05), (tail + 0.3, wide * 0.9, belt + high), 0.025, 6),
                     rod((cabin - 0.1, wide * 0.8, belt - 0.05), (tail + 1.2, wide * 0.9, belt + high), 0.025, 6))  # fmt: skip
    else:
        x, long = (cabin - 0.12 + end) / 2, cabin - 0.12 - end
        kit.add(DARK_GLASS, box(long - 0.1, wide * 1.84, high, 0.02).at(x, 0, belt + high / 2 - 0.02))
        kit.add(accent, pillow(long + 0.16, wide * 2.02, 0.18, 0.07, 2).at(x, 0, belt + high))
        for t in (-0.5, 0.02, 0.5):
            kit.both(skin, box(0.12 if t else 0.09, 0.09, high).at(x + t * (long - 0.12), wide * 0.92, belt + high / 2 - 0.02))
        kit.add(skin, box(0.08, wide * 1.7, high * 0.5).at(end + 0.04, 0, belt + high * 0.2))
        if kind == "half" and kit.chance("dickey_seat", 0.5):
            kit.add(fabric(kit.rng), pillow(0.2, wide * 1.4, 0.45, 0.08, 2).at(tail + 0.35, 0, belt + 0.15))
    # Mudguards: sheets round the wheels, joined by the running board.
    for x, reach in ((axle, (150, -5)), (back_axle, (185, 30))):
        angles = np.radians(np.linspace(*reach, 10))
        arc = np.stack([x + radius * 1.2 * np.cos(angles), 0 * angles, radius + radius * 1.2 * np.sin(angles)], 1)
        arc = arc if x == axle else arc[::-1]
        grid = np.stack([arc + np.array([0, half - 0.3 + 0.3 * t, -0.05 * (2 * t - 1) ** 2]) for t in np.linspace(0, 1, 4)], 1)
        kit.both(accent, sheet(grid, 0.03))
    kit.both(accent, box(axle - back_axle - 1.8 * radius, 0.32, 0.05, 0.01).at((axle + back_axle) / 2, half - 0.15, radius * 0.85))
    kit.both(BLACK, box(0.1, half - narrow * 0.6, 0.06).at(axle - radius, (half + narrow) / 2 * 0.8, radius))
    hub = pick(kit.rng, (wood(kit.rng), CHROME, skin))
    for x in (axle, back_axle):
        for material, part in wheel(radius, 0.15, 12, hub):
            kit.both(material, part.at(x, half - 0.13, radius))
        kit.add(BLACK, rod((x, -half + 0.2, radius), (x, half - 0.2, radius), 0.04, 8))
    kit.both(CHROME, ball(0.2, 0.26, 0.26, 14).at(axle + 0.15, narrow * 0.95, belt * 0.88),
             rod((axle + 0.12, narrow * 0.3, frame + 0.1), (axle + 0.12, narrow * 0.95, belt * 0.84), 0.02, 6))  # fmt: skip
    kit.both(LIGHT, cylinder(0.11, 0.02, 14).turned("y", 90).at(axle + 0.245, narrow * 0.95, belt * 0.88))
    kit.add(CHROME, tube(smooth_path([(front - 0.05, -half * 0.9, radius), (front + 0.02, 0, radius), (front - 0.05, half * 0.9, radius)], 4), 0.035, 6))
    kit.both(CHROME, rod((axle + 0.1, narrow * 0.5, frame), (front, narrow * 0.5, radius), 0.04, 6))
    if kit.chance("spare_wheel", 0.5):
        for material, part in wheel(radius, 0.15, 12, hub):
            kit.add(material, part.turned("z", 80).at(tail - 0.12, 0, frame + radius * 0.9))


def _buggy(kit: Kit, skin: Material, accent: Material) -> None:
    """A frame of tubes with an engine behind the seats, or a small kart without the frame."""
    kart = kit.chance("kart", 0.3)
    length, half = kit.uniform("length", 2.8, 3.8), kit.uniform("width", 1.6, 2.0) / 2
    if kart:
        length, half = length * 0.55, half * 0.7
    front, rear, radius = length / 2, -length / 2, 0.16 if kart else kit.uniform("wheel", 0.33, 0.45)
    floor = radius * 0.6 if kart else radius * 1.1
    roof = floor + (0.3 if kart else kit.uniform("height", 1.05, 1.3))
    wide = half * 0.55
    _underside(kit, length * 0.72, wide * 2, floor - 0.05, floor + 0.05, BLACK)
    leather = fabric(kit.rng)
    for y in ((0,) if kart else (-wide * 0.5, wide * 0.5)):
        kit.add(leather, pillow(0.45, wide * 0.85, 0.16, 0.06, 2).at(-0.05, y, floor + 0.12),
                pillow(0.14, wide * 0.85, 0.62 if not kart else 0.45, 0.06, 2).turned("y", -15).at(-0.32, y, floor + 0.35))  # fmt: skip
    if kart:
        kit.add(skin, pillow(0.35, wide * 1.4, 0.16, 0.07, 2).at(front - 0.2, 0, floor + 0.12),
                box(0.1, half * 1.5, 0.12, 0.03).at(front, 0, floor + 0.02))  # fmt: skip
        kit.both(skin, pillow(0.6, 0.14, 0.16, 0.06, 2).at(0, half * 0.8, floor + 0.08))
        kit.both(BLACK, rod((0, wide, floor), (0, half * 0.8, floor + 0.05), 0.02, 6))
    else:
        for s in (-1, 1):
            y = s * wide
            hoop = [(front - 0.1, y * 0.5, floor + 0.15), (front * 0.45, y, floor + 0.45), (front * 0.15, y * 0.92, roof - 0.04),
                    (-0.3, y * 0.92, roof), (rear + 0.6, y, floor + 0.6), (rear + 0.1, y * 0.7, floor + 0.25)]  # fmt: skip
            kit.add(skin, tube(hoop, 0.035, 6), tube([(front - 0.1, y * 0.5, floor + 0.15), (front * 0.45, y, floor), (rear + 0.1, y * 0.7, floor + 0.25)], 0.035, 6))
            kit.add(skin, rod((-0.3, y * 0.92, roof), (-0.35, y, floor), 0.03, 6), rod((front * 0.45, y, floor + 0.45), (front * 0.45, y, floor), 0.03, 6))
        for x, z, share in ((front * 0.15, roof - 0.04, 0.92), (-0.3, roof, 0.92), (rear + 0.1, floor + 0.25, 0.7), (front - 0.1, floor + 0.15, 0.5)):
            kit.add(skin, rod((x, -wide * share, z), (x, wide * share, z), 0.03, 6))
        kit.add(accent, body([(front - 0.05, wide * 0.45, 0.1, floor + 0.16), (front * 0.42, wide * 0.95, 0.26, floor + 0.24)], 4.0, 3, 16))
        if kit.chance("roof_panel", 0.5):
            kit.add(accent, box(front * 0.15 + 0.3, wide * 1.8, 0.03).at((front * 0.15 - 0.3) / 2, 0, roof))
        kit.both(LIGHT, ball(0.1, 0.2, 0.2, 12).at(front * 0.62, wide * 0.75, floor + 0.48))
    metal_ = metal(kit.rng)
    kit.add(metal_, box(0.5, wide * 1.1, 0.4 if not kart else 0.2, 0.05).at(rear + (0.45 if not kart else 0.3), 0, floor + 0.22),
            cylinder(0.16 if not kart else 0.08, 0.3, 14).at(rear + 0.4, 0, floor + 0.5 if not kart else floor + 0.3))  # fmt: skip
    kit.add(BLACK, rod((0.5 if not kart else 0.2, 0, floor), (0.3, 0, floor + 0.4), 0.02, 6),
            cylinder(0.16, 0.03, 14).turned("y", 60).at(0.3, 0 if kart else wide * 0.5, floor + 0.42))  # fmt: skip
    hub = pick(kit.rng, (CHROME, BLACK, skin))
    for x, tyre in ((front - radius * 0.8, radius * 0.6), (rear + radius * 0.95, radius * 0.85)):
        for material, part in wheel(radius, tyre, 5, hub):
            kit.both(material, part.at(x, half - tyre / 2, radius))
        kit.both(metal_, rod((x - 0.1, wide * 0.5, floor + 0.05), (x, half - tyre, radius), 0.03, 6),
                 rod((x + 0.1, wide * 0.5, floor + 0.05), (x, half - tyre, radius), 0.03, 6))  # fmt: skip


def car(kit: Kit) -> None:
    """Cars of 17 kinds. Hidden: how deep the underside is hollow."""
    kind = kit.choose("subtype", *FORMS, "lorry", "lorry", "formula", "vintage", "buggy")
    skin, accent = paint(kit.rng), paint(kit.rng)
    if kind == "lorry":
        _lorry(kit, skin)
    elif kind == "formula":
        _formula(kit, skin, accent)
    elif kind == "vintage":
        _vintage(kit, skin, BLACK if kit.rng.random() < 0.5 else accent)
    elif kind == "buggy":
        _buggy(kit, skin, accent)
    else:
        shell = _shell(kit, FORMS[kind], kind, skin)
        _fittings(kit, shell, kind, skin, BLACK if kit.rng.random() < 0.6 else CHROME)
