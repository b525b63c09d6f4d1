"""The builder of procedural models, and parts for several families."""
# fmt: off
# We format by hand, because the formatter would put each coordinate in a line.

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from data_gen.catalogues import shapes
from data_gen.catalogues.families import materials as m
from data_gen.catalogues.shapes import Solid, ball, block, box, cylinder, lathe, rod, tube
from data_gen.frame import normalize
from data_gen.mesh import Material, Model, build_model


class Kit:
    """The builder of a model: a random generator, and the parts so far with their materials."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.parts: list[tuple[Solid, Material]] = []

    def add(self, material: Material, *parts: Solid) -> None:
        self.parts += [(part, material) for part in parts]

    def both(self, material: Material, *parts: Solid) -> None:
        """Adds parts and their mirror images (y to -y)."""
        self.add(material, *parts, *(part.scaled(1, -1, 1) for part in parts))

    def four(self, material: Material, *parts: Solid) -> None:
        """Adds parts and their mirror images in x and y."""
        self.both(material, *parts, *(part.scaled(-1, 1, 1) for part in parts))

    def around(self, material: Material, count: int, *parts: Solid, start: float = 0.0) -> None:
        """Adds parts `count` times around the z axis."""
        for angle in start + np.arange(count) * 360 / count:
            self.add(material, *(part.turned("z", angle) for part in parts))

    def change(self, start: int, move: Callable[[Solid], Solid]) -> None:
        """Moves the parts from number `start` on."""
        self.parts[start:] = [(move(part), material) for part, material in self.parts[start:]]

    def uniform(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def choose(self, *choices: Any) -> Any:
        return choices[int(self.rng.integers(len(choices)))]

    def chance(self, probability: float) -> bool:
        return bool(self.rng.random() < probability)

    def draw(self, *materials: Callable[[np.random.Generator], Material]) -> Material:
        """A random material of a random kind."""
        return self.choose(*materials)(self.rng)

    def model(self, parameters: Mapping[str, Any] | None = None) -> Model:
        """The model, normalised."""
        starts = np.cumsum([0, *(len(part.vertices) for part, _ in self.parts)])[:-1]
        vertices = np.concatenate([part.vertices for part, _ in self.parts])
        faces = np.concatenate(
            [part.faces + start for (part, _), start in zip(self.parts, starts, strict=True)])
        materials = list({id(material): material for _, material in self.parts}.values())
        number = {id(material): k for k, material in enumerate(materials)}
        owner = np.array([number[id(material)] for _, material in self.parts])
        part_of = np.repeat(np.arange(len(starts)), [len(part.faces) for part, _ in self.parts])
        uv = texture_coordinates(vertices, faces, starts, part_of, materials, owner)
        model = build_model(vertices, faces, materials=materials, face_material=owner[part_of],
                            uv=uv, parameters=parameters)
        # No warnings of triangles without area, which caps with collinear points have.
        return dataclasses.replace(normalize(model), warnings=())


def texture_coordinates(
    vertices: np.ndarray, faces: np.ndarray, starts: np.ndarray, part_of: np.ndarray,
    materials: Sequence[Material], owner: np.ndarray,
) -> np.ndarray:
    """Texture coordinates [F, 3, 2]: projections along the axis nearest to each normal.

    In front of a face, images are upright and not mirrored. On a face that points up, their bottom
    is toward +x.
    """
    # Relative to the bounding box, which does not depend on hidden parts.
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    scaled = vertices - [*((low + high) / 2)[:2], low[2]]
    scaled /= np.linalg.norm(scaled, axis=1).max()
    low, high = (f.reduceat(scaled, starts, axis=0)[part_of] for f in (np.minimum, np.maximum))
    corners, rows = scaled[faces], np.arange(len(faces))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.argmax(np.abs(normals) * [1, 1.001, 1.002], axis=1)
    tile = np.array([getattr(material, "tile", 1.0) for material in materials])[owner[part_of]]
    covering = (tile == 0)[:, None, None]
    # Textures that cover a part have a margin, so that rounding does not reach the opposite edge.
    fitted = 0.99 * (corners - (low + high)[:, None] / 2) / np.maximum(high - low, 1e-9)[:, None]
    tiled = np.where(covering, fitted, corners / np.where(covering, 1, tile[:, None, None]))
    facing = np.sign(normals[rows, axis])
    u_axis, v_axis = np.array([1, 0, 1])[axis], np.array([2, 2, 0])[axis]
    sign = np.array([1, -1, 1])[axis] * np.where(axis < 2, facing, 1)
    u = tiled[rows, :, u_axis] * sign[:, None]
    v = tiled[rows, :, v_axis] * np.where(axis < 2, 1, -facing)[:, None]
    grain = np.array([getattr(material, "along_grain", False) for material in materials])
    longest = np.argmax((high - low).round(6) * [1, 1, 0.999], axis=1)
    turned = (grain[owner[part_of]] & (v_axis == longest))[:, None]
    result = np.stack([np.where(turned, v, u), np.where(turned, u, v)], axis=2)
    return (result + np.where(covering, 0.5, 0)).astype(np.float32)


LEGS = ("square", "square", "round", "tapered", "turned", "sabre", "hairpin")

_TURNED = ((0.35, 0), (0.5, 0.08), (0.35, 0.16), (0.6, 0.45), (0.4, 0.6), (0.62, 0.66), (0.4, 0.72),
           (0.6, 0.78), (0.6, 1.0))


def four_legs(kit: Kit, material: Material, x: float, y: float, top: float, thick: float,
              style: str = "") -> None:
    """Four legs from z = 0 to `top` below (±x, ±y), some splayed, some with stretchers."""
    style = style or kit.choose(*LEGS)
    splay = kit.choose(0.0, 0.0, kit.uniform(0.02, 0.12)) * top
    head = np.array([x, y, top])
    foot = head + np.array([x, y, 0]) / max(np.hypot(x, y), 1e-9) * splay - [0, 0, top]
    if style == "turned":
        foot = head * [1, 1, 0]
        kit.four(material, lathe([(r * thick * 0.8, z * top) for r, z in _TURNED], 14).at(x, y))
    elif style == "sabre":
        bend = foot * [0.7, 0.7, 1] + head * [0.3, 0.3, 0.45]
        kit.four(material, tube(shapes.smooth_path([foot, bend, head], 4),
                                np.linspace(0.35, 0.6, 9) * thick))
    elif style == "hairpin":
        kit.four(material, rod(foot, head, 0.25 * thick))
    else:
        outline = shapes.superellipse(thick, thick, 2 if style == "round" else 12, 12)
        rings = [np.column_stack([size * outline, 0 * outline[:, 0]]) + end
                 for size, end in ((0.6 if style == "tapered" else 1.0, foot), (1.0, head))]
        kit.four(material, shapes.loft(rings))
    if style != "hairpin" and kit.chance(0.3):
        share = kit.uniform(0.15, 0.4)
        a, b, z = foot * (1 - share) + head * share
        kit.both(material, rod((a, b, z), (-a, b, z), 0.28 * thick))
        kit.add(material, rod((0, b, z), (0, -b, z), 0.28 * thick))


def wheels(kit: Kit, rim: Material, radius: float, width: float, y: float,
           places: Sequence[float]) -> None:
    """Pairs of wheels on z = 0 with their middles at (x, ±y)."""
    w, r = width / 2, radius
    tyre = [(0.6 * r, -w), (0.94 * r, -w), (r, -0.7 * w), (r, 0.7 * w), (0.94 * r, w), (0.6 * r, w)]
    disc = [(0, -1.02 * w), (0.58 * r, -1.04 * w), (0.58 * r, 1.04 * w), (0, 1.02 * w)]
    for x in places:
        kit.both(m.BLACK, lathe(tyre).turned("x", 90).at(x, y, r))
        kit.both(rim, lathe(disc).turned("x", 90).at(x, y, r))
        kit.add(m.BLACK, rod((x, -y, r), (x, y, r), 0.15 * r))


def column(kit: Kit, material: Material, reach: float, top: float, radius: float,
           style: str) -> None:
    """A column to z = `top` on a "disc", on the arms of a "star", or on arms with "casters"."""
    if style == "disc":
        flare = kit.choose(1.0, 1.0, kit.uniform(1.2, 3.0)) * radius
        kit.add(material, lathe([(reach, 0), (reach, 0.015), (0.9 * reach, 0.03), (flare, 0.05),
                                 (radius, 0.3 * top), (radius, 0.7 * top), (flare, top)], 28))
        return
    low, count = 0.06 if style == "casters" else 0.0, kit.choose(4, 5, 5)
    kit.add(material, block((-radius, radius), (-radius, radius), (low + 0.02, top), 0.3 * radius))
    arm = tube([(0, 0, low + 0.08), (0.6 * reach, 0, low + 0.04), (reach, 0, low + 0.02)], 0.02)
    kit.around(material, count, arm)
    if low:
        kit.around(m.BLACK, count, cylinder(0.032, 0.045, 12).turned("x", 90).at(reach, 0, 0.032),
                   rod((reach, 0, 0.03), (reach, 0, 0.09), 0.012))


def fronts(kit: Kit, front: Material, knob: Material, x: float, y: tuple[float, float],
           z: tuple[float, float], columns: int, rows: int) -> None:
    """Drawers or doors with handles, on a face perpendicular to x."""
    wide, high = (y[1] - y[0]) / columns, (z[1] - z[0]) / rows
    style = kit.choose("ball", "bar", "upright", "none")
    inset = kit.chance(0.4) and min(wide, high) > 0.2
    for place in range(columns * rows):
        row, side = divmod(place, columns)
        at = x + 0.025, y[0] + (side + 0.5) * wide, z[0] + (row + 0.5) * high
        kit.add(front, box(0.025, wide - 0.012, high - 0.012, 0.004).at(x + 0.0025, *at[1:]))
        if inset:
            kit.add(front, box(0.012, wide - 0.12, high - 0.12, 0.004).at(x + 0.019, *at[1:]))
        if style == "ball":
            kit.add(knob, ball(0.035, 0.03, 0.03, 10).at(*at))
        elif style == "bar":
            kit.add(knob, box(0.025, min(0.15, 0.5 * wide), 0.012).at(*at))
        elif style == "upright":
            shift = 0.38 * wide * (-1) ** side
            kit.add(knob, box(0.025, 0.012, min(0.2, 0.5 * high)).at(at[0], at[1] + shift, at[2]))
