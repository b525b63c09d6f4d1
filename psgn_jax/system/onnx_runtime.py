"""ONNX graphs on the CPU."""

import os
from collections.abc import Callable, Mapping

import numpy as np


def session(
    graph: bytes | str | os.PathLike[str], threads: int = 1
) -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
    """A function from a graph's inputs to its first output; `graph` is a file or its content.

    Waiting threads sleep; spinning threads, the default, would take the cores from JAX.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.enable_cpu_mem_arena = False
    content = graph if isinstance(graph, bytes) else os.fspath(graph)
    loaded = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    first = loaded.get_outputs()[0].name
    return lambda arrays: np.asarray(loaded.run([first], dict(arrays))[0])
