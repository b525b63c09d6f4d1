"""Common parts of the commands: logging, one-line errors, flags, and the compilation cache."""

import contextlib
import logging as python_logging
import os
import pathlib
import platform
import sys
import zlib
from collections.abc import Iterator, Sequence

from absl import flags, logging

from psgn_jax.config.experiment import Config, ConfigError
from psgn_jax.config.structured import unknown_setting
from psgn_jax.system import processes
from psgn_jax.system.cores import features_line
from psgn_jax.system.files import cache_folder, exit_code_of
from psgn_jax.system.untrusted import message_line, one_line

# The processes that multiprocessing and other libraries start inherit it.
os.environ.update(processes.environment())


def log_to_terminal() -> None:
    """Logs to stderr: all messages of this package and `data_gen`, warnings of other packages."""
    logging.use_absl_handler()
    if not flags.FLAGS.is_parsed():  # in a notebook, where absl would otherwise warn
        flags.FLAGS.mark_as_parsed()
    logging.set_verbosity(logging.INFO)
    logging.set_stderrthreshold(logging.INFO)
    handler = logging.get_absl_handler()
    handler.setFormatter(_OneLine("%(asctime)s %(message)s", "%H:%M:%S"))
    package = pathlib.Path(__file__).resolve().parents[1]
    own = (f"{package}{os.sep}", f"{package.parent / 'data_gen'}{os.sep}")
    handler.addFilter(
        lambda r: (
            r.levelno >= python_logging.WARNING or os.path.realpath(r.pathname).startswith(own)
        )
    )


class _OneLine(python_logging.Formatter):
    """Escapes control characters in messages; tracebacks keep their lines."""

    def formatMessage(self, record: python_logging.LogRecord) -> str:  # noqa: N802
        """The text of a record."""
        record.message = one_line(record.message)
        return super().formatMessage(record)


@contextlib.contextmanager
def exit_on_user_error() -> Iterator[None]:
    """Turns errors that the user can fix, and Ctrl-C, into one line on stderr and an exit code."""
    try:
        yield
    except Exception as error:
        exit_code = exit_code_of(error)
        if exit_code is None:
            raise
        sys.stderr.write(f"error: {message_line(error)}\n")
        sys.exit(exit_code)
    except KeyboardInterrupt:
        sys.stderr.write("stopped by Ctrl-C\n")
        sys.exit(130)  # as in shells


@contextlib.contextmanager
def flags_only(argv: Sequence[str]) -> Iterator[flags.FlagValues]:
    """Context of a command that takes only flags: logging, and `exit_on_user_error`."""
    log_to_terminal()
    with exit_on_user_error():
        if len(argv) > 1:
            raise ConfigError(f"unexpected argument {argv[1]!r}; expected only flags")
        yield flags.FLAGS


def define_network_flags() -> None:
    """Defines --workdir, --weights and --checkpoint, for `weights.opening.open_network`."""
    flags.DEFINE_string("workdir", None, "Folder of a run, instead of weights.")
    flags.DEFINE_string("weights", None, "Name or file of weights; default: those of the package.")
    flags.DEFINE_enum("checkpoint", "best", ["best", "last"], "Checkpoint of the run.")


def define_group_flags() -> None:
    """Defines --coordinator, --num_processes and --process_id, for `system.group.joined`."""
    flags.DEFINE_string("coordinator", None, "HOST:PORT of the first of several processes.")
    flags.DEFINE_integer("num_processes", None, "Number of processes that share the work.")
    flags.DEFINE_integer("process_id", None, "Index of this process, from 0.")


def parse_flags(argv: list[str]) -> list[str]:
    """Parses flags like absl, but ends the process with one line if a flag is wrong.

    Use it as `app.run(..., flags_parser=parse_flags)`.
    """
    with exit_on_user_error():
        try:
            return flags.FLAGS(argv)
        except (AttributeError, KeyError) as error:
            raise unknown_setting(argv, Config()) from error
        except (flags.Error, TypeError, ValueError, OSError) as error:
            raise ConfigError(str(error)) from error


def keep_compiled() -> None:
    """Enables JAX's persistent compilation cache in the cache folder.

    Call it before JAX compiles anything. JAX_COMPILATION_CACHE_DIR names another folder.

    The cache has one folder per type of processor, because a program that was compiled for one may
    not run on another. When XLA loads a cached program on a CPU, it wrongly warns, in 3,000
    characters, that the processor lacks two features. These are tuning flags of XLA, not features
    of a processor. Therefore `psgn_jax.commands` sets TF_CPP_MIN_LOG_LEVEL to 3, unless it is set
    already: native code then logs only fatal errors.
    """
    import jax  # imported here so that wrong flags are reported before JAX is loaded

    if jax.config.values["jax_compilation_cache_dir"]:
        return
    features = features_line() or platform.processor()
    kind = f"{platform.machine()}-{zlib.crc32(features.encode()):08x}"
    folder = cache_folder() / "compiled" / kind
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
