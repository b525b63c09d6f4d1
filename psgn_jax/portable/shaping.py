"""Converts JAX's operations that move numbers without changing them, and reductions, to ONNX."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from psgn_jax.portable.graph import Graph, Params, UnsupportedError, Value, constant, is_empty


def broadcast(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`broadcast_in_dim`: new and repeated axes have size 1 in the stored tensor."""
    x, axes = operands[0], tuple(params["broadcast_dimensions"])
    rank = len(out.shape)
    stored: list[Any] = [1] * rank
    for axis, size in zip(axes, x.stored, strict=True):
        stored[axis] = size
    if x.array is not None:
        return constant(x.array.reshape(stored), tuple(out.shape))
    if x.rank == rank:
        return Value(tuple(out.shape), x.dtype, x.name, x.order, tuple(stored))
    # JAX may place new axes before or between the existing ones.
    name, added = graph.tensor(x), [axis for axis in range(rank) if axis not in axes]
    if added:
        name = graph.node("Unsqueeze", [name, graph.shape(added)])
    return Value(tuple(out.shape), x.dtype, name, tuple(range(rank)), tuple(stored))


def reshape(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`reshape`, `squeeze`, `expand_dims`."""
    if params.get("dimensions") is not None:
        raise UnsupportedError(
            "reshape in an order other than row-major cannot be converted to ONNX"
        )
    x, shape = operands[0], tuple(out.shape)
    if shape == x.shape:
        return x
    name = graph.node("Reshape", [graph.whole(x), graph.shape_to_reshape(shape)])
    return graph.fresh(name, shape, x.dtype)


def transpose(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`transpose`: adds no node; only the order of the stored axes changes."""
    x, permutation = operands[0], list(params["permutation"])
    order = tuple(permutation.index(axis) for axis in x.order)
    stored = tuple(x.stored[axis] for axis in permutation)
    array = None if x.array is None else x.array.transpose(permutation)
    if array is not None:
        order = tuple(range(x.rank))
    return Value(tuple(out.shape), x.dtype, x.name, order, stored, array)


def concatenate(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`concatenate`; empty parts are left out."""
    operands = [value for value in operands if not is_empty(value)]
    plain = tuple(range(operands[0].rank))
    order = next((v.order for v in operands if v.array is None and v.order != plain), plain)
    names = [graph.whole(value, order) for value in operands]
    name = graph.node("Concat", names, axis=order.index(params["dimension"]))
    return Value(tuple(out.shape), operands[0].dtype, name, order, tuple(out.shape))


def slice(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`slice`."""
    (x,), name = operands, graph.whole(operands[0], operands[0].order)
    steps = params["strides"] or (1,) * x.rank
    for axis, size in enumerate(x.shape):
        first, last, step = (
            params["start_indices"][axis],
            params["limit_indices"][axis],
            steps[axis],
        )
        if (first, step) == (0, 1) and last == size:
            continue
        at = x.order.index(axis)
        limits = [graph.shape([value]) for value in (first, last, at, step)]
        name = graph.node("Slice", [name, *limits])
    return Value(tuple(out.shape), x.dtype, name, x.order, tuple(out.shape))


def reverse(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`rev`: reverses axes."""
    (x,) = operands
    name = graph.whole(x, x.order)
    for axis in params["dimensions"]:
        # The end -2**31 includes the first element; -1 would mean the last one.
        limits = [graph.shape([v]) for v in (-1, -(2**31), x.order.index(axis), -1)]
        name = graph.node("Slice", [name, *limits])
    return Value(tuple(out.shape), x.dtype, name, x.order, tuple(out.shape))


def pad(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`pad` at the borders; interior padding is not supported."""
    x, value = operands
    config = params["padding_config"]
    if any(inside for _, _, inside in config):
        raise UnsupportedError("pad with interior padding cannot be converted to ONNX")
    low = [config[axis][0] for axis in x.order]
    high = [config[axis][1] for axis in x.order]
    names = [graph.whole(x, x.order), graph.shape([*low, *high]), graph.tensor(value)]
    name = graph.node("Pad", names)  # negative amounts crop, in ONNX too
    return Value(tuple(out.shape), x.dtype, name, x.order, tuple(out.shape))


def reduce(
    operator: str, graph: Graph, operands: Sequence[Value], out: Any, params: Params
) -> Value:
    """`reduce_sum` and the other reductions."""
    (x,), axes = operands, params["axes"]
    at = [x.order.index(axis) for axis in axes]
    name, options = graph.whole(x, x.order), {"keepdims": 0}
    if operator == "ReduceSum":
        name = graph.node(operator, [name, graph.shape(at)], **options)
    else:
        name = graph.node(operator, [name], axes=at, **options)
    kept = [axis for axis in range(x.rank) if axis not in axes]
    order = tuple(kept.index(axis) for axis in x.order if axis not in axes)
    return Value(tuple(out.shape), x.dtype, name, order, tuple(out.shape))


def gather(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`gather` with known indices: one window, or rows along one axis.

    Indexing with integers, slices and arrays of integers gives these two kinds.
    """
    x, indices = operands
    numbers, sizes = params["dimension_numbers"], params["slice_sizes"]
    axes, dropped = numbers.start_index_map, numbers.collapsed_slice_dims
    others_whole = all(sizes[a] == x.shape[a] for a in range(x.rank) if a not in axes)
    if indices.array is None or numbers.operand_batching_dims or not others_whole:
        raise UnsupportedError(
            "gather with computed indices, batch axes or windows that cut other axes cannot be "
            "converted to ONNX"
        )
    if indices.rank == 1:
        name = graph.whole(x)
        for axis, first in zip(axes, indices.array.tolist(), strict=True):
            limits = [graph.shape([value]) for value in (first, first + sizes[axis], axis)]
            name = graph.node("Slice", [name, *limits])
        if dropped:
            name = graph.node("Squeeze", [name, graph.shape(dropped)])
        return graph.fresh(name, tuple(out.shape), x.dtype)
    (axis,) = axes if len(axes) == 1 else (-1,)
    kept = [a for a in range(len(out.shape)) if a not in numbers.offset_dims]
    if indices.rank != 2 or tuple(dropped) != (axis,) or len(kept) != 1:
        raise UnsupportedError("this gather cannot be converted to ONNX")
    rows = graph.tensor(constant(indices.array[:, 0].astype(np.int64)))
    name = graph.node("Gather", [graph.whole(x), rows], axis=axis)
    places = [a for a in range(len(out.shape)) if a != kept[0]]
    places.insert(axis, kept[0])  # stored axis -> axis of the result
    return Value(tuple(out.shape), x.dtype, name, tuple(places), tuple(out.shape))
