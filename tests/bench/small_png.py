"""Small files of pictures for the documents."""

import io

import numpy as np
from PIL import Image


def small_png(picture, largest):
    """A PNG of at most `largest` bytes, with as many colours as fit; white stays white."""
    white = (np.asarray(picture) == 255).all(axis=2)
    for colours in (255, 127, 63, 31, 15):
        palette = picture.quantize(colours)
        drawn = picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
        indices = np.where(white, colours, np.asarray(drawn)).astype(np.uint8)
        small = Image.fromarray(indices, "P")
        small.putpalette([*drawn.getpalette()[: 3 * colours], 255, 255, 255])
        stream = io.BytesIO()
        small.save(stream, "PNG", optimize=True)
        if stream.tell() <= largest:
            return stream.getvalue()
    raise SystemExit(f"the picture has {stream.tell()} bytes: draw fewer cases")
