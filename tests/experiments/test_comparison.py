"""The comparison with 3D-R2N2: tables, pictures and the parts of the protocol."""

import json
import pathlib

import numpy as np
import pytest
from PIL import Image

from psgn_jax.config import ConfigError, parse
from psgn_jax.data import camera, schema
from psgn_jax.data.dataset import write_dataset
from psgn_jax.experiments import common, figures, volumes
from psgn_jax.experiments import comparison as lib
from psgn_jax.metrics.evaluation import Evaluation, SampleName


def test_configurations_differ_where_they_should():
    here = pathlib.Path("work")
    made = {
        name: lib.configuration(name, "", here, lib.DEFAULT, steps=40 if name == lib.PEER else 0)
        for name in (*lib.POINTS, "volume", *lib.HEADS, lib.PEER)
    }
    assert {config.data.image_size for config in made.values()} == {(96, 128)}
    assert made["emd"].loss.name == "emd_mean"
    assert made["emd"].data.num_points == lib.NUM_POINTS
    assert made[lib.OURS].voxels.sources == {
        "from_cd": "work/cd",
        "from_emd": "work/emd",
        "from_volume": "work/volume",
    }
    assert made["head_cd"].voxels.sources == {"from_cd": "work/cd"}
    assert made[lib.PEER].voxels.eval_views == lib.VIEWS
    assert made[lib.PEER].train.steps == 40
    halved = lib.configuration("cd", "", here, lib.DEFAULT, scale=0.5)
    assert halved.train.steps == lib.DEFAULT.steps[0] // 2
    for name in lib.HEADS:  # parsed at full size too
        lib.configuration(name, "", here, lib.FULL)


def test_the_papers_table_is_consistent():
    rows = [row for name, row in lib.PAPER.items() if name != "mean"]
    assert len(rows) == 13
    np.testing.assert_allclose(np.mean(rows, axis=0), lib.PAPER["mean"], atol=1.5e-3)


def test_a_volumes_surface_becomes_a_cloud(rng):
    volume = np.zeros((32, 32, 32), bool)
    volume[8:24, 12:20, 0:4] = True
    points = volumes.surface_of(volume, rng)
    low, high = np.array([-0.5, -0.25, 0]), np.array([0.5, 0.25, 0.25])
    assert points.shape == (volumes.CANDIDATES, 3)
    assert (points >= low - 1e-6).all()
    assert (points <= high + 1e-6).all()
    on_face = (np.abs(points - low) < 1e-6) | (np.abs(points - high) < 1e-6)
    assert on_face.any(axis=1).all()


def test_thin_cells():
    volume = np.zeros((32, 32, 32), bool)
    volume[4:6, 4:6, 4:6] = True  # a block
    volume[10, 10, :20] = True  # a rod
    volume[20:30, 20:30, 31] = True  # a sheet at the border
    thin = volumes.thin_cells(volume)
    assert thin.sum() == 20 + 100
    assert not thin[4:6, 4:6, 4:6].any()


def test_an_empty_prediction_has_its_likeliest_cell():
    probability = np.zeros((32, 32, 32), np.float32)
    probability[3, 4, 5] = 0.2
    assert np.argwhere(volumes.solid_at(probability, 0.5)).tolist() == [[3, 4, 5]]
    assert volumes.solid_at(probability, 0.1).sum() == 1


def test_rows_in_parts_are_all_rows():
    a, b = np.arange(7.0), np.arange(7.0) * 2
    sizes = []

    def function(x, y):
        sizes.append(len(x))
        return {"sum": x + y}

    np.testing.assert_array_equal(common.in_parts(function, a, b, size=3)["sum"], a + b)
    assert sizes == [3, 3, 3]


def test_seconds_and_budget(tmp_path):
    config = parse({"train": {"batch_size": 4}})
    (tmp_path / "cd").mkdir()
    (tmp_path / "cd" / "config.json").write_text(json.dumps({"train": {"batch_size": 4}}))
    lines = [
        {"step": 1, "kind": "train", "loss": 1.0},
        {"step": 11, "kind": "train", "samples_per_second": 8.0},
        {"step": 11, "kind": "eval", "iou": 0.1},
    ]
    (tmp_path / "cd" / "metrics.jsonl").write_text("".join(json.dumps(x) + "\n" for x in lines))
    assert common.cost(tmp_path / "cd") == pytest.approx((0.5, 5.0))
    assert lib.budget(config, tmp_path, ["cd"], 77) == 77
    assert lib.budget(config, tmp_path, ["cd"], 5) == 77  # stored by the first call
    assert json.loads((tmp_path / "budget.json").read_text())["seconds"] == pytest.approx(5.0)


def document():
    keys = [f"cd_sq_radius2:{n}" for n in (*lib.POINTS, lib.PEER)]
    keys += [f"emd_radius:{n}" for n in (*lib.POINTS, lib.PEER)]
    row = dict.fromkeys(keys, 0.01)
    row |= {key.replace(":", "_surface:"): 0.02 for key in keys}
    row |= {f"iou:{n}": 0.5 for n in (*lib.HEADS, "splat_cd", "splat_emd")}
    row |= {f"iou:{lib.PEER}_{count}": 0.4 for count in lib.VIEWS}
    row |= {f"thin_recall:{n}": 0.3 for n in (lib.OURS, lib.PEER)}
    gain = {"mean": 0.1, "error": 0.01}
    return {
        "split": "test",
        "samples": 5,
        "samples_of": {"chair": 3, "pillow": 2},
        "categories": {"chair": row, "pillow": {**row, f"iou:{lib.PEER}_1": 0.6}},
        "mean": row,
        "seconds": dict.fromkeys((*lib.POINTS, "volume", *lib.HEADS, lib.PEER), 10.0),
        "thresholds": {lib.OURS: 0.4, lib.PEER: 0.35},
        **dict.fromkeys(
            ("gain_volume", "gain_volume_one_cloud", "gain_emd", "gain_over_splat"), gain
        ),
    }


def test_tables():
    iou, volume, surface, thin, heads, gains, times = lib.table(document())
    assert " ".join(iou[1]) == "chair 3 0.500 0.400 0.400 0.400 0.544 0.466 0.533 0.550"
    assert [line[1] for line in iou[1:]] == ["3", "2", "5"]
    # 0.01 radius^2 is 0.25 u^2 and 0.01 radius is 0.05 u, where u is the paper's unit.
    assert volume[2][1:7] == ["0.250", "0.250", "0.01000", "0.01000", "0.050", "0.050"]
    assert surface[2][1:7] == ["0.500", "0.500", "0.02000", "0.02000", "0.100", "0.100"]
    assert thin[2] == ["pillow", "0.300", "0.300"]
    assert heads[1] == ["splat_cd", "0.500"]
    assert gains[1] == ["head_cd - splat_cd", "+0.1000 +- 0.0100"]
    assert times[1] == ["cd", "10"]


def test_pictures(rng):
    axes = lib.bars(document()).axes
    assert len(axes) == 3
    heights = [bar.get_height() for bar in axes[2].containers[1]]
    assert heights == pytest.approx([0.6, 0.4, 0.6])  # 1 - IoU of 3D-R2N2
    intrinsics, extrinsics = camera.default_camera((24, 32))
    volume = np.zeros((32, 32, 32), bool)
    volume[10:20, 10:20, :8] = True
    case = {
        "image": np.zeros((24, 32, 3), np.uint8),
        "intrinsics": intrinsics,
        "extrinsics": extrinsics,
        "category": "chair",
        "cloud": rng.uniform(-0.5, 0.5, (50, 3)),
        **dict.fromkeys((lib.OURS, lib.PEER, "truth"), volume),
    }
    panels = list(lib.panels(case).values())
    assert [panel.shape for panel in panels] == [(192, 256, 3)] * 9
    assert all((panel < 200).any() for panel in panels)
    figure = lib.figure(document(), [case, case])["cases"]
    assert figures.png(figure).startswith(b"\x89PNG")


def samples(split):
    """Boxes of two categories, with five identical views."""
    for number in range(2):
        occupancy = np.zeros((32, 32, 32), bool)
        occupancy[8:24, 8 : 20 + 4 * number, : 8 + 8 * number] = True
        rng = np.random.default_rng(number)
        points = volumes.surface_of(occupancy, rng)[:1100]
        intrinsics, extrinsics = camera.default_camera((16, 32))
        for view in range(5):
            yield schema.Sample(
                image=rng.integers(0, 255, (16, 32, 3), np.uint8),
                mask=np.ones((16, 32), bool),
                points=points,
                intrinsics=intrinsics,
                extrinsics=extrinsics,
                occupancy=occupancy,
                category=("box", "chair")[number],
                model_id=f"{split}{number}",
                view=view,
            )


def test_what_is_compared(tmp_path, monkeypatch):
    """Runs on two samples per category predict the truth; 3D-R2N2 predicts empty volumes."""
    monkeypatch.setattr(volumes, "NUM_POINTS", 32)
    monkeypatch.setattr(volumes, "CANDIDATES", 128)
    known = [s for s in samples("test") if s.view < 2]
    truth = np.stack([s.occupancy for s in known])
    truth[0, 2, 2, :9] = True  # a thin rod
    clouds = np.stack([s.points[:32] for s in known])

    def measure(folder, split, into):
        name = folder.name
        names = [SampleName(i, s.category, s.model_id, s.view) for i, s in enumerate(known)]
        metrics = {"iou": np.full(4, 0.7 if "volume" in name else 0.6)}
        metrics |= {f"iou_splat_{n}": np.full(4, 0.5) for n in lib.POINTS}
        metrics |= {f"iou_{count}_views": np.full(4, 0.1 * count) for count in lib.VIEWS}
        chosen = {f"threshold_of_{key}": 0.5 for key in metrics}
        for key, arrays in into.items():
            arrays += list(truth) if key == "occupancy" else [getattr(s, key) for s in known]
        predictions = truth.astype(np.float32) if name != lib.PEER else 0.1 * truth
        if name in lib.POINTS:
            predictions = clouds
        found = Evaluation(split, names, metrics, 0.01, (0, 0), chosen=chosen)
        return volumes.Run(found, predictions)

    monkeypatch.setattr(volumes, "measure_run", measure)
    document, cases = volumes.compare(tmp_path, "test")
    assert document["samples_of"] == {"box": 2, "chair": 2}
    mean = document["mean"]
    assert mean[f"iou:{lib.OURS}"] == pytest.approx(0.7)
    assert document["gain_volume"] == pytest.approx({"mean": 0.1, "error": 0})
    assert document["gain_over_splat"]["mean"] == pytest.approx(0.1)
    # The most probable cells of 3D-R2N2 are the true ones, so its cloud is that of the truth.
    assert mean[f"cd_sq_radius2:{lib.PEER}"] == pytest.approx(0, abs=1e-9)
    assert mean["cd_sq_radius2:cd"] > 0
    assert mean["cd_sq_radius2_surface:cd"] > 0
    assert document["categories"]["box"][f"thin_recall:{lib.OURS}"] == 1
    assert np.isnan(document["categories"]["chair"][f"thin_recall:{lib.OURS}"])
    assert [case["category"] for case in cases] == ["chair", "box"]
    assert (cases[1]["truth"] == truth[0]).all()  # the sample with the thin rod
    lib.table({**document, "seconds": {}})


@pytest.mark.slow
def test_the_whole_study_and_again(tmp_path, monkeypatch):
    splits = ("train", "validation", "test")
    write_dataset(tmp_path / "data", {s: samples(s) for s in splits}, source="")
    tiny = lib.DEFAULT._replace(
        image_size=(16, 32),
        model={"name": "vanilla", "widths": (4, 4), "fc_points": 64, "fc_widths": (8,)},
        num_points=64,
        batch=(2, 2),
        steps=(2, 2, 2, 2),
        widths=2,
        width_multiplier=1e-3,
    )
    monkeypatch.setattr(lib, "DEFAULT", tiny)
    monkeypatch.setattr(lib, "NUM_POINTS", 64)
    monkeypatch.setattr(volumes, "NUM_POINTS", 64)
    monkeypatch.setattr(volumes, "CANDIDATES", 256)
    work = tmp_path / "work"
    text = lib.STUDY.run(work, data=str(tmp_path / "data"), peer_steps=2)
    assert text == (work / "comparison.txt").read_text()
    found = json.loads((work / "comparison.json").read_text())
    assert set(found["categories"]) == {"box", "chair"}
    assert found["split"] == "test"
    assert found["steps_of_3d_r2n2"] == 2
    assert 0 < found["mean"]["cd_sq_radius2_surface:cd"] < 10
    with Image.open(work / "cases.png") as picture:
        assert picture.size[0] > 9 * 192
    before = {p: p.read_bytes() for p in work.glob("*/metrics.jsonl")}
    assert lib.STUDY.run(work, data=str(tmp_path / "data"), peer_steps=2) == text
    assert len(before) == 8
    assert before == {p: p.read_bytes() for p in work.glob("*/metrics.jsonl")}


def test_records_without_five_views_are_refused_before_anything(tmp_path):
    few = [s for s in samples("train") if s.view < 2]
    write_dataset(tmp_path / "data", {"train": few, "validation": few}, source="")
    with pytest.raises(
        ConfigError, match=r"has 2 views, expected at least 5, as set by voxels.max_views"
    ):
        lib.STUDY.run(tmp_path / "work", data=str(tmp_path / "data"))
    assert not (tmp_path / "work").exists()
