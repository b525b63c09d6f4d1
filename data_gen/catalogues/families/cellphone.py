"""Telephones: mobile phones, desk phones and wall phones."""

from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import hollows
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    WHITE,
    Kit,
    lacquer,
    metal,
    paint,
    pick,
    plastic,
    rect,
    screen,
    wood,
)
from data_gen.catalogues.solids import Solid, ball, box, cylinder, lathe, tube
from data_gen.mesh import Material

Part = tuple[Material, Solid]

_STANDING = ("standing",)
_ANY = ("standing", "standing", "standing", "lying", "leaning", "sideways")


class _Look:
    """Materials and dimensions common to all parts of a phone. Lengths in metres."""

    def __init__(self, kit: Kit, low: float, high: float, *poses: str) -> None:
        """Draws the materials, the width in [low, high], and the pose of the phone."""
        self.pose = kit.choose("pose", *(poses if not kit.visible.get("open_back") else _STANDING))
        self.body = pick(kit.rng, (plastic, plastic, lacquer, paint))(kit.rng)
        self.second = self.body if kit.rng.random() < 0.5 else plastic(kit.rng)
        self.glass = screen(kit.rng)
        self.key = WHITE if max(self.body.diffuse) < 0.5 else BLACK
        self.width = kit.uniform("width", low, high)
        self.corner = self.width * kit.uniform("corner", 0.05, 0.3)
        self.waist = kit.uniform("waist", -0.12, 0.12)
        self.edge = kit.choose("edge", "sharp", "round", "bevel")


def _slab(kit: Kit, look: _Look, tall: float, deep: float) -> Solid:
    """An upright slab on z = 0 with its front at x = deep / 2 and a socket in its lower end.

    In the first slab of a phone, the depth of the socket is hidden. With an open back
    (`open_cellphone`) the slab is a tray instead, and the depth of its recess is hidden.
    """
    w, r = look.width, min(look.corner, 0.4 * tall)
    angle = np.linspace(0, np.pi / 2, 5)
    ends = [(float(r - r * np.cos(a)), float(r - r * np.sin(a))) for a in angle]  # height, inset
    middle = [(tall * t, 0.0) for t in (0.25, 0.5, 0.75)]
    rings = [*ends, *middle, *((tall - z, i) for z, i in ends[::-1])]
    power = {"sharp": 12.0, "bevel": 5.0, "round": 3.0}[look.edge]
    flat = solids.superellipse(deep, 1.0, power, 24)
    outlines = []
    for z, i in rings:
        wide = (w - 2 * i) * (1 + look.waist * (4 * (z / tall - 0.5) ** 2 - 1) * 0.5)
        outlines.append((flat * [1.0, max(wide, 0.2 * w)], z))
    if kit.visible.get("open_back"):
        return _hollow_slab(kit, look, tall, deep)
    if kit.hidden or look.pose == "leaning":
        return solids.stack(outlines)
    return hollows.body(kit, outlines, 0.25 * min(tall, w), "socket_depth", 0.6)


def _hollow_slab(kit: Kit, look: _Look, tall: float, deep: float) -> Solid:
    """A slab. The first one of a phone has a recess of hidden depth in its back."""
    w = look.width

    def outline(inward: float) -> np.ndarray:
        return solids.rounded(
            tall - 2 * inward, w - 2 * inward, max(look.corner - inward, 0.001), 4
        )

    bevel = deep * 0.18
    edge = [
        (outline(bevel * 0.5), 0.0),
        (outline(0.0), bevel),
        (outline(0.0), deep - bevel),
        (outline(bevel), deep),
    ]
    if not kit.hidden:
        hollow = kit.hide("back_recess", 0.02, 0.85) * deep
        wall = outline(w * 0.05)
        edge = [(wall, max(hollow, 0.0002)), (wall, 0.0), *edge]
        kit.azimuth = ((-80.0, 80.0),)
    return solids.stack(edge).turned("y", 90).at(-deep / 2, 0, tall / 2)


def _keys(
    look: _Look, x: float, low: float, high: float, rows: int, columns: int = 3
) -> list[Part]:
    pitch, wide = (high - low) / rows, look.width * 0.84 / columns
    key = solids.superellipse(pitch * 0.66, wide * 0.76, 4.0, 12)
    part = solids.stack([(key, 0.0), (key * 0.9, 0.0014)]).turned("y", 90)
    return [
        (look.key, part.at(x - 0.0002, (j - (columns - 1) / 2) * wide, low + (i + 0.5) * pitch))
        for i in range(rows)
        for j in range(columns)
    ]


def _show(look: _Look, x: float, low: float, high: float, wide: float = 0.86) -> Part:
    return look.glass, box(0.0012, look.width * wide, high - low, 0.0003).at(x, 0, (low + high) / 2)


def _pose(kit: Kit, look: _Look, parts: list[Part]) -> None:
    """Adds the parts of a phone, standing, lying on its back or side, or leaning in a holder."""
    low = min(float(part.vertices[:, 0].min()) for _, part in parts)
    wide = max(float(np.abs(part.vertices[:, 1]).max()) for _, part in parts)
    lean = kit.uniform("lean", 15, 35)
    for material, part in parts:
        posed = part
        if look.pose == "lying":
            posed = part.at(-low).turned("y", -90).scaled(-1, -1, 1)
        elif look.pose == "leaning":
            posed = part.turned("y", -lean)
        elif look.pose == "sideways":
            posed = part.turned("x", 90).at(z=wide)
        kit.add(material, posed)
    # The end with the socket now points to -x if the phone lies on its back, to +y if it lies on
    # its side.
    if look.pose == "lying":
        kit.azimuth = ((-75.0, 75.0),)
    elif look.pose == "sideways":
        kit.azimuth = ((-165.0, -15.0),)
    elif look.pose == "leaning":
        tall = max(float(part.vertices[:, 2].max()) for _, part in parts)
        far = np.sin(np.radians(lean)) * tall * 0.6
        shape = [
            (0.014, 0),
            (0.014, 0.008),
            (0.008, 0.008),
            (-far, 0.55 * tall),
            (-far - 0.006, 0.5 * tall),
            (-0.5 * far - 0.01, 0),
        ]
        kit.add(BLACK, solids.prism(shape, wide * 1.1, 0.001))
        foot = hollows.slab(
            kit, "foot_recess", rect(0.5 * far + 0.03, wide * 1.3, 0.004), 0.008, 0.005
        )
        kit.add(BLACK, foot.at(-0.25 * far, 0, -0.006))


def _smartphone(kit: Kit) -> None:
    look = _Look(kit, 0.058, 0.082, *_ANY)
    tall, deep = (
        look.width * kit.uniform("aspect", 1.75, 2.25),
        kit.uniform("thickness", 0.007, 0.013),
    )
    look.waist = 0.0
    front = deep / 2
    border = kit.uniform("border", 0.02, 0.14) * tall
    parts = [
        (look.body, _slab(kit, look, tall, deep)),
        _show(look, front, border, tall - border, 0.93),
    ]
    if border > 0.09 * tall:
        button = kit.choose("button", "round", "bar", "three")
        if button == "round":
            parts.append(
                (
                    CHROME,
                    cylinder(look.width * 0.08, 0.001, 18).turned("y", 90).at(front, 0, border / 2),
                )
            )
        else:
            for y in (-0.3, 0.0, 0.3) if button == "three" else (0.0,):
                parts.append(
                    (
                        CHROME,
                        box(0.001, look.width * 0.16, 0.003).at(front, y * look.width, border / 2),
                    )
                )
    parts.append(
        (BLACK, box(0.001, look.width * 0.2, 0.0016).at(front + 0.0002, 0, tall - border / 2))
    )
    camera = kit.choose("camera", "dot", "bar", "square")
    y, z = look.width * 0.28, tall * 0.88
    if camera == "square":
        parts.append(
            (
                DARK_GLASS,
                box(0.003, look.width * 0.36, look.width * 0.36, 0.001).at(-front, y * 0.8, z),
            )
        )
    for k in range({"dot": 1, "bar": 2, "square": 2}[camera]):
        parts.append(
            (
                BLACK,
                cylinder(look.width * 0.06, 0.004, 14)
                .turned("y", 90)
                .at(-front, y * (0.8 if camera == "square" else 1), z - k * look.width * 0.17),
            )
        )
    for s in (-1, 1):
        parts.append(
            (CHROME, box(deep * 0.3, 0.0016, tall * 0.1).at(0, s * look.width / 2, tall * 0.7))
        )
    if kit.chance("case", 0.2) and not kit.visible.get("open_back"):
        parts.append(
            (
                paint(kit.rng),
                box(deep * 0.9, look.width * 1.04, tall * 0.99, 0.002).at(-deep * 0.2, 0, tall / 2),
            )
        )
    _pose(kit, look, parts)


def _bar(kit: Kit) -> None:
    """A bar phone: keys below a small screen."""
    look = _Look(kit, 0.04, 0.08, *_ANY)
    tall, deep = (
        look.width * kit.uniform("aspect", 2.0, 3.2),
        kit.uniform("thickness", 0.012, 0.026),
    )
    front = deep / 2
    split = tall * kit.uniform("split", 0.42, 0.6)
    parts = [
        (look.body, _slab(kit, look, tall, deep)),
        _show(look, front, split + 0.05 * tall, tall * 0.92, 0.74),
    ]
    parts += _keys(look, front, tall * 0.05, split - look.width * 0.24, 4)
    knob = kit.choose("navigation", "round", "wide", "four")
    if knob == "round":
        parts.append(
            (
                CHROME,
                cylinder(look.width * 0.13, 0.002, 20)
                .turned("y", 90)
                .at(front, 0, split - look.width * 0.08),
            )
        )
    else:
        parts.append(
            (
                CHROME,
                box(0.002, look.width * (0.6 if knob == "wide" else 0.2), look.width * 0.14).at(
                    front, 0, split - look.width * 0.08
                ),
            )
        )
    if kit.chance("antenna", 0.5):
        r, long = (
            deep * kit.uniform("antenna", 0.18, 0.34),
            tall * kit.uniform("antenna_length", 0.1, 0.6),
        )
        parts.append(
            (
                BLACK,
                cylinder(r, long + 0.01, 12, 0.2 * r).at(
                    0, look.width * 0.34, tall + long / 2 - 0.005
                ),
            )
        )
    _pose(kit, look, parts)


def _flip(kit: Kit) -> None:
    """A clamshell phone, open at a random angle or closed."""
    look = _Look(kit, 0.042, 0.058, "standing", "lying", "lying")
    half, deep = look.width * kit.uniform("aspect", 1.5, 2.1), kit.uniform("thickness", 0.01, 0.016)
    parts: list[Part] = [(look.body, _slab(kit, look, half, deep))]
    parts += _keys(look, deep / 2, half * 0.06, half * 0.62, 4)
    parts.append(
        (
            CHROME,
            cylinder(look.width * 0.16, 0.002, 20).turned("y", 90).at(deep / 2, 0, half * 0.79),
        )
    )
    opened = kit.choose("opened", 0, 105, 150, 160, 170)
    lid: list[Part] = [
        (look.second, _slab(kit, look, half, deep * 0.8).at(-deep * 0.4)),
        _show(look, 0.0, half * 0.2, half * 0.88, 0.76),
    ]
    lid.append(
        (DARK_GLASS, box(0.002, look.width * 0.5, half * 0.24).at(-deep * 0.8, 0, half * 0.6))
    )
    # From closed (0) the lid turns upward about the hinge at the base's upper front edge.
    for material, part in lid:
        parts.append(
            (
                material,
                part.turned("y", 180 - opened).at(
                    deep * 0.5 + 0.0006, 0, half + (0 if opened else 0.0)
                ),
            )
        )
    parts.append(
        (
            CHROME,
            cylinder(deep * 0.42, look.width * 0.9, 14).turned("x", 90).at(deep * 0.3, 0, half),
        )
    )
    if kit.chance("antenna", 0.35):
        parts.append(
            (
                BLACK,
                cylinder(deep * 0.25, half * 0.4, 12).at(
                    -deep * 0.1, look.width * 0.38, half * 1.1
                ),
            )
        )
    _pose(kit, look, parts)


def _slider(kit: Kit) -> None:
    look = _Look(kit, 0.044, 0.06, *_ANY)
    tall, deep = (
        look.width * kit.uniform("aspect", 1.7, 2.2),
        kit.uniform("thickness", 0.014, 0.022),
    )
    side = kit.chance("sideways_keys", 0.4)
    parts: list[Part] = [(look.body, _slab(kit, look, tall, deep * 0.55).at(-deep * 0.25))]
    upper: list[Part] = [
        (look.second, _slab(kit, look, tall, deep * 0.45).at(deep * 0.25)),
        _show(look, deep * 0.475, tall * 0.2, tall * 0.94, 0.84),
    ]
    upper.append(
        (
            CHROME,
            cylinder(look.width * 0.12, 0.002, 18).turned("y", 90).at(deep * 0.475, 0, tall * 0.1),
        )
    )
    if side:
        shift = look.width * kit.uniform("shift", 0.4, 0.7)
        parts += [(m, p.at(y=shift)) for m, p in upper]
        wide = shift / 4
        for i in range(4):
            for j in range(9):
                parts.append(
                    (
                        look.key,
                        box(0.0014, wide * 0.75, tall * 0.075).at(
                            deep * 0.03, -look.width / 2 + (i + 0.5) * wide, tall * (0.1 + 0.1 * j)
                        ),
                    )
                )
    else:
        shift = tall * kit.uniform("shift", 0.25, 0.45)
        parts += [(m, p.at(z=shift)) for m, p in upper]
        parts += _keys(look, deep * 0.025, tall * 0.03, shift * 0.95, 3)
    _pose(kit, look, parts)


def _keyboard(kit: Kit) -> None:
    """A phone with a screen above a keyboard with letters."""
    look = _Look(kit, 0.058, 0.08, *_ANY)
    tall, deep = (
        look.width * kit.uniform("aspect", 1.45, 1.9),
        kit.uniform("thickness", 0.011, 0.02),
    )
    split = tall * kit.uniform("split", 0.4, 0.5)
    parts = [
        (look.body, _slab(kit, look, tall, deep)),
        _show(look, deep / 2, split + tall * 0.05, tall * 0.92),
    ]
    parts += _keys(
        look, deep / 2, tall * 0.05, split - tall * 0.08, 4, kit.choose("columns", 5, 8, 10)
    )
    parts.append(
        (CHROME, cylinder(look.width * 0.06, 0.0024, 16).turned("y", 90).at(deep / 2, 0, split))
    )
    if kit.chance("wheel", 0.3):
        parts.append(
            (
                BLACK,
                cylinder(deep * 0.6, 0.008, 18).turned("x", 90).at(0, look.width / 2, tall * 0.75),
            )
        )
    _pose(kit, look, parts)


def _brick(kit: Kit) -> None:
    """Early phones: a brick phone with an aerial, a satellite phone, a walkie-talkie."""
    look = _Look(kit, 0.045, 0.065, "standing", "standing", "lying")
    tall, deep = (
        look.width * kit.uniform("aspect", 2.3, 4.0),
        look.width * kit.uniform("thick", 0.5, 1.1),
    )
    parts: list[Part] = [(look.body, _slab(kit, look, tall, deep))]
    parts += _keys(look, deep / 2, tall * 0.14, tall * 0.52, 5)
    parts.append(_show(look, deep / 2, tall * 0.56, tall * 0.66, 0.7))
    for k in range(5):
        parts.append(
            (BLACK, box(0.002, look.width * 0.5, 0.003).at(deep / 2, 0, tall * (0.75 + 0.035 * k)))
        )
    r, long = deep * kit.uniform("aerial", 0.1, 0.22), tall * kit.uniform("aerial_length", 0.3, 1.0)
    y = look.width * kit.choose("aerial_side", -0.3, 0.3)
    parts.append(
        (
            BLACK,
            lathe([(r, 0), (r, 0.2 * long), (0.8 * r, 0.25 * long), (0.6 * r, long)], 12).at(
                0, y, tall - 0.002
            ),
        )
    )
    if kit.chance("knob", 0.5):
        parts.append((BLACK, cylinder(r * 1.3, 0.015, 14).at(0, -y, tall + 0.006)))
    if kit.chance("clip", 0.5) and not kit.visible.get("open_back"):
        parts.append(
            (CHROME, box(0.004, look.width * 0.4, tall * 0.3).at(-deep / 2 - 0.006, 0, tall * 0.7))
        )
        parts.append(
            (CHROME, box(0.012, look.width * 0.3, 0.006).at(-deep / 2 - 0.002, 0, tall * 0.84))
        )
    _pose(kit, look, parts)


def _folded(kit: Kit) -> None:
    """A communicator open like a book, a folding screen, a phone that swivels."""
    look = _Look(kit, 0.06, 0.08, *_STANDING)
    style = kit.choose("style", "communicator", "book", "swivel")
    long, deep = (
        look.width * kit.uniform("aspect", 1.9, 2.4),
        kit.uniform("thickness", 0.008, 0.016),
    )
    if style == "communicator":
        slab = hollows.slab(
            kit, "socket_depth", rect(look.width, long, look.corner * 0.5), deep, 0.006
        )
        kit.add(look.body, slab.at(look.width / 2))
        for i in range(4):
            for j in range(10):
                kit.add(
                    look.key,
                    box(look.width * 0.14, long * 0.07, 0.002).at(
                        look.width * (0.2 + 0.2 * i), (j - 4.5) * long * 0.085, deep
                    ),
                )
        lean = kit.uniform("lean", 5, 50)
        for material, part in (
            (look.second, box(deep * 0.8, long, look.width, 0.002)),
            (look.glass, box(deep * 0.84, long * 0.86, look.width * 0.8)),
        ):
            kit.add(material, part.at(0, 0, look.width / 2).turned("y", -lean).at(0, 0, deep))
        return
    if style == "book":
        angle = kit.uniform("angle", 15, 75)
        share = kit.hide("socket_depth", *hollows.RANGE)
        for s in (-1, 1):
            half = solids.tray(rect(deep, look.width, 0.002), long, 0.002, share * 0.2 * look.width)
            for material, part in (
                (look.body, half),
                (look.glass, box(0.001, look.width * 0.96, long * 0.95).at(deep / 2, 0, long / 2)),
            ):
                kit.add(
                    material,
                    part.at(0, look.width / 2).scaled(1, s, 1).turned("z", -s * (90 - angle) * 0.6),
                )
        kit.add(CHROME, cylinder(deep * 0.5, long * 0.98, 14).at(-deep * 0.3, 0, long / 2))
        return
    parts: list[Part] = [(look.body, _slab(kit, look, long * 0.6, deep))]
    parts += _keys(look, deep / 2, long * 0.04, long * 0.42, 4)
    turn = kit.choose("turn", 0, 60, 90, 120)
    lid = [
        (look.second, box(deep * 0.9, look.width, long * 0.62, 0.003)),
        (look.glass, box(deep * 0.94, look.width * 0.84, long * 0.48, 0.0003)),
    ]
    for material, part in lid:
        parts.append(
            (material, part.at(0, 0, long * 0.25).turned("x", turn).at(deep, 0, long * 0.52))
        )
    parts.append(
        (
            CHROME,
            cylinder(look.width * 0.2, deep * 2, 18).turned("y", 90).at(deep * 0.5, 0, long * 0.52),
        )
    )
    _pose(kit, look, parts)


def _cordless(kit: Kit) -> None:
    """A handset in its cradle."""
    look = _Look(kit, 0.044, 0.056, *_STANDING)
    tall, deep = (
        look.width * kit.uniform("aspect", 2.8, 3.6),
        kit.uniform("thickness", 0.022, 0.034),
    )
    wide = look.width * kit.uniform("cradle", 1.3, 2.4)
    long = wide * kit.uniform("cradle_depth", 0.7, 1.2)
    flat = solids.superellipse(long, wide, kit.choose("cradle_shape", 2.2, 4, 9), 32)
    high = kit.uniform("cradle_height", 0.015, 0.05)
    kit.add(
        look.second,
        hollows.body(kit, [(flat, 0.0), (flat, 0.4 * high), (flat * 0.85, high)], 0.4 * high),
    )
    parts: list[Part] = [
        (look.body, _slab(kit, look, tall, deep)),
        _show(look, deep / 2, tall * 0.62, tall * 0.8, 0.7),
    ]
    parts += _keys(look, deep / 2, tall * 0.1, tall * 0.5, 5)
    parts.append(
        (
            CHROME,
            cylinder(look.width * 0.13, 0.002, 18).turned("y", 90).at(deep / 2, 0, tall * 0.56),
        )
    )
    parts += [
        (BLACK, box(0.002, look.width * 0.3, 0.003).at(deep / 2, 0, tall * t)) for t in (0.88, 0.91)
    ]
    if kit.chance("antenna", 0.4):
        parts.append(
            (BLACK, cylinder(0.006, tall * 0.4, 12, 0.001).at(0, look.width * 0.3, tall * 1.15))
        )
    lean = kit.uniform("lean", 5, 28)
    y = kit.choose("offset", 0.0, 0.0, 0.25) * wide
    for material, part in parts:
        kit.add(material, part.turned("y", -lean).at(-long * 0.1, y, high * 0.6))
    if y:
        for i in range(3):
            kit.add(
                look.key,
                box(0.012, wide * 0.2, 0.003).at(long * (0.25 - 0.2 * i), -0.25 * wide, high),
            )


def _desk(kit: Kit) -> None:
    """A desk telephone with keys or a dial, a candlestick telephone, or a wall telephone."""
    look = _Look(kit, 0.05, 0.06, *_STANDING)
    width, depth = kit.uniform("base_width", 0.14, 0.24), kit.uniform("base_depth", 0.14, 0.24)
    high, low = kit.uniform("rear_height", 0.04, 0.1), kit.uniform("front_height", 0.015, 0.04)
    style = kit.choose("style", "modern", "dial", "dial", "candlestick", "wall")
    handset = solids.smooth_path(
        [(0, -0.1, -0.022), (0, -0.085, 0.012), (0, 0, 0.024), (0, 0.085, 0.012), (0, 0.1, -0.022)],
        4,
    )
    thick = np.interp(
        np.linspace(0, 1, len(handset)),
        [0, 0.12, 0.25, 0.75, 0.88, 1],
        [0.024, 0.024, 0.014, 0.014, 0.024, 0.024],
    )
    receiver = tube(handset, thick, 14)
    foot = solids.rounded(depth, width, 0.02)
    if style == "candlestick":
        tall = kit.uniform("tall", 0.24, 0.34)
        body = pick(kit.rng, (BLACK, metal(kit.rng)))
        kit.add(
            body,
            hollows.turned(
                kit,
                [(0.07, 0), (0.07, 0.015), (0.03, 0.03), (0.014, 0.06), (0.014, tall)],
                28,
                0.015,
            ),
        )
        kit.add(
            body,
            ball(0.04, 0.04, 0.04, 14).at(0, 0, tall),
            lathe([(0.014, 0), (0.016, 0.02), (0.035, 0.06), (0.03, 0.06), (0.01, 0.03)], 24)
            .turned("y", 80)
            .at(0.01, 0, tall),
        )
        kit.add(
            body,
            lathe([(0.034, 0), (0.03, 0.02), (0.014, 0.05), (0.014, 0.11), (0.01, 0.12)], 20)
            .turned("x", 8)
            .at(0, 0.06, tall - 0.12),
        )
        kit.add(
            CHROME,
            tube([(0, 0, tall * 0.7), (0, 0.04, tall * 0.74), (0.0, 0.075, tall * 0.74)], 0.005),
        )
        if kit.chance("bell_box", 0.5):
            kit.add(wood(kit.rng), box(0.1, 0.16, 0.22, 0.006).at(-0.14, 0, 0.11))
        return
    if style == "wall":
        main = pick(kit.rng, (wood(kit.rng), look.body))
        tall = kit.uniform("box_height", 0.22, 0.5)
        kit.add(
            main,
            hollows.body(
                kit,
                [
                    (solids.rounded(0.1, width, 0.01, 1), 0.0),
                    (solids.rounded(0.1, width, 0.01, 1), tall),
                ],
                0.06,
            ),
        )
        kit.add(main, box(0.06, width * 0.9, 0.02, 0.005).at(0.06, 0, tall * 0.3))
        kit.add(
            CHROME,
            cylinder(0.032, 0.012, 24).turned("y", 90).at(0.055, -0.035, tall * 0.85),
            cylinder(0.032, 0.012, 24).turned("y", 90).at(0.055, 0.035, tall * 0.85),
        )
        kit.add(
            BLACK,
            lathe([(0.012, 0), (0.014, 0.05), (0.035, 0.09), (0.03, 0.09), (0.008, 0.05)], 20)
            .turned("y", 85)
            .at(0.05, 0, tall * 0.55),
        )
        kit.add(
            BLACK, receiver.turned("x", 90).turned("z", -90).at(0.02, width / 2 + 0.035, tall * 0.6)
        )
        return
    levels = [(foot, 0.0), (foot, low)]
    if style == "dial":
        levels += [
            (foot * 0.92, 0.5 * (low + high)),
            (foot * [0.5, 0.75] - [0.1 * depth, 0], high + 0.02),
        ]
        kit.add(look.body, hollows.body(kit, levels, 0.8 * low))
        slope = np.degrees(np.arctan2(0.34 * depth, high - low + 0.02)) + 12
        r = 0.3 * min(width, depth)
        dial = [(look.key, cylinder(r, 0.008, 32)), (CHROME, cylinder(0.4 * r, 0.014, 24))]
        for k in range(10):
            a = np.radians(30 * k + 40)
            dial.append(
                (
                    look.body,
                    cylinder(0.13 * r, 0.011, 12).at(0.72 * r * np.cos(a), 0.72 * r * np.sin(a), 0),
                )
            )
        for material, part in dial:
            kit.add(
                material,
                part.turned("y", 90 - slope * 0.5).at(0.24 * depth, 0, 0.5 * (low + high) + 0.02),
            )
        kit.both(look.body, box(0.03, 0.015, 0.04, 0.004).at(-0.1 * depth, 0.05, high + 0.035))
        kit.add(look.second, receiver.at(-0.1 * depth, 0, high + 0.065))
    else:
        side = kit.choose("receiver_side", -1, 1)
        shape = [(-depth / 2, 0.0), (depth / 2, 0.0), (depth / 2, low), (-depth / 2, high)]
        kit.add(look.body, solids.prism(shape, width, 0.004))
        kit.add(
            look.second,
            hollows.slab(kit, "foot_recess", rect(depth * 0.8, width * 0.8, 0.01), 0.012, 0.01).at(
                z=-0.01
            ),
        )
        slope = np.degrees(np.arctan2(high - low, depth))
        middle = 0.5 * (low + high)
        parts: list[Part] = [
            (
                look.glass,
                box(depth * 0.2, width * 0.5, 0.004).at(-0.3 * depth, -side * 0.18 * width),
            )
        ]
        for i in range(4):
            for j in range(3):
                parts.append(
                    (
                        look.key,
                        box(depth * 0.09, width * 0.1, 0.006).at(
                            depth * (0.36 - 0.13 * i), (j - 1) * width * 0.14 - side * 0.18 * width
                        ),
                    )
                )
        for i in range(5):
            parts.append(
                (
                    look.key,
                    box(depth * 0.06, width * 0.06, 0.005).at(
                        depth * (0.36 - 0.12 * i), -side * 0.44 * width
                    ),
                )
            )
        parts.append((look.second, receiver.turned("z", 90).at(0, side * 0.3 * width, 0.024)))
        for material, part in parts:
            kit.add(material, part.turned("y", slope).at(0, 0, middle))


def _set(kit: Kit) -> None:
    """A phone in a dock or in the holder of a car, several side by side, or a payphone."""
    look = _Look(kit, 0.05, 0.078, *_STANDING)
    style = kit.choose("style", "row", "dock", "car", "payphone")
    tall, deep = (
        look.width * kit.uniform("aspect", 1.8, 2.2),
        kit.uniform("thickness", 0.008, 0.016),
    )
    share = kit.hide("socket_depth", *hollows.RANGE) if style in ("row", "payphone") else 0.02

    def phone(body: Material, scale: float) -> list[Part]:
        w, t = look.width * scale, tall * scale
        slab = solids.tray(rect(deep, w, 0.003), t, 0.003, share * 0.2 * w)
        return [(body, slab), (look.glass, box(0.001, w * 0.9, t * 0.8).at(deep / 2, 0, t / 2))]

    if style == "row":
        count = kit.choose("count", 2, 3, 4)
        for k in range(count):
            y = (k - (count - 1) / 2) * look.width * 1.4
            for material, part in phone(lacquer(kit.rng), 1 - 0.12 * (k % 3)):
                kit.add(
                    material,
                    part.turned(
                        "z",
                        180
                        if k % 2 and kit.visible.setdefault("turned", bool(kit.rng.random() < 0.5))
                        else 0,
                    ).at(0.02 * k, y),
                )
        return
    if style == "payphone":
        high = kit.uniform("height", 0.5, 0.7)
        kit.add(look.body, solids.tray(rect(0.16, 0.25, 0.02), high, 0.03, share * 0.1))
        kit.add(
            CHROME,
            box(0.02, 0.18, high * 0.4, 0.004).at(0.08, 0.02, high * 0.6),
            box(0.03, 0.1, 0.08, 0.01).at(0.08, 0.04, high * 0.15),
        )
        for i in range(4):
            for j in range(3):
                kit.add(
                    look.key,
                    box(0.01, 0.028, 0.026, 0.002).at(
                        0.092, 0.02 + (j - 1) * 0.04, high * (0.46 + 0.075 * i)
                    ),
                )
        kit.add(
            BLACK,
            tube(
                np.array(
                    [
                        (0.09, -0.11, high * 0.42),
                        (0.13, -0.11, high * 0.48),
                        (0.125, -0.11, high * 0.8),
                        (0.09, -0.11, high * 0.86),
                    ]
                ),
                [0.026, 0.02, 0.02, 0.026],
                14,
            ),
        )
        t = np.linspace(0, 1, 14)
        cord = np.stack(
            [
                0.1 + 0.05 * np.sin(np.pi * t),
                -0.11 + 0.14 * t,
                high * 0.42 * (1 - 3.4 * t * (1 - t)) + 0.02,
            ],
            axis=1,
        )
        kit.add(CHROME, tube(cord, 0.006))
        return
    lean = kit.uniform("lean", 5, 30)
    lift = 0.03 if style == "dock" else kit.uniform("arm", 0.08, 0.2)
    turn = kit.choose("landscape", 0, 0, 90)
    parts = phone(look.body, 1.0)
    for material, part in parts:
        if turn:
            part = part.at(z=-tall / 2).turned("x", 90).at(z=look.width / 2)
        kit.add(material, part.turned("y", -lean).at(0.0, 0, lift))
    if style == "dock":
        flat = solids.superellipse(0.09, 0.1, 3.0, 28)
        levels = [(flat, 0.0), (flat, 0.012), (flat * 0.7, 0.035)]
        kit.add(look.second, hollows.body(kit, levels, 0.01))
    else:
        kit.add(
            BLACK,
            hollows.turned(kit, [(0.045, 0), (0.04, 0.012), (0.01, 0.02)], 24, 0.01),
            tube(
                solids.smooth_path(
                    [(0, 0, 0.01), (-0.06, 0, lift * 0.6), (-0.03, 0, lift + 0.03)], 4
                ),
                0.006,
            ),
        )
        kit.add(
            BLACK,
            box(0.01, look.width * 1.15, look.width * 0.5, 0.002)
            .turned("y", -lean)
            .at(-deep - 0.012, 0, lift + 0.04),
        )


KINDS: dict[str, Callable[[Kit], None]] = {
    "smartphone": _smartphone,
    "bar": _bar,
    "flip": _flip,
    "slider": _slider,
    "keyboard": _keyboard,
    "brick": _brick,
    "folding": _folded,
    "cordless": _cordless,
    "desk": _desk,
    "set": _set,
}

_WEIGHTS = {"smartphone": 2, "bar": 2, "flip": 2}

CASES = ("smartphone", "bar", "keyboard", "brick")
"""The subtypes that can have an open back."""


def cellphone(kit: Kit) -> None:
    """Ten subtypes, see `KINDS`. Hidden: the depth of a socket or of the recess in the foot."""
    kit.build_subtype(KINDS, _WEIGHTS)


def open_cellphone(kit: Kit) -> None:
    """A telephone with a recess in its back: `CASES` of `KINDS`. Hidden: its depth."""
    kit.visible["open_back"] = True
    kit.build_subtype({name: KINDS[name] for name in CASES})
