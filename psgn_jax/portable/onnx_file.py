"""Writes a JAX function as an ONNX file: a walk over the primitives of its trace.

Convolutions read [b, h, w, c] in JAX and [b, c, h, w] in ONNX, so each tensor states the order of
its stored axes. Elementwise operations keep the order, so a chain of convolutions is transposed
only at its ends. Only this file imports onnx.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
import onnx
from jax import export as jax_export
from jax.extend.core import Literal
from onnx import TensorProto, helper, numpy_helper

from psgn_jax.models.cpu_convolution import convolutions_for
from psgn_jax.portable.network import ExportError, InputSpec
from psgn_jax.system.untrusted import brief

OPSET, IR_VERSION = 17, 8
"""Supported since onnxruntime 1.12 (2022), in browsers too."""

_CALLS = ("jit", "custom_jvp_call", "custom_vjp_call")
_ELEMENTWISE = {
    "abs": "Abs", "add": "Add", "and": "And", "convert_element_type": "Cast", "div": "Div",
    "eq": "Equal", "erf": "Erf", "exp": "Exp", "ge": "GreaterOrEqual", "gt": "Greater",
    "le": "LessOrEqual", "log": "Log", "logistic": "Sigmoid", "lt": "Less", "max": "Max",
    "min": "Min", "mul": "Mul", "neg": "Neg", "not": "Not", "or": "Or", "pow": "Pow",
    "select_n": "Where", "sqrt": "Sqrt", "stop_gradient": "Identity", "sub": "Sub", "tanh": "Tanh",
}  # fmt: skip


class _Tensor(NamedTuple):
    """A tensor of the graph; constants of the traced function are arrays of NumPy.

    `shape` has JAX's order of axes; stored axis i is JAX's axis `order[i]`. An axis that JAX
    broadcasts has size 1, because ONNX's operators broadcast it.
    """

    name: str
    shape: tuple[Any, ...]
    order: tuple[int, ...]


_Value = _Tensor | np.ndarray


def to_onnx(
    function: Callable[..., Any],
    inputs: Sequence[InputSpec],
    output: str,
    stored: str,
    texts: Mapping[str, str],
) -> bytes:
    """The content of an ONNX file that computes `function`.

    Args:
      function: maps arrays to an array, whose sizes may depend on symbolic sizes of the inputs.
      inputs: names, types and shapes of the arrays.
      stored: "float32", or "float16" for half the size. Runtimes convert kernels to float32 when
        they load the file.

    Raises:
      ExportError: the function needs the number of images, or has a primitive that cannot be
        converted.
    """
    batch, draws = jax_export.symbolic_shape("batch, draws")
    symbols: dict[Any, Any] = {"batch": batch, "draws": draws}
    shapes = ([symbols.get(size, size) for size in item.shape] for item in inputs)
    types = (np.dtype(item.dtype) for item in inputs)
    try:
        with convolutions_for("export"):
            traced = jax.make_jaxpr(lambda *arrays: function(*arrays))(
                *map(jax.ShapeDtypeStruct, shapes, types)
            )
    except (TypeError, ValueError) as error:  # such as that of `len(x)`
        raise ExportError(
            f"ONNX: the network cannot be traced for any number of images: {brief(error)}; use "
            "x.shape[0] in place of len(x), and compare no sizes with it"
        ) from error
    graph, (out,) = _Graph(inputs, stored), traced.out_avals
    tensors = [
        _Tensor(item.name, aval.shape, _plain(aval.shape))
        for item, aval in zip(inputs, traced.in_avals, strict=True)
    ]
    (value,) = graph.run(traced.jaxpr, [*map(np.asarray, traced.consts), *tensors])
    result = graph.name(graph.whole(value, out.shape))
    graph.nodes.append(helper.make_node("Identity", [result], [output]))
    sizes = [size if isinstance(size, int) else str(size) for size in out.shape]
    infos = [
        helper.make_tensor_value_info(name, _number(dtype), shape)
        for name, dtype, shape in [*inputs, (output, out.dtype, sizes)]
    ]
    model = helper.make_model(
        helper.make_graph(graph.nodes, "network", infos[:-1], infos[-1:], graph.constants),
        opset_imports=[helper.make_opsetid("", OPSET)],
        producer_name="psgn_jax",
    )
    model.ir_version = IR_VERSION
    helper.set_model_props(model, dict(texts))
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


class _Graph:
    def __init__(self, inputs: Sequence[InputSpec], stored: str):
        self.stored = stored
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []
        self._axes = {
            size: (item.name, axis) for item in inputs for axis, size in enumerate(item.shape)
        }

    def node(self, kind: str, *inputs: str, **attributes: Any) -> str:
        name = f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, inputs, [name], name, **attributes))
        return name

    def constant(self, array: Any, dtype: Any = None) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.array(array, dtype, order="C"), name))
        return name

    def kernel(self, array: np.ndarray) -> str:
        """A kernel in the stored type."""
        if self.stored == "float16":
            return self.node("Cast", self.constant(array, np.float16), to=TensorProto.FLOAT)
        return self.constant(array)

    def sizes(self, shape: Sequence[Any], *, infer: bool) -> str:
        """A shape as a tensor; with `infer`, Reshape computes its last symbolic size (-1)."""
        sizes = list(shape)
        unknown = [i for i, size in enumerate(sizes) if not isinstance(size, int)]
        if infer and unknown:
            sizes[unknown.pop()] = -1
        if not unknown:
            return self.constant(sizes, np.int64)
        return self.node("Concat", *map(self._size, sizes), axis=0)

    def _size(self, size: Any) -> str:
        if isinstance(size, int):
            return self.constant([size], np.int64)
        if str(size) not in self._axes:
            raise ExportError(f"ONNX: an axis of {size} numbers cannot be converted")
        name, axis = self._axes[str(size)]
        return self.node("Shape", name, start=axis, end=axis + 1)

    # --- values -------------------------------------------------------------------------------

    def name(self, value: _Value, order: Sequence[int] | None = None) -> str:
        """The name of a tensor with its axes in this order, by default JAX's."""
        order = _plain(value.shape) if order is None else tuple(order)
        if isinstance(value, np.ndarray):
            return self.constant(value.transpose(order))
        if order == value.order:
            return value.name
        return self.node("Transpose", value.name, perm=[value.order.index(a) for a in order])

    def whole(self, value: _Value, shape: Sequence[Any]) -> _Value:
        """The value with its broadcast axes at full size."""
        if tuple(value.shape) == tuple(shape):
            return value
        order = _common_order([value])
        sizes = [1 if value.shape[axis] == shape[axis] else shape[axis] for axis in order]
        target = self.sizes(sizes, infer=False)
        return _Tensor(self.node("Expand", self.name(value, order), target), tuple(shape), order)

    def elementwise(self, kind: str, *operands: _Value, **options: Any) -> _Tensor:
        """A node whose operands are numbers or have the same order of axes."""
        rank = max(len(x.shape) for x in operands)
        full = [x for x in operands if len(x.shape) == rank]
        order = _common_order(full)
        names = [self.name(x, order if len(x.shape) == rank else ()) for x in operands]
        sizes = zip(*(x.shape for x in full), strict=True)
        shape = tuple(next((size for size in each if size != 1), 1) for each in sizes)
        return _Tensor(self.node(kind, *names, **options), shape, order)

    def reshape(self, value: _Value, shape: Sequence[Any]) -> _Value:
        """A reshape; if only leading axes change, the others keep their stored order."""
        if isinstance(value, np.ndarray):
            return value.reshape(shape)
        pairs = zip(reversed(value.shape), reversed(shape), strict=False)
        same = len(list(itertools.takewhile(lambda pair: pair[0] == pair[1], pairs)))
        first, new_first = len(value.shape) - same, len(shape) - same
        if value.order[:first] != tuple(range(first)):
            value = _Tensor(self.name(value), value.shape, _plain(value.shape))
        order = (*range(new_first), *(axis + new_first - first for axis in value.order[first:]))
        target = self.sizes([shape[axis] for axis in order], infer=True)
        return _Tensor(self.node("Reshape", value.name, target), tuple(shape), order)

    def slice(self, x: _Tensor, starts: Any, stops: Any, steps: Any, shape: Any) -> _Tensor:
        bounds = [
            (start, stop, x.order.index(axis), step)
            for axis, (start, stop, step) in enumerate(zip(starts, stops, steps, strict=True))
            if (start, stop, step) != (0, x.shape[axis], 1)
        ]
        if not bounds:
            return x
        indices = [self.constant(each, np.int64) for each in zip(*bounds, strict=True)]
        return _Tensor(self.node("Slice", x.name, *indices), tuple(shape), x.order)

    def convolution(self, x: _Tensor, kernel: np.ndarray, params: Any, out: Any) -> _Tensor:
        numbers, pads = params["dimension_numbers"], np.transpose(params["padding"])
        kind, strides = "Conv", params["window_strides"]
        kernel = kernel.transpose(numbers.rhs_spec)
        if set(params["lhs_dilation"]) != {1}:
            # JAX pads the dilated image; ONNX crops `pads` from the fully padded result.
            kind, strides = "ConvTranspose", params["lhs_dilation"]
            kernel = np.flip(kernel, tuple(range(2, kernel.ndim))).swapaxes(0, 1)
            pads = np.array(kernel.shape[2:]) - 1 - pads
        options = {"strides": strides, "pads": pads.ravel().tolist()}
        options |= {"dilations": params["rhs_dilation"], "group": params["feature_group_count"]}
        image, weight = self.name(x, numbers.lhs_spec), self.kernel(kernel)
        name = self.node(kind, image, weight, **options)
        return _Tensor(name, out.shape, tuple(numbers.out_spec))

    def sum_of_windows(self, x: _Tensor, params: Any, out: Any) -> _Tensor:
        """Sums over windows of images: averages times the window's size."""
        window = params["window_dimensions"]
        order = sorted(range(len(window)), key=lambda axis: window[axis] > 1)
        name = self.node(
            "AveragePool",
            self.name(x, order),
            kernel_shape=[window[axis] for axis in order[2:]],
            strides=[params["window_strides"][axis] for axis in order[2:]],
            pads=[params["padding"][axis][side] for side in (0, 1) for axis in order[2:]],
            count_include_pad=1,
        )
        average = _Tensor(name, out.shape, tuple(order))
        return self.elementwise("Mul", average, np.array(math.prod(window), np.float32))

    # --- a traced function --------------------------------------------------------------------

    def run(self, jaxpr: Any, arguments: Sequence[_Value]) -> list[_Value]:
        """Adds the operations of a traced function; returns its results."""
        variables = [*jaxpr.constvars, *(v for v in jaxpr.invars if 0 not in v.aval.shape)]
        values = dict(zip(variables, arguments, strict=True))

        def read(atom: Any) -> _Value:
            return np.asarray(atom.val) if isinstance(atom, Literal) else values[atom]

        for equation in _needed(jaxpr):
            primitive, params, out = equation.primitive, equation.params, equation.outvars[0].aval
            atoms = [atom for atom in equation.invars if 0 not in atom.aval.shape]
            operands = [read(atom) for atom in atoms]
            known = all(isinstance(value, np.ndarray) for value in operands)
            if primitive.name in _CALLS:
                inner = params.get("jaxpr") or params["call_jaxpr"]
                results = self.run(inner.jaxpr, [*map(np.asarray, inner.consts), *operands])
            elif known and all(isinstance(size, int) for size in out.shape):  # computed by JAX
                result = primitive.bind(*operands, **params)
                results = [*map(np.asarray, result if primitive.multiple_results else [result])]
            else:
                if primitive.name not in (*_ELEMENTWISE, "broadcast_in_dim"):
                    pairs = zip(operands, atoms, strict=True)
                    operands = [self.whole(x, atom.aval.shape) for x, atom in pairs]
                results = [self.result(primitive.name, params, out, operands)]
            values.update(zip(equation.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def result(self, kind: str, params: Any, out: Any, operands: Any) -> _Value:
        """The result of one primitive."""
        numbers = params.get("dimension_numbers")
        if kind in ("max", "min") and isinstance(operands[0], np.ndarray):
            operands = operands[::-1]
        match kind, operands:
            # Runtimes fuse a convolution with Relu or Clip.
            case "max", [x, np.ndarray(ndim=0) as limit] if limit == np.float32(0):
                return self.elementwise("Relu", x)
            case "min", [_Tensor() as x, np.ndarray(ndim=0) as limit]:
                return x._replace(name=self.node("Clip", x.name, "", self.constant(limit)))
            case "convert_element_type", [x]:
                return self.elementwise("Cast", x, to=_number(out.dtype))
            case "select_n", [which, no, yes]:
                return self.elementwise("Where", which, yes, no)
            case _, _ if kind in _ELEMENTWISE:
                return self.elementwise(_ELEMENTWISE[kind], *operands)
            case "broadcast_in_dim", [x]:
                sizes: list[Any] = [1] * len(out.shape)
                for axis, size in zip(params["broadcast_dimensions"], x.shape, strict=True):
                    sizes[axis] = size
                return x if len(sizes) == len(x.shape) else self.reshape(x, sizes)
            case "reshape" | "squeeze" | "expand_dims", [x]:
                return self.reshape(x, out.shape)
            case "transpose", [x]:
                axes = params["permutation"]
                return _Tensor(x.name, out.shape, tuple(axes.index(axis) for axis in x.order))
            case "concatenate", _:
                order = _common_order(operands)
                names = [self.name(x, order) for x in operands]
                name = self.node("Concat", *names, axis=order.index(params["dimension"]))
                return _Tensor(name, out.shape, order)
            case "slice", [x]:
                steps = params["strides"] or [1] * len(x.shape)
                bounds = params["start_indices"], params["limit_indices"], steps
                return self.slice(x, *bounds, out.shape)
            case "gather", [x, np.ndarray() as first] if len(numbers.offset_dims) == len(out.shape):
                # x[..., 3:], where a size of x is a symbol.
                starts, shape = [0] * len(x.shape), params["slice_sizes"]
                for axis, start in zip(numbers.start_index_map, first.tolist(), strict=True):
                    starts[axis] = start
                stops = [start + size for start, size in zip(starts, shape, strict=True)]
                return self.slice(x, starts, stops, [1] * len(starts), shape)
            case "dot_general", [x, np.ndarray(ndim=2) as kernel] if numbers == (
                ((len(x.shape) - 1,), (0,)),
                ((), ()),
            ):
                name = self.node("MatMul", self.name(x), self.kernel(kernel))
                return _Tensor(name, out.shape, _plain(out.shape))
            case "conv_general_dilated", [x, np.ndarray() as kernel]:
                return self.convolution(x, kernel, params, out)
            case "reduce_window_sum", [x]:
                return self.sum_of_windows(x, params, out)
        raise ExportError(f"ONNX: the operation {kind!r} of the network cannot be converted")


def _number(dtype: Any) -> int:
    return helper.np_dtype_to_tensor_dtype(np.dtype(dtype))


def _plain(shape: Sequence[Any]) -> tuple[int, ...]:
    return tuple(range(len(shape)))


def _common_order(values: Sequence[_Value]) -> tuple[int, ...]:
    """The order of axes for operands of the same rank."""
    plain = _plain(values[0].shape)
    orders = (x.order for x in values if isinstance(x, _Tensor))
    return next((order for order in orders if order != plain), plain)


def _needed(jaxpr: Any) -> list[Any]:
    """The equations that the results depend on, in order, without empty arrays."""
    needed, equations = set(map(id, jaxpr.outvars)), []
    for equation in reversed(jaxpr.eqns):
        if needed.intersection(map(id, equation.outvars)):
            equations.append(equation)
            needed.update(id(atom) for atom in equation.invars if 0 not in atom.aval.shape)
    return equations[::-1]
