"""Mitsuba, as this process has started it: the only importer of Mitsuba.

A process calls `start` once, which fixes the variant: `llvm_ad_rgb` is the fast one, `scalar_rgb`
needs no LLVM. `mi` and `dr` are then the packages mitsuba and drjit.
"""

import contextlib
import os
from typing import Any

VARIANTS = ("llvm_ad_rgb", "scalar_rgb")

mi: Any = None

dr: Any = None


def start(variant: str, libllvm: str = "", *, shrink_threads: bool = True) -> None:
    """Loads Mitsuba in one variant, with one thread; once in a process.

    Args:
      variant: one of `VARIANTS`.
      libllvm: path of the LLVM library; "" = Mitsuba looks for one.
      shrink_threads: one thread alone; not for `load_map`.

    Raises:
      ValueError: an unknown variant.
      RuntimeError: another variant was started before.
    """
    global mi, dr
    if variant not in VARIANTS:
        raise ValueError(f"variant {variant!r}: expected one of {list(VARIANTS)}")
    if mi is not None:
        if mi.variant() != variant:
            raise RuntimeError(f"Mitsuba runs as {mi.variant()} in this process already")
        return
    if libllvm:
        os.environ["DRJIT_LIBLLVM_PATH"] = libllvm
    import drjit
    import mitsuba

    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    if shrink_threads and not variant.startswith("scalar"):
        drjit.set_thread_count(1)
    mi, dr = mitsuba, drjit


def release() -> None:
    """Frees what earlier scenes have left behind."""
    if dr is not None and not mi.variant().startswith("scalar"):
        with contextlib.suppress(Exception):
            dr.flush_malloc_cache()
