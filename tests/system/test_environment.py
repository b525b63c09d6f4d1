"""Variables of the environment with which nothing can run end a command in one line."""

import os
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.commands import ROOT, run

from psgn_jax.system.environment import explained

LIST = ["weights", "list", "free-2"]  # imports JAX before it parses flags
TRAIN = ["train", "--config=debug", "--config.data.path="]


def psgn_with(name, value, *arguments, cwd):
    others = {key: x for key, x in os.environ.items() if key not in ("JAX_PLATFORMS", "XLA_FLAGS")}
    environment = {**others, "PYTHONPATH": str(ROOT), name: value}
    program = (sys.executable, "-m", "psgn_jax.commands.psgn")
    return run(*program, *arguments, cwd=cwd, env=environment)


@pytest.mark.parametrize(
    ("name", "value", "arguments", "why"),
    [
        ("JAX_PLATFORMS", "cuda", TRAIN, "JAX cannot start"),
        ("JAX_PLATFORMS", "bogus", TRAIN, "JAX cannot start (Unable to initialize backend"),
        ("JAX_NUM_CPU_DEVICES", "x", LIST, 'Invalid value "x"'),
        ("JAX_ENABLE_X64", "maybe", LIST, "invalid truth value"),
        ("XLA_FLAGS", "--xla_bogus_flag=1", LIST, "Unknown flag in XLA_FLAGS"),
        ("PSGN_CONVOLUTIONS", "bogus", LIST, "accepted: onednn, xla, or unset"),
    ],
)
def test_wrong_variables_are_named(name, value, arguments, why, tmp_path):
    done = psgn_with(name, value, *arguments, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: {name}={value}: {why}")


@pytest.mark.parametrize(
    ("name", "value", "context", "why"),
    [
        ("JAX_TRANSFER_GUARD", "disallow", jax.transfer_guard, "INVALID_ARGUMENT: Disallowed"),
        ("JAX_NUMPY_DTYPE_PROMOTION", "strict", jax.numpy_dtype_promotion, "Input dtypes"),
    ],
)
def test_errors_of_a_computation_name_the_variable(name, value, context, why, monkeypatch):
    monkeypatch.setenv(name, value)
    with context(value), pytest.raises(Exception, match=why) as caught:
        jax.jit(lambda x: x + jnp.ones(3, jnp.int8))(np.ones(3, np.float32))
    assert str(explained(caught.value)).startswith(f"{name}={value}: {why}")


def test_right_variables_change_nothing(tmp_path):
    done = psgn_with("XLA_FLAGS", "--xla_cpu_enable_fast_math=false", *LIST, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
