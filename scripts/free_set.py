"""Renders a training set from free packages.

    python scripts/free_set.py --packages FOLDER --out records/free

FOLDER contains Debian packages, each unpacked in a folder with its name, and a folder `meshes` with
a file `index.csv` (`data_gen.catalogues.indexed`). The source `collections` has the models of the
index with a permissive licence, `copyleft` the models with a copyleft licence. If something is
missing, the command prints how to get it:

    cd FOLDER && apt-get download sweethome3d-furniture
    dpkg-deb -x sweethome3d-furniture_*.deb sweethome3d-furniture

Each source becomes a data set, `records/free/<source>`. Training reads several of them:
`--config.data.path=records/free/furniture,records/free/procedural`. `SOURCES.md` and `sources.json`
list the contents and the licences, and `licences/` has the copyright statements of the packages.

The same command continues a stopped command. `--fraction=0.01` renders a small part of the set.
`--photo=0.25`, `--angles=0.25` and `--level=0.25` render a quarter of each model's views with the
presets `photo`, `angles` and `level` (`data_gen/config.py`), in `records/free/photo/<source>` and
so on. `--variants=8` replaces each model by 8 variants with other proportions.

Exit codes: 0 done; 1 done, but some sources could not be rendered; 2 wrong arguments, missing
packages or no data set; 5 the disk is full; 143 stopped by SIGTERM; 130 stopped by Ctrl-C.
"""

import contextlib
import dataclasses
import gzip
import hashlib
import json
import os
import pathlib
import re
import shlex
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from absl import logging

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from data_gen import config, job, settings
from data_gen.catalogues.entry import Catalogue, family_of, original_name, printable, split_of
from data_gen.catalogues.indexed import INDEX, fits, read_index
from data_gen.catalogues.open_catalogue import open_catalogue, variants_of
from psgn_jax.config.command_line import Flags
from psgn_jax.data.shards import read_report
from psgn_jax.system.errors import Exit, is_disk_full
from psgn_jax.system.files import check_folder, write_atomic
from psgn_jax.system.signals import exit_on_signals
from psgn_jax.system.terminal import start_command
from psgn_jax.system.untrusted import message_line

MESHES = "meshes"
"""Name of the folder with an index, beside the packages."""


class Licence(NamedTuple):
    """The licence of models with names that match the pattern `models`, and the holders."""

    name: str
    models: str = ""
    holders: str = ""


@dataclasses.dataclass(frozen=True)
class Source:
    """A source of a training set, a catalogue with its options.

    Attributes:
      name: also its folder in the training set.
      views: number of images of each model.
      licences: the first licence with a matching pattern counts; () = the index states licences.
      package: name of the Debian package or of the folder of meshes; "" = none.
      source: source of the catalogue: a path in the package, or a number of models.
      exclude: pattern of the names of models that we leave out.
      missing: see `image.missing` of the settings.
      families: whether near-duplicates (`family_of`) share a split; False = the catalogue's splits.
    """

    name: str
    catalogue: str
    views: int
    licences: tuple[Licence, ...] = ()
    package: str = ""
    source: str = ""
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    exclude: str = ""
    missing: float = 0.0
    families: bool = False

    def path(self, packages: str) -> str:
        """The source of the catalogue; `packages` is the folder of the unpacked packages."""
        parts = (packages, self.package) if self.package else ()
        return os.path.join(*parts, self.source)

    def licences_of(self, model_ids: Sequence[str], packages: str) -> list[Licence]:
        """The licence of each model."""
        if self.licences:
            return [next(x for x in self.licences if re.search(x.models, n)) for n in model_ids]
        rows = {printable(row["file"]): row for row in read_index(self.path(packages))}
        return [
            Licence(row.get("licence", "") or "not stated", holders=row.get("author", ""))
            for row in (rows[original_name(name)] for name in model_ids)
        ]


def select(source: Source, packages: str, fraction: float = 1.0, variants: int = 0) -> Catalogue:
    """A catalogue of the models of a source that are in the training set.

    A hash of the names chooses a `fraction` of the models. A larger fraction contains the smaller
    fractions. `open_catalogue.variants_of` describes `variants`. ValueError if the catalogue cannot
    be opened, or no model is left.
    """
    inner = open_catalogue(source.catalogue, source.path(packages), **source.options)
    exclude = source.exclude or "(?!)"  # which matches nothing
    entries = [e for e in inner.models if not re.search(exclude, e.model_id)]
    if not entries:
        raise ValueError(f"source {source.name!r}: no model is left, expected at least 1")
    if source.families:
        entries = [dataclasses.replace(e, split=split_of(family_of(e.model_id))) for e in entries]
    if fraction < 1:
        count = max(3, round(fraction * len(entries)))
        ranked = sorted(entries, key=lambda e: hashlib.sha256(e.model_id.encode()).digest())
        chosen = {e.model_id for e in ranked[:count]}
        entries = [e for e in entries if e.model_id in chosen]
    return variants_of(Catalogue(inner.name, entries), variants)


# --- The sources ------------------------------------------------------------------------------


_OF_MESHES = {
    "collections": ("CC0-*", "CC-BY-?.?*", "MIT", "MIT-0", "Apache-*"),
    "copyleft": ("GPL-*", "AGPL-*", "CC-BY-SA-*"),
}
"""For the sources from an index, patterns of their licences."""

_OURS = (Licence("Apache-2.0", holders="the authors of psgn_jax"),)

_OF_FURNITURE = (
    Licence("CC-BY-3.0", "^Scopia/", "Scopia"),
    Licence("CC-BY-3.0", "^BlendSwap-CC-BY/", "Blend Swap contributors"),
    Licence("CC0-1.0", "^BlendSwap-CC-0/", "Blend Swap contributors"),
    Licence("CC-BY-3.0-US", "^KatorLegaz/", "Kator Legaz"),
    Licence("CC-BY-3.0-US", "^Reallusion/", "Reallusion"),
    Licence("see the package"),
)

SOURCES = {
    source.name: source
    for source in (
        Source(
            "furniture", "sh3f", 12, _OF_FURNITURE, "sweethome3d-furniture",
            "usr/share/sweethome3d", families=True,
            exclude="#(passage-pieton|fleche-|stationnement-)",  # road markings
        ),
        Source("procedural", "procedural", 4, _OURS, source="480"),
        Source("procedural_incomplete", "procedural", 3, _OURS, source="77",
               options={"first_seed": 480}, missing=1.0),
        *(Source(name, "indexed", 14, package=MESHES, options={"licences": licences})
          for name, licences in _OF_MESHES.items()),
    )
}  # fmt: skip
"""All sources, by name."""

OTHER_PRESETS = ("photo", "angles", "level")
"""Presets for a fraction of each model's views. The fractions are flags."""


class Part(NamedTuple):
    """A data set of the training set: a source rendered with a preset."""

    source: Source
    preset: str
    folder: str
    views: int


def plan(chosen: Sequence[Source], fractions: Mapping[str, float] = {}) -> list[Part]:
    """The data sets of a training set, with `fractions` of views by preset, at most 1 in all."""
    if sum(fractions.values()) > 1:
        raise ValueError(f"fractions: got {dict(fractions)}, expected a sum of at most 1")
    parts = []
    for source in chosen:
        views: dict[str, int] = {}
        for name, x in fractions.items():  # the sum of rounded numbers could be too large
            views[name] = min(round(x * source.views), source.views - sum(views.values()))
            if x and not views[name]:
                logging.warning(
                    "--%s=%g of %d views is none: %s", name, x, source.views, source.name
                )
        views["authors"] = source.views - sum(views.values())
        for preset in ("authors", *OTHER_PRESETS):
            folder = source.name if preset == "authors" else f"{preset}/{source.name}"
            if views.get(preset, 0) > 0:
                parts.append(Part(source, preset, folder, views[preset]))
    return parts


def settings_of(
    part: Part, centre: str = "vertices", workers: int = 0, variant: str = "auto"
) -> settings.Settings:
    """The settings of a data set."""
    values = config.get_config(part.preset)
    values.views, values.centre, values.image.missing = part.views, centre, part.source.missing
    if part.preset != "photo":
        # A few samples suffice, because these textures have few texels per pixel.
        values.image.samples = 2
    values.job.workers, values.job.variant = workers, variant
    # The data sets of a source have different cameras.
    values.seed = ("authors", *OTHER_PRESETS).index(part.preset)
    return settings.parse(values)


# --- Packages ---------------------------------------------------------------------------------


def missing(chosen: Sequence[Source], packages: str) -> list[str]:
    """Commands that fetch and unpack missing packages, and a list of missing meshes."""
    lines = []
    for package in dict.fromkeys(s.package for s in chosen if s.package):
        sources = [s for s in chosen if s.package == package]
        if package == MESHES:
            lines += _missing_meshes(pathlib.Path(packages) / MESHES, sources)
        elif any(not os.path.exists(s.path(packages)) for s in sources):
            lines += [
                f"apt-get download {package}",
                f"dpkg-deb -x {package}_*.deb {shlex.quote(str(pathlib.Path(packages) / package))}",
            ]
    return lines


def _missing_meshes(folder: pathlib.Path, sources: Sequence[Source]) -> list[str]:
    """Where to get missing files of a folder of meshes, or its index."""
    if not (folder / INDEX).exists():
        names = ",".join(name for name, s in SOURCES.items() if s.package != MESHES)
        return [
            f"# {folder / INDEX}: an index of your own meshes, with the columns file, category, "
            "licence, author, repository, commit and path; docs/data.md lists free collections "
            f"(--sources={names} does without)"
        ]
    licences = [pattern for source in sources for pattern in source.options["licences"]]
    counts: Counter[tuple[str, str, str]] = Counter()
    for row in read_index(folder, licences):
        if not (folder / row["file"]).exists():
            top = row["file"].partition("/")[0]
            counts[row.get("repository", ""), row.get("commit", ""), top] += 1
    lines = []
    for (repository, commit, top), count in counts.items():
        clone = shlex.join(["git", "clone", f"https://github.com/{repository}"]) + " && "
        clone += shlex.join(["git", "-C", repository.rpartition("/")[2], "checkout", commit]) + "  "
        lines.append(f"{clone if repository else ''}# {count} files of {folder / top}")
    return lines


def with_meshes(chosen: Sequence[Source], packages: str) -> list[Source]:
    """The sources with models in the index. Warnings name what we leave out."""
    of_index = [source for source in chosen if source.package == MESHES]
    rows = read_index(pathlib.Path(packages) / MESHES) if of_index else []
    counts = Counter(row.get("licence", "") for row in rows)
    for name, count in counts.items():
        if not any(fits(name, patterns) for patterns in _OF_MESHES.values()):
            logging.warning("left out: %d meshes with the licence %r", count, name)
    empty = [s for s in of_index if not any(fits(name, s.options["licences"]) for name in counts)]
    for source in empty:
        logging.warning("left out: source %s: no mesh has one of its licences", source.name)
    return [source for source in chosen if source not in empty]


def _documents_of(packages: str, package: str) -> tuple[str, str]:
    """Version and copyright statement of a package; "" = missing."""
    folder = pathlib.Path(packages) / package / "usr/share/doc" / package
    version = terms = ""
    with contextlib.suppress(OSError):
        terms = (folder / "copyright").read_text("utf-8", "replace")
    log = folder / "changelog.Debian.gz"
    with contextlib.suppress(OSError, EOFError), gzip.open(log, "rb") as stream:
        match = re.match(rb"\S+ \(([^)]+)\)", stream.read(300))
        version = match[1].decode("utf-8", "replace") if match else ""
    return version, terms


# --- The table --------------------------------------------------------------------------------


def _reason(text: str) -> str:
    """A reason without names and numbers, so that we can count equal reasons."""
    text = re.sub(r"'[^']*'|\"[^\"]*\"", "...", text)
    return re.sub(r"-?\d+(\.\d+)?(e[+-]?\d+)?", "N", text)[:120]


def _row(
    source: Source, lines: Sequence[Mapping[str, Any]], packages: str, folders: Sequence[str]
) -> dict[str, Any]:
    """The row of a source, from the lines of `models.jsonl` of its data sets."""
    good = {line["model_id"]: line for line in lines if line["status"] == "ok"}
    bad = {x["model_id"]: x for x in lines if x["model_id"] not in good}
    refused = Counter(_reason(line["reason"]) for line in bad.values())
    licences: dict[str, dict[str, Any]] = {}
    for licence in source.licences_of(list(good), packages):
        counted = licences.setdefault(licence.name, {"models": 0, "holders": []})
        counted["models"] += 1
        if licence.holders and licence.holders not in counted["holders"]:
            counted["holders"].append(licence.holders)
    families = {family_of(original_name(n)) for n in good} if source.families else ()
    return {
        "source": source.name,
        "package": source.package,
        "version": _documents_of(packages, source.package)[0] if source.package else "",
        "folders": list(folders),
        "models": len(good),
        "families": len(families) or None,
        "images": sum(line["samples"] for line in lines),
        "splits": dict(Counter(line["split"] for line in good.values())),
        "refused": dict(refused.most_common()),
        "licences": licences,
    }


def _markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table as Markdown."""
    out = [
        "# Sources of this training set",
        "",
        "Distribute this table with the set and with weights trained on it. The copyright files of "
        "the packages are in `licences/`.",
        "",
        "| source | package | models | images | refused | licence | by |",
        "|---|---|---|---|---|---|---|",
    ]
    for each in rows:
        package = f"{each['package']} {each['version']}".strip() or "none"
        terms = each["licences"]
        names = "; ".join(f"{n} ({x['models']})" for n, x in sorted(terms.items()))
        holders = "; ".join(dict.fromkeys(h for x in terms.values() for h in x["holders"]))
        out.append(
            f"| {each['source']} | {package} | {each['models']} | {each['images']} | "
            f"{sum(each['refused'].values())} | {names} | {holders} |"
        )
    total = {k: sum(r[k] for r in rows) for k in ("models", "images")}
    out.append(f"| all | | {total['models']} | {total['images']} | | | |")
    if refused := [(r["source"], text, n) for r in rows for text, n in r["refused"].items()]:
        out += ["", "Refused models, by reason (N stands for any number):", ""]
        out += [f"- {source}: {count} x {text}" for source, text, count in refused]
    return "\n".join(out) + "\n"


def write_table(
    out: pathlib.Path, parts: Sequence[Part], packages: str, lines: Mapping[str, Sequence[Any]]
) -> str:
    """Writes `SOURCES.md`, `sources.json` and the copyright statements; returns `SOURCES.md`.

    `lines` are the lines of `models.jsonl` by folder of the data set. Data sets of earlier calls
    stay in the table.
    """
    table = out / "sources.json"
    rows: dict[str, Any] = {}
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):  # missing or damaged
        for row in json.loads(table.read_text()):
            if any((out / folder).exists() for folder in row["folders"]):
                rows[row["source"]] = row
    for source in {part.source.name: part.source for part in parts}.values():
        if folders := [p.folder for p in parts if p.source is source and p.folder in lines]:
            old = [f for f in rows.get(source.name, {}).get("folders", ()) if f not in folders]
            stored = {f: read_report(out / f) for f in old if (out / f / job.REPORT).exists()}
            every = {f: lines[f] for f in folders} | stored
            reports = [line for own in every.values() for line in own]
            rows[source.name] = _row(source, reports, packages, list(every))
            if text := _documents_of(packages, source.package)[1]:
                write_atomic(out / "licences" / f"{source.package}.txt", text)
    text = _markdown(list(rows.values()))
    write_atomic(table, json.dumps(list(rows.values()), indent=1) + "\n")
    write_atomic(out / "SOURCES.md", text)
    return text


# --- The command ------------------------------------------------------------------------------


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit code."""
    flags = Flags("python scripts/free_set.py --packages=FOLDER", __doc__)
    flags.path("packages", None, "Folder of the unpacked packages.")
    flags.path("out", None, "Folder of the training set.")
    flags.list("sources", [], f"Names of sources, of {', '.join(SOURCES)}; empty = all.")
    share = {"lower_bound": 0.0, "upper_bound": 1.0}
    flags.float("fraction", 1.0, "Fraction of each source's models, at least 3 models.", **share)
    for name in OTHER_PRESETS:
        flags.float(name, 0.0, f"Fraction of the views rendered with the preset {name}.", **share)
    flags.enum(
        "centre", "vertices", ["bounds", "vertices"], "Point of a model that moves to x = y = 0."
    )
    flags.integer("workers", 0, "Number of processes; 0 = the number of cores.", lower_bound=0)
    flags.enum("variant", "auto", ["auto", "llvm", "scalar"], "Variant of Mitsuba.")
    flags.integer(
        "variants", 0, "Number of variants that replace each model; 0 = none.", lower_bound=0
    )
    flags.bool("check", False, "Report missing packages and the numbers of models; render nothing.")
    return flags.run(_main, argv, wrong_input=(ValueError, RuntimeError))


def _main(flags: Flags) -> int:
    exit_on_signals()
    given = flags.values
    if not given.check:
        if given.out is None:
            raise ValueError("--out is missing")
        check_folder(given.out, "--out")
    if unknown := [name for name in given.sources if name not in SOURCES]:
        raise ValueError(f"--sources: got {unknown[0]!r}, expected some of {list(SOURCES)}")
    chosen = [s for name, s in SOURCES.items() if not given.sources or name in given.sources]
    if commands := missing(chosen, given.packages):
        lines = ["error: sources are missing; get them with these commands:", *commands]
        sys.stderr.write("\n  ".join(lines) + "\n")
        return Exit.ERROR
    chosen = with_meshes(chosen, given.packages)
    parts = plan(chosen, {preset: given[preset].value for preset in OTHER_PRESETS})
    made, problems = _render(parts, given)
    if given.check:
        return 0
    sys.stdout.write("\n".join(["", *problems, ""]))
    if not made:
        raise ValueError("no data set was made")
    paths = shlex.quote(",".join(str(pathlib.Path(given.out) / folder) for folder in made))
    sys.stdout.write(f"--config.data.path={paths}\n")
    return Exit.PARTLY if problems else Exit.DONE


def _render(parts: Sequence[Part], given: Any) -> tuple[list[str], list[str]]:
    """Renders the data sets, and writes the table after each. With `--check`, it counts models.

    Returns the folders of the data sets, and a line for each data set that failed.
    """
    lines: dict[str, Sequence[Any]] = {}
    problems = []
    text, count = "", 0
    for number, part in enumerate(parts, 1):
        try:
            models = select(part.source, given.packages, given.fraction, given.variants)
            count += len(models.models) * part.views
            what = f"{part.folder}: {len(models.models)} models, {part.views} views"
            if given.check:
                sys.stdout.write(f"{what}\n")
                continue
            logging.info("%d of %d: %s", number, len(parts), what)
            options = settings_of(part, given.centre, given.workers, given.variant)
            out = pathlib.Path(given.out)
            done = job.render_catalogue(models, out / part.folder, options)
            if not done.samples:
                raise ValueError(f"no model has samples, see {out / part.folder / job.REPORT}")
            lines[part.folder] = done.lines
            text = write_table(out, parts, given.packages, lines)
        except (ValueError, OSError) as error:
            if is_disk_full(error):
                raise
            problems.append(f"not made: {part.folder}: {message_line(error)}")
            logging.error("%s", problems[-1])
    sys.stdout.write(f"{count} images\n" if given.check else text)
    return list(lines), problems


if __name__ == "__main__":
    start_command()
    sys.exit(main())
