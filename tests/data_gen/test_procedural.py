import numpy as np
import pytest
from helpers.refusals import all_refused

from data_gen.catalogues import procedural, shapes
from data_gen.catalogues.families import kit, materials
from data_gen.catalogues.open_catalogue import open_catalogue
from data_gen.mesh import face_normals, weld

EVERY = pytest.mark.parametrize("category", procedural.FAMILIES)


@EVERY
def test_models_are_sound_and_varied(category):
    models = [procedural.generate(category, seed) for seed in range(12)]
    for model in models:
        assert model.warnings == ()
        assert 30 < len(model.faces) < 12_000
        assert np.linalg.norm(model.vertices, axis=1).max() == pytest.approx(1)
        assert model.vertices[:, 2].min() == 0
        facing = face_normals(model.vertices, model.faces)
        assert (model.normals * facing[:, None]).sum(axis=2).min() > -0.2
        assert np.isfinite(model.uv).all()
    assert len({m.parameters["kind"] for m in models}) >= 3
    size = np.array([np.ptp(m.vertices, axis=0) for m in models])
    # The ratios of the sides of the bounding boxes differ by a fifth or more.
    ratios = np.log(size[:, [0, 2]] / size[:, 1:2])
    assert ratios.std(axis=0).max() > 0.2
    assert len({m.materials[0].diffuse for m in models}) > 6


@EVERY
def test_every_part_is_closed_and_faces_outward(category):
    build, kinds = procedural.FAMILIES[category]
    for kind in dict.fromkeys(kinds):
        builder = kit.Kit(np.random.default_rng(len(kind)))
        build(builder, kind)
        for (vertices, faces), _ in builder.parts:
            assert np.linalg.det(vertices[faces]).sum() > 0  # the volume
            # Tips are rings of radius 0, which count as one vertex.
            faces = weld(vertices.round(9))[faces]
            faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
            start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
            size = len(vertices)
            # Every edge is used once in each direction.
            np.testing.assert_array_equal(np.sort(start * size + end), np.sort(end * size + start))


def test_the_catalogue_lists_its_models_and_errors_name_the_value():
    table = (
        ("x", "source 'x'"), ("sofa=3", "'sofa'", "couch"), ("chair=-1", "source 'chair=-1'"),
        ("chair=5,chair=2", "source 'chair=5,chair=2'"), ("2000000", "1000000"),
    )  # fmt: skip
    all_refused(lambda source: open_catalogue("procedural", source), ValueError, table)
    entries = open_catalogue("procedural", "200").models
    assert len({e.model_id for e in entries}) == len(entries) == 13 * 200
    assert {e.category for e in entries[:13]} == set(procedural.FAMILIES)
    train = np.mean([e.split == "train" for e in entries])
    assert train == pytest.approx(0.8, abs=0.03)
    some = list(open_catalogue("procedural", "chair=3, lamp=1", first_seed=5).models)
    assert [e.model_id for e in some] == ["chair-5", "lamp-5", "chair-6", "chair-7"]
    splits = {e.model_id: e.split for e in entries}
    assert all(e.split == splits[e.model_id] for e in some)
    assert some[0].load().parameters["seed"] == 5


def test_a_screen_is_upright_for_a_viewer_in_front():
    image = np.full((4, 4, 4), 255, np.uint8)
    builder = kit.Kit(np.random.default_rng(0))
    builder.add(materials.Textured(texture=image, tile=0.0), shapes.box(0.02, 2, 1))
    model = builder.model()
    front = face_normals(model.vertices, model.faces)[:, 0] > 0.9
    corners, uv = model.corners()[front].reshape(-1, 3), model.uv[front].reshape(-1, 2)
    # Seen from +x, +y is to the right and z is up.
    for axis in (0, 1):
        assert np.corrcoef(corners[:, 1 + axis], uv[:, axis])[0, 1] > 0.99
