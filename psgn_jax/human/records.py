"""The cases of a study: the choice of records, and the file `study.json` that lists them."""

import dataclasses
import hashlib
import json
import os
import pathlib
from typing import Annotated, Literal

import numpy as np

from psgn_jax import structured
from psgn_jax.config import ConfigError
from psgn_jax.data.dataset import JoinedReader, RecordReader, open_split
from psgn_jax.data.schema import Sample
from psgn_jax.structured import Bounds, Count
from psgn_jax.untrusted import message_line, read_json

STUDY_FILE = "study.json"
ANSWERS_FILE = "human.json"
"""The name under which the page saves its models."""

MAX_CASES = 200
_MAX_BYTES = 1 << 20


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
      id: checksum of the cases, which is also in the page and in the saved models.
      data: folders of records, separated by commas.
      split: split of the records.
      cases: in the order of the page.
    """

    format: Literal["psgn human study"]
    version: Annotated[int, Bounds(low=1, high=1)]
    id: str
    data: str
    split: str
    cases: tuple[CaseRecord, ...]

    def text(self) -> str:
        """The content of the file."""
        return json.dumps(dataclasses.asdict(self), indent=1) + "\n"


def choose(reader: RecordReader | JoinedReader, count: int) -> list[int]:
    """Numbers of `count` records, evenly spaced over a split.

    Raises:
      ConfigError: the split has fewer records, or `count` is out of range.
    """
    available = min(len(reader), MAX_CASES)
    if not 1 <= count <= available:
        raise ConfigError(
            f"--cases={count}: the split has {len(reader)} records; accepted: 1 to {available}"
        )
    # The middles of equal parts.
    return [int((2 * i + 1) * len(reader) / (2 * count)) for i in range(count)]


def checksum(samples: list[Sample]) -> str:
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
        study = structured.build(StudyFile, read_json(path, max_bytes=_MAX_BYTES))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; expected a folder of `psgn human`") from None
    except (OSError, ValueError, TypeError) as error:
        raise ConfigError(
            f"{path} is damaged ({message_line(error)}); write the study again"
        ) from None
    if not 1 <= len(study.cases) <= MAX_CASES:
        raise ConfigError(f"{path}: {len(study.cases)} cases, expected 1 to {MAX_CASES}")
    return study


def open_cases(study: StudyFile, data: str = "") -> list[Sample]:
    """The records of a study, from `data` or from where they were when the page was written.

    Raises:
      ConfigError: the records are not those of the study.
      RecordError: they cannot be read.
    """
    reader = open_split((data or study.data).split(","), study.split)
    samples = []
    for case in study.cases:
        if case.record >= len(reader):
            raise ConfigError(
                f"--data={data or study.data}: split {study.split!r} has {len(reader)} records, "
                f"{case.name} is number {case.record}; expected the records of the study"
            )
        samples.append(reader[case.record])
    if checksum(samples) != study.id:
        raise ConfigError(
            f"--data={data or study.data}: images or cameras differ from those of the study; "
            "expected the records from which the study was written"
        )
    return samples
