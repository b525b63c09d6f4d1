"""Shared fixtures. Strict promotion is set before anything is traced."""

import os
import pathlib

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

jax.config.update("jax_numpy_rank_promotion", "raise")

_AUTHORS = pathlib.Path(__file__).resolve().parents[2] / "shared" / "psgn_batches"


@pytest.fixture(scope="session")
def authors_batches() -> pathlib.Path:
    """Folder with the authors' published batches; `PSGN_AUTHORS_BATCHES` overrides the place."""
    path = pathlib.Path(os.environ.get("PSGN_AUTHORS_BATCHES", _AUTHORS))
    if not path.is_dir():
        pytest.skip(f"the authors' batches are not at {path}")
    return path


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
