"""Renders meshes to training data.

    python data_gen/render.py --catalogue NAME --source PATH --out RECORDS

NAME is one of procedural, procedural_extra, procedural_groups, folder, shapenet, sh3f, ac3d,
flightgear, torcs, pyrogenesis, records. PATH is the source of this catalogue: a folder, a file, or
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

import difflib
import functools
import pathlib
import sys
from collections.abc import Collection, Mapping
from typing import Any

if __package__ in (None, ""):  # run as a file: `data_gen` is in the folder above
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[1])

from absl import app, flags, logging
from ml_collections import config_flags

from data_gen import cluster, job, manual, pool, settings
from data_gen.catalogues.by_name import CATALOGUES, open_catalogue, parse_options
from data_gen.catalogues.choosing import Choice
from data_gen.signals import StoppedError, stop_on_signals
from psgn_jax.untrusted import one_line

_CATALOGUE = flags.DEFINE_enum("catalogue", None, sorted(CATALOGUES), "Where the models come from.")
_SOURCE = flags.DEFINE_string(
    "source", None, "Source of the catalogue: a folder, a file, or numbers of models."
)
_OUT = flags.DEFINE_string("out", None, "Folder of the data set.")
_PART = flags.DEFINE_string(
    "shard", "0/1", "i/n: this process does the i-th of n parts, i from 0, for job arrays."
)
_LIMIT = flags.DEFINE_integer(
    "limit",
    0,
    "Render only this many of the chosen models, from the first; 0 = all.",
    lower_bound=0,
)
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
    "scheduler",
    "",
    "Address of a Dask scheduler, whose workers render the models; empty = this machine.",
)
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


def _one_line(error: BaseException) -> str:
    """The message of an error on one line; the last line of a message with a traceback."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if any(line.startswith("Traceback") for line in lines):
        return lines[-1].partition(": ")[2] or lines[-1]
    return one_line(" ".join(lines))


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
        path = file.partition("=")[2].partition(":")[0]
        if not pathlib.Path(path).is_file():
            raise ValueError(f"{file}: there is no such file")
    # If this file were the flag's default, a wrong setting would raise an error at import.
    return [argv[0], *(files or [f"--config={_DEFAULT}"]), *rest]


def _unknown_setting(argv: list[str]) -> str:
    """A message on the first argument that sets an unknown field, with the most similar field."""
    known = _fields(settings.to_dict(settings.Settings()))
    for argument in argv:
        name = argument.partition("=")[0].lstrip("-").partition(".")
        if name[0] in ("config", "noconfig") and name[2] and name[2] not in known:
            near = difflib.get_close_matches(name[2], known, 1)
            return f"{argument}: no such setting" + (
                f"; did you mean --config.{near[0]}?" if near else ""
            )
    return "--config: no such setting"


def _fields(values: Mapping[str, Any], prefix: str = "") -> list[str]:
    names = []
    for name, value in values.items():
        names.append(prefix + name)
        if isinstance(value, Mapping):
            names += _fields(value, f"{prefix}{name}.")
    return names


def _help() -> str:
    own = flags.FLAGS.get_flags_for_module(sys.modules[__name__])
    shown = {
        f"--{flag.name}" + (f"={flag.default}" if flag.default not in (None, [], "") else ""):
        str(flag.help).partition(";\n")[0] for flag in own if flag.name != "config"
    }  # fmt: skip
    shown["--config=FILE"] = (
        "Python file whose `get_config` returns the settings; `data_gen/config.py:NAME` starts "
        f"from one of the presets {', '.join(sorted(settings.PRESETS))}."
    )
    return manual.text(__doc__ or "", dict(sorted(shown.items())))


def _parse_flags(argv: list[str]) -> list[str]:
    """Parses the flags like absl, but every error ends in one line and exit code 2."""
    if {"--help", "-help", "-h", "-?", "--helpshort"} & set(argv[1:]):
        sys.stdout.write(_help())
        sys.exit(0)
    try:
        sys.argv[:] = argv = _config_first(argv)  # `config_flags` reads the order from `sys.argv`
        return flags.FLAGS(argv)
    except (AttributeError, KeyError):
        sys.stderr.write(f"error: {_unknown_setting(argv)}\n")
    except (flags.Error, TypeError, ValueError, OSError) as error:
        sys.stderr.write(f"error: {_one_line(error)}\n")
    sys.exit(2)


def _check_effects(options: settings.Settings, given: Collection[str]) -> None:
    """Raises ValueError for a flag that was given but has no effect with the other flags."""
    if _SEED.present and not _SAMPLE.value:
        raise ValueError(f"--seed={_SEED.value}: it has no effect without --sample")
    no_photo = options.image.shading != "photo" and "without image.shading=photo"
    idle = {
        **{name: no_photo for name in given if name.startswith("film.")},
        "image.rays": no_photo,
        "image.path_samples": options.image.shading != "path" and "without image.shading=path",
        "job.workers": bool(_SCHEDULER.value) and "with --scheduler",
    }
    for name, condition in idle.items():
        if name in given and condition:
            raise ValueError(f"--config.{name}: it has no effect {condition}")


def main(argv: list[str]) -> None:
    """Runs the command and exits with its exit code."""
    logging.set_verbosity(logging.INFO)
    stop_on_signals()
    try:
        if len(argv) > 1:
            raise ValueError(f"unexpected argument {argv[1]!r}")
        name, place, out = _CATALOGUE.value, _SOURCE.value, _OUT.value
        if name is None or place is None or out is None:
            raise ValueError("--catalogue, --source and --out are needed; see --help")
        options = settings.parse(_CONFIG.value)
        _check_effects(options, config_flags.get_override_values(flags.FLAGS["config"]))
        part = parse_part(_PART.value)
        try:
            source = open_catalogue(name, place, **parse_options(name, _OPTION.value))
        except TypeError as error:
            raise ValueError(f"--option: {error}") from error
        render = pool.render_local
        if _SCHEDULER.value:
            render = functools.partial(cluster.render_on, _SCHEDULER.value)
        summary = job.render_catalogue(
            source,
            out,
            options,
            part=part,
            choice=Choice(
                include=tuple(_INCLUDE.value),
                exclude=tuple(_EXCLUDE.value),
                sample=_SAMPLE.value,
                seed=_SEED.value,
            ),
            limit=_LIMIT.value,
            render=render,
        )
    except StoppedError as error:
        logging.warning("%s; run the same command again to resume", error)
        sys.exit(128 + error.number)
    except (ValueError, RuntimeError, OSError) as error:
        sys.stderr.write(f"error: {_one_line(error)}\n")
        sys.exit(2)
    sys.stdout.write(summary.text() + "\n")
    sys.exit(summary.exit_code)


if __name__ == "__main__":
    app.run(main, flags_parser=_parse_flags)
