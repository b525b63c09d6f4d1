"""Mean shapes under CD and EMD: `python -m psgn_jax.experiments.mean_shape [--out DIR]`.

If an image allows several shapes S, a network trained with a distance L tends to predict the mean
shape of that distance,

    x* = argmin over x of E_S[L(x, S)].

This study computes x* by stochastic gradient descent for four distributions of 2D shapes: a circle
of random radius; a spiky arc at a random position on the diagonal; a bar with a square at one of
its four corners; a bar with a disk above it, present with probability 1/2. It writes
`mean_shape.png` (shapes in grey, mean shapes in red) and `mean_shape.json` with the numbers that
the command prints.

Source: Fan, Su, Guibas, CVPR 2017, section 4.3 and its figure on mean shapes, which give pictures
but no numbers. Sizes and measures here are **ours**. Lengths are in a unit of which the drawings
are 1.2 wide.
"""

import json
import pathlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from absl import app, flags, logging
from PIL import Image, ImageDraw, ImageFont

from psgn_jax import losses
from psgn_jax.command_line import exit_on_user_error, log_to_terminal, parse_flags
from psgn_jax.config import ConfigError
from psgn_jax.files import write_atomic
from psgn_jax.types import Array, Float, PRNGKey

Plane = Float[Array, "n 2"]

RADII = (0.2, 0.45)
PLACES = (-0.25, 0.25)
BAR = (0.4, 0.06)  # half of the width and of the height
SIDE = 0.14  # side of the square
DISK, DISK_CENTRE = 0.1, (0.0, 0.26)  # radius and centre
# A point counts as outside a shape beyond this distance, which is a quarter of the bar's height.
NEAR = 0.03


def _uniform(key: PRNGKey, n: int, low: Sequence[float], high: Sequence[float]) -> Plane:
    shape = (n, len(low))
    return jax.random.uniform(key, shape, minval=jnp.array([low]), maxval=jnp.array([high]))


def circle(key: PRNGKey, n: int) -> Plane:
    """Samples n points of a circle about the origin; the radius is uniform in `RADII`."""
    of_radius, of_points = jax.random.split(key)
    radius = jax.random.uniform(of_radius, (), minval=RADII[0], maxval=RADII[1])
    angle = 2 * jnp.pi * jax.random.uniform(of_points, (n,))
    return radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)


def arc_at(angle: Array) -> Array:
    """Points of the spiky arc about the origin: a quarter circle whose radius has five spikes."""
    tooth = 5 * (angle / (jnp.pi / 2)) % 1
    radius = 0.22 + 0.08 * (1 - jnp.abs(2 * tooth - 1))
    return radius[:, None] * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)


def arc(key: PRNGKey, n: int) -> Plane:
    """Samples n points of the spiky arc, shifted diagonally by a number uniform in `PLACES`."""
    of_place, of_points = jax.random.split(key)
    place = jax.random.uniform(of_place, (), minval=PLACES[0], maxval=PLACES[1])
    return arc_at(jnp.pi / 2 * jax.random.uniform(of_points, (n,))) + place


def _attached(key: PRNGKey, n: int, part: Callable[[PRNGKey], Plane], area: float) -> Plane:
    """Samples n points, uniform over the bar and a part of the given area."""
    of_bar, of_part, of_choice = jax.random.split(key, 3)
    share = area / (area + 4 * BAR[0] * BAR[1])
    chosen = jax.random.uniform(of_choice, (n, 1)) < share
    low, high = (-BAR[0], -BAR[1]), BAR
    return jnp.where(chosen, part(of_part), _uniform(of_bar, n, low, high))


def corners() -> np.ndarray:
    """Centres [4, 2] of the squares at the corners of the bar, outside the bar."""
    x, y = BAR[0] - SIDE / 2, BAR[1] + SIDE / 2
    return np.array([[-x, -y], [-x, y], [x, -y], [x, y]], np.float32)


def bar_with_square(key: PRNGKey, n: int) -> Plane:
    """Samples n points, uniform over the bar and a square at one of its corners."""
    of_corner, of_points = jax.random.split(key)
    centre = jnp.asarray(corners())[jax.random.randint(of_corner, (), 0, 4)]
    half = (SIDE / 2, SIDE / 2)

    def square(key: PRNGKey) -> Plane:
        return centre[None] + _uniform(key, n, (-half[0], -half[1]), half)

    return _attached(of_points, n, square, SIDE**2)


def bar_with_disk(key: PRNGKey, n: int) -> Plane:
    """Samples n points, uniform over the bar and, with probability 1/2, a disk above it."""
    of_presence, of_points = jax.random.split(key)

    def disk(key: PRNGKey) -> Plane:
        of_radius, of_angle = jax.random.split(key)
        radius = DISK * jnp.sqrt(jax.random.uniform(of_radius, (n,)))
        angle = 2 * jnp.pi * jax.random.uniform(of_angle, (n,))
        offset = radius[:, None] * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
        return jnp.array([DISK_CENTRE]) + offset

    with_disk = _attached(of_points, n, disk, float(np.pi) * DISK**2)
    alone = _uniform(of_points, n, (-BAR[0], -BAR[1]), BAR)
    return jnp.where(jax.random.bernoulli(of_presence), with_disk, alone)


def _outside_box(points: np.ndarray, centre: Sequence[float], half: Sequence[float]) -> np.ndarray:
    """Distance [n] of points from a filled box."""
    excess = np.maximum(np.abs(points - np.asarray(centre)) - np.asarray(half), 0)
    return np.linalg.norm(excess, axis=1)


def measure_circle(mean: np.ndarray) -> dict[str, float]:
    """Mean (E[r] = .325) and standard deviation (0 for a circle) of the radius of the points."""
    radius = np.linalg.norm(mean, axis=1)
    return {"mean radius": float(radius.mean()), "spread of the radius": float(radius.std())}


def measure_arc(mean: np.ndarray) -> dict[str, float]:
    """Distance of the points from the arc at its mean position; small if the shape is preserved."""
    curve = np.asarray(arc_at(jnp.linspace(0, jnp.pi / 2, 2001)))
    distance = np.linalg.norm(mean[:, None] - curve[None], axis=-1).min(axis=1)
    return {
        "rms distance from the mean arc": float(np.sqrt(np.mean(distance**2))),
        "points farther than .03 from it [%]": float(100 * np.mean(distance > NEAR)),
    }


def _measure_parts(mean: np.ndarray, to_parts: np.ndarray, name: str) -> dict[str, float]:
    to_bar = _outside_box(mean, (0, 0), BAR)
    nearest = np.minimum(to_bar, to_parts)
    return {
        "points outside the bar [%]": float(100 * np.mean(to_bar > NEAR)),
        f"of them inside a {name} [%]": float(
            100 * np.mean(to_parts[to_bar > NEAR] == 0) if (to_bar > NEAR).any() else 0
        ),
        "points in no shape at all [%]": float(100 * np.mean(nearest > NEAR)),
    }


def measure_squares(mean: np.ndarray) -> dict[str, float]:
    """Percentages of points outside the bar, inside a square, and in no possible shape."""
    half = (SIDE / 2, SIDE / 2)
    to_parts = np.min([_outside_box(mean, centre, half) for centre in corners().tolist()], axis=0)
    return _measure_parts(mean, to_parts, "square")


def measure_disk(mean: np.ndarray) -> dict[str, float]:
    """The measures of `measure_squares` for the disk, which has 24.7 % of the points if present."""
    distance = np.linalg.norm(mean - np.asarray(DISK_CENTRE), axis=1)
    return _measure_parts(mean, np.maximum(distance - DISK, 0), "disk")


class Distribution(NamedTuple):
    """A distribution of shapes and the measures of its mean shape."""

    name: str
    draw: Callable[[PRNGKey, int], Plane]
    measure: Callable[[np.ndarray], dict[str, float]]


DISTRIBUTIONS = (
    Distribution("circle of random radius", circle, measure_circle),
    Distribution("spiky arc on the diagonal", arc, measure_arc),
    Distribution("bar, square at a corner", bar_with_square, measure_squares),
    Distribution("bar, disk half of the time", bar_with_disk, measure_disk),
)
DISTANCES: Mapping[str, Callable[..., Array]] = {
    "EMD": losses.emd_mean,
    "CD": losses.chamfer_sq_mean,
}


def mean_shape(
    distance: Callable[..., Array],
    draw: Callable[[PRNGKey, int], Plane],
    key: PRNGKey,
    *,
    num_points: int,
    steps: int,
    shapes: int = 8,
    learning_rate: float = 0.01,
) -> Plane:
    """Minimises E_S[distance(x, S)] over x [n, 2] by Adam with a decreasing learning rate.

    Args:
      distance: distance of two clouds [n, 3].
      draw: maps (key, n) to the n points of a random shape.
      key: random key of the shapes and of the start, a normal cloud of standard deviation .1.
      num_points: n, the number of points of the mean shape and of each shape.
      steps: number of steps.
      shapes: number of random shapes per step.
      learning_rate: of the first step, in units; a cosine schedule reduces it to a hundredth.
    """
    rate = optax.cosine_decay_schedule(learning_rate, steps, alpha=0.01)
    tx = optax.adam(rate)
    start = 0.1 * jax.random.normal(jax.random.fold_in(key, steps), (num_points, 2))

    def in_space(plane: Array) -> Array:
        return jnp.pad(plane, ((0, 0), (0, 1)))

    def objective(x: Array, clouds: Array) -> Array:
        repeated = jnp.broadcast_to(in_space(x)[None], (shapes, num_points, 3))
        return losses.map_pairs(distance)(repeated, clouds).mean()

    def step(carry: tuple[Array, optax.OptState], number: Array) -> tuple[tuple, None]:
        x, opt_state = carry
        keys = jax.random.split(jax.random.fold_in(key, number), shapes)
        clouds = jax.vmap(lambda k: in_space(draw(k, num_points)))(keys)
        updates, opt_state = tx.update(jax.grad(objective)(x, clouds), opt_state)
        return (optax.apply_updates(x, updates), opt_state), None

    @jax.jit
    def descend(x: Array) -> Array:
        (x, _), _ = jax.lax.scan(step, (x, tx.init(x)), jnp.arange(steps))
        return x

    return descend(start)


def study(num_points: int = 256, steps: int = 400, seed: int = 0) -> dict[str, dict]:
    """Computes all mean shapes.

    Returns:
      {distribution: {"EMD" or "CD": {"points": [n, 2], "measures": {name: number}}}}.
    """
    results: dict[str, dict] = {}
    for row, (name, draw, measure) in enumerate(DISTRIBUTIONS):
        key = jax.random.fold_in(jax.random.key(seed), row)
        results[name] = {}
        for label, distance in DISTANCES.items():
            mean = mean_shape(distance, draw, key, num_points=num_points, steps=steps)
            points = np.asarray(mean)
            results[name][label] = {"points": points, "measures": measure(points)}
            logging.info("%s, %s: done", name, label)
    return results


def table(results: Mapping[str, dict]) -> str:
    """The measures as text."""
    lines = [f"{'':46}{'EMD':>8}{'CD':>8}"]
    for name, entries in results.items():
        lines.append(name)
        for measure, value in entries["EMD"]["measures"].items():
            other = entries["CD"]["measures"][measure]
            lines.append(f"  {measure:44}{value:8.3g}{other:8.3g}")
    return "\n".join(lines) + "\n"


def figure(results: Mapping[str, dict], size: int = 300, shapes: int = 5) -> Image.Image:
    """Draws a column per distribution: random shapes, mean shape for EMD, mean shape for CD."""
    scale, margin = 2, 16  # drawn at twice the size, for antialiasing
    font = ImageFont.load_default(size=15)

    def dots(
        panel: Image.Image, points: np.ndarray, colour: tuple[int, ...], radius: float
    ) -> None:
        pen = ImageDraw.Draw(panel)
        for x, y in (points * [1, -1] + 0.6) / 1.2 * size * scale:
            r = radius * scale
            pen.ellipse((x - r, y - r, x + r, y + r), fill=colour)

    columns = []
    for row, (name, entries) in enumerate(results.items()):
        draw = DISTRIBUTIONS[row].draw
        keys = jax.random.split(jax.random.key(row), 60)
        clouds = np.asarray(jax.vmap(lambda k, draw=draw: draw(k, 400))(keys))
        panels = []
        for label in ("shapes", "EMD", "CD"):
            panel = Image.new("RGB", (size * scale, size * scale), "white")
            if label == "shapes":
                for number, cloud in enumerate(clouds[:shapes]):
                    shade = 40 + 150 * number // max(1, shapes - 1)
                    dots(panel, cloud, (shade, shade, shade), 1.0)
            else:
                for cloud in clouds:
                    dots(panel, cloud[:120], (222, 222, 222), 1.0)
                dots(panel, entries[label]["points"], (205, 30, 30), 2.2)
            panels.append(panel.resize((size, size), Image.Resampling.LANCZOS))
            title = name if label == "shapes" else f"mean shape, {label}"
            ImageDraw.Draw(panels[-1]).text((6, 4), title, fill="black", font=font)
        columns.append(panels)
    step = size + margin
    sheet = Image.new("RGB", (step * len(columns) - margin, step * 3 - margin), "white")
    for column, panels in enumerate(columns):
        for row, panel in enumerate(panels):
            sheet.paste(panel, (column * step, row * step))
    return sheet


def run(out: str | pathlib.Path, num_points: int = 256, steps: int = 400, seed: int = 0) -> str:
    """Runs the study; writes the figure and the numbers to `out` and returns the table."""
    out = pathlib.Path(out)
    out.mkdir(parents=True, exist_ok=True)
    results = study(num_points, steps, seed)
    figure(results).save(out / "mean_shape.png")
    numbers = {
        name: {label: entry["measures"] for label, entry in entries.items()}
        for name, entries in results.items()
    }
    document = {"num_points": num_points, "steps": steps, "seed": seed, "measures": numbers}
    write_atomic(out / "mean_shape.json", json.dumps(document, indent=2) + "\n")
    return table(results)


def _main(argv: Sequence[str]) -> None:
    log_to_terminal()
    values = flags.FLAGS
    with exit_on_user_error():
        if len(argv) > 1:
            raise ConfigError(f"unexpected argument {argv[1]!r}")
        text = run(values.out, values.points, values.steps, values.seed)
    sys.stdout.write(text)


if __name__ == "__main__":
    flags.DEFINE_string("out", "runs/mean_shape", "Folder for the figure and the numbers.")
    flags.DEFINE_integer("points", 256, "Points of a cloud.", lower_bound=1)
    flags.DEFINE_integer("steps", 400, "Steps of descent.", lower_bound=1)
    flags.DEFINE_integer("seed", 0, "Seed of shapes and starts.")
    app.run(_main, flags_parser=parse_flags)
