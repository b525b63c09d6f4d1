"""Texts of OBJ files, small pictures, and archives."""

import io
import struct
import zipfile
import zlib

import numpy as np
from PIL import Image

GREY = 191
_SQUARE = ("-1 -1", "1 -1", "1 1", "-1 1")
CUBE = "".join(f"v {xy} {z}\n" for z in (-1, 1) for xy in _SQUARE)
QUADS = ["4 3 2 1", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8"]
FACES = "".join(f"f {q}\n" for q in QUADS)


def png(colour, size=(4, 4), mode="RGB"):
    return picture(Image.new(mode, size, colour))


def png_header(width, height):
    """A PNG of one bit a pixel without its pixels."""
    content = b"IHDR" + struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    chunk = struct.pack(">I", 13) + content + struct.pack(">I", zlib.crc32(content))
    return b"\x89PNG\r\n\x1a\n" + chunk + struct.pack(">I", 0) + b"IDAT"


def picture(image, kind="PNG", **options):
    """An image, an array or lists of bytes as a file."""
    image = np.array(image, np.uint8) if isinstance(image, list) else image
    image = Image.fromarray(image) if isinstance(image, np.ndarray) else image
    stream = io.BytesIO()
    image.save(stream, kind, **options)
    return stream.getvalue()


def zipped(files):
    """A ZIP archive of texts or bytes by name."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return stream.getvalue()


def scene(height=120, width=160, box=(30, 90, 50, 130), colour=(200, 60, 20), back=(GREY,) * 3):
    """A photo of a box, and its mask."""
    image = np.full((height, width, 3), back, np.uint8)
    top, bottom, left, right = box
    image[top:bottom, left:right] = colour
    mask = np.zeros((height, width), bool)
    mask[top:bottom, left:right] = True
    return image, mask


RED_BLUE = picture([[(255, 0, 0), (0, 0, 255)]])
