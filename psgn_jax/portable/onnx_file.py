"""A trained network as an ONNX file."""

from collections.abc import Mapping

from psgn_jax.portable import graph as graph_lib
from psgn_jax.portable import operators
from psgn_jax.portable.network import PortableNetwork

STORED = graph_lib.STORED


def to_onnx(
    network: PortableNetwork, weights: str = "float32", texts: Mapping[str, str] | None = None
) -> bytes:
    """The content of an ONNX file; its inputs and output are described in `portable.network`.

    Args:
      network: the network to convert.
      weights: the type in which weights are stored, one of `STORED`.
      texts: metadata of the file.

    Raises:
      UnsupportedError: an operation of the network cannot be converted.
    """
    traced = network.trace()
    graph = graph_lib.Graph(weights)
    inputs = [
        graph.input(item.name, tuple(aval.shape), item.dtype)
        for item, aval in zip(network.inputs, traced.in_avals, strict=True)
    ]
    (points,) = operators.convert(graph, traced, inputs)
    return graph.finish("points", points, dict(texts or {})).SerializeToString()
