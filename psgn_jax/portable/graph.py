"""Builds an ONNX graph from nodes, constants and symbolic sizes. Only this file imports onnx.

**Layouts.** The network's convolutions read images as [b, h, w, c] in JAX and as [b, c, h, w] in
ONNX. A `Value` therefore records the order in which its axes are stored. Elementwise operators keep
this order, so a chain of convolutions is transposed only at its beginning and end.

**Repeated axes.** An axis that `broadcast_in_dim` repeats keeps the size 1 in the stored tensor as
long as possible, because ONNX operators broadcast their arguments without copies.

**Symbolic sizes.** The number of images is not known before the graph runs. A size such as
`batch*draws` is computed within the graph from the shapes of its inputs.
"""

import ast
import dataclasses
import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

OPSET, IR_VERSION = 17, 8
"""Versions that onnxruntime has supported since 1.12 (2022), in browsers too."""

STORED = ("float32", "float16", "int8")
"""The types in which weights may be stored; arithmetic is float32 in every case.

"float16" halves the size of the file. "int8" reduces it to a quarter: 8-bit integers with one scale
for each output channel. The graph converts both to float32; runtimes do this once, at loading.
"""

_LEAST_WEIGHTS = 512  # constants with fewer numbers stay float32
_TYPES = {
    "float32": TensorProto.FLOAT,
    "float16": TensorProto.FLOAT16,
    "int8": TensorProto.INT8,
    "uint8": TensorProto.UINT8,
    "int32": TensorProto.INT32,
    "int64": TensorProto.INT64,
    "bool": TensorProto.BOOL,
}

Params = dict[str, Any]
"""Parameters of an equation of a jaxpr."""

Size = Any
"""An int, or a symbolic size of `jax.export.symbolic_shape`."""


class UnsupportedError(ValueError):
    """An operation that this exporter cannot convert to ONNX."""


@dataclasses.dataclass(frozen=True, eq=False)
class Value:
    """A tensor of the graph, or a constant.

    Attributes:
      shape: sizes, in the order of JAX's axes.
      dtype: name of the type.
      name: name in the graph; "" for a constant.
      order: stored axis i is JAX's axis `order[i]`.
      stored: stored sizes, in the order of JAX's axes: 1 for axes that `shape` repeats.
      array: value of a constant, in JAX's axis order, with the shape `stored`; otherwise None.
    """

    shape: tuple[Size, ...]
    dtype: str
    name: str
    order: tuple[int, ...]
    stored: tuple[Size, ...]
    array: np.ndarray | None = None

    @property
    def rank(self) -> int:
        """Number of axes."""
        return len(self.shape)


def constant(array: Any, shape: tuple[Size, ...] | None = None) -> Value:
    """A constant, broadcast to `shape` if that is given."""
    array = np.asarray(array)
    dtype = "float32" if array.dtype.name == "bfloat16" else array.dtype.name
    array = array.astype(dtype)
    order = tuple(range(array.ndim))
    return Value(array.shape if shape is None else shape, dtype, "", order, array.shape, array)


class Graph:
    """Collects nodes; `finish` returns the model.

    Args:
      weights: one of `STORED`.
    """

    def __init__(self, weights: str = "float32"):
        if weights not in STORED:
            raise ValueError(f"weights={weights!r}: accepted: {', '.join(STORED)}")
        self.weights = weights
        self._nodes: list[onnx.NodeProto] = []
        self._initializers: dict[str, onnx.TensorProto] = {}
        self._inputs: list[onnx.ValueInfoProto] = []
        self._constants: dict[tuple[Any, ...], str] = {}
        self._symbols: dict[str, tuple[str, int]] = {}
        self._sizes: dict[str, str] = {}
        self._count = 0

    def node(self, operator: str, inputs: Sequence[str], **attributes: Any) -> str:
        """Appends a node with one output; returns the output's name."""
        self._count += 1
        name = f"{operator.lower()}_{self._count}"
        self._nodes.append(helper.make_node(operator, list(inputs), [name], name, **attributes))
        return name

    def input(self, name: str, shape: tuple[Size, ...], dtype: str) -> Value:
        """Declares an input; an axis whose size is a single symbol defines that symbol."""
        for axis, size in enumerate(shape):
            if not isinstance(size, int) and str(size).isidentifier():
                self._symbols.setdefault(str(size), (name, axis))
        self._inputs.append(_info(name, shape, dtype))
        return Value(shape, dtype, name, tuple(range(len(shape))), shape)

    def result(self, name: str, like: Value, dtype: str | None = None) -> Value:
        """The value of a node that keeps the shape and the layout of `like`."""
        return dataclasses.replace(like, name=name, dtype=dtype or like.dtype, array=None)

    def fresh(self, name: str, shape: tuple[Size, ...], dtype: str) -> Value:
        """The value of a node whose output has JAX's axis order and its full size.

        None of its repeated axes is stored with size 1.
        """
        return Value(shape, dtype, name, tuple(range(len(shape))), shape)

    def tensor(self, value: Value, order: Sequence[int] | None = None, channel: int = -1) -> str:
        """Name of a tensor with the value in the given order of axes; repeated axes keep size 1.

        Args:
          value: may be a constant.
          order: order of the axes; None = JAX's order.
          channel: for the kernel of a layer, the index of the output-channel axis in `order`; -1
            for other values. Only kernels are stored as float16 or int8.
        """
        order = tuple(range(value.rank)) if order is None else tuple(order)
        if value.array is not None:
            return self._constant(np.ascontiguousarray(value.array.transpose(order)), channel)
        if order == value.order:
            return value.name
        return self.node("Transpose", [value.name], perm=[value.order.index(a) for a in order])

    def whole(self, value: Value, order: Sequence[int] | None = None, channel: int = -1) -> str:
        """Like `tensor`, but with repeated axes expanded to their full size."""
        order = tuple(range(value.rank)) if order is None else tuple(order)
        name = self.tensor(value, order, channel)
        if value.stored == value.shape:
            return name
        sizes = [1 if value.stored[a] == value.shape[a] else value.shape[a] for a in order]
        return self.node("Expand", [name, self.shape(sizes)])

    def shape(self, sizes: Sequence[Size]) -> str:
        """Name of an int64 tensor with these sizes."""
        if all(isinstance(size, int) for size in sizes):
            return self._constant(np.array(sizes, np.int64))
        return self.node("Concat", [self._size(size) for size in sizes], axis=0)

    def shape_to_reshape(self, sizes: Sequence[Size]) -> str:
        """Like `shape`, for Reshape: a single symbolic size becomes -1, which Reshape infers."""
        unknown = [i for i, size in enumerate(sizes) if not isinstance(size, int)]
        if len(unknown) == 1 and 0 not in sizes:
            return self.shape([-1 if i in unknown else size for i, size in enumerate(sizes)])
        return self.shape(sizes)

    def finish(self, output: str, value: Value, texts: dict[str, str]) -> onnx.ModelProto:
        """The checked model with one output.

        Args:
          output: name of the output.
          value: value of the output.
          texts: metadata.
        """
        self._nodes.append(helper.make_node("Identity", [self.whole(value)], [output]))
        nodes, names = self._used(output)
        graph = helper.make_graph(
            nodes,
            "network",
            self._inputs,
            [_info(output, value.shape, value.dtype)],
            [array for name, array in self._initializers.items() if name in names],
        )
        model = helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="psgn_jax"
        )
        model.ir_version = IR_VERSION
        helper.set_model_props(model, texts)
        onnx.checker.check_model(model, full_check=True)
        return model

    def _used(self, output: str) -> tuple[list[onnx.NodeProto], set[str]]:
        """The nodes that the output depends on, in order, and the names that they read."""
        nodes, names = [], {output}
        for node in reversed(self._nodes):
            if names.intersection(node.output):
                nodes.append(node)
                names.update(node.input)
        return nodes[::-1], names

    def _constant(self, array: np.ndarray, channel: int = -1) -> str:
        digest = hashlib.sha256(array.tobytes()).digest()
        key = (array.dtype.name, array.shape, channel, digest)
        if key not in self._constants:
            is_kernel = channel >= 0 and array.dtype == np.float32 and array.size >= _LEAST_WEIGHTS
            if is_kernel and self.weights == "float16":
                stored = self._initializer(array.astype(np.float16))
                name = self.node("Cast", [stored], to=TensorProto.FLOAT)
            elif is_kernel and self.weights == "int8":
                name = self._as_int8(array, channel)
            else:
                name = self._initializer(array)
            self._constants[key] = name
        return self._constants[key]

    def _as_int8(self, array: np.ndarray, channel: int) -> str:
        others = tuple(axis for axis in range(array.ndim) if axis != channel)
        scale = np.abs(array).max(axis=others, keepdims=True) / np.float32(127)
        scale = np.where(scale > 0, scale, 1).astype(np.float32)
        levels = np.rint(array / scale).astype(np.int8)
        level = self.node("Cast", [self._initializer(levels)], to=TensorProto.FLOAT)
        return self.node("Mul", [level, self._initializer(scale)])

    def _initializer(self, array: np.ndarray) -> str:
        name = f"constant_{len(self._initializers)}"
        self._initializers[name] = numpy_helper.from_array(array, name)
        return name

    def _size(self, size: Size) -> str:
        """Name of an int64 tensor [1] with a size."""
        text = str(size)
        if text not in self._sizes:
            self._sizes[text] = self._evaluate(ast.parse(text, mode="eval").body, text)
        return self._sizes[text]

    def _evaluate(self, tree: ast.expr, text: str) -> str:
        """Computes a symbolic size from its expression `tree`; returns the tensor's name.

        The expression may contain sums, differences, products, powers, `floordiv` and `mod`, of
        positive sizes.
        """
        if isinstance(tree, ast.Constant) and isinstance(tree.value, int):
            return self._constant(np.array([tree.value], np.int64))
        if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.USub):
            return self.node("Neg", [self._evaluate(tree.operand, text)])
        if isinstance(tree, ast.Name) and tree.id in self._symbols:
            name, axis = self._symbols[tree.id]
            return self.node("Shape", [name], start=axis, end=axis + 1)
        operands: list[ast.expr] = []
        operator: str | None = None
        if isinstance(tree, ast.BinOp):
            operands = [tree.left, tree.right]
            names = {ast.Add: "Add", ast.Sub: "Sub", ast.Mult: "Mul", ast.Pow: "Pow"}
            operator = names.get(type(tree.op))
        elif isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name):
            operands, operator = tree.args, {"floordiv": "Div", "mod": "Mod"}.get(tree.func.id)
        if operator is None or len(operands) != 2:
            raise UnsupportedError(f"the symbolic size {text} cannot be converted to ONNX")
        return self.node(operator, [self._evaluate(operand, text) for operand in operands])


def is_empty(value: Any) -> bool:
    """Whether an object with a `shape` has an axis of size 0."""
    return any(isinstance(size, int) and size == 0 for size in value.shape)


def cast_target(dtype: str) -> int:
    """ONNX's number for a dtype."""
    if dtype not in _TYPES:
        raise UnsupportedError(f"the dtype {dtype} cannot be converted to ONNX")
    return int(_TYPES[dtype])


def _info(name: str, shape: Sequence[Size], dtype: str) -> onnx.ValueInfoProto:
    sizes = [size if isinstance(size, int) else str(size) for size in shape]
    return helper.make_tensor_value_info(name, cast_target(dtype), sizes)
