"""Converts JAX's matrix products, convolutions and pooling to ONNX."""

import math
import string
from collections.abc import Sequence
from typing import Any

import numpy as np

from psgn_jax.portable.graph import Graph, Params, UnsupportedError, Value, constant


def dot(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`dot_general`: MatMul for the product `x @ y` with a matrix y, Einsum for all others."""
    x, y = operands
    (sum_x, sum_y), (batch_x, batch_y) = params["dimension_numbers"]
    plain = not batch_x and y.rank == 2 and tuple(sum_y) == (0,)
    if plain and tuple(sum_x) == (x.rank - 1,):
        name = graph.node("MatMul", [graph.whole(x), graph.whole(y, None, channel=1)])
        return graph.fresh(name, tuple(out.shape), "float32")
    letters = iter(string.ascii_lowercase)
    of_x, of_y = [""] * x.rank, [""] * y.rank
    for i, j in [*zip(batch_x, batch_y, strict=True), *zip(sum_x, sum_y, strict=True)]:
        of_x[i] = of_y[j] = next(letters)
    of_x = [letter or next(letters) for letter in of_x]
    of_y = [letter or next(letters) for letter in of_y]
    batch = [of_x[axis] for axis in batch_x]
    free = [
        letter
        for letters_of, used in ((of_x, {*batch_x, *sum_x}), (of_y, {*batch_y, *sum_y}))
        for axis, letter in enumerate(letters_of)
        if axis not in used
    ]
    equation = f"{''.join(of_x)},{''.join(of_y)}->{''.join([*batch, *free])}"
    channel = y.rank - 1 if y.array is not None else -1
    names = [graph.whole(x), graph.whole(y, None, channel=channel)]
    return graph.fresh(graph.node("Einsum", names, equation=equation), tuple(out.shape), "float32")


def convolution(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`conv_general_dilated`: Conv, or ConvTranspose for a convolution with input dilation."""
    x, kernel = operands
    numbers = params["dimension_numbers"]
    dilation, groups = tuple(params["lhs_dilation"]), params["feature_group_count"]
    if params["batch_group_count"] != 1:
        raise UnsupportedError(
            "a convolution with batch_group_count > 1 cannot be converted to ONNX"
        )
    image = graph.whole(x, numbers.lhs_spec)
    options: dict[str, Any] = {"group": groups}
    if set(dilation) == {1}:
        low, high = zip(*params["padding"], strict=True)
        if min(*low, *high) < 0:
            raise UnsupportedError(
                "a convolution with negative padding cannot be converted to ONNX"
            )
        options |= {
            "strides": list(params["window_strides"]),
            "dilations": list(params["rhs_dilation"]),
            "pads": [*low, *high],
        }
        weight = graph.whole(kernel, numbers.rhs_spec, channel=0)
        name = graph.node("Conv", [image, weight], **options)
    else:
        weight, more = _transposed_kernel(graph, kernel, params)
        name = graph.node("ConvTranspose", [image, weight], **options, **more)
    shape = tuple(out.shape)
    return Value(shape, "float32", name, tuple(numbers.out_spec), shape)


def _transposed_kernel(graph: Graph, kernel: Value, params: Params) -> tuple[str, dict[str, Any]]:
    """Kernel and attributes of ConvTranspose for a convolution with input dilation.

    ONNX crops `pads` from the full result of the transposed convolution. With a kernel of size k,
    JAX's padding of the dilated image is k - 1 - `pads`.
    """
    numbers, rank = params["dimension_numbers"], kernel.rank
    if (
        set(params["window_strides"]) != {1}
        or set(params["rhs_dilation"]) != {1}
        or params["feature_group_count"] != 1
        or kernel.array is None
    ):
        raise UnsupportedError(
            "a convolution with input dilation cannot be converted to ONNX if it also has strides, "
            "kernel dilation, groups or a computed kernel"
        )
    outs, ins, *places = numbers.rhs_spec
    taps = [kernel.shape[axis] for axis in places]
    pads = [
        [k - 1 - amount[side] for k, amount in zip(taps, params["padding"], strict=True)]
        for side in (0, 1)
    ]
    if min(pads[0]) < 0:
        raise UnsupportedError(
            "this padding of a transposed convolution cannot be converted to ONNX"
        )
    extra = [max(0, -amount) for amount in pads[1]]
    turned = np.flip(np.asarray(kernel.array), places)
    weight = graph.whole(constant(turned), [ins, outs, *places], channel=1)
    assert rank == 2 + len(places)
    return weight, {
        "strides": list(params["lhs_dilation"]),
        "pads": [*pads[0], *(max(0, amount) for amount in pads[1])],
        "output_padding": extra,
    }


def pool(operator: str, graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    """`reduce_window_max`, `reduce_window_sum` over images; a sum is the average times a count."""
    (x,) = operands[:1]
    window, strides = params["window_dimensions"], params["window_strides"]
    places = [axis for axis, size in enumerate(window) if size > 1]
    others = [axis for axis in range(x.rank) if axis not in places]
    dilated = {*params["base_dilation"], *params["window_dilation"]} != {1}
    if dilated or len(others) != 2 or any(strides[a] != 1 for a in others):
        raise UnsupportedError("this pooling cannot be converted to ONNX")
    order = (*others, *places)
    pads = [params["padding"][axis][side] for side in (0, 1) for axis in places]
    options: dict[str, Any] = {
        "kernel_shape": [window[axis] for axis in places],
        "strides": [strides[axis] for axis in places],
        "pads": pads,
    }
    if operator == "AveragePool":
        options["count_include_pad"] = 1
    name = graph.node(operator, [graph.whole(x, order)], **options)
    if operator == "AveragePool":
        count = np.float32(math.prod(options["kernel_shape"]))
        name = graph.node("Mul", [name, graph.tensor(constant(count))])
    return Value(tuple(out.shape), x.dtype, name, order, tuple(out.shape))
