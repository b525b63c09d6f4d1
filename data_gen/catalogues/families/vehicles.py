"""Cars, planes, firearms, watercraft."""

from collections.abc import Sequence

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    LIGHT,
    RED_LIGHT,
    RUBBER,
    WHITE,
    Kit,
    around,
    fabric,
    metal,
    paint,
    pick,
    wood,
)
from data_gen.catalogues.solids import (
    Solid,
    ball,
    box,
    cylinder,
    lathe,
    loft,
    pillow,
    prism,
    rod,
    tube,
)
from data_gen.meshes import Material


def _wheel(radius: float, width: float, spokes: int, hub: Material) -> list[tuple[Material, Solid]]:
    """A wheel around the origin with its axle along y; the outside toward +y."""
    w = width / 2
    tyre = lathe(
        [
            (radius * 0.62, -w),
            (radius * 0.94, -w),
            (radius, -w * 0.6),
            (radius, w * 0.6),
            (radius * 0.94, w),
            (radius * 0.62, w),
        ],
        24,
        loop=True,
    )
    parts = [
        (RUBBER, tyre.turned("x", -90)),
        (BLACK, cylinder(radius * 0.63, width * 0.7, 20).turned("x", 90)),
    ]
    disc = cylinder(radius * 0.24, width * 0.5, 14, 0.1 * radius).turned("x", 90).at(y=w * 0.5)
    parts.append((hub, disc))
    rim = lathe(
        [
            (radius * 0.64, 0),
            (radius * 0.64, w * 0.3),
            (radius * 0.54, w * 0.3),
            (radius * 0.54, 0),
        ],
        24,
        loop=True,
    )
    parts.append((hub, rim.turned("x", -90).at(y=w * 0.7)))
    for angle in around(spokes):
        spoke = box(radius * 0.14, w * 0.4, radius * 0.5).at(0, w * 0.75, radius * 0.36)
        parts.append((hub, spoke.turned("y", angle)))
    return parts


def car(kit: Kit) -> None:
    """Sedan, hatchback, coupe, estate, van, pickup, off-roader. Hidden: the floor's height."""
    kind = kit.choose(
        "subtype", "sedan", "sedan", "hatch", "coupe", "estate", "van", "pickup", "suv"
    )
    body = paint(kit.rng)
    trim = BLACK if kit.rng.random() < 0.6 else CHROME
    # Lengths in units of a wheel's radius of about a third of a metre.
    tall = {"van": 1.9, "suv": 1.75, "pickup": 1.75, "coupe": 1.28}.get(kind, 1.45) * kit.uniform(
        "tallness", 0.95, 1.06
    )
    length = {"hatch": 3.8, "van": 4.9, "pickup": 5.2, "suv": 4.6, "coupe": 4.4}.get(
        kind, 4.6
    ) * kit.uniform("length", 0.95, 1.05)
    half = kit.uniform("half_width", 0.86, 0.96)
    radius = {"suv": 0.39, "pickup": 0.39, "van": 0.36}.get(kind, 0.33) * kit.uniform(
        "wheel", 0.95, 1.08
    )
    sill = radius * kit.uniform("clearance", 0.55, 0.75)
    belt = tall * {"van": 0.6, "suv": 0.62, "pickup": 0.6}.get(kind, 0.62)
    hood = belt * kit.uniform("hood", 0.88, 0.95)
    front, rear = length / 2, -length / 2
    # Stations of the lower body from the rear: x, half width, top.
    tail = {"sedan": 0.99, "coupe": 1.0, "pickup": 0.98}.get(kind, 1.0) * belt
    nose = kit.uniform("nose", 0.7, 0.85)
    screen_x = front - length * {"van": 0.14, "hatch": 0.24, "pickup": 0.27}.get(kind, 0.27)
    stations = [
        (rear, 0.82, tail * 0.72),
        (rear + 0.04, 0.9, tail * 0.94),
        (rear + 0.25, 0.97, tail),
        (rear + length * 0.3, 1.0, belt),
        (screen_x - 0.1, 1.0, belt),
        (screen_x + 0.05, 0.99, hood * 1.02),
        (front - 0.45, 0.96, hood * 0.97),
        (front - 0.12, 0.9, hood * 0.9),
        (front - 0.03, 0.84, hood * nose),
        (front, 0.76, hood * nose * 0.85),
    ]
    recess = kit.hide("floor_height", 0.02, 0.85)
    rings = []
    for k, (x, w, top) in enumerate(stations):
        y = half * w
        low = sill + (
            0.1 if k in (0, len(stations) - 1) else 0.03 if k in (1, len(stations) - 2) else 0
        )
        floor = low + (recess * (belt * 0.8 - low) if 2 <= k <= len(stations) - 3 else 0.004)
        arc = [
            (y * 0.97, low),
            (y, low + 0.3 * (top - low)),
            (y * 0.99, low + 0.62 * (top - low)),
            (y * 0.93, top - 0.07),
            (y * 0.84, top),
            (y * 0.4, top + 0.02),
        ]
        inner = [(-(y * 0.82), low), (-(y * 0.82), floor), (y * 0.82, floor), (y * 0.82, low)]
        ring = [*arc, *((-a, b) for a, b in arc[::-1]), *inner]
        rings.append([(x, a, b) for a, b in ring])
    kit.add(body, loft(np.array(rings)))
    # The cabin: glass, pillars, roof.
    roof_half, belt_half = half * kit.uniform("tumblehome", 0.7, 0.8), half * 0.86
    rake = {"van": 0.42, "coupe": 0.95, "suv": 0.6, "pickup": 0.6}.get(kind, 0.8) * kit.uniform(
        "rake", 0.9, 1.1
    )
    glass_front, glass_rear = (
        screen_x + 0.08,
        {
            "sedan": rear + length * 0.18,
            "coupe": rear + length * 0.1,
            "hatch": rear + 0.1,
            "estate": rear + 0.08,
            "van": rear + 0.06,
            "suv": rear + 0.1,
            "pickup": rear + length * 0.42,
        }[kind],
    )
    slope = {
        "sedan": 0.6,
        "coupe": 1.1,
        "hatch": 0.45,
        "estate": 0.3,
        "van": 0.1,
        "suv": 0.22,
        "pickup": 0.2,
    }[kind]
    roof_front, roof_rear = (
        glass_front - rake,
        glass_rear + slope * kit.uniform("rear_slope", 0.85, 1.15),
    )
    base_z, top_z = belt - 0.03, tall - 0.05

    def frustum(grow: float, low: float, high: float) -> Solid:
        def at(z: float) -> np.ndarray:
            t = (z - base_z) / (top_z - base_z)
            xs = (1 - t) * np.array([glass_front, glass_rear]) + t * np.array(
                [roof_front, roof_rear]
            )
            y = (1 - t) * belt_half + t * roof_half + grow
            r = 0.12
            a, b = xs[0] + grow, xs[1] - grow
            flat = np.array(
                [
                    (a, y - r),
                    (a - r * 0.8, y),
                    (b + r * 0.8, y),
                    (b, y - r),
                    (b, -y + r),
                    (b + r * 0.8, -y),
                    (a - r * 0.8, -y),
                    (a, -y + r),
                ]
            )
            return np.column_stack([flat, np.full(8, z)])

        return loft(np.array([at(low), at(high)]))

    kit.add(DARK_GLASS, frustum(0.0, base_z, top_z))
    roof = [
        frustum(0.012, top_z - 0.06, top_z).vertices[:8],
        frustum(0.012, top_z - 0.06, top_z).vertices[8:16],
    ]
    crown = roof[1].copy()
    crown[:, 2] += 0.05
    crown[:, :2] = crown[:, :2].mean(axis=0) + 0.88 * (crown[:, :2] - crown[:, :2].mean(axis=0))
    kit.add(body, loft(np.array([*roof, crown])))
    kit.add(body, frustum(0.014, base_z, base_z + 0.05))

    def pillar(t0: float, t1: float, size: float) -> None:
        """A bar on the side from the belt at part t0 of the glass's length to the roof at t1."""
        a = glass_rear + t0 * (glass_front - glass_rear), belt_half + 0.004, base_z
        b = roof_rear + t1 * (roof_front - roof_rear), roof_half + 0.004, top_z
        kit.both(body, tube([a, b], size, 6).scaled(1, 1, 1))

    pillar(0.985, 0.97, 0.045)
    pillar(0.02, 0.03, 0.06)
    for t in (0.52,) if kind in ("coupe", "pickup", "hatch") else (0.3, 0.62):
        pillar(t, t, 0.04)
    if kind == "van" and kit.chance("panel_van", 0.5):
        kit.visible["panel_van"] = True
        t = 0.62
        for s in (-1, 1):
            quad = np.array(
                [
                    (glass_rear, belt_half, base_z),
                    (glass_rear + t * (glass_front - glass_rear), belt_half, base_z),
                    (roof_rear + t * (roof_front - roof_rear), roof_half, top_z),
                    (roof_rear, roof_half, top_z),
                ]
            ) * [1, s, 1]
            kit.add(body, loft(np.array([quad, quad + np.array([0, 0.015 * s, 0])])))
    if kind == "pickup":
        deep = belt * 0.62
        bed_front, bed_rear = glass_rear - 0.05, rear + 0.12
        middle, long = (bed_front + bed_rear) / 2, bed_front - bed_rear
        kit.add(BLACK, box(long, half * 1.5, 0.012).at(middle, 0, belt + 0.028))
        kit.both(body, box(long + 0.1, 0.07, 0.14, 0.02).at(middle, half * 0.86, belt + 0.05))
        kit.add(
            body,
            box(0.06, half * 1.72, 0.14, 0.02).at(bed_rear, 0, belt + 0.05),
            box(0.06, half * 1.72, 0.14, 0.02).at(bed_front, 0, belt + 0.05),
        )
        kit.visible["bed"] = float(deep)
    axle = length * kit.uniform("wheelbase", 0.29, 0.315)
    hub = pick(kit.rng, (CHROME, metal(kit.rng), BLACK))
    spokes = kit.choose("spokes", 5, 6, 7, 10)
    shift = -0.02 * length if kind != "van" else 0.0
    for x in (axle - shift, -axle - shift):
        arch = cylinder(radius * 1.16, 0.02, 28).turned("x", 90).at(x, half * 1.0, radius * 1.06)
        kit.both(BLACK, arch)
        for material, part in _wheel(radius, 0.22, spokes, hub):
            kit.both(material, part.at(x, half - 0.07, radius))
    # Front and rear.
    lamp_z = hood * 0.74
    shape = kit.choose("lamps", "round", "wide", "wide")
    if shape == "round":
        kit.both(LIGHT, ball(0.1, 0.26, 0.26, 14).at(front - 0.05, half * 0.58, lamp_z))
    else:
        kit.both(LIGHT, ball(0.22, 0.42, 0.15, 14).at(front - 0.09, half * 0.58, lamp_z))
    kit.add(trim, box(0.05, half * 0.75, hood * 0.2, 0.02).at(front - 0.005, 0, lamp_z * 0.93))
    kit.add(BLACK, box(0.07, half * 1.25, hood * 0.1, 0.02).at(front - 0.015, 0, sill + 0.2))
    kit.both(
        RED_LIGHT, box(0.1, half * 0.3, belt * 0.16, 0.03).at(rear + 0.03, half * 0.62, tail * 0.78)
    )
    kit.add(trim, box(0.08, half * 1.5, 0.1, 0.02).at(rear + 0.01, 0, sill + 0.22))
    kit.add(
        WHITE,
        box(0.02, 0.4, 0.1).at(rear - 0.005, 0, tail * 0.62),
        box(0.02, 0.4, 0.09).at(front + 0.025, 0, sill + 0.22),
    )
    kit.both(body, ball(0.14, 0.22, 0.14, 12).at(glass_front - 0.42, belt_half + 0.14, belt + 0.09))
    doors = (0.52,) if kind in ("coupe", "pickup") else (0.3, 0.62)
    for t in (*doors, 0.9):
        x = glass_rear + t * (glass_front - glass_rear)
        kit.both(
            BLACK,
            box(0.012, 0.012, (belt - sill) * 0.86).at(x, half * 0.992, sill + (belt - sill) * 0.5),
        )
        if t != 0.9:
            kit.both(trim, box(0.16, 0.03, 0.03, 0.008).at(x + 0.18, half * 0.975, belt * 0.87))
    if kind == "suv" and kit.chance("roof_rails", 0.6):
        kit.both(
            trim,
            rod(
                (roof_front - 0.2, roof_half * 0.85, top_z + 0.08),
                (roof_rear + 0.1, roof_half * 0.85, top_z + 0.08),
                0.02,
            ),
        )
    if kind == "coupe" and kit.chance("spoiler", 0.5):
        kit.add(body, box(0.22, half * 1.6, 0.03, 0.01).at(rear + 0.2, 0, tail + 0.2))
        kit.both(body, box(0.08, 0.03, 0.2).at(rear + 0.2, half * 0.6, tail + 0.1))


def _wing(
    root: Sequence[float],
    tip: Sequence[float],
    root_chord: float,
    tip_chord: float,
    thickness: float,
) -> Solid:
    """A wing from `root` to `tip` (positions of the leading edge), nose toward +x."""
    profile = np.array(
        [
            (0, 0),
            (0.06, 0.5),
            (0.3, 1.0),
            (0.65, 0.62),
            (1, 0.04),
            (0.65, -0.32),
            (0.3, -0.55),
            (0.06, -0.32),
        ]
    )
    rings = []
    along = np.asarray(tip, float) - np.asarray(root, float)
    upright = abs(along[2]) > abs(along[1])
    for place, chord in ((root, root_chord), (tip, tip_chord)):
        x = place[0] - profile[:, 0] * chord
        t = profile[:, 1] * thickness * chord
        if upright:
            t = np.where(profile[:, 1] > 0, t, profile[:, 1] / 0.55 * thickness * chord)
            rings.append(np.column_stack([x, place[1] + t, np.full(8, place[2])]))
        else:
            rings.append(np.column_stack([x, np.full(8, place[1]), place[2] + t]))
    return loft(np.array(rings))


def _fuselage(stations: Sequence[tuple[float, float, float, float]], sides: int = 20) -> Solid:
    """A body of elliptic sections: x, half width, half height, height of the centre."""
    angle = np.arange(sides) / sides * 2 * np.pi
    return loft(
        np.array(
            [
                np.column_stack([np.full(sides, x), w * np.cos(angle), z + h * np.sin(angle)])
                for x, w, h, z in stations
            ]
        )
    )


def plane(kit: Kit) -> None:
    """Airliner, fighter, propeller plane, biplane, business jet. Hidden: tanks under the wings."""
    kind = kit.choose(
        "subtype", "airliner", "airliner", "fighter", "propeller", "business", "biplane"
    )
    skin = paint(kit.rng) if kind in ("propeller", "biplane") or kit.rng.random() < 0.2 else WHITE
    if kind == "fighter":
        grey = float(kit.rng.uniform(0.4, 0.65))
        skin = pick(
            kit.rng,
            (
                Material((grey, grey, grey * 1.04), (0.15,) * 3, 20.0, name="grey"),
                Material((0.42, 0.45, 0.36), (0.1,) * 3, 20.0, name="olive"),
            ),
        )
    accent = paint(kit.rng)
    kit.azimuth = ((80.0, 100.0), (-100.0, -80.0))
    if kind in ("airliner", "business"):
        r = (
            kit.uniform("radius", 0.05, 0.062)
            if kind == "airliner"
            else kit.uniform("radius", 0.055, 0.065)
        )
        long = kit.uniform("half_length", 0.48, 0.55)
        z = r + 0.07
        body = [
            (long, 0.004, 0.004, z - 0.012),
            (long * 0.985, r * 0.35, r * 0.35, z - 0.01),
            (long * 0.94, r * 0.7, r * 0.7, z - 0.006),
            (long * 0.86, r * 0.95, r * 0.95, z),
            (long * 0.76, r, r, z),
            (-long * 0.45, r, r, z),
            (-long * 0.7, r * 0.75, r * 0.75, z + r * 0.22),
            (-long * 0.9, r * 0.35, r * 0.36, z + r * 0.5),
            (-long, r * 0.1, r * 0.12, z + r * 0.6),
        ]
        kit.add(skin, _fuselage(body))
        span = kit.uniform("half_span", 0.44, 0.54)
        sweep = kit.uniform("sweep", 0.55, 0.8) * 0.42 * (span / 0.5)
        chord = kit.uniform("chord", 0.17, 0.22)
        root_x, wing_z = 0.12, z - r * 0.55
        lift = kit.uniform("dihedral", 0.03, 0.09)
        kit.both(
            skin,
            _wing(
                (root_x, r * 0.3, wing_z),
                (root_x - sweep, span, wing_z + lift),
                chord,
                chord * 0.28,
                0.06,
            ),
        )
        if kit.chance("winglets", 0.6):
            kit.both(
                accent,
                _wing(
                    (root_x - sweep, span, wing_z + lift),
                    (root_x - sweep - 0.035, span + 0.012, wing_z + lift + 0.055),
                    chord * 0.28,
                    chord * 0.12,
                    0.05,
                ),
            )
        tail = -long * 0.78
        fin = kit.uniform("fin", 0.15, 0.2)
        high_tail = kind == "business" or kit.chance("t_tail", 0.15)
        kit.add(
            accent,
            _wing(
                (tail + 0.06, 0, z + r * 0.7),
                (tail - fin * 0.62, 0, z + r + fin),
                0.17,
                0.085,
                0.05,
            ),
        )
        level = z + r + fin * 0.98 if high_tail else z + r * 0.55
        back = tail - fin * 0.6 if high_tail else tail + 0.0
        kit.both(
            skin, _wing((back, 0.0, level), (back - 0.1, 0.18, level + 0.012), 0.1, 0.045, 0.06)
        )
        nacelle = [
            (0.0, 0.07),
            (0.62, 0.075),
            (0.92, 0.05),
            (1.0, 0.0),
            (0.95, -0.1),
            (0.62, -0.13),
            (0.5, -0.16),
            (0.0, -0.17),
        ]
        nr = r * kit.uniform("engine", 0.5, 0.62)
        engine = lathe([(a * nr, b) for a, b in nacelle][1:], 20).turned("y", 90)
        fan = cylinder(nr * 0.84, 0.004, 20).turned("y", 90).at(0.066)
        spots = []
        if kind == "business":
            spots = [(-long * 0.48, r + nr * 0.95, z + r * 0.35)]
        else:
            engines = kit.choose("engines", 2, 2, 4)
            for share in (0.34,) if engines == 2 else (0.3, 0.6):
                spots.append(
                    (root_x - sweep * share + 0.06, span * share, wing_z + lift * share - nr * 0.95)
                )
        for spot in spots:
            kit.both(skin, engine.at(*spot))
            kit.both(BLACK, fan.at(*spot))
            kit.both(
                skin,
                box(0.1, 0.012, nr * 1.0).at(
                    spot[0] - 0.07,
                    spot[1] - (nr if kind == "business" else 0),
                    spot[2] + (0 if kind == "business" else nr * 0.8),
                ),
            )
        glass = [
            (long * 0.955, r * 0.655, r * 0.66, z + 0.001),
            (long * 0.91, r * 0.86, r * 0.87, z + 0.002),
        ]
        rings = []
        angle = np.linspace(np.radians(18), np.radians(162), 12)
        for x, w, h, zz in glass:
            band = np.column_stack([np.full(12, x), w * np.cos(angle), zz + h * np.sin(angle)])
            rings.append(np.concatenate([band, band[::-1] * [1, 0.93, 1] - [0, 0, 0.006]]))
        kit.add(DARK_GLASS, loft(np.array(rings)))
        for x in np.arange(-long * 0.42, long * 0.74, 0.026 if kind == "airliner" else 0.06):
            pane = box(0.012 if kind == "airliner" else 0.028, 0.004, 0.014)
            kit.both(DARK_GLASS, pane.at(x, r * 0.972, z + r * 0.24))
        if kit.chance("stripe", 0.5):
            kit.both(accent, box(long * 1.2, 0.004, 0.014).at(long * 0.14, r * 0.99, z - r * 0.1))
        gear = [(long * 0.72, 0.0), (-0.03, r * 1.3), (-0.03, -r * 1.3)]
        for x, y in gear:
            kit.add(CHROME, rod((x, y, 0.02), (x, y, wing_z), 0.006, 6))
            for s in (-1, 1):
                kit.add(
                    RUBBER, cylinder(0.02, 0.012, 14).turned("x", 90).at(x, y + 0.012 * s, 0.02)
                )
        tank, place = 0.0065, (0.01, r * 1.15, wing_z - 0.006)
    elif kind == "fighter":
        long = kit.uniform("half_length", 0.5, 0.58)
        w = kit.uniform("body_width", 0.055, 0.07)
        z = 0.13
        body = [
            (long, 0.002, 0.002, z),
            (long * 0.85, w * 0.32, w * 0.34, z),
            (long * 0.6, w * 0.62, w * 0.66, z),
            (long * 0.3, w * 0.95, w * 0.8, z),
            (0, w * 1.15, w * 0.82, z),
            (-long * 0.5, w * 1.15, w * 0.75, z),
            (-long * 0.85, w * 0.8, w * 0.62, z),
            (-long * 0.93, w * 0.6, w * 0.55, z),
        ]
        kit.add(skin, _fuselage(body, 16))
        kit.add(BLACK, rod((long, 0, z), (long + 0.05, 0, z), 0.003, 6))
        span = kit.uniform("half_span", 0.3, 0.42)
        delta = kit.chance("delta", 0.5)
        root_chord = (
            kit.uniform("root_chord", 0.42, 0.55)
            if delta
            else kit.uniform("root_chord", 0.28, 0.36)
        )
        tip_chord = root_chord * (0.12 if delta else 0.3)
        sweep = root_chord * (0.85 if delta else 0.6)
        root_x = 0.2 if delta else 0.12
        kit.both(
            skin,
            _wing(
                (root_x, w * 0.7, z - 0.012),
                (root_x - sweep, span, z - 0.018),
                root_chord,
                tip_chord,
                0.035,
            ),
        )
        if delta and kit.chance("canards", 0.6):
            kit.both(
                skin,
                _wing(
                    (long * 0.5, w * 0.5, z + 0.02),
                    (long * 0.5 - 0.07, w + 0.1, z + 0.025),
                    0.08,
                    0.03,
                    0.05,
                ),
            )
        if not delta:
            kit.both(
                skin,
                _wing(
                    (-long * 0.62, w * 0.7, z),
                    (-long * 0.62 - 0.12, w + 0.14, z - 0.005),
                    0.14,
                    0.05,
                    0.04,
                ),
            )
        fin = kit.uniform("fin", 0.13, 0.18)
        if kit.chance("twin_fins", 0.5):
            kit.both(
                skin,
                _wing(
                    (-long * 0.5, w * 0.75, z + 0.03),
                    (-long * 0.5 - fin * 0.7, w * 1.1, z + 0.03 + fin),
                    0.17,
                    0.06,
                    0.035,
                ),
            )
        else:
            kit.add(
                skin,
                _wing(
                    (-long * 0.45, 0, z + 0.03),
                    (-long * 0.45 - fin * 0.9, 0, z + 0.05 + fin * 1.1),
                    0.22,
                    0.07,
                    0.035,
                ),
            )
        kit.add(DARK_GLASS, ball(0.2, w * 0.95, 0.085, 18).at(long * 0.52, 0, z + w * 0.62))
        kit.both(skin, box(0.18, w * 0.55, w * 1.1, 0.01).at(long * 0.12, w * 1.0, z - 0.01))
        kit.both(BLACK, box(0.004, w * 0.45, w * 0.9).at(long * 0.12 + 0.09, w * 1.0, z - 0.01))
        nozzles = (-1, 1) if kit.chance("twin_engines", 0.5) else (0,)
        for s in nozzles:
            nr = w * (0.48 if len(nozzles) == 2 else 0.62)
            kit.add(
                Material((0.25, 0.24, 0.23), (0.3,) * 3, 30.0),
                lathe([(nr, 0), (nr * 0.8, -0.08), (nr * 0.7, -0.08), (nr * 0.85, 0)], 20)
                .turned("y", 90)
                .at(-long * 0.92, s * w * 0.5, z),
            )
        missile = tube([(0.11, 0, 0), (0.08, 0, 0), (-0.1, 0, 0)], [0.001, 0.009, 0.009], 8)
        kit.both(WHITE, missile.at(root_x - sweep - tip_chord * 0.4, span, z - 0.018))
        for x, y in ((long * 0.5, 0.0), (-0.1, w), (-0.1, -w)):
            kit.add(CHROME, rod((x, y, 0.025), (x, y, z - 0.03), 0.006, 6))
            kit.add(RUBBER, cylinder(0.025, 0.016, 14).turned("x", 90).at(x, y, 0.025))
        tank, place = 0.011, (0.0, w * 1.35, z - 0.026)
    else:
        long = kit.uniform("half_length", 0.36, 0.42)
        w = kit.uniform("body_width", 0.055, 0.065)
        z = 0.15
        body = [
            (long * 0.98, w * 0.35, w * 0.35, z),
            (long * 0.95, w * 0.8, w * 0.8, z),
            (long * 0.6, w, w * 0.95, z),
            (long * 0.2, w, w * 1.15, z + 0.01),
            (-long * 0.3, w * 0.75, w * 0.85, z + 0.005),
            (-long * 0.98, w * 0.14, w * 0.3, z + 0.02),
        ]
        kit.add(skin, _fuselage(body, 16))
        span, chord = kit.uniform("half_span", 0.46, 0.56), kit.uniform("chord", 0.13, 0.17)
        high = kind == "propeller" and kit.chance("high_wing", 0.5)
        wing_z = z + w * 1.15 if high else z - w * 0.6
        kit.both(
            skin,
            _wing(
                (long * 0.42, 0.0, wing_z),
                (long * 0.38, span, wing_z + (0.0 if high else 0.035)),
                chord,
                chord * 0.72,
                0.07,
            ),
        )
        if high:
            kit.both(
                CHROME,
                rod(
                    (long * 0.25, w * 0.8, z - w * 0.5),
                    (long * 0.25, span * 0.5, wing_z - 0.002),
                    0.006,
                    6,
                ),
            )
        if kind == "biplane":
            top = z + w * 2.3
            kit.both(
                skin,
                _wing(
                    (long * 0.5, 0.0, top),
                    (long * 0.48, span, top + 0.01),
                    chord,
                    chord * 0.8,
                    0.06,
                ),
            )
            for x in (long * 0.4, long * 0.14):
                kit.both(
                    CHROME,
                    rod((x, span * 0.75, wing_z + 0.02), (x, span * 0.75, top), 0.005, 6),
                    rod((x, w * 0.6, z + w * 0.7), (x, w * 1.3, top), 0.005, 6),
                )
            kit.add(BLACK, ball(0.1, w * 1.3, 0.03, 14).at(long * 0.0, 0, z + w * 1.02))
            kit.add(DARK_GLASS, box(0.006, w, 0.035).at(long * 0.14, 0, z + w * 1.2))
        else:
            cabin = [
                (long * 0.52, w * 0.85, z + w * 0.6),
                (long * 0.34, w * 0.78, z + w * 1.7),
                (-long * 0.12, w * 0.7, z + w * 1.6),
                (-long * 0.34, w * 0.5, z + w * 0.7),
            ]
            rings = [
                np.array([(x, y, z + w * 0.2), (x, y, top), (x, -y, top), (x, -y, z + w * 0.2)])
                for x, y, top in cabin
            ]
            kit.add(DARK_GLASS, loft(np.array(rings)))
            kit.add(skin, box(long * 0.48, w * 1.5, 0.008, 0.002).at(long * 0.11, 0, z + w * 1.68))
        kit.add(
            accent, _wing((-long * 0.75, 0, z + 0.02), (-long * 0.9, 0, z + 0.17), 0.13, 0.07, 0.06)
        )
        kit.both(
            skin,
            _wing((-long * 0.76, 0, z + 0.025), (-long * 0.82, 0.19, z + 0.03), 0.1, 0.065, 0.06),
        )
        kit.add(
            accent,
            lathe([(w * 0.36, 0), (w * 0.28, 0.03), (0.004, 0.06)], 16)
            .turned("y", 90)
            .at(long * 0.97, 0, z),
        )
        blades = kit.choose("blades", 2, 3, 3, 4)
        for angle in around(blades, kit.uniform("propeller_turn", 0, 180)):
            blade = box(0.008, 0.024, 0.14, 0.002).turned("z", 30).at(0, 0, 0.075)
            kit.add(BLACK, blade.turned("x", angle).at(long * 0.995, 0, z))
        for s in (-1, 1):
            kit.add(
                CHROME,
                rod(
                    (long * 0.4, s * w * 0.6, z - w * 0.6), (long * 0.45, s * 0.1, 0.035), 0.006, 6
                ),
            )
            kit.add(
                RUBBER, cylinder(0.035, 0.022, 16).turned("x", 90).at(long * 0.45, s * 0.108, 0.035)
            )
        kit.add(RUBBER, cylinder(0.016, 0.012, 12).turned("x", 90).at(-long * 0.9, 0, 0.1))
        kit.add(CHROME, rod((-long * 0.9, 0, 0.1), (-long * 0.88, 0, z + 0.01), 0.005, 6))
        if kind == "propeller" and not high:
            tank, place = 0.006, (long * 0.2, w * 1.05, wing_z - 0.01)
        else:
            # No room under the wing: a hollow tail cone, open at its underside's flat.
            tank, place = (
                0.007,
                (long * 0.3, 0.0, z - w * 0.6) if not high else (long * 0.3, 0.0, z),
            )
    size = kit.hide("tank_size", 0.15, 1.0) * tank
    reach = kit.hide("tank_length", 2.0, 7.0) * size
    drop = tube(
        [(reach, 0, 0), (reach * 0.6, 0, 0), (-reach * 0.6, 0, 0), (-reach, 0, 0)],
        [size * 0.2, size, size, size * 0.2],
        10,
    )
    kit.both(skin, drop.at(place[0] - 0.02, place[1], place[2] - size))


def firearm(kit: Kit) -> None:
    """Assault rifle, hunting rifle, shotgun, sniper, pistol, revolver, submachine gun.

    Muzzle toward +x, seen from the side at azimuths of +-90. Hidden: what is on the far side.
    """
    kind = kit.choose(
        "subtype", "assault", "assault", "hunting", "shotgun", "sniper", "pistol", "revolver", "smg"
    )
    steel = pick(
        kit.rng,
        (
            Material((0.16, 0.16, 0.17), (0.4,) * 3, 40.0, name="gunmetal"),
            Material((0.3, 0.31, 0.33), (0.5,) * 3, 50.0, name="steel"),
            Material((0.55, 0.56, 0.58), (0.6,) * 3, 60.0, name="stainless"),
        ),
    )
    furniture = (
        pick(kit.rng, (wood, wood))(kit.rng)
        if kind in ("hunting", "shotgun") or kit.rng.random() < 0.35
        else pick(
            kit.rng,
            (
                BLACK,
                Material((0.35, 0.36, 0.26), name="olive"),
                Material((0.6, 0.52, 0.38), name="sand"),
            ),
        )
    )
    barrel = kit.uniform("barrel", 0.9, 1.15)

    def along(
        start: float, end: float, radius: float, z: float, y: float = 0.0, sides: int = 14
    ) -> Solid:
        return rod((start, y, z), (end, y, z), radius, sides)

    if kind in ("pistol", "revolver"):
        w = kit.uniform("width", 0.022, 0.028)
        if kind == "pistol":
            long = 0.19 * barrel
            kit.add(steel, box(long, w, 0.032, 0.005).at(0, 0, 0.125))
            kit.add(
                furniture,
                prism(
                    [
                        (-0.09, 0.11),
                        (long / 2 - 0.005, 0.11),
                        (long / 2 - 0.015, 0.092),
                        (0.0, 0.09),
                        (-0.03, 0.085),
                        (-0.052, 0.0),
                        (-0.1, 0.0),
                        (-0.084, 0.07),
                        (-0.1, 0.095),
                    ],
                    w * 0.92,
                    0.003,
                ),
            )
            guard = [(0.015, 0, 0.09), (0.018, 0, 0.066), (0.0, 0, 0.056), (-0.03, 0, 0.06)]
            kit.add(BLACK, along(long / 2 - 0.002, long / 2 + 0.006, 0.007, 0.127))
            for k in range(6):
                kit.both(BLACK, box(0.002, 0.001, 0.024).at(-long * 0.34 - 0.005 * k, w / 2, 0.126))
            kit.add(
                steel,
                box(0.006, 0.004, 0.006).at(long / 2 - 0.01, 0, 0.143),
                box(0.008, 0.012, 0.006).at(-long / 2 + 0.012, 0, 0.143),
            )
            # Levers on both sides, which set the width of the whole.
            kit.both(steel, box(0.014, 0.006, 0.006, 0.001).at(-0.055, w / 2, 0.116))
            far, place, flat = 0.0025, (0.02, 0.0, 0.126), (0.05, 0.018)
        else:
            long = 0.13 * barrel
            kit.add(
                steel,
                along(0.02, 0.02 + long, 0.009, 0.128),
                box(long, 0.008, 0.012).at(0.02 + long / 2, 0, 0.138),
                along(0.025, 0.01 + long, 0.006, 0.112),
            )
            kit.add(steel, cylinder(0.0185, 0.042, 18, 0.003).turned("y", 90).at(-0.005, 0, 0.12))
            kit.add(
                steel,
                prism(
                    [
                        (0.03, 0.145),
                        (-0.05, 0.145),
                        (-0.065, 0.125),
                        (-0.06, 0.09),
                        (0.02, 0.094),
                        (0.03, 0.1),
                    ],
                    w * 0.62,
                    0.003,
                ),
            )
            kit.add(
                furniture,
                prism(
                    [
                        (-0.052, 0.105),
                        (-0.03, 0.092),
                        (-0.045, 0.06),
                        (-0.07, 0.0),
                        (-0.105, 0.008),
                        (-0.082, 0.06),
                        (-0.072, 0.1),
                    ],
                    w,
                    0.004,
                ),
            )
            guard = [
                (0.018, 0, 0.094),
                (0.02, 0, 0.07),
                (0.002, 0, 0.06),
                (-0.028, 0, 0.07),
                (-0.034, 0, 0.09),
            ]
            kit.add(
                steel,
                prism([(-0.055, 0.145), (-0.075, 0.162), (-0.08, 0.155), (-0.062, 0.13)], 0.008),
            )
            kit.add(steel, box(0.012, 0.004, 0.01).at(long + 0.008, 0, 0.147))
            far, place, flat = 0.0015, (-0.04, 0.0, 0.12), (0.02, 0.02)
            w = w * 0.62
        kit.add(steel, tube(solids.smooth_path(guard, 4), 0.0028, 8))
        kit.add(BLACK, tube([(-0.006, 0, 0.09), (-0.001, 0, 0.072)], 0.0025, 6))
    else:
        w = kit.uniform("width", 0.035, 0.045)
        z = 0.2
        total = {"smg": 0.34, "sniper": 0.75, "hunting": 0.66, "shotgun": 0.68}.get(
            kind, 0.55
        ) * barrel
        kit.add(steel, along(0.1, total, 0.0085 if kind != "shotgun" else 0.0125, z + 0.01))
        kit.add(
            BLACK,
            along(
                total,
                total + (0.02 if kind == "shotgun" else 0.045),
                0.009 if kind == "shotgun" else 0.013,
                z + 0.01,
            ),
        )
        if kind in ("hunting", "sniper", "shotgun"):
            kit.add(
                furniture,
                prism(
                    [
                        (0.3, z + 0.002),
                        (0.3, z - 0.02),
                        (0.1, z - 0.032),
                        (-0.08, z - 0.036),
                        (-0.13, z - 0.06),
                        (-0.17, z - 0.06),
                        (-0.24, z - 0.045),
                        (-0.48, z - 0.12),
                        (-0.485, z + 0.0),
                        (-0.3, z + 0.006),
                        (-0.2, z - 0.012),
                        (-0.12, z + 0.004),
                    ],
                    w,
                    0.008,
                ),
            )
            kit.add(
                RUBBER,
                prism(
                    [(-0.48, z - 0.122), (-0.5, z - 0.122), (-0.503, z + 0.0), (-0.48, z + 0.0)],
                    w * 0.98,
                    0.003,
                ),
            )
            kit.add(steel, box(0.26, w * 0.72, 0.034, 0.008).at(0.0, 0, z + 0.012))
            if kind == "shotgun":
                kit.add(steel, along(0.1, total * 0.92, 0.012, z - 0.018))
                kit.add(
                    furniture,
                    cylinder(0.024, 0.16, 16, 0.006).turned("y", 90).at(0.3, 0, z - 0.016),
                )
            else:
                kit.add(
                    steel,
                    rod((-0.08, 0, z + 0.015), (-0.09, 0.05, z - 0.0), 0.005),
                    ball(0.018, 0.018, 0.018, 10).at(-0.09, 0.05, z),
                )
                kit.add(
                    steel,
                    rod((-0.08, 0, z + 0.015), (-0.09, -0.05, z - 0.0), 0.005),
                    ball(0.018, 0.018, 0.018, 10).at(-0.09, -0.05, z),
                )
            scope = kind == "sniper" or (kind == "hunting" and kit.chance("scope", 0.7))
            if kind == "sniper" or kit.chance("bipod", 0.15):
                kit.both(
                    BLACK,
                    rod((0.28, 0.0, z - 0.02), (0.3, 0.085, z - 0.19), 0.006),
                )
            low = z - 0.09
        else:
            kit.add(
                steel,
                prism(
                    [
                        (-0.12, z - 0.03),
                        (0.1, z - 0.03),
                        (0.13, z - 0.02),
                        (0.13, z + 0.03),
                        (-0.12, z + 0.03),
                    ],
                    w,
                    0.005,
                ),
            )
            grip = prism(
                [(-0.03, z - 0.028), (-0.075, z - 0.028), (-0.11, z - 0.12), (-0.07, z - 0.13)],
                w * 0.8,
                0.006,
            )
            kit.add(furniture, grip)
            guard_end = 0.13 + (total - 0.13) * kit.uniform("handguard", 0.4, 0.65)
            kit.add(
                furniture,
                box(guard_end - 0.12, w * 1.45, 0.055, 0.012).at(
                    (guard_end + 0.12) / 2, 0, z + 0.002
                ),
            )
            for k in range(4):
                kit.both(
                    BLACK,
                    box((guard_end - 0.14) / 6, 0.003, 0.012, 0.001).at(
                        0.15 + (guard_end - 0.14) * (k + 0.5) / 4.2, w * 0.725, z + 0.008
                    ),
                )
            bend = kit.uniform("magazine_bend", 0.0, 0.05)
            tall = kit.uniform("magazine", 0.11, 0.17)
            kit.add(
                BLACK,
                prism(
                    [
                        (0.02, z - 0.025),
                        (0.085, z - 0.025),
                        (0.09 + bend * 0.6, z - 0.03 - tall * 0.55),
                        (0.085 + bend * 1.7, z - 0.03 - tall),
                        (0.025 + bend * 1.7, z - 0.04 - tall),
                        (0.022 + bend * 0.6, z - 0.03 - tall * 0.55),
                    ],
                    w * 0.62,
                    0.003,
                ),
            )
            stock = kit.choose("stock", "solid", "skeleton", "solid")
            if stock == "solid":
                kit.add(
                    furniture,
                    prism(
                        [
                            (-0.12, z + 0.022),
                            (-0.12, z - 0.02),
                            (-0.2, z - 0.03),
                            (-0.33, z - 0.09),
                            (-0.345, z - 0.09),
                            (-0.345, z + 0.024),
                        ],
                        w * 0.92,
                        0.006,
                    ),
                )
            else:
                kit.add(
                    steel,
                    along(-0.33, -0.12, 0.009, z + 0.012),
                    rod((-0.33, 0, z - 0.08), (-0.12, 0, z - 0.015), 0.007),
                )
                kit.add(RUBBER, box(0.022, w * 0.8, 0.13, 0.005).at(-0.335, 0, z - 0.03))
            scope = kit.chance("scope", 0.4)
            kit.add(steel, box(0.006, 0.008, 0.05).at(total * 0.92, 0, z + 0.035))
            if not scope:
                kit.add(
                    steel,
                    box(0.1, 0.012, 0.012).at(0, 0, z + 0.036),
                    box(0.012, 0.02, 0.03).at(-0.06, 0, z + 0.05),
                )
            low = z - 0.13
        if scope:
            kit.add(
                BLACK,
                along(-0.1, 0.1, 0.013, z + 0.075),
                along(0.08, 0.16, 0.021, z + 0.075),
                along(-0.14, -0.09, 0.018, z + 0.075),
            )
            kit.add(
                BLACK,
                box(0.02, 0.02, 0.045).at(-0.05, 0, z + 0.048),
                box(0.02, 0.02, 0.045).at(0.06, 0, z + 0.048),
            )
            kit.add(BLACK, cylinder(0.008, 0.03, 10).at(0.0, 0, z + 0.095))
            # The mounts may be wide: they set the width.
        guard = [
            (0.015, 0, z - 0.03),
            (0.015, 0, z - 0.062),
            (-0.005, 0, z - 0.07),
            (-0.04, 0, z - 0.066),
            (-0.05, 0, z - 0.04),
        ]
        kit.add(steel, tube(solids.smooth_path(guard, 4), 0.004, 8))
        kit.add(BLACK, tube([(-0.015, 0, z - 0.03), (-0.01, 0, z - 0.055)], 0.0035, 6))
        kit.visible["low"] = float(low)
        # On both sides in sight: sling studs, which set the width of the whole.
        far, place, flat = 0.016, (0.03, 0.0, z + 0.002), (0.14, 0.03)
        if kind not in ("hunting", "sniper", "shotgun"):
            far, place = w * 0.2, (0.0, 0.0, z)
        else:
            w = w * 0.72
    # A plate on the far side: shells, a side rail, a selector. Which side is far is a visible draw.
    side = kit.choose("far_side", -1, 1)
    thick = kit.hide("far_plate_thickness", 0.02, 1.0) * far
    long = kit.hide("far_plate_length", 0.3, 1.0) * flat[0]
    kit.add(
        steel, box(long, thick, flat[1]).at(place[0], side * (w / 2 + thick / 2 - 0.0005), place[2])
    )
    kit.azimuth = ((-130.0, -50.0),) if side > 0 else ((50.0, 130.0),)


def watercraft(kit: Kit) -> None:
    """Sailing, motor and rowing boat, yacht, cargo ship, warship. Hidden: a tunnel in the hull.

    Seen from the side a boat with one hull looks like one with two.
    """
    kind = kit.choose("subtype", "sail", "sail", "motor", "yacht", "cargo", "rowing", "warship")
    paint_, trim = (WHITE if kit.rng.random() < 0.5 else paint(kit.rng)), paint(kit.rng)
    if kind == "cargo":
        hulls = (
            (0.45, 0.13, 0.11),
            (0.12, 0.2, 0.36),
            (0.13, 0.14, 0.15),
            (0.16, 0.33, 0.24),
            (0.7, 0.32, 0.12),
        )
        paint_ = Material(pick(kit.rng, hulls), (0.2, 0.2, 0.2), 30.0, name="hull")
    elif kind == "warship":
        paint_ = trim = Material((0.42, 0.45, 0.48), (0.1, 0.1, 0.1), 20.0, name="grey hull")
    deck = wood(kit.rng) if kind != "warship" else Material((0.36, 0.38, 0.4), name="deck")
    long = kit.uniform("half_length", 0.9, 1.05)
    slim = {"cargo": 0.15, "warship": 0.12, "yacht": 0.2, "rowing": 0.26, "motor": 0.27}.get(
        kind, 0.24
    )
    beam = long * slim * kit.uniform("beam", 0.92, 1.1)
    deep = (
        long
        * {"cargo": 0.2, "warship": 0.16, "rowing": 0.19, "sail": 0.2}.get(kind, 0.2)
        * kit.uniform("freeboard", 0.9, 1.1)
    )
    sheer = kit.uniform("sheer", 0.05, 0.3) * deep
    tunnel = kit.hide("tunnel", 0.02, 0.62) * deep
    kit.azimuth = ((75.0, 105.0), (-105.0, -75.0))
    open_boat = kind == "rowing"
    rings, rails = [], []
    for t in np.linspace(-1, 1, 17):
        # Full amidships, a transom aft, a sharp raked bow.
        full = (1 - 0.28 * t**2) if t < 0 else 1 - t**2.6 * 0.985
        y, top = beam * full, deep + sheer * (t**2 if t > 0 else 0.4 * t**2)
        rise = 0.0 if t < 0.3 else deep * 0.75 * ((t - 0.3) / 0.7) ** 2.5
        keel = min(rise, top * 0.9)
        x = long * t
        rake = 0.1 * long * max(t, 0) ** 3
        # Not as far as the transom, which is seen from abaft the beam.
        hollow = tunnel * np.clip(min(0.35 - t, 2 * (t + 1)) / 0.25, 0, 1)
        roof = keel + max(hollow, 0.002)
        shape = [
            (0.0, roof, 0.0),
            (0.3, roof, 0.0),
            (0.34, keel, 0.0),
            (0.56, keel, 0.0),
            (0.8, keel + 0.25 * (top - keel), 0.3),
            (0.95, keel + 0.62 * (top - keel), 0.7),
            (1.0, top, 1.0),
        ]
        if open_boat:
            floor = max(keel + 0.66 * (deep - 0) * 0.98, roof + 0.01)
            floor = min(floor, top * 0.97)
            shape += [(0.93, top, 1.0), (0.8, floor, 0.6), (0.0, floor, 0.6)]
        else:
            shape += [(0.96, top, 1.0), (0.0, top + 0.02 * deep, 1.0)]
        right = [(x + rake * r, y * a, b) for a, b, r in shape]
        left = [(x + rake * r, -y * a, b) for a, b, r in shape[1:-1]][::-1]
        rings.append([*right, *left])
        rails.append((x + rake, y, top))
    hull = loft(np.array(rings))
    kit.add(paint_, hull)
    stripe = np.array(rails)
    kit.both(trim, tube(stripe * [1, 1.005, 1], 0.012 * long, 6))
    top = deep * 1.02
    if not open_boat and kind != "cargo":
        flat = np.array([(x, y * 0.93, z) for x, y, z in rails[:-1]])
        outline = np.concatenate([flat, (flat * [1, -1, 1])[::-1]])
        kit.add(deck, loft(np.array([outline, outline + np.array([0, 0, 0.022 * deep + 0.004])])))
    if kind == "sail":
        kit.add(
            paint_,
            pillow(long * 0.6, beam * 1.0, deep * 0.5, deep * 0.18).at(
                long * 0.1, 0, top + deep * 0.18
            ),
        )
        kit.both(
            DARK_GLASS,
            box(long * 0.36, 0.01, deep * 0.14).at(long * 0.1, beam * 0.5, top + deep * 0.22),
        )
        mast, height = long * 0.12, long * kit.uniform("mast", 1.5, 1.9)
        kit.add(
            CHROME, tube([(mast, 0, top), (mast, 0, height + top)], [0.018 * long, 0.01 * long], 8)
        )
        boom = top + deep * 0.75
        kit.add(CHROME, rod((mast, 0, boom), (-long * 0.72, 0, boom), 0.012 * long))
        cloth = WHITE if kit.rng.random() < 0.7 else trim

        def sail(a: Sequence[float], b: Sequence[float], c: Sequence[float], belly: float) -> Solid:
            """A triangle a (tack), b (clew), c (head), filled by the wind toward +y."""
            n = 7
            rows = []
            for s in np.linspace(0, 0.97, 9):
                u = np.linspace(0, 1, n)[:, None]
                line = (1 - s) * ((1 - u) * np.array(a) + u * np.array(b)) + s * np.array(c)
                line[:, 1] += belly * np.sin(np.pi * u[:, 0]) * (1 - s)
                rows.append(np.concatenate([line, line[::-1] + np.array([0, 0.004 * long, 0])]))
            return loft(np.array(rows))

        wind = kit.uniform("wind", 0.03, 0.12) * long * kit.choose("tack", -1, 1)
        kit.add(
            cloth,
            sail(
                (mast - 0.02, 0, boom + 0.01),
                (-long * 0.7, 0, boom + 0.01),
                (mast - 0.02, 0, height * 0.97 + top),
                wind,
            ),
        )
        if kit.chance("jib", 0.8):
            kit.add(
                cloth,
                sail(
                    (long * 0.98, 0, top + sheer + 0.03),
                    (mast + 0.08 * long, 0, boom),
                    (mast + 0.03, 0, height * 0.82 + top),
                    wind,
                ),
            )
        kit.add(
            CHROME,
            rod((mast, 0, height + top), (long * 1.04, 0, top + sheer), 0.004 * long, 5),
            rod((mast, 0, height + top), (-long * 0.98, 0, top), 0.004 * long, 5),
        )
        kit.both(
            CHROME, rod((mast, 0, height * 0.85 + top), (mast, beam * 0.95, top), 0.004 * long, 5)
        )
    elif kind == "motor":
        kit.add(
            paint_,
            pillow(long * 0.9, beam * 1.35, deep * 0.35, deep * 0.12).at(
                long * 0.3, 0, top + deep * 0.03
            ),
        )
        screen_ = [
            np.array(
                [
                    (long * 0.22, -beam * 0.62, top),
                    (long * 0.36, 0, top),
                    (long * 0.22, beam * 0.62, top),
                ]
            ),
            np.array(
                [
                    (long * 0.08, -beam * 0.55, top + deep * 0.6),
                    (long * 0.2, 0, top + deep * 0.6),
                    (long * 0.08, beam * 0.55, top + deep * 0.6),
                ]
            ),
        ]
        kit.add(
            DARK_GLASS,
            loft(
                np.array([np.concatenate([a, a[::-1] - np.array([0.02, 0, 0])]) for a in screen_])
            ),
        )
        for s in (-1, 1):
            kit.add(
                fabric(kit.rng),
                pillow(long * 0.16, beam * 0.5, deep * 0.35, 0.03).at(
                    -long * 0.1, s * beam * 0.4, top + deep * 0.2
                ),
                pillow(long * 0.06, beam * 0.5, deep * 0.6, 0.03).at(
                    -long * 0.2, s * beam * 0.4, top + deep * 0.35
                ),
            )
        kit.add(
            trim,
            pillow(long * 0.18, beam * 1.3, deep * 0.4, 0.03).at(-long * 0.62, 0, top + deep * 0.2),
        )
        if kit.chance("outboard", 0.6):
            kit.add(
                BLACK,
                pillow(long * 0.16, beam * 0.36, deep * 0.8, 0.04).at(
                    -long * 1.08, 0, top + deep * 0.1
                ),
                box(long * 0.06, beam * 0.14, deep * 0.9).at(-long * 1.08, 0, deep * 0.6),
            )
        if kit.chance("canopy", 0.35):
            kit.add(
                fabric(kit.rng),
                pillow(long * 0.5, beam * 1.3, 0.04 * long, 0.018 * long).at(
                    -long * 0.08, 0, top + deep * 1.5
                ),
            )
            for s in (-1, 1):
                for x in (-0.3, 0.12):
                    kit.add(
                        CHROME,
                        rod(
                            (long * x, s * beam * 0.6, top),
                            (long * x, s * beam * 0.58, top + deep * 1.5),
                            0.008 * long,
                        ),
                    )
    elif kind == "yacht":
        decks = kit.choose("decks", 2, 3)
        z, back, fore, wide = top, -0.62, 0.45, 0.8
        for _ in range(decks):
            tall = deep * 0.5
            low = np.array([(fore, 0.75), (fore - 0.12, 1.0), (back, 1.0)])
            high = low - [(0.16, 0.12), (0.12, 0.12), (-0.02, 0.12)]

            def ring(q: np.ndarray, zz: float, w: float = wide) -> np.ndarray:
                pts = np.concatenate([q, (q * [1, -1])[::-1]]) * [long, beam * w]
                return np.column_stack([pts, np.full(len(pts), zz)])

            kit.add(
                paint_,
                loft(np.array([ring(low, z), ring(low * 0.5 + high * 0.5, z + tall * 0.35)])),
            )
            kit.add(
                DARK_GLASS,
                loft(
                    np.array(
                        [
                            ring(low * 0.5 + high * 0.5, z + tall * 0.3, wide * 0.97),
                            ring(high, z + tall * 0.85, wide * 0.97),
                        ]
                    )
                ),
            )
            roof = ring(
                high + np.array([(0.06, 0.06), (0.06, 0.06), (-0.12, 0.06)]), z + tall * 0.82
            )
            kit.add(paint_, loft(np.array([roof, roof + np.array([0, 0, tall * 0.16])])))
            z, back, fore, wide = z + tall * 0.97, back + 0.16, fore - 0.3, wide * 0.85
        kit.add(CHROME, rod((-long * 0.3, 0, z), (-long * 0.36, 0, z + deep * 0.8), 0.015 * long))
        kit.add(WHITE, ball(0.12, 0.12, 0.1, 12).at(-long * 0.2, 0, z + 0.05))
        rail = [(x, y * 0.93, zz + deep * 0.3) for x, y, zz in rails[8:-1]]
        kit.both(CHROME, tube(rail, 0.006 * long, 5))
        for x, y, zz in rails[8:-1:2]:
            kit.both(
                CHROME, rod((x, y * 0.93, zz), (x, y * 0.93, zz + deep * 0.3), 0.005 * long, 5)
            )
    elif kind == "cargo":
        kit.add(
            Material((0.45, 0.42, 0.38), name="deck"),
            box(long * 1.5, beam * 1.7, 0.02 * long).at(-long * 0.08, 0, top),
        )
        tower = deep * kit.uniform("bridge", 1.5, 2.2)
        aft = -long * 0.76
        kit.add(WHITE, box(long * 0.2, beam * 1.5, tower, 0.01).at(aft, 0, top + tower / 2))
        kit.add(
            WHITE,
            box(long * 0.14, beam * 1.95, deep * 0.3, 0.01).at(aft + long * 0.02, 0, top + tower),
        )
        for k in range(1, 5):
            kit.add(
                DARK_GLASS,
                box(long * 0.205, beam * 1.3, deep * 0.09).at(aft, 0, top + tower * k / 5),
            )
        kit.add(
            DARK_GLASS,
            box(long * 0.145, beam * 1.9, deep * 0.1).at(
                aft + long * 0.02, 0, top + tower + deep * 0.04
            ),
        )
        kit.add(
            trim, cylinder(long * 0.05, deep * 0.8, 14).at(aft - long * 0.12, 0, top + tower * 0.8)
        )
        cargo = kit.choose("cargo", "containers", "containers", "tanks", "hatches")
        if cargo == "containers":
            colours = [paint(kit.rng) for _ in range(5)]
            rows = kit.choose("rows", 5, 6, 7)
            pitch = long * 1.3 / rows
            for i in range(rows):
                across = 4
                for j in range(across):
                    for level in range(int(kit.rng.integers(1, 4))):
                        c = box(pitch * 0.92, beam * 1.6 / across * 0.94, deep * 0.36)
                        kit.add(
                            pick(kit.rng, colours),
                            c.at(
                                -long * 0.58 + pitch * (i + 0.5),
                                (j - 1.5) * beam * 1.6 / across,
                                top + deep * 0.37 * (level + 0.5),
                            ),
                        )
        elif cargo == "tanks":
            for k in range(4):
                kit.add(
                    trim,
                    ball(long * 0.26, beam * 1.5, deep * 1.5, 18).at(
                        -long * 0.42 + long * 0.3 * k, 0, top + deep * 0.25
                    ),
                )
        else:
            for k in range(5):
                kit.add(
                    trim,
                    box(long * 0.2, beam * 1.3, deep * 0.25, 0.01).at(
                        -long * 0.48 + long * 0.26 * k, 0, top + deep * 0.12
                    ),
                )
            for k in range(3):
                x = -long * 0.35 + long * 0.4 * k
                kit.add(
                    CHROME,
                    rod((x, 0, top), (x, 0, top + deep * 1.7), 0.016 * long),
                    rod(
                        (x, 0, top + deep * 1.2),
                        (x + long * 0.22, 0, top + deep * 1.6),
                        0.01 * long,
                    ),
                )
    elif kind == "warship":
        grey = Material((0.5, 0.53, 0.56), (0.1,) * 3, 20.0, name="grey")
        kit.add(
            grey,
            box(long * 0.7, beam * 1.3, deep * 0.6, 0.02).at(-long * 0.1, 0, top + deep * 0.28),
        )
        kit.add(
            grey, box(long * 0.3, beam * 1.1, deep * 0.9, 0.02).at(long * 0.08, 0, top + deep * 0.9)
        )
        kit.add(
            DARK_GLASS,
            box(long * 0.31, beam * 1.0, deep * 0.12).at(long * 0.08, 0, top + deep * 1.15),
        )
        kit.add(
            grey,
            tube(
                [(-long * 0.02, 0, top + deep), (-long * 0.04, 0, top + deep * 3)],
                [0.03 * long, 0.008 * long],
                8,
            ),
        )
        kit.add(
            grey, box(0.02 * long, beam * 0.9, 0.02 * long).at(-long * 0.03, 0, top + deep * 2.3)
        )
        kit.add(
            BLACK,
            cylinder(beam * 0.36, deep * 0.8, 16)
            .scaled(1.4, 1, 1)
            .at(-long * 0.28, 0, top + deep * 0.9),
        )
        for spot, aim in ((0.5, 1.0), (0.32, 1.0), (-0.66, -1.0))[: kit.choose("turrets", 2, 3)]:
            floor_z = top + (deep * 0.3 if spot == 0.32 else 0.0)
            if spot == 0.32:
                kit.add(
                    grey,
                    cylinder(beam * 0.5, deep * 0.4, 18).at(long * spot, 0, top + deep * 0.15),
                )
            kit.add(
                grey,
                pillow(long * 0.14, beam * 0.85, deep * 0.36, 0.03).at(
                    long * spot, 0, floor_z + deep * 0.22
                ),
            )
            for y in (-0.2, 0.2):
                kit.add(
                    BLACK,
                    rod(
                        (long * spot, y * beam, floor_z + deep * 0.26),
                        (long * (spot + aim * 0.22), y * beam, floor_z + deep * 0.32),
                        0.01 * long,
                    ),
                )
    else:
        for x in (-0.45, 0.0, 0.42):
            kit.add(
                deck,
                box(long * 0.12, beam * 1.7 * (1 - 0.25 * abs(x)), 0.02 * long, 0.004).at(
                    long * x, 0, deep * 0.9
                ),
            )
        if kit.chance("oars", 0.7):
            for s in (-1, 1):
                oar = tube([(0, 0, 0), (0, s * beam * 2.3, -deep * 0.55)], 0.012 * long, 6)
                blade = (
                    box(0.07 * long, 0.28 * long, 0.012 * long, 0.003)
                    .turned("x", -s * 14)
                    .at(0, s * beam * 2.35, -deep * 0.57)
                )
                kit.add(
                    deck, oar.at(long * 0.15, 0, deep * 1.12), blade.at(long * 0.15, 0, deep * 1.12)
                )
