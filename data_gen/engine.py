"""The only module that imports Mitsuba.

A process calls `start` once with a variant: `llvm_ad_rgb` is fast, `scalar_rgb` works without LLVM.
After that, `mi` and `dr` are the packages mitsuba and drjit.
"""

import contextlib
import os
from typing import Any

VARIANTS = ("llvm_ad_rgb", "scalar_rgb")

mi: Any = None

dr: Any = None


def start(variant: str, libllvm: str = "", *, shrink_threads: bool = True) -> None:
    """Loads Mitsuba in one variant. Further calls have no effect.

    Args:
      variant: one of `VARIANTS`.
      libllvm: path of the LLVM library; "" = Mitsuba searches for one.
      shrink_threads: whether to use only one thread; False is needed for `load_map`.

    Raises:
      ValueError: an unknown variant.
      RuntimeError: this process has started another variant.
    """
    global mi, dr
    if variant not in VARIANTS:
        raise ValueError(f"variant {variant!r}: expected one of {list(VARIANTS)}")
    if mi is not None:
        if mi.variant() != variant:
            raise RuntimeError(f"Mitsuba was started as {mi.variant()}, expected {variant}")
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
    """Frees the memory of earlier scenes."""
    if dr is not None and not mi.variant().startswith("scalar"):
        with contextlib.suppress(Exception):
            dr.flush_malloc_cache()
