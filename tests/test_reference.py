"""The examples in the API reference give the stated results."""

import doctest
import importlib
import re

import pytest
from helpers.commands import ROOT

from psgn_jax import losses
from psgn_jax.prediction.cloud import Prediction
from psgn_jax.prediction.predictor import Predictor


def examples_of(page):
    """The examples of a page of the reference, without the fences around them."""
    text = (ROOT / "docs" / "reference" / f"{page}.md").read_text()
    return "\n\n".join(re.findall(r"^```pycon\n(.*?)^```", text, re.MULTILINE | re.DOTALL))


PAGES = sorted(path.stem for path in (ROOT / "docs" / "reference").glob("*.md"))


@pytest.mark.parametrize("page", PAGES)
def test_examples_of_the_reference(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    test = doctest.DocTestParser().get_doctest(examples_of(page), {}, page, page, 0)
    result = doctest.DocTestRunner().run(test)
    assert result.attempted > 0
    assert result.failed == 0, "the differences are in the captured output"


@pytest.mark.parametrize("page", PAGES)
def test_every_name_of_the_reference_has_an_example(page):
    text, examples = (ROOT / "docs" / "reference" / f"{page}.md").read_text(), examples_of(page)
    names = [name for name in losses.__all__ if name not in losses.LOSSES and page == "losses"]
    block = r"^::: (\S+)\n(?:(?!:::).)*?members:\s*\[(.*?)\]"
    for module, members in re.findall(block, text, re.M | re.S):
        listed = re.findall(r"\w+", members)
        assert set(listed) <= set(dir(importlib.import_module(module))), module
        names += [n for n in listed if not n.endswith(("Config", "Effects"))]  # all have one form
    assert len(names) >= text.count("\n::: ")
    if page == "prediction":
        names += [name for kind in (Prediction, Predictor) for name in vars(kind) if name[0] != "_"]
    assert [name for name in names if not re.search(rf"\b{name}\b", examples)] == []
