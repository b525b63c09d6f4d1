"""Renders meshes to training data.

    python data_gen/render.py --catalogue NAME --source PATH --out RECORDS

NAME is one of the catalogues below. PATH is the source of this catalogue: a folder, a file, or
numbers of models. The folder RECORDS becomes a data set for training. Its file `models.jsonl` has a
line for each model: status, reason for a refusal, checks and times.

Any setting is a flag: `--config.views=8 --config.camera.elevation='(0., 40.)'`; `--help` lists all
of them, and the options of the catalogues. If the command is killed and started again, it continues
where it stopped. The resulting records are identical, byte for byte, for any number of workers,
restarts or parts. `--shard=i/n` renders the i-th of n parts (i from 0), for job arrays with a
common folder; the part that finishes last completes the data set. `--scheduler=tcp://host:8786`
renders on the workers of a Dask cluster; `data_gen/cluster.py` describes what they need.

`--include` and `--exclude` choose models by patterns of category, folder and name; `--sample=N`
takes N of them, spread over categories and folders. A complete data set can be extended: the same
command with a larger `--limit`, `--sample` or source renders only the new models. Training reads
the old state until the new one is complete.

Exit codes: 0 done, all models have samples; 1 done, some models were refused (normal for
collections); 2 wrong arguments, or no samples; 3 this part is finished, other parts are not;
143 stopped by SIGTERM; 130 stopped by Ctrl-C.

Models are identified by name. If the content of a mesh file changes but its name does not, its old
samples are kept; use a new output folder in that case.
"""

import functools
import inspect
import pathlib
import sys
import textwrap
from collections.abc import Iterator
from typing import Any

if __package__ in (None, ""):  # run as a file: `data_gen` is in the folder above
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[1])

from absl import app, flags, logging
from ml_collections import config_flags

from data_gen import cluster, job, pool, settings
from data_gen.catalogues.by_name import (
    CATALOGUES,
    open_catalogue,
    option_types,
    parse_options,
    variants_of,
)
from data_gen.catalogues.choosing import Choice
from psgn_jax.config import structured
from psgn_jax.system.signals import exit_on_signals
from psgn_jax.system.untrusted import message_line

_CATALOGUE = flags.DEFINE_enum("catalogue", None, sorted(CATALOGUES), "Where the models come from.")
_SOURCE = flags.DEFINE_string(
    "source", None, "Source of the catalogue: a folder, a file, or numbers of models."
)
_OUT = flags.DEFINE_string("out", None, "Folder of the data set.")
_PART = flags.DEFINE_string(
    "shard", "0/1", "i/n: this process does the i-th of n parts, i from 0, for job arrays."
)
_LIMIT = flags.DEFINE_integer(
    "limit", 0, "Render only this many of the chosen models, from the first; 0 = all.",
    lower_bound=0,
)  # fmt: skip
_SAMPLE = flags.DEFINE_integer(
    "sample", 0, "Number of models, spread over categories and folders; 0 = all.", lower_bound=0
)
_SEED = flags.DEFINE_integer("seed", 0, "Seed of the choice of --sample.", lower_bound=0)
_PATTERNS = "category, folder or name fits this pattern, such as Weather or '*flare*'; repeatable."
_INCLUDE = flags.DEFINE_multi_string("include", [], f"Only models whose {_PATTERNS}")
_EXCLUDE = flags.DEFINE_multi_string("exclude", [], f"No models whose {_PATTERNS}")
_OPTION = flags.DEFINE_multi_string(
    "option", [], "NAME=VALUE for the catalogue, such as up=+z or max_faces=200000; repeatable."
)
_SCHEDULER = flags.DEFINE_string(
    "scheduler", "", "Address of a Dask scheduler, whose workers render the models; empty = this "
    "machine.",
)  # fmt: skip
_CONFIG = config_flags.DEFINE_config_file("config", None, "Settings.", lock_config=True)
_DEFAULT = pathlib.Path(__file__).with_name("config.py")


def parse_part(text: str) -> tuple[int, int]:
    """`i/n` as numbers.

    Raises:
      ValueError: the text is not of the form i/n.
    """
    first, slash, second = text.partition("/")
    if not (slash and first.isdecimal() and second.isdecimal()) or not int(first) < int(second):
        raise ValueError(f"--shard: got {text!r}, expected i/n with i from 0 to n - 1")
    return int(first), int(second)


def main(argv: list[str]) -> None:
    """Runs the command and exits with its exit code."""
    logging.set_verbosity(logging.INFO)
    exit_on_signals()
    try:
        if len(argv) > 1:
            raise ValueError(f"unexpected argument {argv[1]!r}")
        name, place, out = _CATALOGUE.value, _SOURCE.value, _OUT.value
        if name is None or place is None or out is None:
            raise ValueError("--catalogue, --source and --out are needed; see --help")
        options = settings.parse(_CONFIG.value)
        if _SEED.present and not _SAMPLE.value:
            raise ValueError(f"--seed={_SEED.value}: it has no effect without --sample")
        if _SCHEDULER.value and options.job.workers:
            raise ValueError("--config.job.workers: it has no effect with --scheduler")
        part = parse_part(_PART.value)
        source = open_catalogue(name, place, **parse_options(name, _OPTION.value))
        render = pool.render_local
        if _SCHEDULER.value:
            render = functools.partial(cluster.render_on, _SCHEDULER.value)
        choice = Choice(tuple(_INCLUDE.value), tuple(_EXCLUDE.value), _SAMPLE.value, _SEED.value)
        summary = job.render_catalogue(
            source, out, options, part=part, choice=choice, limit=_LIMIT.value, render=render
        )
    except (ValueError, RuntimeError, OSError) as error:
        sys.stderr.write(f"error: {message_line(error)}\n")
        sys.exit(2)
    sys.stdout.write(summary.text() + "\n")
    sys.exit(summary.exit_code)


# --- Flags and help ---------------------------------------------------------------------------


def _parse_flags(argv: list[str]) -> list[str]:
    """Parses the flags like absl, but every error ends in one line and exit code 2."""
    if {"--help", "-help", "-h", "-?", "--helpshort"} & set(argv[1:]):
        sys.stdout.write("\n".join(_help()) + "\n")
        sys.exit(0)
    try:
        sys.argv[:] = argv = _config_first(argv)  # `config_flags` reads the order from `sys.argv`
        return flags.FLAGS(argv)
    except (AttributeError, KeyError):  # a field that does not exist
        error: Exception = structured.unknown_setting(argv, settings.Settings())
    except (flags.Error, TypeError, ValueError, OSError) as caught:
        # The error of a configuration file holds a traceback.
        lines = [line.strip() for line in str(caught).splitlines() if line.strip()]
        has_traceback = any(line.startswith("Traceback") for line in lines)
        error = ValueError(lines[-1].partition(": ")[2] or lines[-1]) if has_traceback else caught
    sys.stderr.write(f"error: {message_line(error)}\n")
    sys.exit(2)


def _config_first(argv: list[str]) -> list[str]:
    """The arguments with `--config` first; if it is missing, the default is added."""
    rest, files = [], []
    arguments = iter(argv[1:])
    for argument in arguments:
        if argument in ("--config", "-config"):
            files.append(f"--config={next(arguments, '')}")
        elif argument.startswith(("--config=", "-config=")):
            files.append(argument)
        else:
            rest.append(argument)
    if len(files) > 1:
        raise ValueError(f"{files[1]}: --config is given twice")
    for file in files:
        if not pathlib.Path(file.partition("=")[2].partition(":")[0]).is_file():
            raise ValueError(f"{file}: there is no such file")
    # If this file were the flag's default, a wrong setting would raise an error at import.
    return [argv[0], *(files or [f"--config={_DEFAULT}"]), *rest]


def _help() -> Iterator[str]:
    """The help: flags, and from docstrings the catalogues with options and the settings."""
    yield f"{(__doc__ or '').strip()}\n\nFlags"
    for flag in flags.FLAGS.get_flags_for_module(sys.modules[__name__]):
        if flag.name != "config":
            yield f"  --{flag.name}: {str(flag.help).partition(chr(10))[0].rstrip(';')}"
    yield (
        "  --config: Python file whose `get_config` returns the settings;\n"
        "    `data_gen/config.py:NAME` starts from one of the presets "
        f"{', '.join(sorted(settings.PRESETS))}."
    )
    for name in sorted(CATALOGUES):
        yield from _documented(f"--catalogue={name}", CATALOGUES[name])
        values = inspect.signature(CATALOGUES[name]).parameters
        for key in option_types(name):
            if key in values:
                value = values[key].default
                shown = ",".join(map(str, value)) if isinstance(value, tuple) else value
                yield f"  --option={key}={shown}"
    yield from _documented(
        "Every catalogue: --option=variants=0 --option=deviation=0.25", variants_of
    )
    yield from _documented("Settings", settings.Settings)
    for name, section in structured.to_dict(settings.Settings()).items():
        if isinstance(section, dict):
            kind = type(getattr(settings.Settings(), name))
            yield from _documented(f"--config.{name}", kind)
    yield "\nDefaults of the settings"
    for name, value in structured.flatten(settings.Settings()).items():
        yield f"  --config.{name}=" + (f"'{value}'" if isinstance(value, tuple) else str(value))


def _documented(title: str, kind: Any) -> Iterator[str]:
    text = (inspect.getdoc(kind) or "").partition("\n\nRaises:")[0]
    yield f"\n{title}\n{textwrap.indent(text, '  ')}"


if __name__ == "__main__":
    app.run(main, flags_parser=_parse_flags)
