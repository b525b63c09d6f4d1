import dataclasses
import json
import os

import jax
import numpy as np
import pytest
from helpers.refusals import refused
from safetensors.numpy import save

from psgn_jax.config.experiment import ConfigError, to_json
from psgn_jax.weights import file as file_lib
from psgn_jax.weights.file import WeightsError, read_sources, read_weights, write_weights
from psgn_jax.weights.leaves import named_leaves


@pytest.mark.parametrize("dtype", ["float16", "float32"])
def test_round_trip(weights, tmp_path, dtype):
    path = tmp_path / "w.safetensors"
    write_weights(path, weights._replace(dtype=dtype))
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
    write_weights(path, weights._replace(config=config))
    assert b"private" not in path.read_bytes()
    assert b"/home/me" not in path.read_bytes()
    assert read_weights(path).config.train.init == "old"


def test_truncated_and_foreign_files_are_refused(file, tmp_path):
    content = file.read_bytes()
    os.mkfifo(tmp_path / "pipe")
    files = {
        "short": content[:7], "header": content[:100], "cut": content[:-1], "long": content + b"\0",
        "foreign": save({"a": np.zeros(3, np.float32)}), "pickle": b"\x80\x04\x95" + b"pickle" * 20,
        "text": (12).to_bytes(8, "little") + b"not json at all",
        "huge": (1 << 62).to_bytes(8, "little") + b"{}",
    }  # fmt: skip
    for name, part in files.items():
        (tmp_path / name).write_bytes(part)
    names = {"foreign": "another program", "pipe": "named pipe", "none": "No such file"}
    for name in (*files, "pipe", "none", ""):
        with refused(WeightsError, tmp_path / name, names.get(name, "")):
            read_weights(tmp_path / name)


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


def forged(weights, path, *, leaves=None, figures=None, sources=(), **model):
    """Writes a file with the given content and a correct checksum."""
    changed = dataclasses.replace(weights.config.model, **model)
    stored = {f"params.{k}": v for k, v in named_leaves(weights.params).items()}
    stored = {k: np.asarray(v) for k, v in (stored | (leaves or {})).items() if v is not None}
    metadata = {
        "format": file_lib.FORMAT,
        "config": to_json(dataclasses.replace(weights.config, model=changed)),
        "figures": json.dumps(dict(weights.figures)) if figures is None else figures,
        "sources": json.dumps(list(sources)),
    }
    metadata["sha256"] = file_lib._digest(metadata, stored)
    path.write_bytes(save(stored, metadata))


def test_other_parameters_and_a_later_version_are_refused(weights, tmp_path, monkeypatch):
    path = tmp_path / "forged.safetensors"
    name = f"params.{next(iter(named_leaves(weights.params)))}"
    forged(weights, path)
    read_weights(path)
    bad = np.array(named_leaves(weights.params)[name.removeprefix("params.")])
    bad.flat[0] = np.nan
    licences = [{"source": "a", "licences": {"b": x}} for x in ({"holders": [1]}, {"models": "x"})]
    table = [
        ({"leaves": {name: np.zeros((2, 3), np.float32)}}, name, "float32[2, 3]"),
        ({"leaves": {name: None}}, name, "missing"),
        ({"leaves": {"params.more": np.zeros(3, np.float32)}}, "params.more"),
        ({"leaves": {name: bad}}, name, "not finite"),
        ({"fc_widths": (1,) * 20_000}, f"{len(named_leaves(weights.params))} arrays"),
        ({"figures": "[1]"}, "metadata"),
        ({"figures": "[" * 200_000}, "metadata"),
        *(({"sources": [row]}, "metadata") for row in licences),
    ]
    for change in ({"step": -1}, {"metrics": {"emd": 10**400}}, {"data": [{"samples": [3]}]}):
        table.append(({"figures": json.dumps(weights.figures | change)}, "metadata"))
    for content, *names in table:
        forged(weights, path, **content)
        with refused(WeightsError, path, *names):
            read_weights(path)
    forged(weights, path)
    monkeypatch.setattr(file_lib, "FORMAT", "psgn_jax weights 0")
    with refused(WeightsError, path, "later version", "weights 1", "weights 0"):
        read_weights(path)


def test_what_cannot_be_written_is_refused(weights, tmp_path):
    path = tmp_path / "w.safetensors"
    params = jax.tree.map(np.array, weights.params)
    leaf = next(iter(jax.tree.leaves(params)))
    leaf.flat[0] = 1e6
    changed = weights._replace(params=params)
    with refused(WeightsError, path, "float16", "float32"):
        write_weights(path, changed)
    write_weights(path, changed._replace(dtype="float32"))
    leaf.flat[0] = np.inf
    with refused(WeightsError, "inf.safetensors", "not finite"):
        write_weights(tmp_path / "inf.safetensors", changed)
    with refused(WeightsError, "w.pkl", ".safetensors"):
        write_weights(tmp_path / "w.pkl", weights)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["w.safetensors"]


def test_wrong_tables_of_sources_are_refused(tmp_path):
    path = tmp_path / "s.json"
    for text in ("{", "[" * 200_000, "[]", "{}", '[{"source": 3}]', '[{"source": "x"}]'):
        path.write_text(text)
        with refused(ConfigError, path):
            read_sources(path)
