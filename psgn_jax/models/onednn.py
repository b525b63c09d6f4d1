"""Convolutions of batches of images on a CPU, computed by oneDNN.

oneDNN is the library whose kernels PyTorch uses on x86-64 processors. It is optional:
`pip install 'psgn-jax[onednn]'` installs it on Linux. A system's own `libdnnl.so.3` is used as
well. `models.cpu_convolution` calls this module if the library is found and supports the
convolution.

The functions compute the three parts of a convolution

    y[o] = sum over taps t of x[stride * o + t - low] kernel[t]

(o and t have two components): `forward` returns y, `input_gradient` the adjoint with respect to x,
and `kernel_gradient` the adjoint with respect to the kernel. Images are float32 or bfloat16 with
the axes [batch, height, width, channels], kernels [kh, kw, c_in, c_out]. Sums are accumulated in
float32. The results are deterministic for a fixed number of threads.

XLA calls the library through a Python callback, which passes pointers and copies no images. oneDNN
uses its own layout for kernels; rearranging them is part of the time of a call. Each call uses all
threads of oneDNN (`OMP_NUM_THREADS`, by default one for each core), and one call runs at a time.

Source: oneDNN's C interface, version 3.
"""

import ctypes
import functools
import importlib.metadata
import os
import platform
import threading
from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from jax.experimental.buffer_callback import buffer_callback

from psgn_jax.types import Array

DISTRIBUTION = "onednn-cpu-gomp"
"""Name of the Python package that contains the library."""
_FILE = "libdnnl.so.3"

# Constants of oneDNN's header files.
_CPU, _IN_ORDER, _ANY_LAYOUT, _DIRECT, _FORWARD_TRAINING = 1, 1, 1, 1, 64
_USER_SCRATCHPAD = 1
_IMPLEMENTATION, _WEIGHTS_DESC, _DIFF_WEIGHTS_DESC, _SCRATCHPAD_DESC = 8, 131, 132, 136
_SRC, _DST, _WEIGHTS, _SCRATCHPAD, _DIFF_SRC, _DIFF_DST, _DIFF_WEIGHTS = (
    1,
    17,
    33,
    80,
    129,
    145,
    161,
)
_DTYPES = {"float32": 3, "bfloat16": 2}
_ALIGNMENT = 64

_lock = threading.Lock()


class OneDNNError(RuntimeError):
    """A call of oneDNN has failed."""


class Convolution(NamedTuple):
    """Shapes and geometry of a convolution.

    Attributes:
      x: shape of the images, [b, h, w, c_in].
      kernel: shape of the kernel, [kh, kw, c_in, c_out].
      y: shape of the result, [b, ho, wo, c_out].
      stride: step in both directions.
      padding: ((top, bottom), (left, right)).
      dtype: name of the dtype of all arrays.
    """

    x: tuple[int, ...]
    kernel: tuple[int, ...]
    y: tuple[int, ...]
    stride: int
    padding: tuple[tuple[int, int], tuple[int, int]]
    dtype: str


_Part = Literal["forward", "input_gradient", "kernel_gradient"]


class _Argument(ctypes.Structure):
    _fields_ = (("kind", ctypes.c_int), ("memory", ctypes.c_void_p))


@functools.cache
def library() -> Any:
    """The loaded library, or None if there is none for this machine."""
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        return None
    # Otherwise OpenMP's threads keep the cores busy for some time after each call.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    for path in (*_installed(), _FILE):
        try:
            loaded = ctypes.CDLL(path)
        except OSError:
            continue
        if hasattr(loaded, "dnnl_primitive_desc_query_md"):  # since version 3
            loaded.dnnl_primitive_desc_query_md.restype = ctypes.c_void_p
            loaded.dnnl_memory_desc_get_size.restype = ctypes.c_size_t
            return loaded
    return None


def _installed() -> Iterator[str]:
    """Path of the library of the Python package."""
    try:
        files = importlib.metadata.files(DISTRIBUTION) or []
    except importlib.metadata.PackageNotFoundError:
        return
    yield from (str(file.locate()) for file in files if file.name == _FILE)


def forward(x: Array, kernel: Array, convolution: Convolution) -> Array | None:
    """y, or None if oneDNN has no fast routine for this convolution."""
    return _apply("forward", convolution, convolution.y, x, kernel)


def input_gradient(dy: Array, kernel: Array, convolution: Convolution) -> Array | None:
    """The adjoint with respect to x, or None if oneDNN has no fast routine for it."""
    return _apply("input_gradient", convolution, convolution.x, dy, kernel)


def kernel_gradient(x: Array, dy: Array, convolution: Convolution) -> Array | None:
    """The adjoint with respect to the kernel, or None if oneDNN has no fast routine for it."""
    return _apply("kernel_gradient", convolution, convolution.kernel, x, dy)


def _apply(
    part: _Part, convolution: Convolution, shape: tuple[int, ...], *args: Array
) -> Array | None:
    primitive = _primitive(part, convolution)
    if primitive is None:
        return None

    def run(_: Any, result: Any, first: Any, second: Any) -> None:
        primitive.run(_address(first), _address(second), _address(result))

    result = jax.ShapeDtypeStruct(shape, args[0].dtype)
    # Under `jax.vmap`, one call for each element of the mapped axis.
    return buffer_callback(run, result, vmap_method="sequential")(*args)


def _address(buffer: Any) -> int:
    return int(np.asarray(buffer).__array_interface__["data"][0])


@functools.cache
def _primitive(part: _Part, convolution: Convolution) -> "_Primitive | None":
    if library() is None or convolution.dtype not in _DTYPES:
        return None
    b, h, w, _ = convolution.x
    kh, kw = convolution.kernel[:2]
    (top, bottom), (left, right) = convolution.padding
    # Negative padding leaves out the last pixels, which oneDNN does without being told.
    bottom, right = max(0, bottom), max(0, right)
    sizes = [
        (n + low + high - k) // convolution.stride + 1
        for n, low, high, k in ((h, top, bottom, kh), (w, left, right, kw))
    ]
    if min(top, left) < 0 or (b, *sizes) != convolution.y[:3] or 0 in convolution.x:
        return None
    padding = ((top, bottom), (left, right))
    try:
        primitive = _Primitive(part, convolution._replace(padding=padding))
    except OneDNNError:
        return None
    return None if primitive.implementation.startswith("ref") else primitive


def _check(status: int, call: str) -> None:
    if status:
        raise OneDNNError(f"oneDNN: {call} returned status {status}")


def _call(name: str, *args: Any) -> None:
    _check(getattr(library(), name)(*args), name)


def _make(name: str, *args: Any) -> ctypes.c_void_p:
    """Calls a function that stores a new object in its first argument."""
    handle = ctypes.c_void_p()
    _call(name, ctypes.byref(handle), *args)
    return handle


def _query(desc: ctypes.c_void_p, what: int) -> ctypes.c_void_p:
    """A memory descriptor of a primitive."""
    return ctypes.c_void_p(library().dnnl_primitive_desc_query_md(desc, what, 0))


def _size(desc: ctypes.c_void_p) -> int:
    return int(library().dnnl_memory_desc_get_size(desc))


def _dims(values: Sequence[int]) -> Any:
    return (ctypes.c_int64 * 12)(*values)


@functools.cache
def _engine() -> tuple[ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]:
    """Engine, stream and attributes, which all primitives share."""
    engine = _make("dnnl_engine_create", _CPU, ctypes.c_size_t(0))
    stream = _make("dnnl_stream_create", engine, _IN_ORDER)
    attributes = _make("dnnl_primitive_attr_create")
    _call("dnnl_primitive_attr_set_scratchpad_mode", attributes, _USER_SCRATCHPAD)
    return engine, stream, attributes


def _images(shape: tuple[int, ...], dtype: int) -> ctypes.c_void_p:
    b, h, w, c = shape
    strides = _dims((h * w * c, 1, w * c, c))
    return _make("dnnl_memory_desc_create_with_strides", 4, _dims((b, c, h, w)), dtype, strides)


def _kernel(shape: tuple[int, ...], dtype: int, any_layout: bool) -> ctypes.c_void_p:
    kh, kw, c_in, c_out = shape
    dims = _dims((c_out, c_in, kh, kw))
    if any_layout:
        return _make("dnnl_memory_desc_create_with_tag", 4, dims, dtype, _ANY_LAYOUT)
    strides = _dims((1, c_out, kw * c_in * c_out, c_in * c_out))
    return _make("dnnl_memory_desc_create_with_strides", 4, dims, dtype, strides)


def _memory(desc: ctypes.c_void_p) -> ctypes.c_void_p:
    """A memory object without memory."""
    return _make("dnnl_memory_create", desc, _engine()[0], ctypes.c_void_p())


class _Workspace:
    """Temporary memory, one block for each purpose, which grows to the largest size asked for."""

    def __init__(self) -> None:
        self._blocks: dict[str, Any] = {}

    def address(self, purpose: str, size: int) -> int:
        block = self._blocks.get(purpose)
        if block is None or len(block) < size + _ALIGNMENT:
            block = self._blocks[purpose] = np.empty(size + _ALIGNMENT, np.uint8)
        return -(-_address(block) // _ALIGNMENT) * _ALIGNMENT


_workspace = _Workspace()


class _Step:
    """A primitive and its arguments."""

    def __init__(self, desc: ctypes.c_void_p, arguments: dict[int, ctypes.c_void_p]):
        self._primitive = _make("dnnl_primitive_create", desc)
        scratchpad = _query(desc, _SCRATCHPAD_DESC)
        self._scratchpad, self._size = _memory(scratchpad), _size(scratchpad)
        pairs = [*arguments.items(), (_SCRATCHPAD, self._scratchpad)]
        self._arguments = (_Argument * len(pairs))(*(_Argument(*pair) for pair in pairs))

    def run(self) -> None:
        _place(self._scratchpad, _workspace.address("scratchpad", self._size))
        stream, arguments = _engine()[1], self._arguments
        _call("dnnl_primitive_execute", self._primitive, stream, len(arguments), arguments)


def _place(memory: ctypes.c_void_p, address: int) -> None:
    _call("dnnl_memory_set_data_handle", memory, ctypes.c_void_p(address))


class _Primitive:
    """One part of a convolution, and the conversion between the two layouts of the kernel."""

    def __init__(self, part: _Part, convolution: Convolution):
        engine, _, attributes = _engine()
        dtype = _DTYPES[convolution.dtype]
        x, y = _images(convolution.x, dtype), _images(convolution.y, dtype)
        ours = _kernel(convolution.kernel, dtype, any_layout=False)
        kernel = _kernel(convolution.kernel, dtype, any_layout=True)
        stride, dilation = _dims((convolution.stride,) * 2), _dims((0, 0))
        low, high = (_dims(side) for side in zip(*convolution.padding, strict=True))
        geometry = (stride, dilation, low, high)
        name = "dnnl_convolution_{}_primitive_desc_create"
        desc = hint = _make(
            name.format("forward"), engine, _FORWARD_TRAINING, _DIRECT, x, kernel, None, y,
            *geometry, attributes,
        )  # fmt: skip
        if part == "input_gradient":
            desc = _make(
                name.format("backward_data"), engine, _DIRECT, x, kernel, y,
                *geometry, hint, attributes,
            )  # fmt: skip
        elif part == "kernel_gradient":
            desc = _make(
                name.format("backward_weights"), engine, _DIRECT, x, kernel, None, y,
                *geometry, hint, attributes,
            )  # fmt: skip
        text = ctypes.c_char_p()
        _call("dnnl_primitive_desc_query", desc, _IMPLEMENTATION, 0, ctypes.byref(text))
        self.implementation = (text.value or b"").decode()

        backward = part == "kernel_gradient"
        theirs = _query(desc, _DIFF_WEIGHTS_DESC if backward else _WEIGHTS_DESC)
        images, result, weights = _memory(x), _memory(y), _memory(ours)
        self._converted: tuple[ctypes.c_void_p, int] | None = None
        inner, conversion = weights, []
        if not library().dnnl_memory_desc_equal(theirs, ours):
            inner = _memory(theirs)
            self._converted = inner, _size(theirs)
            (source, start), (target, end) = (ours, weights), (theirs, inner)
            if backward:
                (source, start), (target, end) = (target, end), (source, start)
            create = "dnnl_reorder_primitive_desc_create"
            reorder = _make(create, source, engine, target, engine, attributes)
            conversion = [_Step(reorder, {_SRC: start, _DST: end})]
        if part == "forward":
            step = _Step(desc, {_SRC: images, _WEIGHTS: inner, _DST: result})
            self._outer = (images, weights, result)
        elif part == "input_gradient":
            step = _Step(desc, {_DIFF_DST: result, _WEIGHTS: inner, _DIFF_SRC: images})
            self._outer = (result, weights, images)
        else:
            step = _Step(desc, {_SRC: images, _DIFF_DST: result, _DIFF_WEIGHTS: inner})
            self._outer = (images, result, weights)
        self._steps = [step, *conversion] if backward else [*conversion, step]

    def run(self, *addresses: int) -> None:
        """Computes the result from two arguments; all three are given by their addresses."""
        with _lock:
            for memory, address in zip(self._outer, addresses, strict=True):
                _place(memory, address)
            if self._converted is not None:
                memory, size = self._converted
                _place(memory, _workspace.address("kernel", size))
            for step in self._steps:
                step.run()
