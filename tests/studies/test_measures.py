import numpy as np
import pytest

from data_gen.catalogues import cabinets
from data_gen.surface import sample_surface
from psgn_jax.config.experiment import parse
from psgn_jax.evaluation.results import SampleName
from psgn_jax.models.networks import build
from psgn_jax.studies import ambiguity, branches, cd_and_emd, comparison, mean_shape
from psgn_jax.studies.runner import Measured


def test_outliers_missed_and_uneven_points():
    gt = np.linspace([0, 0, 0], [1, 0, 0], 101)
    pred = gt[0:51:10].copy()
    pred[0, 2] = 0.3
    found = cd_and_emd.measure_sample({"pred": pred, "points": gt})
    assert found["outliers"] == pytest.approx(1 / 6)
    assert found["missed"] == pytest.approx(40 / 101, abs=0.021)
    assert found["unevenness"] > 0.3
    even = cd_and_emd.measure_sample({"pred": gt[::10], "points": gt})
    assert even["unevenness"] == pytest.approx(0, abs=1e-6)


SMALL = {"widths": (4, 6, 8), "deconv_level": 1, "fc_points": 30, "fc_widths": (8,)}
CONFIG = parse({"data": {"image_size": (24, 32)}, "model": SMALL})


def sheet_and_tips(rng):
    """A sheet and two thin rods: deconv points lie on the sheet, fc points on the rods."""
    grid = build(CONFIG.model).grid
    row, column = np.mgrid[: grid.height, : grid.width]
    sheet = np.stack([row / grid.height, column / grid.width, 0 * row], axis=-1) - [0.5, 0.5, 0]
    along = rng.permutation(np.concatenate([np.linspace(-1.0, -0.6, 15), np.linspace(0.6, 1, 15)]))
    rods = np.stack([0 * along, along, 0 * along], axis=1)
    pred = np.concatenate([rods, sheet.reshape(-1, 3)]).astype(np.float32)
    flat = np.concatenate([rng.uniform(-0.5, 0.5, (900, 2)), np.zeros((900, 1))], axis=1)
    return {"pred": pred, "points": np.concatenate([flat, rods, rods, rods]).astype(np.float32)}


def test_a_sheet_with_rods_is_told_from_the_rods(rng):
    case = sheet_and_tips(rng)
    found = branches.measure_sample(case, CONFIG.model)
    assert found.keys() == branches.METRICS.keys()
    assert (found["fc_points"], found["deconv_points"]) == (30, len(case["pred"]) - 30)
    assert found["deconv_order"] < 0.25
    assert found["fc_order"] > 0.7
    assert found["fc_pred_to_gt"] == pytest.approx(0, abs=1e-9)
    assert found["fc_share"] + found["deconv_share"] == pytest.approx(1)
    assert found["gt_to_pred"] <= min(found["fc_gt_to_pred"], found["deconv_gt_to_pred"])
    assert found["by_distance_5"] > 0.4 > 0.1 > found["by_distance_1"]
    assert found["by_surface_change"] > 0


@pytest.mark.slow
def test_emd_keeps_the_circle_and_cd_blurs_it(tmp_path, monkeypatch):
    monkeypatch.setattr(mean_shape, "NUM_POINTS", 48)
    circle = "circle of random radius"
    monkeypatch.setattr(mean_shape, "DISTRIBUTIONS", {circle: mean_shape.DISTRIBUTIONS[circle]})
    found = {}
    for run in mean_shape.STUDY.runs(tmp_path, steps=150):
        mean_shape.train(run)
        found[run.name] = [mean_shape.measure(run)]
    radius, spread = (f"{circle}: {key}" for key in ("mean radius", "spread of the radius"))
    emd, cd = (found[name][0].metrics for name in ("EMD", "CD"))
    for metrics in (emd, cd):
        assert metrics[radius] == pytest.approx(np.mean(mean_shape.RADII), abs=0.03)
    assert emd[spread] < 0.3 * cd[spread]


def test_depth_is_read_off_the_true_points():
    assert ambiguity.DEPTH_RANGE == cabinets.DEPTH
    for seed in range(4):
        model = cabinets.generate("front", seed, seed + 1)
        points = sample_surface(model, 4096, 0).astype(np.float32)
        found = ambiguity.measured_depth(points, model.parameters["scale"])
        assert found == pytest.approx(model.parameters["hidden"]["depth"], abs=0.02)


def test_exact_draws_have_the_spread_of_the_truth(rng):
    """Clouds of two equal points, whose x is the hidden depth."""
    depth = rng.uniform(*cabinets.DEPTH, (32, 33))
    depth[1::2] = 0.5
    x = ambiguity.BODY_BEGINS - ambiguity.DEEPEST * depth
    y = 0.01 * rng.normal(size=(32, 33))
    clouds = np.stack([x, y, 0 * x + 0.5], axis=-1)[:, :, None].repeat(2, axis=2)
    clouds = clouds.astype(np.float32)
    each = [ambiguity.of_draws(c[1:], c[0], 1.0) for c in clouds]
    arrays = {key: np.array([of[key] for of in each]) for key in each[0]}
    found = ambiguity.by_kind(arrays, np.arange(32) % 2 == 0)
    mean = {key: np.nanmean(value) for key, value in found.items()}
    var_x, var_y = (v[:, 1:9].var(axis=1) for v in (x, y))
    hidden, visible = var_x[::2].mean(), var_y[::2].mean() / 2
    assert mean["front: spread along x [radius]"] == pytest.approx(hidden**0.5, rel=1e-4)
    ratio = mean["front: spread along x / along y and z (goal: at least 3)"]
    assert ratio == pytest.approx((hidden / visible) ** 0.5, rel=1e-4)
    ratio = mean["spread, turned / front (goal: at most 1/3)"] ** 2
    assert ratio == pytest.approx(var_y[1::2].mean() / (hidden + 2 * visible), rel=1e-3)
    assert np.isnan(found["front: CD of the best draw [radius^2]"][1::2]).all()
    key = "front: depth: Wasserstein-1 from its true distribution"
    assert mean[key] == pytest.approx(0.047, rel=0.2)
    assert mean["front: depth: coverage of the range"] > 0.8
    assert mean["front: depth: standard deviation"] == pytest.approx(0.241, abs=0.02)


def test_surfaces_thin_cells_and_empty_predictions(monkeypatch):
    monkeypatch.setattr(comparison, "NUM_POINTS", 64)
    monkeypatch.setattr(comparison, "CANDIDATES", 512)
    volume = np.zeros((32, 32, 32), bool)
    volume[8:24, 12:20, 0:4] = True
    points = comparison.cloud_of(volume, 0, 2)
    low, high = np.array([-0.5, -0.25, 0]), np.array([0.5, 0.25, 0.25])
    to_faces = np.minimum(points - low, high - points)
    np.testing.assert_allclose(to_faces.min(axis=1), 0, atol=1e-6)
    found = comparison.distances(points, {"occupancy": volume, "points": points}, 0)
    assert found["cd_volume"] > 0  # another cloud of the same surface
    volume[:] = False
    volume[4:6, 4:6, 4:6] = True  # a block
    volume[10, 10, :20] = True  # a rod
    volume[20:30, 20:30, 31] = True  # a sheet at the border
    thin = comparison.thin_cells(volume)
    assert (thin.sum(), thin[4:6, 4:6, 4:6].sum()) == (20 + 100, 0)
    probability = np.zeros((32, 32, 32), np.float32)
    probability[3, 4, 5] = 0.2
    assert np.argwhere(comparison.solid_at(probability, 0.5)).tolist() == [[3, 4, 5]]


def test_a_row_for_each_category():
    names = [SampleName(i, name, "m", 0) for i, name in enumerate(("chair", "chair", "box"))]
    iou, thin = np.array([0.2, 0.4, 0.6]), np.array([np.nan, 0.5, np.nan])
    clouds = {f"{m}_{t}": np.full(3, 0.01) for m in ("cd", "emd") for t in ("volume", "surface")}
    every = {name: iou for name in comparison.METRICS if name.startswith("iou")}
    found = Measured(names, {**every, **clouds, "thin_recall": thin})
    results = {run: [found] for run in (*comparison.POINTS, *comparison.HEADS, comparison.PEER)}
    (lines,) = comparison.by_category(results)
    rows = {line[0]: dict(zip(lines[0], line, strict=True)) for line in lines}
    assert (rows["chair"]["ours"], rows["chair"]["paper*: ours"]) == ("0.300", "0.544")
    assert (rows["mean"]["ours"], rows["mean"]["samples"]) == ("0.450", "3")
    assert (rows["chair"]["thin: ours"], rows["box"]["thin: ours"]) == ("0.500", "nan")
    # .01 radius^2 is .25 u^2 and .01 radius is .05 u, where u is the paper's unit.
    assert rows["box"]["CD: ours [u^2]"] == "0.250"
    assert rows["box"]["EMD: 3D-R2N2 [u]"] == "0.050"
    assert list(rows["mean"].values())[-4:] == ["0.640", "0.560", "0.617", "0.631"]  # 1, 3, 5 views
    published = [row for name, row in comparison.PAPER.items() if name != "mean"]
    np.testing.assert_allclose(np.mean(published, axis=0), comparison.PAPER["mean"], atol=1.5e-3)
