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

XLA calls the library through a Python callback, which passes pointers and copies no images. For
this reason, JAX keeps programs with these functions neither in its compilation cache nor in
exported files. oneDNN uses its own layout for kernels; rearranging them is part of the time of a
call. Each call uses all threads of oneDNN (`OMP_NUM_THREADS`, by default one for each core), and
one call runs at a time. OpenMP starts a team of threads for each thread of XLA that calls it; this
was measured on two cores only. Primitives are kept for the life of the process.

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
_UNSUPPORTED = (2, 3)  # statuses: invalid arguments, unimplemented
_RUNTIMES = (1, 2, 4)  # one thread, OpenMP, TBB
_DTYPES = {"float32": 3, "bfloat16": 2}
_ALIGNMENT = 64

# Iterations that OpenMP's threads wait for the next call before they sleep. Without this limit they
# keep the cores busy for milliseconds; threads that sleep at once start late.
_SPINS = "10000"

_making = threading.RLock()
_running = threading.Lock()


class OneDNNError(RuntimeError):
    """A call of oneDNN has failed."""

    def __init__(self, call: str, status: int):
        super().__init__(f"oneDNN: {call} returned status {status}")
        self.status = status


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


class _Version(ctypes.Structure):
    _fields_ = (
        ("major", ctypes.c_int),
        ("minor", ctypes.c_int),
        ("patch", ctypes.c_int),
        ("commit", ctypes.c_char_p),
        ("cpu_runtime", ctypes.c_uint),
        ("gpu_runtime", ctypes.c_uint),
    )


def library() -> Any:
    """The loaded library, or None if there is none for this machine.

    Sets `GOMP_SPINCOUNT` for this process and its children before it loads the library, unless
    `GOMP_SPINCOUNT` or `OMP_WAIT_POLICY` is set.
    """
    return _load()[0]


def why_not() -> str:
    """Why `library` is None; empty if it is not."""
    return _load()[1]


@functools.cache
def _load() -> tuple[Any, str]:
    """The library, and why there is none."""
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        return None, "it is used on Linux x86-64 only"
    paths = list(_installed())
    if paths and "OMP_WAIT_POLICY" not in os.environ:
        os.environ.setdefault("GOMP_SPINCOUNT", _SPINS)
    reason = "the package is not installed; install it by pip install 'psgn-jax[onednn]'"
    for path in (*paths, _FILE):
        try:
            loaded = ctypes.CDLL(path)
            loaded.dnnl_version.restype = ctypes.POINTER(_Version)
            version = loaded.dnnl_version().contents
        except (OSError, AttributeError) as error:  # AttributeError: not oneDNN
            reason = str(error) if path in paths else reason
            continue
        if version.major != 3 or version.cpu_runtime not in _RUNTIMES:
            reason = f"{path}: expected version 3 with threads of OpenMP or TBB"
            continue
        loaded.dnnl_primitive_desc_query_md.restype = ctypes.c_void_p
        loaded.dnnl_memory_desc_get_size.restype = ctypes.c_size_t
        return loaded, ""
    return None, reason


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
    if any(a.dtype.name != convolution.dtype for a in args):
        return None
    with _making:
        primitive = _primitive(part, convolution)
    if primitive is None:
        return None
    # The API is experimental, so it is imported only where it is used.
    from jax.experimental.buffer_callback import buffer_callback

    result = jax.ShapeDtypeStruct(shape, args[0].dtype)
    # Under `jax.vmap`, one call for each element of the mapped axis. JAX compares callbacks to find
    # compiled programs; a bound method is equal to itself.
    return buffer_callback(primitive.callback, result, vmap_method="sequential")(*args)


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
    except OneDNNError as error:
        if error.status in _UNSUPPORTED:
            return None
        raise
    return None if primitive.implementation.startswith("ref") else primitive


def _call(name: str, *args: Any) -> None:
    status = getattr(library(), name)(*args)
    if status:
        raise OneDNNError(name, status)


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

    def callback(self, _: Any, result: Any, first: Any, second: Any) -> None:
        """`run` for the buffers that XLA passes."""
        self.run(_address(first), _address(second), _address(result))

    def run(self, *addresses: int) -> None:
        """Computes the result from two arguments; all three are given by their addresses."""
        with _running:
            for memory, address in zip(self._outer, addresses, strict=True):
                _place(memory, address)
            if self._converted is not None:
                memory, size = self._converted
                _place(memory, _workspace.address("kernel", size))
            for step in self._steps:
                step.run()
            _call("dnnl_stream_wait", _engine()[1])
