"""The page of the demo, which applies a network to photos; see `psgn_jax.demo`.

This is the only module that imports gradio (extra `demo`). It does so inside functions, so that
`Demo` can be used and tested without gradio. Results are written to a given folder. Those that are
older than an hour are deleted at the next prediction.
"""

import contextlib
import ctypes
import html
import importlib.util
import os
import pathlib
import shutil
import socket
import tempfile
import threading
import time
import urllib.parse
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from PIL import Image

from psgn_jax.config import ConfigError
from psgn_jax.data import masks, photo
from psgn_jax.prediction import demo_server, example_photos
from psgn_jax.prediction.demo_editor import (
    EDITOR_SIZE,
    PAINT,
    bound_editor,
    painted,
    place_in_editor,
    shows_photo,
)
from psgn_jax.prediction.files import predict_photo
from psgn_jax.prediction.predictor import FC, Predictor
from psgn_jax.viewing import page

MAX_SAMPLES = 16

MAX_PIXELS = 50_000_000
"""Largest number of pixels of a decoded photo; a larger JPEG is decoded at a smaller size."""

AT_ONCE = 8
"""Number of requests served at the same time.

Photos with more than `LARGE_PIXELS` pixels are read one at a time, and at most `LARGE_WAITING` of
them wait, so that other requests can always be served."""

LARGE_PIXELS = 6_000_000
LARGE_WAITING = 3
QUEUE = 64
"""Requests that may wait."""

KEPT_SECONDS = 3600.0
ADVICE = (
    '<p style="opacity:.7">The points appear here: drop a photo, check its mask, press Predict.</p>'
)
"""HTML that is shown instead of a result."""

_MARGIN_GREY = 232
_PAGE_HEIGHT = 600
_FOUND = {
    "alpha": "Object found by the transparency of the file.",
    "plain": "Object found: it stands out from a plain background.",
    "rembg": "Object found by a segmentation network (rembg).",
    "grabcut": "Object guessed from the photo's colours (GrabCut), often wrong at the edges.",
}
_DOUBT = "Object guessed from the photo's colours; the mask is probably wrong."
_CORRECT = "The object is red: correct it with brush and eraser, then press Predict."


class Demo:
    """The actions of the page's controls, without gradio.

    Args:
      predictor: the network.
      folder: folder for results; old results are deleted.
    """

    def __init__(self, predictor: Predictor, folder: str | os.PathLike[str]):
        self.predictor = predictor
        self.folder = pathlib.Path(folder)
        self._large = threading.Semaphore()
        self._waiting = threading.BoundedSemaphore(1 + LARGE_WAITING)

    @property
    def max_samples(self) -> int:
        """The largest number of clouds that can be requested; 1 without random input."""
        return MAX_SAMPLES if self.predictor.config.model.random_size else 1

    def open_photo(self, path: str | None, method: str) -> tuple[dict[str, Any] | None, str]:
        """The photo with an automatic mask, for the editor, and a line about the method.

        Args:
          path: path of the photo; None clears the editor.
          method: one of `masks.METHODS`.

        Returns:
          `background` uint8 [*EDITOR_SIZE, 3], `layers` (the mask in `PAINT`, uint8
          [*EDITOR_SIZE, 4]) and `composite` None; None if there is no readable photo.
        """
        if path is None:
            return None, ""
        try:
            with self._room_for(path):
                return self._open_photo(path, method)
        except ValueError as error:
            return None, _failed(error, path)

    def _open_photo(self, path: str, method: str) -> tuple[dict[str, Any], str]:
        read = photo.read_photo(path)
        # Background and layer have exactly the size of the canvas: the editor moves and scales
        # images and layers of other sizes differently.
        rows, columns = place_in_editor(read.image.shape)
        size = (columns.stop - columns.start, rows.stop - rows.start)
        background = np.full((*EDITOR_SIZE, 3), _MARGIN_GREY, np.uint8)
        background[rows, columns] = np.asarray(Image.fromarray(read.image).resize(size))
        layer = np.zeros((*EDITOR_SIZE, 4), np.uint8)
        try:
            mask, how, doubt = masks.find_mask(read.image, read.alpha, method)
        except ValueError as error:
            line = f"{_failed(error, path)} Paint the object, then press Predict."
        else:
            layer[rows, columns][photo.resize_mask(mask, size[::-1])] = PAINT
            line = f"{_DOUBT if doubt else _FOUND[how]} {_CORRECT}"
        return {"background": background, "layers": [layer], "composite": None}, line

    def predict(
        self,
        path: str | None,
        edited: Any,
        samples: float = 1,
        seed: float = 0,
        frame: str = "auto",
        method: str = "auto",
    ) -> tuple[str, list[str], str]:
        """Predicts with the painted mask.

        Args:
          path: path of the photo.
          edited: value of the editor, see `open_photo`; its layers cover the object.
          samples: number of clouds.
          seed: seed of the random input.
          frame: "auto", "place" or "keep" (`Predictor.__call__`).
          method: one of `masks.METHODS`, used if the editor shows no photo.

        Returns:
          HTML that shows the clouds (or `ADVICE`), the files, and a line with the result or the
          error.
        """
        if path is None:
            return ADVICE, [], _failed("no photo: drop one first")
        name = pathlib.Path(path).stem or "image"
        try:
            with self._room_for(path):
                read = photo.read_photo(path)
                mask = None
                if shows_photo(edited):
                    mask = painted(edited, read.image.shape)
                    if not mask.any():
                        raise photo.PhotoError("no mask: paint the object, or choose a method")
                out = self._new_folder()
                result = predict_photo(
                    self.predictor,
                    read,
                    mask,
                    pathlib.Path(path),
                    name,
                    out,
                    samples=_whole("samples", samples),
                    seed=_whole("seed", seed),
                    frame=frame,
                    mask_from=method,
                )
                del read
            viewer = out / ".viewer.html"
            case = page.Case(
                name,
                image=result.view.image,
                samples=result.points,
                num_fc=int((result.branch == FC).sum()),
                colours=result.colours,
            )
            page.write_pages(viewer, [case])
        except (ValueError, OSError) as error:
            return ADVICE, [], _failed(error, path)
        files = sorted(out.glob("[!.]*"), key=lambda file: (file.suffix == ".json", file.name))
        clouds = len(result.points)
        line = (
            f"{clouds} cloud{'s' * (clouds > 1)} of {result.points.shape[1]:,} points in "
            f"{1000 * sum(result.seconds.values()):.0f} ms; the image shows "
            f"{result.seen.mean():.0%} of the points."
        )
        if mask is None:
            line += f" The editor was empty: {_FOUND[result.mask_from]}"
        return in_frame(viewer.read_text(encoding="utf-8")), [str(file) for file in files], line

    def open_example(self, number: int) -> tuple[Any, ...]:
        """Opens an example and predicts its points.

        Returns:
          The path of the example, the outputs of `open_photo`, then those of `predict`.
        """
        path = str(example_photos.example_photos()[number])
        edited, line = self.open_photo(path, "alpha")
        return path, edited, line, *self.predict(path, edited)

    @contextlib.contextmanager
    def _room_for(self, path: str) -> Iterator[None]:
        """Waits until there is memory for reading a photo; frees the memory afterwards.

        Raises:
          PhotoError: the photo is too large, cannot be read, or too many large ones wait.
        """
        pixels = photo.decoded_pixels(path)
        if pixels > MAX_PIXELS:
            raise photo.PhotoError(f"{path} has {pixels:,} pixels: accepted: up to {MAX_PIXELS:,}")
        if pixels <= LARGE_PIXELS:
            yield
            return
        if not self._waiting.acquire(blocking=False):
            raise photo.PhotoError("other large photos are being read: try again in a moment")
        try:
            with self._large:
                yield
        finally:
            self._waiting.release()
            return_memory()

    def _new_folder(self) -> pathlib.Path:
        self.folder.mkdir(parents=True, exist_ok=True)
        for old in self.folder.iterdir():
            if time.time() - old.stat().st_mtime > KEPT_SECONDS:
                shutil.rmtree(old, ignore_errors=True)
        return pathlib.Path(tempfile.mkdtemp(prefix="result-", dir=self.folder))


def return_memory() -> None:
    """Returns free memory to the operating system, if the C library supports it."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def in_frame(document: str) -> str:
    """An HTML document in a sandboxed frame, in which its script can access nothing else."""
    return (
        f'<iframe title="predicted points" sandbox="allow-scripts" srcdoc="{html.escape(document)}"'
        f' style="width:100%;height:{_PAGE_HEIGHT}px;border:0;border-radius:8px"></iframe>'
    )


def links_to(files: Sequence[str]) -> str:
    """HTML with a link to each file on the server; "" without files."""
    links = [
        f'<a href="gradio_api/file={html.escape(urllib.parse.quote(file))}" download>'
        f"{html.escape(pathlib.Path(file).name)}</a> ({pathlib.Path(file).stat().st_size:,} bytes)"
        for file in files
    ]
    return f"<p>Files: {' · '.join(links)}</p>" if links else ""


def build(demo: Demo) -> Any:
    """The page: `gradio.Blocks`.

    Deliberately one function: gradio declares controls and their actions in one context.

    Raises:
      ConfigError: gradio is not installed.
    """
    gradio = import_gradio()

    def open_photo(path: str | None, method: str) -> tuple[Any, ...]:
        edited, line = demo.open_photo(path, method)
        return edited, line, gradio.Button(interactive=edited is not None)

    def predict(*values: Any) -> tuple[Any, ...]:
        shown, made, line = demo.predict(*values)
        return shown, links_to(made), line

    def open_example(event: gradio.SelectData) -> tuple[Any, ...]:
        path, edited, _, shown, made, line = demo.open_example(event.index)
        button = gradio.Button(interactive=edited is not None)
        return path, edited, button, shown, links_to(made), line

    with gradio.Blocks(
        title="psgn_jax", analytics_enabled=False, delete_cache=(600, int(KEPT_SECONDS))
    ) as blocks:
        gradio.Markdown("## From one photo to points\nDrop a photo that shows one whole object.")
        examples = gradio.Gallery(
            [(str(path), example_photos.title(path)) for path in example_photos.example_photos()],
            label="examples: click one",
            columns=6,
            height=150,
            object_fit="contain",
            allow_preview=False,
            interactive=False,
            elem_id="examples",
        )
        with gradio.Row():
            with gradio.Column(scale=1, min_width=280):
                source = gradio.File(label="photo", type="filepath", height=130, elem_id="photo")
                method = gradio.Dropdown(
                    list(masks.METHODS), value="auto", label="find the mask by", elem_id="method"
                )
                samples = gradio.Slider(
                    1, MAX_SAMPLES, 1, step=1, label="samples", visible=demo.max_samples > 1
                )
                seed = gradio.Number(
                    0, precision=0, label="seed", visible=demo.max_samples > 1, minimum=0
                )
                frame = gradio.Dropdown(
                    [
                        ("auto", "auto"),
                        ("place: crop and scale the object", "place"),
                        ("keep: the photo is framed like the training images", "keep"),
                    ],
                    value="auto",
                    label="frame",
                )
                button = gradio.Button(
                    "Predict", variant="primary", elem_id="predict", interactive=False
                )
                line = gradio.HTML("", elem_id="line")
            with gradio.Column(scale=2, min_width=420):
                editor = gradio.ImageEditor(
                    label="mask: paint the object",
                    type="numpy",
                    image_mode="RGBA",
                    format="png",
                    sources=(),
                    transforms=(),
                    layers=False,
                    canvas_size=EDITOR_SIZE[::-1],
                    fixed_canvas=True,
                    brush=gradio.Brush(
                        default_size=24,
                        colors=[("rgb({}, {}, {})".format(*PAINT[:3]), PAINT[3] / 255)],
                        color_mode="fixed",
                    ),
                    eraser=gradio.Eraser(default_size=24),
                    height=520,
                    elem_id="editor",
                )
                bound_editor(editor)
        viewer = gradio.HTML(ADVICE, elem_id="viewer")
        files = gradio.HTML("", elem_id="files")
        # Not `source.change`, which an example also triggers.
        for changed in (source.upload, source.clear, method.change):
            # No prediction while the mask is being computed.
            locked = changed(
                lambda: (gradio.Button(interactive=False), ADVICE, "", ""),
                None,
                [button, viewer, files, line],
                queue=False,
                show_progress="hidden",
                api_visibility="private",
            )
            locked.then(
                open_photo,
                [source, method],
                [editor, line, button],
                show_progress_on=[editor],
                api_visibility="private",
                concurrency_limit=AT_ONCE,
            )
        examples.select(
            open_example,
            None,
            [source, editor, button, viewer, files, line],
            show_progress_on=[viewer],
            api_visibility="private",
            concurrency_limit=AT_ONCE,
        )
        button.click(
            predict,
            [source, editor, samples, seed, frame, method],
            [viewer, files, line],
            show_progress_on=[viewer],
            api_visibility="private",
            concurrency_limit=AT_ONCE,
        )
    blocks.queue(max_size=QUEUE)
    return blocks


def launch(
    demo: Demo, listener: socket.socket, host: str, allowed_hosts: Sequence[str] = ()
) -> demo_server.Server:
    """Serves the page until the server is closed.

    Args:
      demo: the actions of the page.
      listener: socket from `demo_server.listen`.
      host: address of the listener.
      allowed_hosts: further accepted names of this server.

    Raises:
      ConfigError: gradio is not installed, or the server does not start.
    """
    gradio = import_gradio()
    import fastapi

    blocks = build(demo)
    app = gradio.mount_gradio_app(
        fastapi.FastAPI(docs_url=None, redoc_url=None, openapi_url=None),
        blocks,
        path="/",
        allowed_paths=[str(demo.folder), str(example_photos.FOLDER)],
        max_file_size=demo_server.MAX_UPLOAD_BYTES,
        footer_links=[],
        show_error=False,
        ssr_mode=False,
        # The default themes load fonts from a server.
        theme=gradio.themes.Default(
            font=["system-ui", "sans-serif"], font_mono=["ui-monospace", "monospace"]
        ),
    )
    server = demo_server.Server(demo_server.guard(app, host, allowed_hosts), listener)
    server.start()
    return server


def import_gradio() -> Any:
    """The module gradio; raises `ConfigError` with instructions if it is not installed."""
    if importlib.util.find_spec("gradio") is None:
        raise ConfigError("the demo needs the extra 'demo': pip install 'psgn-jax[demo]'")
    os.environ.setdefault("GRADIO_ANALYTICS_ENABLED", "False")
    import gradio

    return gradio


def _whole(name: str, value: Any) -> int:
    try:
        if int(value) == value:
            return int(value)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ConfigError(f"{name}={value}: accepted: an integer")


def _failed(error: Exception | str, path: str | None = None) -> str:
    """An error as one line of HTML, with the name of the photo but not its temporary folder."""
    text = " ".join(str(error).split())
    if path is not None:
        text = text.replace(path, pathlib.Path(path).name)
    return f'<span style="color:#b3261e">{html.escape(text)}</span>'
