"""Texts of OBJ files, and a small picture."""

import io

from PIL import Image

_SQUARE = ("-1 -1", "1 -1", "1 1", "-1 1")
CUBE = "".join(f"v {xy} {z}\n" for z in (-1, 1) for xy in _SQUARE)
QUADS = ["4 3 2 1", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8"]
FACES = "".join(f"f {q}\n" for q in QUADS)


def png(colour, size=(4, 4), mode="RGB"):
    stream = io.BytesIO()
    Image.new(mode, size, colour).save(stream, "PNG")
    return stream.getvalue()
