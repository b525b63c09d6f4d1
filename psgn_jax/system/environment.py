"""Turns the errors of wrong environment variables into one line that names the variable.

JAX and XLA report wrong values when they are imported or at the first computation; for some, XLA
ends the process.
"""

import functools
import os
import re
import subprocess
import sys

from psgn_jax.system.errors import UserError
from psgn_jax.system.untrusted import brief

CONVOLUTIONS = "PSGN_CONVOLUTIONS"
# Beginnings of variable names.
_PLATFORMS = "JAX_PLATFORM", "JAX_NUM_CPU_DEVICES"
_GUARDS = ("JAX_TRANSFER_GUARD",)
_FINITE = "JAX_DEBUG_NANS", "JAX_DEBUG_INFS"
# XLA reads its flags when the first options are made; this takes .1 s of CPU time.
_READ_FLAGS = "from jaxlib import _jax; _jax.CompileOptions().executable_build_options"


def check_environment() -> None:
    """Raises `UserError` for values that would be found late or would end the process."""
    if (asked := os.environ.get(CONVOLUTIONS, "")) not in ("", "onednn", "xla"):
        raise UserError(f"{CONVOLUTIONS}={asked}: accepted: onednn, xla, or unset")
    if given := os.environ.get("XLA_FLAGS", ""):
        _check_xla_flags(given)


def explained(error: BaseException) -> UserError | None:
    """A one-line error if an environment variable caused `error`, or None."""
    if isinstance(error, RuntimeError | AssertionError):
        unstarted = _without_devices(_given(_PLATFORMS))
        if unstarted is not None:
            return unstarted
    text = brief(error)
    for mentioned in re.findall(r"\bjax[._]\w+", text, re.IGNORECASE):
        if (name := mentioned.upper().replace(".", "_")) in os.environ:
            return _wrong(name, text)
    if re.search(r"Disallowed \S+ transfer", text) and (given := _given(_GUARDS)):
        return _wrong(given[0], text)
    if isinstance(error, FloatingPointError) and (given := _given(_FINITE)):
        return _wrong(given[0], text)
    return None


def _given(begins: tuple[str, ...]) -> list[str]:
    return sorted(name for name, value in os.environ.items() if value and name.startswith(begins))


def _wrong(name: str, why: str) -> UserError:
    return UserError(f"{name}={os.environ[name]}: {why}; unset {name}, or change it")


def _without_devices(given: list[str]) -> UserError | None:
    """The error if JAX cannot start the platforms that the variables select, or None."""
    if not given or "jax" not in sys.modules:
        return None
    import jax

    try:
        jax.devices()
    except (RuntimeError, AssertionError) as error:
        shown = " ".join(f"{name}={os.environ[name]}" for name in given)
        # Without JAX's advice. If the CUDA plugin is missing, the message is empty.
        why = re.sub(r" \((set|you may).*", "", brief(error)) or "there is no such device"
        return UserError(f"{shown}: JAX cannot start ({why}); unset {' and '.join(given)}")
    return None


@functools.cache
def _check_xla_flags(given: str) -> None:
    """Tests XLA_FLAGS in a child process, because XLA ends a process with wrong flags."""
    command = [sys.executable, "-P", "-c", _READ_FLAGS]
    found = subprocess.run(command, capture_output=True, text=True, errors="replace")
    first, *_ = found.stderr.splitlines() or [""]
    if found.returncode and "parse_flags_from_env" in first:
        why = brief(first.partition("] ")[2])
        raise UserError(f"XLA_FLAGS={given[:80]}: {why}; unset XLA_FLAGS, or change it")
