import json
import pickle
import shutil
import types

import jax
import numpy as np
import pytest
from helpers import weights as tiny
from helpers.refusals import all_refused, check_message, refused

import psgn_jax
from psgn_jax.commands import export
from psgn_jax.commands import weights as command
from psgn_jax.commands.common import network_of
from psgn_jax.config.experiment import ConfigError, to_json
from psgn_jax.weights.file import read_weights
from psgn_jax.weights.opening import DEFAULT, open_weights, weights_path
from psgn_jax.weights.opening import shipped as shipped_files


def write_run(folder, config, weights):
    """A run whose averaged parameters differ from the current ones."""
    doubled = jax.tree.map(lambda leaf: 2 * leaf, weights.params)
    trees = {"params": doubled, "ema": weights.params}
    return tiny.write_run(folder, config, trees, 12, cd_sq_radius2=0.5, emd_radius=0.25)


@pytest.fixture
def run(config, weights, tmp_path):
    return write_run(tmp_path / "run", config, weights)


def test_names_of_shipped_weights(shipped, file):
    names = (DEFAULT, "small-1", "small-2", "large")
    for name in names:
        shutil.copy(file, shipped / f"{name}.safetensors")
    assert list(shipped_files()) == sorted(names)
    assert open_weights().source == DEFAULT
    network = open_weights("small-2")
    assert (network.source, network.source_kind, network.step) == ("small-2", "weights", 50)
    assert network.scores == {"cd_sq_radius2": 0.0123}
    assert weights_path(str(file)) == file
    table = [
        ({"source": "smal-1"}, "weights='smal-1'", "'small-1'", "the folder of a run"),
        ({"source": "small-1", "checkpoint": "last"}, "checkpoint=last"),
        ({"source": file.parent, "argument": "network"}, f"network={file.parent}", "no run"),
    ]
    all_refused(lambda arguments: open_weights(**arguments), ConfigError, table)
    flags = types.SimpleNamespace(workdir="runs/x", weights="small-1")
    with refused(ConfigError, "weights=small-1"):
        network_of(flags)


def test_a_pickled_predictor_has_the_same_clouds(file):
    """As Ray, joblib and spawned processes pickle it, without the file."""
    model = psgn_jax.load(file)
    file.unlink()
    again = pickle.loads(pickle.dumps(model))
    photo = np.zeros((16, 32, 4), np.uint8)
    photo[4:12, 8:20] = 200
    np.testing.assert_array_equal(again(photo).points, model(photo).points)
    assert (again.checksum, again.source) == (model.checksum, "small-1")


def test_export_takes_the_checkpoint_as_asked(run, weights, tmp_path, capsys):
    sources = tmp_path / "sources.json"
    sources.write_text(json.dumps(weights.sources))
    out = tmp_path / "w.safetensors"
    arguments = ["export", f"--workdir={run}", f"--out={out}", f"--sources={sources},{sources}"]
    assert command.main([*arguments, "--dtype=float32"]) == 0
    read = read_weights(out)
    assert read.figures["averaged"] is True
    assert read.figures["metrics"] == {"cd_sq_radius2": 0.5, "emd_radius": 0.25}
    assert read.figures["data"] == [{"name": "records"}]
    assert len(read.sources) == 4
    of_run, of_file = psgn_jax.load(run), psgn_jax.load(out)
    assert (of_run.source_kind, of_run.checksum) == ("workdir", of_file.checksum)
    assert (of_file.source_kind, of_file.source, of_file.step) == ("weights", "w", 12)
    want, have = jax.tree.leaves(weights.params)[0], jax.tree.leaves(read.params)[0]
    np.testing.assert_array_equal(have, want)
    seen = read.figures["samples_seen"]
    assert command.main([*arguments, "--noema", "--checkpoint=last", "--samples_before=1000"]) == 0
    read = read_weights(out)
    assert read.figures["samples_seen"] == seen + 1000
    assert (read.figures["averaged"], read.figures["metrics"]) == (False, {})
    np.testing.assert_allclose(jax.tree.leaves(read.params)[0], 2 * want, rtol=1e-3)


def test_sources_and_licences_are_inherited(run, file, config, weights, tmp_path, capsys):
    """Of a file and of a run that started from one; only what is new is not stated."""
    changes = {"data__path": "/b/mine,/b/records", "train__init": f"{file},{run}"}
    middle = write_run(tmp_path / "middle", tiny.config(**changes), weights)
    config = tiny.config(data__path="/a/level/chairs,/a/turned/chairs", train__init=str(middle))
    last = write_run(tmp_path / "last", config, weights)
    out = tmp_path / "last.safetensors"
    assert command.main(["export", f"--workdir={last}", f"--out={out}"]) == 0
    assert "CC-BY-3.0 (7 models: Ada, Bo)" in " ".join(capsys.readouterr().out.split())
    sources = read_weights(out).sources
    stated = {row["source"] for row in weights.sources}
    assert {row["source"] for row in sources if row["licences"]} == stated
    unstated = [row["source"] for row in sources if not row["licences"]]
    assert unstated == ["level/chairs", "turned/chairs", "mine", "the data of run"]
    data = [row["name"] for row in read_weights(out).figures["data"]]
    assert data == ["level/chairs", "turned/chairs", "mine", "records", "chairs"]
    table = tmp_path / "sources.json"
    table.write_text(json.dumps([{"source": "level", "licences": {"MIT": {}}}]))
    arguments = ["export", f"--workdir={last}", f"--out={out}", f"--sources={table}"]
    assert command.main(arguments) == 0
    assert read_weights(out).sources == [{"source": "level", "licences": {"MIT": {}}}, *sources[2:]]
    values = types.SimpleNamespace(workdir=last, weights=None, checkpoint="best", out=tmp_path)
    assert list(export.open_to_export(values).sources) == list(sources)
    (last / "config.json").write_text(to_json(tiny.config(train__init=str(last))))  # was replaced
    assert command.main(arguments) == 0


def test_list_shows_figures_and_licences_and_errors_are_one_line(file, shipped, capsys, tmp_path):
    for name in (DEFAULT, "small-50"):
        shutil.copy(file, shipped / f"{name}.safetensors")
    assert command.main(["list"]) == 0
    text = capsys.readouterr().out
    for part in (
        f"{DEFAULT} (default)\n", "vanilla", "rgb+mask of 16x32 pixels to 8 points",
        "  training  400 samples seen, averaged", "chairs (84 samples)",
        "CC-BY-3.0 (7 models: Ada, Bo)", "cars: CC0-1.0",
    ):  # fmt: skip
        assert part in text
    wrong = tmp_path / "wrong.safetensors"
    wrong.write_bytes(b"abc")
    for arguments in (["list", str(wrong)], ["export", "--workdir=none", f"--out={wrong}"]):
        assert command.main(arguments) == 2
        check_message(capsys.readouterr().err, "error: ", arguments[1].removeprefix("--"))
