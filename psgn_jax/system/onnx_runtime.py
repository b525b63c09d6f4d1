"""ONNX graphs on the CPU."""

import os
from collections.abc import Callable, Mapping

import numpy as np


def session(
    graph: bytes | str | os.PathLike[str], threads: int = 1
) -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
    """The first output of a graph, the content of a file or its path, as a function of its inputs.

    Threads sleep while they wait: with their usual busy waiting, they take the cores from JAX's.
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
