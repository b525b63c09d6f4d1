import pathlib
import subprocess
import sys

import pytest

from psgn_jax.command_line import exit_on_user_error
from psgn_jax.config import UserError

ROOT = pathlib.Path(__file__).resolve().parents[1]


def test_terminal_shows_own_progress_and_others_warnings():
    code = """
from absl import logging
from psgn_jax import command_line
from psgn_jax.data.sources import authors
from psgn_jax import convert
command_line.log_to_terminal()
logging.info("of another package")
logging.warning("their warning")
exec(compile("logging.info('own progress')", convert.__file__, "exec"))
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    lines = [line.partition(" ")[2] for line in result.stderr.splitlines()]
    assert lines == ["their warning", "own progress"], result.stderr


def test_user_errors_end_in_one_line(capsys):
    with pytest.raises(SystemExit) as caught, exit_on_user_error():
        raise UserError("one\n two")
    assert caught.value.code == 2
    assert capsys.readouterr().err == "error: one two\n"


def test_a_second_start_reads_compiled_programs_without_a_word(tmp_path):
    code = """
from psgn_jax.command_line import keep_compiled
keep_compiled()
import jax
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
print(jax.jit(lambda x: x @ x + 1)(jax.numpy.ones((64, 64))).sum())
"""
    environment = {"PATH": "/usr/bin:/bin", "JAX_PLATFORMS": "cpu", "PSGN_CACHE": str(tmp_path)}
    outputs = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, env=environment
        )
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""
        outputs.append(done.stdout)
    assert outputs[0] == outputs[1]
    assert [path for path in tmp_path.rglob("*") if path.is_file()]
