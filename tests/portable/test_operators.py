"""Converted graphs give JAX's results for every number of images."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

from psgn_jax.portable import operators, runtime  # noqa: E402
from psgn_jax.portable.graph import STORED, Graph, UnsupportedError  # noqa: E402


def build(function, shapes, weights="float32"):
    """The ONNX model of a function of float32 arrays; sizes in `shapes` may be symbols."""
    names = list(dict.fromkeys(s for shape in shapes for s in shape if isinstance(s, str)))
    symbols = dict(zip(names, jax.export.symbolic_shape(", ".join(names)), strict=True))
    arguments = [
        jax.ShapeDtypeStruct(tuple(symbols.get(s, s) for s in shape), jnp.float32)
        for shape in shapes
    ]
    traced = jax.make_jaxpr(function)(*arguments)
    graph = Graph(weights)
    inputs = [graph.input(f"x{i}", a.shape, "float32") for i, a in enumerate(traced.in_avals)]
    (result,) = operators.convert(graph, traced, inputs)
    return graph.finish("y", result, {})


def require_equal(function, shapes, tolerance=1e-5, sizes=(1, 3)):
    """Builds the graph and compares it with the function; returns the model."""
    model = build(function, shapes)
    session = runtime.Session(model.SerializeToString())
    rng = np.random.default_rng(0)
    for size in sizes:
        values = {"b": size, "d": 2}
        arrays = [
            rng.normal(size=[values.get(s, s) for s in shape]).astype("f4") for shape in shapes
        ]
        result = session({f"x{i}": array for i, array in enumerate(arrays)})
        np.testing.assert_allclose(result, function(*arrays), atol=tolerance, rtol=tolerance)
    return model


def kinds(model):
    return [node.op_type for node in model.graph.node]


def kernel(*shape):
    return jnp.asarray(np.random.default_rng(1).normal(0, 0.3, shape), jnp.float32)


def conv(x, k, stride=1, **options):
    return jax.lax.conv_general_dilated(
        x, k, (stride, stride), "SAME", dimension_numbers=("NHWC", "HWIO", "NHWC"), **options
    )


IMAGE = ("b", 8, 6, 4)


def test_a_chain_of_convolutions_is_transposed_at_its_ends_alone():
    def function(x):
        for size, stride in ((3, 1), (5, 2), (3, 1)):
            x = nn.relu(conv(x, kernel(size, size, 4, 4), stride) + kernel(1, 1, 1, 4))
        return x

    model = require_equal(function, [IMAGE])
    assert kinds(model).count("Transpose") == 2
    assert kinds(model).count("Relu") == 3


@pytest.mark.parametrize(("size", "stride"), [(5, 2), (3, 2), (4, 2), (2, 2), (5, 3), (3, 4)])
def test_transposed_convolutions(size, stride):
    def function(x):
        layout = ("NHWC", "HWIO", "NHWC")
        k = kernel(size, size, 4, 5)
        return jax.lax.conv_transpose(x, k, (stride, stride), "SAME", dimension_numbers=layout)

    assert "ConvTranspose" in kinds(require_equal(function, [IMAGE]))


def group_norm(x, groups=2):
    b, h, w, c = x.shape
    x = x.reshape(b, h, w, groups, c // groups)
    mean = x.mean(axis=(1, 2, 4), keepdims=True)
    x = (x - mean) * jax.lax.rsqrt(x.var(axis=(1, 2, 4), keepdims=True) + 1e-6)
    return x.reshape(b, h, w, c) * kernel(1, 1, 1, c) + 1


FUNCTIONS = {
    "grouped convolution": lambda x: conv(x, kernel(3, 3, 1, 4), feature_group_count=4),
    "dilated convolution": lambda x: conv(x, kernel(3, 3, 4, 4), rhs_dilation=(2, 2)),
    "residual block": lambda x: nn.relu(x + conv(nn.relu(group_norm(x)), kernel(3, 3, 4, 4))),
    "group norm": group_norm,
    "layer norm": lambda x: nn.LayerNorm(use_scale=False, use_bias=False).apply({}, x),
    "gelu": lambda x: nn.gelu(x, approximate=False),
    "tanh gelu": nn.gelu,
    "swish": nn.silu,
    "softplus": nn.softplus,
    "elu": nn.elu,
    "leaky relu": nn.leaky_relu,
    "max pool": lambda x: nn.max_pool(x, (2, 2), (2, 2)),
    "mean pool": lambda x: nn.avg_pool(x, (2, 2), (2, 2), "SAME"),
    "global mean": lambda x: x.mean(axis=(1, 2)),
    "softmax": lambda x: nn.softmax(x.reshape(x.shape[0], -1)),
    "edge padding": lambda x: jnp.pad(x, ((0, 0), (1, 2), (0, 1), (0, 0)), mode="edge"),
    "zero padding after a convolution": lambda x: jnp.pad(
        conv(x, kernel(1, 1, 4, 4)), ((0, 0), (1, 2), (0, 1), (0, 0))
    ),
    "every second row": lambda x: jax.lax.slice_in_dim(conv(x, kernel(1, 1, 4, 4)), 0, 8, 2, 1),
    "windows": lambda x: conv(x, kernel(1, 1, 4, 4))[:, 2:5, 1][:, :, ::-1] + x[:, :3, 2, :1],
    "strided windows": lambda x: conv(x, kernel(1, 1, 4, 4))[:, ::2][:, :, 1::3],
    "rows": lambda x: conv(x, kernel(1, 1, 4, 4))[:, jnp.array([3, 1, 1])],
    "resized": lambda x: jax.image.resize(x, (x.shape[0], 16, 12, 4), "bilinear"),
    "nearest": lambda x: jnp.repeat(jnp.repeat(x, 2, 1), 2, 2),
    "swapped axes": lambda x: conv(x, kernel(1, 1, 4, 4)).swapaxes(1, 3) * 2,
    "concatenated": lambda x: jnp.concatenate([x, conv(x, kernel(3, 3, 4, 2))], axis=-1),
    "joined images": lambda x: jnp.concatenate([x.reshape(-1, 4), kernel(3, 4)]),
    "attention": lambda x: jnp.einsum(
        "bij,bkj->bik", x.reshape(x.shape[0], 48, 4), x.reshape(x.shape[0], 48, 4)
    ),
    "norm": lambda x: x / jnp.sqrt((x**2).sum(-1, keepdims=True) + 1e-3) + jnp.abs(x) ** 3,
    "where": lambda x: jnp.where((x > 0) & ~(x > 1), jnp.log1p(jnp.exp(x)), -1.0),
    "constants alone": lambda x: x * jnp.cumsum(jnp.arange(4.0))[None, None, None],
    "repeated": lambda x: jnp.broadcast_to(x[:, None], (x.shape[0], 3, *x.shape[1:])),
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions(name):
    require_equal(FUNCTIONS[name], [IMAGE], 1e-4)


def test_the_result_of_an_unused_operation_is_left_out():
    def function(x):
        jnp.argsort(x)
        return x + 1

    assert kinds(require_equal(function, [("b", 3)])) == ["Add", "Identity"]


def test_two_symbolic_sizes():
    def function(x, r):
        flat = r.reshape(-1, 5) @ kernel(5, 4)
        flat = flat.reshape(x.shape[0], -1, 4) + x[:, None]
        return flat.reshape(*r.shape[:2], 2, 2)

    require_equal(function, [("b", 4), ("b", "d", 5)])


@pytest.mark.parametrize("weights", STORED)
def test_small_weights(weights):
    matrix = np.random.default_rng(0).normal(size=(64, 32)).astype("f4") * np.logspace(-3, 1, 32)
    matrix[:, 3] = 0

    def function(x):
        return x @ jnp.asarray(matrix, jnp.float32)

    model = build(function, [("b", 64)], weights)
    size = len(model.SerializeToString())
    assert size < {"float32": 8192, "float16": 4096, "int8": 2048}[weights] + 700
    x = np.random.default_rng(1).normal(size=(20, 64)).astype("f4")
    error = np.abs(runtime.Session(model.SerializeToString())({"x0": x}) - function(x))
    # Each output has its own scale, so the error is relative to the largest weight of that output.
    limit = {"float32": 1e-6, "float16": 1e-3, "int8": 1 / 127}[weights]
    assert (error.max(axis=0) <= 64 * limit * np.abs(matrix).max(axis=0)).all()


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x: jnp.sort(x), "'sort' of this network cannot be converted to ONNX"),
        (lambda x: jax.lax.fori_loop(0, 3, lambda i, y: y * x, x), "cannot be converted to ONNX"),
        (lambda x: (x.astype(jnp.int32) // 2).astype(jnp.float32), "cannot be converted to ONNX"),
    ],
)
def test_what_has_no_form_is_named(function, message):
    with pytest.raises(UnsupportedError, match=message):
        build(function, [("b", 3)])
