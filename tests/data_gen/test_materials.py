import importlib.util
import pathlib

import numpy as np
import pytest

from data_gen import scene, shading
from data_gen.catalogues import procedural, solids
from data_gen.catalogues.families import materials, textures
from data_gen.catalogues.families.kit import Kit
from data_gen.catalogues.families.mapping import Fitted, Tiled, Wrapped
from data_gen.mesh import Material

_spec = importlib.util.spec_from_file_location(
    "rasteriser", pathlib.Path(__file__).with_name("rasteriser.py")
)
rasteriser = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(rasteriser)

TEXTURES = {
    **{f"wood {k}": (textures.wood, k) for k in ("straight", "cathedral", "planks", "veneer")},
    **{f"weave {k}": (textures.weave, k) for k in ("plain", "twill", "rib", "knit", "basket")},
    **{f"leather {k}": (textures.leather, k) for k in ("grained", "tufted")},
    **{f"metal {k}": (textures.metal, k)
       for k in ("brushed", "cast", "rusty", "plates", "tread", "mesh")},
    **{f"painted {k}": (textures.painted, k)
       for k in ("clean", "panels", "worn", "chipped", "brush")},
    **{f"stone {k}": (textures.stone, k)
       for k in ("marble", "granite", "concrete", "plaster", "cobbles")},
    **{f"masonry {k}": (textures.masonry, k)
       for k in ("brick", "blocks", "tiles", "roof", "shingles")},
    **{f"foliage {k}": (textures.foliage, k)
       for k in ("leaves", "grass", "bark", "soil", "fur", "straw")},
}  # fmt: skip
PICTURES = {
    **{f"screen {k}": (textures.screen, k) for k in textures.SCREENS},
    **{f"label {k}": (textures.label, k) for k in ("bottle", "box", "book", "clock", "plate")},
    **{f"facade {k}": (textures.facade, k) for k in ("office", "flats", "glass", "house")},
}
COLOURS = [(0.8, 0.8, 0.7), (0.5, 0.1, 0.1), (0.2, 0.3, 0.2), (0.8, 0.6, 0.2)]


def kit(seed=0):
    return Kit(np.random.default_rng(seed), np.random.default_rng(seed))


@pytest.mark.parametrize("name", [*TEXTURES, *PICTURES])
def test_textures_are_small_images_that_differ_by_variant(name):
    function, kind = {**TEXTURES, **PICTURES}[name]
    images = [function(kind, v) for v in (0, 1, 2, 3)]
    assert images[0] is function(kind, 0)  # cached
    for image in images:
        assert image.dtype == np.uint8
        assert image.shape[2] == 4
        assert 32 <= min(image.shape[:2]) <= max(image.shape[:2]) <= 256
        assert not image.flags.writeable
        assert (image[..., 3] == 255).all()
        # Regular and nearly uniform patterns have a visible contrast, too.
        assert image[..., :3].std() > 1.5
    if name not in ("metal tread", "metal mesh"):
        assert any(not np.array_equal(images[0], image) for image in images[1:])


@pytest.mark.parametrize("name", TEXTURES)
def test_shades_tile_without_a_seam(name):
    function, kind = TEXTURES[name]
    image = function(kind, 0)[..., :3].mean(axis=2)
    for axis in (0, 1):
        step = np.abs(np.diff(image, axis=axis)).mean(axis=1 - axis)
        seam = np.abs(np.take(image, 0, axis) - np.take(image, -1, axis)).mean()
        assert seam <= step.max() + 1


@pytest.mark.parametrize("kind", textures.PATTERNS)
def test_patterns_have_the_colours_that_are_given(kind):
    image = textures.pattern(kind, 1, COLOURS)
    ground = np.rint(255 * np.array(COLOURS[0])).astype(int)
    near = np.abs(image[..., :3].astype(int) - ground).max(axis=2) < 30
    assert near.mean() > 0.05
    assert len(np.unique(image.reshape(-1, 4), axis=0)) >= 2


def test_shaded_materials_have_the_mean_colour_asked_for():
    texture = textures.wood("planks", 2)
    material = materials.shaded((0.5, 0.3, 0.2), texture, Tiled())
    mean = textures.mean_colour(texture) * material.diffuse
    np.testing.assert_allclose(mean, (0.5, 0.3, 0.2), atol=0.01)


def test_hues_follow_the_distribution():
    rng = np.random.default_rng(0)
    colours = np.array([materials.lively(rng) for _ in range(4000)])
    red, green, blue = colours.T
    assert (colours.max(axis=1) - colours.min(axis=1) > 0.1).all()
    warm = (red > blue) & (red >= green)
    purple = (green < 0.7 * blue) & (green < 0.7 * red) & (blue > 0.6 * red)
    assert 0.55 < warm.mean() < 0.8
    assert purple.mean() < 0.1


USUAL = ("wood", "metal", "paint", "lacquer", "fabric", "plastic", "screen", "stone", "masonry",
         "ceramic", "fur", "plating", "ground", "camouflage")  # fmt: skip


@pytest.mark.parametrize("name", USUAL)
def test_materials_have_textures_and_repeat(name):
    function = getattr(materials, name)
    drawn = [function(np.random.default_rng(s)) for s in range(16)]
    again = [function(np.random.default_rng(s)) for s in range(16)]
    for a, b in zip(drawn, again, strict=True):
        assert a.diffuse == b.diffuse
        np.testing.assert_array_equal(a.texture, b.texture)
    assert sum(m.texture is not None for m in drawn) >= 8
    assert len({m.diffuse for m in drawn} | {id(m.texture) for m in drawn}) > 4


def test_textures_are_no_finer_than_the_pixels():
    for seed in range(40):
        for name in ("wood", "fabric", "paint", "metal"):
            material = getattr(materials, name)(np.random.default_rng(seed))
            if isinstance(getattr(material, "mapping", None), Tiled):
                density = material.texture.shape[1] / material.mapping.tile
                assert density <= textures.TEXELS_PER_RADIUS + 1e-6


# --- Mappings -------------------------------------------------------------------------------------

# Upper row: red, green. Lower row: blue, white.
QUARTERS = np.full((2, 2, 4), 255, np.uint8)
QUARTERS[0, 0, 1:3], QUARTERS[0, 1, [0, 2]], QUARTERS[1, 0, :2] = 0, 0, 0


def colour_at(model, point, direction):
    """The texture's colour where a ray from `point` in `direction` enters a model."""
    surfaces = scene.flatten(model)
    corners = surfaces.corners.astype(float)
    facing = surfaces.face_normals @ np.asarray(direction) < 0
    best, found = np.inf, None
    for face in np.flatnonzero(facing):
        a, b, c = corners[face]
        matrix = np.stack([b - a, c - a, -np.asarray(direction, float)], axis=1)
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        one, two, t = np.linalg.solve(matrix, np.asarray(point, float) - a)
        if min(one, two, 1 - one - two) >= -1e-9 and t < best:
            best, found = t, (face, one, two)
    face, one, two = found
    weights = np.array([[1 - one - two, one, two]], np.float32)
    colour, _ = shading.look_up(surfaces, np.array([face]), weights)
    return tuple(np.rint(colour[0]).astype(int))


RED, GREEN, BLUE, WHITE = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)


@pytest.mark.parametrize(
    ("direction", "right", "up"),
    [
        ((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((1, 0, 0), (0, -1, 0), (0, 0, 1)),
        ((0, -1, 0), (-1, 0, 0), (0, 0, 1)),
        ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
        ((0, 0, -1), (0, 1, 0), (-1, 0, 0)),
    ],
)
def test_a_fitted_picture_stands_upright_on_every_side(direction, right, up):
    one = kit()
    one.add(materials.pictured(QUARTERS, Fitted()), solids.box(1, 2, 3))
    model = one.model("x", "x", {})
    middle = np.array([0, 0, model.vertices[:, 2].max() / 2])
    away = -5 * np.array(direction, float)
    for (a, b), expected in {(-1, 1): RED, (1, 1): GREEN, (-1, -1): BLUE, (1, -1): WHITE}.items():
        point = middle + away + 0.1 * a * np.array(right) + 0.1 * b * np.array(up)
        assert colour_at(model, point, direction) == expected


def test_a_part_can_set_its_own_mapping():
    one = kit()
    material = materials.pictured(QUARTERS, Tiled(0.5))
    one.add(material, solids.box(1, 1, 1))
    one.add(material, solids.box(1, 1, 1).at(x=2), uv=Fitted((2, 3)))
    uv = one.model("x", "x", {}).uv
    first, second = uv[:12], uv[12:]
    assert np.ptp(second[..., 0]) == pytest.approx(2, rel=0.02)
    assert np.ptp(second[..., 1]) == pytest.approx(3, rel=0.02)
    assert not np.allclose(first, second)


def test_tiles_have_the_same_size_on_all_sides_and_any_model():
    for size in (1.0, 40.0):
        one = kit()
        one.add(
            materials.shaded((0.5,) * 3, QUARTERS, Tiled(0.25)), solids.box(size, 2 * size, size)
        )
        model = one.model("x", "x", {})
        edge = np.roll(model.corners(), -1, axis=1) - model.corners()
        uv_edge = np.roll(model.uv, -1, axis=1) - model.uv
        ratio = np.linalg.norm(uv_edge, axis=2) / np.linalg.norm(edge, axis=2)
        np.testing.assert_allclose(ratio, 4, rtol=1e-4)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_grain_runs_along_the_part(axis):
    lengths = np.ones(3)
    lengths[axis] = 6
    one = kit()
    one.add(materials.shaded((0.5,) * 3, QUARTERS, Tiled(1.0, along_grain=True)),
            solids.box(*lengths), solids.box(2, 2, 0.1).at(z=9))  # fmt: skip
    model = one.model("x", "x", {})
    edge = (np.roll(model.corners(), -1, axis=1) - model.corners())[:12]
    uv_edge = (np.roll(model.uv, -1, axis=1) - model.uv)[:12]
    along = np.abs(edge[..., axis]) > 0.999 * np.linalg.norm(edge, axis=2)
    assert along.sum() >= 8
    np.testing.assert_allclose(np.abs(uv_edge[along][:, 1]), 0, atol=1e-5)


def test_a_wrapped_label_has_no_face_across_its_seam():
    one = kit()
    one.add(materials.pictured(QUARTERS, Wrapped((1, 1.0))), solids.cylinder(1, 2, 24))
    model = one.model("x", "x", {})
    side = np.abs(model.normals[:, 0, 2]) < 0.5
    assert np.ptp(model.uv[side][..., 0], axis=1).max() < 0.06
    # Its middle is at +x, and it is not mirrored.
    low = model.vertices[:, 2].max() * 0.25
    assert colour_at(model, (5, 0.05, low), (-1, 0, 0)) == WHITE
    assert colour_at(model, (5, -0.05, low), (-1, 0, 0)) == BLUE


def test_models_without_textures_have_no_coordinates():
    one = kit()
    one.add(Material((0.5, 0.5, 0.5)), solids.box(1, 1, 1))
    assert not one.model("x", "x", {}).uv.any()


# --- Textures and what is hidden ------------------------------------------------------------------


@pytest.mark.parametrize("category", procedural.CATEGORIES)
def test_textures_tell_nothing_of_what_is_hidden(category):
    for seed in (0, 3):
        models = [procedural.generate(category, seed, hidden_seed=h) for h in (1, 2)]
        low, high = models[0].parameters["hidden_azimuth"][0]
        seen = [
            rasteriser.texture_coordinates(m, (low + high) / 2 + 0.31, elevation=20.0)
            for m in models
        ]
        assert (seen[0] != 0).any() or all(m.texture is None for m in models[0].materials)
        np.testing.assert_allclose(*seen, atol=1e-5)


# --- The extra families ---------------------------------------------------------------------------

EXTRA = pytest.mark.parametrize("category", procedural.EXTRA_CATEGORIES)


def faults(solid):
    """The reasons why a surface is not closed or does not face outward."""
    vertices, faces = solid
    # Tips are rings of radius 0. They count as one vertex; `build_model` drops their empty faces.
    _, first, place = np.unique(
        vertices.round(9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    faces = first[place.reshape(-1)][faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    edge = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    forward, back = edge @ [len(vertices), 1], edge @ [1, len(vertices)]
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    return [
        name
        for name, wrong in (
            ("an edge is used twice in one direction", len(np.unique(forward)) < len(forward)),
            ("the surface is open", not np.isin(back, forward).all()),
            ("the surface is inside out", (np.cross(a, b) * c).sum() <= 0),
        )
        if wrong
    ]


@EXTRA
def test_extra_models_are_sound(category):
    kinds, textured = set(), 0
    for seed in range(12):
        model = procedural.generate(category, seed)
        kinds.add(model.parameters["subtype"])
        assert (model.category, model.model_id) == (category, f"{category}-{seed}")
        assert model.warnings == ()
        assert 20 < len(model.faces) < 20_000
        textured += any(m.texture is not None for m in model.materials)
        assert np.isfinite(model.uv).all()
        np.testing.assert_allclose(np.linalg.norm(model.vertices, axis=1).max(), 1)
        assert model.vertices[:, 2].min() == pytest.approx(0, abs=1e-12)
        assert model.parameters["hidden"] == {}
    assert len(kinds) >= 4, kinds
    assert textured >= 6


@EXTRA
def test_extra_parts_are_closed_and_face_outward(category):
    for seed in range(4):
        made = kit(seed)
        procedural.EXTRA_FAMILIES[category](made)
        found = {fault for solid in made.solids() for fault in faults(solid)}
        assert not found, (made.visible["subtype"], found)


def test_some_extra_models_have_no_colours():
    plain = [m for m in (procedural.generate("cup", s) for s in range(40)) if m.parameters["plain"]]
    assert 2 <= len(plain) <= 14
    for model in plain:
        (material,) = model.materials
        assert (material.name, material.texture) == ("plain", None)
        assert len(set(material.diffuse)) == 1


def test_extra_models_repeat_and_differ():
    for category in procedural.EXTRA_CATEGORIES[::5]:
        one, two = procedural.generate(category, 4), procedural.generate(category, 4)
        np.testing.assert_array_equal(one.vertices, two.vertices)
        np.testing.assert_array_equal(one.uv, two.uv)
        assert one.parameters == two.parameters
        assert one.parameters != procedural.generate(category, 5).parameters
