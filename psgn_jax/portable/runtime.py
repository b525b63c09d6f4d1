"""Runs ONNX graphs by onnxruntime on the CPU. Only this file imports onnxruntime."""

import importlib.util
from collections.abc import Mapping
from typing import Any

import numpy as np

from psgn_jax.config import ConfigError


def require_packages() -> None:
    """Raises `ConfigError` if packages of the extra `export` are missing."""
    names = ("onnx", "onnxruntime", "flatbuffers")  # jax.export needs flatbuffers
    missing = [name for name in names if importlib.util.find_spec(name) is None]
    if missing:
        raise ConfigError(f"{', '.join(missing)}: not installed; pip install 'psgn-jax[export]'")


class Session:
    """An ONNX graph that is loaded and can be called.

    Args:
      model: content of the ONNX file.
      threads: number of threads for one operation.

    Raises:
      ValueError: onnxruntime cannot load the model.
    """

    def __init__(self, model: bytes, threads: int = 1):
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(
                model, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime does not export its error classes
            raise ValueError(f"onnxruntime cannot load the model: {str(error)[:200]}") from None

    def __call__(self, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
        """The first output of the graph, for inputs given by name."""
        results: Any = self._session.run(None, dict(arrays))
        return np.asarray(results[0])
