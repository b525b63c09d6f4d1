"""Times 3x3x3 convolutions on a CPU: XLA's, and convolutions of slices as batches of images.

    python tests/bench/convolution3d.py [--batch 2]

Prints CPU seconds of the process (the least of three calls), for the value alone and for the value
with both gradients. `lax` is `conv_general_dilated`. `ours` is the function that the package uses.
`outputs` is a variant of it in which the three depths of the kernel become output channels.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.models.cpu_convolution import conv2d, conv3d


def lax(x, kernel):
    return jax.lax.conv_general_dilated(
        x, kernel, (1, 1, 1), "SAME", dimension_numbers=("NDHWC", "DHWIO", "NDHWC")
    )


def outputs(x, kernel):
    b, n, h, w, c = x.shape
    flat = kernel.transpose(1, 2, 3, 0, 4).reshape(3, 3, c, -1)
    y = conv2d(x.reshape(b * n, h, w, c), flat).reshape(b, n, h, w, 3, -1)
    rest = ((0, 0), (0, 0), (0, 0))
    before = jnp.pad(y[:, :-1, :, :, 0], ((0, 0), (1, 0), *rest))
    after = jnp.pad(y[:, 1:, :, :, 2], ((0, 0), (0, 1), *rest))
    return before + y[:, :, :, :, 1] + after


def seconds(call, *inputs):
    best = np.inf
    jax.block_until_ready(call(*inputs))
    for _ in range(3):
        start = time.process_time()
        jax.block_until_ready(call(*inputs))
        best = min(best, time.process_time() - start)
    return best


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--batch", type=int, default=2)
    batch = parser.parse_args().batch
    for n, c_in, c_out in ((32, 1, 16), (32, 16, 16), (32, 16, 1), (8, 128, 128), (4, 128, 128)):
        rng = np.random.default_rng(0)
        x = jnp.asarray(rng.normal(size=(batch, n, n, n, c_in)), jnp.float32)
        kernel = jnp.asarray(rng.normal(size=(3, 3, 3, c_in, c_out)), jnp.float32)
        row = f"{n:3d}^3 {c_in:4d} -> {c_out:4d}"
        for name, function in (("lax", lax), ("ours", conv3d), ("outputs", outputs)):
            value = jax.jit(function)
            both = jax.jit(jax.grad(lambda a, k, f=function: (f(a, k) ** 2).sum(), (0, 1)))
            forward = seconds(value, x, kernel)
            backward = seconds(both, x, kernel)
            row += f"   {name} {forward:.4f} {backward:.4f}"
        print(row, flush=True)


if __name__ == "__main__":
    main()
