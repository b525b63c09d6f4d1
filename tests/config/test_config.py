import runpy

import ml_collections
import pytest
from helpers.commands import ROOT
from helpers.refusals import all_refused, check_message, refused

from psgn_jax.commands import train
from psgn_jax.commands.default_data import ensure_default_data
from psgn_jax.config import Config, ConfigError, files, parse, to_dict
from psgn_jax.config.command_line import Flags
from psgn_jax.config.experiment import check_paths, check_used, from_json, to_json
from psgn_jax.config.structured import flatten, suggestion
from psgn_jax.models.networks import build


def test_defaults_and_round_trips():
    assert parse({}) == parse(ml_collections.ConfigDict(to_dict(Config()))) == Config()
    config = parse({"data": {"image_size": [96, 128], "inputs": ["rgb", "depth", "mask"]}})
    assert from_json(to_json(config)) == config
    assert config.model.image_size == (96, 128)
    assert config.model.in_channels == 6
    assert "in_channels" not in to_dict(config)["model"]


def test_mistakes_are_named():
    vae = {"posterior": True, "random_size": 2}
    all_refused(parse, ConfigError, [
        ({"modle": {}}, "modle", "'model'", "seed"),
        ({"model": {"widhts": (1, 2)}}, "model.widhts", "'widths'"),
        ({"optim": {"lr": 1}}, "optim.lr", "'learning_rate'"),
        ({"model": {"in_channels": 3}}, "model.in_channels", "data"),
        ({"model": 3}, "model=3", "section", "name"),
        ({"train": {"steps": 1.5}}, "train.steps=1.5", "integer"),
        ({"train": {"steps": True}}, "train.steps=True", "integer"),
        ({"optim": {"learning_rate": 0}}, "optim.learning_rate=0", "> 0"),
        ({"optim": {"learning_rate": float("nan")}}, "optim.learning_rate", "finite"),
        ({"optim": {"b1": 1.0}}, "optim.b1=1.0", ">= 0 and < 1"),
        ({"optim": {"schedule": "cosin"}}, "optim.schedule", "'cosine'", "'constant'"),
        ({"model": {"posterior": True}}, "model.random_size=0", "model.posterior"),
        ({"model": vae, "loss": {"min_of_n": 2}}, "loss.min_of_n=2", "model.posterior=True"),
        ({"optim": {"warmup_steps": 9}, "train": {"steps": 9}}, "warmup_steps=9", "train.steps=9"),
        ({"data": {"flip": 1}}, "data.flip=1", "True", "False"),
        ({"data": {"inputs": ("rgb", "rgb")}}, "data.inputs", "once"),
        ({"data": {"inputs": ("mask",)}}, "data.inputs", "'rgb'"),
        ({"data": {"image_size": (64,)}}, "data.image_size=(64,)", "tuple of 2"),
        ({"data": {"image_size": (16, 256)}}, "data.image_size=(16, 256)", "32", "model.widths"),
        ({"model": {"widths": (8,)}}, "model.widths=(8,)", "two"),
        ({"model": {"deconv_level": 6}}, "model.deconv_level=6", "0 to 5"),
        ({"model": {"deconv_channels": 4}}, "model.deconv_channels=4", "3"),
        ({"loss": {"min_of_n": 2}}, "loss.min_of_n=2", "model.random_size=0"),
        ({"loss": {"winner_points": 9}}, "loss.winner_points=9", "loss.min_of_n=1"),
        ({"task": "refiner"}, "voxels.from_cd=''", "voxels.from_emd"),
        ({"task": "volume", "data": {"stretch": 0.1}}, "data.stretch=0.1", "'volume'"),
        ({"task": "volume", "eval": {"refine": True}}, "eval.refine=True", "'volume'"),
        ({"task": "volume", "data": {"image_size": (100, 128)}}, "data.image_size", "64"),
        ({"task": "views", "data": {"inputs": ("rgb", "depth")}}, "data.inputs", "'views'"),
        ({"task": "views", "voxels": {"eval_views": (1, 1)}}, "voxels.eval_views", "once"),
        ({"task": "views", "loss": {"l2": "authors"}}, "loss.l2='authors'", "'none'"),
        ({"model": {"name": "vanilla", "fc_points": 0}}, "model.fc_points=0", "1"),
    ])  # fmt: skip
    with refused(ConfigError, "model.name='vanila'", "did you mean 'vanilla'", "'two_branch'"):
        build(parse({"model": {"name": "vanila"}}).model)


def test_suggestions_are_of_the_same_meaning():
    fields = flatten(Config())
    for name, meant in {
        "optim.lr": "optim.learning_rate", "train.lr": "optim.learning_rate",
        "batch_size": "train.batch_size", "eval.batchsize": "eval.batch_size",
        "train.stps": "train.steps", "data.jpg": "data.photo.jpeg",
    }.items():  # fmt: skip
        assert meant in suggestion(name, fields)
    assert suggestion("optim.foo", fields) == suggestion("e", ["export"]) == ""


@pytest.mark.parametrize(
    ("arguments", "field", "value"),
    [
        (["--config.model.widths=(4,8)", "--config.model.widths=(8,16)"], "widths", (8, 16)),
        (["--config.model.fc_widths=(4,8)", "--config.model.fc_widths=()"], "fc_widths", ()),
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
    check_message(capsys.readouterr().err, "--config.model.posterior", "--config.FIELD=VALUE")


def test_help_lists_configurations_and_fields(capsys):
    assert train.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {name} " in text for name in files.names())
    assert all(f"--config.{name}=" in text for name in flatten(Config()))


def test_settings_without_effect_are_refused_on_the_command_line():
    source, draws = {"from_cd": "x"}, {"model": {"random_size": 2}, "loss": {"min_of_n": 2}}
    table = [
        ({"task": "volume", "loss": {"name": "emd_mean"}}, "loss.name='emd_mean'", "'points'"),
        ({"task": "refiner", "voxels": source, **draws}, "model.random_size=2", "'points'"),
        ({"task": "volume", "eval": {"aligned": True}}, "eval.aligned=True", "'points'"),
        ({"loss": {"kl_weight": 2}}, "loss.kl_weight=2.0", "1.0", "model.posterior"),
        ({"model": {"random_at": "all"}}, "model.random_at", "'bottleneck'", "model.random_size"),
        ({"model": {"posterior_hidden": 2}}, "model.posterior_hidden=2", "128"),
        ({"loss": {"emd_tolerance": 0.1}}, "loss.emd_tolerance=0.1", "0.01", "loss.name"),
        ({"optim": {"final_fraction": 0.1}}, "optim.final_fraction=0.1", "optim.schedule"),
        ({"voxels": {"max_views": 2}}, "voxels.max_views=2", "5", "'views'"),
        ({"task": "views", "voxels": {"from_emd": "x"}}, "voxels.from_emd='x'", "'refiner'"),
    ]
    for tree, *_ in table:
        check_used(parse(tree), ["seed"])  # a file may have them
    every = flatten(Config())
    all_refused(lambda tree: check_used(parse(tree), every), ConfigError, table)


def test_missing_and_wrong_paths(tmp_path):
    (tmp_path / "file").touch()
    table = [(f"{tmp_path},/no/such", "data.path='/no/such'"), (f"{tmp_path}/file", "data.path")]
    all_refused(lambda path: check_paths(parse({"data": {"path": path}})), ConfigError, table)
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
    for path in (ROOT / "configs").glob("*.py"):
        module = runpy.run_path(str(path))
        config = parse(module["get_config"]())
        check_used(config, flatten(config))
        assert f"python -m psgn_jax.main --config=configs/{path.name}" in module["__doc__"]
