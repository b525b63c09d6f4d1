"""Renders meshes to training data.

    python data_gen/render.py --catalogue NAME --source PATH --out RECORDS

NAME is a catalogue in the list below. PATH is its source: a folder, a file, or numbers of models.
The folder RECORDS becomes a data set for training. Its file `models.jsonl` has a line for each
model: status, reason for a refusal, checks and time.

Each setting is a flag: `--config.views=8 --config.camera.elevation='(0., 40.)'`. `--config=photo`
starts from a preset. You can kill the command; the same command continues it. The records are the
same, byte for byte, for any number of workers, restarts or parts. The parts of `--shard=i/n` share
the folder; the last part completes the data set. `data_gen/cluster.py` states what the workers of
`--scheduler=tcp://host:8786` need.

To add models, render them into another folder: training reads several, `--config.data.path=a,b`.

Exit codes: 0 done, all models have samples; 1 done, some models were refused (normal for
collections); 2 wrong arguments, or no samples; 3 this part is finished, other parts are not; 5 the
disk is full; 143 stopped by SIGTERM; 130 stopped by Ctrl-C.

Models are identified by name. If a mesh file changes but its name does not, we try a refused model
again (without `--shard`), but old samples stay: use a new output folder.
"""

import dataclasses
import functools
import inspect
import pathlib
import re
import sys
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

if __package__ in (None, ""):  # run as a file: `data_gen` is in the folder above
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[1])

from absl import logging

from data_gen import cluster, job, pool, settings
from data_gen.catalogues import open_catalogue as catalogues
from data_gen.catalogues.choosing import Choice
from psgn_jax.config.command_line import Flags, named_file
from psgn_jax.system.signals import exit_on_signals
from psgn_jax.system.terminal import start_command

_DEFAULT = pathlib.Path(__file__).with_name("config.py")


def path_of(value: str) -> str:
    """The path of a settings file from its path or a preset's name; `ConfigError` if neither."""
    return named_file(value, {name: f"{_DEFAULT}:{name}" for name in sorted(settings.PRESETS)})


def main(argv: Sequence[str] | None = None) -> int:
    usage = "psgn render --catalogue=NAME --source=PATH --out=FOLDER"
    flags = Flags(usage, __doc__, lambda: "\n".join(_details()))
    flags.config(settings.Settings(), path_of, str(_DEFAULT))
    flags.enum("catalogue", None, sorted(catalogues.CATALOGUES), "Kind of the source of models.")
    flags.path("source", None, "Source of the models: a folder, a file, or numbers of models.")
    flags.path("out", None, "Folder of the data set.")
    flags.string("shard", "0/1", "i/n: the i-th of n parts, i from 0, for job arrays.")
    flags.integer("limit", 0, "Number of chosen models, from the first; 0 = all.", lower_bound=0)
    flags.integer(
        "sample", 0, "Number of models, spread over categories and folders; 0 = all.", lower_bound=0
    )
    flags.integer("seed", 0, "Seed of the choice of --sample.", lower_bound=0)
    patterns = "category, folder or name fits this pattern, such as Weather or '*flare*'."
    flags.multi_string("include", [], f"Only models whose {patterns}")
    flags.multi_string("exclude", [], f"No models whose {patterns}")
    flags.multi_string("option", [], "NAME=VALUE for the catalogue, such as up=+z.")
    flags.string("scheduler", "", "Address of a Dask scheduler; empty = this machine.")
    return flags.run(_main, argv, wrong_input=(ValueError, RuntimeError))


def _main(flags: Flags) -> int:
    exit_on_signals()
    values = flags.values
    options = settings.parse(flags.settings)
    if flags.given("seed") and not values.sample:
        raise ValueError(f"--seed={values.seed}: it has no effect without --sample")
    if values.scheduler and options.job.workers:
        raise ValueError("--config.job.workers: it has no effect with --scheduler")
    match = re.fullmatch(r"([0-9]+)/([0-9]+)", values.shard)
    if not match or not int(match[1]) < int(match[2]):
        raise ValueError(f"shard={values.shard}: expected i/n with i from 0 to n - 1")
    part = int(match[1]), int(match[2])
    catalogue_options = catalogues.parse_options(values.catalogue, values.option)
    source = catalogues.open_catalogue(values.catalogue, values.source, **catalogue_options)
    render: pool.Pool = pool.render_local
    if values.scheduler:
        logging.get_absl_handler().addFilter(cluster.is_no_traceback)
        render = functools.partial(cluster.render_on, values.scheduler)
    patterns = tuple(values.include), tuple(values.exclude)
    choice = Choice(*patterns, values.sample, values.seed, values.limit)
    progress = job.render_catalogue(
        source, values.out, options, part=part, choice=choice, render=render
    )
    sys.stdout.write(job.text_of(progress) + "\n")
    return progress.exit_code


# --- Help ---------------------------------------------------------------------------------------


def _details() -> Iterator[str]:
    """The catalogues with their options, and the settings, from docstrings."""
    yield (
        f"\n--config=NAME: one of the presets {', '.join(sorted(settings.PRESETS))};\n"
        "--config=FILE: a Python file whose `get_config` returns the settings, such as a copy of\n"
        f"  {_DEFAULT}"
    )
    for name, function in sorted(catalogues.CATALOGUES.items()):
        yield from _documented(f"--catalogue={name}", function)
        for key, parameter in inspect.signature(function).parameters.items():
            if key != "source":
                value = parameter.default
                shown = ",".join(map(str, value)) if isinstance(value, tuple) else value
                yield f"  --option={key}={shown}"
    yield from _documented(
        "Every catalogue: --option=variants=0 --option=deviation=0.25", catalogues.variants_of
    )
    yield from _documented("Settings", settings.Settings)
    for field in dataclasses.fields(settings.Settings):
        if dataclasses.is_dataclass(field.type):
            yield from _documented(f"--config.{field.name}", field.type)


def _documented(title: str, kind: Any) -> Iterator[str]:
    text = (inspect.getdoc(kind) or "").partition("\n\nRaises:")[0]
    yield f"\n{title}\n{textwrap.indent(text, '  ')}"


if __name__ == "__main__":
    start_command()
    sys.exit(main())
