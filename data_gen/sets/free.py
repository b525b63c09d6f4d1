"""The training set of nothing but free packages, in one command.

    python data_gen/sets/free.py --packages FOLDER --out records/free

FOLDER has Debian's packages, each unpacked in a folder of its name; what is missing is said, with
the commands that fetch it:

    cd FOLDER && apt-get download torcs-data && dpkg-deb -x torcs-data_*.deb torcs-data

Each source becomes a data set of its own, `records/free/<source>`; training reads several:
`--config.data.path=records/free/furniture,records/free/aircraft`. `SOURCES.md` and `sources.json`
beside them say what is in the set and under which licences, and `licences/` has the packages'
statements of copyright.

Killed and started again, the command goes on where it was. A model that cannot be used is refused
and stops nothing. `--fraction=0.01` makes a small set in the same way. `--photo=0.25` gives a
quarter of each model's views to the preset `photo`, in `records/free/photo/<source>`.

Exit codes: 0 done; 1 done, but for sources that could not be read; 2 wrong arguments, packages are
missing or nothing came of it; 143 and 130 stopped by SIGTERM or Ctrl-C.
"""

import dataclasses
import json
import pathlib
import sys
from collections.abc import Sequence
from typing import Any

if __package__ in (None, ""):  # run as a file: two folders above is where `data_gen` is
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[2])

from absl import app, flags, logging

from data_gen import config, job, settings
from data_gen.catalogues.by_name import CATALOGUES
from data_gen.sets import sources
from data_gen.sets.sources import Licence, Selection, Source
from data_gen.signals import StoppedError, stop_on_signals
from psgn_jax.files import write_atomic
from psgn_jax.untrusted import one_line

_FLIGHTGEAR = "Curtis L. Olson and the FlightGear team"
_FREE_ART = "Jean-Christophe Durieu; ViPeR"

# Lights, clouds, marks, water, pieces, whole towns, copies, and a train with a stray sphere.
_NO_OBJECTS = (
    r"(?i)^(Weather|Astro|Effects|Autopush|Volcanoes)/|light|flare|strobe|beacon\.ac|Crater|contrail"
    r"|null\.|puff|square\.|thermalcap|tracer|glide-path|Sillage|/cut\.|/datum\.|wave-off|flols|flash"
    r"|propeller\.|parks-and-objects|groundtile|towropes|banlieue|zone_?maisons|ZoneImmeubles"
    r"|ICE3firstcar|Buildings/(cow|horse)-stable|Geometry/(container_carrier|Ensign)"
    r"|AutoGate|DockingGate|jetway-movable|testpilot|Foxtrot\.|hull\.ac|superstructure|saratoga-"
)

SOURCES = (
    Source(
        "furniture",
        "sh3f",
        views=12,
        package="sweethome3d-furniture",
        place="usr/share/sweethome3d",
        exclude="#(passage-pieton|fleche-|stationnement-)",  # paint on a road
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
        exclude=_NO_OBJECTS,
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
        families="",  # the catalogue's splits go by the meshes, not the names
        licences=(Licence("CC-BY-SA-3.0", holders="Wildfire Games"),),
    ),
    Source(
        "procedural",
        "procedural",
        views=4,
        place="480",
        families="",
        licences=(Licence("Apache-2.0", holders="the authors of psgn_jax"),),
    ),
    Source(
        "procedural_extra",
        "procedural_extra",
        views=3,
        place="100",
        families="",
        licences=(Licence("Apache-2.0", holders="the authors of psgn_jax"),),
    ),
)
"""All sources; one whose catalogue does not exist here is left out."""

PHOTO = 0.0
"""Default share of each model's views in the preset `photo`."""


@dataclasses.dataclass(frozen=True)
class Part:
    """A data set of the set: a source rendered with a preset.

    Attributes:
      source: which source.
      preset: of `data_gen/config.py`.
      folder: of the data set, relative to the set's.
      views: images of each model.
    """

    source: Source
    preset: str
    folder: str
    views: int


def plan(chosen: Sequence[Source], photo: float = PHOTO) -> list[Part]:
    """The data sets of a set, source after source.

    Args:
      chosen: the sources.
      photo: share of the views in the preset `photo`, 0 to 1.
    """
    parts = []
    for source in chosen:
        pictures = round(photo * source.views)
        for preset, folder, views in (
            ("authors", source.name, source.views - pictures),
            ("photo", f"photo/{source.name}", pictures),
        ):
            if views:
                parts.append(Part(source, preset, folder, views))
    return parts


def known_sources() -> dict[str, Source]:
    """The sources whose catalogues exist here, by name."""
    return {s.name: s for s in SOURCES if s.catalogue in CATALOGUES}


def options_of(part: Part, workers: int, variant: str) -> settings.Settings:
    """Settings of a data set of the set.

    Raises:
      ValueError: there is no such preset.
    """
    values = config.get_config(part.preset)
    values.views = part.views
    values.centre = "vertices"  # as the authors' objects stand
    if part.preset == "authors":
        # Textures have few texels a pixel here; nine samples would cost a third of the whole time.
        values.image.samples = 2
    values.job.workers = workers
    values.job.variant = variant
    # Other cameras than those of the same models in the other preset.
    values.seed = 0 if part.preset == "authors" else 1
    return settings.parse(values)


def write_table(
    out: pathlib.Path, parts: Sequence[Part], packages: str, lines: dict[str, list[Any]]
) -> str:
    """Writes `SOURCES.md`, `sources.json` and the statements of copyright; returns the former.

    Args:
      out: the set's folder.
      parts: all its data sets.
      packages: folder that the packages are unpacked in.
      lines: reports on models by the data sets' folders; those that are missing are not counted.
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
    workers: int = 0,
    variant: str = "auto",
) -> tuple[str, list[str]]:
    """Renders all data sets of a set, or goes on with them, and writes its table after each.

    Args:
      out: the set's folder, made where missing.
      packages: folder that the packages are unpacked in.
      parts: the data sets.
      fraction: see `sources.Selection`.
      workers: processes, 0 = one per processor.
      variant: see `settings.JobSettings`.

    Returns:
      the table, and a line for each data set that could not be made.

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
            summary = job.render_catalogue(
                selection, out / part.folder, options_of(part, workers, variant)
            )
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
    flags.DEFINE_list("sources", [], "Names of sources with commas between them; empty = all.")
    flags.DEFINE_float("fraction", 1.0, "Part of each source's models, at least 3 of them.",
                       lower_bound=0.0, upper_bound=1.0)  # fmt: skip
    flags.DEFINE_float("photo", PHOTO, "Share of the views in the preset photo.",
                       lower_bound=0.0, upper_bound=1.0)  # fmt: skip
    flags.DEFINE_integer("workers", 0, "Processes, 0 = one per processor.", lower_bound=0)
    flags.DEFINE_enum("variant", "auto", settings.VARIANTS, "How Mitsuba runs.")
    flags.DEFINE_bool("check", False, "Say what is missing and how many models there are; no more.")


def _parse_flags(argv: list[str]) -> list[str]:
    _define_flags()
    try:
        return flags.FLAGS(argv)
    except (flags.Error, ValueError) as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)


def main(argv: list[str]) -> None:
    """The command; exits with the code that tells what came of it."""
    logging.set_verbosity(logging.INFO)
    stop_on_signals()
    given = flags.FLAGS
    try:
        if len(argv) > 1:
            raise ValueError(f"unexpected argument {argv[1]!r}")
        if given.packages is None or (given.out is None and not given.check):
            raise ValueError("--packages and --out are needed")
        known = known_sources()
        unknown = [name for name in given.sources if name not in known]
        if unknown:
            raise ValueError(f"--sources: got {unknown[0]!r}, expected some of {list(known)}")
        chosen = [s for name, s in known.items() if not given.sources or name in given.sources]
        commands = sources.missing(chosen, given.packages)
        if commands:
            raise ValueError(
                "packages are missing; these commands fetch and unpack them:\n  "
                + "\n  ".join(commands)
            )
        parts = plan(chosen, given.photo)
        for part in parts:
            options_of(part, given.workers, given.variant)  # no such preset: said before the work
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
            workers=given.workers, variant=given.variant,
        )  # fmt: skip
    except StoppedError as error:
        logging.warning("%s; the same command goes on with the set", error)
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
