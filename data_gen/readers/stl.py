"""Reader of STL files, text and binary, with the colours of Magics and VisCAM."""

import re

import numpy as np

from data_gen.mesh import GREY, UnusableModelError
from data_gen.readers.model_files import (
    UTF_16_MARKS,
    DamagedError,
    as_utf8,
    check_announced,
    numbers,
)
from data_gen.readers.parts import Part
from data_gen.readers.textures import TRAILING, Assets

_HEAD = 84  # bytes before the facets of a binary file: 80 of any content, and the number of facets
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("word", "<u2")])


def read_stl(data: bytes, assets: Assets) -> list[Part]:
    # Both kinds may begin with "solid", but text has no zero bytes.
    count = int.from_bytes(data[80:_HEAD], "little")
    exact = len(data) == _HEAD + _FACET.itemsize * count
    if not exact and (data[:2] in UTF_16_MARKS or b"\0" not in data[:_HEAD]):
        text = as_utf8(data).decode("utf-8", "replace")
        corners, colours = _from_text(text.lower(), assets), None
    else:
        corners, colours = _from_binary(data, count, assets)
    counts, index = np.full(len(corners), 3), np.arange(3 * len(corners))
    return [Part(corners.reshape(-1, 3), counts, index, colours=colours)]


def _from_text(text: str, assets: Assets) -> np.ndarray:
    """The corners [F, 3, 3] of the facets of a text in lower case."""
    end = text.rfind("endsolid")
    if re.search(r"\bfacet\s+normal\b", text[max(end, 0) :]):
        raise UnusableModelError("the file is cut off: no line 'endsolid' after the last facet")
    text = text[: end if end >= 0 else None]
    # Remove the names of solids, which may contain these words.
    text = re.sub(r"(?m)^[ \t]*(?:end)?solid\b.*?(?=\bfacet\s+normal\b|$)", "", text)
    facets = len(re.findall(r"\bfacet\b", text))
    assets.budget.charge(faces=facets)
    if not facets:
        raise DamagedError("neither binary data nor a text with facets")
    words = re.findall(r"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", text)
    if len(words) != 3 * facets or text.count("endloop") != facets:
        what = f"{facets} facets begin, but it has {len(words)} corners"
        raise UnusableModelError(f"the file is cut off or damaged: {what}")
    return numbers(words).reshape(-1, 3, 3)


def _from_binary(data: bytes, count: int, assets: Assets) -> tuple[np.ndarray, np.ndarray | None]:
    """The corners [F, 3, 3] of the facets, and display RGBA [3 F, 4] or None."""
    there, left = divmod(len(data) - _HEAD, _FACET.itemsize)
    if count == 0 and there > 0 and left == 0:
        assets.warn("0 facets announced, those after the header are read", there)
        count = there
    assets.budget.charge(faces=count)
    check_announced("facets", count, max(there, 0))
    if over := len(data) - _HEAD - _FACET.itemsize * count:
        assets.warn(TRAILING, over)
    facets = np.frombuffer(data, _FACET, count, _HEAD)
    word = facets["word"]
    own = word >= 1 << 15  # VisCAM marks facets that have a colour, Magics the others
    mark = data[:70].find(b"COLOR=")
    base, shifts = np.array([*GREY, 1.0]), (10, 5, 0)
    if mark >= 0:
        base, shifts = np.frombuffer(data, np.uint8, 4, mark + 6) / 255, (0, 5, 10)
        own = ~own & word.any()
    elif not own.any():
        if word.any():
            assets.warn("attributes of facets without the mark of colours not read")
        return facets["corners"].astype(np.float64), None
    levels = [(word >> shift & 31) / 31 for shift in shifts]
    colours = np.where(own[:, None], np.stack([*levels, np.ones(count)], axis=1), base)
    return facets["corners"].astype(np.float64), colours.repeat(3, axis=0)
