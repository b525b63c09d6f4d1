"""Mean shapes under CD and EMD: `psgn study mean_shape`.

If an image does not determine the shape S, a network trained with a distance L tends to the cloud

    x* = argmin over x of E_S[L(x, S)],

the mean shape for L. We compute x* by stochastic gradient descent, without a network, for four
distributions of plane shapes: a circle of random radius; a spiky arc at a random position on the
diagonal; a bar with a square at one of its four corners; a bar with a disk above it with
probability 1/2. All shapes lie in a square of side 1.2.

Source: Fan, Su, Guibas, CVPR 2017, section 4.3 and its figure on mean shapes, which show the clouds
and no numbers; sizes and measures here are **ours**.
"""

import io
import pathlib
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import optax

from psgn_jax import losses
from psgn_jax.array_types import Array, Float, PRNGKey
from psgn_jax.studies import figures
from psgn_jax.studies.runner import Measured, Results, Run, Study
from psgn_jax.system.files import write_atomic

Plane = Float[Array, "n 2"]

NUM_POINTS = 256
RADII = (0.2, 0.45)
PLACES = (-0.25, 0.25)
BAR = (0.4, 0.06)  # half lengths
SIDE = 0.14  # side of the square
# Centres of the squares at the bar's corners, outside the bar.
CORNERS = [(x * (BAR[0] - SIDE / 2), y * (BAR[1] + SIDE / 2)) for x in (-1, 1) for y in (-1, 1)]
DISK, DISK_CENTRE = 0.1, (0.0, 0.26)
NEAR = 0.03  # a point farther than this from a shape is outside: a quarter of the bar's width


def _uniform(key: PRNGKey, n: int, half: tuple[float, float]) -> Plane:
    """Points in a box about the origin."""
    high = jnp.array([half])
    return jax.random.uniform(key, (n, 2), minval=-high, maxval=high)


def _ring(angle: Array, radius: Array | float) -> Plane:
    return radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)


def circle(key: PRNGKey, n: int) -> Plane:
    """A circle about the origin with a radius uniform in `RADII`."""
    of_radius, of_points = jax.random.split(key)
    radius = jax.random.uniform(of_radius, (), minval=RADII[0], maxval=RADII[1])
    return _ring(2 * jnp.pi * jax.random.uniform(of_points, (n,)), radius)


def arc_at(angle: Array) -> Array:
    """The spiky arc about the origin: a quarter circle whose radius has five spikes."""
    tooth = 5 * (angle / (jnp.pi / 2)) % 1
    radius = 0.22 + 0.08 * (1 - jnp.abs(2 * tooth - 1))
    return _ring(angle, radius[:, None])


def arc(key: PRNGKey, n: int) -> Plane:
    """The spiky arc at a position uniform in `PLACES` on the diagonal."""
    of_place, of_points = jax.random.split(key)
    place = jax.random.uniform(of_place, (), minval=PLACES[0], maxval=PLACES[1])
    return arc_at(jnp.pi / 2 * jax.random.uniform(of_points, (n,))) + place


def _attached(key: PRNGKey, n: int, part: Callable[[PRNGKey], Plane], area: float) -> Plane:
    """Uniform points on the union of the bar and a part with this area."""
    of_bar, of_part, of_choice = jax.random.split(key, 3)
    share = area / (area + 4 * BAR[0] * BAR[1])
    chosen = jax.random.uniform(of_choice, (n, 1)) < share
    return jnp.where(chosen, part(of_part), _uniform(of_bar, n, BAR))


def bar_with_square(key: PRNGKey, n: int) -> Plane:
    """The bar and a square at one of its corners."""
    of_corner, of_points = jax.random.split(key)
    centre = jnp.array(CORNERS)[jax.random.randint(of_corner, (), 0, 4)]

    def square(key: PRNGKey) -> Plane:
        return centre[None] + _uniform(key, n, (SIDE / 2, SIDE / 2))

    return _attached(of_points, n, square, SIDE**2)


def bar_with_disk(key: PRNGKey, n: int) -> Plane:
    """The bar and, with probability 1/2, a disk above it."""
    of_presence, of_points = jax.random.split(key)

    def disk(key: PRNGKey) -> Plane:
        of_radius, of_angle = jax.random.split(key)
        radius = DISK * jnp.sqrt(jax.random.uniform(of_radius, (n, 1)))
        angle = 2 * jnp.pi * jax.random.uniform(of_angle, (n,))
        return jnp.array([DISK_CENTRE]) + _ring(angle, radius)

    with_disk = _attached(of_points, n, disk, float(np.pi) * DISK**2)
    alone = _uniform(of_points, n, BAR)
    return jnp.where(jax.random.bernoulli(of_presence), with_disk, alone)


def _outside_box(points: np.ndarray, centre: tuple, half: tuple) -> np.ndarray:
    excess = np.maximum(np.abs(points - np.asarray(centre)) - np.asarray(half), 0)
    return np.linalg.norm(excess, axis=1)


def measure_circle(mean: np.ndarray) -> dict[str, float]:
    """Mean and spread of the points' radius; .325 and 0 for the circle of mean radius."""
    radius = np.linalg.norm(mean, axis=1)
    return {"mean radius": float(radius.mean()), "spread of the radius": float(radius.std())}


def measure_arc(mean: np.ndarray) -> dict[str, float]:
    """Distance of the points from the arc at its mean position; small if the arc is kept."""
    curve = np.asarray(arc_at(jnp.linspace(0, jnp.pi / 2, 2001)))
    distance = np.linalg.norm(mean[:, None] - curve[None], axis=-1).min(axis=1)
    return {
        "rms distance from the mean arc": float(np.sqrt(np.mean(distance**2))),
        "points farther than .03 from it [%]": float(np.mean(distance > NEAR)),
    }


def _measure_parts(mean: np.ndarray, to_parts: np.ndarray, name: str) -> dict[str, float]:
    to_bar = _outside_box(mean, (0, 0), BAR)
    outside = to_bar > NEAR
    return {
        "points outside the bar [%]": float(outside.mean()),
        f"of them inside a {name} [%]": (to_parts[outside] == 0).sum() / max(1, outside.sum()),
        "points in no shape at all [%]": float(np.mean(np.minimum(to_bar, to_parts) > NEAR)),
    }


def measure_squares(mean: np.ndarray) -> dict[str, float]:
    """Shares of points outside the bar, inside a square, and in no shape."""
    to_parts = [_outside_box(mean, centre, (SIDE / 2, SIDE / 2)) for centre in CORNERS]
    return _measure_parts(mean, np.min(to_parts, axis=0), "square")


def measure_disk(mean: np.ndarray) -> dict[str, float]:
    """Like `measure_squares`; a disk has 24.7 % of the points of its shape."""
    distance = np.linalg.norm(mean - np.asarray(DISK_CENTRE), axis=1)
    return _measure_parts(mean, np.maximum(distance - DISK, 0), "disk")


DISTRIBUTIONS = {
    "circle of random radius": (circle, measure_circle),
    "spiky arc on the diagonal": (arc, measure_arc),
    "bar, square at a corner": (bar_with_square, measure_squares),
    "bar, disk half of the time": (bar_with_disk, measure_disk),
}
"""Name -> function that draws n uniform points on a random shape; measures of the mean shape."""

DISTANCES = {"EMD": losses.emd_mean, "CD": losses.chamfer_sq_mean}


def mean_shape(
    distance: Callable[..., Array], draw: Callable[[PRNGKey, int], Plane], key: PRNGKey, steps: int
) -> Plane:
    """The minimiser x [n, 2] of E_S[distance(x, S)], by Adam on eight random shapes per step."""
    tx = optax.adam(optax.cosine_decay_schedule(0.01, steps, alpha=0.01))
    start = 0.1 * jax.random.normal(jax.random.fold_in(key, steps), (NUM_POINTS, 2))

    def objective(x: Array, keys: PRNGKey) -> Array:
        shapes = jax.vmap(lambda k: draw(k, NUM_POINTS))(keys)
        pair = jnp.broadcast_to(x[None], shapes.shape), shapes
        in_space = (jnp.pad(clouds, ((0, 0), (0, 0), (0, 1))) for clouds in pair)
        return losses.map_pairs(distance)(*in_space).mean()

    def step(number: Array, carry: tuple[Array, optax.OptState]) -> tuple[Array, optax.OptState]:
        x, state = carry
        keys = jax.random.split(jax.random.fold_in(key, number), 8)
        updates, state = tx.update(jax.grad(objective)(x, keys), state)
        return optax.apply_updates(x, updates), state

    descend = jax.jit(lambda x: jax.lax.fori_loop(0, steps, step, (x, tx.init(x)))[0])
    return descend(start)


def _file(run: Run) -> pathlib.Path:
    return run.folder / f"mean_shapes_{run.config.train.steps}.npz"


def train(run: Run) -> None:
    """Computes the mean shapes of all distributions, unless the folder has them."""
    if _file(run).exists():
        return
    clouds, key, steps = {}, jax.random.key(run.seed), run.config.train.steps
    for row, (name, (draw, _)) in enumerate(DISTRIBUTIONS.items()):
        of_row = jax.random.fold_in(key, row)
        clouds[name] = np.asarray(mean_shape(DISTANCES[run.name], draw, of_row, steps))
    np.savez(buffer := io.BytesIO(), allow_pickle=False, **clouds)
    write_atomic(_file(run), buffer.getvalue())


def measure(run: Run) -> Measured:
    """The measures of each mean shape; shown: the mean shapes [n, 2]."""
    with np.load(_file(run)) as file:
        clouds = {name: file[name] for name in DISTRIBUTIONS}
    metrics = {
        f"{name}: {key}": np.array([value])
        for name, (_, measures) in DISTRIBUTIONS.items()
        for key, value in measures(clouds[name]).items()
    }
    return Measured([], metrics, clouds)


def figure(results: Results) -> figures.Figure:
    """A column for each distribution: random shapes in grey, mean shapes in red."""
    sheet = figures.blank(300 * len(DISTRIBUTIONS), 930)
    axes = sheet.subplots(3, len(DISTRIBUTIONS), squeeze=False)
    for column, (name, (draw, _)) in enumerate(DISTRIBUTIONS.items()):
        keys = jax.random.split(jax.random.key(column), 60)
        clouds = np.asarray(jax.vmap(lambda k, draw=draw: draw(k, 400))(keys))
        for cloud, grey in zip(clouds[:5], np.linspace(0.15, 0.75, 5), strict=True):
            axes[0, column].scatter(*cloud.T, s=2, color=str(grey))
        axes[0, column].set_title(name, fontsize=11)
        for row, (label, runs) in enumerate(results.items(), start=1):
            axes[row, column].scatter(*clouds[:, :120].reshape(-1, 2).T, s=2, color="0.87")
            axes[row, column].scatter(*runs[0].shown[name].T, s=10, color="#cd1e1e")
            axes[row, column].set_title(f"mean shape, {label}", fontsize=11)
    for ax in axes.flat:
        ax.set(xlim=(-0.6, 0.6), ylim=(-0.6, 0.6), aspect="equal", xticks=[], yticks=[])
        ax.spines[:].set_color("0.9")
    return sheet


STUDY = Study(
    "mean_shape",
    {"train.steps": 400},
    lambda *_: {name: {} for name in DISTANCES},
    {},
    figure,
    measure,
    train=train,
    note="Unit of lengths: the shapes lie in a square of side 1.2.",
)
