"""The examples in docstrings and in the API reference give the stated results."""

import doctest
import importlib
import pathlib
import re

import pytest

from psgn_jax import losses
from psgn_jax.prediction.cloud import Prediction
from psgn_jax.prediction.predictor import Predictor

ROOT = pathlib.Path(__file__).resolve().parents[1]


def modules_with_examples() -> list[str]:
    paths = [p for package in ("psgn_jax", "data_gen") for p in (ROOT / package).rglob("*.py")]
    return sorted(
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in paths
        if ">>> " in path.read_text()
    )


@pytest.mark.parametrize("name", modules_with_examples())
def test_examples(name):
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted > 0
    assert result.failed == 0, "the differences are in the captured output"


def examples_of(page):
    """The examples of a page of the reference, without the fences around them."""
    text = (ROOT / "docs" / "reference" / f"{page}.md").read_text()
    return "\n\n".join(re.findall(r"^```pycon\n(.*?)^```", text, re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize(
    "page", ["config", "data", "data_gen", "losses", "models", "prediction", "training"]
)
def test_examples_of_the_reference(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    test = doctest.DocTestParser().get_doctest(examples_of(page), {}, page, page, 0)
    result = doctest.DocTestRunner().run(test)
    assert result.attempted > 0
    assert result.failed == 0, "the differences are in the captured output"


def test_every_public_name_has_an_example():
    named = re.findall(r"losses\.(\w+)", examples_of("losses"))
    missing = [name for name in losses.__all__ if name not in named]
    methods = {"cloud": Prediction, "model": Predictor}
    missing += [
        f"{name}.{method}"
        for name, kind in methods.items()
        for method in vars(kind)
        if method[0] != "_" and f"{name}.{method}" not in examples_of("prediction")
    ]
    assert missing == []
