"""Results that no refactoring may change: the leaves of a checkpoint, metrics, and a resumed run.

`oracles/golden.json` has the measurements of a run that was stopped after 6 of 12 steps, from the
code of version 0.1.0.dev0, on the records in `oracles/solids`.
"""

import dataclasses
import json
import pathlib

import numpy as np
import pytest
from helpers import standin

from psgn_jax.tasks.run import evaluate_run
from psgn_jax.training import loop
from psgn_jax.weights.checkpoint import Checkpoints
from psgn_jax.weights.leaves import named_leaves
from psgn_jax.weights.run_folder import open_run

ORACLES = pathlib.Path(__file__).with_name("oracles")
GOLDEN = json.loads((ORACLES / "golden.json").read_text())


@pytest.fixture(scope="module")
def config():
    steps = {"train__eval_every": 3, "train__keep_checkpoints": 1, "eval__emd_tolerance": 0.01}
    return standin.config(data__path=str(ORACLES / "solids"), **steps)


@pytest.fixture(scope="module")
def run(config, tmp_path_factory):
    """The folder of a run after 6 steps."""
    workdir = tmp_path_factory.mktemp("run")
    shorter = dataclasses.replace(config.train, steps=6)
    loop.train(dataclasses.replace(config, train=shorter), workdir)
    return workdir


def test_leaves_of_a_checkpoint_and_its_evaluation(run):
    found = Checkpoints(run / "checkpoints", read_only=True).restore_newest()
    leaves = {name: f"{a.dtype}{list(a.shape)}" for name, a in found.leaves.items()}
    assert leaves == GOLDEN["leaves"]
    means = evaluate_run(open_run(run, "last")).means
    for name, value in GOLDEN["means"].items():
        np.testing.assert_allclose(means[name], value, rtol=1e-4, atol=1e-6, err_msg=name)


def test_a_run_goes_on_as_before(config, run):
    leaves = named_leaves(loop.train(config, run).state)
    assert leaves.keys() == GOLDEN["resumed"].keys()
    for name, leaf in leaves.items():
        total = np.sum(np.abs(np.asarray(leaf, np.float64)))
        want = GOLDEN["resumed"][name]
        np.testing.assert_allclose(total, want, rtol=1e-3, atol=1e-6, err_msg=name)
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    for line, golden in zip(lines, GOLDEN["metrics"], strict=True):
        line.pop("samples_per_second", None)
        assert line.keys() == golden.keys()
        for name, value in golden.items():
            if isinstance(value, int | float):
                np.testing.assert_allclose(line[name], value, rtol=1e-3, atol=1e-6, err_msg=name)
