import csv
import dataclasses
import math
import types

import numpy as np
import pytest
from helpers import drawn_solids
from helpers.refusals import all_refused, refused
from helpers.standin import SOLIDS

from psgn_jax.config.experiment import ConfigError
from psgn_jax.data.dataset import write_dataset
from psgn_jax.evaluation.results import SampleName
from psgn_jax.studies import branches, completion
from psgn_jax.studies import runner as lib
from psgn_jax.system.errors import UserError

pytestmark = pytest.mark.usefixtures("keep_compiled")
TINY = {
    "data.image_size": (12, 16), "data.num_points": 64, "data.num_eval_points": 256,
    "model.widths": (4, 6), "model.deconv_level": 0, "model.fc_points": 20, "model.fc_widths": (8,),
    "loss.name": "chamfer_sq_mean", "train.batch_size": 4, "train.steps": 2, "train.log_every": 1,
    "eval.batch_size": 8, "eval.emd_tolerance": 0,
}  # fmt: skip
STUDY = dataclasses.replace(completion.STUDY, base=TINY)
RECORDS = str(SOLIDS)


def logs(folder):
    """Their contents, and when a checkpoint was last written."""
    paths = sorted(folder.rglob("metrics.jsonl"))
    return [(p, p.read_bytes(), p.with_name("checkpoints").stat().st_mtime_ns) for p in paths]


@pytest.mark.slow
def test_a_study_is_shared_stopped_resumed_and_repeated(tmp_path, monkeypatch):
    folder, options = tmp_path / "a", {"data": RECORDS, "seeds": 2}
    assert lib.run(STUDY, folder, data=RECORDS, only="rgbd:1") == ""
    (alone,) = logs(folder)
    train, started = lib.loop.train, []

    def stopped_at_the_second(config, folder):
        started.append(folder.name)
        if len(started) == 2:
            return types.SimpleNamespace(stopped_by=15)
        return train(config, folder)

    monkeypatch.setattr(lib.loop, "train", stopped_at_the_second)
    with refused(UserError, "same command") as caught:
        lib.run(STUDY, folder, **options)
    assert caught.value.exit_code == 143
    text = lib.run(STUDY, folder, **options)
    assert started == ["rgb-0", "rgbd-0", "rgb-0", "rgbd-0", "rgb-1", "rgbd-1"]
    finished, numbers = logs(folder), (folder / "completion.csv").read_text()
    assert len(finished) == 4
    assert alone in finished

    rows = list(csv.DictReader(numbers.splitlines()))
    by_key = {(r["configuration"], r["minus"], r["metric"]): r for r in rows}
    change = by_key["rgbd", "rgb", "cd_sq_radius2"]
    means = [float(by_key[name, "", "cd_sq_radius2"]["mean"]) for name in ("rgbd", "rgb")]
    assert float(change["mean"]) == pytest.approx(means[0] - means[1])
    assert (change["samples"], change["seeds"]) == ("11", "2")
    assert min(float(change["error_samples"]), float(change["error_seeds"])) > 0
    assert "rgbd - rgb" in (folder / "completion.md").read_text()
    for name in ("completion.png", "completion_curves.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")

    # Again, also on another split, without a further training.
    again = lib.run(STUDY, folder, **options, measure=[f"{RECORDS}:train"])
    assert again.startswith(text)
    assert (folder / "completion.csv").read_text() == numbers
    assert (folder / f"completion-{SOLIDS.name}-train.md").is_file()
    assert logs(folder) == finished

    # Finished runs are measured by another study.
    runs = [str(folder / name) for name in ("rgb-0", "rgb-1")]
    assert f"{runs[1]} - {runs[0]}" in lib.run(branches.STUDY, tmp_path / "b", finished=runs)


def test_other_records_and_what_does_not_fit(tmp_path):
    drawn = drawn_solids.samples(2, seed=0, image_size=(12, 16))
    flat = [dataclasses.replace(s, depth=None) for s in drawn]
    write_dataset(tmp_path / "flat", {"train": flat, "validation": flat}, source="")
    run = lambda options: lib.run(STUDY, tmp_path / "work", **{"data": RECORDS, **options})  # noqa: E731
    all_refused(run, ConfigError, [
        ({"data": str(tmp_path / "flat")}, "data=", tmp_path / "flat", "'depth'"),
        ({"only": "rgb"}, "only=rgb", "CONFIG:SEED", "rgbd"),
        ({"only": "depth:0"}, "only=depth:0", "CONFIG:SEED"),
        ({"measure": ["records"]}, "measure=records", "FOLDER:SPLIT"),
        ({"measure": ["a/x:test", "b/x:test"]}, "measure=b/x:test"),
    ])  # fmt: skip
    assert not (tmp_path / "work").exists()
    (run, _) = STUDY.runs(tmp_path, data="here", eval_data="there")
    assert (run.config.data.path, run.config.data.eval_path) == ("here", "there")


def measured(metrics, models="abcd"):
    names = [SampleName(i, "car", model, 0) for i, model in enumerate(models)]
    return lib.Measured(names, {name: np.array(values) for name, values in metrics.items()})


def test_means_differences_and_their_errors():
    results = {
        "a": [measured({"cd_": [1.0, 2, 3, np.nan]}), measured({"cd_": [3.0, 2, 3, np.nan]})],
        "b": [measured({"cd_": [2.0, 4, 3, np.nan], "iou": [0.5]})] * 2,
    }
    metrics = {"cd_": "CD [radius^2]", "iou": "IoU [%]"}
    study = dataclasses.replace(STUDY, metrics=metrics, pairs=[("b", "a")])
    a, b, iou, change = lib.summarise(results, study)
    assert (a.mean, a.samples, a.seeds) == (pytest.approx(7 / 3), 3, 2)
    assert a.error_samples == pytest.approx(np.std([2, 2, 3], ddof=1) / np.sqrt(3))
    assert a.error_seeds == pytest.approx(np.std([2, 8 / 3], ddof=1) / np.sqrt(2))
    assert (b.error_seeds, math.isnan(iou.error_samples)) == (0, True)
    assert change.mean == pytest.approx(2 / 3)
    assert change.error_samples == pytest.approx(np.std([0, 2, 0], ddof=1) / np.sqrt(3))
    assert change.better == 0
    for metric, better in (("precision", 1), ("emd_radius", 0), ("visible_share", math.nan)):
        pair = {k: [measured({metric: v}, "ab")] for k, v in (("a", [1.0, 2]), ("b", [3.0, 4]))}
        *_, change = lib.summarise(pair, dataclasses.replace(study, metrics={metric: metric}))
        np.testing.assert_equal(change.better, better)
    # The first two samples are views of one model: deviations of 2/3 and -2/3 in all.
    names = measured({}, "aabb").names
    results = {key: [m._replace(names=names) for m in many] for key, many in results.items()}
    *_, change = lib.summarise(results, study)
    assert (change.mean, change.error_samples) == (pytest.approx(2 / 3), pytest.approx(4 / 9))
