"""Parametric families for the 13 categories of the paper's table: endless, seeded, no files.

`generate(category, seed)` makes a model of several parts and materials, its front toward +x. Each
family has several sub-types with random proportions, parts and colours.

**Hidden parameters.** What an image cannot tell is drawn from a generator of its own:
`generate(category, seed, hidden_seed=h)` for different h gives models that look the same from every
azimuth in `parameters["hidden_azimuth"]`, pixel for pixel, and differ where the camera cannot see:
in the hollow of a seat, behind a front, on the far side. The bounding box and hemisphere do not
depend on them, so normalisation keeps the rest where it is. An azimuth is the direction from the
model's origin to the camera, in degrees from +x toward +y; the ranges hold for cameras at least 15
degrees above the horizon and at least 2.5 units away. `hidden_azimuth` is a tuple of ranges
(low, high) in [-180, 180]; `parameters["hidden"]` are the hidden values.
"""

import colorsys
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from data_gen import meshes
from data_gen.catalogues import solids
from data_gen.catalogues.solids import Solid, ball, box, cylinder, lathe, loft, pillow, prism, rod, tube
from data_gen.meshes import Material, Model

EVERYWHERE = ((-180.0, 180.0),)

# Keeps these draws apart from those of other users of the same seed.
_VISIBLE, _HIDDEN = 0x70736776, 0x70736768


# --- Materials --------------------------------------------------------------------------------


def _shade(rgb: Sequence[float], rng: np.random.Generator, spread: float = 0.08) -> Any:
    factor = 1 + rng.uniform(-spread, spread)
    return tuple(float(np.clip(v * factor, 0, 1)) for v in rgb)


def _pick(rng: np.random.Generator, choices: Sequence[Any]) -> Any:
    return choices[int(rng.integers(len(choices)))]


def wood(rng: np.random.Generator) -> Material:
    """Oak, beech, pine, walnut, cherry, ebony."""
    colours = ((0.72, 0.53, 0.33), (0.82, 0.66, 0.46), (0.86, 0.70, 0.47), (0.42, 0.27, 0.17),
               (0.55, 0.27, 0.16), (0.24, 0.16, 0.12), (0.62, 0.42, 0.26))  # fmt: skip
    return Material(_shade(_pick(rng, colours), rng), (0.12, 0.12, 0.12), 25.0, name="wood")


def metal(rng: np.random.Generator) -> Material:
    """Steel, chrome, black iron, brass, bronze."""
    colours = ((0.66, 0.67, 0.69), (0.78, 0.79, 0.8), (0.2, 0.2, 0.21), (0.72, 0.57, 0.27),
               (0.45, 0.33, 0.22), (0.36, 0.37, 0.4))  # fmt: skip
    return Material(_shade(_pick(rng, colours), rng), (0.55, 0.55, 0.55), 60.0, name="metal")


def paint(rng: np.random.Generator) -> Material:
    """Any lively colour, or white, grey, black."""
    if rng.random() < 0.35:
        grey = float(_pick(rng, (0.93, 0.85, 0.6, 0.35, 0.14)))
        colour = _shade((grey, grey, grey), rng, 0.04)
    else:
        colour = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.5, 0.9), rng.uniform(0.45, 0.95))
    return Material(colour, (0.4, 0.4, 0.4), 60.0, name="paint")


def fabric(rng: np.random.Generator) -> Material:
    """Upholstery: muted colours, greys, leather."""
    kind = rng.random()
    if kind < 0.6:
        colour = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.15, 0.6), rng.uniform(0.35, 0.85))
        return Material(colour, name="fabric")
    if kind < 0.8:
        grey = float(rng.uniform(0.25, 0.9))
        return Material((grey, grey, grey * 0.97), name="fabric")
    colours = ((0.33, 0.19, 0.12), (0.13, 0.12, 0.12), (0.58, 0.37, 0.22), (0.87, 0.83, 0.75))
    return Material(_shade(_pick(rng, colours), rng), (0.2, 0.2, 0.2), 30.0, name="leather")


def plastic(rng: np.random.Generator) -> Material:
    """Housings: black, greys, white, beige."""
    colours = ((0.1, 0.1, 0.11), (0.2, 0.2, 0.22), (0.5, 0.51, 0.53), (0.9, 0.9, 0.9),
               (0.82, 0.78, 0.68), (0.7, 0.71, 0.73))  # fmt: skip
    return Material(_shade(_pick(rng, colours), rng), (0.25, 0.25, 0.25), 40.0, name="plastic")


def screen(rng: np.random.Generator) -> Material:
    """A display, off or showing one colour."""
    if rng.random() < 0.5:
        return Material((0.05, 0.06, 0.08), (0.5, 0.5, 0.5), 120.0, name="screen")
    colour = colorsys.hsv_to_rgb(rng.uniform(0.45, 0.72), rng.uniform(0.3, 0.8), rng.uniform(0.4, 0.8))
    return Material(colour, (0.3, 0.3, 0.3), 120.0, name="screen")


RUBBER = Material((0.09, 0.09, 0.09), (0.08, 0.08, 0.08), 15.0, name="rubber")
DARK_GLASS = Material((0.1, 0.13, 0.16), (0.6, 0.6, 0.6), 120.0, name="dark glass")
GLASS = Material((0.62, 0.76, 0.78), (0.6, 0.6, 0.6), 120.0, opacity=0.4, name="glass")
BLACK = Material((0.07, 0.07, 0.07), name="black")
WHITE = Material((0.92, 0.92, 0.9), (0.2, 0.2, 0.2), 30.0, name="white")
CHROME = Material((0.75, 0.76, 0.78), (0.7, 0.7, 0.7), 90.0, name="chrome")
LIGHT = Material((0.98, 0.95, 0.82), (0.5, 0.5, 0.5), 60.0, name="light")
RED_LIGHT = Material((0.72, 0.05, 0.05), (0.5, 0.5, 0.5), 60.0, name="red light")
GOLD = Material((0.78, 0.62, 0.25), (0.6, 0.55, 0.4), 60.0, name="brass")


# --- Putting a model together -----------------------------------------------------------------


class Kit:
    """A model in the making: parts with materials, and the two random generators.

    Attributes:
      rng: of what can be seen.
      hidden_rng: of what cannot.
      visible: parameters to be stored.
      hidden: hidden parameters to be stored.
      azimuth: where from they are hidden.
    """

    def __init__(self, rng: np.random.Generator, hidden_rng: np.random.Generator) -> None:
        self.rng, self.hidden_rng = rng, hidden_rng
        self.visible: dict[str, Any] = {}
        self.hidden: dict[str, Any] = {}
        self.azimuth: tuple[tuple[float, float], ...] = EVERYWHERE
        self._parts: list[tuple[Solid, int]] = []
        self._materials: list[Material] = []

    def add(self, material: Material, *parts: Solid) -> None:
        """Adds parts of one material."""
        for index, known in enumerate(self._materials):
            if known is material:
                break
        else:
            index = len(self._materials)
            self._materials.append(material)
        self._parts += [(part, index) for part in parts]

    def both(self, material: Material, *parts: Solid) -> None:
        """Adds parts and their mirror images on the other side."""
        self.add(material, *parts, *(part.mirrored() for part in parts))

    def uniform(self, name: str, low: float, high: float) -> float:
        """Draws a visible parameter and stores it."""
        self.visible[name] = float(self.rng.uniform(low, high))
        return self.visible[name]

    def choose(self, name: str, *choices: Any) -> Any:
        """Draws a visible parameter among choices and stores it."""
        self.visible[name] = _pick(self.rng, choices)
        return self.visible[name]

    def chance(self, name: str, probability: float) -> bool:
        """Draws a visible yes or no and stores it."""
        self.visible[name] = bool(self.rng.random() < probability)
        return self.visible[name]

    def hide(self, name: str, low: float, high: float) -> float:
        """Draws a hidden parameter and stores it."""
        self.hidden[name] = float(self.hidden_rng.uniform(low, high))
        return self.hidden[name]

    def model(self, category: str, model_id: str, parameters: dict[str, Any]) -> Model:
        """The finished model, normalised."""
        sizes = np.cumsum([0, *(len(part.vertices) for part, _ in self._parts)])
        faces = [part.faces + start for (part, _), start in zip(self._parts, sizes[:-1], strict=True)]
        owner = np.repeat([index for _, index in self._parts], [len(f) for f in faces])
        model = meshes.build(
            np.concatenate([part.vertices for part, _ in self._parts]),
            np.concatenate(faces),
            materials=self._materials,
            face_material=owner,
            category=category,
            model_id=model_id,
            parameters={
                **parameters,
                **self.visible,
                "hidden": self.hidden,
                "hidden_azimuth": self.azimuth,
            },
        )
        # A cap with points in a line has triangles without area: no news to anybody.
        return dataclasses.replace(meshes.normalize(model), warnings=())


def _rect(x: float, y: float, radius: float = 0.0) -> Callable[[float], np.ndarray]:
    """An outline for `solids.tray`."""

    def outline(inward: float) -> np.ndarray:
        return solids.rounded(x - 2 * inward, y - 2 * inward, max(radius - inward, 0.004), 3)

    return outline


def _disc(radius: float, sides: int = 32) -> Callable[[float], np.ndarray]:
    angle = np.arange(sides) / sides * 2 * np.pi
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return lambda inward: circle * (radius - inward)


def _around(count: int, start: float = 0.0) -> np.ndarray:
    return start + np.arange(count) / count * 360


# --- Furniture --------------------------------------------------------------------------------


def _legs(kit: Kit, x: float, y: float, height: float, style: str, material: Material) -> None:
    """Four legs whose feet are at most at (+-x, +-y)."""
    thick = kit.uniform("leg_thickness", 0.025, 0.05)
    splay = kit.uniform("leg_splay", 0.0, 0.12) * height if style in ("round", "tapered") else 0.0
    for sx in (-1, 1):
        for sy in (-1, 1):
            foot, top = (sx * x, sy * y, 0.0), (sx * (x - splay), sy * (y - splay), height)
            if style == "square":
                kit.add(material, box(thick, thick, height, 0.004).at(sx * x, sy * y, height / 2))
            elif style == "round":
                kit.add(material, rod(foot, top, thick / 2, 10))
            elif style == "tapered":
                kit.add(material, tube([foot, top], [thick * 0.3, thick * 0.65], 12))
            elif style == "turned":
                profile = [(0.35, 0), (0.5, 0.08), (0.35, 0.16), (0.6, 0.45), (0.4, 0.6), (0.62, 0.66),
                           (0.4, 0.72), (0.6, 0.78), (0.6, 1.0)]  # fmt: skip
                kit.add(
                    material,
                    lathe([(r * thick * 1.2, h * height) for r, h in profile], 12).at(sx * x, sy * y),
                )


def _swivel_base(kit: Kit, radius: float, height: float, material: Material) -> None:
    """A star foot with castors and a gas column."""
    arms = kit.choose("base_arms", 4, 5, 5)
    for angle in _around(arms, kit.uniform("base_turn", 0, 72)):
        arm = tube([(0, 0, 0.11), (radius * 0.5, 0, 0.095), (radius, 0, 0.065)], [0.028, 0.022, 0.016])
        kit.add(material, arm.turned("z", angle))
        castor = cylinder(0.03, 0.04, 12).turned("x", 90).at(radius, 0, 0.03)
        kit.add(RUBBER, castor.turned("z", angle))
    kit.add(material, cylinder(0.028, height - 0.1, 12).at(z=0.1 + (height - 0.1) / 2))
    kit.add(BLACK, cylinder(0.045, (height - 0.1) * 0.5, 12).at(z=0.1 + (height - 0.1) * 0.25))


def _chair_back(
    kit: Kit, style: str, depth: float, width: float, low: float, high: float, lean: float,
    frame: Material, cover: Material,
) -> None:  # fmt: skip
    """The back of a chair, from z = low to high at the seat's rear edge, leaning backward."""
    rise = high - low

    def tilt(part: Solid) -> Solid:
        return part.turned("y", -lean).at(-depth / 2 + 0.02, 0, low)

    def post(y: float, radius: float = 0.016) -> Solid:
        return rod((0, y, -0.03), (0, y, rise), radius)

    half = width / 2 - 0.02
    if style == "solid":
        outline = solids.rounded(width, rise, kit.uniform("back_round", 0.01, 0.16), 4)
        back = solids.stack([(outline, -0.0125), (outline, 0.0125)]).turned("x", 90).turned("z", 90)
        kit.add(frame, tilt(back.at(z=rise / 2)))
    elif style == "padded":
        pad = kit.uniform("back_pad", 0.05, 0.09)
        kit.add(cover, tilt(pillow(pad, width * 0.96, rise * 0.94, 0.04).at(0.01, 0, rise * 0.53)))
        kit.both(frame, tilt(post(half * 0.5, 0.014)))
    elif style == "slats":
        kit.both(frame, tilt(post(half)))
        kit.add(frame, tilt(box(0.024, width, 0.07, 0.006).at(z=rise - 0.03)))
        kit.add(frame, tilt(box(0.02, width - 0.03, 0.035).at(z=0.1)))
        for y in np.linspace(-half, half, kit.choose("back_slats", 3, 4, 5) + 2)[1:-1]:
            kit.add(frame, tilt(box(0.012, 0.035, rise - 0.12).at(0, y, rise / 2 + 0.02)))
    elif style == "ladder":
        kit.both(frame, tilt(post(half, 0.018)))
        for z in np.linspace(rise * 0.25, rise - 0.035, kit.choose("back_rungs", 2, 3, 4)):
            bow = [(0, -half, z), (-0.025, 0, z), (0, half, z)]
            rung = tube(solids.smooth_path(bow, 4), 0.03, 8)
            kit.add(frame, tilt(rung.at(z=-z).scaled(0.45, 1, 1.1).at(z=z)))
    elif style == "spindles":
        count = kit.choose("back_spindles", 5, 6, 7, 8)
        bow = [(0, -half, 0.0), (-0.01, -half * 1.0, rise * 0.6), (-0.02, -half * 0.6, rise * 0.95),
               (-0.02, half * 0.6, rise * 0.95), (-0.01, half * 1.0, rise * 0.6), (0, half, 0.0)]  # fmt: skip
        kit.add(frame, tilt(tube(solids.smooth_path(bow, 6), 0.014)))
        for y in np.linspace(-half, half, count + 2)[1:-1]:
            top = rise * (0.97 - 0.12 * (y / half) ** 2)
            kit.add(frame, tilt(rod((0, y * 0.85, 0), (-0.02, y * 0.95, top), 0.007, 6)))
    else:  # "open": a frame with one band
        loop = [(0, -half, 0), (0, -half, rise * 0.75), (0, -half * 0.75, rise), (0, half * 0.75, rise),
                (0, half, rise * 0.75), (0, half, 0)]  # fmt: skip
        kit.add(frame, tilt(tube(solids.smooth_path(loop, 5), 0.014)))
        band = rise * kit.uniform("back_band", 0.25, 0.5)
        kit.add(cover, tilt(pillow(0.03, 2 * half, band, 0.014, 2).at(z=rise - band * 0.62)))


def _armrests(
    kit: Kit, style: str, depth: float, width: float, seat: float, material: Material, pad: Material
) -> None:
    top = seat + kit.uniform("arm_height", 0.18, 0.25)
    y = width / 2 + 0.015
    if style == "posts":
        kit.both(material, rod((depth * 0.32, y, seat - 0.03), (depth * 0.32, y, top), 0.014))
        kit.both(pad, box(depth * 0.92, 0.05, 0.025, 0.008).at(-0.01, y, top))
    elif style == "loops":
        loop = [(-depth * 0.42, y, seat - 0.02), (-depth * 0.44, y, top - 0.03), (-depth * 0.3, y, top),
                (depth * 0.3, y, top), (depth * 0.4, y, top - 0.05), (depth * 0.36, y, seat - 0.02)]  # fmt: skip
        kit.both(material, tube(solids.smooth_path(loop, 4), 0.016))


def chair(kit: Kit) -> None:
    """Four legs, swivel, sled, cantilever, stool, armchair. Hidden: the hollow under the seat."""
    kind = kit.choose("subtype", "four_legs", "four_legs", "four_legs", "swivel", "sled", "stool",
                      "armchair", "cantilever")  # fmt: skip
    frame = _pick(kit.rng, (wood, wood, metal, paint))(kit.rng)
    cover = fabric(kit.rng) if kit.rng.random() < 0.6 else frame
    depth, width = kit.uniform("depth", 0.4, 0.5), kit.uniform("width", 0.4, 0.5)
    seat, thick = kit.uniform("seat_height", 0.4, 0.48), kit.uniform("seat_thickness", 0.05, 0.09)
    round_ = kit.uniform("seat_round", 0.01, 0.1)
    if kind == "stool":
        seat = kit.uniform("stool_height", 0.55, 0.75)
        width = depth = kit.uniform("stool_width", 0.32, 0.4)
    if kind == "armchair":
        _armchair(kit, frame, cover)
        return
    hollow = kit.hide("seat_recess", 0.02, 0.9) * thick
    outline = _rect(depth, width, round_)
    if kind == "stool" and kit.chance("round_seat", 0.6):
        outline = _disc(width / 2)
    kit.add(cover, solids.tray(outline, thick, 0.025, hollow).at(z=seat - thick))
    if kit.chance("cushion", 0.3) and kind != "stool":
        kit.add(fabric(kit.rng), pillow(depth * 0.92, width * 0.92, 0.05, 0.024).at(z=seat + 0.02))
    under = seat - thick + 0.005
    if kind == "four_legs":
        style = kit.choose("legs", "square", "round", "tapered", "turned")
        x, y = depth / 2 - 0.03, width / 2 - 0.03
        _legs(kit, x, y, under, style, frame)
        if style in ("square", "turned") and kit.chance("stretchers", 0.6):
            z = under * kit.uniform("stretcher_height", 0.2, 0.45)
            kit.both(frame, rod((-x, y, z), (x, y, z), 0.01))
            kit.add(frame, rod((0, -y, z), (0, y, z), 0.01))
    elif kind == "swivel":
        steel = CHROME if kit.rng.random() < 0.5 else BLACK
        _swivel_base(kit, kit.uniform("base_radius", 0.27, 0.33), under, steel)
    elif kind == "sled":
        x, y = depth / 2 - 0.02, width / 2 - 0.01
        loop = [(-x * 0.8, y, under), (-x, y, 0.04), (-x * 0.8, y, 0.014), (x * 0.8, y, 0.014),
                (x, y, 0.04), (x * 0.8, y, under)]  # fmt: skip
        kit.both(frame, tube(solids.smooth_path(loop, 4), 0.014))
        kit.add(frame, rod((-x * 0.8, -y, under - 0.02), (-x * 0.8, y, under - 0.02), 0.012))
    elif kind == "cantilever":
        x, y = depth / 2, width / 2 - 0.005
        loop = [(-x, y, 0.016), (x * 0.7, y, 0.016), (x * 0.95, y, 0.06), (x, y, under * 0.6),
                (x * 0.9, y, under), (-x * 0.9, y, under)]  # fmt: skip
        kit.both(CHROME, tube(solids.smooth_path(loop, 5), 0.015))
        kit.add(CHROME, rod((-x, -y, 0.016), (-x, y, 0.016), 0.015))
    elif kind == "stool":
        if kit.chance("pedestal", 0.4):
            steel = CHROME
            kit.add(steel, lathe([(0.2, 0), (0.2, 0.012), (0.05, 0.035), (0.028, 0.06)], 28))
            kit.add(steel, cylinder(0.025, under - 0.05, 14).at(z=0.05 + (under - 0.05) / 2))
            angle = np.linspace(0, 2 * np.pi, 25)[:, None]
            ring = np.hstack([0.15 * np.cos(angle), 0.15 * np.sin(angle), 0 * angle + under * 0.4])
            kit.add(steel, tube(ring, 0.01, 6))
            kit.add(steel, rod((-0.15, 0, under * 0.4), (0.15, 0, under * 0.4), 0.009))
        else:
            foot = width / 2 + 0.02
            for sx in (-1, 1):
                for sy in (-1, 1):
                    kit.add(frame, rod((sx * foot, sy * foot, 0), (sx * foot * 0.6, sy * foot * 0.6, under), 0.016))
            for z in (0.3, 0.5):
                r = foot * (1 - 0.4 * z)
                for a, b in (((r, -r), (r, r)), ((-r, -r), (-r, r)), ((-r, r), (r, r)), ((-r, -r), (r, -r))):
                    kit.add(frame, rod((*a, under * z), (*b, under * z), 0.009))
    if kind == "stool" and not kit.chance("stool_back", 0.3):
        return
    rise = kit.uniform("back_height", 0.32, 0.58) * (0.6 if kind == "stool" else 1)
    style = kit.choose("back", "solid", "slats", "ladder", "spindles", "padded", "open")
    if kind in ("swivel", "cantilever"):
        style = kit.choose("back", "padded", "padded", "solid", "open")
    lean = kit.uniform("back_lean", 4, 14)
    _chair_back(kit, style, depth, width, seat, seat + rise, lean, frame, cover)
    if kind != "stool" and kit.chance("arms", 0.4):
        arm = kit.choose("arm_style", "posts", "loops")
        _armrests(kit, arm, depth, width, seat, CHROME if kind == "cantilever" else frame, cover)


def _armchair(kit: Kit, frame: Material, cover: Material) -> None:
    depth, width = kit.uniform("depth", 0.7, 0.85), kit.uniform("width", 0.68, 0.9)
    arm, back = kit.uniform("arm_width", 0.1, 0.17), kit.uniform("back_thickness", 0.13, 0.2)
    seat, top = kit.uniform("seat_height", 0.36, 0.44), kit.uniform("height", 0.75, 1.0)
    lift = kit.uniform("leg_height", 0.06, 0.16)
    base = seat - 0.14 - lift
    hollow = kit.hide("base_recess", 0.02, 0.9) * base
    kit.add(cover, solids.tray(_rect(depth, width, 0.05), base, 0.05, hollow).at(z=lift))
    inner = width - 2 * arm
    kit.add(cover, pillow(depth - back, inner, 0.16, 0.05).at(back / 2, 0, seat - 0.07))
    kit.add(cover, pillow(back, width if kit.chance("wide_back", 0.5) else inner + 0.02, top - lift - base, 0.07).turned("y", 0).at(-depth / 2 + back / 2, 0, (top + lift + base) / 2))
    high = seat + kit.uniform("arm_height", 0.14, 0.22)
    kit.both(cover, pillow(depth * 0.98, arm, high - lift - base + 0.04, 0.05).at(0, width / 2 - arm / 2, (high + lift + base) / 2 - 0.02))
    style = kit.choose("legs", "square", "tapered")
    _legs(kit, depth / 2 - 0.06, width / 2 - 0.06, lift + 0.02, style, frame)


def bench(kit: Kit) -> None:
    """Park bench, slab, storage bench. Hidden: supports behind a solid end, or a hollow seat."""
    kind = kit.choose("subtype", "park", "park", "slab", "panel_ends", "panel_ends", "storage")
    main = _pick(kit.rng, (wood, wood, wood, paint))(kit.rng)
    iron = _pick(kit.rng, (metal, paint))(kit.rng) if kit.rng.random() < 0.8 else BLACK
    length, depth = kit.uniform("length", 1.1, 1.9), kit.uniform("depth", 0.36, 0.48)
    seat = kit.uniform("seat_height", 0.4, 0.48)
    if kind == "storage":
        hollow = kit.hide("box_recess", 0.05, 0.92) * (seat - 0.03)
        kit.add(main, solids.tray(_rect(depth, length, 0.01), seat - 0.03, 0.03, hollow))
        kit.add(fabric(kit.rng), pillow(depth, length, 0.07, 0.03).at(z=seat))
        for y in np.linspace(-length / 2, length / 2, kit.choose("panels", 2, 3, 4) + 1)[1:-1]:
            kit.add(BLACK, box(0.004, 0.012, seat * 0.8).at(depth / 2, y, seat * 0.46))
        if kit.chance("back", 0.5):
            kit.add(main, box(0.04, length, 0.42, 0.01).at(-depth / 2 + 0.02, 0, seat + 0.2))
        return
    if kind == "slab":
        thick = kit.uniform("thickness", 0.07, 0.14)
        hollow = kit.hide("slab_recess", 0.02, 0.92) * thick
        kit.add(main, solids.tray(_rect(depth, length, 0.012), thick, 0.03, hollow).at(z=seat - thick))
        under = seat - thick + 0.002
        style = kit.choose("supports", "square", "round", "tapered", "blocks")
        if style == "blocks":
            for y in (-1, 1):
                block = box(depth * 0.8, 0.14, under, 0.015)
                kit.add(iron, block.at(0, y * length * 0.36, under / 2))
        else:
            _legs(kit, depth / 2 - 0.04, length / 2 - 0.06, under, style, iron)
        if kit.chance("back", 0.35):
            _bench_back(kit, length, depth, seat, main, iron)
        return
    count = kit.choose("slats", 3, 4, 5)
    pitch = depth / count
    for x in (np.arange(count) - (count - 1) / 2) * pitch:
        kit.add(main, box(pitch * 0.8, length, 0.035, 0.006).at(x, 0, seat - 0.017))
    under = seat - 0.035
    if kind == "park":
        # Curved iron ends, two or three; a thick front rail hides its own hollow back.
        wide = 0.05
        ends = (-1, 1) if kit.chance("two_ends", 0.7) else (-1, 0, 1)
        for side in ends:
            y = side * (length / 2 - 0.1)
            kit.add(iron, box(depth * 0.94, wide, 0.03).at(0, y, under - 0.015))
            for sign in (-1, 1):
                leg = [(sign * depth * 0.4, y, under), (sign * depth * 0.3, y, under * 0.55), (sign * depth * 0.46, y, 0.015)]
                kit.add(iron, tube(solids.smooth_path(leg, 4), 0.022))
                kit.add(iron, box(0.09, wide, 0.02).at(sign * depth * 0.46, y, 0.01))
        rail = kit.uniform("rail", 0.07, 0.1)
        hollow = kit.hide("rail_recess", 0.02, 0.92) * rail
        kit.add(main, solids.tray(_rect(depth * 0.6, length * 0.9, 0.01), rail, 0.015, hollow).at(z=under - rail))
        if kit.chance("arms", 0.6):
            for side in (-1, 1):
                y = side * (length / 2 - 0.05)
                arm = [(-depth * 0.45, y, seat + 0.22), (0, y, seat + 0.24), (depth * 0.4, y, seat + 0.2), (depth * 0.44, y, seat - 0.02)]
                kit.add(iron, tube(solids.smooth_path(arm, 4), 0.018))
        if kit.chance("back", 0.85):
            _bench_back(kit, length, depth, seat, main, iron)
        return
    # Solid ends as wide as the seat: from the side nobody knows what stands between them.
    end = box(depth, 0.06, under, 0.008)
    kit.both(iron, end.at(0, length / 2 - 0.06, under / 2))
    supports = int(kit.hidden_rng.integers(0, 4))
    width = kit.hide("support_width", 0.1, 0.3) * depth
    kit.hidden["supports"] = supports
    for y in np.linspace(-length / 2, length / 2, supports + 2)[1:-1] * 0.7:
        kit.add(iron, box(width, 0.05, under * 0.98).at(0, y, under * 0.5))
    kit.azimuth = ((87.0, 93.0), (-93.0, -87.0))
    if kit.chance("back", 0.6):
        _bench_back(kit, length, depth, seat, main, iron)


def _bench_back(
    kit: Kit, length: float, depth: float, seat: float, main: Material, iron: Material
) -> None:
    rise, lean = kit.uniform("back_height", 0.34, 0.46), kit.uniform("back_lean", 5, 15)

    def tilt(part: Solid) -> Solid:
        return part.turned("y", -lean).at(-depth / 2 + 0.02, 0, seat - 0.02)

    style = kit.choose("back_style", "rails", "rails", "slats", "solid")
    kit.both(iron, tilt(box(0.035, 0.045, rise, 0.004).at(-0.03, length / 2 - 0.1, rise / 2)))
    if style == "solid":
        kit.add(main, tilt(box(0.03, length, rise * 0.75, 0.008).at(0, 0, rise * 0.62)))
    elif style == "rails":
        count = kit.choose("back_rails", 2, 3, 4)
        pitch = rise * 0.85 / count
        for k in range(count):
            kit.add(main, tilt(box(0.026, length, pitch * 0.72, 0.006).at(0, 0, rise - pitch * (k + 0.5))))
    else:
        kit.add(main, tilt(box(0.03, length, 0.06, 0.008).at(0, 0, rise)))
        kit.add(main, tilt(box(0.03, length, 0.05, 0.008).at(0, 0, rise * 0.2)))
        for y in np.linspace(-length / 2, length / 2, int(length / 0.1))[1:-1]:
            kit.add(main, tilt(box(0.015, 0.035, rise * 0.8).at(0, y, rise * 0.6)))


def _case(
    kit: Kit, material: Material, depth: float, width: float, height: float, wall: float, back: float
) -> None:
    """A case, solid from the front: walls all around, closed by a back panel `back` from behind."""
    outline = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * 0.5

    def ring(x: float, inward: float) -> np.ndarray:
        size = np.array([width - 2 * inward, height - 2 * inward])
        return np.column_stack([np.full(4, x), outline * size])

    rear, front = -depth / 2, depth / 2
    inside = rear + max(back, 0.002)
    bevel = 0.004
    rings = [ring(inside, wall), ring(rear, wall), ring(rear, 0), ring(front - bevel, 0),
             ring(front, bevel)]  # fmt: skip
    kit.add(material, loft(rings).at(z=height / 2))


def cabinet(kit: Kit) -> None:
    """Wardrobe, dresser, sideboard, open shelf, locker. Hidden: how far in the back panel stands."""
    kind = kit.choose("subtype", "wardrobe", "dresser", "sideboard", "shelf", "locker", "nightstand")
    body = _pick(kit.rng, (wood, wood, paint))(kit.rng)
    front = body if kit.rng.random() < 0.4 else _pick(kit.rng, (wood, paint))(kit.rng)
    if kind == "locker":
        body = front = paint(kit.rng)
    knob = metal(kit.rng)
    sizes = {"wardrobe": ((0.9, 1.6), (1.7, 2.2), (0.5, 0.62)), "dresser": ((0.7, 1.2), (0.75, 1.2), (0.42, 0.55)),
             "sideboard": ((1.2, 1.9), (0.55, 0.85), (0.38, 0.5)), "shelf": ((0.6, 1.2), (1.2, 2.0), (0.28, 0.4)),
             "locker": ((0.5, 1.2), (1.5, 1.9), (0.42, 0.55)), "nightstand": ((0.4, 0.55), (0.45, 0.65), (0.35, 0.45))}  # fmt: skip
    wide, tall, deep = sizes[kind]
    width, height = kit.uniform("width", *wide), kit.uniform("height", *tall)
    depth = kit.uniform("depth", *deep)
    lift = 0.0
    if kind != "locker" and kit.chance("feet", 0.6):
        lift = kit.uniform("foot_height", 0.06, 0.16)
        _legs(kit, depth / 2 - 0.04, width / 2 - 0.05, lift + 0.01, kit.choose("legs", "square", "tapered"), body)
    else:
        lift = 0.05
        kit.add(BLACK, box(depth - 0.06, width - 0.03, lift + 0.01).at(z=lift / 2))
    inner = height - lift
    wall = 0.02
    back = kit.hide("back_recess", 0.0, 0.8) * depth
    kit.azimuth = ((-85.0, 85.0),)
    top = kit.chance("top_plate", 0.6)
    if top:
        kit.add(body, box(depth + 0.03, width + 0.04, 0.03, 0.006).at(0, 0, height + 0.014))
    if kind == "shelf":
        # Open to the front: here the recess ends at the panel that the shelves stand against.
        panel = depth * 0.18
        back = min(back / depth / 0.8 * (panel - 0.01), panel - 0.008)
        kit.hidden["back_recess"] = back / depth
        kit.both(body, box(depth, wall, inner, 0.003).at(0, width / 2 - wall / 2, lift + inner / 2))
        kit.add(body, box(panel - back, width - wall, inner - 0.01).at(-depth / 2 + (panel + back) / 2, 0, lift + inner / 2))
        count = kit.choose("shelves", 3, 4, 5, 6)
        for z in np.linspace(lift + wall / 2, height - wall / 2, count + 1):
            shelf_depth = depth if z in (lift + wall / 2, height - wall / 2) else depth - panel - 0.01
            kit.add(body, box(shelf_depth - 0.004, width - wall, wall).at(depth / 2 - shelf_depth / 2, 0, z))
        if kit.chance("upright", 0.4):
            kit.add(body, box(depth - panel - 0.02, wall, inner - 0.02).at(panel / 2, 0, lift + inner / 2))
        if kit.chance("books", 0.6):
            edges = np.linspace(lift + wall / 2, height - wall / 2, count + 1)
            for z, above in zip(edges[:-1], edges[1:], strict=True):
                y, end = -width / 2 + 0.05, width / 2 * kit.rng.uniform(-0.5, 0.9)
                cover = [paint(kit.rng) for _ in range(3)]
                while y < end:
                    t = kit.rng.uniform(0.025, 0.05)
                    tall_ = (above - z - wall) * kit.rng.uniform(0.6, 0.92)
                    kit.add(_pick(kit.rng, cover), box(depth * 0.5, t * 0.92, tall_).at(0.05 * depth, y, z + wall / 2 + tall_ / 2))
                    y += t
        return
    case = Kit(kit.rng, kit.hidden_rng)
    _case(case, body, depth - 0.02, width, inner, wall, back)
    kit.add(body, *(part.at(-0.01, 0, lift) for part, _ in case._parts))
    if kind == "wardrobe":
        columns, rows = kit.choose("doors", 2, 2, 3, 4), 1
    elif kind == "locker":
        columns, rows = kit.choose("doors", 1, 2, 3), kit.choose("tiers", 1, 2, 3)
    elif kind == "nightstand":
        columns, rows = 1, kit.choose("drawers", 1, 2, 3)
    elif kind == "dresser":
        columns, rows = kit.choose("columns", 1, 2), kit.choose("drawers", 3, 4, 5)
    else:
        columns, rows = kit.choose("doors", 2, 3, 4), kit.choose("tiers", 1, 1, 2, 3)
    gap, w, h = 0.008, (width - 0.01) / columns, (inner - 0.01) / rows
    handle = kit.choose("handle", "knob", "bar", "bar")
    inset_panel = kit.chance("inset_panels", 0.4)
    for i in range(columns):
        for j in range(rows):
            y, z = (i - (columns - 1) / 2) * w, lift + 0.005 + (j + 0.5) * h
            kit.add(front, box(0.022, w - gap, h - gap, 0.004).at(depth / 2 - 0.011, y, z))
            if inset_panel and min(w, h) > 0.16:
                kit.add(body, box(0.004, w - 0.1, h - 0.1, 0.001).at(depth / 2 + 0.001, y, z))
            tall_door = h > w * 0.9
            hy = y + (0.4 * w if i < columns / 2 else -0.4 * w) if tall_door else y
            if columns == 1 and tall_door:
                hy = y + 0.4 * w
            if handle == "knob":
                kit.add(knob, ball(0.035, 0.035, 0.035, 10).at(depth / 2 + 0.018, hy, z))
            else:
                size = (0.02, 0.014, min(0.16, h * 0.5)) if tall_door else (0.02, min(0.16, w * 0.4), 0.014)
                kit.add(knob, box(*size, 0.004).at(depth / 2 + 0.012, hy, z))
    if kind == "locker":
        for i in range(columns):
            for k in range(4):
                kit.add(BLACK, box(0.004, w * 0.5, 0.008).at(depth / 2 + 0.001, (i - (columns - 1) / 2) * w, height - 0.1 - 0.025 * k))


def table(kit: Kit) -> None:
    """Four legs, pedestal, trestle, coffee table, desk. Hidden: under the top, behind a panel."""
    kind = kit.choose("subtype", "four_legs", "four_legs", "pedestal", "trestle", "coffee", "desk", "desk")
    main = _pick(kit.rng, (wood, wood, paint))(kit.rng)
    frame = main if kit.rng.random() < 0.5 else metal(kit.rng)
    depth, length = kit.uniform("depth", 0.7, 1.0), kit.uniform("length", 1.0, 2.0)
    height = kit.uniform("height", 0.7, 0.78)
    thick = kit.uniform("thickness", 0.05, 0.11)
    if kind == "coffee":
        height, depth = kit.uniform("height", 0.32, 0.48), kit.uniform("depth", 0.5, 0.8)
        length = kit.uniform("length", 0.7, 1.3)
    round_top = kind == "pedestal" and kit.chance("round_top", 0.7) or (kind == "coffee" and kit.chance("round_top", 0.3))
    if round_top:
        length = depth = kit.uniform("diameter", 0.7, 1.2)
    hollow = kit.hide("top_recess", 0.02, 0.92) * thick
    outline = _disc(depth / 2, 40) if round_top else _rect(depth, length, kit.uniform("corner", 0.004, 0.08))
    glass = kind in ("coffee", "four_legs", "pedestal") and kit.chance("glass_top", 0.2)
    under = height - thick + 0.002
    if glass:
        # Nothing hides under glass but what the frame's own rails hide.
        kit.add(GLASS, solids.stack([(outline(0.0), height - 0.015), (outline(0.0), height)]))
        rail = outline(0.1), outline(0.16)
        deep = thick * 0.9
        bottom = height - 0.016 - deep
        kit.add(frame, solids.stack([(rail[1], height - 0.016), (rail[1], bottom), (rail[0], bottom), (rail[0], height - 0.016)][::-1]))
        kit.hidden.clear()
        shift = kit.hide("column_hollow", 0.3, 0.9)
        kit.add(frame, solids.tray(_disc(0.05, 16), bottom, 0.006, shift * bottom))
    else:
        kit.add(main, solids.tray(outline, thick, 0.03, hollow).at(z=height - thick))
    if kind in ("four_legs", "coffee"):
        style = kit.choose("legs", "square", "round", "tapered", "turned")
        inset_ = 0.15 * depth if round_top else 0.05
        x, y = depth / 2 - inset_, length / 2 - inset_
        if round_top:
            x = y = depth * 0.32
        _legs(kit, x, y, height - 0.016 if glass else under, style, frame)
        if kind == "coffee" and not round_top and kit.chance("shelf", 0.5):
            kit.add(main, box(2 * x, 2 * y, 0.02, 0.004).at(z=height * 0.3))
    elif kind == "pedestal":
        r = kit.uniform("column", 0.035, 0.07)
        foot = kit.choose("foot", "disc", "star")
        kit.add(frame, lathe([(r * 1.6, 0.02), (r, 0.14), (r * 0.9, under * 0.6), (r * 1.7, under)], 20))
        if foot == "disc":
            wide = min(depth, length) * 0.32
            kit.add(frame, lathe([(wide, 0), (wide, 0.02), (wide * 0.3, 0.06)], 32))
        else:
            for angle in _around(kit.choose("feet", 3, 4, 4), 45):
                reach = min(depth, length) * 0.38
                arm = tube(solids.smooth_path([(0, 0, 0.16), (reach * 0.6, 0, 0.08), (reach, 0, 0.02)], 4), 0.024)
                kit.add(frame, arm.turned("z", angle))
    elif kind == "trestle":
        y = length * 0.36
        if kit.chance("panels", 0.4):
            kit.both(frame, box(depth * 0.7, 0.05, under, 0.006).at(0, y, under / 2))
        else:
            for s in (-1, 1):
                kit.add(frame, rod((-depth * 0.4, s * y, 0.0), (depth * 0.2, s * y, under), 0.025))
                kit.add(frame, rod((depth * 0.4, s * y, 0.0), (-depth * 0.2, s * y, under), 0.025))
        kit.add(frame, box(0.03, 2 * y, 0.07).at(0, 0, under * 0.45))
    elif kind == "desk":
        side = kit.choose("sides", "panels", "panels", "legs")
        if side == "panels":
            kit.both(frame, box(depth * 0.94, 0.03, under, 0.004).at(0, length / 2 - 0.03, under / 2))
            # A front panel down to the ground: from there, drawers behind it are anybody's guess.
            kit.add(main, box(0.025, length - 0.06, under).at(depth * 0.42, 0, under / 2))
            count = int(kit.hidden_rng.integers(0, 3))
            kit.hidden["pedestals"] = count
            wide = kit.hide("pedestal_width", 0.18, 0.3) * length
            left = bool(kit.hidden_rng.random() < 0.5)
            kit.hidden["left"] = left
            for k in range(count):
                s = 1 if (k == 0) == left else -1
                block = box(depth * 0.72, wide, under * 0.85).at(0, s * (length / 2 - 0.05 - wide / 2), under * 0.57)
                kit.add(main, block)
            kit.azimuth = ((-30.0, 30.0),)
        else:
            _legs(kit, depth / 2 - 0.05, length / 2 - 0.05, under, kit.choose("legs", "square", "round"), frame)
            wide = length * kit.uniform("drawers_width", 0.2, 0.32)
            s = kit.choose("drawers_side", -1, 1)
            kit.add(main, box(depth * 0.8, wide, under * 0.8, 0.004).at(0, s * (length / 2 - 0.08 - wide / 2), under * 0.6))
            for k in range(3):
                z = under * (0.28 + 0.26 * k)
                kit.add(frame, box(0.02, wide * 0.5, 0.014).at(depth * 0.4, s * (length / 2 - 0.08 - wide / 2), z + 0.06))
                kit.add(BLACK, box(0.003, wide, 0.006).at(depth * 0.4, s * (length / 2 - 0.08 - wide / 2), z + 0.18))


def couch(kit: Kit) -> None:
    """Two to four seats, chaise, chesterfield, arms of many widths. Hidden: the hollow base."""
    kind = kit.choose("subtype", "modern", "modern", "classic", "chaise", "loveseat", "armless")
    cover = fabric(kit.rng)
    cushion = cover if kit.rng.random() < 0.6 else fabric(kit.rng)
    foot = _pick(kit.rng, (wood, metal))(kit.rng)
    seats = {"loveseat": 2, "chaise": 3}.get(kind) or kit.choose("seats", 2, 3, 3, 4)
    kit.visible["seats"] = seats
    one = kit.uniform("seat_width", 0.55, 0.7)
    arm = 0.0 if kind == "armless" else kit.uniform("arm_width", 0.1, 0.26)
    depth, back = kit.uniform("depth", 0.82, 1.0), kit.uniform("back_thickness", 0.14, 0.24)
    width = seats * one + 2 * arm
    seat, top = kit.uniform("seat_height", 0.38, 0.46), kit.uniform("height", 0.68, 0.92)
    skirt = kit.chance("skirt", 0.35)
    lift = 0.0 if skirt else kit.uniform("leg_height", 0.06, 0.16)
    base = seat - 0.15 - lift
    hollow = kit.hide("base_recess", 0.02, 0.92) * base
    kit.add(cover, solids.tray(_rect(depth, width, 0.04), base, 0.06, hollow).at(z=lift))
    if not skirt:
        _legs(kit, depth / 2 - 0.07, width / 2 - 0.08, lift + 0.02, kit.choose("legs", "square", "tapered", "round"), foot)
    floor = lift + base
    rear = -depth / 2
    kit.add(cover, pillow(back, width, top - floor + 0.04, min(0.07, back * 0.45)).at(rear + back / 2, 0, (top + floor) / 2 - 0.02))
    front = depth / 2
    if arm:
        high = seat + kit.uniform("arm_height", 0.1, 0.22)
        y = width / 2 - arm / 2
        kit.both(cover, pillow(depth, arm, high - floor + 0.06, 0.04).at(0, y, (high + floor) / 2 - 0.03))
        if kind == "classic":
            roll = cylinder(arm * 0.62, depth * 0.99, 20, 0.02).turned("y", 90)
            kit.both(cover, roll.at(0, y + arm * 0.05, high))
            kit.add(cover, cylinder(back * 0.5, width * 0.985, 20, 0.02).turned("x", 90).at(rear + back * 0.5, 0, top))
    for k in range(seats):
        y = (k - (seats - 1) / 2) * one
        long = front - rear - back
        extra = 0.0
        if kind == "chaise" and k == seats - 1:
            extra = kit.uniform("chaise", 0.4, 0.7)
            kit.add(cover, box(extra + 0.02, one, base, 0.02).at(front + extra / 2 - 0.01, y, floor - base / 2))
            kit.add(foot, cylinder(0.025, lift + 0.02, 10).at(front + extra - 0.08, y, lift / 2 + 0.01))
        kit.add(cushion, pillow(long + extra, one - 0.012, 0.17, 0.05).at(rear + back + (long + extra) / 2, y, seat - 0.075))
        if kind != "armless" or kit.rng.random() < 0.5:
            soft = pillow(0.16, one - 0.03, top - seat - 0.04, 0.07).turned("y", -12)
            kit.add(cushion, soft.at(rear + back + 0.07, y, (top + seat) / 2 + 0.01))
    if kit.chance("throw_pillows", 0.5):
        loose = fabric(kit.rng)
        for s in (-1, 1):
            p = pillow(0.12, 0.38, 0.38, 0.055).turned("y", -22).turned("z", -s * 15)
            kit.add(loose, p.at(rear + back + 0.24, s * (width / 2 - arm - 0.22), seat + 0.2))


def lamp(kit: Kit) -> None:
    """Floor, table, desk, pendant, tripod. Hidden: bulb and frame in a shade closed on top."""
    kind = kit.choose("subtype", "table", "table", "floor", "tripod", "desk", "pendant", "arc")
    body = _pick(kit.rng, (metal, metal, wood, paint))(kit.rng)
    shade = _pick(kit.rng, (fabric, paint))(kit.rng)
    if kit.rng.random() < 0.4:
        shade = Material((0.93, 0.89, 0.78), name="shade")
    style = kit.choose("shade", "cone", "drum", "bell", "dome")

    def hang(radius: float, tall: float, x: float, z: float, tip: float = 0.0) -> None:
        """A shade whose top is at z, with what it hides."""
        top = {"cone": 0.5, "drum": 0.92, "bell": 0.42, "dome": 0.3}[style]
        wall = 0.012
        if style in ("bell", "dome"):
            t = np.linspace(0, 1, 9)
            r = top + (1 - top) * (t**1.7 if style == "bell" else np.sqrt(1 - (1 - t) ** 2))
        else:
            t = np.array([0.0, 1.0])
            r = top + (1 - top) * t
        outer = [(radius * a, -tall * b) for a, b in zip(r, t, strict=True)]
        inner = [(radius * a - wall, -tall * b - (wall if b == 0 else 0)) for a, b in zip(r, t, strict=True)]
        part = lathe([*outer, *inner[::-1]], 32)
        kit.add(shade, part.turned("y", tip).at(x, 0, z))
        bulb = kit.hide("bulb_radius", 0.05, 0.28) * radius
        drop = kit.hide("bulb_drop", 0.3, 0.6) * tall
        kit.add(LIGHT, ball(2 * bulb, 2 * bulb, min(2.4 * bulb, 0.5 * tall), 14).at(z=-drop).turned("y", tip).at(x, 0, z))

    if kind == "pendant":
        cord = kit.uniform("cord", 0.5, 1.2)
        lights = kit.choose("lights", 1, 1, 3)
        radius, tall = kit.uniform("shade_radius", 0.16, 0.3), kit.uniform("shade_height", 0.16, 0.32)
        if lights == 1:
            hang(radius, tall, 0, tall)
            kit.add(body, rod((0, 0, tall - 0.01), (0, 0, tall + cord), 0.008, 6))
            kit.add(body, lathe([(0.07, 0), (0.06, 0.03), (0.01, 0.04)], 20).at(z=tall + cord))
        else:
            # One beam, three shades in a row; each with the same things inside.
            saved = dict(kit.hidden)
            state = kit.hidden_rng.bit_generator.state
            for y in (-1, 0, 1):
                kit.hidden_rng.bit_generator.state = state
                kit.hidden = dict(saved)
                before = len(kit._parts)
                hang(radius * 0.7, tall * 0.8, 0, tall * 0.8)
                kit._parts[before:] = [(p.at(0, y * radius * 1.9, 0), m) for p, m in kit._parts[before:]]
                kit.add(body, rod((0, y * radius * 1.9, tall * 0.8 - 0.01), (0, y * radius * 1.9, tall + cord * 0.6), 0.007, 6))
            kit.add(body, box(0.06, radius * 4.6, 0.035, 0.01).at(0, 0, tall + cord * 0.6))
        return
    if kind == "desk":
        base = kit.uniform("base", 0.09, 0.13)
        kit.add(body, lathe([(base, 0), (base, 0.015), (base * 0.9, 0.028), (0.02, 0.035)], 28))
        a, b = kit.uniform("lower_arm", 0.3, 0.42), kit.uniform("upper_arm", 0.28, 0.4)
        lean, reach = np.radians(kit.uniform("lean", 8, 25)), np.radians(kit.uniform("reach", 20, 50))
        elbow = np.array([-a * np.sin(lean), 0, 0.03 + a * np.cos(lean)])
        head = elbow + [b * np.cos(reach), 0, b * np.sin(reach)]
        for y in (-0.012, 0.012):
            kit.add(body, rod((0, y, 0.03), (elbow[0], y, elbow[2]), 0.007), rod((elbow[0], y, elbow[2]), (head[0], y, head[2]), 0.007))
        kit.add(body, cylinder(0.02, 0.05, 12).turned("x", 90).at(*elbow))
        kit.add(body, ball(0.06, 0.06, 0.06, 12).at(*head))
        style = kit.visible["shade"] = _pick(kit.rng, ("cone", "dome", "bell"))
        hang(kit.uniform("shade_radius", 0.08, 0.12), kit.uniform("shade_height", 0.11, 0.16), head[0], head[2] + 0.01, kit.uniform("tip", -12, 0))
        return
    if kind == "arc":
        base = kit.uniform("base", 0.16, 0.22)
        high = kit.uniform("height", 1.5, 1.9)
        reach = kit.uniform("reach", 0.7, 1.1)
        kit.add(_pick(kit.rng, (BLACK, WHITE, body)), cylinder(base, 0.06, 32, 0.01).at(z=0.03))
        path = [(0, 0, 0.05), (-0.06, 0, high * 0.55), (reach * 0.25, 0, high * 0.95), (reach * 0.7, 0, high), (reach, 0, high * 0.82)]
        kit.add(body, tube(solids.smooth_path(path, 6), 0.014))
        hang(kit.uniform("shade_radius", 0.16, 0.24), kit.uniform("shade_height", 0.16, 0.26), reach, high * 0.83)
        return
    if kind == "table":
        radius, tall = kit.uniform("shade_radius", 0.14, 0.22), kit.uniform("shade_height", 0.16, 0.26)
        stem = kit.uniform("stem", 0.22, 0.4)
        shape = kit.choose("foot", "vase", "ball", "column", "gourd", "box")
        if shape == "vase":
            p = [(0.06, 0), (0.07, 0.02), (0.05, 0.06), (0.09, 0.4), (0.1, 0.6), (0.05, 0.9), (0.03, 1.0)]
            kit.add(body, lathe([(r, h if k < 3 else h * stem) for k, (r, h) in enumerate(p)], 28))
        elif shape == "ball":
            r = stem * 0.42
            kit.add(body, ball(2 * r, 2 * r, 2 * r, 20).at(z=r + 0.02), cylinder(r * 0.6, 0.03, 24).at(z=0.015))
        elif shape == "column":
            kit.add(body, lathe([(0.09, 0), (0.09, 0.02), (0.025, 0.05), (0.02, stem)], 28))
        elif shape == "gourd":
            p = [(0.08, 0), (0.11, 0.12), (0.1, 0.3), (0.045, 0.55), (0.06, 0.72), (0.05, 0.88), (0.02, 1.0)]
            kit.add(body, lathe([(r, h * stem) for r, h in p], 28))
        else:
            kit.add(body, box(0.11, 0.11, stem * 0.85, 0.012).at(z=stem * 0.425))
        kit.add(metal(kit.rng), cylinder(0.01, tall + stem * 0.3, 10).at(z=stem * 0.85 + (tall + stem * 0.3) / 2))
        hang(radius, tall, 0, stem + tall)
        return
    radius, tall = kit.uniform("shade_radius", 0.18, 0.28), kit.uniform("shade_height", 0.2, 0.32)
    high = kit.uniform("height", 1.3, 1.7)
    if kind == "tripod":
        hub = high - tall - 0.12
        for angle in _around(3, kit.uniform("turn", 0, 120)):
            foot = kit.visible.setdefault("spread", float(kit.rng.uniform(0.22, 0.34)))
            kit.add(body, rod((foot, 0, 0), (0.02, 0, hub), 0.016).turned("z", angle))
        kit.add(metal(kit.rng), cylinder(0.035, 0.08, 16, 0.01).at(z=hub), cylinder(0.012, high - hub - 0.02, 10).at(z=(high + hub) / 2 - 0.01))
    else:
        base = kit.uniform("base", 0.12, 0.18)
        kit.add(body, lathe([(base, 0), (base, 0.018), (base * 0.3, 0.04), (0.013, 0.06), (0.013, high - 0.01)], 28))
        if kit.chance("reading_arm", 0.25):
            kit.add(body, rod((0, 0, high * 0.6), (0.22, 0.0, high * 0.62), 0.008))
            kit.add(shade, lathe([(0.03, 0), (0.06, -0.1), (0.05, -0.1), (0.02, -0.01)], 20).at(0.23, 0, high * 0.63))
    hang(radius, tall, 0, high)


# --- Things with a front ----------------------------------------------------------------------


def speaker(kit: Kit) -> None:
    """Tower, bookshelf, on a stand, stage monitor, sound bar, round. Hidden: the recess behind."""
    kind = kit.choose("subtype", "tower", "bookshelf", "bookshelf", "stand", "stage", "bar")
    body = _pick(kit.rng, (wood, plastic, paint))(kit.rng)
    cone = _pick(kit.rng, (BLACK, Material((0.2, 0.2, 0.22), name="cone"), Material((0.85, 0.7, 0.2), name="kevlar"), Material((0.8, 0.8, 0.8), name="aluminium")))
    grille = Material((0.13, 0.13, 0.14), name="grille")
    size = {"tower": ((0.18, 0.26), (0.85, 1.2), (0.24, 0.36)), "bookshelf": ((0.17, 0.24), (0.28, 0.42), (0.2, 0.3)),
            "stand": ((0.17, 0.24), (0.28, 0.42), (0.2, 0.3)), "stage": ((0.35, 0.5), (0.55, 0.8), (0.3, 0.42)),
            "bar": ((0.8, 1.2), (0.09, 0.14), (0.1, 0.16))}[kind]  # fmt: skip
    width, height, depth = (kit.uniform(n, *r) for n, r in zip(("width", "height", "depth"), size, strict=True))
    lift = 0.0
    if kind == "tower" or (kind == "bookshelf" and kit.chance("feet", 0.5)):
        lift = 0.025
        for sx in (-1, 1):
            for sy in (-1, 1):
                kit.add(BLACK, lathe([(0.006, 0), (0.016, lift + 0.002)], 10).at(sx * (depth / 2 - 0.03), sy * (width / 2 - 0.03)))
    elif kind == "stand":
        lift = kit.uniform("stand_height", 0.5, 0.7)
        kit.add(BLACK, box(depth * 1.05, width * 1.2, 0.02, 0.005).at(z=0.01), box(depth * 0.9, width * 0.9, 0.015).at(z=lift - 0.008))
        kit.add(BLACK, cylinder(0.025, lift - 0.02, 14).at(z=lift / 2))
    back = kit.hide("back_recess", 0.0, 0.75) * depth
    kit.azimuth = ((-85.0, 85.0),)
    case = Kit(kit.rng, kit.hidden_rng)
    _case(case, body, depth, width, height, 0.015, back)
    kit.add(body, *(part.at(z=lift) for part, _ in case._parts))
    front = depth / 2

    def driver(radius: float, y: float, z: float) -> None:
        ring = lathe([(radius, 0), (radius, 0.006), (radius * 0.93, 0.01), (radius * 0.9, 0.004)], 28)
        edge = lathe([(radius * 0.92, 0.003), (radius * 0.86, 0.009), (radius * 0.78, 0.002)], 28)
        funnel = lathe([(radius * 0.8, 0.004), (radius * 0.3, 0.0012), (radius * 0.3, 0.0011)], 28)
        dome = ball(radius * 0.5, radius * 0.5, radius * 0.3, 14).at(z=0.003)
        for material, part in ((CHROME, ring), (RUBBER, edge), (cone, funnel), (BLACK, dome)):
            kit.add(material, part.turned("y", 90).at(front, y, z))

    kit.add(grille, box(0.004, width * 0.94, height * 0.96, 0.001).at(front, 0, lift + height / 2))
    if kind == "bar":
        for y in np.linspace(-0.42, 0.42, kit.choose("drivers", 4, 5, 6, 8)) * width:
            driver(height * 0.34, y, lift + height / 2)
    elif kind == "stage":
        driver(width * 0.4, 0, lift + height * 0.34)
        horn = prism([(0, -0.1), (0.012, -0.14), (0.012, 0.14), (0, 0.1)], width * 0.62).turned("z", 0)
        kit.add(BLACK, horn.scaled(1, 1, height).at(front, 0, lift + height * 0.79))
        kit.add(CHROME, box(0.006, width * 0.2, height * 0.06).at(front + 0.009, 0, lift + height * 0.79))
        kit.both(BLACK, box(depth * 0.4, 0.006, 0.09, 0.002).at(0, width / 2, lift + height * 0.7))
    else:
        woofers = kit.choose("woofers", 2, 3, 4) if kind == "tower" else 1
        r = width * 0.4
        pitch = min(2.15 * r, height * 0.68 / woofers)
        for k in range(woofers):
            driver(min(r, pitch * 0.47), 0, lift + height * 0.06 + pitch * (k + 0.5))
        driver(width * 0.17, 0, lift + min(height * 0.06 + pitch * woofers + width * 0.24, height - width * 0.2))
        if kind == "tower" and kit.chance("midrange", 0.5):
            driver(width * 0.24, 0, lift + height - width * 0.3)


def monitor(kit: Kit) -> None:
    """Desk monitor, television, CRT, curved, laptop. Hidden: the bulge behind the screen."""
    kind = kit.choose("subtype", "desk", "desk", "tv", "crt", "curved", "laptop")
    body, glass = plastic(kit.rng), screen(kit.rng)
    width = kit.uniform("width", 0.9, 1.3) if kind in ("tv", "curved") else kit.uniform("width", 0.45, 0.65)
    aspect = kit.uniform("aspect", 1.25, 1.4) if kind == "crt" else kit.uniform("aspect", 1.5, 1.9)
    if kind == "curved":
        aspect = kit.uniform("aspect", 2.0, 2.4)
    height = width / aspect
    bezel, thick = width * kit.uniform("bezel", 0.012, 0.04), width * kit.uniform("thickness", 0.03, 0.06)
    kit.azimuth = ((-30.0, 30.0),)

    def bulge(low: float, reach: float) -> None:
        """A housing behind the screen, inside the wedge that the screen hides from above."""
        deep = kit.hide("bulge_depth", 0.05, 1.0) * reach
        wide = kit.hide("bulge_width", 0.3, 0.6) * width
        tall = kit.hide("bulge_height", 0.3, 0.6) * height
        outer = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])
        rings = [np.column_stack([np.full(4, x), outer * [wide * s, tall * s]]) for x, s in ((0.0, 1.0), (-deep, 0.6))]
        kit.add(body, loft(rings).at(-thick / 2 + 0.001, 0, low + tall * 0.5 + 0.02 * height))

    if kind == "laptop":
        depth = width * kit.uniform("deck", 0.62, 0.72)
        kit.add(body, box(depth, width, 0.022, 0.005).at(depth / 2, 0, 0.011))
        kit.add(BLACK, box(depth * 0.45, width * 0.86, 0.004).at(depth * 0.4, 0, 0.023))
        for i in range(4):
            for j in range(10):
                kit.add(body, box(depth * 0.08, width * 0.065, 0.004).at(depth * (0.24 + 0.105 * i), (j - 4.5) * width * 0.083, 0.026))
        kit.add(BLACK, box(depth * 0.2, width * 0.26, 0.002).at(depth * 0.8, 0, 0.0225))
        lean = kit.uniform("lean", 8, 25)
        lid = box(0.014, width, height, 0.004).at(0, 0, height / 2)
        show = box(0.002, width - 2 * bezel, height - 2 * bezel).at(0.008, 0, height / 2)
        kit.add(body, lid.turned("y", -lean).at(0, 0, 0.02))
        kit.add(glass, show.turned("y", -lean).at(0, 0, 0.02))
        # Feet, battery pack: a wedge below the lid's shadow, no deeper than the lid leans back.
        reach = max(np.sin(np.radians(lean)) * height * 0.55, 0.01)
        deep = kit.hide("rear_pack", 0.02, 1.0) * reach
        kit.add(body, box(deep, width * 0.6, 0.016).at(-deep / 2 - 0.004, 0, 0.009))
        return
    if kind == "crt":
        deep = width * kit.uniform("tube_depth", 0.7, 0.9)
        low = 0.06
        face = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]) * [width, height]
        shape = [(deep * 0.5, 0.97), (deep * 0.48, 1.0), (deep * 0.2, 1.0), (-deep * 0.05, 0.86), (-deep * 0.5, 0.62)]
        rings = [np.column_stack([np.full(4, x), face * s]) for x, s in shape]
        kit.add(body, loft(rings).at(z=low + height / 2))
        kit.add(glass, box(0.01, width * 0.84, height * 0.8, 0.004).at(deep * 0.5, 0, low + height * 0.53))
        kit.add(BLACK, *(box(0.008, 0.02, 0.01).at(deep * 0.5, width * (0.2 + 0.06 * k), low + height * 0.07) for k in range(4)))
        kit.add(body, cylinder(width * 0.3, 0.03, 24).at(deep * 0.1, 0, 0.015), cylinder(width * 0.14, low + 0.02, 20).at(deep * 0.1, 0, low / 2))
        # Behind the wide front part, on the tube's underside.
        kit.azimuth = ((-20.0, 20.0),)
        pack = kit.hide("yoke_depth", 0.05, 0.42) * deep
        kit.add(body, box(pack, width * 0.4, height * 0.3).at(-deep * 0.02 - pack / 2, 0, low + height * 0.3))
        return
    lift = width * kit.uniform("lift", 0.08, 0.2)
    if kind == "tv":
        lift = width * 0.06
    centre = lift + height / 2
    if kind == "curved":
        bend = kit.uniform("bend", 0.1, 0.25)
        y = np.linspace(-0.5, 0.5, 17)

        def shell(w: float, h: float, x0: float, x1: float) -> Solid:
            ring = [np.array([[x0 + bend * width * t * t * 2, w * t, -h / 2], [x1 + bend * width * t * t * 2, w * t, -h / 2],
                              [x1 + bend * width * t * t * 2, w * t, h / 2], [x0 + bend * width * t * t * 2, w * t, h / 2]]) for t in y]  # fmt: skip
            return loft(np.array(ring))

        kit.add(body, shell(width, height, -thick / 2, thick / 2).at(z=centre))
        kit.add(glass, shell(width - 2 * bezel, height - 2 * bezel, thick / 2, thick / 2 + 0.004).at(z=centre))
    else:
        kit.add(body, box(thick, width, height, thick * 0.2).at(z=centre))
        kit.add(glass, box(0.006, width - 2 * bezel, height - 2.4 * bezel).at(thick / 2, 0, centre + 0.2 * bezel))
    stand = kit.choose("stand", "feet", "plate") if kind == "tv" else kit.choose("stand", "plate", "disc", "vee")
    reach = width * kit.uniform("stand_depth", 0.16, 0.24)
    if stand == "feet":
        for s in (-1, 1):
            for sign in (-1, 1):
                kit.add(body, rod((0, s * width * 0.36, lift + 0.01), (sign * reach * 0.8, s * width * 0.36, 0.01), 0.012))
        reach *= 0.8
    else:
        if stand == "plate":
            kit.add(body, box(2 * reach, width * 0.45, 0.014, 0.004).at(z=0.007))
        elif stand == "disc":
            kit.add(body, cylinder(reach, 0.014, 32, 0.003).scaled(1, 1.3, 1).at(z=0.007))
        else:
            for s in (-1, 1):
                kit.add(body, rod((0, 0, 0.012), (reach, s * width * 0.3, 0.012), 0.011), rod((0, 0, 0.012), (-reach, s * width * 0.16, 0.012), 0.011))
        kit.add(body, box(thick * 0.6, width * 0.1, lift + height * 0.25).at(-thick * 0.6, 0, (lift + height * 0.25) / 2))
    bulge(lift, max(reach - thick / 2 - 0.01, 0.01))


def cellphone(kit: Kit) -> None:
    """Smartphone, candy bar, flip, slider, with keyboard. Hidden: how far the back is recessed."""
    kind = kit.choose("subtype", "smartphone", "smartphone", "candybar", "flip", "slider", "keyboard")
    body, glass = _pick(kit.rng, (plastic, plastic, paint))(kit.rng), screen(kit.rng)
    key = WHITE if max(body.diffuse) < 0.5 else BLACK
    width = kit.uniform("width", 0.06, 0.078)
    height = width * kit.uniform("aspect", 1.85, 2.15)
    thick = kit.uniform("thickness", 0.008, 0.012) if kind == "smartphone" else kit.uniform("thickness", 0.014, 0.02)
    corner = width * kit.uniform("corner", 0.06, 0.2)
    kit.azimuth = ((-80.0, 80.0),)

    def slab(tall: float, deep: float, inner: float) -> Solid:
        """An upright slab whose front is at x = deep / 2, its back hollowed out."""
        wall = width * 0.05

        def outline(inward: float) -> np.ndarray:
            return solids.rounded(tall - 2 * inward, width - 2 * inward, max(corner - inward, 0.001), 4)

        bevel = deep * 0.18
        part = solids.stack([(outline(wall), max(inner, 0.0002)), (outline(wall), 0.0), (outline(bevel * 0.5), 0.0),
                             (outline(0.0), bevel), (outline(0.0), deep - bevel), (outline(bevel), deep)])  # fmt: skip
        return part.turned("y", 90).at(-deep / 2, 0, tall / 2)

    def keypad(front: float, low: float, high: float, rows: int) -> None:
        pitch = (high - low) / rows
        for i in range(rows):
            for j in range(3):
                kit.add(key, box(0.0012, width * 0.22, pitch * 0.62, 0.0003).at(front, (j - 1) * width * 0.28, low + (i + 0.5) * pitch))

    recess = kit.hide("back_recess", 0.02, 0.85) * thick
    front = thick / 2
    if kind == "smartphone":
        kit.add(body, slab(height, thick, recess))
        border = kit.uniform("border", 0.03, 0.14)
        kit.add(glass, box(0.0008, width * 0.92, height * (1 - border) - 0.003).at(front, 0, height / 2))
        if border > 0.1:
            kit.add(CHROME, cylinder(width * 0.07, 0.001, 18).turned("y", 90).at(front, 0, height * border * 0.25))
        kit.add(BLACK, box(0.001, width * 0.2, 0.0016).at(front + 0.0002, 0, height - 0.004))
        kit.both(CHROME, box(thick * 0.3, 0.0012, height * 0.08).at(0, width / 2, height * 0.7))
    elif kind == "candybar":
        kit.add(body, slab(height, thick, recess))
        kit.add(glass, box(0.001, width * 0.76, height * 0.36, 0.0003).at(front, 0, height * 0.72))
        keypad(front, height * 0.06, height * 0.4, 4)
        kit.add(CHROME, cylinder(width * 0.12, 0.0016, 18).turned("y", 90).at(front, 0, height * 0.46))
        if kit.chance("antenna", 0.6):
            kit.add(BLACK, cylinder(thick * 0.32, height * 0.24, 12).at(0, width * 0.36, height * 1.08))
    elif kind == "keyboard":
        kit.add(body, slab(height * 0.92, thick, recess))
        kit.add(glass, box(0.001, width * 0.84, height * 0.38, 0.0003).at(front, 0, height * 0.66))
        for i in range(4):
            for j in range(8):
                kit.add(key, box(0.0012, width * 0.085, height * 0.06, 0.0003).at(front, (j - 3.5) * width * 0.11, height * (0.07 + 0.08 * i)))
        kit.add(CHROME, cylinder(width * 0.06, 0.002, 16).turned("y", 90).at(front, 0, height * 0.42))
    elif kind == "slider":
        kit.add(body, slab(height * 0.8, thick * 0.55, recess * 0.5).at(-thick * 0.28))
        upper = slab(height * 0.8, thick * 0.45, 0.0)
        slide = height * kit.uniform("slide", 0.25, 0.4)
        kit.add(body, upper.at(thick * 0.28, 0, slide))
        kit.add(glass, box(0.001, width * 0.84, height * 0.56, 0.0003).at(front + thick * 0.02, 0, slide + height * 0.46))
        kit.add(CHROME, cylinder(width * 0.1, 0.0016, 18).turned("y", 90).at(front + thick * 0.02, 0, slide + height * 0.09))
        keypad(0.0, height * 0.03, slide * 0.95, 3)
    else:
        half = height * 0.62
        kit.add(body, slab(half, thick, recess))
        keypad(front, half * 0.08, half * 0.62, 4)
        kit.add(CHROME, cylinder(width * 0.14, 0.0016, 18).turned("y", 90).at(front, 0, half * 0.78))
        tip = kit.uniform("open_angle", 8, 25)
        lid = slab(half, thick * 0.6, 0.0)
        kit.add(body, lid.turned("y", tip).at(thick * 0.1, 0, half * 1.0))
        show = box(0.001, width * 0.78, half * 0.66, 0.0003).at(thick * 0.3, 0, half * 0.54)
        kit.add(glass, show.turned("y", tip).at(thick * 0.1, 0, half * 1.0))
        kit.add(CHROME, cylinder(thick * 0.42, width * 0.9, 14).turned("x", 90).at(0.0, 0, half))


# --- Vehicles ---------------------------------------------------------------------------------


def _wheel(radius: float, width: float, spokes: int, hub: Material) -> list[tuple[Material, Solid]]:
    """A wheel around the origin with its axle along y; the outside toward +y."""
    w = width / 2
    tyre = lathe([(radius * 0.62, -w), (radius * 0.94, -w), (radius, -w * 0.6), (radius, w * 0.6), (radius * 0.94, w), (radius * 0.62, w)], 24)
    parts = [(RUBBER, tyre.turned("x", -90)), (BLACK, cylinder(radius * 0.63, width * 0.7, 20).turned("x", 90))]
    disc = cylinder(radius * 0.24, width * 0.5, 14, 0.1 * radius).turned("x", 90).at(y=w * 0.5)
    parts.append((hub, disc))
    rim = lathe([(radius * 0.64, 0), (radius * 0.64, w * 0.3), (radius * 0.54, w * 0.3), (radius * 0.54, 0)], 24)
    parts.append((hub, rim.turned("x", -90).at(y=w * 0.7)))
    for angle in _around(spokes):
        spoke = box(radius * 0.14, w * 0.4, radius * 0.5).at(0, w * 0.75, radius * 0.36)
        parts.append((hub, spoke.turned("y", angle)))
    return parts


def car(kit: Kit) -> None:
    """Sedan, hatchback, coupe, estate, van, pickup, off-roader. Hidden: the floor's height."""
    kind = kit.choose("subtype", "sedan", "sedan", "hatch", "coupe", "estate", "van", "pickup", "suv")
    body = paint(kit.rng)
    trim = BLACK if kit.rng.random() < 0.6 else CHROME
    # Lengths in units of a wheel's radius of about a third of a metre.
    tall = {"van": 1.9, "suv": 1.75, "pickup": 1.75, "coupe": 1.28}.get(kind, 1.45) * kit.uniform("tallness", 0.95, 1.06)
    length = {"hatch": 3.8, "van": 4.9, "pickup": 5.2, "suv": 4.6, "coupe": 4.4}.get(kind, 4.6) * kit.uniform("length", 0.95, 1.05)
    half = kit.uniform("half_width", 0.86, 0.96)
    radius = {"suv": 0.39, "pickup": 0.39, "van": 0.36}.get(kind, 0.33) * kit.uniform("wheel", 0.95, 1.08)
    sill = radius * kit.uniform("clearance", 0.55, 0.75)
    belt = tall * {"van": 0.6, "suv": 0.62, "pickup": 0.6}.get(kind, 0.62)
    hood = belt * kit.uniform("hood", 0.88, 0.95)
    front, rear = length / 2, -length / 2
    # Stations of the lower body from the rear: x, half width, top.
    tail = {"sedan": 0.99, "coupe": 1.0, "pickup": 0.98}.get(kind, 1.0) * belt
    nose = kit.uniform("nose", 0.7, 0.85)
    screen_x = front - length * {"van": 0.14, "hatch": 0.24, "pickup": 0.27}.get(kind, 0.27)
    stations = [(rear, 0.82, tail * 0.72), (rear + 0.04, 0.9, tail * 0.94), (rear + 0.25, 0.97, tail),
                (rear + length * 0.3, 1.0, belt), (screen_x - 0.1, 1.0, belt), (screen_x + 0.05, 0.99, hood * 1.02),
                (front - 0.45, 0.96, hood * 0.97), (front - 0.12, 0.9, hood * 0.9), (front - 0.03, 0.84, hood * nose), (front, 0.76, hood * nose * 0.85)]  # fmt: skip
    recess = kit.hide("floor_height", 0.02, 0.85)
    rings = []
    for k, (x, w, top) in enumerate(stations):
        y = half * w
        low = sill + (0.1 if k in (0, len(stations) - 1) else 0.03 if k in (1, len(stations) - 2) else 0)
        floor = low + (recess * (belt * 0.8 - low) if 2 <= k <= len(stations) - 3 else 0.004)
        arc = [(y * 0.97, low), (y, low + 0.3 * (top - low)), (y * 0.99, low + 0.62 * (top - low)), (y * 0.93, top - 0.07), (y * 0.84, top), (y * 0.4, top + 0.02)]
        inner = [(-(y * 0.82), low), (-(y * 0.82), floor), (y * 0.82, floor), (y * 0.82, low)]
        ring = [*arc, *((-a, b) for a, b in arc[::-1]), *inner]
        rings.append([(x, a, b) for a, b in ring])
    kit.add(body, loft(np.array(rings)))
    # The cabin: glass, pillars, roof.
    roof_half, belt_half = half * kit.uniform("tumblehome", 0.7, 0.8), half * 0.86
    rake = {"van": 0.42, "coupe": 0.95, "suv": 0.6, "pickup": 0.6}.get(kind, 0.8) * kit.uniform("rake", 0.9, 1.1)
    glass_front, glass_rear = screen_x + 0.08, {
        "sedan": rear + length * 0.18, "coupe": rear + length * 0.1, "hatch": rear + 0.1, "estate": rear + 0.08,
        "van": rear + 0.06, "suv": rear + 0.1, "pickup": rear + length * 0.42,
    }[kind]  # fmt: skip
    slope = {"sedan": 0.6, "coupe": 1.1, "hatch": 0.45, "estate": 0.3, "van": 0.1, "suv": 0.22, "pickup": 0.2}[kind]
    roof_front, roof_rear = glass_front - rake, glass_rear + slope * kit.uniform("rear_slope", 0.85, 1.15)
    base_z, top_z = belt - 0.03, tall - 0.05

    def frustum(grow: float, low: float, high: float) -> Solid:
        def at(z: float) -> np.ndarray:
            t = (z - base_z) / (top_z - base_z)
            xs = (1 - t) * np.array([glass_front, glass_rear]) + t * np.array([roof_front, roof_rear])
            y = (1 - t) * belt_half + t * roof_half + grow
            r = 0.12
            a, b = xs[0] + grow, xs[1] - grow
            flat = np.array([(a, y - r), (a - r * 0.8, y), (b + r * 0.8, y), (b, y - r), (b, -y + r), (b + r * 0.8, -y), (a - r * 0.8, -y), (a, -y + r)])
            return np.column_stack([flat, np.full(8, z)])
        return loft(np.array([at(low), at(high)]))

    kit.add(DARK_GLASS, frustum(0.0, base_z, top_z))
    roof = [frustum(0.012, top_z - 0.06, top_z).vertices[:8], frustum(0.012, top_z - 0.06, top_z).vertices[8:16]]
    crown = roof[1].copy()
    crown[:, 2] += 0.05
    crown[:, :2] = crown[:, :2].mean(axis=0) + 0.88 * (crown[:, :2] - crown[:, :2].mean(axis=0))
    kit.add(body, loft(np.array([*roof, crown])))
    kit.add(body, frustum(0.014, base_z, base_z + 0.05))

    def pillar(t0: float, t1: float, size: float) -> None:
        """A bar on the side from the belt at fraction t0 of the glass's length to the roof at t1."""
        a = glass_rear + t0 * (glass_front - glass_rear), belt_half + 0.004, base_z
        b = roof_rear + t1 * (roof_front - roof_rear), roof_half + 0.004, top_z
        kit.both(body, tube([a, b], size, 6).scaled(1, 1, 1))

    pillar(0.985, 0.97, 0.045)
    pillar(0.02, 0.03, 0.06)
    for t in ((0.52,) if kind in ("coupe", "pickup", "hatch") else (0.3, 0.62)):
        pillar(t, t, 0.04)
    if kind == "van" and kit.chance("panel_van", 0.5):
        kit.visible["panel_van"] = True
        t = 0.62
        for s in (-1, 1):
            quad = np.array([(glass_rear, belt_half, base_z), (glass_rear + t * (glass_front - glass_rear), belt_half, base_z),
                             (roof_rear + t * (roof_front - roof_rear), roof_half, top_z), (roof_rear, roof_half, top_z)]) * [1, s, 1]  # fmt: skip
            kit.add(body, loft(np.array([quad, quad + [0, 0.015 * s, 0]])))
    if kind == "pickup":
        deep = belt * 0.62
        bed_front, bed_rear = glass_rear - 0.05, rear + 0.12
        middle, long = (bed_front + bed_rear) / 2, bed_front - bed_rear
        kit.add(BLACK, box(long, half * 1.5, 0.012).at(middle, 0, belt + 0.028))
        kit.both(body, box(long + 0.1, 0.07, 0.14, 0.02).at(middle, half * 0.86, belt + 0.05))
        kit.add(body, box(0.06, half * 1.72, 0.14, 0.02).at(bed_rear, 0, belt + 0.05), box(0.06, half * 1.72, 0.14, 0.02).at(bed_front, 0, belt + 0.05))
        kit.visible["bed"] = float(deep)
    axle = length * kit.uniform("wheelbase", 0.29, 0.315)
    hub = _pick(kit.rng, (CHROME, metal(kit.rng), BLACK))
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
    kit.both(RED_LIGHT, box(0.1, half * 0.3, belt * 0.16, 0.03).at(rear + 0.03, half * 0.62, tail * 0.78))
    kit.add(trim, box(0.08, half * 1.5, 0.1, 0.02).at(rear + 0.01, 0, sill + 0.22))
    kit.add(WHITE, box(0.02, 0.4, 0.1).at(rear - 0.005, 0, tail * 0.62), box(0.02, 0.4, 0.09).at(front + 0.025, 0, sill + 0.22))
    kit.both(body, ball(0.14, 0.22, 0.14, 12).at(glass_front - 0.42, belt_half + 0.14, belt + 0.09))
    doors = (0.52,) if kind in ("coupe", "pickup") else (0.3, 0.62)
    for t in (*doors, 0.9):
        x = glass_rear + t * (glass_front - glass_rear)
        kit.both(BLACK, box(0.012, 0.012, (belt - sill) * 0.86).at(x, half * 0.992, sill + (belt - sill) * 0.5))
        if t != 0.9:
            kit.both(trim, box(0.16, 0.03, 0.03, 0.008).at(x + 0.18, half * 0.975, belt * 0.87))
    if kind == "suv" and kit.chance("roof_rails", 0.6):
        kit.both(trim, rod((roof_front - 0.2, roof_half * 0.85, top_z + 0.08), (roof_rear + 0.1, roof_half * 0.85, top_z + 0.08), 0.02))
    if kind == "coupe" and kit.chance("spoiler", 0.5):
        kit.add(body, box(0.22, half * 1.6, 0.03, 0.01).at(rear + 0.2, 0, tail + 0.2))
        kit.both(body, box(0.08, 0.03, 0.2).at(rear + 0.2, half * 0.6, tail + 0.1))


def _wing(
    root: Sequence[float], tip: Sequence[float], root_chord: float, tip_chord: float, thickness: float
) -> Solid:
    """A wing from `root` to `tip` (positions of the leading edge), nose toward +x."""
    profile = np.array([(0, 0), (0.06, 0.5), (0.3, 1.0), (0.65, 0.62), (1, 0.04), (0.65, -0.32), (0.3, -0.55), (0.06, -0.32)])
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
    kind = kit.choose("subtype", "airliner", "airliner", "fighter", "propeller", "business", "biplane")
    skin = paint(kit.rng) if kind in ("propeller", "biplane") or kit.rng.random() < 0.2 else WHITE
    if kind == "fighter":
        grey = float(kit.rng.uniform(0.4, 0.65))
        skin = _pick(kit.rng, (Material((grey, grey, grey * 1.04), (0.15,) * 3, 20.0, name="grey"), Material((0.42, 0.45, 0.36), (0.1,) * 3, 20.0, name="olive")))
    accent = paint(kit.rng)
    kit.azimuth = ((80.0, 100.0), (-100.0, -80.0))
    if kind in ("airliner", "business"):
        r = kit.uniform("radius", 0.05, 0.062) if kind == "airliner" else kit.uniform("radius", 0.055, 0.065)
        long = kit.uniform("half_length", 0.48, 0.55)
        z = r + 0.07
        body = [(long, 0.004, 0.004, z - 0.012), (long * 0.985, r * 0.35, r * 0.35, z - 0.01), (long * 0.94, r * 0.7, r * 0.7, z - 0.006), (long * 0.86, r * 0.95, r * 0.95, z), (long * 0.76, r, r, z),
                (-long * 0.45, r, r, z), (-long * 0.7, r * 0.75, r * 0.75, z + r * 0.22), (-long * 0.9, r * 0.35, r * 0.36, z + r * 0.5), (-long, r * 0.1, r * 0.12, z + r * 0.6)]  # fmt: skip
        kit.add(skin, _fuselage(body))
        span = kit.uniform("half_span", 0.44, 0.54)
        sweep = kit.uniform("sweep", 0.55, 0.8) * 0.42 * (span / 0.5)
        chord = kit.uniform("chord", 0.17, 0.22)
        root_x, wing_z = 0.12, z - r * 0.55
        lift = kit.uniform("dihedral", 0.03, 0.09)
        kit.both(skin, _wing((root_x, r * 0.3, wing_z), (root_x - sweep, span, wing_z + lift), chord, chord * 0.28, 0.06))
        if kit.chance("winglets", 0.6):
            kit.both(accent, _wing((root_x - sweep, span, wing_z + lift), (root_x - sweep - 0.035, span + 0.012, wing_z + lift + 0.055), chord * 0.28, chord * 0.12, 0.05))
        tail = -long * 0.78
        fin = kit.uniform("fin", 0.15, 0.2)
        high_tail = kind == "business" or kit.chance("t_tail", 0.15)
        kit.add(accent, _wing((tail + 0.06, 0, z + r * 0.7), (tail - fin * 0.62, 0, z + r + fin), 0.17, 0.085, 0.05))
        level = z + r + fin * 0.98 if high_tail else z + r * 0.55
        back = tail - fin * 0.6 if high_tail else tail + 0.0
        kit.both(skin, _wing((back, 0.0, level), (back - 0.1, 0.18, level + 0.012), 0.1, 0.045, 0.06))
        nacelle = [(0.0, 0.07), (0.62, 0.075), (0.92, 0.05), (1.0, 0.0), (0.95, -0.1), (0.62, -0.13), (0.5, -0.16), (0.0, -0.17)]
        nr = r * kit.uniform("engine", 0.5, 0.62)
        engine = lathe([(a * nr, b) for a, b in nacelle][1:], 20).turned("y", 90)
        fan = cylinder(nr * 0.84, 0.004, 20).turned("y", 90).at(0.066)
        spots = []
        if kind == "business":
            spots = [(-long * 0.48, r + nr * 0.95, z + r * 0.35)]
        else:
            engines = kit.choose("engines", 2, 2, 4)
            for share in (0.34,) if engines == 2 else (0.3, 0.6):
                spots.append((root_x - sweep * share + 0.06, span * share, wing_z + lift * share - nr * 0.95))
        for spot in spots:
            kit.both(skin, engine.at(*spot))
            kit.both(BLACK, fan.at(*spot))
            kit.both(skin, box(0.1, 0.012, nr * 1.0).at(spot[0] - 0.07, spot[1] - (nr if kind == "business" else 0), spot[2] + (0 if kind == "business" else nr * 0.8)))
        glass = [(long * 0.955, r * 0.655, r * 0.66, z + 0.001), (long * 0.91, r * 0.86, r * 0.87, z + 0.002)]
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
                kit.add(RUBBER, cylinder(0.02, 0.012, 14).turned("x", 90).at(x, y + 0.012 * s, 0.02))
        tank, place = 0.0085, (0.01, r * 1.15, wing_z - 0.006)
    elif kind == "fighter":
        long = kit.uniform("half_length", 0.5, 0.58)
        w = kit.uniform("body_width", 0.055, 0.07)
        z = 0.13
        body = [(long, 0.002, 0.002, z), (long * 0.85, w * 0.32, w * 0.34, z), (long * 0.6, w * 0.62, w * 0.66, z), (long * 0.3, w * 0.95, w * 0.8, z),
                (0, w * 1.15, w * 0.82, z), (-long * 0.5, w * 1.15, w * 0.75, z), (-long * 0.85, w * 0.8, w * 0.62, z), (-long * 0.93, w * 0.6, w * 0.55, z)]  # fmt: skip
        kit.add(skin, _fuselage(body, 16))
        kit.add(BLACK, rod((long, 0, z), (long + 0.05, 0, z), 0.003, 6))
        span = kit.uniform("half_span", 0.3, 0.42)
        delta = kit.chance("delta", 0.5)
        root_chord = kit.uniform("root_chord", 0.42, 0.55) if delta else kit.uniform("root_chord", 0.28, 0.36)
        tip_chord = root_chord * (0.12 if delta else 0.3)
        sweep = root_chord * (0.85 if delta else 0.6)
        root_x = 0.2 if delta else 0.12
        kit.both(skin, _wing((root_x, w * 0.7, z - 0.012), (root_x - sweep, span, z - 0.018), root_chord, tip_chord, 0.035))
        if delta and kit.chance("canards", 0.6):
            kit.both(skin, _wing((long * 0.5, w * 0.5, z + 0.02), (long * 0.5 - 0.07, w + 0.1, z + 0.025), 0.08, 0.03, 0.05))
        if not delta:
            kit.both(skin, _wing((-long * 0.62, w * 0.7, z), (-long * 0.62 - 0.12, w + 0.14, z - 0.005), 0.14, 0.05, 0.04))
        fin = kit.uniform("fin", 0.13, 0.18)
        if kit.chance("twin_fins", 0.5):
            kit.both(skin, _wing((-long * 0.5, w * 0.75, z + 0.03), (-long * 0.5 - fin * 0.7, w * 1.1, z + 0.03 + fin), 0.17, 0.06, 0.035))
        else:
            kit.add(skin, _wing((-long * 0.45, 0, z + 0.03), (-long * 0.45 - fin * 0.9, 0, z + 0.05 + fin * 1.1), 0.22, 0.07, 0.035))
        kit.add(DARK_GLASS, ball(0.2, w * 0.95, 0.085, 18).at(long * 0.52, 0, z + w * 0.62))
        kit.both(skin, box(0.18, w * 0.55, w * 1.1, 0.01).at(long * 0.12, w * 1.0, z - 0.01))
        kit.both(BLACK, box(0.004, w * 0.45, w * 0.9).at(long * 0.12 + 0.09, w * 1.0, z - 0.01))
        nozzles = (-1, 1) if kit.chance("twin_engines", 0.5) else (0,)
        for s in nozzles:
            nr = w * (0.48 if len(nozzles) == 2 else 0.62)
            kit.add(Material((0.25, 0.24, 0.23), (0.3,) * 3, 30.0), lathe([(nr, 0), (nr * 0.8, -0.08), (nr * 0.7, -0.08), (nr * 0.85, 0)], 20).turned("y", 90).at(-long * 0.92, s * w * 0.5, z))
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
        body = [(long * 0.98, w * 0.35, w * 0.35, z), (long * 0.95, w * 0.8, w * 0.8, z), (long * 0.6, w, w * 0.95, z), (long * 0.2, w, w * 1.15, z + 0.01),
                (-long * 0.3, w * 0.75, w * 0.85, z + 0.005), (-long * 0.98, w * 0.14, w * 0.3, z + 0.02)]  # fmt: skip
        kit.add(skin, _fuselage(body, 16))
        span, chord = kit.uniform("half_span", 0.46, 0.56), kit.uniform("chord", 0.13, 0.17)
        high = kind == "propeller" and kit.chance("high_wing", 0.5)
        wing_z = z + w * 1.15 if high else z - w * 0.6
        kit.both(skin, _wing((long * 0.42, 0.0, wing_z), (long * 0.38, span, wing_z + (0.0 if high else 0.035)), chord, chord * 0.72, 0.07))
        if high:
            kit.both(CHROME, rod((long * 0.25, w * 0.8, z - w * 0.5), (long * 0.25, span * 0.5, wing_z - 0.002), 0.006, 6))
        if kind == "biplane":
            top = z + w * 2.3
            kit.both(skin, _wing((long * 0.5, 0.0, top), (long * 0.48, span, top + 0.01), chord, chord * 0.8, 0.06))
            for x in (long * 0.4, long * 0.14):
                kit.both(CHROME, rod((x, span * 0.75, wing_z + 0.02), (x, span * 0.75, top), 0.005, 6), rod((x, w * 0.6, z + w * 0.7), (x, w * 1.3, top), 0.005, 6))
            kit.add(BLACK, ball(0.1, w * 1.3, 0.03, 14).at(long * 0.0, 0, z + w * 1.02))
            kit.add(DARK_GLASS, box(0.006, w, 0.035).at(long * 0.14, 0, z + w * 1.2))
        else:
            cabin = [(long * 0.52, w * 0.85, z + w * 0.6), (long * 0.34, w * 0.78, z + w * 1.7), (-long * 0.12, w * 0.7, z + w * 1.6), (-long * 0.34, w * 0.5, z + w * 0.7)]
            rings = [np.array([(x, y, z + w * 0.2), (x, y, top), (x, -y, top), (x, -y, z + w * 0.2)]) for x, y, top in cabin]
            kit.add(DARK_GLASS, loft(np.array(rings)))
            kit.add(skin, box(long * 0.48, w * 1.5, 0.008, 0.002).at(long * 0.11, 0, z + w * 1.68))
        kit.add(accent, _wing((-long * 0.75, 0, z + 0.02), (-long * 0.9, 0, z + 0.17), 0.13, 0.07, 0.06))
        kit.both(skin, _wing((-long * 0.76, 0, z + 0.025), (-long * 0.82, 0.19, z + 0.03), 0.1, 0.065, 0.06))
        kit.add(accent, lathe([(w * 0.36, 0), (w * 0.28, 0.03), (0.004, 0.06)], 16).turned("y", 90).at(long * 0.97, 0, z))
        blades = kit.choose("blades", 2, 3, 3, 4)
        for angle in _around(blades, kit.uniform("propeller_turn", 0, 180)):
            blade = box(0.008, 0.024, 0.14, 0.002).turned("z", 30).at(0, 0, 0.075)
            kit.add(BLACK, blade.turned("x", angle).at(long * 0.995, 0, z))
        for s in (-1, 1):
            kit.add(CHROME, rod((long * 0.4, s * w * 0.6, z - w * 0.6), (long * 0.45, s * 0.1, 0.035), 0.006, 6))
            kit.add(RUBBER, cylinder(0.035, 0.022, 16).turned("x", 90).at(long * 0.45, s * 0.108, 0.035))
        kit.add(RUBBER, cylinder(0.016, 0.012, 12).turned("x", 90).at(-long * 0.9, 0, 0.1))
        kit.add(CHROME, rod((-long * 0.9, 0, 0.1), (-long * 0.88, 0, z + 0.01), 0.005, 6))
        if kind == "propeller" and not high:
            tank, place = 0.012, (long * 0.2, w * 1.15, wing_z - 0.01)
        else:
            # No room under the wing: a hollow tail cone, open at its underside's flat.
            tank, place = 0.007, (long * 0.3, 0.0, z - w * 0.6) if not high else (long * 0.3, 0.0, z)
    size = kit.hide("tank_size", 0.15, 1.0) * tank
    reach = kit.hide("tank_length", 2.0, 7.0) * size
    drop = tube([(reach, 0, 0), (reach * 0.6, 0, 0), (-reach * 0.6, 0, 0), (-reach, 0, 0)], [size * 0.2, size, size, size * 0.2], 10)
    kit.both(skin, drop.at(place[0] - 0.02, place[1], place[2] - size))


def firearm(kit: Kit) -> None:
    """Assault rifle, hunting rifle, shotgun, sniper, pistol, revolver, submachine gun.

    Muzzle toward +x, seen from the side at azimuths of +-90. Hidden: what is on the far side.
    """
    kind = kit.choose("subtype", "assault", "assault", "hunting", "shotgun", "sniper", "pistol", "revolver", "smg")
    steel = _pick(kit.rng, (Material((0.16, 0.16, 0.17), (0.4,) * 3, 40.0, name="gunmetal"), Material((0.3, 0.31, 0.33), (0.5,) * 3, 50.0, name="steel"), Material((0.55, 0.56, 0.58), (0.6,) * 3, 60.0, name="stainless")))
    furniture = _pick(kit.rng, (wood, wood))(kit.rng) if kind in ("hunting", "shotgun") or kit.rng.random() < 0.35 else _pick(kit.rng, (BLACK, Material((0.35, 0.36, 0.26), name="olive"), Material((0.6, 0.52, 0.38), name="sand")))
    barrel = kit.uniform("barrel", 0.9, 1.15)

    def along(start: float, end: float, radius: float, z: float, y: float = 0.0, sides: int = 14) -> Solid:
        return rod((start, y, z), (end, y, z), radius, sides)

    if kind in ("pistol", "revolver"):
        w = kit.uniform("width", 0.022, 0.028)
        if kind == "pistol":
            long = 0.19 * barrel
            kit.add(steel, box(long, w, 0.032, 0.005).at(0, 0, 0.125))
            kit.add(furniture, prism([(-0.09, 0.11), (long / 2 - 0.005, 0.11), (long / 2 - 0.015, 0.092), (0.0, 0.09), (-0.03, 0.085), (-0.052, 0.0), (-0.1, 0.0), (-0.084, 0.07), (-0.1, 0.095)], w * 0.92, 0.003))
            guard = [(0.015, 0, 0.09), (0.018, 0, 0.066), (0.0, 0, 0.056), (-0.03, 0, 0.06)]
            kit.add(BLACK, along(long / 2 - 0.002, long / 2 + 0.006, 0.007, 0.127))
            for k in range(6):
                kit.both(BLACK, box(0.002, 0.001, 0.024).at(-long * 0.34 - 0.005 * k, w / 2, 0.126))
            kit.add(steel, box(0.006, 0.004, 0.006).at(long / 2 - 0.01, 0, 0.143), box(0.008, 0.012, 0.006).at(-long / 2 + 0.012, 0, 0.143))
            far, place, flat = 0.004, (0.02, 0.0, 0.126), (0.05, 0.018)
        else:
            long = 0.13 * barrel
            kit.add(steel, along(0.02, 0.02 + long, 0.009, 0.128), box(long, 0.008, 0.012).at(0.02 + long / 2, 0, 0.138), along(0.025, 0.01 + long, 0.006, 0.112))
            kit.add(steel, cylinder(0.0185, 0.042, 18, 0.003).turned("y", 90).at(-0.005, 0, 0.12))
            kit.add(steel, prism([(0.03, 0.145), (-0.05, 0.145), (-0.065, 0.125), (-0.06, 0.09), (0.02, 0.094), (0.03, 0.1)], w * 0.62, 0.003))
            kit.add(furniture, prism([(-0.052, 0.105), (-0.03, 0.092), (-0.045, 0.06), (-0.07, 0.0), (-0.105, 0.008), (-0.082, 0.06), (-0.072, 0.1)], w, 0.004))
            guard = [(0.018, 0, 0.094), (0.02, 0, 0.07), (0.002, 0, 0.06), (-0.028, 0, 0.07), (-0.034, 0, 0.09)]
            kit.add(steel, prism([(-0.055, 0.145), (-0.075, 0.162), (-0.08, 0.155), (-0.062, 0.13)], 0.008))
            kit.add(steel, box(0.012, 0.004, 0.01).at(long + 0.008, 0, 0.147))
            far, place, flat = 0.0015, (-0.04, 0.0, 0.12), (0.02, 0.02)
            w = w * 0.62
        kit.add(steel, tube(solids.smooth_path(guard, 4), 0.0028, 8))
        kit.add(BLACK, tube([(-0.006, 0, 0.09), (-0.001, 0, 0.072)], 0.0025, 6))
    else:
        w = kit.uniform("width", 0.035, 0.045)
        z = 0.2
        total = {"smg": 0.34, "sniper": 0.75, "hunting": 0.66, "shotgun": 0.68}.get(kind, 0.55) * barrel
        kit.add(steel, along(0.1, total, 0.0085 if kind != "shotgun" else 0.0125, z + 0.01))
        kit.add(BLACK, along(total, total + (0.02 if kind == "shotgun" else 0.045), 0.009 if kind == "shotgun" else 0.013, z + 0.01))
        if kind in ("hunting", "sniper", "shotgun"):
            kit.add(furniture, prism([(0.3, z + 0.002), (0.3, z - 0.02), (0.1, z - 0.032), (-0.08, z - 0.036), (-0.13, z - 0.06), (-0.17, z - 0.06), (-0.24, z - 0.045), (-0.48, z - 0.12), (-0.485, z + 0.0), (-0.3, z + 0.006), (-0.2, z - 0.012), (-0.12, z + 0.004)], w, 0.008))
            kit.add(RUBBER, prism([(-0.48, z - 0.122), (-0.5, z - 0.122), (-0.503, z + 0.0), (-0.48, z + 0.0)], w * 0.98, 0.003))
            kit.add(steel, box(0.26, w * 0.72, 0.034, 0.008).at(0.0, 0, z + 0.012))
            if kind == "shotgun":
                kit.add(steel, along(0.1, total * 0.92, 0.012, z - 0.018))
                kit.add(furniture, cylinder(0.024, 0.16, 16, 0.006).turned("y", 90).at(0.3, 0, z - 0.016))
            else:
                kit.add(steel, rod((-0.08, 0, z + 0.015), (-0.09, 0.05, z - 0.0), 0.005), ball(0.018, 0.018, 0.018, 10).at(-0.09, 0.05, z))
                kit.add(steel, rod((-0.08, 0, z + 0.015), (-0.09, -0.05, z - 0.0), 0.005), ball(0.018, 0.018, 0.018, 10).at(-0.09, -0.05, z))
            scope = kind == "sniper" or (kind == "hunting" and kit.chance("scope", 0.7))
            if kind == "sniper" or kit.chance("bipod", 0.15):
                kit.both(BLACK, rod((0.28, 0.0, z - 0.02), (0.3, 0.085, z - 0.19), 0.006), )
            low = z - 0.09
        else:
            kit.add(steel, prism([(-0.12, z - 0.03), (0.1, z - 0.03), (0.13, z - 0.02), (0.13, z + 0.03), (-0.12, z + 0.03)], w, 0.005))
            grip = prism([(-0.03, z - 0.028), (-0.075, z - 0.028), (-0.11, z - 0.12), (-0.07, z - 0.13)], w * 0.8, 0.006)
            kit.add(furniture, grip)
            guard_end = 0.13 + (total - 0.13) * kit.uniform("handguard", 0.4, 0.65)
            kit.add(furniture, box(guard_end - 0.12, w * 1.45, 0.055, 0.012).at((guard_end + 0.12) / 2, 0, z + 0.002))
            for k in range(4):
                kit.both(BLACK, box((guard_end - 0.14) / 6, 0.003, 0.012, 0.001).at(0.15 + (guard_end - 0.14) * (k + 0.5) / 4.2, w * 0.725, z + 0.008))
            bend = kit.uniform("magazine_bend", 0.0, 0.05)
            tall = kit.uniform("magazine", 0.11, 0.17)
            kit.add(BLACK, prism([(0.02, z - 0.025), (0.085, z - 0.025), (0.09 + bend * 0.6, z - 0.03 - tall * 0.55), (0.085 + bend * 1.7, z - 0.03 - tall), (0.025 + bend * 1.7, z - 0.04 - tall), (0.022 + bend * 0.6, z - 0.03 - tall * 0.55)], w * 0.62, 0.003))
            stock = kit.choose("stock", "solid", "skeleton", "solid")
            if stock == "solid":
                kit.add(furniture, prism([(-0.12, z + 0.022), (-0.12, z - 0.02), (-0.2, z - 0.03), (-0.33, z - 0.09), (-0.345, z - 0.09), (-0.345, z + 0.024)], w * 0.92, 0.006))
            else:
                kit.add(steel, along(-0.33, -0.12, 0.009, z + 0.012), rod((-0.33, 0, z - 0.08), (-0.12, 0, z - 0.015), 0.007))
                kit.add(RUBBER, box(0.022, w * 0.8, 0.13, 0.005).at(-0.335, 0, z - 0.03))
            scope = kit.chance("scope", 0.4)
            kit.add(steel, box(0.006, 0.008, 0.05).at(total * 0.92, 0, z + 0.035))
            if not scope:
                kit.add(steel, box(0.1, 0.012, 0.012).at(0, 0, z + 0.036), box(0.012, 0.02, 0.03).at(-0.06, 0, z + 0.05))
            low = z - 0.13
        if scope:
            kit.add(BLACK, along(-0.1, 0.1, 0.013, z + 0.075), along(0.08, 0.16, 0.021, z + 0.075), along(-0.14, -0.09, 0.018, z + 0.075))
            kit.add(BLACK, box(0.02, 0.02, 0.045).at(-0.05, 0, z + 0.048), box(0.02, 0.02, 0.045).at(0.06, 0, z + 0.048))
            kit.add(BLACK, cylinder(0.008, 0.03, 10).at(0.0, 0, z + 0.095))
            # The mounts may be wide: they set the width.
        guard = [(0.015, 0, z - 0.03), (0.015, 0, z - 0.062), (-0.005, 0, z - 0.07), (-0.04, 0, z - 0.066), (-0.05, 0, z - 0.04)]
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
    kit.add(steel, box(long, thick, flat[1]).at(place[0], side * (w / 2 + thick / 2 - 0.0005), place[2]))
    kit.azimuth = ((-130.0, -50.0),) if side > 0 else ((50.0, 130.0),)


def watercraft(kit: Kit) -> None:
    """Sailing boat, motor boat, yacht, cargo ship, rowing boat, ferry. Hidden: a tunnel in the hull.

    Seen from the side a boat with one hull looks like one with two.
    """
    kind = kit.choose("subtype", "sail", "sail", "motor", "yacht", "cargo", "rowing", "warship")
    paint_, trim = (WHITE if kit.rng.random() < 0.5 else paint(kit.rng)), paint(kit.rng)
    deck = wood(kit.rng)
    long = kit.uniform("half_length", 0.9, 1.05)
    slim = {"cargo": 0.15, "warship": 0.12, "yacht": 0.2, "rowing": 0.26, "motor": 0.27}.get(kind, 0.24)
    beam = long * slim * kit.uniform("beam", 0.92, 1.1)
    deep = long * {"cargo": 0.2, "warship": 0.16, "rowing": 0.19, "sail": 0.2}.get(kind, 0.2) * kit.uniform("freeboard", 0.9, 1.1)
    sheer = kit.uniform("sheer", 0.05, 0.3) * deep
    tunnel = kit.hide("tunnel", 0.02, 0.62) * deep
    kit.azimuth = ((60.0, 120.0), (-120.0, -60.0))
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
        hollow = tunnel * np.clip((0.35 - t) / 0.25, 0, 1) if t < 0.35 else 0.0
        roof = keel + max(hollow, 0.002)
        shape = [(0.0, roof, 0.0), (0.3, roof, 0.0), (0.34, keel, 0.0), (0.56, keel, 0.0), (0.8, keel + 0.25 * (top - keel), 0.3), (0.95, keel + 0.62 * (top - keel), 0.7), (1.0, top, 1.0)]
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
        kit.add(deck, loft(np.array([outline, outline + [0, 0, 0.022 * deep + 0.004]])))
    if kind == "sail":
        kit.add(paint_, pillow(long * 0.6, beam * 1.0, deep * 0.5, deep * 0.18).at(long * 0.1, 0, top + deep * 0.18))
        kit.both(DARK_GLASS, box(long * 0.36, 0.01, deep * 0.14).at(long * 0.1, beam * 0.5, top + deep * 0.22))
        mast, height = long * 0.12, long * kit.uniform("mast", 1.5, 1.9)
        kit.add(CHROME, tube([(mast, 0, top), (mast, 0, height + top)], [0.018 * long, 0.01 * long], 8))
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
                rows.append(np.concatenate([line, line[::-1] + [0, 0.004 * long, 0]]))
            return loft(np.array(rows))

        wind = kit.uniform("wind", 0.03, 0.12) * long * kit.choose("tack", -1, 1)
        kit.add(cloth, sail((mast - 0.02, 0, boom + 0.01), (-long * 0.7, 0, boom + 0.01), (mast - 0.02, 0, height * 0.97 + top), wind))
        if kit.chance("jib", 0.8):
            kit.add(cloth, sail((long * 0.98, 0, top + sheer + 0.03), (mast + 0.08 * long, 0, boom), (mast + 0.03, 0, height * 0.82 + top), wind))
        kit.add(CHROME, rod((mast, 0, height + top), (long * 1.04, 0, top + sheer), 0.004 * long, 5), rod((mast, 0, height + top), (-long * 0.98, 0, top), 0.004 * long, 5))
        kit.both(CHROME, rod((mast, 0, height * 0.85 + top), (mast, beam * 0.95, top), 0.004 * long, 5))
    elif kind == "motor":
        kit.add(paint_, pillow(long * 0.9, beam * 1.35, deep * 0.35, deep * 0.12).at(long * 0.3, 0, top + deep * 0.03))
        screen_ = [np.array([(long * 0.22, -beam * 0.62, top), (long * 0.36, 0, top), (long * 0.22, beam * 0.62, top)]),
                   np.array([(long * 0.08, -beam * 0.55, top + deep * 0.6), (long * 0.2, 0, top + deep * 0.6), (long * 0.08, beam * 0.55, top + deep * 0.6)])]  # fmt: skip
        kit.add(DARK_GLASS, loft(np.array([np.concatenate([a, a[::-1] - [0.02, 0, 0]]) for a in screen_])))
        for s in (-1, 1):
            kit.add(fabric(kit.rng), pillow(long * 0.16, beam * 0.5, deep * 0.35, 0.03).at(-long * 0.1, s * beam * 0.4, top + deep * 0.2), pillow(long * 0.06, beam * 0.5, deep * 0.6, 0.03).at(-long * 0.2, s * beam * 0.4, top + deep * 0.35))
        kit.add(trim, pillow(long * 0.18, beam * 1.3, deep * 0.4, 0.03).at(-long * 0.62, 0, top + deep * 0.2))
        if kit.chance("outboard", 0.6):
            kit.add(BLACK, pillow(long * 0.16, beam * 0.36, deep * 0.8, 0.04).at(-long * 1.08, 0, top + deep * 0.1), box(long * 0.06, beam * 0.14, deep * 0.9).at(-long * 1.08, 0, deep * 0.6))
        if kit.chance("canopy", 0.35):
            kit.add(fabric(kit.rng), pillow(long * 0.5, beam * 1.3, 0.04 * long, 0.018 * long).at(-long * 0.08, 0, top + deep * 1.5))
            for s in (-1, 1):
                for x in (-0.3, 0.12):
                    kit.add(CHROME, rod((long * x, s * beam * 0.6, top), (long * x, s * beam * 0.58, top + deep * 1.5), 0.008 * long))
    elif kind == "yacht":
        decks = kit.choose("decks", 2, 3)
        z, back, fore, wide = top, -0.62, 0.45, 0.8
        for k in range(decks):
            tall = deep * 0.5
            low = np.array([(fore, 0.75), (fore - 0.12, 1.0), (back, 1.0)])
            high = low - [(0.16, 0.12), (0.12, 0.12), (-0.02, 0.12)]
            def ring(q: np.ndarray, zz: float, w: float = wide) -> np.ndarray:
                pts = np.concatenate([q, (q * [1, -1])[::-1]]) * [long, beam * w]
                return np.column_stack([pts, np.full(len(pts), zz)])
            kit.add(paint_, loft(np.array([ring(low, z), ring(low * 0.5 + high * 0.5, z + tall * 0.35)])))
            kit.add(DARK_GLASS, loft(np.array([ring(low * 0.5 + high * 0.5, z + tall * 0.3, wide * 0.97), ring(high, z + tall * 0.85, wide * 0.97)])))
            roof = ring(high + [(0.06, 0.06), (0.06, 0.06), (-0.12, 0.06)], z + tall * 0.82)
            kit.add(paint_, loft(np.array([roof, roof + [0, 0, tall * 0.16]])))
            z, back, fore, wide = z + tall * 0.97, back + 0.16, fore - 0.3, wide * 0.85
        kit.add(CHROME, rod((-long * 0.3, 0, z), (-long * 0.36, 0, z + deep * 0.8), 0.015 * long))
        kit.add(WHITE, ball(0.12, 0.12, 0.1, 12).at(-long * 0.2, 0, z + 0.05))
        rail = [(x, y * 0.93, zz + deep * 0.3) for x, y, zz in rails[8:-1]]
        kit.both(CHROME, tube(rail, 0.006 * long, 5))
        for x, y, zz in rails[8:-1:2]:
            kit.both(CHROME, rod((x, y * 0.93, zz), (x, y * 0.93, zz + deep * 0.3), 0.005 * long, 5))
    elif kind == "cargo":
        kit.add(Material((0.45, 0.42, 0.38), name="deck"), box(long * 1.5, beam * 1.7, 0.02 * long).at(-long * 0.08, 0, top))
        tower = deep * kit.uniform("bridge", 1.5, 2.2)
        aft = -long * 0.76
        kit.add(WHITE, box(long * 0.2, beam * 1.5, tower, 0.01).at(aft, 0, top + tower / 2))
        kit.add(WHITE, box(long * 0.14, beam * 1.95, deep * 0.3, 0.01).at(aft + long * 0.02, 0, top + tower))
        for k in range(1, 5):
            kit.add(DARK_GLASS, box(long * 0.205, beam * 1.3, deep * 0.09).at(aft, 0, top + tower * k / 5))
        kit.add(DARK_GLASS, box(long * 0.145, beam * 1.9, deep * 0.1).at(aft + long * 0.02, 0, top + tower + deep * 0.04))
        kit.add(trim, cylinder(long * 0.05, deep * 0.8, 14).at(aft - long * 0.12, 0, top + tower * 0.8))
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
                        kit.add(_pick(kit.rng, colours), c.at(-long * 0.58 + pitch * (i + 0.5), (j - 1.5) * beam * 1.6 / across, top + deep * 0.37 * (level + 0.5)))
        elif cargo == "tanks":
            for k in range(4):
                kit.add(trim, ball(long * 0.26, beam * 1.5, deep * 1.5, 18).at(-long * 0.42 + long * 0.3 * k, 0, top + deep * 0.25))
        else:
            for k in range(5):
                kit.add(trim, box(long * 0.2, beam * 1.3, deep * 0.25, 0.01).at(-long * 0.48 + long * 0.26 * k, 0, top + deep * 0.12))
            for k in range(3):
                x = -long * 0.35 + long * 0.4 * k
                kit.add(CHROME, rod((x, 0, top), (x, 0, top + deep * 1.7), 0.016 * long), rod((x, 0, top + deep * 1.2), (x + long * 0.22, 0, top + deep * 1.6), 0.01 * long))
    elif kind == "warship":
        grey = Material((0.5, 0.53, 0.56), (0.1,) * 3, 20.0, name="grey")
        kit.add(grey, box(long * 0.7, beam * 1.3, deep * 0.6, 0.02).at(-long * 0.1, 0, top + deep * 0.28))
        kit.add(grey, box(long * 0.3, beam * 1.1, deep * 0.9, 0.02).at(long * 0.08, 0, top + deep * 0.9))
        kit.add(DARK_GLASS, box(long * 0.31, beam * 1.0, deep * 0.12).at(long * 0.08, 0, top + deep * 1.15))
        kit.add(grey, tube([(-long * 0.02, 0, top + deep), (-long * 0.04, 0, top + deep * 3)], [0.03 * long, 0.008 * long], 8))
        kit.add(grey, box(0.02 * long, beam * 0.9, 0.02 * long).at(-long * 0.03, 0, top + deep * 2.3))
        kit.add(BLACK, cylinder(beam * 0.36, deep * 0.8, 16).scaled(1.4, 1, 1).at(-long * 0.28, 0, top + deep * 0.9))
        for x, s in ((0.5, 1), (0.32, 1), (-0.66, -1))[: kit.choose("turrets", 2, 3)]:
            level = top + (deep * 0.3 if x == 0.32 else 0)
            if x == 0.32:
                kit.add(grey, cylinder(beam * 0.5, deep * 0.4, 18).at(long * x, 0, top + deep * 0.15))
            kit.add(grey, pillow(long * 0.14, beam * 0.85, deep * 0.36, 0.03).at(long * x, 0, level + deep * 0.22))
            for y in (-0.2, 0.2):
                kit.add(BLACK, rod((long * x, y * beam, level + deep * 0.26), (long * (x + s * 0.22), y * beam, level + deep * 0.32), 0.01 * long))
    else:
        for x in (-0.45, 0.0, 0.42):
            kit.add(deck, box(long * 0.12, beam * 1.7 * (1 - 0.25 * abs(x)), 0.02 * long, 0.004).at(long * x, 0, deep * 0.9))
        if kit.chance("oars", 0.7):
            for s in (-1, 1):
                oar = tube([(0, 0, 0), (0, s * beam * 2.3, -deep * 0.55)], 0.012 * long, 6)
                blade = box(0.07 * long, 0.28 * long, 0.012 * long, 0.003).turned("x", -s * 14).at(0, s * beam * 2.35, -deep * 0.57)
                kit.add(deck, oar.at(long * 0.15, 0, deep * 1.12), blade.at(long * 0.15, 0, deep * 1.12))


FAMILIES: dict[str, Callable[[Kit], None]] = {
    "plane": plane,
    "bench": bench,
    "cabinet": cabinet,
    "car": car,
    "chair": chair,
    "monitor": monitor,
    "lamp": lamp,
    "speaker": speaker,
    "firearm": firearm,
    "couch": couch,
    "table": table,
    "cellphone": cellphone,
    "watercraft": watercraft,
}
"""The families, in the order of the paper's table."""

CATEGORIES = tuple(FAMILIES)


def generate(category: str, seed: int, *, hidden_seed: int | None = None) -> Model:
    """A model of a category, in the project's frame, its front toward +x.

    Args:
      category: one of `CATEGORIES`.
      seed: of everything that can be seen, at least 0; the same seed gives the same model.
      hidden_seed: of what cannot be seen; None = `seed`.

    Returns:
      A normalised model named `<category>-<seed>`, `-h<hidden_seed>` appended where one is given,
      with every parameter in `parameters`: see this module's docstring for the hidden ones.

    Raises:
      ValueError: there is no such category, or a seed is negative.
    """
    if category not in FAMILIES:
        raise ValueError(f"category {category!r}: expected one of {list(CATEGORIES)}")
    for name, value in (("seed", seed), ("hidden_seed", hidden_seed)):
        if value is not None and value < 0:
            raise ValueError(f"{name}: got {value}, expected 0 or more")
    number = CATEGORIES.index(category)
    inner = seed if hidden_seed is None else hidden_seed
    kit = Kit(
        np.random.default_rng([_VISIBLE, number, seed]),
        np.random.default_rng([_HIDDEN, number, inner]),
    )
    FAMILIES[category](kit)
    name = f"{category}-{seed}" + ("" if hidden_seed is None else f"-h{hidden_seed}")
    return kit.model(category, name, {"seed": seed, "hidden_seed": inner})
