"""Hybrids of two similar objects."""

import dataclasses

import numpy as np
import pytest
import scipy.spatial
from helpers import drawn_solids as solids

from data_gen.mesh import UnusableModelError
from data_gen.sets import hybrids, variants
from psgn_jax.data.dataset import RecordReader, write_dataset
from psgn_jax.data.schema import validate

# Lower and upper corners of the parts of a chair with one arm: it has no symmetry.
CHAIR = [
    ((-0.4, -0.3, 0.3), (0.4, 0.3, 0.4)),
    ((-0.4, -0.3, 0.4), (0.4, -0.2, 0.9)),
    ((0.3, -0.2, 0.4), (0.4, 0.3, 0.6)),
    ((-0.1, -0.1, 0.0), (0.1, 0.1, 0.3)),
]


def cloud_of(parts, seed=0, num_points=4000):
    """Points inside boxes, as many in each."""
    rng = np.random.default_rng(seed)
    count = num_points // len(parts)
    return np.concatenate([rng.uniform(low, high, (count, 3)) for low, high in parts])


def turn_about_z(points, angle, mirrored=False):
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return (points * [-1, 1, 1] if mirrored else points) @ turn.T


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.7, 3.0, 5.0])
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_turn_moves_a_turned_copy_onto_the_object(angle, mirrored):
    chair = turn_about_z(cloud_of(CHAIR), 0.9)
    copy = 0.7 * turn_about_z(cloud_of(CHAIR, seed=1), angle, mirrored) + [0.2, -0.1, 0.3]
    plate = cloud_of([((-0.5, -0.5, 0), (0.5, 0.5, 0.1))])
    pole = cloud_of([((-0.1, -0.1, 0), (0.1, 0.1, 1.0)), ((-0.3, -0.2, 0.9), (0.3, 0.2, 1.0))])
    shapes = [hybrids.Shape.of(each) for each in (plate, chair, pole, copy)]
    index, turn = hybrids.most_similar(shapes, neighbours=2)
    assert index.shape == turn.shape == (4, 2)
    assert index[1, 0] == 3
    assert index[3, 0] == 1
    boxes = shapes[1].box, shapes[3].box
    join = hybrids.random_cut(chair, copy, boxes, turn[1, 0], np.random.default_rng(0))
    assert join is not None
    distance, _ = scipy.spatial.cKDTree(chair).query(join.moved(copy))
    assert np.quantile(distance, 0.99) < 0.06


def test_a_cut_keeps_one_object_on_each_side_of_a_plane():
    stool = cloud_of([((-0.4, -0.2, 0.4), (0.4, 0.2, 0.5)), ((-0.3, -0.2, 0), (0.3, 0.2, 0.4))])
    crate = cloud_of([((-0.6, -0.3, 0), (0.6, 0.3, 0.6))], seed=1)
    boxes = hybrids.Box.around(stool), hybrids.Box.around(crate)
    axes = set()
    for seed in range(30):
        join = hybrids.random_cut(stool, crate, boxes, 0, np.random.default_rng(seed))
        assert join is not None
        first, second = stool[join.first], join.moved(crate)[join.second]
        # Stretched to the box of the first object, whose longer side is that of x.
        low, high = stool.min(axis=0), stool.max(axis=0)
        np.testing.assert_allclose(np.ptp(join.moved(crate), axis=0), high - low, atol=1e-3)
        apart = [
            axis for axis in (0, 2)
            if first[:, axis].max() <= second[:, axis].min() + 1e-9
            or second[:, axis].max() <= first[:, axis].min() + 1e-9
        ]  # fmt: skip
        assert len(apart) == 1
        axes.add(apart[0])
    assert axes == {0, 2}


def test_a_cut_that_leaves_too_little_is_none():
    ends = cloud_of([((-0.4, -0.2, 0), (-0.3, 0.2, 0.1)), ((0.3, -0.2, 0), (0.4, 0.2, 0.1))])
    plate = np.array([[-0.5, -0.2, 0.6], [0.5, 0.2, 0.6]])  # two points above the plane
    points = np.concatenate([ends, plate])
    boxes = hybrids.Box.around(points), hybrids.Box.around(points)
    cuts = [
        hybrids.random_cut(points, points, boxes, 0, np.random.default_rng(seed))
        for seed in range(30)
    ]
    assert None in cuts
    assert any(cuts)


def test_points_in_a_vertical_plane_are_refused():
    wall = cloud_of([((0, 0, 0), (1, 0, 1))])
    with pytest.raises(UnusableModelError, match="in a vertical plane"):
        hybrids.Shape.of(wall)


def a_box(name, half, num_points=3000):
    rng = np.random.default_rng(0)
    return solids.draw(solids.box(np.array(half)), rng, num_points=num_points, model_id=name)


def test_hybrids_are_drawn_after_the_variants(tmp_path, capsys):
    samples = [a_box("a", (0.3, 0.45, 0.25)), a_box("few", (0.3, 0.4, 0.2), 50),
               a_box("b", (0.2, 0.3, 0.3))]  # fmt: skip
    write_dataset(tmp_path / "src", {"train": samples}, source="solids")
    arguments = [str(tmp_path / "src"), str(tmp_path / "dst"), "--variants=1", "--hybrids=2"]
    assert variants.main(arguments) == 1
    assert "50 different points" in capsys.readouterr().err
    reader = RecordReader(tmp_path / "dst", "train")
    drawn = [reader[i] for i in range(len(reader))]
    names = [f"{n} {kind}" for n in "ab" for kind in ("variant 0", "hybrid 0", "hybrid 1")]
    assert [sample.model_id for sample in drawn] == names
    for sample in drawn:
        validate(sample)
    # Variants and hybrids of one seed do not depend on each other.
    for name, kind in (("variants", "variant"), ("hybrids", "hybrid")):
        others = {"variants": 0, "hybrids": 0} | {name: 1}
        to = tmp_path / name
        flags = [f"--{flag}={number}" for flag, number in others.items()]
        assert variants.main([arguments[0], str(to), *flags]) == 1
        alone = RecordReader(to, "train")[0]
        (same,) = (each for each in drawn if each.model_id == f"a {kind} 0")
        assert alone.model_id == same.model_id
        assert alone.image.tobytes() == same.image.tobytes()


def test_an_object_without_others_has_no_hybrids(tmp_path, capsys):
    sample = dataclasses.replace(a_box("a", (0.3, 0.45, 0.25)), category="box")
    write_dataset(tmp_path / "src", {"train": [sample]}, source="solids")
    arguments = [str(tmp_path / "src"), str(tmp_path / "dst"), "--variants=1", "--hybrids=2"]
    assert variants.main(arguments) == 1
    assert "no hybrids: there is no other model that can be used" in capsys.readouterr().err
    assert len(RecordReader(tmp_path / "dst", "train")) == 1
    assert variants.main([*arguments[:2], "--variants=0", "--hybrids=0"]) == 2
