"""Meshes to training data.

    python data_gen/render.py --catalogue NAME --source PATH --out RECORDS

NAME is one of procedural, folder, shapenet, sh3f, ac3d; PATH is what the catalogue reads. RECORDS
becomes a data set of `psgn_jax.data.records` that training reads, with `models.jsonl` beside it: a
line for each model with its status, reason, checks and times.

Any setting is a flag: `--config.views=8 --config.camera.elevation='(0., 40.)'`; see
`data_gen/settings.py` for all of them. Killed and started again, the command goes on where it was;
the records that it ends with are the same, byte for byte, for any number of workers, kills or
parts. `--shard=i/n` does the i-th of n parts of the work (i from 0), for job arrays on a common
folder; whoever is last completes the data set. `--scheduler=tcp://host:8786` hands the models to
the workers of a Dask cluster, see `data_gen/cluster.py` for what they need; the rest is the same.

Exit codes: 0 done, all models have samples; 1 done, some models were refused (normal for
collections); 2 wrong arguments, or nothing came of it; 3 done with this part, others are not;
143 and 130 stopped by SIGTERM or Ctrl-C.

Models are known by their names: where a mesh's file has changed under the same name, what was made
of it before stays; give another folder for the output then.
"""

import functools
import pathlib
import signal
import sys
from typing import Any

if __package__ in (None, ""):  # run as a file: the folder above is where `data_gen` is
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[1])

from absl import app, flags, logging
from ml_collections import config_flags

from data_gen import catalogues, cluster, job, pool, settings


class StoppedError(Exception):
    """A signal asked for the end."""

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by signal {number}")
        self.number = number


_CATALOGUE = flags.DEFINE_enum(
    "catalogue", None, sorted(catalogues.CATALOGUES), "Where the models come from."
)
_SOURCE = flags.DEFINE_string(
    "source", None, "What the catalogue reads: a folder, a file, or numbers of models."
)
_OUT = flags.DEFINE_string("out", None, "Folder of the data set.")
_PART = flags.DEFINE_string(
    "shard", "0/1", "i/n: this process does the i-th of n parts, i from 0, for job arrays."
)
_LIMIT = flags.DEFINE_integer(
    "limit", 0, "The first models of the catalogue alone; 0 = all.", lower_bound=0
)
_OPTION = flags.DEFINE_multi_string(
    "option", [], "NAME=VALUE for the catalogue, such as up=+z or max_faces=200000; repeatable."
)
_SCHEDULER = flags.DEFINE_string(
    "scheduler", "", "Address of a Dask scheduler; its workers render. Empty: this machine does."
)
_CONFIG = config_flags.DEFINE_config_file("config", None, "Settings.", lock_config=True)
_DEFAULT = pathlib.Path(__file__).with_name("config.py")


def parse_part(text: str) -> tuple[int, int]:
    """`i/n` as numbers.

    Raises:
      ValueError: it is no such part.
    """
    first, slash, second = text.partition("/")
    if not (slash and first.isdecimal() and second.isdecimal()) or not int(first) < int(second):
        raise ValueError(f"--shard: got {text!r}, expected i/n with i from 0 to n - 1")
    return int(first), int(second)


def _stop(number: int, frame: Any) -> None:
    raise StoppedError(number)


def _parse_flags(argv: list[str]) -> list[str]:
    """As absl does, but whatever is wrong ends in one line and exit code 2."""
    if not any(a.split("=")[0].lstrip("-") == "config" for a in argv[1:]):
        # Not as the flag's default: what is wrong with a setting would show at the import.
        argv = [argv[0], f"--config={_DEFAULT}", *argv[1:]]
    try:
        return flags.FLAGS(argv)
    except (AttributeError, KeyError) as error:  # no such setting
        text = " ".join(str(error.args[0]).replace("\\n", " ").replace("\\", "").split())
        sys.stderr.write(f"error: --config: no such setting: {text.strip(chr(39))}\n")
    except (flags.Error, TypeError, ValueError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
    sys.exit(2)


def main(argv: list[str]) -> None:
    """The command; exits with the code that tells what came of it."""
    logging.set_verbosity(logging.INFO)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _stop)
    try:
        if len(argv) > 1:
            raise ValueError(f"unexpected argument {argv[1]!r}")
        name, place, out = _CATALOGUE.value, _SOURCE.value, _OUT.value
        if name is None or place is None or out is None:
            raise ValueError("--catalogue, --source and --out are needed")
        options = settings.parse(_CONFIG.value)
        part = parse_part(_PART.value)
        try:
            source = catalogues.open(name, place, **catalogues.parse_options(name, _OPTION.value))
        except TypeError as error:
            raise ValueError(f"--option: {error}") from error
        render = pool.render_local
        if _SCHEDULER.value:
            render = functools.partial(cluster.render_on, _SCHEDULER.value)
        summary = job.render_catalogue(
            source, out, options, part=part, limit=_LIMIT.value, render=render
        )
    except StoppedError as error:
        logging.warning("%s; the same command goes on with the job", error)
        sys.exit(128 + error.number)
    except (ValueError, RuntimeError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)
    sys.stdout.write(summary.text() + "\n")
    sys.exit(summary.exit_code)


if __name__ == "__main__":
    flags.mark_flags_as_required(["catalogue", "source", "out"])
    app.run(main, flags_parser=_parse_flags)
