"""Reader of OFF files, as defined in the manual of Geomview."""

import itertools
import re

import numpy as np

from data_gen.mesh import UnusableModelError
from data_gen.readers.model_files import DamagedError, as_utf8, check_announced, numbers
from data_gen.readers.parts import Part, picked, rgba
from data_gen.readers.textures import TRAILING, TWO_COLOURS, Assets


def _count(word: str) -> int:
    if not word.isdecimal():
        raise DamagedError("a word that is not a number")
    return int(word)


def read_off(data: bytes, assets: Assets) -> list[Part]:
    text = as_utf8(data).decode("utf-8", "replace")
    lines = [words for line in text.split("\n") if (words := line.split("#")[0].split())]
    first = lines[0][0] if lines else ""
    # Some files of ModelNet have no space between the word and the first count.
    kind = re.fullmatch(r"(?:(ST)?(CN?|NC?)?(4?n?)(?:OFF|off))?(\d*)", first)
    if not kind or not first:
        raise DamagedError("it does not begin with a line 'OFF'")
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
        raise DamagedError("expected the numbers of vertices and faces")
    if len(head) == 2 and lines and len(lines[0]) == 1:
        lines.pop(0)  # the number of edges in a line of its own
    if len(head) > 3:
        lines.insert(0, head[3:])
    points, faces = int(head[0]), int(head[1])
    assets.budget.charge(faces=faces)

    tail = 2 if kind[1] else 0  # texture coordinates; OFF has no textures
    width = 3 + 3 * ("N" in extra) + 4 * ("C" in extra) + tail
    widths = {len(words) for words in lines[:points]}
    if len(widths) > 1 or max(widths, default=3) < 3 or len(lines) < points:
        words = list(itertools.chain(*lines))  # the line breaks have no meaning
        check_announced("vertices", points, len(words) // width)
        rows = [words[k : k + width] for k in range(0, points * width, width)]
        rest, lines = iter(words[points * width :]), []
        for number in rest:
            lines.append([number, *itertools.islice(rest, _count(number))])
        if len(lines) > faces:  # or vertices differ in the number of words
            raise DamagedError("lines of vertices differ in length")
    else:
        rows, lines = lines[:points], lines[points:]
        if len(lines) > faces and any(len(w) <= _count(w[0]) for w in lines[:faces]):
            pieces, lines = lines, []
            for words in pieces:  # a face may go over several lines, its colour ends with a line
                if lines and len(lines[-1]) <= _count(lines[-1][0]):
                    lines[-1] += words
                else:
                    lines.append(words)
    check_announced("faces", faces, len(lines))
    if len(lines) > faces:
        assets.warn(TRAILING, len(lines) - faces)
    table = numbers(rows).reshape(points, -1)
    counts = np.array([_count(words[0]) for words in lines[:faces]], np.int64)
    corners: list[str] = []
    paint: list[list[str]] = []
    unread = 0
    for words, size in zip(lines, counts.tolist(), strict=False):
        corners += words[1 : size + 1]
        colour = words[size + 1 :]
        unread += len(colour) not in (0, 3, 4)
        paint.append(colour if len(colour) in (3, 4) else [])
    flat = numbers(corners, np.int64)
    check_announced("corners of faces", int(counts.sum()), len(flat))
    if unread:
        assets.warn("colours of faces that are indices of a colour map not read", unread)
    at = 6 if "N" in extra else 3
    end = table.shape[1] - tail
    if end < at:
        raise DamagedError(f"{table.shape[1]} numbers in a vertex")
    normals = picked(table[:, 3:6], flat) if "N" in extra else None
    colours = None
    if "C" in extra and end - at in (3, 4):
        colours = picked(rgba(table[:, at:end], assets), flat)
    elif end != at:
        assets.warn("more numbers of each vertex not read", end - at)
    if any(paint) and colours is not None:
        assets.warn(TWO_COLOURS)
    elif any(paint):
        painted = numbers([[*colour, *["nan"] * 4][:4] for colour in paint])
        colours = np.repeat(rgba(painted, assets), counts, axis=0)
    return [Part(table[:, :3], counts, flat, normals=normals, colours=colours)]
