"""Convolutions of images on a CPU, computed by oneDNN through its C interface, version 3.

The package `onednn-cpu-gomp` contains the library. The three parts of a convolution

    y[o] = sum over taps t of x[stride * o + t - low] kernel[t]

(o and t have two components) are `forward`, which returns y, `input_gradient`, the adjoint with
respect to x, and `kernel_gradient`, the adjoint with respect to the kernel. Images are float32 or
bfloat16 with the axes [batch, height, width, channels], kernels [kh, kw, c_in, c_out]. Sums are
accumulated in float32. The results are deterministic for a fixed number of threads.

XLA calls the library through a Python callback, which passes pointers and copies no images.
Therefore JAX neither caches nor exports programs with these functions. There are at most as many
simultaneous calls as devices; they share the cores, or use `OMP_NUM_THREADS` threads each.
Primitives are kept for each thread, for the life of the process.
"""

import ctypes
import functools
import importlib.metadata
import os
import threading
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, get_args

import jax
import numpy as np

from psgn_jax.array_types import Array
from psgn_jax.system.cores import num_cores

_DISTRIBUTION, _FILE = "onednn-cpu-gomp", "libdnnl.so.3"

# Constants of oneDNN's header files.
_CPU, _IN_ORDER, _ANY_LAYOUT, _DIRECT, _FORWARD_TRAINING = 1, 1, 1, 1, 64
_USER_SCRATCHPAD = 1
_IMPLEMENTATION, _WEIGHTS_DESC, _DIFF_WEIGHTS_DESC, _SCRATCHPAD_DESC = 8, 131, 132, 136
_SRC, _DST, _WEIGHTS, _SCRATCHPAD = 1, 17, 33, 80
_DIFF_SRC, _DIFF_DST, _DIFF_WEIGHTS = 129, 145, 161
_UNSUPPORTED = (2, 3)  # statuses: invalid arguments, unimplemented
_DTYPES = {"float32": 3, "bfloat16": 2}
_ALIGNMENT = 64

# Iterations for which OpenMP's threads spin before they sleep. By default they keep the cores busy
# for milliseconds; threads that sleep at once start late.
_SPINS = "10000"

_Handle = ctypes.c_void_p
Part = Literal["forward", "input_gradient", "kernel_gradient"]


class OneDNNError(RuntimeError):
    """A call of oneDNN has failed; the arguments are a message and the status."""


class Convolution(NamedTuple):
    """Shapes and geometry of a convolution; `padding` is ((top, bottom), (left, right)).

    The padded size is `(out - 1) * stride + k`; padding of unread outer pixels is negative.
    """

    x: tuple[int, ...]
    kernel: tuple[int, ...]
    y: tuple[int, ...]
    stride: int
    padding: tuple[tuple[int, int], tuple[int, int]]
    dtype: str


class _Argument(ctypes.Structure):
    _fields_ = (("kind", ctypes.c_int), ("memory", ctypes.c_void_p))


@functools.cache
def library() -> tuple[Any, str]:
    """The loaded library, or None and the reason.

    `GOMP_SPINCOUNT` is set during loading, unless it or `OMP_WAIT_POLICY` is set already.
    """
    try:
        files = importlib.metadata.files(_DISTRIBUTION) or []
        path = next(str(file.locate()) for file in files if file.name == _FILE)
    except (importlib.metadata.PackageNotFoundError, StopIteration):
        return None, f"the package {_DISTRIBUTION} is not installed (Linux x86-64 only)"
    chosen = {"OMP_WAIT_POLICY", "GOMP_SPINCOUNT"} & os.environ.keys()
    if not chosen:
        os.environ["GOMP_SPINCOUNT"] = _SPINS
    try:
        loaded = ctypes.CDLL(path)
    except OSError as error:  # such as a missing libgomp.so.1
        return None, str(error)
    finally:
        if not chosen:
            del os.environ["GOMP_SPINCOUNT"]
    loaded.dnnl_primitive_desc_query_md.restype = ctypes.c_void_p
    loaded.dnnl_memory_desc_get_size.restype = ctypes.c_size_t
    return loaded, ""


def computes(convolution: Convolution) -> bool:
    """Whether oneDNN has fast routines for all parts of a convolution."""
    thread = threading.get_ident()
    return all(_primitive(thread, part, convolution) is not None for part in get_args(Part))


def compute(part: Part, first: Array, second: Array, convolution: Convolution) -> Array:
    """A part of a convolution, if oneDNN `computes` it.

    Arguments: (x, kernel) for "forward", (dy, kernel) or (x, dy) for the input or kernel gradient.
    """
    primitive = _primitive(threading.get_ident(), part, convolution)
    assert primitive is not None
    # An experimental API, so it is imported only where it is used.
    from jax.experimental.buffer_callback import buffer_callback

    shapes = {"forward": convolution.y, "input_gradient": convolution.x}
    result = jax.ShapeDtypeStruct(shapes.get(part, convolution.kernel), first.dtype)
    # JAX compares callbacks to find compiled programs; a bound method is equal to itself.
    return buffer_callback(primitive.callback, result, vmap_method="sequential")(first, second)


@functools.cache
def _turns() -> threading.Semaphore:
    """Limits the number of simultaneous calls."""
    return threading.Semaphore(jax.local_device_count())


# A call sets addresses in streams, primitives and workspaces, so threads cannot share them. Not
# `threading.local`: Python forgets XLA's threads after each callback.
_making = threading.Lock()  # the first thread makes the engine, which all share
_workspaces: dict[tuple[int, str], np.ndarray] = {}


@functools.cache
def _stream(thread: int) -> _Handle:
    if (devices := jax.local_device_count()) > 1 and "OMP_NUM_THREADS" not in os.environ:
        library()[0].omp_set_num_threads(-(-num_cores() // devices))
    with _making:
        return _make("dnnl_stream_create", _engine()[0], _IN_ORDER)


@functools.cache
def _primitive(thread: int, part: Part, convolution: Convolution) -> "_Primitive | None":
    """The primitive of the calling thread."""
    (top, bottom), (left, right) = convolution.padding
    if convolution.dtype not in _DTYPES or min(top, left) < 0 or 0 in convolution.x:
        return None
    _stream(thread)
    # For negative padding at the end, oneDNN ignores the last pixels by itself.
    padding = ((top, max(0, bottom)), (left, max(0, right)))
    try:
        primitive = _Primitive(part, convolution._replace(padding=padding))
    except OneDNNError as error:
        if error.args[1] in _UNSUPPORTED:
            return None
        raise
    return None if primitive.implementation.startswith("ref") else primitive


def _call(name: str, *args: Any) -> None:
    if status := getattr(library()[0], name)(*args):
        raise OneDNNError(f"oneDNN: {name} returned status {status}", status)


def _make(name: str, *args: Any) -> _Handle:
    """Calls a function that returns a new object in its first argument."""
    handle = _Handle()
    _call(name, ctypes.byref(handle), *args)
    return handle


def _query(desc: _Handle, what: int) -> _Handle:
    """A memory descriptor of a primitive."""
    return _Handle(library()[0].dnnl_primitive_desc_query_md(desc, what, 0))


def _size(desc: _Handle) -> int:
    return int(library()[0].dnnl_memory_desc_get_size(desc))


def _dims(*values: int) -> Any:
    return (ctypes.c_int64 * 12)(*values)


@functools.cache
def _engine() -> tuple[_Handle, _Handle]:
    """Engine and attributes of all primitives."""
    engine = _make("dnnl_engine_create", _CPU, ctypes.c_size_t(0))
    attributes = _make("dnnl_primitive_attr_create")
    _call("dnnl_primitive_attr_set_scratchpad_mode", attributes, _USER_SCRATCHPAD)
    return engine, attributes


def _strided(dims: Any, dtype: int, strides: Any) -> _Handle:
    return _make("dnnl_memory_desc_create_with_strides", 4, dims, dtype, strides)


def _images(shape: Sequence[int], dtype: int) -> _Handle:
    b, h, w, c = shape
    return _strided(_dims(b, c, h, w), dtype, _dims(h * w * c, 1, w * c, c))


def _memory(desc: _Handle) -> _Handle:
    """A memory object without memory; `_place` sets its address."""
    return _make("dnnl_memory_create", desc, _engine()[0], _Handle())


def _place(memory: _Handle, address: int) -> None:
    _call("dnnl_memory_set_data_handle", memory, _Handle(address))


def _address(buffer: Any) -> int:
    return int(np.asarray(buffer).__array_interface__["data"][0])


def _workspace(purpose: str, size: int) -> int:
    """Address of temporary memory; the block for a purpose only grows."""
    key = threading.get_ident(), purpose
    block = _workspaces.get(key)
    if block is None or len(block) < size + _ALIGNMENT:
        block = _workspaces[key] = np.empty(size + _ALIGNMENT, np.uint8)
    return -(-_address(block) // _ALIGNMENT) * _ALIGNMENT


class _Step:
    """A primitive and its arguments."""

    def __init__(self, desc: _Handle, arguments: dict[int, _Handle]):
        self._primitive = _make("dnnl_primitive_create", desc)
        scratchpad = _query(desc, _SCRATCHPAD_DESC)
        self._scratchpad, self._size = _memory(scratchpad), _size(scratchpad)
        pairs = [*arguments.items(), (_SCRATCHPAD, self._scratchpad)]
        self._arguments = (_Argument * len(pairs))(*(_Argument(*pair) for pair in pairs))

    def run(self) -> None:
        _place(self._scratchpad, _workspace("scratchpad", self._size))
        stream, arguments = _stream(threading.get_ident()), self._arguments
        _call("dnnl_primitive_execute", self._primitive, stream, len(arguments), arguments)


class _Primitive:
    """One part of a convolution, with the kernel's conversion to or from oneDNN's layout."""

    def __init__(self, part: Part, convolution: Convolution):
        self._key = part, convolution
        engine, attributes = _engine()
        dtype, stride = _DTYPES[convolution.dtype], convolution.stride
        x, y = _images(convolution.x, dtype), _images(convolution.y, dtype)
        kh, kw, c_in, c_out = convolution.kernel
        dims = _dims(c_out, c_in, kh, kw)
        ours = _strided(dims, dtype, _dims(1, c_out, kw * c_in * c_out, c_in * c_out))
        kernel = _make("dnnl_memory_desc_create_with_tag", 4, dims, dtype, _ANY_LAYOUT)
        low, high = (_dims(*side) for side in zip(*convolution.padding, strict=True))
        geometry = (_dims(stride, stride), _dims(0, 0), low, high)
        backward, name = part == "kernel_gradient", "dnnl_convolution_{}_primitive_desc_create"
        kinds, with_bias = (engine, _FORWARD_TRAINING, _DIRECT), (x, kernel, None, y)
        desc = _make(name.format("forward"), *kinds, *with_bias, *geometry, attributes)
        if part != "forward":
            name = name.format("backward_weights" if backward else "backward_data")
            tensors = with_bias if backward else (x, kernel, y)
            desc = _make(name, engine, _DIRECT, *tensors, *geometry, desc, attributes)
        text = ctypes.c_char_p()
        _call("dnnl_primitive_desc_query", desc, _IMPLEMENTATION, 0, ctypes.byref(text))
        self.implementation = (text.value or b"").decode()

        theirs = _query(desc, _DIFF_WEIGHTS_DESC if backward else _WEIGHTS_DESC)
        images, result, weights = _memory(x), _memory(y), _memory(ours)
        self._converted: tuple[_Handle, int] | None = None
        inner, conversion = weights, []
        if not library()[0].dnnl_memory_desc_equal(theirs, ours):
            inner = _memory(theirs)
            self._converted = inner, _size(theirs)
            (source, start), (target, end) = (ours, weights), (theirs, inner)
            if backward:
                (source, start), (target, end) = (target, end), (source, start)
            create = "dnnl_reorder_primitive_desc_create"
            reorder = _make(create, source, engine, target, engine, attributes)
            conversion = [_Step(reorder, {_SRC: start, _DST: end})]
        arguments = {  # in the order of first, second and result
            "forward": {_SRC: images, _WEIGHTS: inner, _DST: result},
            "input_gradient": {_DIFF_DST: result, _WEIGHTS: inner, _DIFF_SRC: images},
            "kernel_gradient": {_SRC: images, _DIFF_DST: result, _DIFF_WEIGHTS: inner},
        }[part]
        self._outer = [weights if memory is inner else memory for memory in arguments.values()]
        step = _Step(desc, arguments)
        self._steps = [step, *conversion] if backward else [*conversion, step]

    def callback(self, _: Any, result: Any, first: Any, second: Any) -> None:
        """Computes `result` from the buffers that XLA passes, in a thread of XLA."""
        with _turns():
            primitive = _primitive(threading.get_ident(), *self._key)
            assert primitive is not None
            primitive._run(first, second, result)

    def _run(self, *buffers: Any) -> None:
        for memory, buffer in zip(self._outer, buffers, strict=True):
            _place(memory, _address(buffer))
        if self._converted is not None:
            memory, size = self._converted
            _place(memory, _workspace("kernel", size))
        for step in self._steps:
            step.run()
        _call("dnnl_stream_wait", _stream(threading.get_ident()))
