"""Converts JAX's primitives to ONNX: `convert` appends a traced function to a graph.

The conversion works on operations, not on particular networks: every function that consists of the
primitives below can be converted. Any other primitive raises `UnsupportedError` with its name.
Equations whose arguments are all known are computed by JAX and stored as constants. Equations whose
results are not used are left out.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax.extend.core
import numpy as np

from psgn_jax.portable import products, shaping
from psgn_jax.portable.graph import (
    Graph,
    Params,
    UnsupportedError,
    Value,
    cast_target,
    constant,
    is_empty,
)

Operator = Callable[[Graph, Sequence[Value], Any, Params], Value]

_UNARY = {
    "neg": "Neg",
    "exp": "Exp",
    "log": "Log",
    "tanh": "Tanh",
    "logistic": "Sigmoid",
    "sqrt": "Sqrt",
    "abs": "Abs",
    "erf": "Erf",
    "floor": "Floor",
    "ceil": "Ceil",
    "sign": "Sign",
    "sin": "Sin",
    "cos": "Cos",
    "not": "Not",
}
_BINARY = {
    "add": "Add",
    "sub": "Sub",
    "mul": "Mul",
    "div": "Div",
    "max": "Max",
    "min": "Min",
    "pow": "Pow",
    "eq": "Equal",
    "lt": "Less",
    "le": "LessOrEqual",
    "gt": "Greater",
    "ge": "GreaterOrEqual",
    "and": "And",
    "or": "Or",
    "xor": "Xor",
}
_LOGICAL = frozenset({"and", "or", "xor", "not"})
_COMPARISONS = frozenset({"eq", "lt", "le", "gt", "ge"})
_SAME = frozenset({"copy", "copy_p", "stop_gradient", "optimization_barrier"})
_CALLS = ("jaxpr", "call_jaxpr", "fun_jaxpr")


def convert(graph: Graph, closed: Any, inputs: Sequence[Value]) -> list[Value]:
    """Appends a traced function to a graph.

    Args:
      graph: the graph to append to.
      closed: the function, traced by `jax.make_jaxpr`.
      inputs: arguments of the function.

    Returns:
      the results of the function.

    Raises:
      UnsupportedError: the function contains an operation that cannot be converted.
    """
    return _convert(graph, closed.jaxpr, [constant(c) for c in closed.consts], inputs)


def _convert(
    graph: Graph, jaxpr: Any, consts: Sequence[Value], inputs: Sequence[Value]
) -> list[Value]:
    values: dict[Any, Value] = dict(zip(jaxpr.constvars, consts, strict=True))
    values.update(zip(jaxpr.invars, inputs, strict=True))

    def read(atom: Any) -> Value:
        return constant(atom.val) if hasattr(atom, "val") else values[atom]

    for equation in _used(jaxpr):
        operands = [read(atom) for atom in equation.invars]
        results = _apply(graph, equation, operands)
        values.update(zip(equation.outvars, results, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _used(jaxpr: Any) -> list[Any]:
    """The equations that a result depends on, in order."""
    needed = {atom for atom in jaxpr.outvars if not hasattr(atom, "val")}
    used = []
    for equation in reversed(jaxpr.eqns):
        if needed.intersection(equation.outvars):
            used.append(equation)
            needed |= {atom for atom in equation.invars if not hasattr(atom, "val")}
    return used[::-1]


def _apply(graph: Graph, equation: Any, operands: list[Value]) -> list[Value]:
    name, params = equation.primitive.name, equation.params
    inner = next((params[key] for key in _CALLS if key in params), None)
    if inner is not None and name not in ("scan", "while", "cond"):
        closed = inner if hasattr(inner, "consts") else jax.extend.core.ClosedJaxpr(inner, ())
        return convert(graph, closed, operands)
    out = equation.outvars[0].aval
    if name != "broadcast_in_dim" and _are_known(operands) and _is_static(out.shape):
        arrays = [np.broadcast_to(np.asarray(v.array), v.shape) for v in operands]
        results = equation.primitive.bind(*arrays, **params)
        results = results if equation.primitive.multiple_results else [results]
        return [constant(np.asarray(result)) for result in results]
    if is_empty(out):  # needs no name, because `concatenate` leaves out empty values
        return [graph.fresh("", tuple(out.shape), np.dtype(out.dtype).name)]
    if name in _SAME:
        return list(operands)
    if name in _UNARY:
        return [_unary(graph, name, operands[0])]
    if name in _BINARY:
        return [_binary(graph, name, operands, out)]
    if name not in OPERATORS:
        raise UnsupportedError(
            f"the operation {name!r} of this network cannot be converted to ONNX"
        )
    return [OPERATORS[name](graph, operands, out, params)]


def _are_known(values: Sequence[Value]) -> bool:
    """Whether all values are constants of known sizes."""
    return all(value.array is not None and _is_static(value.shape) for value in values)


def _is_static(shape: Sequence[Any]) -> bool:
    return all(isinstance(size, int) for size in shape)


# --- elementwise operations ------------------------------------------------------------------


def _together(graph: Graph, values: Sequence[Value]) -> tuple[list[str], Value]:
    """Names of tensors with the same order of axes, and a value with the layout of their result."""
    rank = max(value.rank for value in values)
    plain = tuple(range(rank))
    full = [value for value in values if value.rank == rank]
    order = next((v.order for v in full if v.array is None and v.order != plain), plain)
    names = [graph.tensor(v, order if v.rank == rank else None) for v in values]
    stored = list(full[0].stored)
    for value in full[1:]:
        stored = [
            a if not (isinstance(a, int) and a == 1) else b
            for a, b in zip(stored, value.stored, strict=True)
        ]
    return names, Value(full[0].shape, full[0].dtype, "", order, tuple(stored))


def _unary(graph: Graph, name: str, x: Value) -> Value:
    return graph.result(graph.node(_UNARY[name], [graph.tensor(x, x.order)]), x)


def _binary(graph: Graph, name: str, operands: Sequence[Value], out: Any) -> Value:
    kind = operands[0].dtype
    if (name in _LOGICAL and kind != "bool") or (name == "div" and not kind.startswith("float")):
        raise UnsupportedError(f"the operation {name!r} of {kind} cannot be converted to ONNX")
    if name == "max" and (zero := _is_zero(operands)) is not None:
        x = operands[1 - zero]
        return graph.result(graph.node("Relu", [graph.tensor(x, x.order)]), x)
    names, like = _together(graph, operands)
    dtype = "bool" if name in _COMPARISONS else None
    return graph.result(graph.node(_BINARY[name], names), like, dtype)


def _is_zero(operands: Sequence[Value]) -> int | None:
    """Index of the operand that is the float32 constant 0.

    None if there is none or the other operand is constant too.
    """
    for i, value in enumerate(operands):
        is_number = value.array is not None and value.array.size == 1
        if is_number and value.dtype == "float32" and not np.any(value.array):
            return i if operands[1 - i].array is None else None
    return None


def _cast(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    (x,) = operands
    dtype = np.dtype(params["new_dtype"]).name
    if dtype == x.dtype:
        return x
    name = graph.node("Cast", [graph.tensor(x, x.order)], to=cast_target(dtype))
    return graph.result(name, x, dtype)


def _where(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    which, *cases = operands
    if which.dtype != "bool" or len(cases) != 2:
        raise UnsupportedError("select_n of more than two cases cannot be converted to ONNX")
    names, like = _together(graph, [*cases, which])
    like = Value(out.shape, cases[0].dtype, "", like.order, like.stored)
    return graph.result(graph.node("Where", [names[2], names[1], names[0]]), like)


def _rsqrt(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    root = graph.node("Sqrt", [graph.tensor(operands[0], operands[0].order)])
    return graph.result(graph.node("Reciprocal", [root]), operands[0])


def _integer_pow(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    (x,), power = operands, params.get("y", 2)
    name = graph.tensor(x, x.order)
    if power == 2:
        return graph.result(graph.node("Mul", [name, name]), x)
    exponent = graph.tensor(constant(np.float32(power)))
    return graph.result(graph.node("Pow", [name, exponent]), x)


def _not_equal(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    equal = _binary(graph, "eq", operands, out)
    return graph.result(graph.node("Not", [equal.name]), equal)


def _erfc(graph: Graph, operands: Sequence[Value], out: Any, params: Params) -> Value:
    (x,) = operands
    erf = graph.node("Erf", [graph.tensor(x, x.order)])
    return graph.result(graph.node("Sub", [graph.tensor(constant(np.float32(1))), erf]), x)


def _shifted(
    inner: str, before: float, after: float, graph: Graph, operands: Sequence[Value], *_: Any
) -> Value:
    """`inner(x + before) + after`, for log1p and expm1."""
    (x,) = operands
    name = graph.tensor(x, x.order)
    if before:
        name = graph.node("Add", [name, graph.tensor(constant(np.float32(before)))])
    name = graph.node(inner, [name])
    if after:
        name = graph.node("Add", [name, graph.tensor(constant(np.float32(after)))])
    return graph.result(name, x)


OPERATORS: dict[str, Operator] = {
    "convert_element_type": _cast,
    "select_n": _where,
    "rsqrt": _rsqrt,
    "square": _integer_pow,
    "integer_pow": _integer_pow,
    "ne": _not_equal,
    "erfc": _erfc,
    "log1p": functools.partial(_shifted, "Log", 1, 0),
    "expm1": functools.partial(_shifted, "Exp", 0, -1),
    "broadcast_in_dim": shaping.broadcast,
    "reshape": shaping.reshape,
    "squeeze": shaping.reshape,
    "expand_dims": shaping.reshape,
    "transpose": shaping.transpose,
    "concatenate": shaping.concatenate,
    "slice": shaping.slice,
    "rev": shaping.reverse,
    "pad": shaping.pad,
    "reduce_sum": functools.partial(shaping.reduce, "ReduceSum"),
    "reduce_max": functools.partial(shaping.reduce, "ReduceMax"),
    "reduce_min": functools.partial(shaping.reduce, "ReduceMin"),
    "reduce_prod": functools.partial(shaping.reduce, "ReduceProd"),
    "gather": shaping.gather,
    "dot_general": products.dot,
    "conv_general_dilated": products.convolution,
    "reduce_window_max": functools.partial(products.pool, "MaxPool"),
    "reduce_window_sum": functools.partial(products.pool, "AveragePool"),
}
"""Primitive -> function that appends its ONNX nodes; see also `_UNARY` and `_BINARY`."""
