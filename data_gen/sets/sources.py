"""Sources of a training set: their models, splits and licences."""

import contextlib
import dataclasses
import gzip
import hashlib
import os
import pathlib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from data_gen.catalogues.by_name import open_catalogue, variants_of
from data_gen.catalogues.entry import Catalogue, original_name, split_of

_COLOURS = (
    "white|black|red|green|blue|yellow|grey|gray|brown|beige|orange|pink|purple|gold|silver|dark"
    "|light|clear"
)

_ENDINGS = re.compile(
    rf"([-_ .]?(lod[-_]?\d*|(low|high|hi)[-_]?(poly|res)|{_COLOURS})"
    r"|[-_ .]+(\d{1,3}|[a-z])|(?<=[a-z]{3})\d{1,2}|\(\d+\))$"
)


def family_of(model_id: str) -> str:
    """The common part of the names of near-duplicates.

    It is the name without folders, suffix and livery (after a colon), and without numbers, colours
    and levels of detail at its end: `Models/farmhouse2-white.ac` and `farmhouse4.ac` are in the
    family "farmhouse", `A320/Models/A320.ac:AirFrance` is in the family "a320".
    """
    name = model_id.rpartition("/")[2].rpartition("#")[2].split(":")[0].casefold()
    stem = re.sub(r"\.[a-z]{1,4}$", "", name)
    while True:
        shorter = _ENDINGS.sub("", stem)
        if len(shorter) < 2 or shorter == stem:
            return stem
        stem = shorter


@dataclasses.dataclass(frozen=True)
class Licence:
    """The licence of some models.

    Attributes:
      name: SPDX identifier of the licence if there is one, else its name.
      models: pattern of the names of the models, "" = all that no earlier pattern matches.
      holders: the copyright holders to be named.
    """

    name: str
    models: str = ""
    holders: str = ""


@dataclasses.dataclass(frozen=True)
class Source:
    """A source of a training set.

    Attributes:
      name: name of the source and of its folder in the training set.
      catalogue: one of `by_name.CATALOGUES`.
      views: number of images of each model.
      licences: licences of its models; the first one with a matching pattern counts.
      package: name of the Debian package, "" = none is needed.
      place: source of the catalogue: a path in the unpacked package, or a number of models.
      options: options of the catalogue.
      exclude: pattern of the names of models that are left out.
      missing: fraction of the models that are rendered without some of their faces, see
        `data_gen.render_model.without_faces`.
      families: models of a family are in the same split. "name": the family is `family_of(name)`;
        "folder": the family is the first folder of the name; "": no families, the catalogue decides
        the split.
    """

    name: str
    catalogue: str
    views: int
    licences: tuple[Licence, ...]
    package: str = ""
    place: str = ""
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    exclude: str = ""
    missing: float = 0.0
    families: str = "name"

    def path(self, packages: str | os.PathLike[str]) -> str:
        """The source of the catalogue, given the folder of the unpacked packages."""
        return (
            str(pathlib.Path(packages) / self.package / self.place) if self.package else self.place
        )

    def family(self, model_id: str) -> str:
        """The family of a model, "" if the catalogue decides the split."""
        if not self.families:
            return ""
        return family_of(model_id.split("/")[0] if self.families == "folder" else model_id)

    def licence_of(self, model_id: str) -> Licence:
        """The licence of a model."""
        return next(x for x in self.licences if re.search(x.models, model_id))


def select(
    source: Source, packages: str | os.PathLike[str], fraction: float = 1.0, variants: int = 0
) -> Catalogue:
    """A catalogue of the models of a source that are in the training set.

    Args:
      source: the source.
      packages: folder of the unpacked packages.
      fraction: fraction of the models, chosen by a hash of the name. A larger fraction contains the
        smaller ones.
      variants: see `by_name.variants_of`; a variant has the split of its model.

    Raises:
      ValueError: the catalogue cannot be opened, or no model is left.
    """
    inner = open_catalogue(source.catalogue, source.path(packages), **source.options)
    entries = [
        e for e in inner.entries()
        if not source.exclude or not re.search(source.exclude, e.model_id)
    ]  # fmt: skip
    if not entries:
        raise ValueError(f"source {source.name!r}: no model is left, expected at least 1")
    if source.families:
        entries = [
            dataclasses.replace(e, split=split_of(source.family(e.model_id))) for e in entries
        ]
    if fraction < 1:
        count = max(3, round(fraction * len(entries)))
        ranked = sorted(entries, key=lambda e: hashlib.sha256(e.model_id.encode()).digest())
        chosen = {e.model_id for e in ranked[:count]}
        entries = [e for e in entries if e.model_id in chosen]
    return variants_of(Catalogue(inner.name, entries), variants)


# --- Packages ---------------------------------------------------------------------------------


def missing(sources: Sequence[Source], packages: str | os.PathLike[str]) -> list[str]:
    """Commands that fetch and unpack the missing packages."""
    lines = []
    for package in dict.fromkeys(s.package for s in sources if s.package):
        if any(not os.path.exists(s.path(packages)) for s in sources if s.package == package):
            lines += [
                f"apt-get download {package}",
                f"dpkg-deb -x {package}_*.deb {pathlib.Path(packages) / package}",
            ]
    return lines


def documents_of(packages: str | os.PathLike[str], package: str) -> tuple[str, str]:
    """Version and copyright statement of a package; "" if one is missing."""
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
    """A reason for a refusal without names and numbers, so that equal reasons can be counted."""
    text = re.sub(r"'[^']*'|\"[^\"]*\"", "...", text)
    return re.sub(r"-?\d+(\.\d+)?(e[+-]?\d+)?", "N", text)[:120]


def row(
    source: Source,
    lines: Sequence[Mapping[str, Any]],
    packages: str | os.PathLike[str],
    folders: Sequence[str],
) -> dict[str, Any]:
    """The row of a source in the table, from the lines of `models.jsonl` of all its data sets."""
    good = {line["model_id"]: line for line in lines if line["status"] == "ok"}
    bad = {x["model_id"]: x for x in lines if x["model_id"] not in good}
    refused = Counter(_reason(line["reason"]) for line in bad.values())
    licences: dict[str, dict[str, Any]] = {}
    for licence in map(source.licence_of, good):
        counted = licences.setdefault(licence.name, {"models": 0, "holders": []})
        counted["models"] += 1
        if licence.holders and licence.holders not in counted["holders"]:
            counted["holders"].append(licence.holders)
    families = {source.family(original_name(n)) for n in good} - {""}
    return {
        "source": source.name,
        "package": source.package,
        "version": documents_of(packages, source.package)[0] if source.package else "",
        "folders": list(folders),
        "models": len(good),
        "families": len(families) or None,
        "images": sum(line["samples"] for line in lines),
        "splits": dict(Counter(line["split"] for line in good.values())),
        "refused": dict(refused.most_common()),
        "licences": licences,
    }


def markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table as Markdown, to be distributed with the set and with weights trained on it."""
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
        names = "; ".join(f"{n} ({x['models']})" for n, x in sorted(each["licences"].items()))
        holders = "; ".join(
            dict.fromkeys(h for x in each["licences"].values() for h in x["holders"])
        )
        out.append(
            f"| {each['source']} | {package} | {each['models']} | {each['images']} | "
            f"{sum(each['refused'].values())} | {names} | {holders} |"
        )
    total = {k: sum(r[k] for r in rows) for k in ("models", "images")}
    out.append(f"| all | | {total['models']} | {total['images']} | | | |")
    refused = [(r["source"], text, n) for r in rows for text, n in r["refused"].items()]
    if refused:
        out += ["", "Refused models, by reason (N stands for any number):", ""]
        out += [f"- {source}: {count} x {text}" for source, text, count in refused]
    return "\n".join(out) + "\n"
