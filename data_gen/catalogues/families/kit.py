"""What the families are built with: materials, and the model in the making."""

import colorsys
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from data_gen import meshes
from data_gen.catalogues import solids
from data_gen.catalogues.solids import Solid
from data_gen.meshes import Material, Model

EVERYWHERE = ((-180.0, 180.0),)


class HiddenRange(NamedTuple):
    """What a hidden parameter is drawn from, uniformly: [low, high), or whole numbers of it."""

    low: float
    high: float
    whole: bool = False


# --- Materials --------------------------------------------------------------------------------


def shade_of(rgb: Sequence[float], rng: np.random.Generator, spread: float = 0.08) -> Any:
    """A colour a little lighter or darker than given."""
    factor = 1 + rng.uniform(-spread, spread)
    return tuple(float(np.clip(v * factor, 0, 1)) for v in rgb)


def pick(rng: np.random.Generator, choices: Sequence[Any]) -> Any:
    """One of the choices."""
    return choices[int(rng.integers(len(choices)))]


def wood(rng: np.random.Generator) -> Material:
    """Oak, beech, pine, walnut, cherry, ebony."""
    colours = (
        (0.72, 0.53, 0.33),
        (0.82, 0.66, 0.46),
        (0.86, 0.70, 0.47),
        (0.42, 0.27, 0.17),
        (0.55, 0.27, 0.16),
        (0.24, 0.16, 0.12),
        (0.62, 0.42, 0.26),
    )
    return Material(shade_of(pick(rng, colours), rng), (0.12, 0.12, 0.12), 25.0, name="wood")


def metal(rng: np.random.Generator) -> Material:
    """Steel, chrome, black iron, brass, bronze."""
    colours = (
        (0.66, 0.67, 0.69),
        (0.78, 0.79, 0.8),
        (0.2, 0.2, 0.21),
        (0.72, 0.57, 0.27),
        (0.45, 0.33, 0.22),
        (0.36, 0.37, 0.4),
    )
    return Material(shade_of(pick(rng, colours), rng), (0.55, 0.55, 0.55), 60.0, name="metal")


def paint(rng: np.random.Generator) -> Material:
    """Any lively colour, or white, grey, black."""
    if rng.random() < 0.35:
        grey = float(pick(rng, (0.93, 0.85, 0.6, 0.35, 0.14)))
        colour = shade_of((grey, grey, grey), rng, 0.04)
    else:
        colour = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.5, 0.9), rng.uniform(0.45, 0.95))
    return Material(colour, (0.4, 0.4, 0.4), 60.0, name="paint")


def lacquer(rng: np.random.Generator) -> Material:
    """Painted furniture: white, greys, black, muted colours, now and then a lively one."""
    kind = rng.random()
    if kind < 0.5:
        grey = float(pick(rng, (0.93, 0.88, 0.75, 0.5, 0.3, 0.14)))
        colour = shade_of((grey, grey, grey * 0.98), rng, 0.04)
    else:
        saturation = rng.uniform(0.15, 0.45) if kind < 0.85 else rng.uniform(0.5, 0.85)
        colour = colorsys.hsv_to_rgb(rng.random(), saturation, rng.uniform(0.35, 0.85))
    return Material(colour, (0.25, 0.25, 0.25), 40.0, name="lacquer")


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
    return Material(shade_of(pick(rng, colours), rng), (0.2, 0.2, 0.2), 30.0, name="leather")


def plastic(rng: np.random.Generator) -> Material:
    """Housings: black, greys, white, beige."""
    colours = (
        (0.1, 0.1, 0.11),
        (0.2, 0.2, 0.22),
        (0.5, 0.51, 0.53),
        (0.9, 0.9, 0.9),
        (0.82, 0.78, 0.68),
        (0.7, 0.71, 0.73),
    )
    return Material(shade_of(pick(rng, colours), rng), (0.25, 0.25, 0.25), 40.0, name="plastic")


def screen(rng: np.random.Generator) -> Material:
    """A display, off or showing one colour."""
    if rng.random() < 0.5:
        return Material((0.05, 0.06, 0.08), (0.5, 0.5, 0.5), 120.0, name="screen")
    colour = colorsys.hsv_to_rgb(
        rng.uniform(0.45, 0.72), rng.uniform(0.3, 0.8), rng.uniform(0.4, 0.8)
    )
    return Material(colour, (0.3, 0.3, 0.3), 120.0, name="screen")


RUBBER = Material((0.09, 0.09, 0.09), (0.08, 0.08, 0.08), 15.0, name="rubber")
DARK_GLASS = Material((0.1, 0.13, 0.16), (0.6, 0.6, 0.6), 120.0, name="dark glass")
GLASS = Material((0.42, 0.6, 0.6), (0.6, 0.6, 0.6), 120.0, opacity=0.5, name="glass")
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
      ranges: what they are drawn from, each on its own.
      azimuth: where from they are hidden.

    Args:
      rng: of what can be seen.
      hidden_rng: of what cannot.
      given: hidden parameters that are not drawn.
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
        self._parts: list[tuple[Solid, int]] = []
        self._materials: list[Material] = []

    def add(self, material: Material, *parts: Solid) -> None:
        """Adds parts of one material."""
        index = next((i for i, m in enumerate(self._materials) if m is material), None)
        if index is None:
            index = len(self._materials)
            self._materials.append(material)
        self._parts += [(part, index) for part in parts]

    def move_from(self, start: int, y: float) -> None:
        """Moves the parts from number `start` on along y."""
        self._parts[start:] = [(part.at(y=y), index) for part, index in self._parts[start:]]

    @property
    def num_parts(self) -> int:
        """Parts so far."""
        return len(self._parts)

    def both(self, material: Material, *parts: Solid) -> None:
        """Adds parts and their mirror images on the other side."""
        self.add(material, *parts, *(part.mirrored() for part in parts))

    def uniform(self, name: str, low: float, high: float) -> float:
        """Draws a visible parameter and stores it."""
        self.visible[name] = float(self.rng.uniform(low, high))
        return self.visible[name]

    def choose(self, name: str, *choices: Any) -> Any:
        """Draws a visible parameter among choices and stores it."""
        self.visible[name] = pick(self.rng, choices)
        return self.visible[name]

    def chance(self, name: str, probability: float) -> bool:
        """Draws a visible yes or no and stores it."""
        self.visible[name] = bool(self.rng.random() < probability)
        return self.visible[name]

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
            below = " (itself left out)" if span.whole else ""
            raise ValueError(
                f"hidden {name}: got {value}, expected {kind} from {span.low:g} to "
                f"{span.high:g}{below}"
            )
        self.ranges[name] = span
        self.hidden[name] = int(value) if span.whole else float(value)
        return value

    def model(self, category: str, model_id: str, parameters: dict[str, Any]) -> Model:
        """The finished model, normalised."""
        sizes = np.cumsum([0, *(len(part.vertices) for part, _ in self._parts)])
        faces = [
            part.faces + start for (part, _), start in zip(self._parts, sizes[:-1], strict=True)
        ]
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
    """Directions in degrees, evenly around."""
    return start + np.arange(count) / count * 360


def case(depth: float, width: float, height: float, wall: float, back: float) -> Solid:
    """A case on z = 0, solid from the front.

    Args:
      depth: along x, around 0.
      width: along y.
      height: along z.
      wall: thickness of the walls that stand around the hollow at the back.
      back: how far the back panel stands in from behind.
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
