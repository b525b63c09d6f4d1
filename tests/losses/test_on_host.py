"""The EMD of clouds on an accelerator is solved on the host, with the bits of a CPU.

No accelerator is needed: the programs for one are chosen, and compute on the CPU.
"""

import sys

import pytest
from helpers.commands import ROOT, run

pytestmark = pytest.mark.slow
START = """
import sys, threading
import jax, jax.numpy as jnp, numpy as np
# A callback keeps a thread of the CPU's client busy, which on an accelerator is another client.
jax.config.update("jax_cpu_enable_async_dispatch", False)
"""
PAIRS = """
from psgn_jax import losses
from psgn_jax.losses import auction, chamfer, mapping
a, b = np.random.default_rng(0).normal(size=(2, 4, 20, 3)).astype(np.float32)
def same(found, want):
    jax.tree.map(np.testing.assert_array_equal, found, want)
def value(a, b):
    return losses.emd_mean(a, b, tolerance=.1)
def choose_the_accelerator():
    jax.clear_caches()
    for module in (auction, chamfer, mapping):
        module.per_platform = lambda cpu, other, *arrays: other(*arrays)
def gradient(a, b):
    return jax.grad(lambda a, b: losses.map_pairs(value)(a, b).sum(), (0, 1))(a, b)
"""
ONE_PROCESS = """
with_nan = a.copy()
with_nan[1, 3] = np.nan
direct = jax.jit(jax.vmap(losses.assign))(a, b)
direct_nan = jax.jit(jax.vmap(losses.assign))(with_nan, b)
direct_gradient = jax.jit(gradient)(a, b)
choose_the_accelerator()
assign = jax.jit(jax.vmap(losses.assign))
same(assign(a, b), direct)
same(jax.vmap(losses.assign)(a, b), direct)
same(losses.assign(a[0], b[0]), jax.tree.map(lambda x: x[0], direct))
same(jax.jit(gradient)(a, b), direct_gradient)
same(jax.lax.scan(lambda _, pair: (None, losses.assign(*pair)), None, (a, b))[1], direct)
same(assign(with_nan, b), direct_nan)
assert np.isnan(direct_nan.gap).tolist() == [False, True, False, False]
same(jax.jit(losses.map_pairs(losses.assign))(a[:0], b[:0]).index, np.zeros((0, 20)))

# 100 steps beside a thread that keeps the interpreter busy.
def compute():
    while not done:
        sum(range(1000))
done = False
sys.setswitchinterval(1e-4)
busy = threading.Thread(target=compute)
busy.start()
step = jax.jit(jax.grad(lambda a, b: losses.map_pairs(value)(a, b).sum()))
x = a
for _ in range(100):
    x = x - .01 * step(x, b)
done = True
busy.join()
assert value(x[0], b[0]) < value(a[0], b[0])

def fails(*_):
    raise MemoryError("no memory for this pair")
auction._solve = fails
try:
    jax.block_until_ready(assign(a, b))
except (jax.errors.JaxRuntimeError, ValueError) as error:  # JAX's type differs by its way there
    assert "no memory for this pair" in str(error)
else:
    raise AssertionError("no error")
"""
TWO_DEVICES = """
mesh = jax.make_mesh((2,), ("d",), axis_types=(jax.sharding.AxisType.Auto,))
def split(function):
    return jax.jit(jax.shard_map(function, mesh=mesh, in_specs=jax.P("d"), out_specs=jax.P("d")))
def with_sum(a, b):
    found = gradient(a, b)
    return found, jax.lax.psum(jnp.abs(found[0]).sum(), "d")[None]
functions = [losses.map_pairs(losses.assign), jax.vmap(losses.assign), with_sum]
direct = [split(f)(a, b) for f in functions]
choose_the_accelerator()
for f, wanted in zip(functions, direct):
    on_host = split(f)
    for _ in range(20):
        same(on_host(a, b), wanted)
"""
TEXT_FOR_A_GPU = """
from helpers import standin
from jax._src.callback import pure_callback_p
from jax._src.interpreters import mlir
from psgn_jax import tasks
from psgn_jax.data import loader
from psgn_jax.models import networks
from psgn_jax.training import step
jax.default_backend = lambda: "gpu"
def stand_in(ctx, *arguments, **_):  # the real one needs a GPU
    types = [mlir.aval_to_ir_type(ctx.module_context, x) for x in ctx.avals_out]
    return mlir.custom_call("solve", result_types=types, operands=arguments).results
mlir.register_lowering(pure_callback_p, stand_in, platform="cuda")
def text(function, *arguments):
    return jax.jit(function).trace(*arguments).lower(lowering_platforms=("cuda",)).as_text()

loss = "emd_mean@136 + 5*chamfer_sq_mean"
config = standin.config(data__num_points=136, loss__name=loss, model__widths=(4, 6, 8))
task = tasks.create(config)
create, train_step = step.create_training(config, task, step.data_mesh())
state = jax.eval_shape(create)
batches = loader.train_batches(config.data, batch_size=8, seed=0, start_step=0)
batch = {k: v for k, v in next(batches).items() if k in networks.input_keys(config)}
program = text(train_step, state, batch)
assert program.count("custom_call @solve") == 1 and "while" not in program
jax.clear_caches()
"""


def check(code, devices=1):
    """`code` runs in a process; as in the tests, it compiles without optimisation."""
    flags = ("--xla_backend_optimization_level=0", "--xla_cpu_parallel_codegen_split_count=1",
             f"--xla_force_host_platform_device_count={devices}")  # fmt: skip
    path = f"{ROOT}:{ROOT / 'tests'}"
    environment = {"JAX_PLATFORMS": "cpu", "PYTHONPATH": path, "PATH": "/usr/bin:/bin"}
    environment["XLA_FLAGS"] = " ".join(flags)
    run(sys.executable, "-c", START + PAIRS + code, env=environment)


def test_the_bits_of_a_cpu_and_one_callback_in_a_step_on_a_gpu():
    check(TEXT_FOR_A_GPU + ONE_PROCESS)


def test_two_devices():
    check(TWO_DEVICES, devices=2)
