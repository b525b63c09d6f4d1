"""The common structure of the studies: files, options, stopped trainings; charts and grids."""

import dataclasses
import importlib.util
import json
import math
import types

import numpy as np
import pytest
from PIL import Image

from psgn_jax.config import Config, ConfigError, UserError
from psgn_jax.experiments import common, figures


def measure(options):
    return {"value": options.scale * np.arange(3.0).sum(), "none": [math.nan]}, "rest"


def table(numbers):
    return [[["what", "number"], ["value", f"{numbers['value']:.1f}"]]]


def figure(numbers, rest):
    assert rest == "rest"
    chart = figures.Bars("a title", ["first", "second"], {"a": [1.0, math.nan], "b": [2.0, 3.0]})
    return {"bars": figures.bars([chart])}


STUDY = common.Study(
    "demo", lambda _: (), measure, table, figure, options={"scale": 1.0}, note="a note"
)


def test_a_study_writes_tables_numbers_and_figures(tmp_path):
    text = STUDY.run(tmp_path, scale=2.0)
    assert text == "what   number\n-------------\nvalue     6.0\n\na note\n"
    assert (tmp_path / "demo.txt").read_text() == text
    markdown = "| what | number |\n| --- | --- |\n| value | 6.0 |\n\na note\n"
    assert (tmp_path / "demo.md").read_text() == markdown
    document = json.loads((tmp_path / "demo.json").read_text())
    assert document == {"options": {"scale": 2.0}, "value": 6.0, "none": [None]}
    with Image.open(tmp_path / "bars.png") as picture:
        assert picture.size == (860, 300)
    with pytest.raises(TypeError, match="expected options among"):
        STUDY.run(tmp_path, scales=2.0)


def test_a_stopped_training_ends_the_study_with_the_signals_code(tmp_path, monkeypatch):
    started = []

    def train(config, folder):
        started.append(folder)
        return types.SimpleNamespace(stopped_by=15)

    monkeypatch.setattr(common.train_lib, "train", train)
    study = dataclasses.replace(STUDY, configs=lambda _: [("a", Config()), ("b", Config())])
    with pytest.raises(UserError, match="the same command continues") as caught:
        study.run(tmp_path)
    assert caught.value.exit_code == 143
    assert started == [tmp_path / "a"]


def test_without_matplotlib_nothing_is_trained(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'psgn-jax\[experiments\]'"):
        STUDY.run(tmp_path)


def test_a_grid_of_images_and_values():
    image, values = np.zeros((24, 32, 3), np.uint8), np.array([[0.0, 1.0], [math.nan, 0.5]])
    rows = [{"image": image, "map": values}, {"image": image}]
    sheet = figures.grid(rows, labels=["a", "b"], scale=(0.0, 1.0), scale_title="radius")
    titles = [axes.get_title() for axes in sheet.axes[:4]]
    assert titles == ["image", "map", "", ""]  # no title below the same title
    assert [axes.get_ylabel() for axes in sheet.axes[:4]] == ["a", "", "b", ""]
    assert figures.png(sheet).startswith(b"\x89PNG")
