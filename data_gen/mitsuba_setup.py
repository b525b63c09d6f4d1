"""Finds out which variant of Mitsuba works on this machine, by searching for LLVM and testing it.

Mitsuba is imported only in separate processes, because LLVM may abort the process that loads it.

    python -m data_gen.mitsuba_setup smoke [VARIANT [LIBRARY]]

renders a triangle with an LLVM library, or without one in scalar mode. The exit code is 0 if that
works.
"""

import importlib.util
import os
import pathlib
import re
import subprocess
import sys
from typing import NamedTuple

import numpy as np

from data_gen import ROOT, engine
from data_gen.ray_mesh import Mesh

# Versions of LLVM, best first. Dr.Jit refuses 14; 15 and 16 abort the process.
_LLVM_VERSIONS = (19, 20, 18, 17, 21, 22)

_LLVM_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib",
    "/usr/lib/llvm-*/lib", "/usr/local/lib", "/opt/homebrew/opt/llvm*/lib",
    "/usr/local/opt/llvm*/lib",
)  # fmt: skip

NO_LLVM = (
    "no usable LLVM library: rendering in scalar mode, two to five times slower. "
    "Run `apt-get install libllvm19` (Debian, Ubuntu) or `brew install llvm@19` (macOS), or set "
    "the variable DRJIT_LIBLLVM_PATH to the path of a library"
)

NO_MITSUBA = "Mitsuba is not installed: `pip install 'psgn-jax[render]'`"


class Variant(NamedTuple):
    """Name of the variant of Mitsuba, and path of the LLVM library or ""."""

    name: str
    libllvm: str = ""


def has_mitsuba() -> bool:
    """Whether Mitsuba is installed. This does not import it."""
    return importlib.util.find_spec("mitsuba") is not None


def llvm_candidates() -> list[str]:
    """LLVM libraries of this machine with a suitable version, best first."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH", "")
    libraries: dict[int, str] = {}
    for folder in _LLVM_FOLDERS:
        root = pathlib.Path("/")
        for path in sorted(root.glob(f"{folder[1:]}/libLLVM*")):
            match = re.fullmatch(
                r"libLLVM(?:-(\d+)(?:\.\d+)*)?(?:\.so(?:\.(\d+)(?:\.\d+)*)?|\.dylib)", path.name
            )
            version = int((match and (match[1] or match[2])) or 0)
            if version in _LLVM_VERSIONS:
                libraries.setdefault(version, str(path))
    rest = [libraries[v] for v in _LLVM_VERSIONS if v in libraries]
    return [named, *rest] if named else rest


def _smoke(library: str, variant: str) -> bool:
    """Whether a separate process can render with this library."""
    environment = {**os.environ, "DRJIT_LIBLLVM_PATH": library}
    environment["PYTHONPATH"] = os.pathsep.join(
        [str(ROOT), *filter(None, [environment.get("PYTHONPATH")])]
    )
    try:
        done = subprocess.run(
            [sys.executable, "-m", "data_gen.mitsuba_setup", "smoke", variant, library],
            env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            timeout=180, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def choose_variant(wanted: str = "auto") -> tuple[Variant, str]:
    """The variant to render with, tested in a separate process, and a message or "".

    Args:
      wanted: "llvm", "scalar", or "auto" = LLVM if it works.

    Raises:
      RuntimeError: Mitsuba is not installed or does not run, or `wanted` is "llvm" and no LLVM
        library works.
    """
    if not has_mitsuba():
        raise RuntimeError(NO_MITSUBA)
    if wanted != "scalar":
        for library in llvm_candidates():
            if _smoke(library, "llvm_ad_rgb"):
                return Variant("llvm_ad_rgb", library), ""
        if wanted == "llvm":
            raise RuntimeError(f"job.variant 'llvm': {NO_LLVM}")
    if not _smoke("", "scalar_rgb"):
        raise RuntimeError(
            "Mitsuba is installed but does not run: `python -m data_gen.mitsuba_setup smoke "
            "scalar_rgb` shows why"
        )
    return Variant("scalar_rgb"), "" if wanted == "scalar" else NO_LLVM


def _smoke_test(variant: str, library: str) -> None:
    engine.start(variant, library)
    corners = np.array([[[-1, -1, 0], [1, -1, 0], [0, 1, 0]]], np.float32)
    mesh = Mesh(corners)
    down = np.array([[0, 0, -1]], np.float32)
    hits = mesh.cast(np.array([[0, 0, 2], [5, 5, 2]], np.float32), np.repeat(down, 2, axis=0))
    if hits.face.tolist() != [0, -1] or abs(hits.t[0] - 2) > 1e-5:
        raise SystemExit(f"wrong hits: {hits}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["smoke"]:
        _smoke_test(*(sys.argv[2:4] + ["scalar_rgb", ""][len(sys.argv) - 2 :])[:2])
    else:
        sys.exit(__doc__)
