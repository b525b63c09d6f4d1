"""Reads what gradio's image editor returns: where the photo lies, and which pixels are painted.

The value is a mapping with `background` and `composite`, uint8 [*EDITOR_SIZE, 4], and `layers`, a
list of such arrays, as in `gradio.ImageEditor`. The module does not import gradio.
"""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from PIL import Image

from psgn_jax.data import photo

EDITOR_SIZE = (600, 800)
"""Height and width of the canvas that the mask is painted on, whatever the photo's shape.

The photo is scaled to fit the canvas and centred. The prediction uses the photo at its own size.
"""

PAINT = (226, 70, 40, 150)
"""Colour of the mask over the photo, RGBA."""

MAX_LAYERS = 4
"""Largest number of layers of the editor's value."""

KEPT_VALUES = 16
"""Largest number of editor values that are kept until they are used."""

MAX_LAYER_BYTES = 4_000_000


def place_in_editor(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the editor's canvas that a photo of this shape [h, w, ...] covers."""
    height, width = EDITOR_SIZE
    scale = min(height / shape[0], width / shape[1])
    rows, columns = max(1, round(scale * shape[0])), max(1, round(scale * shape[1]))
    top, left = (height - rows) // 2, (width - columns) // 2
    return slice(top, top + rows), slice(left, left + columns)


def shows_photo(edited: Any) -> bool:
    """Whether the editor's value has a background image.

    If the editor was cleared, there is no background; otherwise the background covers the canvas.

    Raises:
      PhotoError: the value was refused, see `check_pictures`.
    """
    if (edited or {}).get("refused"):
        raise photo.PhotoError(edited["refused"])
    background = (edited or {}).get("background")
    return background is not None and bool(background[..., 3:].all())


def painted(edited: Any, shape: tuple[int, ...]) -> np.ndarray:
    """The pixels of a photo of this shape [h, w, ...] that the editor's layers cover.

    Returns:
      bool [h, w]; paint outside the photo is ignored.
    """
    mask = np.zeros(EDITOR_SIZE, np.bool_)
    for layer in edited["layers"]:
        if layer.shape[:2] != EDITOR_SIZE:
            raise photo.PhotoError(
                f"the editor's layer is {list(layer.shape[:2])}: accepted: {list(EDITOR_SIZE)}; "
                "drop the photo again"
            )
        mask |= layer[..., 3] > PAINT[3] // 2
    return photo.resize_mask(mask[place_in_editor(shape)].copy(), shape[:2])


def check_pictures(pictures: Sequence[Any]) -> None:
    """Checks the parts of an editor's value by their headers, before they are decoded.

    Args:
      pictures: background, composite and layers, as paths or bytes of image files; None where a
        part is missing.

    Raises:
      PhotoError: there are more layers than `MAX_LAYERS`, or a part is not an image or has another
        size than the canvas.
    """
    if len(pictures) > MAX_LAYERS + 2:
        raise photo.PhotoError(
            f"{len(pictures) - 2} layers of a mask: accepted: up to {MAX_LAYERS}"
        )
    for picture in pictures:
        if picture is None:
            continue
        try:
            source = io.BytesIO(picture) if isinstance(picture, bytes) else picture
            with Image.open(source, formats=("PNG", "WEBP", "JPEG")) as file:
                size = file.size[::-1]
        except (OSError, ValueError, SyntaxError, TypeError, Image.DecompressionBombError):
            raise photo.PhotoError(
                "a layer of the mask is not an image: drop the photo again"
            ) from None
        if size != EDITOR_SIZE:
            raise photo.PhotoError(
                f"the editor's layer is {list(size)}: accepted: {list(EDITOR_SIZE)}; "
                "drop the photo again"
            )


class Blobs(dict[str, Any]):
    """Editor values that were received and not yet used; the oldest are dropped."""

    def __setitem__(self, key: str, value: Any) -> None:
        """Stores a value and drops the oldest ones beyond `KEPT_VALUES`."""
        self.pop(key, None)
        super().__setitem__(key, value)
        while len(self) > KEPT_VALUES:
            del self[next(iter(self))]


def bound_editor(editor: Any) -> None:
    """Makes an `ImageEditor` check the data that it receives before it decodes or stores them."""
    preprocess, accept = editor.preprocess, editor.accept_blobs
    editor.blob_storage = Blobs()

    def checked_preprocess(payload: Any) -> Any:
        sent = payload
        if payload is not None and payload.id is not None:
            sent = editor.blob_storage.get(payload.id)
        try:
            if sent is not None:
                parts = [sent.background, sent.composite, *(sent.layers or ())]
                check_pictures([getattr(part, "path", part) for part in parts])
        except photo.PhotoError as error:
            editor.blob_storage.pop(payload.id, None)
            return {"background": None, "layers": [], "composite": None, "refused": str(error)}
        return preprocess(payload)

    def checked_accept(data: Any) -> Any:
        index = str(data.data.get("index") or "0")
        size = sum(len(content) for _, content in data.files)
        if index != "null" and not (index.isascii() and index.isdigit() and len(index) < 3):
            raise ValueError("index of a layer: accepted: a number")
        if (index != "null" and int(index) >= MAX_LAYERS) or size > MAX_LAYER_BYTES:
            raise ValueError(f"a layer of {size} bytes, number {index}: too many or too large")
        return accept(data)

    checked_accept._is_server_fn = True  # type: ignore[attr-defined]
    editor.preprocess, editor.accept_blobs = checked_preprocess, checked_accept
