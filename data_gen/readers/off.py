"""Reader of OFF files, as the manual of Geomview describes them."""

import itertools
import re
from typing import Any

import numpy as np

from data_gen.mesh import UnusableModelError, check_face_count
from data_gen.parts import Part, picked, rgba
from data_gen.readers.model_files import as_utf8
from data_gen.readers.textures import TRAILING, TWO_COLOURS, Assets

_NO_NUMBER = "not readable as OFF: a word that is not a number"


def _cut(what: str, announced: int, there: int) -> UnusableModelError:
    return UnusableModelError(f"the file is cut off: {announced} {what} announced, {there} there")


def _count(word: str) -> int:
    if not word.isdecimal():
        raise UnusableModelError(_NO_NUMBER)
    return int(word)


def read_off(data: bytes, assets: Assets) -> dict[str, Any]:
    """Arrays of an OFF file for `mesh.build_model`."""
    text = as_utf8(data).decode("utf-8", "replace")
    lines = [words for line in text.split("\n") if (words := line.split("#")[0].split())]
    first = lines[0][0] if lines else ""
    # Some files of ModelNet have no space between the word and the first count.
    kind = re.fullmatch(r"(?:(ST)?(CN?|NC?)?(4?n?)(?:OFF|off))?(\d*)", first)
    if not kind or not first:
        raise UnusableModelError("not readable as OFF: it does not begin with a line 'OFF'")
    lines[0][:1] = filter(None, [kind[4]])
    if lines[0][:1] == ["BINARY"]:
        raise UnusableModelError("binary OFF is not read")
    if kind[3]:
        raise UnusableModelError(f"{first} is not read: its points do not have three coordinates")
    extra = kind[2] or ""
    head: list[str] = []
    while lines and len(head) < 2:
        head += lines.pop(0)
    if len(head) < 2 or not (head[0] + head[1]).isdecimal():
        raise UnusableModelError("not readable as OFF: expected the numbers of vertices and faces")
    if len(head) == 2 and lines and len(lines[0]) == 1:
        lines.pop(0)  # the number of edges in a line of its own
    if len(head) > 3:
        lines.insert(0, head[3:])
    points, faces = int(head[0]), int(head[1])
    check_face_count(faces, assets.max_faces)

    tail = 2 if kind[1] else 0  # texture coordinates, but OFF names no image
    width = 3 + 3 * ("N" in extra) + 4 * ("C" in extra) + tail
    if len({len(words) for words in lines[:points]}) > 1 or len(lines) < points:
        words = list(itertools.chain(*lines))  # lines have no meaning
        if len(words) < points * width:
            raise _cut("vertices", points, len(words) // width)
        rows = [words[k : k + width] for k in range(0, points * width, width)]
        rest, lines = iter(words[points * width :]), []
        for number in rest:
            lines.append([number, *itertools.islice(rest, _count(number))])
        if len(lines) > faces:  # or not all vertices have as many numbers
            raise UnusableModelError("not readable as OFF: lines of vertices differ in length")
    else:
        rows, lines = lines[:points], lines[points:]
    if len(lines) < faces:
        raise _cut("faces", faces, len(lines))
    if len(lines) > faces:
        assets.warn(TRAILING, len(lines) - faces)
    paint = np.full((faces, 4), np.nan)
    try:
        table = np.array(rows, np.float64).reshape(points, -1)
        counts = np.array([_count(words[0]) for words in lines[:faces]], np.int64)
        corners: list[str] = []
        unread = 0
        for index, (words, size) in enumerate(zip(lines, counts.tolist(), strict=False)):
            corners += words[1 : size + 1]
            colour = words[size + 1 :]
            if len(colour) in (3, 4):
                paint[index, : len(colour)] = [float(word) for word in colour]
            unread += len(colour) not in (0, 3, 4)
        flat = np.array([int(word) for word in corners], np.int64)
    except (ValueError, OverflowError) as error:
        raise UnusableModelError(_NO_NUMBER) from error
    if len(flat) < counts.sum():
        raise _cut("corners of faces", int(counts.sum()), len(flat))
    if unread:
        assets.warn("colours of faces that are indices of a colour map not read", unread)
    at = 6 if "N" in extra else 3
    end = table.shape[1] - tail
    if end < at:
        raise UnusableModelError(f"not readable as OFF: {table.shape[1]} numbers in a vertex")
    normals = picked(table[:, 3:6], flat) if "N" in extra else None
    colours = None
    if "C" in extra and end - at in (3, 4):
        colours = picked(rgba(table[:, at:end]), flat)
    elif end != at:
        assets.warn("more numbers of each vertex not read", end - at)
    if not np.isnan(paint).all():
        if colours is None:
            colours = np.repeat(rgba(paint), counts, axis=0)
        else:
            assets.warn(TWO_COLOURS)
    return assets.arrays([Part(table[:, :3], counts, flat, normals=normals, colours=colours)])
