import itertools

import numpy as np
import pytest
from helpers.obj_text import CUBE, FACES

from data_gen.catalogues import proportions
from data_gen.catalogues.entry import original_name
from data_gen.catalogues.open_catalogue import open_catalogue, parse_options
from data_gen.mesh import face_normals


def test_meshes_have_variants_with_the_split_of_their_model(write, tmp_path):
    for number in range(12):
        write(f"{number}.obj", CUBE + FACES)
    splits = {m.model_id: m.split for m in open_catalogue("folder", tmp_path).models}
    assert len(set(splits.values())) > 1
    entries = open_catalogue("folder", tmp_path, **parse_options("folder", ["variants=3"])).models
    assert len({e.model_id for e in entries}) == len(entries) == 36
    assert all(e.split == splits[original_name(e.model_id)] for e in entries)
    extents = set()
    for entry in entries[:3]:
        model = entry.load()
        # Still a box that stands in the unit hemisphere, with normals that fit its faces.
        extents.add(tuple(np.ptp(model.vertices, axis=0).round(3)))
        low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
        at_end = np.minimum(model.vertices - low, high - model.vertices)
        np.testing.assert_allclose(at_end, 0, atol=1e-9)
        assert np.linalg.norm(model.vertices, axis=1).max() == pytest.approx(1)
        flat = face_normals(model.vertices, model.faces)[:, None]
        np.testing.assert_allclose(model.normals, np.broadcast_to(flat, (12, 3, 3)), atol=1e-6)
        np.testing.assert_array_equal(entry.load().vertices, model.vertices)
    assert len(extents) == 3


def test_proportions_keep_planes_and_symmetry():
    rng = np.random.default_rng(0)
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    points = rng.uniform(-1, 1, (6000, 3)) * [0.3, 0.45, 0.25]
    points[np.arange(6000), rng.integers(0, 3, 6000)] = 0.25  # some planes inside
    ends = list(itertools.product((-0.3, 0.3), (-0.45, 0.45), (-0.25, 0.25)))
    points = np.concatenate([points, ends]) @ turn.T
    change, axes = proportions.random_proportions(points, "a variant", 0.3)
    changed = change(points)
    assert changed[:, 2].min() == 0
    # The order of points along each axis is kept, and planes stay planes.
    frame = np.eye(3)
    frame[:2, :2] = axes
    for along, now in zip((points @ frame.T).T, (changed @ frame.T).T, strict=True):
        order = np.argsort(along)
        assert (np.diff(now[order]) >= -1e-9).all()
        for plane in (along.min(), along.max(), 0.25):
            here = np.abs(along - plane) < 1e-6
            assert not here.any() or np.ptp(now[here]) < 1e-5
    # A point and its mirror image about the middle have mirror images after the change.
    across = points[:, :2] @ axes.T
    middle = (across.min(axis=0) + across.max(axis=0)) / 2 @ axes
    mirrored = np.concatenate([2 * middle - points[:, :2], points[:, 2:]], axis=1)
    np.testing.assert_allclose(change(mirrored)[:, :2], 2 * middle - changed[:, :2], atol=1e-9)
