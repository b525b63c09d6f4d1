import os
import sys

import pytest
from helpers.commands import ROOT, run
from helpers.refusals import check_message, refused
from helpers.standin import write_solids

from psgn_jax.commands import psgn as cli
from psgn_jax.config import files
from psgn_jax.config.command_line import load_file
from psgn_jax.config.experiment import ConfigError


def test_help_and_errors_list_commands_and_configurations(capsys):
    assert cli.main([]) == cli.main(["--help"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert all(lines.count([name, *text.split()]) == 2 for name, text in cli.COMMANDS.items())
    assert cli.main(["trian"]) == 2
    check_message(capsys.readouterr().err, "error: psgn trian", "'train'", *cli.COMMANDS)
    assert cli.main(["train", "--workdir=runs/none"]) == 2
    first, *lines = capsys.readouterr().err.splitlines()
    check_message(first, "error: --config")
    assert [line.split()[0] for line in lines] == files.names()


@pytest.mark.parametrize(
    ("shell", "command", "code", "error"),
    [
        ('exec "$@" >&-', ["--help"], 0, ""),
        ('exec "$@" > /dev/full', ["inspect", "datä"], 5, "error: No space left on device\n"),
        ('PYTHONIOENCODING=ascii exec "$@"', ["inspect", "datä"], 0, ""),
        ('set -o pipefail; "$@" | true', ["inspect", "datä"], 141, ""),
        ('set -o pipefail; PYTHONUNBUFFERED=1 "$@" | true', ["inspect", "datä"], 141, ""),
        ('set -o pipefail; "$@" | true', ["--help"], 141, ""),
    ],
)
def test_output_that_nothing_can_take_ends_in_no_traceback(shell, command, code, error, tmp_path):
    write_solids(tmp_path / "datä")
    script = "import sys; from psgn_jax.commands.psgn import main; sys.exit(main())"
    program = ["bash", "-c", shell, "bash", sys.executable, "-c", script, *command]
    environment = {key: v for key, v in os.environ.items() if key != "PYTHONUNBUFFERED"}
    environment["PYTHONPATH"] = str(ROOT)
    assert run(*program, code=code, cwd=tmp_path, env=environment).stderr == error


def test_ctrl_c_skips_what_python_does_at_exit():
    """There, jaxlib crashed after an interrupted compilation."""
    script = """
import atexit, signal, sys
from psgn_jax.commands import psgn
atexit.register(print, "at exit")
psgn.importlib.import_module = lambda name: signal.raise_signal(signal.SIGINT)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may start tests that ignore it
sys.argv = ["psgn", "view"]
sys.exit(psgn.main())
"""
    done = run(sys.executable, "-c", script, code=130, cwd=ROOT)
    assert (done.stdout, done.stderr) == ("", "stopped by Ctrl-C\n")


def test_a_configuration_is_a_path_or_a_name_and_executed_once(tmp_path, capsys):
    assert files.path_of("configs/debug.py") == "configs/debug.py"
    assert files.path_of("debug") == str(ROOT / "configs" / "debug.py")
    assert files.path_of("data_gen/config.py:photo") == "data_gen/config.py:photo"
    with refused(ConfigError, "--config=configs/debgu.py", "'debug'"):
        files.path_of("configs/debgu.py")
    file, mark = tmp_path / "mine.py", tmp_path / "mark"
    file.write_text(
        f"with open({str(mark)!r}, 'a') as file:\n    file.write('x')\n"
        "from psgn_jax.config import files\n\n\n"
        "def get_config():\n    return files.load('debug')\n"
    )
    arguments = ["train", f"--config={file}", "--config.train.steps=0", "--config.seed=1"]
    assert cli.main(arguments) == 2
    check_message(capsys.readouterr().err, "error: train.steps=0", ">= 1")
    assert mark.read_text() == "x"


def test_files_that_are_no_configurations(tmp_path):
    path = tmp_path / "file.py"
    for content, why in {
        b"root:x:0:0:root:/root:/bin/bash\n": "SyntaxError",
        b"x = 1": "get_config",
        b"def get_config(): raise RuntimeError('what')": "RuntimeError: what",
        b"#" * 1_000_001: "1000000 bytes",
    }.items():
        path.write_bytes(content)
        with refused(ConfigError, f"--config={path}", why, "get_config()"):
            load_file(str(path))
