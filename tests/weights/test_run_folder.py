import json
import os
import re

import numpy as np
import pytest
from helpers.refusals import refused
from helpers.weights import write_run

from psgn_jax.config.experiment import ConfigError, parse
from psgn_jax.weights.checkpoint import CheckpointError
from psgn_jax.weights.run_folder import locked, open_run


def test_a_folder_is_locked_and_cleared_of_what_killed_trainings_left(tmp_path):
    (tmp_path / "checkpoints").mkdir()
    names = (".config.json.0123abcd.tmp", "checkpoints/.scores.json.9876fedc.tmp")
    left = [tmp_path / name for name in names]
    others = [tmp_path / "config.json", tmp_path / ".mine.tmp"]
    for path in left + others:
        path.touch()
    with locked(tmp_path):
        assert [path.exists() for path in left + others] == [False] * 2 + [True] * 2
        with refused(ConfigError, tmp_path, "another training"):
            locked(tmp_path).__enter__()


@pytest.fixture
def run(tmp_path):
    """A run of one checkpoint without a network."""
    config = parse({"model": {"fc_points": 64}})
    return write_run(tmp_path, config, {"params": {"a": {"kernel": np.zeros(2)}}})


@pytest.mark.parametrize("name", ["config.json", "checkpoints/scores.json", "metrics.jsonl"])
def test_a_named_pipe_in_the_folder_is_refused(run, name):
    (run / name).unlink(missing_ok=True)
    os.mkfifo(run / name)
    for opening in (open_run, lambda run: locked(run).__enter__()):
        with refused(OSError, "named pipe"):
            opening(run)


def test_what_does_not_fit_is_named(run):
    metadata = run / "checkpoints" / "3" / "meta" / "metadata"
    settings, document = (run / "config.json").read_text(), metadata.read_text()
    unchecked = re.sub(r'.*"crc32": .*\n', "", settings)
    for old, new, *names in (
        ('"fc_points": 64', '"fc_points": 32', "step 3", "model.fc_points=32", 64),
        ('"points"', '"volume"', "step 3", "task='volume'"),
        ('"fc_points": 64', '"fc_points": -1', "config.json", "model.fc_points=-1"),
    ):
        (run / "config.json").write_text(unchecked.replace(old, new, 1))
        with refused(ConfigError, *names):
            open_run(run)
    (run / "config.json").write_text(settings)
    for meta in ({}, {"config": 5}, []):
        changed = {key: value for key, value in json.loads(document).items() if key != "crc32"}
        metadata.write_text(json.dumps(changed | {"meta": meta}))
        with refused((ConfigError, CheckpointError), run, "step 3"):
            open_run(run)


@pytest.mark.parametrize(
    ("old", "new"),
    [("_threshold\": 0.01", "_threshold\": 0.03"), ("{", "[" * 100_000), ("{", "\0")],
)  # fmt: skip
def test_a_damaged_configuration_is_that_of_the_checkpoint(run, old, new, caplog):
    config, text = open_run(run).config, (run / "config.json").read_text()
    (run / "config.json").write_text(text.replace(old, new, 1))
    caplog.clear()
    assert open_run(run).config == config
    (line,) = [r.message for r in caplog.records if "config.json" in r.message]
    assert "config.json: damaged" in line
