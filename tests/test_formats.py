"""Files of version 1, `version_1.zip`, are read; those of a later version are refused."""

import json
import pathlib
import zipfile

import numpy as np
import pytest

from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.schema import RecordError
from psgn_jax.system.untrusted import with_checksum
from psgn_jax.viewing.predictions import PredictionFileError, read_prediction
from psgn_jax.weights import checkpoint
from psgn_jax.weights.file import WeightsError, read_arrays, read_weights
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


def test_a_later_version_is_refused(stored, monkeypatch):
    manifest = stored / "records" / "manifest.json"
    content = json.loads(manifest.read_text()) | {"version": 2}
    content.pop("crc32")
    manifest.write_text(json.dumps(with_checksum(content)))
    with pytest.raises(
        RecordError, match=r"version 2; this version of psgn_jax reads .* version 1"
    ):
        RecordReader(stored / "records", "train")
    file = stored / "prediction.npz"
    with np.load(file) as archive:
        later = dict(archive) | {"version": np.int32(2)}
    np.savez(file, **later)
    with pytest.raises(PredictionFileError, match=r"version 2 .* reads version 1"):
        read_prediction(file, ["points"])
    with pytest.raises(WeightsError, match="psgn_jax weights 1', expected 'psgn_jax weights 2"):
        read_arrays(stored / "weights.safetensors", "psgn_jax weights 2")
    monkeypatch.setattr(checkpoint, "FORMAT", 0)
    with pytest.raises(checkpoint.CheckpointError, match="the format is 1, expected 0"):
        open_run(stored / "run")
