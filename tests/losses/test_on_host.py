"""The EMD of clouds on an accelerator is solved on the host, with the bits of a CPU.

No accelerator is needed: JAX is told that its default backend is a GPU, and computes on the CPU.
"""

import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
START = """
import sys, threading
import jax, jax.numpy as jnp, numpy as np
# A callback keeps a thread of the CPU's client busy, which on an accelerator is another client.
jax.config.update("jax_cpu_enable_async_dispatch", False)
"""
PAIRS = """
from psgn_jax import losses
from psgn_jax.config.experiment import LossConfig
from psgn_jax.losses import auction
from psgn_jax.losses.by_name import configured_loss
a, b = np.random.default_rng(0).normal(size=(2, 4, 20, 3)).astype(np.float32)
def same(found, want):
    jax.tree.map(np.testing.assert_array_equal, found, want)
def value(a, b):
    return losses.emd_mean(a, b, tolerance=.1)
def gradient(a, b):
    return jax.grad(lambda a, b: losses.map_pairs(value)(a, b).sum(), (0, 1))(a, b)
"""
ONE_PROCESS = """
with_nan = a.copy()
with_nan[1, 3] = np.nan
direct = jax.jit(jax.vmap(losses.assign))(a, b)
direct_nan = jax.jit(jax.vmap(losses.assign))(with_nan, b)
direct_gradient = jax.jit(gradient)(a, b)
jax.clear_caches()
jax.default_backend = lambda: "gpu"
assign = jax.jit(jax.vmap(losses.assign))
same(assign(a, b), direct)
same(jax.vmap(losses.assign)(a, b), direct)
same(losses.assign(a[0], b[0]), jax.tree.map(lambda x: x[0], direct))
same(jax.jit(gradient)(a, b), direct_gradient)
same(jax.lax.scan(lambda _, pair: (None, losses.assign(*pair)), None, (a, b))[1], direct)
same(assign(with_nan, b), direct_nan)
assert np.isnan(direct_nan.gap).tolist() == [False, True, False, False]
same(jax.jit(losses.map_pairs(losses.assign))(a[:0], b[:0]).index, np.zeros((0, 20)))

# 200 steps beside a thread that keeps the interpreter busy.
def compute():
    while not done:
        sum(range(1000))
done = False
sys.setswitchinterval(1e-4)
busy = threading.Thread(target=compute)
busy.start()
step = jax.jit(jax.grad(lambda a, b: losses.map_pairs(value)(a, b).sum()))
x = a
for _ in range(200):
    x = x - .01 * step(x, b)
done = True
busy.join()
assert value(x[0], b[0]) < value(a[0], b[0])

# The program for a GPU has one callback and no loop.
from jax._src.callback import pure_callback_p
from jax._src.interpreters import mlir
def stand_in(ctx, *arguments, **_):  # the real one needs a GPU
    types = [mlir.aval_to_ir_type(ctx.module_context, x) for x in ctx.avals_out]
    return mlir.custom_call("solve", result_types=types, operands=arguments).results
mlir.register_lowering(pure_callback_p, stand_in, platform="cuda")
loss = losses.map_pairs(configured_loss(LossConfig("emd_mean@20 + 5*chamfer_sq_mean")))
total = jax.grad(lambda pred, gt: loss(pred, gt)[0].sum())
more = np.concatenate([b] * 60, 1)  # 1,200 points: two tiles for a GPU
text = jax.jit(total).trace(a, more).lower(lowering_platforms=("cuda",)).as_text()
assert text.count("custom_call @solve") == 1
assert text.count("stablehlo.while") <= 1, "one for the tiles of the Chamfer distance"
text = jax.jit(gradient).trace(a, b).lower(lowering_platforms=("cuda",)).as_text()
assert text.count("custom_call @solve") == 1 and "while" not in text

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


def start(code, *arguments):
    """A process in which `code` runs; as in the tests, it compiles without optimisation."""
    flags = ("--xla_backend_optimization_level=0", "--xla_cpu_parallel_codegen_split_count=1")
    environment = {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}
    command = [sys.executable, "-c", START + PAIRS + code, *arguments]
    return subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, env=environment | {"XLA_FLAGS": " ".join(flags)}
    )


def test_the_bits_of_a_cpu():
    process = start(ONE_PROCESS)
    _, errors = process.communicate(timeout=900)
    assert process.returncode == 0, errors[-3000:]
