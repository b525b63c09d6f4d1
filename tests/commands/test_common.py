import errno
import os
import sys

import pytest
from helpers.commands import ROOT, psgn_each, python, run
from helpers.refusals import check_message
from jax.errors import JaxRuntimeError

from psgn_jax.commands import psgn
from psgn_jax.config.command_line import Flags
from psgn_jax.system.errors import UserError


def test_terminal_shows_own_progress_and_others_warnings():
    code = """
from psgn_jax.system.terminal import log_to_terminal, start_command
start_command()
from absl import logging
from psgn_jax.data.sources import authors
from psgn_jax.commands import convert
log_to_terminal()
logging.info("of another package")
logging.warning("their warning")
exec(compile("logging.info('own%sprogress', chr(10))", convert.__file__, "exec"))
"""
    result = python(code)
    lines = [line.partition(" ")[2] for line in result.stderr.splitlines()]
    assert lines == ["their warning", r"own\nprogress"], result.stderr


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (UserError("one\n two"), 2, "error: one two"),
        (UserError("weights=a/seed=1: no"), 2, "error: --weights=a/seed=1: no"),
        (FileNotFoundError(2, "No such file", "/no/such"), 2, "error: /no/such: No such file"),
        (OSError(errno.ENOSPC, "No space left", "/a/b"), 5, "error: /a/b: No space left"),
        (MemoryError(), 2, "error: not enough memory"),
        (KeyboardInterrupt(), 130, "stopped by Ctrl-C"),
        (JaxRuntimeError("RESOURCE_EXHAUSTED:\n9 B"), 2, "error: RESOURCE_EXHAUSTED: 9 B"),
    ],
)
def test_errors_of_the_system_end_in_one_line(capsys, error, code, line):
    def body(_):
        raise error

    flags = Flags("psgn anything", "")
    flags.string("weights", "", "A file.")
    assert flags.run(body, []) == code
    assert capsys.readouterr().err == line + "\n"


def test_errors_of_the_program_keep_their_traceback():
    with pytest.raises(ZeroDivisionError):
        Flags("psgn anything", "").run(lambda _: 1 / 0, [])


def test_wrong_arguments_end_in_one_line_before_a_network_is_made(tmp_path):
    file = tmp_path / "file"
    file.touch()
    predict = ["predict", f"--workdir={tmp_path}", f"--out={tmp_path}"]
    train = ["train", "--config=debug", f"--workdir={tmp_path / 'run'}"]
    cases = (
        (["train", "--config=debug", "--config.data.path=tests", f"--workdir={file}"], file),
        (["train", "--config=finetune"], "train.init='WEIGHTS'"),
        ([*train, "--config.data.path=/no/such"], "data.path='/no/such'"),
        ([*train, "--config.train.steps=1e5"], "train.steps='1e5'"),
        ([*train, "--num_processes=2"], "num_processes=2, process_id=None"),
        ([*train, "--nonsense"], "nonsense"),
        ([*train, "stray"], "'stray'"),
        (["evaluate", "--workdir=run", f"--report={file}"], file),
        (["evaluate", "--weights=none", "--data=tests"], "'tests'"),
        (["convert", "authors", "docs", "https://a.b/c"], "https://a.b/c"),
        (predict, "IMAGE"),
        ([*predict, "a.png", "--formats=stl"], "ply, xyz, obj, glb, npz"),
        (["predict", "docs/renders.png", "--workdir=run", f"--out={file}"], file),
        (["study", "losss"], "'losses'"),
    )
    found = psgn_each(*(arguments for arguments, _ in cases), JAX_PLATFORMS="none")
    for done, (_, message) in zip(found, cases, strict=True):
        assert (done.returncode, done.stderr[:7]) == (2, "error: "), done.stderr
        check_message(done.stderr, message)
    assert not (tmp_path / "run").exists()


def test_a_second_start_reads_compiled_programs_and_cores_are_devices(tmp_path):
    code = """
from psgn_jax.commands import common
from psgn_jax.system.terminal import start_command
start_command()
common.num_cores = lambda: 6
common.use_cores(18)
common.keep_compiled()
import jax
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
print(jax.jit(lambda x: x @ x + 1)(jax.numpy.ones((64, 64))).sum(), jax.device_count())
common.use_cores(1)  # too late, and without effect
"""
    environment = {"PATH": "/usr/bin:/bin", "JAX_PLATFORMS": "cpu", "PSGN_CACHE": str(tmp_path)}
    environment["TF_CPP_MIN_LOG_LEVEL"] = "1"  # as in the children of a process that imported jax

    def start(lines=0, **more):
        done = run(sys.executable, "-c", code, cwd=ROOT, env=environment | more)
        assert len(done.stderr.splitlines()) == lines, done.stderr
        return done.stdout

    first = start()
    assert first.split()[1] == "3"
    kept, *_ = tmp_path.rglob("*-cache")
    content = kept.read_bytes()
    kept.write_bytes(content[: len(content) // 2])  # as of a full disk
    assert start(lines=1) == first
    assert kept.stat().st_size > len(content) // 2
    assert start() == first
    kept.unlink()
    os.mkfifo(kept)  # reading it would wait without end
    assert start() == first
    assert start(JAX_NUM_CPU_DEVICES="2").split()[1] == "2"


def test_every_command_has_help_without_foreign_flags(capsys):
    for name in psgn.COMMANDS:
        assert psgn.main([name, "--help"]) == 0
        shown = capsys.readouterr().out
        assert shown.startswith(f"usage: psgn {name}"), name
        for foreign in ("verbosity", "pdb", "grain_py_debug_mode", "helpfull"):
            assert f"--{foreign}" not in shown, name
