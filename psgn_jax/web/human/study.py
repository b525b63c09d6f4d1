"""The files of a study: the page, `study.json`, which lists its cases, and the saved models."""

import dataclasses
import hashlib
import json
import os
import pathlib
import re
from typing import Annotated, Literal

import numpy as np

from psgn_jax.config import structured
from psgn_jax.config.experiment import ConfigError
from psgn_jax.config.structured import Bounds, Count, Fraction
from psgn_jax.data.dataset import open_split
from psgn_jax.data.schema import Sample
from psgn_jax.system.errors import UserError
from psgn_jax.system.files import check_folder, write_atomic
from psgn_jax.system.untrusted import message_line, one_line, read_json
from psgn_jax.viewing.page import picture_uri, to_json

STATIC = pathlib.Path(__file__).resolve().parent / "static"
PAGE, STUDY_FILE = "index.html", "study.json"
ANSWERS_FILE = "human.json"
"""The name under which the page saves its models."""

MAX_CASES, MAX_PARTS = 200, 200
_MAX_BYTES = 20_000_000

Version = Annotated[int, Bounds(low=1, high=1)]
Place = Annotated[float, Bounds(low=-4, high=4)]
Extent = Annotated[float, Bounds(low=0.002, high=8)]
Degrees = Annotated[float, Bounds(low=-360, high=360)]
Middle = Annotated[float, Bounds(low=-2, high=2)]
Seconds = Annotated[float, Bounds(low=0, high=1e8)]
Sides = Annotated[int, Bounds(low=3, high=12)]


class AnswersError(UserError):
    """The file of models cannot be used."""


@dataclasses.dataclass(frozen=True)
class CaseRecord:
    """The record of a case: name on the page, number in the split, object and view."""

    name: str
    record: Count
    model_id: str
    view: Count


@dataclasses.dataclass(frozen=True)
class StudyFile:
    """The content of `study.json`; it contains no points.

    Attributes:
      format: always "psgn human study".
      version: version of the format.
      id: checksum of the images and cameras, which is also in the page and in the saved models.
      data: folders of records, separated by commas.
      split: split of the records.
      cases: in the order of the page.
    """

    format: Literal["psgn human study"]
    version: Version
    id: str
    data: str
    split: str
    cases: tuple[CaseRecord, ...]


@dataclasses.dataclass(frozen=True)
class Part:
    """A primitive and its symmetric copies, in the object's frame (see `Answer`).

    Attributes:
      kind: the primitive.
      size: extents along its own axes.
      at: position of its centre.
      turn: angles a, b, c in degrees; its rotation is Rz(c) Ry(b) Rx(a).
      mirror: "x", "y" or "xy": copies with the opposite signs of these coordinates; "" = none.
      taper: scale of the upper end, 0 = a tip.
      sides: number of sides of a prism.
    """

    kind: Literal["box", "cylinder", "cone", "sphere", "prism"]
    size: tuple[Extent, Extent, Extent]
    at: tuple[Place, Place, Place]
    turn: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    mirror: Literal["", "x", "y", "xy"] = ""
    taper: Fraction = 1.0
    sides: Sides = 3


@dataclasses.dataclass(frozen=True)
class Answer:
    """The model of one case.

    Attributes:
      case: name of the case.
      seconds: time that the person spent on it.
      done: whether the person marked it as done.
      turn: rotation of the object's x axis about the vertical, degrees. The object's frame is the
        project's frame, rotated by this angle and moved by (x, y, 0).
      x: see `turn`; unit of the frame.
      y: see `turn`; unit of the frame.
      parts: the primitives; none if the case was not modelled.
    """

    case: str
    seconds: Seconds
    done: bool
    turn: Degrees
    x: Middle
    y: Middle
    parts: tuple[Part, ...]


@dataclasses.dataclass(frozen=True)
class AnswersFile:
    """The file of models; `study` is the id of the study that it belongs to."""

    format: Literal["psgn human study"]
    version: Version
    study: str
    cases: tuple[Answer, ...]


def build_study(
    data: str, out: str | os.PathLike[str], *, split: str = "validation", cases: int = 16
) -> pathlib.Path:
    """Writes the page, one HTML file, and `study.json`; returns the page.

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
    available = min(len(reader), MAX_CASES)
    if not 1 <= cases <= available:
        raise ConfigError(
            f"--cases={cases}: the split has {len(reader)} records; accepted: 1 to {available}"
        )
    # The middles of equal parts of the split.
    numbers = [int((2 * i + 1) * len(reader) / (2 * cases)) for i in range(cases)]
    samples = [reader[number] for number in numbers]
    records = tuple(
        CaseRecord(f"Case {i}", number, sample.model_id, sample.view)
        for i, (number, sample) in enumerate(zip(numbers, samples, strict=True), 1)
    )
    study = StudyFile("psgn human study", 1, _checksum(samples), data, split, records)
    shown = [
        {
            "name": record.name,
            "image": picture_uri(sample.image),
            "width": sample.image.shape[1],
            "height": sample.image.shape[0],
            "intrinsics": sample.intrinsics.ravel().tolist(),
            "extrinsics": sample.extrinsics.ravel().tolist(),
        }
        for record, sample in zip(records, samples, strict=True)
    ]
    pieces = {
        "STYLE": (STATIC / "style.css").read_text("utf-8"),
        "DATA": to_json({"id": study.id, "cases": shown}),
        "SCRIPT": (STATIC / "page.js").read_text("utf-8"),
    }
    template = (STATIC / "index.html").read_text("utf-8")
    page = re.sub(r"/\*(STYLE|DATA|SCRIPT)\*/", lambda match: pieces[match[1]], template)
    write_atomic(out / STUDY_FILE, json.dumps(dataclasses.asdict(study), indent=1) + "\n")
    write_atomic(out / PAGE, page)
    return out / PAGE


def _checksum(samples: list[Sample]) -> str:
    """16 hexadecimal digits of a hash of the images and cameras of a study."""
    digest = hashlib.sha256()
    for sample in samples:
        for array in (sample.image, sample.intrinsics, sample.extrinsics):
            digest.update(f"{array.dtype} {array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def read_study(folder: str | os.PathLike[str]) -> StudyFile:
    """Reads `study.json`.

    Raises:
      ConfigError: it is missing, damaged or not written by `psgn human`.
    """
    path = pathlib.Path(folder) / STUDY_FILE
    try:
        return structured.build(StudyFile, read_json(path, max_bytes=_MAX_BYTES))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; expected a folder of `psgn human`") from None
    except (OSError, ValueError, TypeError) as error:
        raise ConfigError(
            f"{path} is damaged ({message_line(error)}); write the study again"
        ) from None


def open_cases(study: StudyFile, data: str = "") -> list[Sample]:
    """The records of a study, from `data` or from where they were when the page was written.

    Raises:
      ConfigError: the records are not those of the study.
      RecordError: they cannot be read.
    """
    reader = open_split((data or study.data).split(","), study.split)
    samples = [reader[case.record] for case in study.cases if case.record < len(reader)]
    if _checksum(samples) != study.id:
        raise ConfigError(
            f"--data={data or study.data}: images or cameras differ from those of the study; "
            "expected the records from which the study was written"
        )
    return samples


def read_answers(path: str | os.PathLike[str], study: StudyFile) -> tuple[Answer, ...]:
    """The models of all cases, in the order of the study. The file is not trusted.

    Raises:
      AnswersError: the file is missing or damaged, belongs to another study, or has values out of
        bounds.
    """
    shown = one_line(path)
    try:
        answers = structured.build(AnswersFile, read_json(path, max_bytes=_MAX_BYTES))
    except FileNotFoundError:
        raise AnswersError(
            f"{shown}: no such file; press `Save all` in the page and move human.json there, or "
            "give --answers=FILE"
        ) from None
    except (OSError, ValueError, TypeError, RecursionError) as error:
        why = message_line(error)[:300]
        raise AnswersError(f"{shown}: {why}; expected the file that the page saves") from None
    if answers.study != study.id:
        raise AnswersError(
            f"{shown}: saved for the study {one_line(answers.study)[:40]!r}, expected {study.id!r}"
        )
    names = [case.name for case in study.cases]
    if [answer.case for answer in answers.cases] != names:
        raise AnswersError(f"{shown}: expected the {len(names)} cases of the study, each once")
    for answer in answers.cases:
        if len(answer.parts) > MAX_PARTS:
            raise AnswersError(
                f"{shown}: {answer.case} has {len(answer.parts)} parts, expected at most "
                f"{MAX_PARTS}"
            )
    return answers.cases
