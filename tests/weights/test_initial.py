"""`train.init`: a training starts from the parameters of another one."""

import json

import numpy as np
import pytest
from helpers import weights as tiny
from helpers.refusals import all_refused, refused

from psgn_jax.config.experiment import ConfigError, from_json
from psgn_jax.training.loop import train
from psgn_jax.weights.file import write_weights
from psgn_jax.weights.leaves import named_leaves
from psgn_jax.weights.opening import initial_params, open_initial, origins_of


def test_a_training_begins_with_the_trained_network(tmp_path):
    two = {"train__steps": 2, "train__eval_every": 2, "optim__learning_rate": 1e-9}
    base = tiny.config(**two)
    path = tmp_path / "w.safetensors"
    weights = tiny.weights(base, "float32")
    write_weights(path, weights)
    config = tiny.config(**two, train__init=str(path))
    outcome = train(config, tmp_path / "run")
    lines = [json.loads(x) for x in (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()]
    first, last = (line for line in lines if line["kind"] == "eval")
    assert (first["step"], last["step"]) == (0, 2)
    # The learning rate is almost 0, so both the parameters and their averages are still the same.
    trained = named_leaves(weights.params)
    for tree in (outcome.state.params, outcome.state.ema):
        for name, leaf in named_leaves(tree).items():
            np.testing.assert_allclose(leaf, trained[name], atol=1e-7, err_msg=name)
    assert first["cd_sq_radius2"] == pytest.approx(last["cd_sq_radius2"], rel=1e-5)
    assert from_json((tmp_path / "run" / "config.json").read_text()).train.init == str(path)
    # The run resumes from its own checkpoint, even if the file no longer exists.
    path.unlink()
    assert int(train(config, tmp_path / "run").state.step) == 2
    with refused(ConfigError, tmp_path / "run", "train.init="):
        train(base, tmp_path / "run")
    with refused(ConfigError, f"train.init={str(path)!r}", "the folder of a run"):
        train(config, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_layers_that_do_not_fit_are_named_and_left_out_only_when_asked():
    config = tiny.config(train__init="w")
    other = tiny.config(model__fc_widths=(20,))
    trained, drawn = tiny.random_params(config, 0), tiny.random_params(other, 1)
    shapes = {name: leaf.shape for name, leaf in named_leaves(trained).items()}
    different = [n for n, leaf in named_leaves(drawn).items() if leaf.shape != shapes[n]]
    layers = sorted({name.rpartition(".")[0] for name in different})
    flag = '"(' + "".join(f"'{layer}'," for layer in layers) + ')"'
    with refused(ConfigError, "train.init=", *layers, f"train.init_skip={flag}"):
        initial_params(config, drawn, trained)
    partial = tiny.config(train__init="w", train__init_skip=tuple(layers))
    for name, leaf in named_leaves(initial_params(partial, drawn, trained)).items():
        source = drawn if name.rpartition(".")[0] in layers else trained
        np.testing.assert_array_equal(leaf, named_leaves(source)[name], err_msg=name)
    pattern = tiny.config(train__init="w", train__init_skip=("x*",))
    with refused(ConfigError, "train.init_skip", "'x*'", *layers):
        initial_params(pattern, drawn, trained)


def test_a_new_random_input_changes_little_at_first():
    config = tiny.config(model__random_size=4, train__init="w")
    trained, drawn = tiny.random_params(tiny.config(), 0), tiny.random_params(config, 1)
    taken, new = named_leaves(initial_params(config, drawn, trained)), named_leaves(drawn)
    (name,) = taken.keys() - named_leaves(trained).keys()
    assert name.endswith("bottleneck.random.kernel")
    np.testing.assert_allclose(taken[name], 0.1 * new[name], rtol=1e-6)


def test_a_network_of_another_task_is_refused(tmp_path):
    write_weights(tmp_path / "w.safetensors", tiny.weights(tiny.config()))
    volume = tiny.config(task="volume", train__init=str(tmp_path / "w.safetensors"))
    with refused(ConfigError, "train.init=", "'points'", "'volume'"):
        open_initial(volume)
    with refused(ConfigError, "init_skip=('a',)", "train.init"):
        tiny.config(train__init_skip=("a",))


def test_several_networks_start_as_their_mean(tmp_path):
    config = tiny.config()
    files = [tmp_path / "one.safetensors", tmp_path / "two.safetensors"]
    given = [tiny.random_params(config, seed) for seed in (0, 1)]
    for file, params in zip(files, given, strict=True):
        write_weights(file, tiny.weights(config, "float32")._replace(params=params))
    comma = tmp_path / "a, b" / "one.safetensors"
    write_weights(comma, tiny.weights(config))
    assert origins_of(tiny.config(train__init=str(comma)))[1][1:] == tiny.SOURCES
    both = open_initial(tiny.config(train__init=f"{files[0]}, {files[1]}"))
    assert both.source.startswith("the mean of ")
    leaves = [named_leaves(params) for params in (*given, both.params)]
    for name, mean in leaves[2].items():
        want = (np.asarray(leaves[0][name]) + np.asarray(leaves[1][name])) / 2
        np.testing.assert_allclose(mean, want, atol=1e-7, err_msg=name)
    write_weights(files[1], tiny.weights(tiny.config(model__fc_widths=(20,)), "float32"))
    table = [
        (f"{files[0]},{files[1]}", "two.safetensors' has other layers"),
        (f"{files[0]},nothing", "train.init='nothing'"),
        (",".join("x" * 150), "train.init='x'"),
        (f"{files[0]},", "train.init=", "empty"),
    ]
    all_refused(lambda init: open_initial(tiny.config(train__init=init)), ConfigError, table)
