"""Primitives and the surface of their union, compared with areas and volumes in closed form."""

import dataclasses

import numpy as np
import pytest
from helpers import javascript
from helpers.human_study import LEG, TOP, TURN, table_points

from psgn_jax.human.answers import Answer, Part
from psgn_jax.human.build import STATIC
from psgn_jax.human.solids import (
    HiddenSurfaceError,
    area,
    crosses_itself,
    inside,
    sample_union,
    solids_of,
    triangulate,
    unit_mesh,
)

BOX = Part("box", (1.0, 1.0, 1.0), (0.0, 0.0, 0.5))
L_SHAPE = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.0), (0.0, 0.0), (0.0, 0.5), (-0.5, 0.5))
KINDS = {
    "box": BOX,
    "cylinder": dataclasses.replace(BOX, kind="cylinder"),
    "cone": dataclasses.replace(BOX, kind="cone", taper=0.0),
    "sphere": dataclasses.replace(BOX, kind="sphere"),
    "prism": dataclasses.replace(BOX, kind="prism", sides=5),
    "pyramid": dataclasses.replace(BOX, taper=0.25),
    "outline": dataclasses.replace(BOX, kind="outline", outline=L_SHAPE, taper=0.5),
}


def answer(*parts, turn=0.0, x=0.0, y=0.0):
    return Answer("Case 1", 0.0, True, turn, x, y, tuple(parts))


def volume(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


@pytest.mark.parametrize("name", list(KINDS))
def test_meshes_are_closed_and_face_outward(name):
    mesh = unit_mesh(KINDS[name])
    edges = np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    forth = {tuple(edge) for edge in edges.tolist()}
    assert len(forth) == len(edges)
    assert {(b, a) for a, b in forth} == forth
    assert np.abs(mesh.vertices).max() == pytest.approx(0.5)
    polygon = 16 * np.sin(2 * np.pi / 32) / 4  # of 32 corners in a circle of diameter 1
    expected = {
        "box": 1,
        "cylinder": polygon,
        "cone": polygon / 3,
        "pyramid": (1 + 0.25 + 0.25**2) / 3,
        "outline": 0.75 * (1 + 0.5 + 0.5**2) / 3,
    }
    assert volume(mesh) == pytest.approx(expected.get(name, volume(mesh)), rel=1e-9)
    assert volume(mesh) > 0
    if name == "sphere":
        assert volume(mesh) == pytest.approx(np.pi / 6, rel=0.03)


@pytest.mark.parametrize("name", list(KINDS))
@pytest.mark.parametrize("mirror", ["", "x"])
def test_inside_agrees_with_the_winding_number(name, mirror, rng):
    part = dataclasses.replace(
        KINDS[name], size=(0.7, 0.4, 0.9), at=(0.1, 0.2, 0.5), turn=(30.0, -50.0, 110.0),
        mirror=mirror,
    )  # fmt: skip
    for solid in solids_of(answer(part, turn=35.0, x=0.1)):
        points = rng.uniform(-0.8, 1.0, (400, 3))
        a, b, c = (
            solid.mesh.vertices[solid.mesh.faces[:, k]][None] - points[:, None] for k in range(3)
        )
        la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
        dots = [(u * v).sum(axis=2) for u, v in ((a, b), (b, c), (c, a))]
        below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
        angle = 2 * np.arctan2(np.einsum("nfk,nfk->nf", a, np.cross(b, c)), below)
        winding = angle.sum(axis=1) / (4 * np.pi)
        np.testing.assert_array_equal(inside(solid, points), winding > 0.5)


def test_points_are_uniform_on_the_table():
    parts = [Part("box", TOP[1], TOP[0]), Part("box", LEG[1], LEG[0], mirror="xy")]
    parts = [dataclasses.replace(p, at=tuple(map(float, p.at)), size=p.size) for p in parts]
    points = sample_union(solids_of(answer(*parts, turn=float(TURN))), 20_000, 0)
    truth = table_points(20_000)
    assert points.dtype == np.float32
    for low, high in ((0, 0.3), (0.3, 0.61), (0.61, 0.63), (0.69, 0.71)):
        share = [np.mean((c[:, 2] >= low) & (c[:, 2] < high)) for c in (points, truth)]
        assert share[0] == pytest.approx(share[1], abs=0.012)
    # There are no points under the top where the legs touch it.
    angle = np.deg2rad(TURN)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    own = points[:, :2] @ turn
    near = np.abs(np.abs(own) - LEG[0][:2]).max(axis=1) < 0.039
    assert not (near & (np.abs(points[:, 2] - 0.62) < 1e-4)).any()


def test_two_boxes_that_share_faces_are_one_box():
    left = dataclasses.replace(BOX, size=(1.0, 0.6, 1.0), at=(0.0, -0.2, 0.5))
    right = dataclasses.replace(BOX, size=(1.0, 0.6, 1.0), at=(0.0, 0.2, 0.5))
    points = sample_union(solids_of(answer(left, right)), 30_000, 0)
    # The overlap is neither empty nor counted twice: y is uniform on the top.
    top = points[np.abs(points[:, 2] - 1) < 1e-5]
    counts, _ = np.histogram(top[:, 1], bins=5, range=(-0.5, 0.5))
    assert counts.min() > 0.9 * counts.mean()
    assert np.isclose(np.abs(points - [0, 0, 0.5]).max(axis=1), 0.5, atol=1e-4).all()
    again = sample_union(solids_of(answer(left, right, left)), 30_000, 0)
    assert np.mean(again[:, 1] < 0) == pytest.approx(0.5, abs=0.02)


def test_a_part_inside_another_has_no_points():
    small = dataclasses.replace(BOX, kind="sphere", size=(0.5, 0.5, 0.5))
    points = sample_union(solids_of(answer(BOX, small)), 1000, 0)
    assert np.isclose(np.abs(points - [0, 0, 0.5]).max(axis=1), 0.5, atol=1e-4).all()
    assert issubclass(HiddenSurfaceError, ValueError)


def test_polygons():
    assert area(L_SHAPE) == pytest.approx(0.75)
    assert not crosses_itself(L_SHAPE)
    assert len(triangulate(L_SHAPE)) == 4
    bow = ((-0.5, -0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, 0.5))
    assert crosses_itself(bow)
    assert triangulate(L_SHAPE[::-1]) is None
    on_a_line = ((-0.5, -0.5), (0.0, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
    faces = triangulate(on_a_line)
    assert sum(area([on_a_line[i] for i in face]) for face in faces) == pytest.approx(1)


@pytest.mark.skipif(javascript.NODE is None, reason="no node")
def test_polygons_are_cut_as_in_the_page(rng):
    """Random star polygons: Python and JavaScript give the same triangles."""
    stars = []
    for corners in (3, 5, 9, 40):
        angles = np.sort(rng.uniform(0, 2 * np.pi, corners)) + np.pi
        radius = rng.uniform(0.1, 0.5, corners)
        points = np.round(radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1), 5)
        stars.append([tuple(p) for p in points.tolist()])
    cut = javascript.node(
        "return input.stars.map(s => [g.triangulate(s), g.crossesItself(s)]);",
        {"g": STATIC / "geometry.js"},
        stars=stars,
    )
    for star, (faces, crossing) in zip(stars, cut, strict=True):
        expected = triangulate(star)
        assert crosses_itself(star) == crossing
        assert faces == (None if expected is None else [list(face) for face in expected])
