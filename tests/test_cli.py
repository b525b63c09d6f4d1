"""The console script: every command is reached by name, with its own flags and exit codes."""

import ast
import importlib.util
import os
import pathlib
import re
import subprocess
import sys
import zipfile

import pytest
from helpers import drawn_solids

from psgn_jax import cli, config_files
from psgn_jax.config import ConfigError
from psgn_jax.data.dataset import write_dataset

ROOT = pathlib.Path(__file__).resolve().parents[1]
ALL = {**cli.COMMANDS, **cli.STUDIES}


def run(*arguments, cwd=ROOT, **environment):
    return subprocess.run(
        [sys.executable, "-m", "psgn_jax.cli", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, **environment},
        timeout=400,
    )


@pytest.mark.parametrize("arguments", [[], ["--help"]])
def test_help_lists_each_command_on_a_line(arguments, capsys):
    assert cli.main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    for name, command in cli.COMMANDS.items():
        assert any(line.split() == [name, *command.summary.split()] for line in lines), name
    assert any(line.split()[:1] == ["study"] for line in lines)


def test_help_of_the_studies_lists_them(capsys):
    assert cli.main(["study", "--help"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in cli.STUDIES)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["trian"], "psgn trian: no such command; did you mean 'train'? expected one of train"),
        (["study", "losss"], "psgn study losss: no such command; did you mean 'losses'?"),
    ],
)
def test_an_unknown_command_ends_in_one_line(arguments, message, capsys):
    assert cli.main(arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    (line,) = shown.err.splitlines()
    assert line.startswith("error: ")
    assert message in line


@pytest.mark.parametrize("name", list(ALL))
def test_each_name_is_a_module_that_runs(name):
    spec = importlib.util.find_spec(ALL[name].module)
    assert spec is not None
    body = ast.parse(pathlib.Path(spec.origin).read_text()).body
    assert any(isinstance(node, ast.If) and "__main__" in ast.unparse(node.test) for node in body)


def test_every_experiment_is_a_study():
    paths = (ROOT / "psgn_jax" / "experiments").glob("*.py")
    commands = {path.stem for path in paths if 'if __name__ == "__main__"' in path.read_text()}
    assert {study.module.rpartition(".")[2] for study in cli.STUDIES.values()} == commands


def test_arguments_and_exit_codes_are_those_of_the_command():
    shown = run("inspect", "--help")
    assert shown.returncode == 0
    assert "--sheet" in shown.stdout
    shown = run("train", "--help")
    assert shown.returncode == 0
    assert "--workdir" in shown.stdout
    done = run("train", "--config=quickstart", "--config.train.steps=-1")
    assert done.returncode == 2
    assert done.stderr == "error: train.steps=-1: accepted: a number >= 1 and <= 2147483647\n"


def test_a_configuration_is_a_path_or_a_name():
    assert config_files.path_of("configs/debug.py") == "configs/debug.py"
    assert config_files.path_of("debug") == str(ROOT / "configs" / "debug.py")
    assert config_files.path_of("debug:small") == str(ROOT / "configs" / "debug.py") + ":small"
    assert set(config_files.names()) == {p.stem for p in (ROOT / "configs").glob("*.py")}
    for wrong in ("debgu", "configs/debgu.py"):
        with pytest.raises(ConfigError, match=r"did you mean 'debug'\? expected the path"):
            config_files.path_of(wrong)


@pytest.mark.parametrize("form", [["--config", "debug"], ["--config=debug"], ["-config=debug"]])
def test_names_are_replaced_on_the_command_line(form):
    path = config_files.path_of("debug")
    replaced = config_files.with_paths(["psgn", *form, "--config.seed=3", "debug"])
    expected = [*form[:-1], form[-1].replace("debug", path)]
    assert replaced == ["psgn", *expected, "--config.seed=3", "debug"]


@pytest.mark.slow
def test_a_wheel_trains_by_name_without_a_clone(tmp_path):
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", f"-w{tmp_path}", str(ROOT)]
    subprocess.run(command, check=True, timeout=300)
    (wheel,) = tmp_path.glob("*.whl")
    packages = tmp_path / "packages"
    zipfile.ZipFile(wheel).extractall(packages)
    (entry_points,) = packages.glob("*.dist-info/entry_points.txt")
    assert "psgn = psgn_jax.cli:main" in entry_points.read_text()
    assert (packages / "psgn_jax" / "configs" / "quickstart.py").is_file()
    environment = {"PYTHONPATH": str(packages), "PYTHONSAFEPATH": "1"}
    done = run(
        "train", "--config=quickstart", "--config.train.steps=-1", cwd=tmp_path, **environment
    )
    assert done.stderr == "error: train.steps=-1: accepted: a number >= 1 and <= 2147483647\n"
    solids = {
        split: drawn_solids.samples(8, seed=seed, image_size=(48, 64))
        for seed, split in enumerate(("train", "validation"))
    }
    write_dataset(tmp_path / "records", solids, source="solids")
    options = ["data.path=records", "train.steps=2", "train.eval_every=0", "train.batch_size=4"]
    flags = [f"--config.{option}" for option in [*options, "optim.warmup_steps=0"]]
    done = run("train", "--config=debug", *flags, cwd=tmp_path, **environment)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "debug" / "config.json").is_file()


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"root:x:0:0:root:/root:/bin/bash\n", "SyntaxError"),
        (b"\x89PNG\r\n\x1a\n\0\0", "null bytes"),
        (b'{"seed": 0, "flip": false}', "name 'false' is not defined"),
        (b"def get_config(:", "SyntaxError"),
        (b"x = 1", "it has no function get_config"),
        (b"import no_such_module", "No module named 'no_such_module'"),
        (b"def get_config(): raise RuntimeError('what')", "RuntimeError: what"),
        (b"def get_config(): return {}['a']", "KeyError"),
        (b"def get_config(): return get_config()", "RecursionError"),
        (b"def get_config(): return 5", "get_config returns int"),
        (b"def get_config(text): return 5", "missing 1 required positional"),
        (b"#" * 1_000_001, "more than 1000000 bytes"),
    ],
)
def test_files_that_are_no_configurations(content, why, tmp_path):
    path = tmp_path / "file.py"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=re.escape(why)) as caught:
        config_files.with_paths(["psgn", f"--config={path}"])
    assert str(caught.value).startswith(f"--config={path} is not a configuration (")
    assert "a Python file with a function get_config()" in str(caught.value)


def test_the_argument_of_a_configuration_is_checked_with_it(tmp_path):
    path = tmp_path / "file.py"
    path.write_text(
        "import ml_collections\n"
        "def get_config(size): return ml_collections.ConfigDict({'large': {}}[size])\n"
    )
    assert config_files.with_paths(["--config", f"{path}:large"])[1] == f"{path}:large"
    with pytest.raises(ConfigError, match="KeyError: 'small'"):
        config_files.with_paths(["--config", f"{path}:small"])


def test_an_interrupt_while_modules_are_imported(monkeypatch, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.runpy, "run_module", interrupted)
    assert cli.main(["train", "--config=debug"]) == 130
    assert capsys.readouterr().err == "stopped by Ctrl-C\n"
