"""Configurations: every mistake ends in one line naming field, value and what is accepted."""

import pathlib
import runpy

import ml_collections
import pytest

from psgn_jax.commands.default_data import ensure_default_data
from psgn_jax.config.command_line import Flags
from psgn_jax.config.experiment import (
    Config,
    ConfigError,
    check_paths,
    check_used,
    from_json,
    parse,
    to_dict,
    to_json,
)
from psgn_jax.config.structured import flatten


def test_defaults_and_round_trips():
    assert parse({}) == Config()
    assert parse(ml_collections.ConfigDict(to_dict(Config()))) == Config()
    config = parse({"data": {"image_size": [96, 128], "inputs": ["rgb", "depth", "mask"]}})
    assert from_json(to_json(config)) == config
    assert config.model.image_size == (96, 128)
    assert config.model.in_channels == 6
    assert "in_channels" not in to_dict(config)["model"]


WRONG = [
    ({"modle": {}}, "modle is not a field; did you mean 'model'? accepted: seed, data"),
    ({"model": {"widhts": (1, 2)}}, "model.widhts is not a field; did you mean 'widths'?"),
    ({"model": {"in_channels": 3}}, "model.in_channels follows from data"),
    ({"model": 3}, "model=3: accepted: a section with name"),
    ({"train": {"steps": 1.5}}, "train.steps=1.5: accepted: an integer"),
    ({"train": {"steps": True}}, "train.steps=True: accepted: an integer"),
    ({"optim": {"learning_rate": 0}}, "optim.learning_rate=0: accepted: a number > 0"),
    ({"optim": {"learning_rate": float("nan")}}, "accepted: a finite number"),
    ({"optim": {"b1": 1.0}}, "optim.b1=1.0: accepted: a number >= 0 and < 1"),
    ({"optim": {"schedule": "cosin"}}, "did you mean 'cosine'? accepted: 'constant', 'cosine'"),
    ({"model": {"posterior": True}}, "model.random_size=0: accepted: at least 1 with model.post"),
    (
        {"model": {"posterior": True, "random_size": 2}, "loss": {"min_of_n": 2}},
        "loss.min_of_n=2: accepted: 1 with model.posterior=True",
    ),
    ({"optim": {"warmup_steps": 9}, "train": {"steps": 9}}, "fewer than train.steps=9"),
    ({"data": {"flip": 1}}, "data.flip=1: accepted: True or False"),
    ({"data": {"inputs": ("rgb", "rgb")}}, "each once"),
    ({"data": {"inputs": ("mask",)}}, "'rgb' and any of"),
    ({"data": {"image_size": (64,)}}, "data.image_size=(64,): accepted: a tuple of 2"),
    ({"data": {"image_size": (16, 256)}}, "data.image_size=(16, 256): accepted: (height, width)"),
    ({"model": {"widths": (8,)}}, "at least two resolution levels"),
    ({"model": {"deconv_level": 6}}, "model.deconv_level=6: accepted: 0 to 5"),
    ({"model": {"deconv_channels": 4}}, "a multiple of 3"),
    ({"loss": {"min_of_n": 2}}, "loss.min_of_n=2: accepted: 1, since without a random input"),
    ({"loss": {"winner_points": 9}}, "loss.winner_points=9: accepted: 0 with loss.min_of_n=1"),
    ({"task": "refiner"}, "voxels.from_cd='': accepted: the folder of a trained run"),
    ({"task": "volume", "data": {"stretch": 0.1}}, "data.stretch=0.1: accepted: 0 with task"),
    ({"task": "volume", "eval": {"refine": True}}, "eval.refine=True: accepted: False with task"),
    ({"task": "volume", "data": {"image_size": (100, 128)}}, "multiples of 64 for 'volume'"),
    ({"task": "views", "data": {"inputs": ("rgb", "depth")}}, "'rgb' and 'mask' with"),
    ({"task": "views", "voxels": {"eval_views": (1, 1)}}, "numbers of views, each once"),
    ({"task": "views", "loss": {"l2": "authors"}}, "loss.l2='authors': accepted: 'none' with"),
    ({"model": {"name": "vanilla", "fc_points": 0}}, "model.fc_points=0: accepted: at least 1"),
    ({"model": {"name": "lite0"}}, "model.name='lite0': accepted: 'vanilla', 'two_branch', "),
    ({"loss": {"l2_scale": 0.2}}, "loss.l2_scale is not a field"),
]


def test_mistakes_are_named():
    for tree, message in WRONG:
        with pytest.raises(ConfigError) as caught:
            parse(tree)
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "field", "value"),
    [
        (["--config.model.widths=(4,8)", "--config.model.widths=(8,16)"], "widths", (8, 16)),
        (["--config.model.fc_widths=(4,8)", "--config.model.fc_widths=()"], "fc_widths", ()),
        (["--config.model.fc_points=4", "--config.model.fc_points=8"], "fc_points", 8),
        (["--config.model.posterior=1", "-config.model.posterior=false"], "posterior", False),
    ],
)
def test_the_last_one_of_repeated_flags_counts(arguments, field, value, capsys):
    flags = Flags("psgn anything", "")
    flags.config(Config(), file="configs/base.py")
    assert flags.run(lambda _: None, [*arguments, "--config.seed=3"]) == 0
    assert flags.settings.seed == 3
    assert flags.settings.model[field] == value
    assert flags.fields[-2:] == [f"model.{field}", "seed"]
    assert flags.run(lambda _: None, ["--config.model.posterior"]) == 2
    assert "--config.model.posterior: accepted: --config.FIELD=VALUE" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        ({"task": "volume", "loss": {"name": "emd_mean"}},
         "loss.name='emd_mean': accepted: 'chamfer_sq_mean' unless task='points'"),
        ({"task": "refiner", "voxels": {"from_cd": "x"}, "model": {"random_size": 2},
          "loss": {"min_of_n": 2}}, "model.random_size=2: accepted: 0 unless task='points'"),
        ({"task": "views", "model": {"posterior": True, "random_size": 2}},
         "model.posterior=True: accepted: False unless task='points'"),
        ({"loss": {"kl_weight": 2}}, "loss.kl_weight=2.0: accepted: 1.0 unless model.posterior"),
        ({"loss": {"kl_warmup_steps": 2}}, "accepted: 0 unless model.posterior=True"),
        ({"model": {"random_at": "all"}}, "'bottleneck' unless model.random_size > 0"),
        ({"task": "volume", "eval": {"aligned": True}}, "False unless task='points'"),
        ({"model": {"posterior_hidden": 2}}, "accepted: 128 unless model.posterior=True"),
        ({"loss": {"emd_tolerance": 0.1}}, "accepted: 0.01 unless loss.name has an EMD"),
        ({"optim": {"final_fraction": 0.1}}, "accepted: 0.0 unless optim.schedule='cosine'"),
        ({"voxels": {"max_views": 2}}, "voxels.max_views=2: accepted: 5 unless task='views'"),
        ({"task": "views", "voxels": {"from_emd": "x"}}, "accepted: '' unless task='refiner'"),
    ],
)  # fmt: skip
def test_settings_without_effect_are_refused_on_the_command_line(tree, message):
    config = parse(tree)
    check_used(config, ["seed"])  # a recipe may have them
    with pytest.raises(ConfigError) as caught:
        check_used(config, flatten(config))
    assert message in str(caught.value)


def test_missing_and_wrong_paths(tmp_path):
    (tmp_path / "file").touch()
    for path, message in (
        (f"{tmp_path},/no/such", "data.path='/no/such' does not exist"),
        (str(tmp_path / "file"), "is not a folder"),
    ):
        with pytest.raises(ConfigError, match=message):
            check_paths(parse({"data": {"path": path}}))
    for path in ("/no/such", ""):  # not needed by an evaluation
        evaluated = parse({"data": {"path": path, "eval_path": str(tmp_path)}})
        check_paths(evaluated, training=False)
        ensure_default_data(evaluated, training=False)
    check_paths(parse({}))


def test_names_of_folders_may_have_commas_and_a_home(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b,c", "d, e,f"):
        (tmp_path / name).mkdir()
    for path, folders in (
        ("a, b,c ,d, e,f", ("a", "b,c", "d, e,f")),
        ("b,c*2,a", ("b,c", "b,c", "a")),
        ("b,c *2", ("b,c", "b,c")),
        ("~/a,~/b,c", (f"{tmp_path}/a", f"{tmp_path}/b,c")),
        ("a,,no,b", ("a", "no", "b")),
        (",".join("x" * 3000), ("x",) * 3000),  # at once
    ):
        assert parse({"data": {"path": path}}).data.folders == folders
    check_paths(parse({"data": {"path": "a,b,c", "eval_path": "~/d, e,f"}}))


def test_every_configuration_file_is_valid_and_says_how_it_is_run():
    for path in (pathlib.Path(__file__).resolve().parents[1] / "configs").glob("*.py"):
        module = runpy.run_path(str(path))
        config = parse(module["get_config"]())
        check_used(config, flatten(config))
        assert f"python -m psgn_jax.main --config=configs/{path.name}" in module["__doc__"]
