import json
import os
import re

import numpy as np
import pytest

from psgn_jax.config.experiment import ConfigError, parse, to_dict, to_json
from psgn_jax.weights.checkpoint import CheckpointError, Checkpoints
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
        with pytest.raises(ConfigError, match="another training is running"):
            locked(tmp_path).__enter__()


@pytest.fixture
def run(tmp_path):
    """A run of one checkpoint without a network."""
    config = parse({"model": {"fc_points": 64}})
    (tmp_path / "config.json").write_text(to_json(config))
    checkpoints = Checkpoints(tmp_path / "checkpoints")
    checkpoints.save(3, {"params.a.kernel": np.zeros(2)}, {"config": to_dict(config)})
    checkpoints.close()
    return tmp_path


def edit(run, old, new, checksum=False):
    """Replaces text of config.json, and deletes the line of its checksum."""
    text = (run / "config.json").read_text()
    if not checksum:
        text = re.sub(r'.*"crc32": .*\n', "", text)
    assert old in text
    (run / "config.json").write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("name", ["config.json", "checkpoints/scores.json", "metrics.jsonl"])
def test_a_named_pipe_in_the_folder_is_refused(run, name):
    (run / name).unlink(missing_ok=True)
    os.mkfifo(run / name)
    for opening in (open_run, lambda run: locked(run).__enter__()):
        with pytest.raises(OSError, match="it is a named pipe, expected a file"):
            opening(run)


@pytest.mark.parametrize(
    ("meta", "why"),
    [({}, r"\(it is missing\)"), ({"config": 5}, "accepted: a section"), ([], "meta is not an")],
)
def test_a_checkpoint_without_a_configuration_is_named(run, meta, why):
    checkpoints = Checkpoints(run / "checkpoints", keep=1)
    checkpoints.save(4, {"params.a.kernel": np.zeros(2)}, {"config": meta})
    checkpoints.close()
    file = run / "checkpoints" / "4" / "meta" / "metadata"
    document = json.loads(file.read_text())
    del document["crc32"]
    file.write_text(json.dumps(document | {"meta": meta}))
    with pytest.raises((ConfigError, CheckpointError), match=f"step 4.*{why}") as caught:
        open_run(run)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"fc_points": 64', '"fc_points": 32', r"step 3: model.fc_points=32 \(trained with 64\)"),
        ('"points"', '"volume"', r"does not fit the checkpoint of step 3: task='volume'"),
        ('"fc_points": 64', '"fc_points": -1', r"config.json: model.fc_points=-1: accepted"),
    ],
)
def test_a_configuration_that_does_not_fit_its_checkpoint(run, old, new, message):
    edit(run, old, new)
    with pytest.raises(ConfigError, match=message):
        open_run(run)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('"fscore_threshold": 0.01', '"fscore_threshold": 0.03', "its checksum does not match"),
        ("{", "[" * 100_000, "brackets nested"),
        ("{", "\0", "Expecting"),
    ],
)
def test_a_damaged_configuration_is_that_of_the_checkpoint(run, old, new, why, caplog):
    config = open_run(run).config
    edit(run, old, new, checksum=True)
    caplog.clear()
    assert open_run(run).config == config
    (line,) = [r.message for r in caplog.records if "config.json" in r.message]
    assert f"config.json: damaged: {why}" in line
    assert line.endswith("using the configuration in the checkpoint")
