"""Results that no refactoring may change: the leaves of a checkpoint, metrics, an evaluation.

`oracles/golden.json` has the measurements of a run of 6 steps, from the code of version 0.1.0.dev0,
on the records in `oracles/solids`. If you mean other numbers, say in CHANGELOG that trainings are
no longer comparable.
"""

import json
import pathlib

import numpy as np
from helpers import standin

from psgn_jax.tasks.run import evaluate_run
from psgn_jax.training import loop
from psgn_jax.training.log import read_metrics
from psgn_jax.weights.checkpoint import Checkpoints
from psgn_jax.weights.run_folder import open_run

GOLDEN = json.loads(pathlib.Path(__file__).with_name("oracles").joinpath("golden.json").read_text())


def test_a_run_of_six_steps(tmp_path):
    run = tmp_path / "run"
    steps = {"train__steps": 6, "train__eval_every": 3, "train__keep_checkpoints": 1}
    loop.train(standin.config(eval__emd_tolerance=0.01, **steps), run)
    found = Checkpoints(run / "checkpoints", read_only=True).restore_newest()
    leaves = {name: f"{a.dtype}{list(a.shape)}" for name, a in found.leaves.items()}
    assert leaves == GOLDEN["leaves"]
    measured = [*read_metrics(run / "metrics.jsonl"), evaluate_run(open_run(run, "last")).means]
    wanted = [*((line, 1e-3) for line in GOLDEN["metrics"]), (GOLDEN["means"], 1e-4)]
    for line, (golden, rtol) in zip(measured, wanted, strict=True):
        for name, value in golden.items():
            if isinstance(value, int | float):
                np.testing.assert_allclose(line[name], value, rtol, 1e-6, err_msg=name)
