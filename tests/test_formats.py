"""Files of a later version are refused. `data/test_dataset.py` has the manifest of records."""

import numpy as np
from helpers import weights as tiny
from helpers.refusals import refused

from psgn_jax.prediction.formats import PredictionFileError, read_prediction
from psgn_jax.weights import checkpoint, file


def test_a_later_version_is_refused(tmp_path, monkeypatch):
    np.savez(tmp_path / "prediction.npz", version=np.int32(2), points=np.zeros((1, 4, 3)))
    with refused(PredictionFileError, "prediction.npz", "later version", 2, 1):
        read_prediction(tmp_path / "prediction.npz", ["points"])
    file.write_weights(tmp_path / "w.safetensors", tiny.weights(tiny.config()))
    monkeypatch.setattr(file, "FORMAT", "psgn_jax weights 0")
    with refused(file.WeightsError, "w.safetensors", "later version", "weights 1", "weights 0"):
        file.read_weights(tmp_path / "w.safetensors")
    saved = checkpoint.Checkpoints(tmp_path / "checkpoints")
    saved.save(3, {"params.a.kernel": np.zeros(2)}, {})
    saved.close()
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.setattr(checkpoint, "FORMAT", 0)
    with refused(checkpoint.CheckpointError, "checkpoints/3", "later version", 1, 0):
        checkpoint.Checkpoints(tmp_path / "checkpoints").restore_newest()
    assert sorted(tmp_path.rglob("*")) == before
