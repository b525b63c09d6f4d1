"""What `evaluate_run` hands to a task and states about it."""

import dataclasses
import json
import types

import numpy as np
import pytest
from helpers import weights as tiny

from psgn_jax import tasks
from psgn_jax.evaluation.results import Evaluation, SampleName
from psgn_jax.tasks.run import evaluate_run
from psgn_jax.weights.run_folder import Trained


@pytest.mark.parametrize(("asked", "want"), [(None, True), (False, False), (True, True)])
def test_the_runs_own_setting_decides_whether_clouds_are_refined(
    tmp_path, monkeypatch, asked, want
):
    config = tiny.config(eval__refine=True)
    names, metrics = [SampleName(0, "chair", "a", 0)], {"cd_sq_radius2": np.ones(1)}
    result = Evaluation("validation", names, metrics, 0.01, (8, 64))
    seen = []

    def create(config, workdir):
        seen.append(config.eval)
        return types.SimpleNamespace(evaluate=lambda params, **options: result)

    monkeypatch.setattr(tasks, "create", create)
    evaluate_run(Trained(config, 1, {}, {}, "tiny", "weights"), out=tmp_path, refine=asked)
    assert seen == [dataclasses.replace(config.eval, aligned=True, refine=want)]
    assert json.loads((tmp_path / "table.json").read_text())["refine"] is want
