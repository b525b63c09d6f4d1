"""The builder of procedural models, and common shapes.

The usual materials of `families.materials` can be imported from here as well.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.mapping import Tiled, UVMapping
from data_gen.catalogues.families.materials import (
    BLACK,
    CHROME,
    DARK_GLASS,
    GLASS,
    GOLD,
    LIGHT,
    RED_LIGHT,
    RUBBER,
    WHITE,
    TexturedMaterial,
    fabric,
    lacquer,
    metal,
    paint,
    pick,
    plastic,
    screen,
    shade_of,
    wood,
)
from data_gen.catalogues.solids import Solid
from data_gen.frame import normalize
from data_gen.mesh import Material, Model, build_model

__all__ = [
    "BLACK",
    "CHROME",
    "DARK_GLASS",
    "EVERYWHERE",
    "GLASS",
    "GOLD",
    "LIGHT",
    "RED_LIGHT",
    "RUBBER",
    "WHITE",
    "HiddenRange",
    "Kit",
    "around",
    "case",
    "disc",
    "fabric",
    "lacquer",
    "metal",
    "paint",
    "pick",
    "plastic",
    "rect",
    "screen",
    "shade_of",
    "wood",
]

EVERYWHERE = ((-180.0, 180.0),)


class HiddenRange(NamedTuple):
    """The range [low, high) from which a hidden parameter is drawn uniformly.

    `whole` says whether only whole numbers are drawn.
    """

    low: float
    high: float
    whole: bool = False


class _Part(NamedTuple):
    """A part, the number of its material, and its texture mapping; None = that of the material."""

    solid: Solid
    material: int
    uv: UVMapping | None


class Kit:
    """The builder of a model: its parts and materials, and two random generators.

    Attributes:
      rng: generator of the visible parameters.
      hidden_rng: generator of the hidden parameters.
      visible: visible parameters, which are stored.
      hidden: hidden parameters, which are stored.
      ranges: ranges of the hidden parameters.
      azimuth: azimuths from which they are hidden.

    Args:
      rng: generator of the visible parameters.
      hidden_rng: generator of the hidden parameters.
      given: hidden parameters that are set instead of drawn.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        hidden_rng: np.random.Generator,
        given: Mapping[str, float] | None = None,
    ) -> None:
        self.rng, self.hidden_rng = rng, hidden_rng
        self._given = dict(given or {})
        self.visible: dict[str, Any] = {}
        self.hidden: dict[str, Any] = {}
        self.ranges: dict[str, HiddenRange] = {}
        self.azimuth: tuple[tuple[float, float], ...] = EVERYWHERE
        self._parts: list[_Part] = []
        self._materials: list[Material] = []
        self._named: dict[str, Material] = {}

    def add(self, material: Material, *parts: Solid, uv: UVMapping | None = None) -> None:
        """Adds parts of one material.

        Args:
          material: material of the parts.
          *parts: closed surfaces.
          uv: texture mapping; None = that of the material.
        """
        index = next((i for i, m in enumerate(self._materials) if m is material), None)
        if index is None:
            index = len(self._materials)
            self._materials.append(material)
        self._parts += [_Part(part, index, uv) for part in parts]

    def move_from(self, start: int, y: float) -> None:
        """Moves the parts from number `start` on along y."""
        self._parts[start:] = [p._replace(solid=p.solid.at(y=y)) for p in self._parts[start:]]

    def turn_all(self, axis: str, degrees: float) -> None:
        """Rotates all parts so far; see `Solid.turned`."""
        self._parts = [p._replace(solid=p.solid.turned(axis, degrees)) for p in self._parts]

    def take(self, other: "Kit", place: Callable[[Solid], Solid]) -> None:
        """Adds the parts of another model, each mapped by `place`."""
        for part in other._parts:
            self.add(other._materials[part.material], place(part.solid), uv=part.uv)

    def solids(self) -> tuple[Solid, ...]:
        """The parts so far."""
        return tuple(part.solid for part in self._parts)

    def paint_all(self, material: Material) -> None:
        """Replaces the materials of all parts so far."""
        self._materials = [material]
        self._parts = [part._replace(material=0) for part in self._parts]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The smallest and the largest coordinates so far."""
        corners = [f(p.solid.vertices, axis=0) for f in (np.min, np.max) for p in self._parts]
        half = len(self._parts)
        return np.min(corners[:half], axis=0), np.max(corners[half:], axis=0)

    def once(self, name: str, make: Callable[[np.random.Generator], Material]) -> Material:
        """A material that is drawn at the first call with this name and reused at later calls."""
        if name not in self._named:
            self._named[name] = make(self.rng)
        return self._named[name]

    @property
    def num_faces(self) -> int:
        """Number of triangles so far."""
        return sum(len(part.solid.faces) for part in self._parts)

    @property
    def num_parts(self) -> int:
        """Number of parts so far."""
        return len(self._parts)

    def both(self, material: Material, *parts: Solid, uv: UVMapping | None = None) -> None:
        """Adds parts and their mirror images (y to -y)."""
        self.add(material, *parts, *(part.mirrored() for part in parts), uv=uv)

    def uniform(self, name: str, low: float, high: float) -> float:
        """Draws a visible parameter and stores it."""
        self.visible[name] = float(self.rng.uniform(low, high))
        return self.visible[name]

    def choose(self, name: str, *choices: Any) -> Any:
        """Draws a visible parameter from choices and stores it."""
        self.visible[name] = pick(self.rng, choices)
        return self.visible[name]

    def chance(self, name: str, probability: float) -> bool:
        """Draws a visible boolean parameter and stores it."""
        self.visible[name] = bool(self.rng.random() < probability)
        return self.visible[name]

    def build_subtype(
        self, kinds: Mapping[str, Callable[["Kit"], None]], weights: Mapping[str, int] | None = None
    ) -> None:
        """Draws the visible parameter `subtype` and adds the parts of that subtype.

        Args:
          kinds: for each subtype the function that adds its parts.
          weights: relative probabilities of some subtypes; the others have 1.
        """
        names = [name for name in kinds for _ in range((weights or {}).get(name, 1))]
        kinds[self.choose("subtype", *names)](self)

    def hide(self, name: str, low: float, high: float) -> float:
        """Draws a hidden parameter and stores it."""
        drawn = float(self.hidden_rng.uniform(low, high))
        return float(self._hide(name, HiddenRange(low, high), drawn))

    def hide_count(self, name: str, high: int) -> int:
        """Draws a hidden whole number from 0 to `high` - 1 and stores it."""
        drawn = int(self.hidden_rng.integers(high))
        return int(self._hide(name, HiddenRange(0, high, True), drawn))

    def _hide(self, name: str, span: HiddenRange, drawn: float) -> float:
        value = self._given.get(name, drawn)
        if not span.low <= value <= span.high or (
            span.whole and not (value == int(value) < span.high)
        ):
            kind = "a whole number" if span.whole else "a number"
            below = " (exclusive)" if span.whole else ""
            raise ValueError(
                f"hidden {name}: got {value}, expected {kind} from {span.low:g} to "
                f"{span.high:g}{below}"
            )
        self.ranges[name] = span
        self.hidden[name] = int(value) if span.whole else float(value)
        return value

    def model(self, category: str, model_id: str, parameters: dict[str, Any]) -> Model:
        """The finished model, normalised."""
        sizes = np.cumsum([0, *(len(part.solid.vertices) for part in self._parts)])
        starts = sizes[:-1]
        vertices = np.concatenate([part.solid.vertices for part in self._parts])
        faces = np.concatenate(
            [part.solid.faces + start for part, start in zip(self._parts, starts, strict=True)]
        )
        part_of = np.repeat(np.arange(len(starts)), [len(part.solid.faces) for part in self._parts])
        model = build_model(
            vertices,
            faces,
            materials=self._materials,
            face_material=np.array([part.material for part in self._parts])[part_of],
            uv=self._texture_coordinates(vertices, faces, starts, part_of),
            category=category,
            model_id=model_id,
            parameters={
                **parameters,
                **self.visible,
                "hidden": self.hidden,
                "hidden_azimuth": self.azimuth,
            },
        )
        # Caps with collinear points have triangles without area; no warning is needed.
        return dataclasses.replace(normalize(model), warnings=())

    def _texture_coordinates(
        self, vertices: np.ndarray, faces: np.ndarray, starts: np.ndarray, part_of: np.ndarray
    ) -> np.ndarray | None:
        """Texture coordinates [F, 3, 2] of all corners; None if no material has a texture."""
        if all(m.texture is None for m in self._materials):
            return None
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        placed = vertices - [*((low + high) / 2)[:2], low[2]]
        placed /= np.linalg.norm(placed, axis=1).max()
        box = np.stack([f.reduceat(placed, starts, axis=0) for f in (np.minimum, np.maximum)])
        corners = placed[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        groups: dict[UVMapping, list[int]] = {}
        for number, part in enumerate(self._parts):
            material = self._materials[part.material]
            if material.texture is not None:
                own = material.mapping if isinstance(material, TexturedMaterial) else Tiled()
                groups.setdefault(part.uv or own, []).append(number)
        result = np.zeros((len(faces), 3, 2), np.float32)
        for mapping, numbers in groups.items():
            here = np.flatnonzero(np.isin(part_of, numbers))
            result[here] = mapping(corners[here], normals[here], *box[:, part_of[here]])
        return result


def rect(x: float, y: float, radius: float = 0.0) -> Callable[[float], np.ndarray]:
    """A rectangular outline for `solids.tray`."""

    def outline(inward: float) -> np.ndarray:
        return solids.rounded(x - 2 * inward, y - 2 * inward, max(radius - inward, 0.004), 3)

    return outline


def disc(radius: float, sides: int = 32) -> Callable[[float], np.ndarray]:
    """A round outline for `solids.tray`."""
    angle = np.arange(sides) / sides * 2 * np.pi
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return lambda inward: circle * (radius - inward)


def around(count: int, start: float = 0.0) -> np.ndarray:
    """`count` directions around the circle, in degrees."""
    return start + np.arange(count) / count * 360


def case(depth: float, width: float, height: float, wall: float, back: float) -> Solid:
    """A case on z = 0 with a recess in its back.

    Args:
      depth: length along x, centred at 0.
      width: length along y.
      height: length along z.
      wall: thickness of the walls around the recess.
      back: depth of the recess.
    """
    outline = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * 0.5

    def ring(x: float, inward: float) -> np.ndarray:
        size = np.array([width - 2 * inward, height - 2 * inward])
        return np.column_stack([np.full(4, x), outline * size])

    rear, front, bevel = -depth / 2, depth / 2, 0.004
    rings = [
        ring(rear + max(back, 0.002), wall),
        ring(rear, wall),
        ring(rear, 0),
        ring(front - bevel, 0),
        ring(front, bevel),
    ]
    return solids.loft(rings).at(z=height / 2)
