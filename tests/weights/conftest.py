import pytest
from helpers import weights as tiny

from psgn_jax.weights import opening
from psgn_jax.weights.file import write_weights


@pytest.fixture
def config():
    return tiny.config(data__path="/somewhere/private/records")


@pytest.fixture
def weights(config):
    return tiny.weights(config)


@pytest.fixture
def file(weights, tmp_path):
    write_weights(tmp_path / "small-1.safetensors", weights)
    return tmp_path / "small-1.safetensors"


@pytest.fixture
def shipped(monkeypatch, tmp_path):
    """An empty folder that replaces the folder of the weights in the package."""
    folder = tmp_path / "shipped"
    folder.mkdir()
    monkeypatch.setattr(opening, "FOLDER", folder)
    return folder
