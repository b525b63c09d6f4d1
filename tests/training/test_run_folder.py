import numpy as np
import pytest

from psgn_jax.config import ConfigError, parse, to_dict, to_json
from psgn_jax.training.checkpoint import Checkpoints
from psgn_jax.training.run_folder import locked, open_run


def test_a_folder_is_locked_until_its_owner_ends(tmp_path):
    with locked(tmp_path / "run"), pytest.raises(ConfigError, match="another training is running"):
        locked(tmp_path / "run").__enter__()
    with locked(tmp_path / "run"):
        pass


def test_what_killed_trainings_left_is_removed(tmp_path):
    (tmp_path / "checkpoints").mkdir()
    left = [tmp_path / ".config.json.123.tmp", tmp_path / "checkpoints/.scores.json.9.tmp"]
    others = [tmp_path / "config.json", tmp_path / ".mine.tmp"]
    for path in left + others:
        path.touch()
    with locked(tmp_path):
        assert [path.exists() for path in left + others] == [False] * 2 + [True] * 2


@pytest.fixture
def run(tmp_path):
    """A run of one checkpoint without a network."""
    config = parse({"model": {"fc_points": 64}})
    (tmp_path / "config.json").write_text(to_json(config))
    checkpoints = Checkpoints(tmp_path / "checkpoints")
    checkpoints.save(3, {"params.a.kernel": np.zeros(2)}, {"config": to_dict(config)})
    checkpoints.close()
    return tmp_path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"fc_points": 64', '"fc_points": 32', r"step 3: model.fc_points=32 \(trained with 64\)"),
        ('"points"', '"volume"', r"does not fit the checkpoint of step 3: task='volume'"),
        ('"fc_points": 64', '"fc_points": -1', r"config.json: model.fc_points=-1: accepted"),
        ("{", "[" * 100_000, r"config.json: it is not JSON"),
        ("{", "\0", r"config.json: it is not JSON"),
    ],
)
def test_a_configuration_that_does_not_fit_its_checkpoint(run, old, new, message):
    path = run / "config.json"
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(ConfigError, match=message):
        open_run(run)


def test_a_configuration_that_is_no_text(run):
    (run / "config.json").write_bytes(b"\xff\x00")
    with pytest.raises(ConfigError, match=r"config\.json: it is not JSON"):
        open_run(run)


def test_fields_that_say_nothing_of_the_network_may_differ(run):
    path = run / "config.json"
    path.write_text(path.read_text().replace('"num_workers": 0', '"num_workers": 3', 1))
    assert open_run(run).config.data.num_workers == 3
