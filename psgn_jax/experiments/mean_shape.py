"""Mean shapes under CD and EMD: `python -m psgn_jax.experiments.mean_shape [--out DIR]`.

Where an image leaves a shape S in doubt, a network trained on a distance L tends to the cloud

    x* = argmin over x of E_S[L(x, S)],

the mean shape of that distance. Here x* is found by stochastic gradient descent for four
distributions of plane shapes: a circle of random radius; a spiky arc at a random place on the
diagonal; a bar with a square at one of its four corners; a bar with a disk beside it half of the
time. Written are `mean_shape.png` (shapes in grey, the mean shapes in red) and `mean_shape.json`
with the numbers that the command prints.

Source: Fan, Su, Guibas, CVPR 2017, section 4.3 and its figure on mean shapes, which show the clouds
and no numbers; sizes and measures here are **ours**. The unit is that of the drawings, 1.2 wide.
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
BAR = (0.4, 0.06)  # half sizes
SIDE = 0.14  # of the square
DISK, DISK_CENTRE = 0.1, (0.0, 0.26)
# Beyond this distance from a shape a point counts as outside: half the width of the bar's end.
NEAR = 0.03


def _uniform(key: PRNGKey, n: int, low: Sequence[float], high: Sequence[float]) -> Plane:
    shape = (n, len(low))
    return jax.random.uniform(key, shape, minval=jnp.array([low]), maxval=jnp.array([high]))


def circle(key: PRNGKey, n: int) -> Plane:
    """A circle about the origin, n points; the radius is uniform in `RADII`."""
    of_radius, of_points = jax.random.split(key)
    radius = jax.random.uniform(of_radius, (), minval=RADII[0], maxval=RADII[1])
    angle = 2 * jnp.pi * jax.random.uniform(of_points, (n,))
    return radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)


def arc_at(angle: Array) -> Array:
    """The spiky arc about the origin: a quarter circle whose radius has five spikes."""
    tooth = 5 * (angle / (jnp.pi / 2)) % 1
    radius = 0.22 + 0.08 * (1 - jnp.abs(2 * tooth - 1))
    return radius[:, None] * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)


def arc(key: PRNGKey, n: int) -> Plane:
    """The spiky arc, n points, moved along the diagonal to a place uniform in `PLACES`."""
    of_place, of_points = jax.random.split(key)
    place = jax.random.uniform(of_place, (), minval=PLACES[0], maxval=PLACES[1])
    return arc_at(jnp.pi / 2 * jax.random.uniform(of_points, (n,))) + place


def _attached(key: PRNGKey, n: int, part: Callable[[PRNGKey], Plane], area: float) -> Plane:
    """Points uniform over the bar and a part of the given area."""
    of_bar, of_part, of_choice = jax.random.split(key, 3)
    share = area / (area + 4 * BAR[0] * BAR[1])
    chosen = jax.random.uniform(of_choice, (n, 1)) < share
    low, high = (-BAR[0], -BAR[1]), BAR
    return jnp.where(chosen, part(of_part), _uniform(of_bar, n, low, high))


def corners() -> np.ndarray:
    """Centres [4, 2] of the squares at the bar's corners, outside the bar."""
    x, y = BAR[0] - SIDE / 2, BAR[1] + SIDE / 2
    return np.array([[-x, -y], [-x, y], [x, -y], [x, y]], np.float32)


def bar_with_square(key: PRNGKey, n: int) -> Plane:
    """The bar and a square at one of its corners, n points uniform over both."""
    of_corner, of_points = jax.random.split(key)
    centre = jnp.asarray(corners())[jax.random.randint(of_corner, (), 0, 4)]
    half = (SIDE / 2, SIDE / 2)

    def square(key: PRNGKey) -> Plane:
        return centre[None] + _uniform(key, n, (-half[0], -half[1]), half)

    return _attached(of_points, n, square, SIDE**2)


def bar_with_disk(key: PRNGKey, n: int) -> Plane:
    """The bar and, with probability 1/2, a disk above it, n points uniform over all."""
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
    """Distance [n] to a filled box."""
    excess = np.maximum(np.abs(points - np.asarray(centre)) - np.asarray(half), 0)
    return np.linalg.norm(excess, axis=1)


def measure_circle(mean: np.ndarray) -> dict[str, float]:
    """Radius of the points: its mean (E[r] = .325) and its spread, 0 for a circle."""
    radius = np.linalg.norm(mean, axis=1)
    return {"mean radius": float(radius.mean()), "spread of the radius": float(radius.std())}


def measure_arc(mean: np.ndarray) -> dict[str, float]:
    """Distance of the points from the arc at its mean place: small where the shape is kept."""
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
    """Shares of points outside the bar, inside a square, and in no shape of the distribution."""
    half = (SIDE / 2, SIDE / 2)
    to_parts = np.min([_outside_box(mean, centre, half) for centre in corners().tolist()], axis=0)
    return _measure_parts(mean, to_parts, "square")


def measure_disk(mean: np.ndarray) -> dict[str, float]:
    """As `measure_squares`, for the disk; its points are 24.7 % of a shape that has it."""
    distance = np.linalg.norm(mean - np.asarray(DISK_CENTRE), axis=1)
    return _measure_parts(mean, np.maximum(distance - DISK, 0), "disk")


class Distribution(NamedTuple):
    """A random shape and what to measure of a mean shape."""

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
    """The minimiser x [n, 2] of E_S[distance(x, S)], by Adam with a falling learning rate.

    Args:
      distance: of two clouds [n, 3].
      draw: (key, n) to the n points of a random shape.
      key: of the shapes and of the start, a normal cloud of deviation .1.
      num_points: n, of the mean shape and of each shape.
      steps: of descent.
      shapes: drawn for each step.
      learning_rate: of the first step, in units; half a cosine down to a hundredth.
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
    """{distribution: {"EMD" or "CD": {"points": [n, 2], "measures": {name: number}}}}."""
    results: dict[str, dict] = {}
    for row, (name, draw, measure) in enumerate(DISTRIBUTIONS):
        key = jax.random.fold_in(jax.random.key(seed), row)
        results[name] = {}
        for label, distance in DISTANCES.items():
            found = mean_shape(distance, draw, key, num_points=num_points, steps=steps)
            points = np.asarray(found)
            results[name][label] = {"points": points, "measures": measure(points)}
            logging.info("%s, %s: done", name, label)
    return results


def table(results: Mapping[str, dict]) -> str:
    """The measures as text."""
    lines = [f"{'':46}{'EMD':>8}{'CD':>8}"]
    for name, found in results.items():
        lines.append(name)
        for measure, value in found["EMD"]["measures"].items():
            other = found["CD"]["measures"][measure]
            lines.append(f"  {measure:44}{value:8.3g}{other:8.3g}")
    return "\n".join(lines) + "\n"


def figure(results: Mapping[str, dict], size: int = 300, shapes: int = 5) -> Image.Image:
    """A column per distribution: random shapes, the mean shape under EMD, that under CD."""
    scale, margin = 2, 16  # drawn larger, then reduced: smooth dots
    font = ImageFont.load_default(size=15)

    def dots(
        panel: Image.Image, points: np.ndarray, colour: tuple[int, ...], radius: float
    ) -> None:
        pen = ImageDraw.Draw(panel)
        for x, y in (points * [1, -1] + 0.6) / 1.2 * size * scale:
            r = radius * scale
            pen.ellipse((x - r, y - r, x + r, y + r), fill=colour)

    columns = []
    for row, (name, found) in enumerate(results.items()):
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
                dots(panel, found[label]["points"], (205, 30, 30), 2.2)
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
    """The whole study; writes the figure and the numbers into `out` and returns the table."""
    out = pathlib.Path(out)
    out.mkdir(parents=True, exist_ok=True)
    results = study(num_points, steps, seed)
    figure(results).save(out / "mean_shape.png")
    numbers = {
        name: {label: entry["measures"] for label, entry in found.items()}
        for name, found in results.items()
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
