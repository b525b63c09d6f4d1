"""Nearest neighbours on a GPU: a Pallas kernel (Triton) that keeps minima and indices on chip.

One program holds a tile of rows (points of one cloud) in registers and streams over the columns
(points of the other cloud). For each row and lane it keeps the smallest squared distance and the
number of the chunk of columns with that distance. No array of size n m is written. Each of the two
directions is one launch. Under `vmap` the batch is an axis of the launch. Reductions have a fixed
order, so equal inputs give equal bits.

Cost. A distance takes 6 instructions per lane (3 differences, 1 product, 2 fused multiply-adds),
its minimum 1, the update of the chunk number 2. For long clouds one number is stored for each group
of _GROUP chunks (2 / _GROUP instructions); at the end the distances to the group with the minimum
(256 columns for each row) are computed again. In the machine code of Triton 3.6 for sm_90 the inner
loop has 7.8 instructions per distance for 16,384 columns and 9.7 for 1,024 columns, without spills.
For clouds of these two sizes, both directions together therefore take 17.5 instructions per pair of
points. An exact search that computes every distance once needs at least 8 (6 for the distance, and
one minimum per direction); `tests/bench/kernels.py` uses 8 as the lower bound. The time is not
known: the kernel has not been run on a GPU yet.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import pallas as pl
from jax.experimental.pallas import triton as plgpu

from psgn_jax.losses.kernels.dispatch import varying_like
from psgn_jax.types import Array

# A tile of 32 x 64 distances on 4 warps is 16 rows and one column per thread. For each row the
# thread stores 3 coordinates, 2 minima (of the group and of all columns so far) and a number. It
# uses 113 to 162 registers in total. Triton requires powers of two.
_ROWS = 32
_COLS = 64
_GROUP = 4  # chunks of columns that share a stored number if there are at least _LONG columns
_LONG = 4096
_WARPS = 4
_LAST = np.iinfo(np.int32).max


def _kernel(rows_ref, cols_ref, distance_ref, index_ref, *, groups: int, group: int):  # type: ignore[no-untyped-def]
    rows = [rows_ref[axis, :][:, None] for axis in range(3)]
    lanes = jax.lax.broadcasted_iota(jnp.int32, (1, _COLS), 1)
    shape = (_ROWS, _COLS)

    def squared(cols: list[Array]) -> Array:
        x, y, z = (r - c for r, c in zip(rows, cols, strict=True))
        return x * x + y * y + z * z

    def step(number: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        best, where = carry
        least = None
        for chunk in range(group):
            begin = (number * group + chunk) * _COLS
            d = squared([cols_ref[axis, pl.ds(begin, _COLS)][None, :] for axis in range(3)])
            least = d if least is None else jnp.minimum(least, d)
        assert least is not None
        better = least < best  # strict: among equal distances the first is kept
        return jnp.where(better, least, best), jnp.where(better, number, where)

    start = jnp.full(shape, jnp.inf, rows[0].dtype), jnp.zeros(shape, jnp.int32)
    best, where = jax.lax.fori_loop(jnp.int32(0), jnp.int32(groups), step, start)
    if group == 1:
        where = where * _COLS + lanes
    else:
        # Compute the distances to the first group with the minimum again, to find the column. The
        # minimum is also computed again, because a new distance may be rounded differently and then
        # differ from the old minimum.
        least = jnp.min(best, axis=1)[:, None]
        first = jnp.min(jnp.where(best == least, where, groups - 1), axis=1)[:, None]
        best, where = start
        for chunk in range(group):
            position = (first * group + chunk) * _COLS + lanes
            d = squared([plgpu.load(cols_ref.at[axis, position]) for axis in range(3)])
            better = d < best
            best, where = jnp.where(better, d, best), jnp.where(better, position, where)
    least = jnp.min(best, axis=1)
    distance_ref[:] = least
    index_ref[:] = jnp.min(jnp.where(best == least[:, None], where, _LAST), axis=1)


def _planes(points: Array, multiple: int) -> Array:
    # Pads with copies of the last point. They tie with the last point, and the lowest index wins a
    # tie, so no padded point is ever chosen.
    return jnp.pad(points, ((0, -len(points) % multiple), (0, 0)), mode="edge").T


def nearest(rows: Array, cols: Array, *, interpret: bool = False) -> tuple[Array, Array]:
    """Squared distance and index of the nearest point of `cols` [m, 3] for each of `rows` [n, 3].

    Among points at equal distance the lowest index is returned. If coordinates are NaN, the results
    of the affected rows are undefined, but the kernel terminates.
    """
    n, m = len(rows), len(cols)
    group = _GROUP if m >= _LONG else 1
    rows, cols = _planes(rows, _ROWS), _planes(cols, _COLS * group)
    padded = rows.shape[1]
    tile = pl.BlockSpec((_ROWS,), lambda i: (i,))
    distance, index = pl.pallas_call(
        functools.partial(_kernel, groups=cols.shape[1] // (_COLS * group), group=group),
        grid=(padded // _ROWS,),
        in_specs=[
            pl.BlockSpec((3, _ROWS), lambda i: (0, i)),
            pl.BlockSpec(cols.shape, lambda i: (0, 0)),
        ],
        out_specs=(tile, tile),
        out_shape=(
            varying_like((padded,), rows.dtype, rows, cols),
            varying_like((padded,), jnp.int32, rows, cols),
        ),
        compiler_params=plgpu.CompilerParams(num_warps=_WARPS, num_stages=1),
        interpret=interpret,
        name="chamfer_nearest",
    )(rows, cols)
    return distance[:n], jnp.clip(index[:n], 0, m - 1)


def search(a: Array, b: Array, *, interpret: bool = False) -> tuple[Array, Array, Array, Array]:
    """Squared distances and indices of the nearest points from a to b, then from b to a."""
    return *nearest(a, b, interpret=interpret), *nearest(b, a, interpret=interpret)


def trial() -> bool:
    """Returns whether the compiled kernel is correct on small clouds, on the default device."""
    rng = np.random.default_rng(0)
    a, b = (rng.normal(size=(n, 3)).astype(np.float32) for n in (40, _LONG))
    d = np.square(a[:, None] - b[None]).sum(axis=-1)
    got = jax.jit(search).lower(a, b).compile()(a, b)
    return bool(
        np.allclose(got[0], d.min(axis=1), rtol=1e-5)
        and np.allclose(d[np.arange(len(a)), got[1]], d.min(axis=1), rtol=1e-5)
        and np.allclose(got[2], d.min(axis=0), rtol=1e-5)
        and np.allclose(d[got[3], np.arange(len(b))], d.min(axis=0), rtol=1e-5)
    )
