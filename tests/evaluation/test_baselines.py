import json

import numpy as np
import pytest
from helpers import weights
from helpers.refusals import refused

from psgn_jax.config.experiment import ConfigError
from psgn_jax.evaluation import baselines

CONFIG = weights.config(model__fc_points=136)


@pytest.fixture(scope="module")
def rows():
    return baselines.measure(CONFIG, weights.random_params(CONFIG), "validation")


def test_what_the_rows_are_worth(rows):
    rows, models = rows
    assert len(set(models)) == 11
    assert tuple(rows) == baselines.ROWS
    values = np.stack(list(rows.values()))
    assert values.shape[1:] == (11, len(baselines.METRICS))
    assert np.isfinite(values).all()
    cd, emd = np.moveaxis(values.mean(axis=1), -1, 0)[:2]
    cds, emds = dict(zip(rows, cd, strict=True)), dict(zip(rows, emd, strict=True))
    for order in (cds, emds):
        assert order["floor"] < order["oracle"] < min(order["retrieval"], order["fixed cloud"])
    assert cds["network"] > 3 * cds["oracle"]  # its parameters are random


def test_intervals_and_files(rows):
    values = np.random.default_rng(1).normal(3, 2, (400, 2))
    mean, low, high = baselines.intervals(values, np.arange(400))
    np.testing.assert_allclose(high - low, 2 * 1.96 * 2 / np.sqrt(400), rtol=0.15)
    assert (low < mean).all()
    assert (mean < high).all()
    # Four equal views of a model are worth one of them.
    few, models = values[::4], np.arange(100)
    many = baselines.intervals(few.repeat(4, axis=0), models.repeat(4))
    np.testing.assert_allclose(many, baselines.intervals(few, models))
    document = json.loads(baselines.json_text(*rows, split="validation"))
    assert document["rows"]["floor"]["cd_sq_radius2"][0] == rows[0]["floor"][:, 0].mean()


def test_splits_that_cannot_be_compared_are_refused():
    with refused(ConfigError, "split='train'"):
        baselines.measure(CONFIG, None, "train")
    with refused(ConfigError, "split='validation'", 20000):
        baselines.measure(weights.config(model__fc_points=10_000), None, "validation")
