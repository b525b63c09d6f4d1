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

Exit codes: 0 done; 1 done, except for sources that could not be rendered; 2 wrong arguments,
missing packages or no data set; 143 stopped by SIGTERM; 130 stopped by Ctrl-C.
"""

import dataclasses
import json
import pathlib
import sys
from collections.abc import Mapping, Sequence
from typing import Any

if __package__ in (None, ""):  # run as a file: `data_gen` is two folders above
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[2])

from absl import app, flags, logging

from data_gen import config, frame, job, settings
from data_gen.catalogues import non_objects
from data_gen.catalogues.by_name import CATALOGUES
from data_gen.sets import sources
from data_gen.sets.sources import Licence, Selection, Source
from data_gen.signals import StoppedError, stop_on_signals
from psgn_jax.files import write_atomic
from psgn_jax.untrusted import one_line

_FLIGHTGEAR = "Curtis L. Olson and the FlightGear team"
_FREE_ART = "Jean-Christophe Durieu; ViPeR"


def _procedural(name: str, *, views: int, models: str) -> Source:
    licence = Licence("Apache-2.0", holders="the authors of psgn_jax")
    return Source(name, name, views=views, place=models, families="", licences=(licence,))


SOURCES = (
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
    Source(
        "ancient",
        "pyrogenesis",
        views=6,
        package="0ad-data",
        place="usr/share/games/0ad/mods/public/public.zip",
        families="",  # the catalogue splits by meshes
        licences=(Licence("CC-BY-SA-3.0", holders="Wildfire Games"),),
    ),
    _procedural("procedural", views=4, models="480"),
    _procedural("procedural_extra", views=3, models="100"),
    _procedural("procedural_groups", views=3, models="4000"),
    dataclasses.replace(
        _procedural("procedural_groups", views=3, models="1000"),
        name="procedural_incomplete",
        options={"first_seed": 4000},
        missing=1.0,
    ),
)
"""All sources."""

OTHER_PRESETS = ("photo", "angles", "level")
"""Presets for a part of each model's views. Their flags are the fractions of the views."""


@dataclasses.dataclass(frozen=True)
class Part:
    """A data set of the training set: a source rendered with a preset.

    Attributes:
      source: the source.
      preset: a preset of `data_gen/config.py`.
      folder: folder of the data set, relative to that of the training set.
      views: number of images of each model.
    """

    source: Source
    preset: str
    folder: str
    views: int


def plan(chosen: Sequence[Source], fractions: Mapping[str, float] = {}) -> list[Part]:
    """The data sets of a training set, source by source.

    Args:
      chosen: the sources.
      fractions: fraction of the views rendered with each of `OTHER_PRESETS`; a missing one is 0.

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


def known_sources() -> dict[str, Source]:
    """The sources with an existing catalogue, by name."""
    return {s.name: s for s in SOURCES if s.catalogue in CATALOGUES}


@dataclasses.dataclass(frozen=True)
class Options:
    """Options of the rendering that are the same for all data sets.

    Attributes:
      centre: see `settings.Settings`. The authors' objects are centred on their vertices.
      workers: number of processes, 0 = one per processor.
      variant: see `settings.JobSettings`.
    """

    centre: str = "vertices"
    workers: int = 0
    variant: str = "auto"


def settings_of(part: Part, options: Options) -> settings.Settings:
    """Settings of a data set.

    Raises:
      ValueError: the preset is unknown.
    """
    values = config.get_config(part.preset)
    values.views = part.views
    values.centre = options.centre
    values.image.missing = part.source.missing
    if part.preset != "photo":
        # These textures have few texels per pixel, so that a few samples suffice.
        values.image.samples = 2
    values.job.workers = options.workers
    values.job.variant = options.variant
    # One seed for each preset, so that the cameras of a source's data sets differ.
    values.seed = ("authors", *OTHER_PRESETS).index(part.preset)
    return settings.parse(values)


def write_table(
    out: pathlib.Path, parts: Sequence[Part], packages: str, lines: dict[str, list[Any]]
) -> str:
    """Writes `SOURCES.md`, `sources.json` and the copyright statements; returns `SOURCES.md`.

    Args:
      out: folder of the training set.
      parts: all its data sets.
      packages: folder of the unpacked packages.
      lines: lines of `models.jsonl` by folder of the data set; missing data sets are not counted.
    """
    rows = []
    for source in dict.fromkeys(p.source.name for p in parts):
        own = [p for p in parts if p.source.name == source and p.folder in lines]
        if own:
            reports = [line for p in own for line in lines[p.folder]]
            rows.append(sources.row(own[0].source, reports, packages, [p.folder for p in own]))
            package = own[0].source.package
            text = sources.copyright_of(packages, package) if package else ""
            if text:
                (out / "licences").mkdir(exist_ok=True)
                write_atomic(out / "licences" / f"{package}.txt", text)
    text = sources.markdown(rows)
    write_atomic(out / "sources.json", json.dumps(rows, indent=1) + "\n")
    write_atomic(out / "SOURCES.md", text)
    return text


def build(
    out: pathlib.Path,
    packages: str,
    parts: Sequence[Part],
    *,
    fraction: float = 1.0,
    options: Options = Options(),
) -> tuple[str, list[str]]:
    """Renders all data sets of a training set, or completes them. Writes the table after each.

    Args:
      out: folder of the training set; created if missing.
      packages: folder of the unpacked packages.
      parts: the data sets.
      fraction: see `sources.Selection`.
      options: options of the rendering.

    Returns:
      The table, and a line for each data set that could not be rendered.

    Raises:
      RuntimeError: Mitsuba is missing or does not run.
    """
    out.mkdir(parents=True, exist_ok=True)
    lines: dict[str, list[Any]] = {}
    problems = []
    text = ""
    for number, part in enumerate(parts, 1):
        try:
            selection = Selection(part.source, packages, fraction)
            logging.info(
                "%d of %d: %s, %d models, %d views each",
                number, len(parts), part.folder, len(selection), part.views,
            )  # fmt: skip
            summary = job.render_catalogue(selection, out / part.folder, settings_of(part, options))
        except (ValueError, OSError) as error:
            problems.append(f"{part.folder}: {error}")
            logging.error("%s: %s", part.folder, error)
            continue
        lines[part.folder] = list(summary.lines)
        text = write_table(out, parts, packages, lines)
    return text, problems


# --- The command ------------------------------------------------------------------------------


def _define_flags() -> None:
    flags.DEFINE_string("packages", None, "Folder of the unpacked packages.")
    flags.DEFINE_string("out", None, "Folder of the set.")
    flags.DEFINE_list("sources", [], "Names of sources, separated by commas; empty = all.")
    flags.DEFINE_float("fraction", 1.0, "Fraction of each source's models, at least 3 models.",
                       lower_bound=0.0, upper_bound=1.0)  # fmt: skip
    flags.DEFINE_float("photo", 0.0, "Fraction of the views rendered with the preset photo.",
                       lower_bound=0.0, upper_bound=1.0)  # fmt: skip
    flags.DEFINE_float("angles", 0.0, "Fraction of the views rendered with the preset angles.",
                       lower_bound=0.0, upper_bound=1.0)  # fmt: skip
    flags.DEFINE_float("level", 0.0, "Fraction of the views rendered with the preset level.",
                       lower_bound=0.0, upper_bound=1.0)  # fmt: skip
    flags.DEFINE_enum("centre", "vertices", frame.CENTRES,
                      "Point of a model that is moved to x = y = 0.")  # fmt: skip
    flags.DEFINE_integer("workers", 0, "Processes, 0 = one per processor.", lower_bound=0)
    flags.DEFINE_enum("variant", "auto", settings.VARIANTS, "Variant of Mitsuba.")
    flags.DEFINE_bool("check", False, "Only report missing packages and the number of models.")


def _parse_flags(argv: list[str]) -> list[str]:
    _define_flags()
    try:
        return flags.FLAGS(argv)
    except (flags.Error, ValueError) as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)


def main(argv: list[str]) -> None:
    """Runs the command and exits with one of the codes in the docstring of this module."""
    logging.set_verbosity(logging.INFO)
    stop_on_signals()
    given = flags.FLAGS
    try:
        if len(argv) > 1:
            raise ValueError(f"unexpected argument {argv[1]!r}, expected only flags")
        if given.packages is None or (given.out is None and not given.check):
            raise ValueError("--packages, --out: missing, expected both")
        known = known_sources()
        unknown = [name for name in given.sources if name not in known]
        if unknown:
            raise ValueError(f"--sources: got {unknown[0]!r}, expected some of {list(known)}")
        chosen = [s for name, s in known.items() if not given.sources or name in given.sources]
        commands = sources.missing(chosen, given.packages)
        if commands:
            raise ValueError(
                "packages are missing; these commands download and unpack them:\n  "
                + "\n  ".join(commands)
            )
        fractions = {preset: getattr(given, preset) for preset in OTHER_PRESETS}
        parts = plan(chosen, fractions)
        options = Options(given.centre, given.workers, given.variant)
        for part in parts:
            settings_of(part, options)  # reports an unknown preset early
        if given.check:
            count = 0
            for part in parts:
                selection = Selection(part.source, given.packages, given.fraction)
                count += len(selection) * part.views
                sys.stdout.write(f"{part.folder}: {len(selection)} models, {part.views} views\n")
            sys.stdout.write(f"{count} images\n")
            return
        text, problems = build(
            pathlib.Path(given.out), given.packages, parts, fraction=given.fraction,
            options=options,
        )  # fmt: skip
    except StoppedError as error:
        logging.warning("%s; run the same command to continue", error)
        sys.exit(128 + error.number)
    except (ValueError, RuntimeError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)
    made = [str(pathlib.Path(given.out) / p.folder) for p in parts
            if not any(x.startswith(f"{p.folder}: ") for x in problems)]  # fmt: skip
    sys.stdout.write(text)
    sys.stdout.write("\n".join(["", *(f"not made: {one_line(p)}" for p in problems), ""]))
    sys.stdout.write(f"--config.data.path={','.join(made)}\n")
    sys.exit(2 if not made else 1 if problems else 0)


if __name__ == "__main__":
    app.run(main, flags_parser=_parse_flags)
