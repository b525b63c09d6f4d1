"""Files of version 1, `version_1.zip`, are read; those of a later version are refused."""

import json
import os
import pathlib
import shutil
import sys
import zipfile

import jax
import numpy as np
import onnxruntime
import pytest
from helpers.commands import run

from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.schema import RecordError
from psgn_jax.portable import folder
from psgn_jax.prediction.formats import PredictionFileError, read_prediction
from psgn_jax.system.untrusted import with_checksum
from psgn_jax.weights import checkpoint, file
from psgn_jax.weights.file import WeightsError, read_weights
from psgn_jax.weights.run_folder import open_run


@pytest.fixture
def stored(tmp_path):
    with zipfile.ZipFile(pathlib.Path(__file__).with_name("version_1.zip")) as archive:
        archive.extractall(tmp_path)
    return tmp_path


def test_version_1_is_read(stored):
    (sample,) = RecordReader(stored / "records", "train")
    assert sample.image.shape == (16, 32, 3)
    assert sample.mask.any()
    assert sample.points.shape[1] == 3
    run = open_run(stored / "run")
    assert (run.step, run.scores) == (3, {"cd_sq_radius2": 0.5})
    np.testing.assert_array_equal(run.params["a"]["kernel"], np.arange(4))
    weights = read_weights(stored / "weights.safetensors")
    assert weights.config == run.config
    assert weights.sources[0]["licences"]["CC-BY-3.0"]["holders"] == ["Ada", "Bo"]
    points = read_prediction(stored / "prediction.npz", ["points"])["points"]
    np.testing.assert_array_equal(points.ravel(), np.arange(12, dtype=np.float32) / 12)


def test_an_exported_network_of_version_1_runs(stored):
    image = np.arange(48 * 64 * 3).reshape(1, 48, 64, 3).astype(np.uint8)
    mask = np.ones((1, 48, 64), bool)
    expected = np.load(stored / "network" / "points.npy")
    content = (stored / "network" / "network.stablehlo").read_bytes()
    program = jax.export.deserialize(bytearray(content))
    np.testing.assert_allclose(program.call(image, mask), expected, atol=1e-5)
    session = onnxruntime.InferenceSession(stored / "network" / "network.onnx")
    (points,) = session.run(None, {"image": image, "mask": mask})
    np.testing.assert_allclose(points, expected, atol=1e-5)


def test_a_later_version_is_refused(stored, monkeypatch):
    manifest = stored / "records" / "manifest.json"
    content = json.loads(manifest.read_text()) | {"version": 2}
    content.pop("crc32")
    manifest.write_text(json.dumps(with_checksum(content)))
    with pytest.raises(RecordError, match=r"version 2; this version .* reads .* version 1"):
        RecordReader(stored / "records", "train")
    prediction = stored / "prediction.npz"
    with np.load(prediction) as archive:
        later = dict(archive) | {"version": np.int32(2)}
    np.savez(prediction, **later)
    with pytest.raises(PredictionFileError, match=r"later version .* is 2, this one reads 1"):
        read_prediction(prediction, ["points"])
    monkeypatch.setattr(file, "FORMAT", "psgn_jax weights 0")
    with pytest.raises(WeightsError, match=r"a later version .* weights 1', expected 'psgn_jax"):
        read_weights(stored / "weights.safetensors")
    before = sorted((stored / "run").rglob("*"))
    monkeypatch.setattr(checkpoint, "FORMAT", 0)
    with pytest.raises(checkpoint.CheckpointError, match="format is 1, this version reads 0"):
        open_run(stored / "run")
    assert sorted((stored / "run").rglob("*")) == before


def test_the_example_of_an_exported_network_refuses_a_later_version(stored):
    about = stored / "network" / "network.json"
    about.write_text(about.read_text().replace("psgn_jax network 1", "psgn_jax network 3"))
    template = pathlib.Path(folder.__file__).with_name("templates") / "example.py.txt"
    example = shutil.copy(template, stored / "network" / "example.py")
    shutil.copy(template.with_name("silhouette.py.txt"), example.with_name("silhouette.py"))
    done = run(sys.executable, example, env=os.environ | {"PYTHONSAFEPATH": ""})
    assert done.returncode == 1
    assert done.stderr.endswith("has the format 'psgn_jax network 3': use the example beside it\n")
