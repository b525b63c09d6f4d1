import itertools

import numpy as np
import pytest
import scipy.ndimage
import scipy.spatial
from helpers.solid_models import cube, joined, model_of

from data_gen import cameras
from data_gen.catalogues import shapes
from data_gen.frame import normalize
from data_gen.mesh import UnusableModelError, build_model, face_normals
from data_gen.solid import mark_surface, solid_occupancy

SIDE = 3  # points along the edge of a cell
ANGLES = (0.0, 20.0)
ALONG = np.eye(3)


def filled_cells(bodies, model, rotation, size=32):
    """Cells of which at least half of 3 x 3 x 3 points are in one of a model's convex bodies."""
    along = ((np.arange(size * SIDE) + 0.5) * 2 / (size * SIDE)).astype(np.float32)
    x, y, z = np.meshgrid(along - 1, along - 1, along, indexing="ij", sparse=True)
    # The model is normalised, the bodies are not.
    corners = joined(*bodies)[0]
    low, scale = corners.min(axis=0), np.ptp(model.vertices, axis=0) / np.ptp(corners, axis=0)
    inside = np.zeros([size * SIDE] * 3, bool)
    for body in bodies:
        vertices = (body.vertices - low) * scale + model.vertices.min(axis=0)
        planes = scipy.spatial.ConvexHull(vertices @ rotation.T).equations.round(6)
        within = np.ones_like(inside)
        for a, b, c, shift in np.unique(planes, axis=0).astype(np.float32):
            within &= a * x + b * y + (c * z + shift) <= 0
        inside |= within
    parts = inside.reshape(size, SIDE, size, SIDE, size, SIDE)
    return parts.sum(axis=(1, 3, 5)) * 2 >= SIDE**3


def parts_of(cells):
    """The number of 26-connected components."""
    return scipy.ndimage.label(cells, np.ones((3, 3, 3)))[1]


def build(*parts):
    return normalize(build_model(*joined(*parts)))


def table(thickness, radius):
    """A top of a thickness, and legs of a radius."""
    ends = itertools.product((-0.5, 0.5), (-0.5, 0.5))
    legs = [shapes.rod((x, y, 0), (x, y, 0.9), radius) for x, y in ends]
    return [shapes.box(1.4, 1.4, thickness).at(z=0.9), *legs]


THICK = {
    "table": table(0.25, 0.12),
    "mushroom": (shapes.ball(1.2, 1.2, 0.6, 12).at(z=1), shapes.rod((0, 0, 0), (0, 0, 1), 0.2)),
}
"""Watertight bodies whose parts are thicker than two cells."""

JUNCTIONS = {
    "thin top": table(0.02, 0.1),
    "thin legs": table(0.2, 0.012),
    "brim": (shapes.ball(0.8, 0.8, 0.8, 12).at(z=0.1), shapes.box(1.6, 1.6, 0.01)),
    "shelf": (
        *(shapes.box(0.15, 0.6, 1.2).at(x, 0, 0.6) for x in (-0.6, 0.6)),
        *(shapes.box(1.2, 0.6, 0.015).at(z=z) for z in (0.1, 0.45, 0.8, 1.15)),
    ),
}
"""Thin parts that meet thick ones."""


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("name", THICK)
def test_thick_bodies_are_filled(name, angle):
    model, rotation = build(*THICK[name]), cameras.turn_about_vertical(angle)
    want, got = filled_cells(THICK[name], model, rotation), solid_occupancy(model, rotation)
    assert (got & want).sum() / (got | want).sum() >= 0.95


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("name", JUNCTIONS)
def test_a_solid_falls_apart_no_more_than_its_surface(name, angle):
    model, rotation = build(*JUNCTIONS[name]), cameras.turn_about_vertical(angle)
    corners = (model.vertices @ rotation.T + [1, 1, 0]) * 16
    surface, _ = mark_surface(corners, model.faces, model.edges, 32)
    got = solid_occupancy(model, rotation)
    assert parts_of(surface) == 1
    assert parts_of(got) == 1
    assert got.sum() < 1.3 * (filled_cells(JUNCTIONS[name], model, rotation) | surface).sum()


def crossings(corners, size):
    """Whether a triangle meets the segments from each cell's centre to the next along z."""
    a, b, c = corners
    centre = np.arange(size) + 0.5
    x, y = np.meshgrid(centre, centre, indexing="ij")
    det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    s = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / det
    t = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / det
    z = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])
    met = ((s >= 0) & (t >= 0) & (s + t <= 1))[..., None]
    return met & (z[..., None] >= centre[:-1]) & (z[..., None] <= centre[1:])


def test_no_step_of_air_crosses_a_marked_sliver(rng):
    size, face, edges = 20, np.array([[0, 1, 2]]), np.array([[0, 1], [1, 2], [0, 2]])
    for _ in range(80):
        # Long and thin, some thinner than any cell, in all directions.
        corners = rng.uniform(-2, size + 2, (3, 3))
        corners[2] = corners[0] + rng.uniform(-0.2, 1.2) * (corners[1] - corners[0])
        corners[2] += rng.normal(size=3) * 10 ** rng.uniform(-4, 0.7)
        marked, crossed = mark_surface(corners, face, edges, size)
        for axes in ((1, 2, 0), (2, 0, 1), (0, 1, 2)):  # the last one is that of the steps
            met, cells = crossings(corners[:, axes], size), marked.transpose(axes)
            assert (cells[..., :-1] | cells[..., 1:])[met].all()
            np.testing.assert_array_equal(crossed[axes[-1]].transpose(axes)[..., :-1], met)


def test_occupancy_has_no_bias_is_indexed_x_y_z_and_turned():
    # Tops above and below the middle of cells: a cell counts if at least half of it is full.
    for height, layers in ((0.46, 7), (0.49, 8), (0.52, 8)):
        box = model_of(shapes.box(1.6, 0.9, height).at(z=height / 2))
        assert solid_occupancy(box, ALONG).any(axis=(0, 1)).sum() == layers
    bar = normalize(model_of(shapes.box(4, 1, 1)))
    along = solid_occupancy(bar, ALONG)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    x, y, z = (np.ptp(i) + 1 for i in np.nonzero(along))
    assert x > 25 > 12 > max(y, z)
    assert along[..., 0].any()
    np.testing.assert_array_equal(solid_occupancy(bar, quarter), along.transpose(1, 0, 2))


def test_occupancy_fills_through_cracks_and_an_open_bottom_but_no_open_vessel():
    box = shapes.box(1, 1, 1)
    closed = normalize(model_of(box))
    normal = face_normals(box.vertices, box.faces)
    without_bottom = normalize(build_model(box.vertices, box.faces[normal[:, 2] > -0.5]))
    want = solid_occupancy(closed, ALONG)
    np.testing.assert_array_equal(solid_occupancy(without_bottom, ALONG), want)
    # Gaps of half a cell between faces are closed.
    corners = closed.corners() + 0.012 * face_normals(closed.vertices, closed.faces)[:, None]
    apart = build_model(corners.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    got = solid_occupancy(apart, ALONG)
    assert got[16, 16, 5]
    assert (got & want).sum() / want.sum() > 0.95
    normal = face_normals(cube().vertices, cube().faces)
    vessel = normalize(build_model(cube().vertices, cube().faces[normal[:, 2] < 0.5]))
    got = solid_occupancy(vessel, ALONG)
    assert not got[16, 16, 8]
    assert got[16, 16, 0]


def test_occupancy_refuses_endless_surface():
    vertices = np.tile([[-0.7, -0.7, 0], [0.7, -0.7, 0], [0, 0.7, 0.6]], (20000, 1))
    model = build_model(vertices, np.arange(60000).reshape(-1, 3))
    with pytest.raises(UnusableModelError):
        solid_occupancy(model, ALONG)
