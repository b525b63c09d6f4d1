import dataclasses
import itertools
import json

import jax
import numpy as np
import pytest
from helpers import standin
from helpers.refusals import all_refused, refused

import psgn_jax
from psgn_jax.config.experiment import ConfigError
from psgn_jax.data import camera, loader, schema
from psgn_jax.data.dataset import write_dataset
from psgn_jax.data.schema import RecordError
from psgn_jax.evaluation import results as lib
from psgn_jax.evaluation import table as table_lib
from psgn_jax.evaluation.results import Evaluation, SampleName
from psgn_jax.tasks import refiner
from psgn_jax.tasks.run import evaluate_run, report_runs
from psgn_jax.training.log import read_metrics
from psgn_jax.training.loop import train
from psgn_jax.weights.checkpoint import Checkpoints
from psgn_jax.weights.run_folder import open_run

pytestmark = pytest.mark.usefixtures("keep_compiled")
VIEWS = 3


def box(number, view):
    """A box whose image encodes its number and view, so that a test can identify the record."""
    rng = np.random.default_rng(number)
    low, high = rng.integers([6, 6, 0], [12, 12, 2]), rng.integers([18, 18, 6], [27, 27, 18])
    occupancy = np.zeros((32, 32, 32), bool)
    occupancy[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = True
    points = rng.uniform(low / 16 - [1, 1, 0], high / 16 - [1, 1, 0], (64, 3)).astype(np.float32)
    intrinsics, extrinsics = camera.default_camera((16, 32))
    return schema.Sample(
        image=np.full((16, 32, 3), 10 * number + view, np.uint8),
        mask=np.ones((16, 32), bool), points=points, intrinsics=intrinsics, extrinsics=extrinsics,
        occupancy=occupancy, category=("box", "crate")[number % 2], model_id=f"m{number}",
        view=view,
    )  # fmt: skip


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("boxes") / "data"
    boxes = [box(n, v) for n in range(6) for v in range(VIEWS)]
    splits = {"train": boxes[: 4 * VIEWS], "validation": boxes[4 * VIEWS :]}
    write_dataset(folder, splits, source="boxes", records_per_shard=7)
    return str(folder)


def config(data, **changes):
    small = {
        "data__path": data, "data__inputs": ("rgb",), "data__num_points": 20,
        "data__num_eval_points": 20, "model__name": "vanilla", "model__widths": (4, 4),
        "model__random_size": 0, "loss__l2": "none", "optim__learning_rate": 1e-2,
        "train__batch_size": 2, "train__steps": 2, "train__eval_every": 2,
        "train__checkpoint_every": 1, "train__images_every": 2,
    }  # fmt: skip
    of_task = {
        "refiner": {"voxels__widths": (2,) * 5},
        "views": {"voxels__width_multiplier": 1e-3, "voxels__max_views": VIEWS,
                  "voxels__eval_views": (1, VIEWS)},
    }  # fmt: skip
    return standin.config(**small | of_task.get(changes.get("task"), {}) | changes)


def entries(workdir, kind):
    return [line for line in read_metrics(workdir / "metrics.jsonl") if line["kind"] == kind]


def number_and_view(image):
    return divmod(int(image[0, 0, 0]), 10)


def test_batches_of_views(data):
    cfg = config(data, task="views").data
    twice = dataclasses.replace(cfg, path=f"{data}*2")
    batch = next(loader.train_batches(twice, batch_size=24, seed=1, start_step=0))
    for views in batch["image"]:
        assert len({number_and_view(view) for view in views}) == len(views) > 1
    batches = loader.train_batches(cfg, batch_size=4, seed=1, start_step=0)
    kept, seen = list(itertools.islice(batches, 12)), []
    batches.close()
    for batch in kept:
        assert batch["mask"].shape == batch["image"].shape[:-1]
        for views, volume in zip(batch["image"], batch["occupancy"], strict=True):
            which = [number_and_view(view) for view in views]
            assert len({number for number, _ in which}) == 1
            assert len(set(which)) == len(which)  # without replacement
            seen.append(which[0])
            np.testing.assert_array_equal(volume, box(*which[0]).occupancy)
    assert {batch["image"].shape[1] for batch in kept} == {1, 2, 3}
    assert sorted(seen) == sorted(4 * [(n, v) for n in range(4) for v in range(VIEWS)])
    # The batches are the same if reading starts in the middle, and if two processes share them.
    second = {"process_index": 1, "process_count": 2}
    again = loader.train_batches(cfg, batch_size=4, seed=1, start_step=5, **second)
    np.testing.assert_array_equal(next(again)["image"], kept[5]["image"][2:])
    again.close()
    # In an evaluation, the record itself is the first view.
    (batch,) = loader.eval_batches(cfg, split="validation", batch_size=6)
    firsts = [number_and_view(views[0]) for views in batch["image"]]
    assert firsts == [(n, v) for n in (4, 5) for v in range(VIEWS)]
    assert [number_and_view(v) for v in batch["image"][1]] == [(4, 1), (4, 2), (4, 0)]


def test_a_mirrored_model_is_so_in_all_views_and_in_its_volume(data):
    cfg = dataclasses.replace(config(data, task="views").data, flip=True)
    batches, mirrored = loader.train_batches(cfg, batch_size=4, seed=1, start_step=0), []
    for batch in itertools.islice(batches, 4):
        for views, volume in zip(batch["image"], batch["occupancy"], strict=True):
            truth = box(*number_and_view(views[0])).occupancy
            mirrored.append(np.array_equal(volume, truth[:, ::-1]))
            assert mirrored[-1] or np.array_equal(volume, truth)
    batches.close()
    assert 2 < sum(mirrored) < 14


def test_too_few_views_or_no_volumes_are_named(data, tmp_path):
    wrong = config(f"{data}*2", task="views", voxels__max_views=4)  # copies are no other views
    with refused(RecordError, "3 views", "4", "voxels.max_views"):
        loader.train_batches(wrong.data, batch_size=2, seed=0, start_step=0)
    bare = [dataclasses.replace(box(0, 0), occupancy=None)]
    write_dataset(tmp_path / "bare", {"train": bare, "validation": bare}, source="")
    with refused(ConfigError, "occupancy", "data.path"):
        train(config(str(tmp_path / "bare"), task="volume"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.fixture(scope="module")
def points_run(data, tmp_path_factory):
    workdir = tmp_path_factory.mktemp("points") / "cd"
    train(config(data, train__eval_every=0, train__images_every=0), workdir)
    return workdir


@pytest.fixture(scope="module")
def refined(data, points_run, tmp_path_factory):
    workdir = tmp_path_factory.mktemp("refine") / "run"
    settings = config(data, task="refiner", voxels__from_cd=str(points_run))
    return workdir, train(settings, workdir)


def test_a_refiner_keeps_its_source_and_threshold(data, refined, points_run, tmp_path):
    workdir, outcome = refined
    assert set(outcome.state.params) == {*(f"conv{i}" for i in range(5)), "occupancy"}
    (found,) = entries(workdir, "eval")
    assert found["one_minus_iou"] == pytest.approx(1 - found["iou"])
    assert 0.05 <= found["threshold_of_iou_splat_cd"] <= 0.95
    scores = Checkpoints(workdir / "checkpoints", read_only=True).scores[2]
    assert scores["threshold_of_iou"] == found["threshold_of_iou"]
    before, kept = open_run(points_run, "best"), open_run(workdir / "frozen" / "from_cd", "last")
    assert before[0] == kept[0]
    jax.tree.map(np.testing.assert_array_equal, before[1], kept[1])
    moved = config(data, task="refiner", voxels__from_cd="/no/such")
    assert refiner.open_source(moved, workdir, "from_cd").step == 2
    result = evaluate_run(open_run(workdir), out=tmp_path / "out")
    assert result.means["iou"] == pytest.approx(found["iou"], rel=1e-6)
    assert "during training: iou" in table_lib.text(result)
    document = json.loads((tmp_path / "out" / "table.json").read_text())
    assert set(document["categories"]) == {"box", "crate"}
    assert "num_pred_points" not in document


def test_a_refiner_predicts_no_points_and_sources_must_fit(data, points_run, refined, tmp_path):
    def opened(source, **changes):
        wrong = config(data, task="refiner", voxels__from_cd=str(source), **changes)
        return refiner.open_source(wrong, tmp_path, "from_cd")

    run = open_run(refined[0])
    all_refused(lambda wrong: wrong(), ConfigError, [
        (lambda: psgn_jax.load(refined[0]), "task='refiner'", "'points'"),
        (lambda: evaluate_run(run, draws=2), "task='refiner'", "'points'"),
        (lambda: report_runs(tmp_path / "pages", [run]), "task='refiner'", "'points'"),
        (lambda: opened("/no/such"), "voxels.from_cd='/no/such'", "'points'"),
        (lambda: opened(refined[0]), refined[0], "'refiner'", "'points'"),
        (lambda: opened(points_run, data__image_size=(32, 32)),
         "data.image_size=(32, 32)", "(16, 32)", "voxels.from_cd"),
    ])  # fmt: skip


@pytest.mark.slow
def test_all_inputs_of_a_refiner(data, points_run, tmp_path):
    train(config(data, task="volume"), tmp_path / "volume")
    (found,) = entries(tmp_path / "volume", "eval")
    assert found["log_volume_abs_error"] > 0
    sources = {"from_cd": points_run, "from_emd": points_run, "from_volume": tmp_path / "volume"}
    sources = {f"voxels__{name}": str(folder) for name, folder in sources.items()}
    outcome = train(config(data, task="refiner", **sources), tmp_path / "run")
    assert outcome.state.params["conv0"]["kernel"].shape[-2] == 3
    assert set(entries(tmp_path / "run", "eval")[0]) >= {"iou_splat_cd", "iou_splat_emd"}


@pytest.mark.slow
def test_3d_r2n2_on_one_to_three_views(data, tmp_path):
    train(config(data, task="views"), tmp_path / "run")
    (found,) = entries(tmp_path / "run", "eval")
    assert {"iou_1_views", "iou_3_views", "threshold_of_iou_3_views"} <= set(found)
    result = evaluate_run(open_run(tmp_path / "run"))
    assert result.means["iou_3_views"] == pytest.approx(found["iou_3_views"], rel=1e-6)


def test_thresholds_are_chosen_or_taken():
    sweep = np.zeros((2, 19))
    sweep[:, 7] = (0.5, 0.7)  # threshold .40
    sweep[0, 3] = 1.0  # threshold .20: better for one sample only
    names = [SampleName(0, "c", "m", 0)] * 2
    found = Evaluation("test", names, {"iou": sweep, "x": np.ones(2)}, 0.01, (0, 0))
    fresh = lib.at_thresholds(found, {}, best="iou")
    assert fresh.chosen == {"threshold_of_iou": 0.4}
    assert fresh.means == pytest.approx({"iou": 0.6, "x": 1.0, "one_minus_iou": 0.4})
    assert "chosen on this split" in table_lib.text(fresh)
    taken = lib.at_thresholds(found, {"threshold_of_iou": 0.2}, best="iou")
    assert taken.means["iou"] == pytest.approx(0.5)
