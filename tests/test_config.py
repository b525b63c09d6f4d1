"""Configurations: every mistake ends in one line naming field, value and what is accepted."""

import pathlib
import runpy
import subprocess
import sys

import jax
import ml_collections
import pytest

from psgn_jax.config import (
    Config,
    ConfigError,
    check_paths,
    flatten,
    from_json,
    parse,
    to_dict,
    to_json,
)
from psgn_jax.losses.by_name import parse_terms
from psgn_jax.models import point_out_net


def test_defaults_are_the_dataclasses():
    assert parse({}) == Config()
    assert parse(ml_collections.ConfigDict(to_dict(Config()))) == Config()


def test_round_trip_through_json():
    config = parse({"data": {"image_size": [96, 128], "inputs": ["rgb", "depth", "mask"]}})
    assert from_json(to_json(config)) == config
    assert config.model.image_size == (96, 128)
    assert config.model.in_channels == 6
    assert "in_channels" not in to_dict(config)["model"]


def test_flatten_names_every_field():
    flat = flatten(Config())
    assert flat["train.steps"] == 300_000
    assert flat["seed"] == 0
    assert "model.image_size" not in flat


WRONG = [
    ({"modle": {}}, "modle is not a field; did you mean 'model'? accepted: seed, data"),
    ({"model": {"widhts": (1, 2)}}, "model.widhts is not a field; did you mean 'widths'?"),
    ({"model": {"in_channels": 3}}, "model.in_channels follows from data"),
    ({"model": 3}, "model=3: accepted: a section with name"),
    ({"train": {"steps": 1.5}}, "train.steps=1.5: accepted: an integer"),
    ({"train": {"steps": "many"}}, "train.steps='many': accepted: an integer"),
    ({"train": {"steps": True}}, "train.steps=True: accepted: an integer"),
    ({"train": {"steps": 0}}, "train.steps=0: accepted: a number >= 1"),
    ({"optim": {"learning_rate": 0}}, "optim.learning_rate=0: accepted: a number > 0"),
    ({"optim": {"learning_rate": float("nan")}}, "accepted: a finite number"),
    ({"optim": {"b1": 1.0}}, "optim.b1=1.0: accepted: a number >= 0 and < 1"),
    ({"optim": {"schedule": "cosin"}}, "did you mean 'cosine'? accepted: 'constant', 'cosine'"),
    ({"model": {"posterior": True}}, "model.random_size=0: accepted: at least 1 with model.post"),
    (
        {"model": {"posterior": True, "random_size": 2}, "loss": {"min_of_n": 2}},
        "loss.min_of_n=2: accepted: 1 with model.posterior=True",
    ),
    (
        {"model": {"posterior": True, "random_size": 2, "posterior_widths": ()}},
        "model.posterior_widths=(): accepted: 1 to 5 widths",
    ),
    ({"model": {"random_at": "fcc"}}, "model.random_at='fcc': did you mean 'fc'?"),
    (
        {"model": {"random_at": "fc", "fc_points": 0}},
        "model.random_at='fc': accepted: 'bottleneck', because there is no fc branch",
    ),
    ({"loss": {"kl_weight": -1}}, "loss.kl_weight=-1: accepted: a number >= 0"),
    ({"optim": {"warmup_steps": 9}, "train": {"steps": 9}}, "fewer than train.steps=9"),
    ({"data": {"flip": 1}}, "data.flip=1: accepted: True or False"),
    ({"data": {"path": None}}, "data.path=None: accepted: a string"),
    ({"data": {"inputs": "rgb"}}, "data.inputs='rgb': accepted: a tuple"),
    ({"data": {"inputs": ("rgb", "msk")}}, "data.inputs[1]='msk': did you mean 'mask'?"),
    ({"data": {"inputs": ("rgb", "rgb")}}, "each once"),
    ({"data": {"inputs": ("mask",)}}, "'rgb' and any of"),
    ({"data": {"image_size": (64,)}}, "data.image_size=(64,): accepted: a tuple of 2"),
    ({"data": {"image_size": (16, 256)}}, "data.image_size=(16, 256): accepted: (height, width)"),
    ({"data": {"image_size": (192, -1)}}, "data.image_size[1]=-1: accepted: a number >= 1"),
    ({"model": {"widths": (8,)}}, "at least two resolution levels"),
    ({"model": {"deconv_level": 6}}, "model.deconv_level=6: accepted: 0 to 5"),
    ({"model": {"deconv_channels": 4}}, "a multiple of 3"),
    ({"loss": {"min_of_n": 0}}, "loss.min_of_n=0: accepted: a number >= 1"),
    ({"loss": {"min_of_n": 2}}, "loss.min_of_n=2: accepted: 1, since without a random input"),
    ({"model": {"name": "vanilla", "fc_points": 0}}, "model.fc_points=0: accepted: at least 1"),
]


@pytest.mark.parametrize(("tree", "message"), WRONG, ids=[m for _, m in WRONG])
def test_mistakes_are_named(tree, message):
    with pytest.raises(ConfigError) as caught:
        parse(tree)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_wrong_paths(tmp_path):
    with pytest.raises(ConfigError, match=r"data.path='/no/such' does not exist"):
        check_paths(parse({"data": {"path": "/no/such"}}))
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(ConfigError, match="is not a folder"):
        check_paths(parse({"data": {"path": str(file)}}))
    with pytest.raises(ConfigError, match="'/no/such' does not exist"):
        check_paths(parse({"data": {"path": f"{tmp_path},/no/such"}}))
    check_paths(parse({}))


@pytest.mark.parametrize("text", ["{", "[]", '{"model": {"nam": 1}}'])
def test_foreign_json_is_refused(text):
    with pytest.raises(ConfigError):
        from_json(text)


@pytest.mark.parametrize(
    "name", ["authors", "authors_small", "base", "debug", "mo2_cd", "quickstart"]
)
def test_config_files_parse(name, request):
    root = request.config.rootpath
    parse(runpy.run_path(str(root / "configs" / f"{name}.py"))["get_config"]())


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--config.train.stps=3"], "train.stps"),
        (["--config.train.steps=many"], "many"),
        (["--config.train.steps=-1"], "train.steps=-1: accepted: a number >= 1"),
        (["--config.data.image_size=(4,4)"], "data.image_size=(4, 4): accepted"),
        (["--config.data.path=/no/such"], "data.path='/no/such' does not exist"),
        (["--config.model.name=pointnet"], "model.name='pointnet': accepted: 'vanilla'"),
        (["--config=configs/none.py"], "configs/none.py"),
        (["--nonsense"], "nonsense"),
        (["stray"], "unexpected argument 'stray'"),
    ],
)
def test_wrong_command_lines_end_in_one_line(flags, message, request, tmp_path):
    root = request.config.rootpath
    command = [sys.executable, "-m", "psgn_jax.main", "--config=configs/debug.py"]
    result = subprocess.run(
        [*command, f"--workdir={tmp_path / 'run'}", *flags],
        capture_output=True,
        text=True,
        cwd=root,
    )
    assert result.returncode == 2, result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("error: ")
    assert message in lines[0]
    assert not (tmp_path / "run").exists()


FILES = sorted((pathlib.Path(__file__).resolve().parents[1] / "configs").glob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_configuration_file_is_valid_and_says_what_to_expect(path):
    module = runpy.run_path(str(path))
    parse(module["get_config"]())
    text = module["__doc__"]
    assert f"python -m psgn_jax.main --config=configs/{path.name}" in text
    for word in ("Hardware", "ime", "xpect"):
        assert word in text, word


@pytest.mark.parametrize("name", ["authors_small", "authors_small_cd", "pretrained"])
def test_size_of_the_small_networks(name):
    """They promise 5.2 M parameters."""
    (path,) = [p for p in FILES if p.stem == name]
    config = parse(runpy.run_path(str(path))["get_config"]())
    model = point_out_net.build(config.model)
    image = jax.ShapeDtypeStruct((1, *config.model.image_size, 4), "float32")
    params = jax.eval_shape(lambda x: model.init(jax.random.key(0), x, None), image)["params"]
    assert 5e6 < sum(leaf.size for leaf in jax.tree.leaves(params)) < 5.25e6


def test_what_compares_no_losses_is_trained_by_their_sum():
    configs = {
        path.stem: parse(runpy.run_path(str(path))["get_config"]())
        for path in FILES
        if path.stem
        in ("authors_small", "authors_small_cd", "finetune", "pretrained", "quickstart")
    }
    by_cd = configs.pop("authors_small_cd")
    assert {c.loss.name for c in configs.values()} == {"emd_mean@1024 + 5*chamfer_sq_mean"}
    small, by_cd = flatten(configs["authors_small"]), flatten(by_cd)
    assert {key for key in small if small[key] != by_cd[key]} == {"loss.name"}
    assert by_cd["loss.name"] == "chamfer_sq_mean"


def test_what_ships_sees_a_million_and_a_half_samples():
    (path,) = [p for p in FILES if p.stem == "pretrained"]
    config = parse(runpy.run_path(str(path))["get_config"]())
    assert config.train.steps * config.train.batch_size >= 1.5e6
    assert config.data.eval_folders == ("records/authors",)
    assert len(set(config.data.folders)) > 1
    assert [term.num_points for term in parse_terms(config.loss.name)] == [1024, 0]
