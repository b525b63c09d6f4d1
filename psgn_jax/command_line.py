"""What all commands share: progress on the terminal, errors in one line, flags, kept programs."""

import contextlib
import logging as python_logging
import os
import pathlib
import platform
import re
import sys
import zlib
from collections.abc import Iterator

from absl import flags, logging

from psgn_jax.config import ConfigError
from psgn_jax.files import cache_folder


def log_to_terminal() -> None:
    """Shows the progress of this package and of `data_gen`, of others only warnings, on stderr."""
    logging.use_absl_handler()
    if not flags.FLAGS.is_parsed():  # in a notebook: absl would complain with the first line
        flags.FLAGS.mark_as_parsed()
    logging.set_verbosity(logging.INFO)
    logging.set_stderrthreshold(logging.INFO)
    handler = logging.get_absl_handler()
    handler.setFormatter(python_logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    package = pathlib.Path(__file__).resolve().parent
    own = (f"{package}{os.sep}", f"{package.parent / 'data_gen'}{os.sep}")
    handler.addFilter(
        lambda r: (
            r.levelno >= python_logging.WARNING or os.path.realpath(r.pathname).startswith(own)
        )
    )


@contextlib.contextmanager
def exit_on_user_error() -> Iterator[None]:
    """Ends the process with one line and the error's exit code for what a user can mend.

    Those are the errors that have an `exit_code`: `UserError` and, since the records' code does not
    depend on the configuration's, `RecordError`.
    """
    try:
        yield
    except ValueError as error:
        exit_code = getattr(error, "exit_code", None)
        if exit_code is None:
            raise
        line = " ".join(str(error).split())
        sys.stderr.write(f"error: {line}\n")
        sys.exit(exit_code)


def parse_flags(argv: list[str]) -> list[str]:
    """Parses flags as absl does, but ends with one line whatever is wrong with one.

    For `app.run(..., flags_parser=parse_flags)`.
    """
    with exit_on_user_error():
        try:
            return flags.FLAGS(argv)
        except (AttributeError, KeyError) as error:
            # An unknown field; the message is a repr inside a repr: its quotes and escapes go.
            text = re.sub(r"\\n", " ", str(error.args[0])).translate(str.maketrans("", "", "\\'\""))
            text = " ".join(text.split())
            name = next(iter(re.findall(r"\w+", text)), "")
            given = next((a for a in argv if re.search(rf"\b{name}\b", a)), "--config")
            raise ConfigError(f"{given}: no such field: {text}") from error
        except (flags.Error, TypeError, ValueError, OSError) as error:
            raise ConfigError(str(error)) from error


def keep_compiled() -> None:
    """Lets JAX keep compiled programs in the cache folder: a second start compiles nothing.

    On a CPU they are kept by the kind of processor, as what is compiled for one may not run on
    another that shares the folder. XLA takes two of its own tuning preferences for features that
    the processor lacks, and warns in 3,000 characters for every program it reads back:
    `TF_CPP_MIN_LOG_LEVEL`, unless it is set, leaves only fatal messages of native code. Call it
    before JAX compiles anything. Whoever sets JAX_COMPILATION_CACHE_DIR decides for themselves.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    import jax  # commands answer a wrong flag before JAX is imported

    if jax.config.values["jax_compilation_cache_dir"]:
        return
    folder = cache_folder() / "compiled" / _kind_of_processor()
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


def _kind_of_processor() -> str:
    try:
        text = pathlib.Path("/proc/cpuinfo").read_text()
        features = next(line for line in text.splitlines() if line.startswith(("flags", "Feat")))
    except (OSError, StopIteration):
        features = platform.processor()
    return f"{platform.machine()}-{zlib.crc32(features.encode()):08x}"
