"""Reads the file of models that the page saves. The file is not trusted."""

import dataclasses
import os
from typing import Annotated, Literal

from psgn_jax import structured
from psgn_jax.config import UserError
from psgn_jax.human.records import StudyFile
from psgn_jax.human.solids import area, crosses_itself, triangulate
from psgn_jax.structured import Bounds, Fraction
from psgn_jax.untrusted import message_line, one_line, read_json

MAX_PARTS, MAX_CORNERS = 200, 64
_MAX_BYTES = 20_000_000

Place = Annotated[float, Bounds(low=-4, high=4)]
Extent = Annotated[float, Bounds(low=0.002, high=8)]
Degrees = Annotated[float, Bounds(low=-360, high=360)]
Middle = Annotated[float, Bounds(low=-2, high=2)]
Corner = Annotated[float, Bounds(low=-0.5, high=0.5)]
Seconds = Annotated[float, Bounds(low=0, high=1e8)]
Sides = Annotated[int, Bounds(low=3, high=12)]


class AnswersError(UserError):
    """The file of models cannot be used."""


@dataclasses.dataclass(frozen=True)
class Part:
    """A primitive and its symmetric copies, in the object's frame (see `Answer`).

    Attributes:
      kind: the primitive; an outline is extruded along its own z.
      size: extents along its own axes.
      at: position of its centre.
      turn: angles a, b, c in degrees; its rotation is Rz(c) Ry(b) Rx(a).
      mirror: "x", "y" or "xy": copies with the opposite signs of these coordinates; "" = none.
      taper: scale of the upper end, 0 = a tip.
      sides: number of sides of a prism.
      outline: corners of an outline, counter-clockwise, in [-1/2, 1/2] x [-1/2, 1/2].
    """

    kind: Literal["box", "cylinder", "cone", "sphere", "prism", "outline"]
    size: tuple[Extent, Extent, Extent]
    at: tuple[Place, Place, Place]
    turn: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    mirror: Literal["", "x", "y", "xy"] = ""
    taper: Fraction = 1.0
    sides: Sides = 3
    outline: tuple[tuple[Corner, Corner], ...] = ()


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
    """The file; `study` is the id of the study that it belongs to."""

    format: Literal["psgn human study"]
    version: Annotated[int, Bounds(low=1, high=1)]
    study: str
    cases: tuple[Answer, ...]


def read_answers(path: str | os.PathLike[str], study: StudyFile) -> tuple[Answer, ...]:
    """The models of all cases, in the order of the study.

    Raises:
      AnswersError: the file is missing or damaged, belongs to another study, or has values out of
        bounds.
    """
    shown = one_line(path)
    try:
        node = read_json(path, max_bytes=_MAX_BYTES)
        answers = structured.build(AnswersFile, node)
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
        raise AnswersError(f"{shown}: expected the cases {names[0]} to {names[-1]}, each once")
    for answer in answers.cases:
        _check(answer, shown)
    return answers.cases


def _check(answer: Answer, shown: str) -> None:
    if len(answer.parts) > MAX_PARTS:
        raise AnswersError(
            f"{shown}: {answer.case} has {len(answer.parts)} parts, expected at most {MAX_PARTS}"
        )
    for number, part in enumerate(answer.parts, 1):
        where = f"{shown}: part {number} of {answer.case}"
        corners = part.outline
        if part.kind != "outline":
            if corners:
                raise AnswersError(f"{where}: a {part.kind} with an outline; expected none")
            continue
        if not 3 <= len(corners) <= MAX_CORNERS:
            raise AnswersError(
                f"{where}: an outline of {len(corners)} corners, expected 3 to {MAX_CORNERS}"
            )
        if crosses_itself(corners) or area(corners) < 1e-6 or triangulate(corners) is None:
            raise AnswersError(
                f"{where}: the outline crosses itself or has no area; expected corners in "
                "counter-clockwise order"
            )
