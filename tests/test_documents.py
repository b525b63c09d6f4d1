import ast
import doctest
import re
import shlex
import sys

import pytest
from helpers.commands import ROOT, run

import psgn_jax
from psgn_jax.commands import psgn, study
from psgn_jax.config import Config
from psgn_jax.config.files import path_of
from psgn_jax.config.structured import flatten

FOLDERS = "configs|data_gen|docs|notebooks|psgn_jax|scripts|tests"
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
PAGES = [p for p in PAGES if p.name not in ("CHANGELOG.md", "journal.md")]
_FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def command_lines():
    """All `psgn ...` lines of fenced blocks and of code in the text, with their page."""
    found = set()
    for page in PAGES:
        text = page.read_text()
        blocks = [code for kind, code in _FENCED.findall(text) if kind in ("", "bash")]
        lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
        inline = re.findall(r"`(psgn [^`]+)`", _FENCED.sub("", text))
        for line in [*lines, *(" ".join(text.split()) for text in inline)]:
            if match := re.search(r"(?:^|[ /$])psgn (.*)", line.partition(" #")[0]):
                found.add((page.name, match[1]))
    return sorted(found)


def flags_in(path):
    return {f"--{name}" for name in re.findall(r"""["'](?:--)?([a-z]\w+)["']""", path.read_text())}


def test_commands_and_their_flags_exist():
    from data_gen import settings as rendering

    training = {f"--config.{name}" for name in flatten(Config())}
    known_to_render = {f"--config.{name}" for name in flatten(rendering.Settings())}
    lines = command_lines()
    assert len(lines) > 20
    wrong = []
    for page, line in lines:
        name, *arguments = shlex.split(line)
        if name.startswith("-") or name == "COMMAND":
            continue
        if name == "study" and arguments and arguments[0] not in (*study.STUDIES, "NAME"):
            wrong.append(f"{page}: psgn {line}: no study {arguments[0]}")
        if name not in psgn.COMMANDS:
            wrong.append(f"{page}: psgn {line}: no command {name}")
            continue
        module = psgn.module(name).replace(".", "/")
        files = [ROOT / f"{module}.py", *(ROOT / "psgn_jax").glob("*/common.py")]
        files += [ROOT / "data_gen" / "render.py"] * (name == "render")
        known = set().union({"--help"}, *map(flags_in, files))
        known |= known_to_render if name == "render" else training
        for argument in arguments:
            flag, _, value = argument.partition("=")
            if flag.startswith("--") and flag not in known:
                wrong.append(f"{page}: psgn {line}: no flag {flag}")
            if flag == "--config" and name == "train":
                path_of(value)
    assert not wrong, "\n".join(wrong)


def test_files_and_imports_in_the_documents_exist():
    wrong = []
    for page in PAGES:
        for kind, code in _FENCED.findall(page.read_text()):
            for node in ast.walk(ast.parse(code if kind == "python" else "")):
                if isinstance(node, ast.ImportFrom) and str(node.module).startswith("psgn_jax"):
                    exec(ast.unparse(node), {})
        for code in re.findall(r"`([^`\n]+)`", _FENCED.sub("", page.read_text())):
            names = re.findall(rf"\b(?:{FOLDERS})/[\w/.]*\w", code)
            if page.name == "architecture.md":  # which leaves out the package's name
                names += re.findall(r"^[\w/]+\.py$", code)
            for name in names:
                exists = any((ROOT / top / name).exists() for top in ("", "psgn_jax", "data_gen"))
                if not exists and not name.startswith("psgn_jax/configs"):
                    wrong.append(f"{page.name}: {name}")
    assert not wrong, "\n".join(wrong)


def test_the_version_is_that_of_the_citation_and_of_the_changes():
    citation = (ROOT / "CITATION.cff").read_text()
    (version,) = re.findall(r"^version: (\S+)$", citation, re.MULTILINE)
    (date,) = re.findall(r"^date-released: (\S+)$", citation, re.MULTILINE)
    assert version == psgn_jax.__version__
    assert f"\n## {version}, {date}\n" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.usefixtures("keep_compiled")
def test_the_training_loop_on_the_page_of_losses_trains():
    page = (ROOT / "docs" / "losses.md").read_text()
    loop = page.partition("<!-- loop -->\n```python\n")[2].partition("```")[0]
    small = loop.replace("1024", "64").replace("3072", "192")
    exec(small.replace("range(60)", "range(1)"), first := {})
    exec(small, last := {})
    assert last["value"] < 0.8 * first["value"]


@pytest.mark.slow
def test_the_site_builds(tmp_path):
    pytest.importorskip("mkdocstrings_handlers.python", reason="the extra `docs` is not installed")
    command = (sys.executable, "-m", "mkdocs", "build", "--strict")
    run(*command, f"--site-dir={tmp_path / 'site'}", cwd=ROOT)
    reference = (tmp_path / "site" / "reference" / "losses" / "index.html").read_text()
    assert "chamfer_sq_mean" in reference


def examples_of(page):
    """The examples of a page of the reference, without the fences around them."""
    text = (ROOT / "docs" / "reference" / f"{page}.md").read_text()
    return "\n\n".join(re.findall(r"^```pycon\n(.*?)^```", text, re.MULTILINE | re.DOTALL))


REFERENCE = sorted(path.stem for path in (ROOT / "docs" / "reference").glob("*.md"))


@pytest.mark.parametrize("page", REFERENCE)
def test_examples_of_the_reference(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    test = doctest.DocTestParser().get_doctest(examples_of(page), {}, page, page, 0)
    result = doctest.DocTestRunner().run(test)
    assert result.attempted > 0
    assert result.failed == 0, "the differences are in the captured output"
