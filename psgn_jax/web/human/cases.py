"""The files of a study: the page, `study.json` with its cases, and the saved models."""

import dataclasses
import hashlib
import json
import os
import pathlib
from typing import Annotated, Literal, TypeVar

import numpy as np

from psgn_jax.config import structured
from psgn_jax.config.experiment import ConfigError
from psgn_jax.config.structured import Bounds, Count
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.schema import Sample
from psgn_jax.system.files import check_folder, write_atomic
from psgn_jax.system.untrusted import message_line, one_line, read_json
from psgn_jax.viewing.viewer import document, picture_uri, to_json

STATIC = pathlib.Path(__file__).resolve().parent / "static"
PAGE, STUDY_FILE = "index.html", "study.json"
ANSWERS_FILE = "human.json"
"""The file that the page saves."""

MAX_CASES, MAX_SOLIDS = 200, 800

Coordinate = Annotated[float, Bounds(low=-20, high=20)]
Seconds = Annotated[float, Bounds(low=0, high=1e8)]
T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class CaseRecord:
    """The record of a case."""

    name: str  # on the page
    record: Count  # number in the split
    model_id: str
    view: Count


@dataclasses.dataclass(frozen=True)
class StudyFile:
    """The content of `study.json`; it contains no points."""

    format: Literal["psgn human study"]
    version: Annotated[int, Bounds(low=1, high=1)]
    id: str  # checksum of images and cameras, also in the page and in the saved models
    data: str  # folders of records, separated by commas
    split: str
    cases: tuple[CaseRecord, ...]  # in the order of the page


@dataclasses.dataclass(frozen=True)
class Answer:
    """The model of one case."""

    case: str
    seconds: Seconds  # time that the person spent
    done: bool
    parts: Count  # number of parts; a part has up to three mirrored copies
    # Corners of all convex parts and copies, in the project's frame.
    solids: tuple[tuple[tuple[Coordinate, Coordinate, Coordinate], ...], ...]
    model: str = ""  # for the page


@dataclasses.dataclass(frozen=True)
class AnswersFile:
    """The content of `human.json`."""

    format: Literal["psgn human study"]
    version: Annotated[int, Bounds(low=1, high=1)]
    study: str  # `StudyFile.id`
    cases: tuple[Answer, ...]


def build_study(
    data: str, out: str | os.PathLike[str], *, split: str = "validation", cases: int = 16
) -> pathlib.Path:
    """Writes the page, an HTML file, and `study.json`; returns the path of the page.

    The page has images and cameras, but not the objects' points, names or categories.
    """
    out = pathlib.Path(out)
    check_folder(out, "out")
    reader = RecordReader(data.split(","), split)
    available = min(len(reader), MAX_CASES)
    if not 1 <= cases <= available:
        raise ConfigError(
            f"cases={cases}: the split has {len(reader)} records; accepted: 1 to {available}"
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
    text = to_json({"id": study.id, "cases": shown})
    script = (STATIC / "app.js").read_text("utf-8")
    write_atomic(out / STUDY_FILE, json.dumps(dataclasses.asdict(study), indent=1) + "\n")
    write_atomic(out / PAGE, document(STATIC / PAGE, text, SCRIPT=script))
    return out / PAGE


def _checksum(samples: list[Sample]) -> str:
    digest = hashlib.sha256()
    for sample in samples:
        for array in (sample.image, sample.intrinsics, sample.extrinsics):
            digest.update(f"{array.dtype} {array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _read(kind: type[T], path: pathlib.Path, missing: str, damaged: str) -> T:
    shown = one_line(path)
    try:
        return structured.build(kind, read_json(path))
    except FileNotFoundError:
        raise ConfigError(f"{shown}: no such file; {missing}") from None
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise ConfigError(f"{shown}: {message_line(error)[:300]}; {damaged}") from None


def read_study(folder: str | os.PathLike[str]) -> StudyFile:
    """Reads `study.json`; `ConfigError` if it is missing, damaged or another file."""
    path = pathlib.Path(folder) / STUDY_FILE
    return _read(StudyFile, path, "expected a folder of `psgn human`", "write the study again")


def open_cases(study: StudyFile, data: str = "") -> list[Sample]:
    """The records of a study, in `data` or the folder from which the page was written.

    Raises:
      ConfigError: the records differ from the page's.
      RecordError: they cannot be read.
    """
    reader = RecordReader((data or study.data).split(","), study.split)
    samples = [reader[case.record] for case in study.cases if case.record < len(reader)]
    if _checksum(samples) != study.id:
        raise ConfigError(
            f"data={data or study.data}: images or cameras differ from those of the study; "
            "expected the records from which the study was written"
        )
    return samples


def read_answers(path: str | os.PathLike[str], study: StudyFile) -> tuple[Answer, ...]:
    """The models of all cases, in the order of the study, from an untrusted file.

    Raises:
      ConfigError: it is missing, damaged or of another study, or has values out of bounds.
    """
    answers = _read(
        AnswersFile,
        pathlib.Path(path),
        "press `Save all` in the page and move human.json there, or name another file (`answers`)",
        "expected the file that the page saves",
    )
    shown = one_line(path)
    if answers.study != study.id:
        raise ConfigError(
            f"{shown}: saved for the study {one_line(answers.study)[:40]!r}, expected {study.id!r}"
        )
    names = [case.name for case in study.cases]
    if [answer.case for answer in answers.cases] != names:
        raise ConfigError(f"{shown}: expected the {len(names)} cases of the study, each once")
    for answer in answers.cases:
        if len(answer.solids) > MAX_SOLIDS:
            raise ConfigError(
                f"{shown}: {answer.case} has {len(answer.solids)} solids, expected at most "
                f"{MAX_SOLIDS}"
            )
    return answers.cases
