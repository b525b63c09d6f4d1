"""Renders a training set from free packages only.

    python data_gen/sets/free.py --packages FOLDER --out records/free

FOLDER contains Debian packages, each unpacked in a folder with its name. If packages are missing,
the command prints the commands that fetch them:

    cd FOLDER && apt-get download torcs-data && dpkg-deb -x torcs-data_*.deb torcs-data

Each source becomes a separate data set, `records/free/<source>`. Training reads several of them:
`--config.data.path=records/free/furniture,records/free/aircraft`. `SOURCES.md` and `sources.json`
list the contents and the licences, and `licences/` contains the copyright statements of the
packages.

If the command is stopped and started again, it continues. Unusable models are refused and
reported. `--fraction=0.01` renders a small part of the set. `--photo=0.25` renders a quarter of the
views of each model with the preset `photo`, in `records/free/photo/<source>`. `--angles=0.25` does
the same with the preset `angles`: the cameras of `photo` with the light and shading of the authors.
This renders several times as fast as the preset `photo`. `--level=0.25` does the same with the
preset `level`: like `angles`, but near the horizon, at elevations of -8 to 10 degrees.
`--variants=8` replaces each model by 8 variants with other proportions.

Exit codes: 0 done; 1 done, except for sources that could not be rendered; 2 wrong arguments,
missing packages or no data set; 143 stopped by SIGTERM; 130 stopped by Ctrl-C.
"""

import dataclasses
import json
import pathlib
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

if __package__ in (None, ""):  # run as a file: `data_gen` is two folders above
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[2])

from absl import app, flags, logging

from data_gen import config, job, settings
from data_gen.catalogues import non_objects
from data_gen.sets import sources
from data_gen.sets.sources import Licence, Source, select
from psgn_jax.system.files import write_atomic
from psgn_jax.system.signals import exit_on_signals
from psgn_jax.system.untrusted import message_line

_FLIGHTGEAR = "Curtis L. Olson and the FlightGear team"
_FREE_ART = "Jean-Christophe Durieu; ViPeR"


def _procedural(name: str, *, views: int, models: str) -> Source:
    licence = Licence("Apache-2.0", holders="the authors of psgn_jax")
    return Source(name, name, views=views, place=models, families="", licences=(licence,))


SOURCES = {
    source.name: source
    for source in (
        Source(
            "furniture",
            "sh3f",
            views=12,
            package="sweethome3d-furniture",
            place="usr/share/sweethome3d",
            exclude="#(passage-pieton|fleche-|stationnement-)",  # road markings
            licences=(
                Licence("CC-BY-3.0", "^Scopia/", "Scopia"),
                Licence("CC-BY-3.0", "^BlendSwap-CC-BY/", "Blend Swap contributors"),
                Licence("CC0-1.0", "^BlendSwap-CC-0/", "Blend Swap contributors"),
                Licence("CC-BY-3.0-US", "^KatorLegaz/", "Kator Legaz"),
                Licence("CC-BY-3.0-US", "^Reallusion/", "Reallusion"),
                Licence("see the package"),
            ),
        ),
        Source(
            "scenery",
            "ac3d",
            views=10,
            package="flightgear-data-models",
            place="usr/share/games/flightgear/Models",
            exclude=non_objects.SCENERY,
            licences=(Licence("GPL-2.0-or-later", holders=_FLIGHTGEAR),),
        ),
        Source(
            "aircraft",
            "flightgear",
            views=8,
            package="flightgear-data-ai",
            place="usr/share/games/flightgear/AI/Aircraft",
            families="folder",
            licences=(Licence("GPL-2.0-or-later", holders=_FLIGHTGEAR),),
        ),
        Source(
            "cars",
            "torcs",
            views=24,
            package="torcs-data",
            place="usr/share/games/torcs",
            licences=(
                Licence(
                    "GPL-2.0-or-later",
                    "^cars/(155-DTM|buggy|p406)/",
                    "Eric Espié; Christophe Guionneau; Bernhard Wymann; Andrea Alfieri",
                ),
                Licence("LAL-1.2 (Free Art)", holders=_FREE_ART),
            ),
        ),
        _procedural("procedural", views=4, models="480"),
        dataclasses.replace(
            _procedural("procedural", views=3, models="77"),
            name="procedural_incomplete",
            options={"first_seed": 480},
            missing=1.0,
        ),
    )
}
"""All sources, by name."""

OTHER_PRESETS = ("photo", "angles", "level")
"""Presets for a part of each model's views. Their flags are the fractions of the views."""


class Part(NamedTuple):
    """A data set of the training set: a source rendered with a preset of `data_gen/config.py`.

    Attributes:
      source: the source.
      preset: the preset.
      folder: folder of the data set, relative to that of the training set.
      views: number of images of each model.
    """

    source: Source
    preset: str
    folder: str
    views: int


def plan(chosen: Sequence[Source], fractions: Mapping[str, float] = {}) -> list[Part]:
    """The data sets of a training set, source by source.

    `fractions` are those of the views rendered with each of `OTHER_PRESETS`; a missing one is 0.

    Raises:
      ValueError: the sum of the fractions exceeds 1.
    """
    if sum(fractions.values()) > 1:
        raise ValueError(
            f"{', '.join(f'--{name}={x:g}' for name, x in fractions.items())}: expected a sum of "
            "at most 1"
        )
    parts = []
    for source in chosen:
        views: dict[str, int] = {}
        for name, x in fractions.items():  # the sum of rounded numbers could be too large
            views[name] = min(round(x * source.views), source.views - sum(views.values()))
        views["authors"] = source.views - sum(views.values())
        for preset in ("authors", *OTHER_PRESETS):
            folder = source.name if preset == "authors" else f"{preset}/{source.name}"
            if views.get(preset, 0) > 0:
                parts.append(Part(source, preset, folder, views[preset]))
    return parts


def settings_of(
    part: Part, centre: str = "vertices", workers: int = 0, variant: str = "auto"
) -> settings.Settings:
    """Settings of a data set. The authors' objects are centred on their vertices."""
    values = config.get_config(part.preset)
    values.views, values.centre, values.image.missing = part.views, centre, part.source.missing
    if part.preset != "photo":
        # These textures have few texels per pixel, so that a few samples suffice.
        values.image.samples = 2
    values.job.workers, values.job.variant = workers, variant
    # One seed for each preset, so that the cameras of a source's data sets differ.
    values.seed = ("authors", *OTHER_PRESETS).index(part.preset)
    return settings.parse(values)


def write_table(
    out: pathlib.Path, parts: Sequence[Part], packages: str, lines: Mapping[str, Sequence[Any]]
) -> str:
    """Writes `SOURCES.md`, `sources.json` and the copyright statements; returns `SOURCES.md`.

    `lines` are those of `models.jsonl` by folder of the data set; missing ones are not counted.
    """
    rows = []
    for source in {part.source.name: part.source for part in parts}.values():
        folders = [p.folder for p in parts if p.source is source and p.folder in lines]
        if folders:
            reports = [line for folder in folders for line in lines[folder]]
            rows.append(sources.row(source, reports, packages, folders))
            _, text = sources.documents_of(packages, source.package)
            if text:
                write_atomic(out / "licences" / f"{source.package}.txt", text)
    text = sources.markdown(rows)
    write_atomic(out / "sources.json", json.dumps(rows, indent=1) + "\n")
    write_atomic(out / "SOURCES.md", text)
    return text


# --- The command ------------------------------------------------------------------------------


def _parse_flags(argv: list[str]) -> list[str]:
    flags.DEFINE_string("packages", None, "Folder of the unpacked packages.")
    flags.DEFINE_string("out", None, "Folder of the set.")
    flags.DEFINE_list("sources", [], "Names of sources, separated by commas; empty = all.")
    flags.DEFINE_float("fraction", 1.0, "Fraction of each source's models, at least 3 models.",
                       lower_bound=0.0, upper_bound=1.0)  # fmt: skip
    for name in OTHER_PRESETS:
        flags.DEFINE_float(name, 0.0, f"Fraction of the views rendered with the preset {name}.",
                           lower_bound=0.0, upper_bound=1.0)  # fmt: skip
    flags.DEFINE_enum("centre", "vertices", ["bounds", "vertices"],
                      "Point of a model that is moved to x = y = 0.")  # fmt: skip
    flags.DEFINE_integer("workers", 0, "Processes, 0 = one per processor.", lower_bound=0)
    flags.DEFINE_enum("variant", "auto", ["auto", "llvm", "scalar"], "Variant of Mitsuba.")
    flags.DEFINE_integer("variants", 0, "Number of variants with other proportions that replace "
                         "each model; 0 = the models themselves.", lower_bound=0)  # fmt: skip
    flags.DEFINE_bool("check", False, "Only report missing packages and the number of models.")
    try:
        return flags.FLAGS(argv)
    except (flags.Error, ValueError) as error:
        sys.stderr.write(f"error: {message_line(error)}\n")
        sys.exit(2)


def main(argv: list[str]) -> None:
    """Runs the command and exits with one of the codes in the docstring of this module."""
    logging.set_verbosity(logging.INFO)
    exit_on_signals()
    given = flags.FLAGS
    try:
        if len(argv) > 1:
            raise ValueError(f"unexpected argument {argv[1]!r}, expected only flags")
        if given.packages is None or (given.out is None and not given.check):
            raise ValueError("--packages, --out: missing, expected both")
        unknown = [name for name in given.sources if name not in SOURCES]
        if unknown:
            raise ValueError(f"--sources: got {unknown[0]!r}, expected some of {list(SOURCES)}")
        chosen = [s for name, s in SOURCES.items() if not given.sources or name in given.sources]
        commands = sources.missing(chosen, given.packages)
        if commands:
            sys.stderr.write(
                "error: packages are missing; these commands download and unpack them:\n  "
                + "\n  ".join(commands) + "\n"
            )  # fmt: skip
            sys.exit(2)
        parts = plan(chosen, {preset: getattr(given, preset) for preset in OTHER_PRESETS})
        made, problems = _render(parts)
    except (ValueError, RuntimeError, OSError) as error:
        sys.stderr.write(f"error: {message_line(error)}\n")
        sys.exit(2)
    if not given.check:
        paths = (str(pathlib.Path(given.out) / folder) for folder in made)
        sys.stdout.write("\n".join(["", *problems, f"--config.data.path={','.join(paths)}", ""]))
        sys.exit(2 if not made else 1 if problems else 0)


def _render(parts: Sequence[Part]) -> tuple[list[str], list[str]]:
    """Renders all data sets, or completes them, and writes the table after each.

    With `--check`, it only reports the numbers of models.

    Returns:
      The folders of the data sets, and a line for each data set that could not be rendered.

    Raises:
      RuntimeError: Mitsuba is missing or does not run.
    """
    given = flags.FLAGS
    lines: dict[str, Sequence[Any]] = {}
    problems = []
    text = ""
    count = 0
    for number, part in enumerate(parts, 1):
        try:
            models = select(part.source, given.packages, given.fraction, given.variants)
            count += len(models) * part.views
            what = f"{part.folder}: {len(models)} models, {part.views} views"
            if given.check:
                sys.stdout.write(f"{what}\n")
                continue
            logging.info("%d of %d: %s", number, len(parts), what)
            options = settings_of(part, given.centre, given.workers, given.variant)
            out = pathlib.Path(given.out)
            lines[part.folder] = job.render_catalogue(models, out / part.folder, options).lines
            text = write_table(out, parts, given.packages, lines)
        except (ValueError, OSError) as error:
            problems.append(f"not made: {part.folder}: {message_line(error)}")
            logging.error("%s", problems[-1])
    sys.stdout.write(f"{count} images\n" if given.check else text)
    return list(lines), problems


if __name__ == "__main__":
    app.run(main, flags_parser=_parse_flags)
