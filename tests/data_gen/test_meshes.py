import dataclasses

import free_meshes
import numpy as np
import pytest
import scipy.ndimage

from data_gen.catalogues import solids
from data_gen.frame import axis_vector, normalize, orient
from data_gen.mesh import Material, UnusableModelError, build_model, face_areas, face_normals
from data_gen.polygons import cut_ears
from data_gen.surface import sample_surface
from data_gen.voxelise import solid_occupancy


def model_of(solid, **kwargs):
    return build_model(solid.vertices, solid.faces, **kwargs)


def cube(size=1.0):
    return solids.box(size, size, size)


def sphere(sides=32):
    return solids.ball(2, 2, 2, sides)


def test_build_drops_what_is_no_surface():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [9, 9, 9]], float)
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 0, 1], [0, 1, 7], [0, 2, -1]])
    model = build_model(vertices, faces)
    assert len(model.faces) == 1
    assert len(model.vertices) == 3
    assert any("2 degenerate" in w for w in model.warnings)
    assert any("do not exist" in w for w in model.warnings)


def test_build_drops_faces_nobody_can_see():
    clear = Material(opacity=0.0)
    faces = cube().faces
    owner = np.arange(len(faces)) % 2
    model = build_model(cube().vertices, faces, materials=[Material(), clear], face_material=owner)
    assert len(model.faces) == len(faces) // 2


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_build_refuses_vertices_that_are_not_finite(bad):
    vertices = cube().vertices.copy()
    vertices[0, 0] = bad
    with pytest.raises(UnusableModelError, match="not finite"):
        build_model(vertices, cube().faces)


def test_a_bad_vertex_that_no_face_uses_is_harmless():
    vertices = np.concatenate([cube().vertices, [[np.nan] * 3]])
    assert len(build_model(vertices, cube().faces).faces) == 12


def test_build_refuses_empty_and_too_large():
    with pytest.raises(UnusableModelError, match="empty"):
        build_model(np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(UnusableModelError, match="empty"):
        build_model(np.zeros((3, 3)), [[0, 1, 2]])
    with pytest.raises(UnusableModelError, match="limit of 11"):
        model_of(cube(), max_faces=11)


def test_model_checks_its_arrays():
    model = model_of(cube())
    with pytest.raises(ValueError, match="model faces"):
        dataclasses.replace(model, faces=model.faces + 100)
    with pytest.raises(ValueError, match="model uv"):
        dataclasses.replace(model, uv=model.uv[:3])


def test_crease_normals_of_a_cube_are_flat_and_of_a_sphere_round():
    flat = model_of(cube())
    np.testing.assert_allclose(
        flat.normals, np.repeat(face_normals(flat.vertices, flat.faces)[:, None], 3, 1),
        atol=1e-6,
    )  # fmt: skip
    round_ = model_of(sphere())
    # Apart from the poles, where few faces meet, the normal is the direction from the centre.
    np.testing.assert_allclose(round_.normals, round_.corners(), atol=0.02)


def test_crease_normals_do_not_need_shared_vertices():
    soup = sphere().vertices[sphere().faces].reshape(-1, 3)
    model = build_model(soup, np.arange(len(soup)).reshape(-1, 3))
    np.testing.assert_allclose(model.normals, model.corners(), atol=0.02)


def test_crease_normals_with_many_faces_on_one_edge():
    # A book of 200 pages: linear cost, unit normals.
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    tips = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    vertices = np.concatenate([[[0, 0, -1.0], [0, 0, 1.0]], tips])
    faces = np.stack([np.zeros(200, int), np.ones(200, int), np.arange(2, 202)], axis=1)
    model = build_model(vertices, faces)
    np.testing.assert_allclose(np.linalg.norm(model.normals, axis=2), 1, atol=1e-5)


def test_missing_normals_are_made_and_given_ones_kept():
    solid = cube()
    given = np.repeat(face_normals(solid.vertices, solid.faces)[:, None], 3, 1)
    given[0] = 0
    given[1, 1] = np.nan
    given[2] *= 7
    model = model_of(solid, normals=given)
    want = np.repeat(face_normals(model.vertices, model.faces)[:, None], 3, 1)
    np.testing.assert_allclose(model.normals, want, atol=1e-6)
    assert any("4 corner normals" in w for w in model.warnings)


def test_a_face_is_turned_over_to_agree_with_its_normals():
    solid = cube()
    given = np.repeat(face_normals(solid.vertices, solid.faces)[:, None], 3, 1)
    faces = solid.faces.copy()
    faces[3] = faces[3][::-1]
    model = build_model(solid.vertices, faces, normals=given)
    facing = face_normals(model.vertices, model.faces)
    assert ((facing[:, None] * model.normals).sum(axis=2) > 0.99).all()


@pytest.mark.parametrize(("up", "front"), [("+y", "+z"), ("+z", "-y"), ("-x", "+y"), ("+y", "-z")])
def test_orient_turns_up_to_z_and_front_to_x(up, front):
    model = model_of(cube())
    marked = dataclasses.replace(
        model, vertices=np.stack([axis_vector(up), axis_vector(front)] * 4)
    )
    turned = orient(marked, up, front).vertices
    np.testing.assert_allclose(turned[:2], [[0, 0, 1], [1, 0, 0]], atol=1e-12)
    volume = np.linalg.det(np.stack([turned[1], np.cross(turned[0], turned[1]), turned[0]]))
    assert volume == pytest.approx(1)


def test_orient_names_a_wrong_axis():
    with pytest.raises(ValueError, match="axis 'y'"):
        orient(model_of(cube()), up="y")
    with pytest.raises(ValueError, match="right angles"):
        orient(model_of(cube()), up="+y", front="-y")


def test_a_mirroring_keeps_the_outside_outside():
    model = normalize(model_of(sphere()))
    mirrored = model.transformed(np.array([[-1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]))
    facing = face_normals(mirrored.vertices, mirrored.faces)
    assert ((facing[:, None] * mirrored.normals).sum(axis=2) > 0.9).all()
    assert (facing * (mirrored.corners().mean(axis=1) - [0, 0, 0.5])).sum(axis=1).min() > 0


def test_normalize(rng):
    shift = rng.normal(size=3) * 100
    model = normalize(model_of(solids.box(3, 2, 1).at(*shift)))
    np.testing.assert_allclose(np.linalg.norm(model.vertices, axis=1).max(), 1)
    assert model.vertices[:, 2].min() == 0
    np.testing.assert_allclose(model.vertices[:, :2].min(0), -model.vertices[:, :2].max(0))
    np.testing.assert_allclose(
        np.ptp(model.vertices, axis=0)[0] / np.ptp(model.vertices, axis=0)[2], 3
    )


def with_sheet(texture, corners, model):
    """The model and, as its last two faces, a rectangle under a texture."""
    count = len(model.vertices)
    faces = np.concatenate([model.faces, count + np.array([[0, 1, 2], [0, 2, 3]])])
    uv = np.zeros((len(faces), 3, 2))
    uv[-2:] = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])[[[0, 1, 2], [0, 2, 3]]]
    owner = np.zeros(len(faces), int)
    owner[-2:] = 1
    return build_model(
        np.concatenate([model.vertices, corners]), faces, uv=uv, face_material=owner,
        materials=[Material(), Material(texture=texture)],
    )  # fmt: skip


@pytest.mark.parametrize("size", [(64, 64), (50, 333)])
def test_normalize_counts_only_what_is_drawn(size):
    # A leaf of radius 0.7 on a sheet that reaches under the ground and far out.
    v, u = ((np.arange(n) + 0.5) / n * 2 - 1 for n in size)
    texture = np.full((*size, 4), 255, np.uint8)
    texture[..., 3] = 255 * (u**2 + v[:, None] ** 2 < 0.49)
    texture[: size[0] // 2, : size[1] // 2, 3] = 0  # v > 1/2, u < 1/2
    corners = np.array([[-2, 0, -1], [2, 0, -1], [2, 0, 3], [-2, 0, 3.0]])
    model = with_sheet(texture, corners, model_of(cube(0.5)))
    exists = texture[..., 3] > 0
    sample = sample_surface(model, 200_000, 0).points
    low, high = sample.min(axis=0), sample.max(axis=0)
    origin = np.array([*(low + high)[:2] / 2, low[2]])
    radius = np.linalg.norm(sample - origin, axis=1).max()
    got = normalize(model)
    want = (model.vertices - origin) / radius
    np.testing.assert_allclose(got.vertices, want, atol=0.006)
    # And the texels' borders exactly: the lowest row that exists, seen from the sheet's corner.
    row = np.flatnonzero(exists.any(axis=1)).max() + 1
    ground = 3 - 4 * row / size[0]
    np.testing.assert_allclose(
        got.vertices[-4, 2] * radius, corners[0, 2] - min(ground, -0.25), atol=0.01
    )


def test_normalize_of_a_model_without_alpha_keeps_its_bits():
    texture = np.full((8, 8, 4), 255, np.uint8)
    corners = np.array([[-2, 0, -1], [2, 0, -1], [2, 0, 3], [-2, 0, 3.0]])
    model = with_sheet(texture, corners, model_of(cube(0.5)))
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    moved = model.vertices - [*(low + high)[:2] / 2, low[2]]
    np.testing.assert_array_equal(
        normalize(model).vertices, moved / np.linalg.norm(moved, axis=1).max()
    )


def test_normalize_of_sheets_that_exist_nowhere_or_repeat():
    corners = np.array([[-2, 0, -1], [2, 0, -1], [2, 0, 3], [-2, 0, 3.0]])
    texture = np.zeros((16, 16, 4), np.uint8)
    model = with_sheet(texture, corners, model_of(cube(0.5)))
    want = normalize(model_of(cube(0.5))).vertices
    np.testing.assert_allclose(normalize(model).vertices[:-4], want)
    alone = dataclasses.replace(
        model, faces=model.faces[-2:], uv=model.uv[-2:], normals=model.normals[-2:],
        face_material=model.face_material[-2:],
    )  # fmt: skip
    with pytest.raises(UnusableModelError, match="nothing of the surface exists"):
        normalize(alone)
    # Stripes, three times repeated and shifted: v from -1.4 to 1.6.
    texture[8:] = 255
    striped = dataclasses.replace(alone, materials=(Material(), Material(texture=texture)),
                                  uv=(alone.uv * 3 - [0, 1.4]).astype(np.float32))  # fmt: skip
    got = normalize(striped).vertices
    # It exists for v in [-1, -.5], [0, .5] and [1, 1.5]; one of v is a third of the height of 4.
    scale = np.ptp(got[:, 0]) / 4
    assert got[:, 2].min() == pytest.approx(-0.4 / 3 * 4 * scale, abs=0.005)


def test_normalize_refuses_what_overflows():
    with pytest.raises(UnusableModelError):
        normalize(dataclasses.replace(model_of(cube()), vertices=cube().vertices * 1e200))


def test_normalize_refuses_strays_by_name():
    far = solids.ball(0.1, 0.1, 0.1, 8).at(0, 20, 0.5)
    vertices, faces = joined(cube(), far)
    owner = (np.arange(len(faces)) >= 12).astype(int)
    materials = [Material(name="paint"), Material(name="marker")]
    model = build_model(vertices, faces, face_material=owner, materials=materials)
    with pytest.raises(UnusableModelError, match=r"stray part .*marker.*\(.*20, 0\.5.*empty"):
        normalize(model)
    # A pair of things half an extent apart is one object.
    pair = joined(cube(), cube().at(2.5, 0, 0))
    assert len(normalize(build_model(*pair)).faces) == 24


def test_a_railway_car_with_a_stray_sphere_is_refused():
    with pytest.raises(UnusableModelError, match="stray part"):
        free_meshes.model("ac3d", "Transport/ICE3firstcar.ac")


def test_samples_are_uniform_by_area():
    model = normalize(model_of(solids.box(4, 2, 1)))
    sample = sample_surface(model, 7000, 3)
    area = face_areas(model.vertices, model.faces)
    got = np.bincount(sample.face, minlength=len(area)) / 7000
    np.testing.assert_allclose(got, area / area.sum(), atol=2e-3)
    # Inside the faces, too: the centroid of a face's points is the face's.
    for face in range(len(area)):
        points = sample.points[sample.face == face]
        np.testing.assert_allclose(points.mean(0), model.corners()[face].mean(0), atol=0.08)
    np.testing.assert_allclose(np.linalg.norm(sample.normals, axis=1), 1, atol=1e-5)
    assert sample.points.dtype == sample.normals.dtype == np.float32


def test_samples_are_the_seeds():
    model = model_of(sphere())
    one, two, other = (sample_surface(model, 500, s) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.points, two.points)
    assert not np.array_equal(one.points, other.points)
    with pytest.raises(ValueError, match="number of points: got 0"):
        sample_surface(model, 0, 1)


def square(texture, opacity=1.0):
    """A unit square in the plane z = 0 whose texture covers it once."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return build_model(
        np.column_stack([corners, np.zeros(4)]), faces, uv=corners[faces],
        materials=[Material(texture=texture, opacity=opacity)],
    )  # fmt: skip


def test_no_points_in_the_holes_of_an_alpha_map():
    texture = np.full((8, 8, 4), 255, np.uint8)
    texture[:4, :, 3] = 0  # the upper half: v > 1/2
    texture[6:, :4, 3] = 10  # nearly clear: lower left
    sample = sample_surface(square(texture), 4000, 0)
    assert len(sample.points) == 4000
    assert sample.points[:, 1].max() <= 0.5
    left = sample.points[:, 0] < 0.5
    assert sample.points[left, 1].min() >= 0.25
    assert left.mean() == pytest.approx(1 / 3, abs=0.03)


def test_glass_has_points_and_a_clear_texture_has_none():
    texture = np.full((4, 4, 4), 255, np.uint8)
    assert len(sample_surface(square(texture, 0.3), 100, 0).points) == 100
    texture[..., 3] = 0
    with pytest.raises(UnusableModelError, match="hardly any"):
        sample_surface(square(texture), 100, 0)


def joined(*solids_):
    """One solid of several, as arrays."""
    sizes = np.cumsum([0, *(len(p.vertices) for p in solids_)])
    return (
        np.concatenate([p.vertices for p in solids_]),
        np.concatenate([p.faces + n for p, n in zip(solids_, sizes[:-1], strict=True)]),
    )


@pytest.mark.parametrize("back", [False, True])
def test_doubled_faces_have_one_density(back):
    # A box and, beside it, one with every face twice.
    here, there = solids.box(1, 1, 1), solids.box(1, 1, 1).at(1.5, 0, 0)
    vertices, faces = joined(here, there)
    again = faces[12:, ::-1] if back else faces[12:]
    model = normalize(build_model(vertices, np.concatenate([faces, again])))
    sample = sample_surface(model, 20_000, 0)
    right = (sample.points[:, 0] > 0).mean()
    assert right / (1 - right) == pytest.approx(1, abs=0.05)
    same = sample_surface(model, 20_000, 0)
    np.testing.assert_array_equal(same.points, sample.points)


def test_surfaces_that_lie_on_one_another_have_one_density():
    # The same square by two triangles, and turned over by a grid of many.
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 8)] * 2, [0.0], indexing="ij"), -1)
    index = np.arange(64).reshape(8, 8)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    many = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    square_ = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
    model = build_model(
        np.concatenate([square_, grid.reshape(-1, 3)]), np.concatenate([faces, many + 6])
    )
    sample = sample_surface(model, 20_000, 0)
    left = (sample.points[:, 0] < 1).mean()
    assert left / (1 - left) == pytest.approx(1, abs=0.05)


def test_a_hole_in_one_of_two_layers_shows_the_other():
    texture = np.full((4, 4, 4), 255, np.uint8)
    texture[:, :2, 3] = 0  # u < 1/2
    under = square(None)
    over = square(texture)
    model = build_model(
        np.concatenate([over.vertices, under.vertices]),
        np.concatenate([over.faces, under.faces + 4]),
        uv=np.concatenate([over.uv, under.uv]), face_material=np.array([0, 0, 1, 1]),
        materials=[*over.materials, *under.materials],
    )  # fmt: skip
    sample = sample_surface(model, 20_000, 0)
    left = (sample.points[:, 0] < 0.5).mean()
    assert left / (1 - left) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("case", ["doubled", "back first", "inside out", "open below"])
def test_normals_point_outward_where_the_mesh_can_tell(case):
    ball = solids.ball(2, 2, 2, 24)
    faces = ball.faces
    if case == "doubled":
        faces = np.concatenate([faces, faces[:, ::-1]])
    elif case == "back first":
        faces = np.concatenate([faces[:, ::-1], faces])
    elif case == "inside out":
        faces = faces[:, ::-1]
    else:
        faces = faces[ball.vertices[faces][..., 2].max(axis=1) > -0.8][:, ::-1]
    model = normalize(build_model(ball.vertices, faces))
    sample = sample_surface(model, 4000, 0)
    outward = sample.points - [0, 0, sample.points[:, 2].max() / 2]
    assert ((outward * sample.normals).sum(axis=1) > 0).mean() > 0.99


def test_an_inner_wall_keeps_its_normals():
    inner, outer = solids.ball(1.4, 1.4, 1.4, 24), solids.ball(2, 2, 2, 24)
    vertices, faces = joined(outer, inner)
    faces[len(outer.faces) :] = faces[len(outer.faces) :, ::-1]
    model = build_model(vertices, faces)
    sample = sample_surface(model, 4000, 0)
    toward = np.where(np.linalg.norm(sample.points, axis=1) > 0.85, 1, -1)
    assert ((sample.points * sample.normals).sum(axis=1) * toward > 0).all()


@pytest.mark.parametrize(
    "name", ["Reallusion/Reallusion#female01", "Scopia/Scopia#maceta", "Scopia/Scopia#little_lamp2"]
)
def test_furniture_with_doubled_faces_has_one_density(name):
    model = free_meshes.model("sh3f", name)
    sample = sample_surface(model, 16_384, 0)
    # Doubled or not, by exact geometry: the same corners again.
    key = np.sort(np.round(model.corners(), 5).view("f8,f8,f8").reshape(-1, 3), axis=1)
    _, number, count = np.unique(
        key.view(np.uint8).reshape(len(key), -1), axis=0, return_inverse=True, return_counts=True
    )
    twice = count[number.ravel()] > 1
    area = face_areas(model.vertices, model.faces)
    got = twice[sample.face].mean()
    once = area[~twice].sum()
    double = (area / count[number.ravel()])[twice].sum()
    assert double / (once + double) > 0.2
    ratio = (got / double) / ((1 - got) / once) if once > 0.05 * double else 1
    assert ratio == pytest.approx(1, abs=0.05)


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
    # Faces drawn apart by half a cell leak nothing.
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
    # A sheet on the border of two layers of cells is in one of them.
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
    with pytest.raises(UnusableModelError, match="too much to voxelise"):
        solid_occupancy(model, np.eye(3))


def test_ears_of_a_star():
    angle = np.arange(10) / 10 * 2 * np.pi
    star = (
        np.stack([np.cos(angle), np.sin(angle)], axis=1)
        * np.where(np.arange(10) % 2, 0.4, 1)[:, None]
    )
    triangles = star[cut_ears(star)]
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    assert (area > 0).all()
    x, y = star.T
    assert area.sum() == pytest.approx((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)
