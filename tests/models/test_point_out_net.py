import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.refusals import all_refused

from psgn_jax.config.experiment import ModelConfig
from psgn_jax.models import layers
from psgn_jax.models.cpu_convolution import convolutions_for
from psgn_jax.models.networks import build


# Layers of the authors' published networks, in order: (kind, kernel size, input channels, output
# channels). Source: github.com/fanhqme/PointSetGeneration, demo/runsingleimage.py (two branches)
# and depthestimate/train_nn.py (hourglass).
def _convs(text: str) -> list[tuple[str, int, int, int]]:
    """ "3 4-16 16-16" is two convolutions of 3x3, from 4 to 16 and from 16 to 16 channels."""
    size, *pairs = text.split()
    channels = (pair.split("-") for pair in pairs)
    return [("conv", int(size), int(c_in), int(c_out)) for c_in, c_out in channels]


def _merges(*widths: tuple[int, int, int]) -> list[tuple[str, int, int, int]]:
    """Layers of each `Merge` upwards: transposed from a to b, skip from c to b, b to b."""
    layers = []
    for a, b, c in widths:
        layers += [("transposed", 5, a, b), ("conv", 3, c, b), ("conv", 3, b, b)]
    return layers


_FIRST = _convs("3 4-16 16-16 16-32 32-32 32-32 32-64 64-64 64-64 64-128 128-128 128-128")
_INNER = _convs("3 256-256 256-256 512-512 512-512 512-512")
_ENCODER = {
    "two_branch": _FIRST + _INNER + _convs("3 128-256 256-512") + _convs("5 512-512"),
    "hourglass": _FIRST + _INNER + _convs("5 128-256 256-512 512-512"),
}
_UP_TO_24X32 = _merges((512, 256, 512), (256, 128, 256), (128, 64, 128))
_UP_TO_96X128 = _merges((64, 32, 64), (32, 16, 32))
_DOWN_AGAIN = [
    *_convs("3 16-32 32-32 32-32 32-64 64-64 64-64"),
    *_convs("5 64-128 128-256 256-512"),
    *_convs("3 128-128 128-128 256-256 256-256"),
]
# The skip convolutions of the last pass read features with the decoder's widths.
_UP_AGAIN = _merges((512, 256, 256), (256, 128, 128), (128, 64, 64))
_HEAD = _convs("3 64-64 64-3")
_FC_IN = ("dense", 1, 3 * 4 * 512, 2048)
_FC_HIDDEN = ("dense", 1, 2048, 1024)
_FC_OUT = ("dense", 1, 1024, 256 * 3)

PUBLISHED = {
    # Not published: the two-branch network without its deconv branch; all points are from fc.
    "vanilla": [*_ENCODER["two_branch"], _FC_IN, _FC_HIDDEN, ("dense", 1, 1024, 1024 * 3)],
    "two_branch": [*_ENCODER["two_branch"], _FC_IN, _FC_HIDDEN, _FC_OUT, *_UP_TO_24X32, *_HEAD],
    "hourglass": [
        *_ENCODER["hourglass"], *_UP_TO_24X32, *_UP_TO_96X128, *_DOWN_AGAIN, *_UP_AGAIN, *_HEAD,
        ("dense", 1, 2048, 2048), _FC_IN, _FC_IN, _FC_HIDDEN, _FC_OUT,
    ],
}  # fmt: skip


def full_config(name: str, **changes) -> ModelConfig:
    return ModelConfig(name=name, fc_points=1024 if name == "vanilla" else 256, **changes)


def tiny_config(name: str = "two_branch", **changes) -> ModelConfig:
    """A network that compiles fast: five levels, 32x48 pixels, widths 8 to 16, deconv grid 8x12."""
    small = {
        "widths": (8, 8, 8, 16, 16),
        "image_size": (32, 48),
        "fc_widths": (32, 16),
        "fc_points": 16,
        "deconv_level": 2,
    }
    return ModelConfig(name=name, **(small | changes))


def arguments(config: ModelConfig, batch: int = 2):
    rng = np.random.default_rng(0)
    x = rng.random((batch, *config.image_size, config.in_channels), np.float32)
    r = rng.standard_normal((batch, config.random_size), np.float32)
    return x, r if config.random_size else None


@functools.cache
def initialised(config: ModelConfig):
    """The network and random parameters.

    They are drawn by NumPy, because compiling the initialisation of every network takes long. The
    biases are random too, because a test would not notice that a zero bias is not added.
    """
    network = build(config)
    shapes = jax.eval_shape(network.init, jax.random.key(1), *arguments(config, batch=1))["params"]
    rng = np.random.default_rng(1)

    def draw(leaf):
        scale = 0.05 if len(leaf.shape) == 1 else np.sqrt(2 / np.prod(leaf.shape[:-1]))
        return (scale * rng.standard_normal(leaf.shape)).astype(leaf.dtype)

    return network, jax.tree.map(draw, shapes)


@functools.cache
def _jitted(config: ModelConfig, intermediates: bool):
    return jax.jit(functools.partial(build(config).apply, capture_intermediates=intermediates))


def apply(config: ModelConfig, params, x, r=None, *, intermediates=False):
    """The outputs, as NumPy arrays: operations of JAX on them would be compiled for each shape."""
    return jax.device_get(_jitted(config, intermediates)({"params": params}, x, r))


@pytest.mark.parametrize("name", PUBLISHED)
def test_full_size_is_the_published_network(name):
    config = full_config(name)
    network = build(config)
    x = jax.ShapeDtypeStruct((2, 192, 256, 4), jnp.float32)
    out, variables = jax.eval_shape(network.init_with_output, jax.random.key(0), x)
    flat = jax.tree_util.tree_flatten_with_path(variables["params"])[0]
    kernels = {path[:-1]: leaf.shape for path, leaf in flat if path[-1].key == "kernel"}
    biases = {path[:-1]: leaf.shape for path, leaf in flat if path[-1].key == "bias"}
    assert kernels.keys() == biases.keys()
    assert len(kernels) + len(biases) == len(flat)

    def described(path, shape):
        if len(shape) == 2:
            return ("dense", 1, *shape)
        assert shape[0] == shape[1]
        return ("transposed" if path[-1].key == "up" else "conv", *shape[1:])

    layers = sorted(described(path, shape) for path, shape in kernels.items())
    assert layers == sorted(PUBLISHED[name])
    assert all(biases[path] == shape[-1:] for path, shape in kernels.items())
    assert out.shape == (2, 1024, 3)
    fc = config.fc_points
    assert network.branches == (range(fc), range(fc, 1024))
    assert network.grid == ((0, 0, 0) if name == "vanilla" else (24, 32, 1))


def test_output_order():
    config = tiny_config(deconv_channels=6)
    _, params = initialised(config)
    x, _ = arguments(config)
    points, captured = apply(config, params, x, intermediates=True)
    outputs = captured["intermediates"]
    fc = outputs["fc"]["points"]["__call__"][0]
    network = build(config)
    grid, (fc_range, deconv_range) = network.grid, network.branches
    cells = outputs["deconv_points"]["__call__"][0] + np.asarray(layers.grid_offset(*grid))
    assert cells.shape == (2, grid.height, grid.width, 3 * grid.points_per_cell)
    assert points.shape == (2, network.num_points, 3)
    np.testing.assert_array_equal(points[:, 5], fc[:, 15:18])
    assert deconv_range[0] == fc_range[-1] + 1
    for row, column, k in [(0, 0, 1), (3, 5, 0), (7, 11, 1)]:
        index = deconv_range[(row * grid.width + column) * 2 + k]
        np.testing.assert_array_equal(points[:, index], cells[:, row, column, 3 * k : 3 * k + 3])


def test_every_pixel_random_number_and_parameter_reaches_the_output():
    """In both passes of the hourglass, which has all layers of the other versions."""
    small = {"widths": (8,) * 7, "fc_widths": (32, 16), "fc_points": 16}
    config = ModelConfig(name="hourglass", random_size=5, **small)
    network, params = initialised(config)
    x, r = arguments(config, batch=1)
    weights = np.random.default_rng(3).normal(size=(1, network.num_points, 3)).astype("f4")

    def weighted(params, x, r):
        return jnp.sum(network.apply({"params": params}, x, r) * weights)

    gradients = jax.jit(jax.grad(weighted, argnums=(0, 1, 2)))(params, x, r)
    by_parameter, by_pixel, by_random = jax.device_get(gradients)
    assert np.all(np.any(by_pixel != 0, axis=-1))
    assert np.all(np.any(by_pixel != 0, axis=(0, 1, 2)))
    assert np.all(by_random != 0)
    for path, leaf in jax.tree_util.tree_flatten_with_path(by_parameter)[0]:
        assert np.any(leaf != 0), jax.tree_util.keystr(path)


def test_padding_repeats_the_border_on_both_sides():
    config = tiny_config(image_size=(29, 37))
    assert build(config).padded_size == (32, 48)
    assert build(full_config("vanilla", image_size=(32, 65))).padded_size == (64, 128)
    x, _ = arguments(config)
    padded = np.pad(x, [(0, 0), (1, 2), (5, 6), (0, 0)], mode="edge")
    whole = dataclasses.replace(config, image_size=(32, 48))
    _, params = initialised(whole)
    want = apply(whole, params, padded)
    np.testing.assert_allclose(apply(config, params, x), want, rtol=1e-5, atol=1e-6)


def test_bfloat16_keeps_parameters_and_points_in_float32():
    config = tiny_config("hourglass", random_size=4, compute_dtype="bfloat16")
    x, r = arguments(config)
    network = build(config)
    variables = jax.eval_shape(network.init, jax.random.key(0), x, r)
    assert all(leaf.dtype == jnp.float32 for leaf in jax.tree.leaves(variables))
    apply = functools.partial(network.apply, capture_intermediates=True)
    points, captured = jax.eval_shape(apply, variables, x, r)
    assert points.dtype == jnp.float32
    assert captured["intermediates"]["deconv_conv"]["__call__"][0].dtype == jnp.bfloat16


@pytest.mark.parametrize("random_at", ["bottleneck", "all"])
def test_several_draws_are_as_many_separate_calls_and_samples_are_independent(random_at):
    config = tiny_config(random_size=4, random_at=random_at)
    _, params = initialised(config)
    x, _ = arguments(config)
    r = np.random.default_rng(4).normal(size=(2, 3, 4)).astype(np.float32)
    clouds = apply(config, params, x, r)
    assert clouds.shape == (2, 3, build(config).num_points, 3)
    assert np.abs(clouds[:, 0] - clouds[:, 1]).max() > 1e-4
    separate = np.stack([apply(config, params, x, r[:, i]) for i in range(3)], axis=1)
    np.testing.assert_allclose(clouds, separate, rtol=1e-4, atol=1e-5)
    other = np.stack([x[0], 1 - x[1]])
    np.testing.assert_array_equal(apply(config, params, other, r)[0], clouds[0])
    assert np.abs(apply(config, params, other, r)[1] - clouds[1]).max() > 1e-4
    shapes = jax.eval_shape(build(config).init, jax.random.key(0), x, r)["params"]
    assert jax.tree.map(jnp.shape, shapes) == jax.tree.map(jnp.shape, params)


@pytest.mark.parametrize(("name", "most"), [("two_branch", 1.85), ("hourglass", 3.3)])
def test_eight_draws_cost_no_eight_encoders(name, most):
    """Counts at full size. The hourglass repeats all layers after its first bottleneck."""
    config = full_config(name, random_size=128)
    network, x = build(config), jax.ShapeDtypeStruct((1, 192, 256, 4), jnp.float32)
    one, eight = (jax.ShapeDtypeStruct((1, *n, 128), jnp.float32) for n in ((), (8,)))
    variables = jax.eval_shape(network.init, jax.random.key(0), x, one)

    def count(r):  # arithmetic operations, by XLA's analysis
        return jax.jit(network.apply).lower(variables, x, r).cost_analysis()["flops"]

    with convolutions_for("export"):  # calls of oneDNN are not counted
        assert count(eight) < most * count(one)


@pytest.mark.usefixtures("unchecked_annotations")
def test_wrong_arrays():
    plain, random = tiny_config(), tiny_config(random_size=4)
    x, r = arguments(random)

    def called(case):
        jax.eval_shape(build(case[0]).init, jax.random.key(0), *case[1:])

    all_refused(called, ValueError, [
        ((plain, x[:, :16]), "x has the shape (2, 16, 48, 4)", "(32, 48, 4)"),
        ((plain, x, r), "r is of the shape (2, 4)", "None"),
        ((random, x), "r is None", "(2, 'draws', 4)"),
        ((random, x, r[:1]), "r is of the shape (1, 4)", "(2, 'draws', 4)"),
        ((random, x, r[:, :3]), "r is of the shape (2, 3)", "(2, 'draws', 4)"),
    ])  # fmt: skip


def test_with_xla_a_network_has_forward_mode(monkeypatch):
    monkeypatch.setenv("PSGN_CONVOLUTIONS", "xla")
    config = tiny_config("vanilla", widths=(8, 8), image_size=(8, 8))
    network, params = initialised(config)
    x, _ = arguments(config)
    predict = jax.jit(lambda x: network.apply({"params": params}, x))
    _, moved = jax.jvp(predict, (x,), (x,))
    by_reverse = jax.grad(lambda x: predict(x).sum())(x)
    np.testing.assert_allclose(moved.sum(), (by_reverse * x).sum(), rtol=1e-4)
