"""Imports Mitsuba (no other module does), in a variant that works on this machine.

A process calls `start` once with a variant: `llvm_ad_rgb` is fast, `scalar_rgb` works without LLVM.
Then `mi` and `dr` are the packages mitsuba and drjit. Loading LLVM may abort the process, so
`choose_variant` tests it in separate processes, `python -m data_gen.engine VARIANT`.
"""

import contextlib
import functools
import importlib.metadata
import importlib.util
import os
import pathlib
import re
import subprocess
import sys
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from psgn_jax.system import processes

mi: Any = None
dr: Any = None

# Versions of LLVM, best first. Dr.Jit refuses 14; 15 and 16 abort the process.
_LLVM_VERSIONS = (19, 20, 18, 17, 21, 22)

_LLVM_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib",
    "/usr/lib/llvm-*/lib", "/usr/local/lib", "/opt/homebrew/opt/llvm*/lib",
    "/usr/local/opt/llvm*/lib",
)  # fmt: skip

NO_LLVM = (
    "no usable LLVM library: rendering in scalar mode, two to five times slower. Run "
    "`pip install 'psgn-jax[render]'` (Linux on x86-64), `apt-get install libllvm19` (Debian, "
    "Ubuntu) or `brew install llvm@19` (macOS), or set the variable DRJIT_LIBLLVM_PATH to the path "
    "of a library"
)


class Variant(NamedTuple):
    """A variant of Mitsuba: its name, and the path of the LLVM library or ""."""

    name: str
    libllvm: str = ""

    def environment(self) -> dict[str, str]:
        return processes.environment(DRJIT_LIBLLVM_PATH=self.libllvm)


def start(variant: str, *, shrink_threads: bool = True) -> None:
    """Loads a variant of Mitsuba with the LLVM of DRJIT_LIBLLVM_PATH, once per process.

    `shrink_threads`: use a single thread. Reading environment maps needs more.
    """
    global mi, dr
    if mi is not None:
        if mi.variant() != variant:
            raise RuntimeError(f"Mitsuba was started as {mi.variant()}, expected {variant}")
        return
    import drjit
    import mitsuba

    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    if shrink_threads and not variant.startswith("scalar"):
        drjit.set_thread_count(1)
    mi, dr = mitsuba, drjit


def mesh(
    corners: np.ndarray,
    uv: np.ndarray,
    normals: np.ndarray | None = None,
    bsdf: Mapping[str, Any] | None = None,
) -> Any:
    """A mesh of Mitsuba from values of face corners: [f, 3, 3], [f, 3, 2] and [f, 3, 3]."""
    count, properties = 3 * len(corners), mi.Properties()
    if bsdf is not None:
        properties["mesh_bsdf"] = mi.load_dict(bsdf)
    result = mi.Mesh("mesh", count, len(corners), has_vertex_normals=normals is not None,
                     has_vertex_texcoords=True, props=properties)  # fmt: skip
    values = mi.traverse(result)
    given = {"vertex_positions": corners, "vertex_normals": normals, "vertex_texcoords": uv}
    for name, of_corners in given.items():
        if of_corners is not None:
            values[name] = np.ascontiguousarray(of_corners, np.float32).ravel()
    values["faces"] = np.arange(count, dtype=np.uint32)
    values.update()
    return result


def release() -> None:
    """Frees the memory of earlier scenes."""
    if dr is not None and not mi.variant().startswith("scalar"):
        with contextlib.suppress(Exception):
            dr.flush_malloc_cache()


def has_mitsuba() -> bool:
    """Whether Mitsuba is installed; we do not import it."""
    return importlib.util.find_spec("mitsuba") is not None


def llvm_candidates() -> list[str]:
    """Suitable LLVM libraries, best first: of the wheel, then of this machine."""
    named = list(filter(None, [os.environ.get("DRJIT_LIBLLVM_PATH")]))
    paths = _llvm_of_wheel()
    for folder in _LLVM_FOLDERS:
        paths += sorted(pathlib.Path("/").glob(f"{folder[1:]}/libLLVM*"))
    libraries: dict[int, str] = {}
    for path in paths:
        match = re.fullmatch(
            r"libLLVM(?:-(\d+)(?:\.\d+)*)?(?:\.so(?:\.(\d+)(?:\.\d+)*)?|\.dylib)", path.name
        )
        version = int((match and (match[1] or match[2])) or 0)
        if version in _LLVM_VERSIONS:
            libraries.setdefault(version, str(path))
    return named + [libraries[v] for v in _LLVM_VERSIONS if v in libraries]


def _llvm_of_wheel() -> list[pathlib.Path]:
    """The libraries of karellen-llvm-core; pip puts them in the environment's `lib` folder."""
    try:
        files = importlib.metadata.files("karellen-llvm-core") or []
    except importlib.metadata.PackageNotFoundError:
        return []
    found = [file.locate() for file in files if file.name.startswith("libLLVM.so.")]
    return [pathlib.Path(str(path)).resolve() for path in found]


@functools.cache
def _smoke(variant: Variant) -> bool:
    """Whether a separate process renders with this variant."""
    try:
        done = subprocess.run(
            processes.python("data_gen.engine", variant.name), env=variant.environment(),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=180, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def choose_variant(wanted: str = "auto") -> tuple[Variant, str]:
    """The "llvm" or "scalar" variant, "auto" = LLVM if it works; and a message or "".

    Raises:
      RuntimeError: Mitsuba is not installed or does not run, or "llvm" does not work.
    """
    if not has_mitsuba():
        raise RuntimeError("Mitsuba is not installed: `pip install 'psgn-jax[render]'`")
    if wanted != "scalar":
        for library in llvm_candidates():
            variant = Variant("llvm_ad_rgb", library)
            if _smoke(variant):
                return variant, ""
        if wanted == "llvm":
            raise RuntimeError(f"job.variant 'llvm': {NO_LLVM}")
    if not _smoke(Variant("scalar_rgb")):
        raise RuntimeError("Mitsuba does not run: `python -m data_gen.engine scalar_rgb` shows why")
    return Variant("scalar_rgb"), "" if wanted == "scalar" else NO_LLVM


if __name__ == "__main__":  # the process of `_smoke`
    start(sys.argv[1])
    _triangle = np.array([[[-1, -1, 0], [1, -1, 0], [0, 1, 0]]])
    _scene = mi.load_dict({"type": "scene", "triangle": mesh(_triangle, _triangle[..., :2])})
    _hit = _scene.ray_intersect(mi.Ray3f(mi.Point3f(0, 0, 2), mi.Vector3f(0, 0, -1)))
    _distance = np.array(_hit.t, np.float64).item()
    if abs(_distance - 2) > 1e-5:
        raise SystemExit(f"wrong distance: {_distance}, expected 2")
