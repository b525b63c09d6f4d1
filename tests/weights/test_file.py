"""A file of weights can be written and read back; damaged and foreign files are refused."""

import dataclasses
import json
import os

import jax
import numpy as np
import pytest
from safetensors.numpy import save

from psgn_jax.config.experiment import ConfigError, to_json
from psgn_jax.weights import file as file_lib
from psgn_jax.weights.file import WeightsError, read_sources, read_weights, write_weights
from psgn_jax.weights.leaves import named_leaves


@pytest.mark.parametrize("dtype", ["float16", "float32"])
def test_round_trip(weights, tmp_path, dtype):
    path = tmp_path / "w.safetensors"
    write_weights(path, dataclasses.replace(weights, dtype=dtype))
    read = read_weights(path)
    want, have = named_leaves(weights.params), named_leaves(read.params)
    assert have.keys() == want.keys()
    for name, leaf in want.items():
        assert have[name].dtype == np.float32
        np.testing.assert_array_equal(have[name], leaf.astype(dtype), err_msg=name)
    assert read.dtype == dtype
    assert read.config.model == weights.config.model
    assert read.figures["samples_seen"] == 400
    assert read.figures["metrics"] == {"cd_sq_radius2": 0.0123}
    assert list(read.sources) == list(weights.sources)


def test_paths_of_the_machine_stay_behind(weights, tmp_path):
    fields = {"init": "/home/me/runs/old", "init_skip": ("fc*",)}
    train = dataclasses.replace(weights.config.train, **fields)
    config = dataclasses.replace(weights.config, train=train)
    path = tmp_path / "w.safetensors"
    write_weights(path, dataclasses.replace(weights, config=config))
    assert b"private" not in path.read_bytes()
    assert b"/home/me" not in path.read_bytes()
    assert read_weights(path).config.train.init == "old"


def refused(path, message):
    with pytest.raises(WeightsError) as caught:
        read_weights(path)
    assert message in str(caught.value), caught.value
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_truncated_and_foreign_files_are_refused(file, tmp_path):
    content = file.read_bytes()
    cut = tmp_path / "cut.safetensors"
    for part in (content[:7], content[:100], content[:-1], content + b"\0"):
        cut.write_bytes(part)
        with pytest.raises(WeightsError):
            read_weights(cut)
    refused(tmp_path / "none.safetensors", "No such file")
    refused(tmp_path, "it is a folder, expected a file")
    os.mkfifo(tmp_path / "pipe.safetensors")
    refused(tmp_path / "pipe.safetensors", "it is a named pipe, expected a file")
    path = tmp_path / "foreign.safetensors"
    for content, message in (
        (save({"a": np.zeros(3, np.float32)}), "a file of another program"),
        (b"\x80\x04\x95" + b"pickle" * 20, "not a file of weights"),
        ((12).to_bytes(8, "little") + b"not json at all", "not readable as weights"),
        ((1 << 62).to_bytes(8, "little") + b"{}", "with a header of 4611686018427387904"),
    ):
        path.write_bytes(content)
        refused(path, message)


def test_every_flipped_bit_is_noticed(file, tmp_path):
    content = file.read_bytes()
    flipped = tmp_path / "flipped.safetensors"
    rng = np.random.default_rng(0)
    header = 8 + int.from_bytes(content[:8], "little")
    # The header may end in spaces; other white space there is valid too and means the same.
    used = len(content[:header].rstrip())
    places = [*rng.integers(0, used, 150), *rng.integers(header, len(content), 50)]
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= 1 << rng.integers(8)
        flipped.write_bytes(damaged)
        with pytest.raises(WeightsError):
            read_weights(flipped)


def forged(weights, path, *, leaves=None, figures=None, sources=()):
    """Writes a file with the given content and a correct checksum."""
    stored = {f"params.{k}": v for k, v in named_leaves(weights.params).items()}
    stored = {k: np.asarray(v) for k, v in (stored | (leaves or {})).items() if v is not None}
    metadata = {
        "format": file_lib.FORMAT,
        "config": to_json(weights.config),
        "figures": json.dumps(dict(weights.figures)) if figures is None else figures,
        "sources": json.dumps(list(sources)),
    }
    metadata["sha256"] = file_lib._digest(metadata, stored)
    path.write_bytes(save(stored, metadata))


def test_parameters_that_are_not_the_networks_are_refused(weights, tmp_path):
    path = tmp_path / "forged.safetensors"
    name = f"params.{next(iter(named_leaves(weights.params)))}"
    forged(weights, path)
    read_weights(path)
    bad = np.array(named_leaves(weights.params)[name.removeprefix("params.")])
    bad.flat[0] = np.nan
    for key, leaf, message in (
        (name, np.zeros((2, 3), np.float32), f"leaf {name} is float32[2, 3], expected float32"),
        (name, None, f"leaf {name} is missing"),
        ("params.more", np.zeros(3, np.float32), "leaf params.more is not expected"),
        (name, bad, f"{name} is not finite"),
    ):
        forged(weights, path, leaves={key: leaf})
        refused(path, message)
    good = dict(weights.figures)
    wrong = ({"step": -1}, {"metrics": {"emd_radius": 10**400}}, {"data": [{"samples": [3]}]})
    for figures in [[1], *(good | change for change in wrong)]:
        forged(weights, path, figures=json.dumps(figures))
        refused(path, "its metadata")
    for licence in ({"holders": [1]}, {"models": "x"}):
        forged(weights, path, sources=[{"source": "a", "licences": {"b": licence}}])
        refused(path, "its metadata")
    forged(weights, path, figures="[" * 200_000)
    refused(path, "its metadata: brackets nested more than 32 deep")


def test_what_cannot_be_written_is_refused(weights, tmp_path):
    path = tmp_path / "w.safetensors"
    params = jax.tree.map(np.array, weights.params)
    leaf = next(iter(jax.tree.leaves(params)))
    leaf.flat[0] = 1e6
    changed = dataclasses.replace(weights, params=params)
    with pytest.raises(WeightsError, match="too large for float16; use float32"):
        write_weights(path, changed)
    write_weights(path, dataclasses.replace(changed, dtype="float32"))
    leaf.flat[0] = np.inf
    with pytest.raises(WeightsError, match="is not finite"):
        write_weights(tmp_path / "inf.safetensors", changed)
    with pytest.raises(WeightsError, match=r"with the suffix .safetensors"):
        write_weights(tmp_path / "w.pkl", weights)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["w.safetensors"]


def test_wrong_tables_of_sources_are_refused(tmp_path):
    path = tmp_path / "s.json"
    for text in ("{", "[" * 200_000, "[]", "{}", '[{"source": 3}]', '[{"source": "x"}]'):
        path.write_text(text)
        with pytest.raises(ConfigError, match=r"^sources="):
            read_sources(path)
