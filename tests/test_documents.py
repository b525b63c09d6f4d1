"""README.md and docs/: the site builds, and the commands in them exist with these flags."""

import ast
import importlib.util
import inspect
import os
import pathlib
import re
import shlex
import subprocess
import sys

import pytest

from psgn_jax import cli, command_line, config_files
from psgn_jax.config import Config, to_dict

ROOT = pathlib.Path(__file__).resolve().parents[1]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]

_FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_DEFINES = re.compile(r"DEFINE_|add_argument$")


def commands():
    """All `psgn ...` lines of fenced blocks and of code in the text, with their page."""
    found = set()
    for page in PAGES:
        text = page.read_text()
        blocks = [m[2] for m in _FENCED.finditer(text) if m[1] in ("", "bash")]
        inline = re.findall(r"`(psgn [^`]+)`", _FENCED.sub("", text))
        lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
        for line in [*lines, *(" ".join(text.split()) for text in inline)]:
            if match := re.search(r"(?:^|[ /$])(psgn .*)", line.partition(" #")[0]):
                found.add((page.relative_to(ROOT).as_posix(), match[1]))
    return sorted(found)


def flags_defined_in(text):
    """Names of the flags that a piece of source defines."""
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    names = {
        str(argument.value).lstrip("-")
        for call in calls
        if _DEFINES.search(ast.unparse(call.func))
        for argument in call.args[:1]
        if isinstance(argument, ast.Constant)
    }
    if any(ast.unparse(call.func) == "define_network_flags" for call in calls):
        names |= flags_defined_in(inspect.getsource(command_line.define_network_flags))
    return names


def flags_of(module):
    """Names of the flags that a command's files define, read from their source."""
    spec = importlib.util.find_spec(module)
    path = pathlib.Path(spec.origin)
    sources = [path, path.with_name("common.py")] if "experiments" in module else [path]
    return {"help"}.union(*(flags_defined_in(source.read_text()) for source in sources))


def fields(tree, prefix="config."):
    for name, value in tree.items():
        yield f"{prefix}{name}"
        if isinstance(value, dict):
            yield from fields(value, f"{prefix}{name}.")


def known_fields(name):
    if name != "render":
        return set(fields(to_dict(Config())))
    from data_gen import settings

    return set(fields(settings.to_dict(settings.Settings())))


def test_the_documents_have_commands():
    assert len(commands()) > 20


@pytest.mark.parametrize(("page", "line"), commands())
def test_commands_exist_with_these_flags(page, line):
    name, *arguments = shlex.split(line)[1:]
    if name.startswith("-") or name in ("COMMAND", "NAME"):
        return
    table = cli.COMMANDS
    if name == "study":
        name, table = arguments[0], cli.STUDIES
        if name in ("NAME", "--help"):  # `psgn study NAME`
            return
    assert name in table
    known = flags_of(table[name].module) | known_fields(name)
    for argument in arguments:
        flag, _, value = argument.partition("=")
        if flag.startswith("--"):
            assert flag[2:] in known, f"{page}: {flag}"
        if flag == "--config" and name == "train":
            config_files.path_of(value)


def named_in_code():
    """Paths and dotted names in code of the documents, with their page."""
    for page in PAGES:
        for text in re.findall(r"`([^`\n]+)`", _FENCED.sub("", page.read_text())):
            for path in re.findall(
                r"\b(?:configs|data_gen|docs|notebooks|psgn_jax|tests)/[\w/.]+", text
            ):
                yield page.name, path
            for name in re.findall(r"\b(?:data_gen|psgn_jax)(?:\.[a-z]\w*)+", text):
                yield page.name, name


@pytest.mark.parametrize(("page", "name"), sorted(set(named_in_code())))
def test_files_and_modules_named_in_the_documents_exist(page, name):
    if "/" in name:
        in_wheel = name.startswith("psgn_jax/configs")
        assert in_wheel or (ROOT / name.rstrip(".")).exists()
        return
    *package, last = name.split(".")
    path = ROOT.joinpath(*package)
    if not (path / last).is_dir() and not (path / f"{last}.py").is_file():
        source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        assert re.search(rf"\b{last}\b", source.read_text()), f"{source} has no {last}"


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


def test_code_in_the_documents_is_valid():
    for page in PAGES:
        for language, code in _FENCED.findall(page.read_text()):
            if language == "python":
                compile(code, str(page), "exec")


def test_the_site_builds(tmp_path):
    pytest.importorskip("mkdocs", reason="the extra `docs` is not installed")
    pytest.importorskip("mkdocstrings_handlers.python", reason="the extra `docs` is not installed")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", f"--site-dir={tmp_path / 'site'}"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    reference = (tmp_path / "site" / "reference" / "losses" / "index.html").read_text()
    assert "chamfer_sq_mean" in reference
    for path in (tmp_path / "site").rglob("*.html"):
        foreign = re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=\"?(?:https?:)?//[^\s>]+",
                             path.read_text())  # fmt: skip
        assert not foreign, f"{path}: {foreign[0]}"
