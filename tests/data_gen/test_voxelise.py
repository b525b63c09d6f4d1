"""Solid voxels compared with winding numbers, and marked surfaces with exact geometry."""

import free_meshes
import numpy as np
import pytest
import scipy.ndimage
import watertight
import winding
from helpers.solid_models import cube, model_of, sphere

from data_gen import cameras
from data_gen.catalogues import solids
from data_gen.catalogues.by_name import open_catalogue
from data_gen.frame import normalize
from data_gen.mesh import UnusableModelError, build_model, face_normals
from data_gen.surface import sample_surface
from data_gen.voxelise import mark_surface, solid_occupancy

FACE = np.array([[0, 1, 2]])
EDGES = np.array([[0, 1], [1, 2], [0, 2]])


def crossings(corners, axis, size):
    """Whether a triangle meets the segments from each cell's centre to the next along an axis."""
    a, b, c = np.roll(corners, -1 - axis, axis=1)
    centre = np.arange(size) + 0.5
    x, y = np.meshgrid(centre, centre, indexing="ij")
    det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    s = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / det
    t = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / det
    z = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])
    met = ((s >= 0) & (t >= 0) & (s + t <= 1))[..., None]
    met = met & (z[..., None] >= centre[:-1]) & (z[..., None] <= centre[1:])
    return np.moveaxis(met, (0, 1, 2), ((axis + 1) % 3, (axis + 2) % 3, axis))


def slivers(rng, count, size):
    """Long thin triangles, some of them thinner than any cell, in all directions."""
    ends = rng.uniform(-2, size + 2, (count, 2, 3))
    part = rng.uniform(-0.2, 1.2, (count, 1))
    third = ends[:, 0] + part * (ends[:, 1] - ends[:, 0])
    third += rng.normal(size=(count, 3)) * 10 ** rng.uniform(-4, 0.7, (count, 1))
    return np.concatenate([ends, third[:, None]], axis=1)


def test_no_step_of_air_crosses_a_marked_sliver(rng):
    size = 20
    for corners in slivers(rng, 150, size):
        marked, crossed = mark_surface(corners, FACE, EDGES, size)
        for axis in range(3):
            met = crossings(corners, axis, size)
            first = tuple(slice(None, -1) if k == axis else slice(None) for k in range(3))
            second = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
            assert (marked[first] | marked[second])[met].all()
            np.testing.assert_array_equal(crossed[axis][first], met)


def test_marked_cells_hold_the_surface_and_leave_no_part_out(rng):
    size = 20
    for corners in slivers(rng, 60, size).clip(0.1, size - 0.1):
        marked, _ = mark_surface(corners, FACE, EDGES, size)
        # Half of the points are on the edges.
        weights = rng.dirichlet([1, 1, 1], 20_000)
        weights[::2, 0] = 0
        weights[::2] = rng.permuted(weights[::2], axis=1)
        points = weights / weights.sum(axis=1, keepdims=True) @ corners
        cells = np.argwhere(marked) + 0.5
        gaps = np.abs(points[::50, None] - cells).max(axis=2).min(axis=1)
        assert gaps.max() < 1.5
        on_it = np.unique(np.floor(points).astype(int), axis=0) + 0.5
        assert np.abs(cells[:, None] - on_it).max(axis=2).min(axis=1).max() < 1.5


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 77.0])
def test_a_body_of_slivers_is_solid(angle):
    # A flat cushion whose lid is a fan of slivers, which is common in furniture models.
    around = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    rim = np.stack([np.cos(around), 0.6 * np.sin(around), np.zeros(240)], axis=1)
    vertices = np.concatenate([rim, rim + np.array([0, 0, 0.25]), [[0.9, 0, 0], [0.9, 0, 0.32]]])
    here, there = np.arange(240), np.roll(np.arange(240), -1)
    faces = np.concatenate(
        [
            np.stack([there, here, np.full(240, 480)], axis=1),
            np.stack([here + 240, there + 240, np.full(240, 481)], axis=1),
            np.stack([here, there, there + 240], axis=1),
            np.stack([here, there + 240, here + 240], axis=1),
        ]
    )
    model = normalize(build_model(vertices, faces))
    assert winding.is_watertight(model)
    rotation = cameras.turn_about_vertical(angle)
    want = winding.occupancy(winding.inside(model, rotation))
    got = solid_occupancy(model, rotation)
    assert (got & want).sum() / (got | want).sum() > 0.95


def compare(model):
    """Compares a model's voxels in two views with winding numbers.

    Only thick parts (`winding.thick_parts`) are compared, without the air behind narrow gaps
    (`winding.sheltered`). Both are the same parts of space in both views.

    Returns:
      The smaller IoU of the two views, and the ratio of the smaller to the larger volume of the two
      views: of the voxels, and of the winding numbers.
    """
    turns = [watertight.turn(view) for view in range(2)]
    views = [winding.fields(model, turn) for turn in turns]
    thick = winding.thick_parts(views[0][0])
    behind = [winding.sheltered(*view) for view in views]
    iou, ours, theirs = [], [], []
    for turn, view in zip(turns, views, strict=True):
        part = winding.cells_of(thick, turn @ turns[0].T)
        for other, air in zip(turns, behind, strict=True):
            part &= ~winding.cells_of(air, turn @ other.T)
        got, want = solid_occupancy(model, turn) & part, winding.occupancy(view[0]) & part
        iou.append((got & want).sum() / (got | want).sum())
        ours.append(got.sum())
        theirs.append(want.sum())
    return min(iou), min(ours) / max(ours), min(theirs) / max(theirs)


def test_a_car_agrees_with_winding_numbers():
    entry = next(e for e in open_catalogue("procedural", "1").entries() if e.model_id == "car-0")
    model, turn = entry.load(), cameras.turn_about_vertical(-37.0)
    want = winding.occupancy(winding.inside(model, turn))
    got = solid_occupancy(model, turn)
    assert (got & want).sum() / (got | want).sum() > 0.95


def test_walls_thinner_than_the_points_close_a_room():
    # Panes of glass, thinner than the distance between the sample points of the winding numbers.
    # The numbers at the points alone would not separate the inside from the outside.
    outer, inner = solids.box(1.0, 1.0, 0.8), solids.box(0.996, 0.996, 0.796)
    vertices = np.concatenate([outer.vertices, inner.vertices])
    vertices[:, 2] -= vertices[:, 2].min()
    faces = np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.vertices)])
    model = build_model(vertices, faces)
    assert winding.is_watertight(model)
    for view in range(2):
        turn = watertight.turn(view)
        want = winding.occupancy(winding.inside(model, turn))
        got = solid_occupancy(model, turn)
        assert (got & want).sum() / (got | want).sum() > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("source", watertight.MODELS)
def test_models_agree_with_winding_numbers(source):
    """Run with `-m slow -s` for the table."""
    entries = {e.model_id: e for e in free_meshes.entries_of_source(source)}
    for name in watertight.MODELS[source]:
        model = entries[name].load()
        assert winding.is_watertight(model), name
        iou, volumes, theirs = compare(model)
        missed = watertight.MISSES.get(name, ("",))[0]
        print(
            f"{source}: {name}: IoU {iou:.3f}, volumes of two views {volumes:.3f} (winding numbers "
            f"{theirs:.3f}){', falls short: ' + missed if missed else ''}",
            flush=True,
        )
        for figure, value in (("IoU", iou), ("volumes", volumes)):
            if missed == figure:
                # Known deviations: not larger than stated, and to be removed once the test holds.
                assert watertight.MISSES[name][1] - 0.005 < value < 0.95, name
            else:
                assert value >= 0.95, (name, figure)


def test_a_mattress_of_slivers_holds_no_air():
    model = free_meshes.model("sh3f", "Scopia/Scopia#air-mattress")
    turn = cameras.turn_about_vertical(0.0)
    points = winding.inside(model, turn)
    whole = points.reshape(32, winding.SIDE, 32, winding.SIDE, 32, winding.SIDE)
    assert solid_occupancy(model, turn)[whole.all(axis=(1, 3, 5))].all()


def test_the_volume_of_a_flat_box_has_no_bias():
    # Tops above and below the middle of cells: a cell counts if at least half of it is full.
    for height, layers in ((0.46, 7), (0.49, 8), (0.52, 8)):
        box = build_model(*_box(1.6, 0.9, height))
        got = solid_occupancy(box, np.eye(3))
        assert got.any(axis=(0, 1)).sum() == layers


def _box(*size):
    solid = solids.box(*size)
    return solid.vertices - [0, 0, solid.vertices[:, 2].min()], solid.faces


def centres(size=32):
    x = (np.arange(size) + 0.5) / size * 2
    return np.stack(np.meshgrid(x - 1, x - 1, x, indexing="ij"), axis=-1)


def test_occupancy_of_a_dome_is_its_volume():
    model = normalize(model_of(sphere()))
    got = solid_occupancy(model, np.eye(3))
    radius = model.vertices[:, 2].max() / 2
    want = np.linalg.norm(centres() - [0, 0, radius], axis=-1) < radius
    assert got.shape == (32, 32, 32)
    assert (got & want).sum() / (got | want).sum() > 0.9


def test_occupancy_is_indexed_x_y_z_and_turned():
    bar = normalize(model_of(solids.box(4, 1, 1)))
    along = solid_occupancy(bar, np.eye(3))
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    across = solid_occupancy(bar, quarter)
    x, y, z = (np.ptp(i) + 1 for i in np.nonzero(along))
    assert x > 25
    assert y < 12
    assert z < 12
    assert np.nonzero(along)[2].min() == 0
    np.testing.assert_array_equal(across, along.transpose(1, 0, 2))


def test_occupancy_fills_through_cracks_and_an_open_bottom():
    box = solids.box(1, 1, 1)
    closed = normalize(model_of(box))
    normal = face_normals(box.vertices, box.faces)
    without_bottom = normalize(build_model(box.vertices, box.faces[normal[:, 2] > -0.5]))
    want = solid_occupancy(closed, np.eye(3))
    np.testing.assert_array_equal(solid_occupancy(without_bottom, np.eye(3)), want)
    # Gaps of half a cell between faces are closed.
    corners = closed.corners() + 0.012 * face_normals(closed.vertices, closed.faces)[:, None]
    cracked = build_model(corners.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    got = solid_occupancy(cracked, np.eye(3))
    assert got[16, 16, 5]
    assert (got & want).sum() / want.sum() > 0.95


def test_occupancy_keeps_an_open_vessel_open():
    normal = face_normals(cube().vertices, cube().faces)
    vessel = normalize(build_model(cube().vertices, cube().faces[normal[:, 2] < 0.5]))
    got = solid_occupancy(vessel, np.eye(3))
    assert not got[16, 16, 8]
    assert got[16, 16, 0]


def test_occupancy_keeps_thin_parts():
    table = [solids.box(1.4, 1.4, 0.02).at(z=0.9)]
    table += [solids.rod((x, y, 0), (x, y, 0.9), 0.008) for x in (-0.6, 0.6) for y in (-0.6, 0.6)]
    sizes = np.cumsum([0, *(len(p.vertices) for p in table)])
    model = normalize(
        build_model(
            np.concatenate([p.vertices for p in table]),
            np.concatenate([p.faces + n for p, n in zip(table, sizes[:-1], strict=True)]),
        )
    )
    got = solid_occupancy(model, np.eye(3))
    points = sample_surface(model, 5000, 0).points
    cell = np.clip(np.floor((points + np.array([1, 1, 0])) * 16).astype(int), 0, 31)
    # A sheet on the border between two layers of cells is in one of them.
    assert got[tuple(cell.T)].mean() > 0.85
    assert scipy.ndimage.maximum_filter(got, size=3)[tuple(cell.T)].all()
    assert got.sum() < 3000
    assert not got[16, 16, 3]


def test_occupancy_in_any_pose_holds_most_of_the_surface(rng):
    model = normalize(model_of(solids.box(2, 1, 1)))
    for angle in rng.uniform(0, 2 * np.pi, 4):
        c, s = np.cos(angle), np.sin(angle)
        rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        got = solid_occupancy(model, rotation)
        inside = (np.abs((centres() @ rotation)[..., 0]) < model.vertices[:, 0].max()) & (
            np.abs((centres() @ rotation)[..., 1]) < model.vertices[:, 1].max()
        )
        inside &= centres()[..., 2] < model.vertices[:, 2].max()
        assert (got & inside).sum() / (got | inside).sum() > 0.85


def test_occupancy_refuses_endless_surface():
    vertices = np.tile([[-0.7, -0.7, 0], [0.7, -0.7, 0], [0, 0.7, 0.6]], (20000, 1))
    model = build_model(vertices, np.arange(60000).reshape(-1, 3))
    with pytest.raises(UnusableModelError, match="more than the limit"):
        solid_occupancy(model, np.eye(3))
