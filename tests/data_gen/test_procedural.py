import importlib.util
import itertools
import pathlib

import numpy as np
import pytest

from data_gen.catalogues import bodies, procedural, solids
from data_gen.catalogues.by_name import open_catalogue
from data_gen.catalogues.families import (
    bench,
    cabinet,
    cellphone,
    chair,
    couch,
    lamp,
    monitor,
    speaker,
    table,
)
from data_gen.catalogues.families.kit import Kit
from data_gen.mesh import face_normals
from data_gen.surface import sample_surface
from data_gen.voxelise import solid_occupancy

_spec = importlib.util.spec_from_file_location(
    "rasteriser", pathlib.Path(__file__).with_name("rasteriser.py")
)
rasteriser = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(rasteriser)

EVERY = pytest.mark.parametrize("category", procedural.CATEGORIES)


def test_the_categories_are_the_papers():
    assert len(procedural.CATEGORIES) == 13


@EVERY
def test_models_are_sound(category):
    for seed in range(8):
        model = procedural.generate(category, seed)
        assert model.category == category
        assert model.model_id == f"{category}-{seed}"
        assert model.warnings == ()
        assert 100 < len(model.faces) < 20_000
        assert len(model.materials) >= 2 or category in (
            "bench",
            "couch",
            "chair",
            "table",
            "cabinet",
        )
        np.testing.assert_allclose(np.linalg.norm(model.vertices, axis=1).max(), 1)
        assert model.vertices[:, 2].min() == 0
        np.testing.assert_allclose(np.linalg.norm(model.normals, axis=2), 1, atol=1e-4)
        facing = face_normals(model.vertices, model.faces)
        assert (model.normals * facing[:, None]).sum(axis=2).min() > -0.2
        sample = sample_surface(model, 500, 0)
        assert np.isfinite(sample.points).all()
        assert model.parameters["hidden"]
        assert model.parameters["hidden_azimuth"]


def test_a_glass_table_has_its_glass():
    model = next(
        m for m in (procedural.generate("table", s) for s in range(20))
        if m.parameters.get("glass_top")
    )  # fmt: skip
    (index,) = [k for k, m in enumerate(model.materials) if m.name == "glass"]
    top = model.vertices[model.faces[model.face_material == index]]
    np.testing.assert_allclose(top[..., 2].max(), model.vertices[:, 2].max())


@EVERY
def test_same_seed_same_model_and_every_seed_another(category):
    one, two = procedural.generate(category, 7), procedural.generate(category, 7)
    np.testing.assert_array_equal(one.vertices, two.vertices)
    np.testing.assert_array_equal(one.normals, two.normals)
    assert one.parameters == two.parameters
    assert one.parameters != procedural.generate(category, 8).parameters


@EVERY
def test_several_subtypes(category):
    kinds = {procedural.generate(category, s).parameters["subtype"] for s in range(16)}
    assert len(kinds) >= 4, kinds


FURNITURE = (table, couch, chair, bench, cabinet, lamp, monitor, speaker, cellphone)


def _name_of(module):
    return module.__name__.rpartition(".")[2]


def _extremes_of_kind(module, kind, seed):
    """Two models of a subtype: with the lowest and the highest values of hidden parameters."""
    spans = {}
    for end in (None, 0, 1):
        hidden = {k: (s.low, s.high - s.whole)[end or 0] for k, s in spans.items()}
        kit = Kit(np.random.default_rng([seed, 1]), np.random.default_rng(2), hidden)
        module.KINDS[kind](kit)
        spans = kit.ranges
        if end is not None:
            yield kit.model(_name_of(module), f"{kind}-{seed}", {})


def _pictures(model, azimuth):
    """Depth and material [48, 64], seen from the smallest promised distance and elevation."""
    return rasteriser.inverse_depth(
        model, azimuth, distance=2.5, elevation=15.0, size=(48, 64), focal=74.0
    )


@pytest.mark.parametrize("module", FURNITURE, ids=_name_of)
def test_every_kind_keeps_the_contract_of_hidden_parameters(module):
    assert len(module.KINDS) >= 9
    for number, kind in enumerate(module.KINDS):
        one, other = _extremes_of_kind(module, kind, number)
        assert one.warnings == ()
        assert 100 < len(one.faces) < 20_000, kind
        assert one.parameters["hidden"], kind
        assert one.parameters["hidden"] != other.parameters["hidden"], kind
        np.testing.assert_allclose(one.vertices.min(0), other.vertices.min(0), atol=1e-9)
        np.testing.assert_allclose(one.vertices.max(0), other.vertices.max(0), atol=1e-9)
        low, high = one.parameters["hidden_azimuth"][0]
        azimuth = (low, high)[number % 2] if high - low < 360 else 60.0 * number
        (depth, material), (other_depth, other_material) = (
            _pictures(m, azimuth) for m in (one, other)
        )
        np.testing.assert_allclose(depth, other_depth, atol=1e-7, err_msg=kind)
        np.testing.assert_array_equal(material, other_material, err_msg=kind)


@pytest.mark.parametrize("category", procedural.OPEN_BACKS)
def test_backs_are_closed(category):
    for seed in range(10):
        models = [procedural.generate(category, seed, hidden_seed=h) for h in (1, 2)]
        if models[0].parameters.get("pose") in ("lying", "sideways"):
            continue  # the socket in the lower end is visible
        for azimuth in (180.0, 120.0 if seed % 2 else -120.0):
            pictures = [_pictures(m, azimuth) for m in models]
            np.testing.assert_allclose(pictures[0][0], pictures[1][0], atol=1e-7)
            np.testing.assert_array_equal(pictures[0][1], pictures[1][1])


@pytest.mark.parametrize(("category", "kind"), [("speaker", "bookshelf"), ("cabinet", "wardrobe")])
def test_a_box_is_solid_from_front_to_back(category, kind):
    models = (procedural.generate(category, seed) for seed in range(200))
    for model in itertools.islice((m for m in models if m.parameters["subtype"] == kind), 5):
        length = np.ptp(model.vertices[:, 0])
        reach = []
        for azimuth in (0.0, 180.0):
            inverse, _ = rasteriser.inverse_depth(
                model, azimuth, distance=8.0, elevation=0.0, size=(48, 64), focal=200.0
            )
            middle = inverse[:, 29:35]
            reach.append(np.median(8 - 1 / middle[middle > 0]))  # from the origin to the camera
        # Less than the whole length, because a cornice or a grille may extend beyond the box.
        assert sum(reach) > 0.75 * length


@pytest.mark.parametrize("category", procedural.OPEN_BACKS)
def test_backs_are_open_where_a_study_asks(category):
    for seed in range(4):
        models = [
            procedural.generate(category, seed, hidden_seed=h, open_back=True) for h in (1, 2)
        ]
        assert models[0].model_id == f"{category}-{seed}-open-h1"
        assert list(models[0].parameters["hidden"]) == ["back_recess"]
        (low, high) = models[0].parameters["hidden_azimuth"][0]
        for azimuth in (low, 0.0, high):
            one, other = (_pictures(m, azimuth)[0] for m in models)
            np.testing.assert_allclose(one, other, atol=1e-7)
        one, other = (_pictures(m, 180.0)[0] for m in models)
        assert (np.abs(one - other) > 1e-4).sum() > 10
        again = procedural.redraw_hidden(models[0], 2)
        assert again.model_id == models[1].model_id
        np.testing.assert_array_equal(again.vertices, models[1].vertices)


def test_the_catalogue_of_open_backs():
    catalogue = open_catalogue("procedural", "2", open_backs=True, hidden_draws=2)
    entries = list(catalogue.entries())
    assert len(entries) == len(catalogue) == 2 * 2 * len(procedural.OPEN_BACKS)
    assert entries[0].model_id == entries[0].load().model_id == "cabinet-0-open-h0"
    closed = {e.model_id: e.split for e in open_catalogue("procedural", "2").entries()}
    assert all(closed[e.model_id.partition("-open")[0]] == e.split for e in entries)
    with pytest.raises(ValueError, match="category 'chair': expected one of"):
        open_catalogue("procedural", "chair=1", open_backs=True)
    with pytest.raises(ValueError, match="for an open back"):
        procedural.generate("chair", 0, open_back=True)
    with pytest.raises(ValueError, match="name of a procedural model"):
        procedural.redraw_hidden("chair-1-open")


@EVERY
def test_hidden_parameters_cannot_be_seen_and_matter(category):
    for seed in range(2):
        models = [procedural.generate(category, seed, hidden_seed=h) for h in (1, 2)]
        ranges = models[0].parameters["hidden_azimuth"]
        assert models[0].parameters["hidden"] != models[1].parameters["hidden"]
        visible = [
            {k: v for k, v in m.parameters.items() if k not in ("hidden", "hidden_seed")}
            for m in models
        ]
        assert visible[0] == visible[1]
        np.testing.assert_allclose(
            *(np.stack([m.vertices.min(0), m.vertices.max(0)]) for m in models), atol=1e-9
        )
        low, high = ranges[seed % len(ranges)]
        # The ends of the range, from the smallest promised distance and elevation.
        for azimuth in (low, high) if high - low < 360 else (-60.0, 120.0):
            (depth, material), (other_depth, other_material) = (
                rasteriser.inverse_depth(
                    m, azimuth, distance=2.5, elevation=15.0, size=(72, 96), focal=110.0
                )
                for m in models
            )
            assert (depth > 0).sum() > 100
            np.testing.assert_allclose(depth, other_depth, atol=1e-7)
            np.testing.assert_array_equal(material, other_material)
        # The geometry differs.
        clouds = [sample_surface(m, 4000, 0).points for m in models]
        assert len(models[0].faces) != len(models[1].faces) or not np.array_equal(*clouds)


@pytest.mark.parametrize("category", ["plane", "bench", "firearm", "watercraft"])
def test_the_authors_camera_sees_nothing_of_what_is_hidden(category):
    # At full size, from the ends of the ranges, where hidden parts would become visible first.
    models = [procedural.redraw_hidden(f"{category}-0", h) for h in (1, 2)]
    for azimuth in models[0].parameters["hidden_azimuth"][0]:
        one, two = (
            rasteriser.inverse_depth(m, azimuth, size=(192, 256), focal=400.0) for m in models
        )
        changed = (np.abs(one[0] - two[0]) > 1e-6) | (one[1] != two[1])
        assert changed.sum() <= 2


@pytest.mark.parametrize(("name", "azimuth"), [("plane-48", 156.0), ("watercraft-5", 180.0)])
def test_nobody_looks_into_the_underside_from_behind(name, azimuth):
    models = []
    for end in ("low", "high"):
        ranges = procedural.hidden_ranges(name)
        values = {key: getattr(span, end) for key, span in ranges.items()}
        models.append(procedural.redraw_hidden(name, values=values))
    one, two = (
        rasteriser.inverse_depth(
            m, azimuth, distance=2.5, elevation=15.0, size=(72, 96), focal=110.0
        )
        for m in models
    )
    np.testing.assert_array_equal(one[0], two[0])


def test_hidden_seed_defaults_to_the_seed():
    one, two = procedural.generate("chair", 3), procedural.generate("chair", 3, hidden_seed=3)
    np.testing.assert_array_equal(one.vertices, two.vertices)
    assert two.model_id == "chair-3-h3"


@EVERY
def test_hidden_parameters_are_drawn_from_their_ranges(category):
    name = f"{category}-5"
    ranges = procedural.hidden_ranges(name)
    draws = [procedural.redraw_hidden(name, h) for h in range(8)]
    assert all(list(m.parameters["hidden"]) == list(ranges) for m in draws)
    for key, span in ranges.items():
        values = np.array([m.parameters["hidden"][key] for m in draws])
        assert span.low <= values.min() < values.max() <= span.high
        # The probability that 8 draws lie within one quarter of the range is 1 in 65536.
        assert np.ptp(values) > 0.25 * (span.high - span.low - span.whole)


def test_redrawn_models_are_those_of_the_catalogue():
    entries = list(open_catalogue("procedural", "bench=2", hidden_draws=2).entries())
    for entry, hidden in zip(entries, (0, 1, 0, 1), strict=True):
        for name in (entry, entry.model_id, entry.load(), entry.model_id.split("-h")[0]):
            model = procedural.redraw_hidden(name, hidden)
            assert model.model_id == entry.model_id
            np.testing.assert_array_equal(model.vertices, entry.load().vertices)
            assert model.parameters == entry.load().parameters


def test_hidden_parameters_can_be_set():
    found = {}
    for low in (False, True):
        ranges = procedural.hidden_ranges("cabinet-5-open")
        values = {k: (r.low if low else r.high) for k, r in ranges.items()}
        found[low] = procedural.redraw_hidden("cabinet-5-open", 3, values=values)
        assert found[low].parameters["hidden"] == values
        assert found[low].model_id == "cabinet-5-open-h3-set"
    one, two = (solid_occupancy(m, np.eye(3)).sum() for m in found.values())
    assert one < two  # a deep recess leaves less
    (name,) = list(ranges)[:1]
    for wrong, match in (({name: 9.0}, f"hidden {name}: got 9"), ({"a": 1.0}, "hidden 'a'")):
        with pytest.raises(ValueError, match=match):
            procedural.redraw_hidden("cabinet-5-open", values=wrong)
    bench = next(
        f"bench-{s}" for s in range(30) if "supports" in procedural.hidden_ranges(f"bench-{s}")
    )
    counts = [len(procedural.redraw_hidden(bench, values={"supports": n}).faces) for n in range(4)]
    assert len(set(np.diff(counts))) == 1
    for wrong in (4, 1.5, -1):
        with pytest.raises(ValueError, match="hidden supports"):
            procedural.redraw_hidden(bench, values={"supports": wrong})
    for name in ("sofa-1", "chair", "chair-1-x", "lib/chair-1"):
        with pytest.raises(ValueError, match="name of a procedural model"):
            procedural.redraw_hidden(name)


def test_wrong_arguments():
    with pytest.raises(ValueError, match="category 'sofa': expected one of"):
        procedural.generate("sofa", 0)
    for wrong in ("1000000000000", "chair=1000001", "9" * 30):
        with pytest.raises(ValueError, match="expected at most 1000000 models in all"):
            open_catalogue("procedural", wrong)
    with pytest.raises(ValueError, match="seed: got -1"):
        procedural.generate("chair", -1)


PARTS = {
    "box": solids.box(1, 2, 3),
    "bevelled": solids.box(1, 2, 3, 0.1),
    "pillow": solids.pillow(1, 2, 3, 0.3),
    "cylinder": solids.cylinder(1, 2, 40),
    "ball": solids.ball(1, 2, 3, 40),
    "ring": solids.lathe([(1, 0), (2, 0), (2, 1), (1, 1)], 40, loop=True),
    "rod": solids.rod((0, 0, 0), (1, 2, 3), 0.1),
    "tube": solids.tube(solids.smooth_path([(0, 0, 0), (1, 0, 1), (1, 1, 2)]), 0.1),
    "prism": solids.prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 0.5),
    "star prism": solids.prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 0.5, 0.05),
    "tray": solids.tray(lambda d: solids.rounded(2 - 2 * d, 1 - 2 * d, 0.2), 0.3, 0.1, 0.2),
    "body": bodies.body([(2, 0.1, 0.1, 0, 2), (1, 1, 0.8, 0.2, 3), (-1, 1, 1, 0, 4)]),
    "sheet": solids.sheet(np.stack([*np.mgrid[:3.0, :4.0], np.zeros((3, 4))], axis=-1), 0.1),
    "pane": solids.pane(np.stack([*np.mgrid[:3.0, :4.0], np.zeros((3, 4))], axis=-1), 0.1),
    "wing": bodies.wing([(0, 0, 0, 2), (-1, 3, 0.2, 1)]),
    "round wing": bodies.wing([(0, 0, 0, 2), (-1, 3, 0.2, 1), (-2, 4, 0, 0.5)], steps=3),
    "fin": bodies.wing([(0, 0, 0, 2), (-1, 0.3, 3, 1)], fin=True),
    "mirrored": solids.box(1, 2, 3).mirrored(),
    "turned": solids.prism([(0, 0), (2, 0), (0, 1)], 0.5).turned("x", 50).turned("z", 200),
    "cushion": solids.cushion(1, 2, 0.5),
    "sweep": solids.sweep(
        solids.rounded(0.2, 0.1, 0.03), [(0, 0, 0), (1, 0, 0), (1, 0, 1)], (0, 1, 0)
    ),
    "hoop": solids.sweep(
        solids.rounded(0.2, 0.1, 0.03), [(0, 0, 0), (1, 0, 0), (1, 0, 1)], (0, 1, 0), loop=True
    ),
    "curved sheet": solids.sheet(
        np.array([[(v, np.cos(u), np.sin(u)) for u in np.linspace(0, 4, 9)] for v in (0, 1)]), 0.1
    ),
    "smooth profile": solids.lathe(solids.smooth_profile([(0.5, 0), (1, 1), (0.2, 2)])),
}  # fmt: skip


@pytest.mark.parametrize("name", PARTS)
def test_parts_are_closed_and_face_outward(name):
    vertices, faces = PARTS[name]
    # Tips are rings of radius 0. They count as one vertex; `build_model` drops their empty faces.
    _, first, place = np.unique(
        vertices.round(9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    faces = first[place.reshape(-1)][faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    directed = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    forward = {tuple(e) for e in directed.tolist()}
    assert len(forward) == len(directed), "an edge is used twice in one direction"
    assert {(b, a) for a, b in forward} == forward, "the surface is open"
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = (np.cross(a, b) * c).sum() / 6
    assert volume > 0
    if name in ("box", "mirrored"):
        assert volume == pytest.approx(6)
    if name == "ball":
        assert volume == pytest.approx(np.pi, rel=0.03)
    if name == "ring":
        assert volume == pytest.approx(3 * np.pi, rel=0.01)
    if name == "prism":
        assert volume == pytest.approx(1.5)
    if name in ("sheet", "pane"):
        assert volume == pytest.approx(0.1 * 3 * 2)
    if name == "cushion":
        assert 0.65 < volume < 0.75


def test_curves_pass_through_their_points_and_do_not_overshoot():
    table = [(3, 1, 0.0), (2, 1, 5), (1, 0, 5), (-1, 0, 5)]
    places = bodies.between([row[0] for row in table], 8)
    assert len(places) == 25
    np.testing.assert_allclose(bodies.through(table, places)[::8], [row[1:] for row in table])
    one, two = bodies.through(table, places).T
    assert one.min() == 0
    assert one.max() == 1
    assert two.max() == 5
    assert (np.diff(one) <= 0).all()
    np.testing.assert_array_equal(bodies.through(table, np.array([-9.0])), [[0, 5]])
    np.testing.assert_allclose(bodies.through([(0, 2), (2, 4)], np.array([0.5])), [[2.5]])


def test_superellipses_go_from_diamonds_to_boxes():
    for power, area in ((1, 2 * 3 * 4 / 4), (2, np.pi * 3), (40, 4 * 3)):
        x, y = solids.superellipse(4, 3, power, 400).T
        found = abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
        assert found == pytest.approx(area, rel=0.02)
    np.testing.assert_allclose(np.ptp(solids.superellipse(4, 3, 3.0), axis=0), [4, 3])


def test_a_split_solid_keeps_all_faces():
    whole = solids.box(1, 2, 3)
    chosen = np.arange(len(whole.faces)) % 3 == 0
    one, two = solids.split(whole, chosen)
    assert (len(one.faces), len(two.faces)) == (chosen.sum(), (~chosen).sum())
    np.testing.assert_array_equal(one.faces, whole.faces[chosen])


@pytest.mark.parametrize(
    ("category", "kinds"), [("car", 15), ("plane", 12), ("watercraft", 12), ("firearm", 10)]
)
def test_vehicles_differ_in_kind(category, kinds):
    models = [procedural.generate(category, s) for s in range(60)]
    assert len({m.parameters["subtype"] for m in models}) >= kinds
    size = np.array([np.ptp(m.vertices, axis=0) for m in models])
    # The proportions of length, width and height vary, not only the colours.
    for ratio in (size[:, 1] / size[:, 0], size[:, 2] / size[:, 0]):
        assert np.percentile(ratio, 90) > 1.3 * np.percentile(ratio, 10)
