import pytest

from psgn_jax.config import ConfigError
from psgn_jax.training.run_folder import locked


def test_a_folder_is_locked_until_its_owner_ends(tmp_path):
    with locked(tmp_path / "run"), pytest.raises(ConfigError, match="another training is running"):
        locked(tmp_path / "run").__enter__()
    with locked(tmp_path / "run"):
        pass
