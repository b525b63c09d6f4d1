"""Mean shapes under CD and EMD: `python -m psgn_jax.experiments.mean_shape [--out DIR]`.

If an image does not determine the shape S, a network trained with a distance L tends to the cloud

    x* = argmin over x of E_S[L(x, S)],

the mean shape of that distance. This study computes x* by stochastic gradient descent for four
distributions of plane shapes: a circle with random radius; a spiky arc at a random position on the
diagonal; a bar with a square at one of its four corners; a bar with a disk above it with
probability 1/2. `mean_shape.png` shows random shapes in grey and the mean shapes in red.

Source: Fan, Su, Guibas, CVPR 2017, section 4.3 and its figure on mean shapes, which show the clouds
and no numbers; sizes and measures here are **ours**. The shapes lie in a square of side 1.2.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from absl import flags, logging

from psgn_jax import losses
from psgn_jax.experiments import common, figures
from psgn_jax.metrics.table import Lines
from psgn_jax.types import Array, Float, PRNGKey

Plane = Float[Array, "n 2"]

RADII = (0.2, 0.45)
PLACES = (-0.25, 0.25)
BAR = (0.4, 0.06)  # half lengths
SIDE = 0.14  # side of the square
DISK, DISK_CENTRE = 0.1, (0.0, 0.26)
# A point farther than this from a shape counts as outside: a quarter of the bar's width.
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
    """The spiky arc, n points, at a position on the diagonal that is uniform in `PLACES`."""
    of_place, of_points = jax.random.split(key)
    place = jax.random.uniform(of_place, (), minval=PLACES[0], maxval=PLACES[1])
    return arc_at(jnp.pi / 2 * jax.random.uniform(of_points, (n,))) + place


def _attached(key: PRNGKey, n: int, part: Callable[[PRNGKey], Plane], area: float) -> Plane:
    """Points uniform on the union of the bar and a part of the given area."""
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
    """The bar and a square at one of its corners; n points uniform on both."""
    of_corner, of_points = jax.random.split(key)
    centre = jnp.asarray(corners())[jax.random.randint(of_corner, (), 0, 4)]
    half = (SIDE / 2, SIDE / 2)

    def square(key: PRNGKey) -> Plane:
        return centre[None] + _uniform(key, n, (-half[0], -half[1]), half)

    return _attached(of_points, n, square, SIDE**2)


def bar_with_disk(key: PRNGKey, n: int) -> Plane:
    """The bar and, with probability 1/2, a disk above it; n points uniform on both."""
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
    """Mean and spread of the points' radius; for the circle of mean radius they are .325 and 0."""
    radius = np.linalg.norm(mean, axis=1)
    return {"mean radius": float(radius.mean()), "spread of the radius": float(radius.std())}


def measure_arc(mean: np.ndarray) -> dict[str, float]:
    """Distance of the points from the arc at its mean position; small if the shape is kept."""
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
    """Like `measure_squares`. Where there is a disk, it has 24.7 % of the points of the shape."""
    distance = np.linalg.norm(mean - np.asarray(DISK_CENTRE), axis=1)
    return _measure_parts(mean, np.maximum(distance - DISK, 0), "disk")


class Distribution(NamedTuple):
    """A random shape, and the measures of its mean shape."""

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
) -> Plane:
    """The minimiser x [n, 2] of E_S[distance(x, S)], by Adam with a falling learning rate.

    The learning rate decays from 0.01 to a hundredth of that along half a cosine.

    Args:
      distance: distance of two clouds [n, 3].
      draw: maps (key, n) to the n points of a random shape.
      key: key of the shapes and of the start, a normal cloud with standard deviation .1.
      num_points: n, for the mean shape and each shape.
      steps: number of descent steps.
      shapes: number of shapes drawn for each step.
    """
    rate = optax.cosine_decay_schedule(0.01, steps, alpha=0.01)
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


def measure(options: Any) -> tuple[dict[str, Any], dict[str, dict[str, np.ndarray]]]:
    """The measures of each mean shape, and the mean shapes [n, 2]."""
    measures: dict[str, dict[str, dict[str, float]]] = {}
    points: dict[str, dict[str, np.ndarray]] = {}
    for row, (name, draw, measure_of) in enumerate(DISTRIBUTIONS):
        key = jax.random.fold_in(jax.random.key(options.seed), row)
        points[name] = {
            label: np.asarray(
                mean_shape(distance, draw, key, num_points=options.points, steps=options.steps)
            )
            for label, distance in DISTANCES.items()
        }
        measures[name] = {label: measure_of(cloud) for label, cloud in points[name].items()}
        logging.info("%s: done", name)
    return {"measures": measures}, points


def table(numbers: Mapping[str, Any]) -> list[Lines]:
    """A row for each measure of each distribution."""
    lines = [["distribution", "measure", *DISTANCES]]
    for name, measures in numbers["measures"].items():
        for key in measures["EMD"]:
            lines.append([name, key, *(f"{measures[label][key]:.3g}" for label in DISTANCES)])
    return [lines]


def figure(_: Any, points: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, Any]:
    """A column for each distribution: random shapes, the mean shapes under EMD and CD."""
    draws = {name: draw for name, draw, _ in DISTRIBUTIONS}
    sheet = figures.blank(300 * len(points), 930)
    axes = sheet.subplots(3, len(points), squeeze=False)
    for column, (name, means) in enumerate(points.items()):
        keys = jax.random.split(jax.random.key(column), 60)
        clouds = np.asarray(jax.vmap(lambda k, draw=draws[name]: draw(k, 400))(keys))
        for cloud, grey in zip(clouds[:5], np.linspace(0.15, 0.75, 5), strict=True):
            axes[0, column].scatter(*cloud.T, s=2, color=str(grey))
        axes[0, column].set_title(name, fontsize=11)
        for row, (label, mean) in enumerate(means.items(), start=1):
            axes[row, column].scatter(*clouds[:, :120].reshape(-1, 2).T, s=2, color="0.87")
            axes[row, column].scatter(*mean.T, s=10, color="#cd1e1e")
            axes[row, column].set_title(f"mean shape, {label}", fontsize=11)
    for ax in axes.flat:
        ax.set(xlim=(-0.6, 0.6), ylim=(-0.6, 0.6), aspect="equal", xticks=[], yticks=[])
        ax.spines[:].set_color("0.9")
    return {"mean_shape": sheet}


STUDY = common.Study(
    "mean_shape",
    lambda _: (),
    measure,
    table,
    figure,
    options={"points": 256, "steps": 400, "seed": 0},
    note="Unit of lengths: the shapes lie in a square of side 1.2.",
)

if __name__ == "__main__":
    flags.DEFINE_string("workdir", "runs/mean_shape", "Folder of the results.")
    flags.DEFINE_alias("out", "workdir")
    flags.DEFINE_integer("points", 256, "Points of a cloud.", lower_bound=1)
    flags.DEFINE_integer("steps", 400, "Steps of descent.", lower_bound=1)
    flags.DEFINE_integer("seed", 0, "Seed of shapes and starts.")
    STUDY.main()
