import dataclasses

import numpy as np
import pytest
from helpers import drawn_solids as solids

from data_gen import settings
from data_gen.catalogues.open_catalogue import open_catalogue, parse_options
from data_gen.catalogues.records import surfels
from data_gen.engine import Variant
from data_gen.mesh import UnusableModelError, face_areas
from data_gen.render_model import Context
from psgn_jax.data.codec import decode
from psgn_jax.data.dataset import write_dataset


def box_sample(num_points=4000, model_id="a box"):
    """A box that fits into the unit hemisphere."""
    rng, box = np.random.default_rng(0), solids.box(np.array([0.3, 0.45, 0.25]))
    return solids.draw(box, rng, num_points=num_points, model_id=model_id)


def test_the_surfels_cover_the_surface():
    sample = box_sample(16384)
    model = surfels(sample)
    corners = model.vertices[model.faces].reshape(-1, 3)
    # All corners are near points, and the surfels cover the surface several times.
    low, high = sample.points.min(axis=0), sample.points.max(axis=0)
    assert (corners > low - 0.04).all()
    assert (corners < high + 0.04).all()
    x, y, z = (high - low).tolist()  # of the turned box
    surface = 2 * (x * y + y * z + z * x)
    assert 2 < face_areas(model.vertices, model.faces).sum() / surface < 8
    # Away from the edges, the normals are those of the box, whose sides are turned about z.
    middle = model.vertices[model.faces].mean(axis=1)
    top = (middle[:, 2] > high[2] - 1e-3) & (np.abs(middle[:, :2]) < 0.1).all(axis=1)
    assert top.sum() > 100
    assert np.abs(model.normals[top][..., 2]).min() > 0.99


def test_surfels_stay_in_the_unit_hemisphere_and_have_the_colours_of_the_image():
    sample = box_sample()
    points = sample.points / np.linalg.norm(sample.points, axis=1).max()
    points[:, 2] -= points[:, 2].min()
    points /= np.linalg.norm(points, axis=1).max()
    model = surfels(dataclasses.replace(sample, points=points))
    assert model.vertices[:, 2].min() >= 0
    assert np.linalg.norm(model.vertices, axis=1).max() <= 1 + 1e-12
    image = np.where(sample.mask[..., None], np.array([200, 40, 80], np.uint8), np.uint8(191))
    (material,) = surfels(dataclasses.replace(sample, image=image)).materials
    used = material.texture[material.texture[..., 3] > 0]
    assert (np.abs(used[:, :3].astype(int) - [200, 40, 80]) <= 8).all()
    without = surfels(dataclasses.replace(sample, depth=None)).materials[0].texture
    assert np.ptp(without[..., :3][without[..., 3] > 0]) == 0


def test_models_keep_their_split_frame_and_place(here, tmp_path, monkeypatch):
    first, other = box_sample(), box_sample(200, "another box")
    again = dataclasses.replace(first, view=1)
    write_dataset(tmp_path, {"train": [first, again], "validation": [other]}, source="solids")
    monkeypatch.chdir(tmp_path)
    entries = open_catalogue("records", ".").models
    monkeypatch.chdir("/")
    found = [(e.model_id, e.split) for e in entries]
    assert found == [("a box", "train"), ("another box", "validation")]
    values = {
        "views": 1, "num_points": 2000, "camera": {"azimuth": (0.0, 0.0)}, "image": {"samples": 1},
    }  # fmt: skip
    context = Context(settings.parse(values), "records", Variant("scalar_rgb"), None)
    (result,) = here([(0, entries[0])], context)
    view = decode(result.records[0])
    # Seen from the same angle, the object covers nearly the same pixels.
    both = (view.mask & first.mask).sum() / (view.mask | first.mask).sum()
    assert both > 0.93
    np.testing.assert_allclose(view.points.mean(axis=0), first.points.mean(axis=0), atol=0.02)


def test_ambiguous_models_are_refused_and_duplicates_of_held_out_ones_left_out(tmp_path):
    sample, name = box_sample(200), "expected a name that belongs to"
    write_dataset(tmp_path, {"train": [sample], "duplicate": [sample]}, source="solids")
    assert [entry.split for entry in open_catalogue("records", tmp_path).models] == ["train"]
    with pytest.raises(ValueError, match="none"):
        open_catalogue("records", tmp_path / "none")
    for number, (splits, message) in enumerate((
        ({"train": [dataclasses.replace(sample, model_id="")]}, name),
        ({"train": [sample], "test": [sample]}, name),
        ({"val": [sample]}, "expected some of"),
    )):  # fmt: skip
        write_dataset(tmp_path / str(number), splits, source="solids")
        with pytest.raises(ValueError, match=message):
            open_catalogue("records", tmp_path / str(number))


def test_variants_replace_their_models(tmp_path):
    sample = box_sample(800)
    # A vertical plane, oblique to the axes, so that its points lie in it only up to rounding.
    along, up = np.float32([[0.8, 0.6, 0], [0, 0, 1]])
    oblique = sample.points[:, :1] * along + sample.points * up
    flat = dataclasses.replace(sample, model_id="flat", points=oblique)
    write_dataset(tmp_path, {"train": [sample, flat]}, source="solids")
    options = parse_options("records", ["variants=3", "deviation=0.2"])
    entries = open_catalogue("records", tmp_path, **options).models
    assert len(entries) == 6
    assert [e.model_id for e in entries[:3]] == [f"a box variant {i}" for i in range(3)]
    assert {e.split for e in entries} == {"train"}
    models = [e.load() for e in entries[:3]]
    heights = [float(np.ptp(m.vertices[:, 2])) for m in models]
    assert len(set(np.round(heights, 3))) == 3
    for model in models:
        assert np.linalg.norm(model.vertices, axis=1).max() == pytest.approx(1, abs=0.05)
    with pytest.raises(UnusableModelError, match="in a vertical plane, expected a volume"):
        entries[3].load()
