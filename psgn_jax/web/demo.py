"""The page of `psgn demo`: a photo, its mask to correct with a brush, and the predicted points.

This is the only module that imports gradio (extra `demo`), inside functions, so that `Demo` can be
used without it. Photos are read one at a time.
"""

import contextlib
import html
import importlib.util
import logging
import os
import pathlib
import shutil
import socket
import tempfile
import time
import urllib.parse
from collections.abc import Sequence
from typing import Any

import numpy as np
from PIL import Image

from psgn_jax.config.experiment import ConfigError
from psgn_jax.data import photo, resize
from psgn_jax.prediction import masks
from psgn_jax.prediction.files import predict_photo
from psgn_jax.prediction.predictor import FC, Predictor
from psgn_jax.viewing import page

EXAMPLES = pathlib.Path(__file__).resolve().parent / "examples"
"""Renders of procedural models under the project's licence; their alpha channel is their mask."""

EDITOR_SIZE = (600, 800)
"""Height and width of the canvas that the mask is painted on, whatever the photo's shape.

The photo is scaled to fit the canvas and centred: gradio's editor moves and scales images of other
sizes differently than layers. The prediction uses the photo at its own size."""

PAINT = (226, 70, 40, 150)
"""Colour of the mask over the photo, RGBA."""

MAX_SAMPLES = 16
MAX_PIXELS = 50_000_000
MAX_UPLOAD_BYTES = 25_000_000
KEPT_SECONDS = 3600.0
_ADVICE = '<p style="opacity:.7">The points appear here: drop a photo, check its mask.</p>'
_CORRECT = "The object is red: correct it with brush and eraser, then press Predict."
_FOLDER = "psgn-demo-"


class Demo:
    """The actions of the page's controls, without gradio.

    Args:
      predictor: the network.
      folder: folder for results; those older than an hour are removed.
    """

    def __init__(self, predictor: Predictor, folder: str | os.PathLike[str]):
        self.predictor = predictor
        self.folder = pathlib.Path(folder)

    def open_photo(self, path: str | None, mask_path: str | None) -> tuple[Any, str]:
        """A photo and its mask, which is read from a file or found, for the editor.

        Returns:
          `background` uint8 [*EDITOR_SIZE, 3], `layers` (the mask in `PAINT`, uint8
          [*EDITOR_SIZE, 4]) and `composite` None, or None without a readable photo; and a line
          that says where the mask is from.
        """
        if path is None:
            return None, ""
        try:
            read = self._read(path)
        except ValueError as error:
            return None, _failed(error, path)
        rows, columns = place_in_editor(read.image.shape)
        size = (columns.stop - columns.start, rows.stop - rows.start)
        background = np.full((*EDITOR_SIZE, 3), 232, np.uint8)
        background[rows, columns] = np.asarray(Image.fromarray(read.image).resize(size))
        layer = np.zeros((*EDITOR_SIZE, 4), np.uint8)
        try:
            if mask_path is not None:
                mask, source = photo.read_mask(mask_path, read), "the given file"
            else:
                mask, source = masks.find_mask(read.image, read.alpha)
        except ValueError as error:
            line = f"{_failed(error, path, mask_path)} Paint the object, then press Predict."
        else:
            layer[rows, columns][resize.smooth_mask(mask, size[::-1])] = PAINT
            line = f"Mask: {source}. {_CORRECT}"
        return {"background": background, "layers": [layer], "composite": None}, line

    def predict(
        self, path: str | None, edited: Any, samples: float, seed: float, frame: str
    ) -> tuple[str, list[str], str]:
        """Predicts the points of a photo with the painted mask.

        Args:
          edited: value of the editor, see `open_photo`; its layers cover the object.
          frame: "auto", "place" or "keep" (`Predictor.__call__`).

        Returns:
          HTML that shows the clouds, the files, and a line with the result or the error.
        """
        if path is None or not edited or edited.get("background") is None:
            return _ADVICE, [], _failed("no photo: drop one first")
        name = pathlib.Path(path).stem or "image"
        try:
            read = self._read(path)
            mask = painted(edited["layers"], read.image.shape)
            if not mask.any():
                raise photo.PhotoError("no mask: paint the object")
            out = self._new_folder()
            options: dict[str, Any] = {"samples": _integer(samples), "seed": _integer(seed)}
            result = predict_photo(
                self.predictor, read, mask, pathlib.Path(path), name, out, frame=frame, **options
            )
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
            return _ADVICE, [], _failed(error, path)
        files = sorted(out.glob("[!.]*"), key=lambda file: (file.suffix == ".json", file.name))
        line = (
            f"{len(result.points)} x {result.points.shape[1]:,} points in "
            f"{1000 * sum(result.seconds.values()):.0f} ms; the image shows "
            f"{result.seen.mean():.0%} of them."
        )
        return in_frame(viewer.read_text(encoding="utf-8")), [str(file) for file in files], line

    def _read(self, path: str) -> photo.Photo:
        pixels = photo.decoded_pixels(path)
        if pixels > MAX_PIXELS:
            raise photo.PhotoError(f"{path} has {pixels:,} pixels: accepted: up to {MAX_PIXELS:,}")
        return photo.read_photo(path)

    def _new_folder(self) -> pathlib.Path:
        self.folder.mkdir(parents=True, exist_ok=True)
        for old in self.folder.glob("result-*"):
            if time.time() - old.stat().st_mtime > KEPT_SECONDS:
                shutil.rmtree(old, ignore_errors=True)
        return pathlib.Path(tempfile.mkdtemp(prefix="result-", dir=self.folder))


def place_in_editor(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the editor's canvas that a photo of this shape [h, w, ...] covers."""
    height, width = EDITOR_SIZE
    scale = min(height / shape[0], width / shape[1])
    rows, columns = max(1, round(scale * shape[0])), max(1, round(scale * shape[1]))
    top, left = (height - rows) // 2, (width - columns) // 2
    return slice(top, top + rows), slice(left, left + columns)


def painted(layers: Sequence[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """The pixels bool [h, w] of a photo of this shape [h, w, ...] that the editor's layers cover.

    Raises:
      PhotoError: a layer has another size than the canvas.
    """
    mask = np.zeros(EDITOR_SIZE, np.bool_)
    for layer in layers:
        if layer.shape != (*EDITOR_SIZE, 4):
            raise photo.PhotoError(
                f"a layer of the mask is {list(layer.shape)}: accepted: {[*EDITOR_SIZE, 4]}; "
                "drop the photo again"
            )
        mask |= layer[..., 3] > PAINT[3] // 2
    return resize.smooth_mask(mask[place_in_editor(shape)].copy(), shape[:2])


def in_frame(document: str) -> str:
    """An HTML document in a sandboxed frame, in which its script can access nothing else."""
    return (
        f'<iframe title="predicted points" sandbox="allow-scripts" srcdoc="{html.escape(document)}"'
        ' style="width:100%;height:600px;border:0;border-radius:8px"></iframe>'
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
    """The page, `gradio.Blocks`."""
    gradio = import_gradio()
    examples = sorted(EXAMPLES.glob("*.png"))
    can_sample = bool(demo.predictor.config.model.random_size)

    def open_photo(path: str | None, mask_path: str | None) -> tuple[Any, ...]:
        edited, line = demo.open_photo(path, mask_path)
        return edited, _ADVICE, "", line

    def predict(*values: Any) -> tuple[Any, ...]:
        shown, made, line = demo.predict(*values)
        return shown, links_to(made), line

    def open_example(event: gradio.SelectData) -> tuple[Any, ...]:
        path = str(examples[event.index])
        edited, _ = demo.open_photo(path, None)
        return path, None, edited, *predict(path, edited, 1, 0, "auto")

    with gradio.Blocks(title="psgn_jax", delete_cache=(600, int(KEPT_SECONDS))) as blocks:
        gradio.Markdown("## From one photo to points\nDrop a photo that shows one whole object.")
        gallery = gradio.Gallery(
            [(str(path), path.stem.replace("_", " ")) for path in examples],
            label="examples: click one", columns=6, height=230, object_fit="contain",
            allow_preview=False, interactive=False, elem_id="examples",
        )  # fmt: skip
        with gradio.Row():
            with gradio.Column(scale=1, min_width=280):
                source = gradio.File(label="photo", type="filepath", height=130, elem_id="photo")
                given = gradio.File(
                    label="mask, white on the object (optional)",
                    type="filepath", height=110, elem_id="mask",
                )  # fmt: skip
                samples = gradio.Slider(1, MAX_SAMPLES, 1, step=1, label="samples",
                                        visible=can_sample)  # fmt: skip
                seed = gradio.Number(0, precision=0, label="seed", visible=can_sample)
                frames = [
                    ("auto", "auto"),
                    ("place: crop and scale the object", "place"),
                    ("keep: framed like the training images", "keep"),
                ]
                frame = gradio.Dropdown(frames, value="auto", label="frame")
                button = gradio.Button("Predict", variant="primary", elem_id="predict")
                line = gradio.HTML("", elem_id="line")
            with gradio.Column(scale=2, min_width=420):
                colour = ("rgb({}, {}, {})".format(*PAINT[:3]), PAINT[3] / 255)
                editor = gradio.ImageEditor(
                    label="mask: paint the object", type="numpy", image_mode="RGBA", format="png",
                    sources=(), transforms=(), layers=False, canvas_size=EDITOR_SIZE[::-1],
                    fixed_canvas=True, height=520, elem_id="editor",
                    brush=gradio.Brush(default_size=24, colors=[colour], color_mode="fixed"),
                    eraser=gradio.Eraser(default_size=24),
                )  # fmt: skip
        viewer = gradio.HTML(_ADVICE, elem_id="viewer")
        files = gradio.HTML("", elem_id="files")
        shown = [viewer, files, line]
        private = {"api_visibility": "private", "concurrency_id": "photo", "concurrency_limit": 1}
        # Not `change`, which an example also triggers.
        for changed in (source.upload, source.clear, given.upload, given.clear):
            changed(open_photo, [source, given], [editor, *shown], **private)
        gallery.select(open_example, None, [source, given, editor, *shown], **private)
        button.click(predict, [source, editor, samples, seed, frame], shown, **private)
    blocks.queue(max_size=64)
    return blocks


def serve(demo: Demo, listener: socket.socket, hosts: Sequence[str]) -> None:
    """Serves the page until SIGINT or SIGTERM.

    Args:
      demo: the actions of the page.
      listener: a bound socket.
      hosts: accepted `Host` headers. A site that points its own name at this address (DNS
        rebinding) sends its own name and is refused.
    """
    gradio = import_gradio()
    import fastapi
    import uvicorn
    from starlette.middleware.trustedhost import TrustedHostMiddleware

    app = fastapi.FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=list(hosts), www_redirect=False)
    app = gradio.mount_gradio_app(
        app, build(demo), path="/", allowed_paths=[str(demo.folder), str(EXAMPLES)],
        max_file_size=MAX_UPLOAD_BYTES, footer_links=[], show_error=False, ssr_mode=False,
        # The default themes load fonts from a server.
        theme=gradio.themes.Default(
            font=["system-ui", "sans-serif"], font_mono=["ui-monospace", "monospace"]
        ),
    )  # fmt: skip
    logging.getLogger("uvicorn.error").addFilter(_without_traceback)
    config = uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=2)
    uvicorn.Server(config).run(sockets=[listener])


def _without_traceback(record: logging.LogRecord) -> bool:
    """Logs an error of a malformed request as one line."""
    if record.exc_info and record.exc_info[1] is not None:
        error = record.exc_info[1]
        record.msg, record.args = "refused a request: %s: %s", (type(error).__name__, error)
        record.exc_info = record.exc_text = None
    return True


def temporary_folder() -> pathlib.Path:
    """A folder of this process; removes those of demos that were killed."""
    parent = pathlib.Path(tempfile.gettempdir())
    for old in parent.glob(f"{_FOLDER}*"):
        number = old.name.removeprefix(_FOLDER).partition("-")[0]
        if number.isdigit() and not pathlib.Path("/proc", number).exists():
            shutil.rmtree(old, ignore_errors=True)
    return pathlib.Path(tempfile.mkdtemp(prefix=f"{_FOLDER}{os.getpid()}-"))


def import_gradio() -> Any:
    """The module gradio; raises `ConfigError` with instructions if it is not installed."""
    if importlib.util.find_spec("gradio") is None:
        raise ConfigError("the demo needs the extra 'demo': pip install 'psgn-jax[demo]'")
    os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"
    import gradio

    return gradio


def _integer(value: Any) -> int:
    with contextlib.suppress(TypeError, ValueError, OverflowError):
        if int(value) == value:
            return int(value)
    raise ConfigError(f"got {value}, expected an integer")


def _failed(error: Exception | str, *paths: str | None) -> str:
    """An error as one line of HTML, with the names of files but not their temporary folder."""
    text = " ".join(str(error).split())
    for path in filter(None, paths):
        text = text.replace(path, pathlib.Path(path).name)
    return f'<span style="color:#b3261e">{html.escape(text)}</span>'
