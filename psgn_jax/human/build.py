"""Builds the page of a study: one HTML file that contains its scripts, images and cameras.

Browsers refuse to load JavaScript modules for a page that is opened as a file. Therefore the page
has one script, in which each module is a function that returns the module's exports.
"""

import os
import pathlib
import re
from typing import Any

from psgn_jax.data.dataset import open_split
from psgn_jax.data.schema import Sample
from psgn_jax.files import check_folder, write_atomic
from psgn_jax.human.records import (
    STUDY_FILE,
    CaseRecord,
    StudyFile,
    checksum,
    choose,
)
from psgn_jax.viewing.page import picture_uri, to_json

STATIC = pathlib.Path(__file__).resolve().parent / "static"
MODULES = (
    "geometry",
    "study",
    "camera",
    "render",
    "handles",
    "outline",
    "view",
    "inspector",
    "app",
)
"""Modules in the order of the script; each imports only from those before it."""

PAGE = "index.html"

_IMPORT = re.compile(r'^import (\{[^}]+\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:const|class|function) (\w+))", re.MULTILINE)


def build_study(
    data: str,
    out: str | os.PathLike[str],
    *,
    split: str = "validation",
    cases: int = 16,
) -> pathlib.Path:
    """Writes the page and `study.json`; returns the page.

    The page contains the images and the cameras. It contains neither points nor the names and
    categories of the objects.

    Args:
      data: folders of records, separated by commas.
      out: folder, created if missing.
      split: split of the records.
      cases: number of cases, evenly spaced over the split.

    Raises:
      ConfigError: the split has fewer records, or `cases` is out of range.
      UserError: `out` is not a folder for files.
      RecordError: the records cannot be read.
    """
    out = pathlib.Path(out)
    check_folder(out, "--out")
    reader = open_split(data.split(","), split)
    numbers = choose(reader, cases)
    samples = [reader[number] for number in numbers]
    records = tuple(
        CaseRecord(f"Case {i}", number, sample.model_id, sample.view)
        for i, (number, sample) in enumerate(zip(numbers, samples, strict=True), 1)
    )
    study = StudyFile("psgn human study", 1, checksum(samples), data, split, records)
    write_atomic(out / STUDY_FILE, study.text())
    write_atomic(out / PAGE, page_text(study, samples))
    return out / PAGE


def page_text(study: StudyFile, samples: list[Sample]) -> str:
    """The page as text."""
    cases = [
        _case(record.name, sample) for record, sample in zip(study.cases, samples, strict=True)
    ]
    pieces = {
        "STYLE": (STATIC / "style.css").read_text("utf-8"),
        "DATA": to_json({"id": study.id, "cases": cases}),
        "SCRIPT": script(),
    }
    template = (STATIC / "index.html").read_text("utf-8")
    return re.sub(r"/\*(STYLE|DATA|SCRIPT)\*/", lambda match: pieces[match[1]], template)


def script() -> str:
    """All modules as one script."""
    return '"use strict";\nconst modules = {};\n' + "".join(map(_module, MODULES))


def _module(name: str) -> str:
    text = (STATIC / f"{name}.js").read_text("utf-8")
    exported = ", ".join(_EXPORT.findall(text))
    text = _IMPORT.sub(lambda match: f"const {match[1]} = modules.{match[2]};", text)
    return (
        f"modules.{name} = (() => {{\n{_EXPORT.sub('', text)}\nreturn {{ {exported} }};\n}})();\n"
    )


def _case(name: str, sample: Sample) -> dict[str, Any]:
    height, width = sample.image.shape[:2]
    return {
        "name": name,
        "image": picture_uri(sample.image),
        "width": width,
        "height": height,
        "intrinsics": sample.intrinsics.ravel().tolist(),
        "extrinsics": sample.extrinsics.ravel().tolist(),
    }
