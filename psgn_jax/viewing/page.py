"""A viewer for point clouds: one HTML file that needs no internet connection and no other files.

It shows the image, the predicted cloud and the ground truth. If there are several samples, a slider
chooses one. The clouds can be rotated with a mouse or a finger. Points are coloured by height,
branch, error, spread of the samples, or by the colours of the image. `page.html` contains the code
of the page, which draws on a canvas; a content security policy forbids all requests. Coordinates
are stored as int16 and have an error below 1e-4 units.
"""

import base64
import contextlib
import dataclasses
import io
import json
import pathlib
import tempfile
from collections.abc import Iterable
from typing import IO, Any

import numpy as np
from PIL import Image

from psgn_jax.system.files import write_atomic
from psgn_jax.viewing import spheres

_TEMPLATE = pathlib.Path(__file__).with_name("page.html")
CLOUD_SCRIPT = pathlib.Path(__file__).with_name("cloud.js")
"""Draws clouds in a browser; an ES module."""

_PLACE_OF_DATA = "/*DATA*/"
_EXTENT = 2.0  # largest coordinate that can be stored; objects extend to about 1
_ERROR_TOP = 0.2  # distance with the last colour of the scale, unit
_BLOCK = 512


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """One image with its predictions, as shown on the page.

    Attributes:
      name: a unique name; `page.html#NAME` opens the case.
      image: uint8 [H, W, 3].
      samples: float32 [k, n, 3], predictions in the project's frame.
      truth: float32 [m, 3], the ground truth, or None.
      num_fc: number of points of the fc branch, which come first.
      colours: uint8 [k, n, 3], colours from the image, or None.
      about: a short text, such as the category.
      metrics: a short text for each sample.
    """

    name: str
    image: np.ndarray
    samples: np.ndarray
    truth: np.ndarray | None = None
    num_fc: int = 0
    colours: np.ndarray | None = None
    about: str = ""
    metrics: tuple[str, ...] = ()


def write_pages(
    path: str | pathlib.Path,
    cases: Iterable[Case],
    *,
    title: str = "psgn_jax",
    max_bytes: int = 5_000_000,
) -> dict[str, pathlib.Path]:
    """Writes one page, or several that link to each other: `page.html`, `page-2.html`, ...

    Args:
      path: path of the first page.
      cases: at least one case; names must be unique. Only one case and one page are in memory at a
        time.
      title: title of the pages.
      max_bytes: maximum size of a page, unless a single case is larger.

    Returns:
      The page of each case, by the name of the case.

    Raises:
      ValueError: a name occurs twice.
    """
    path = pathlib.Path(path)
    drawing = CLOUD_SCRIPT.read_text(encoding="utf-8").replace("export class", "class")
    template = _TEMPLATE.read_text(encoding="utf-8").replace("/*CLOUD*/", drawing)
    pages: dict[str, pathlib.Path] = {}
    with contextlib.ExitStack() as stack:
        # Pages link to each other, so their number must be known before the first is written.
        groups: list[IO[str]] = []
        size = 0
        for case in cases:
            if case.name in pages:
                raise ValueError(f"cases: the name {case.name!r} occurs twice; accepted: each once")
            text = to_json(_encode(case))
            if not groups or (size and len(template) + 4096 + size + len(text) > max_bytes):
                path.parent.mkdir(parents=True, exist_ok=True)
                unnamed = tempfile.TemporaryFile("w+", encoding="utf-8", dir=path.parent)  # noqa: SIM115
                groups.append(stack.enter_context(unnamed))
                size = 0
            groups[-1].write(("," if size else "") + text)
            size += len(text) + 1
            pages[case.name] = _numbered(path, len(groups))
        files = [_numbered(path, number + 1) for number in range(len(groups))]
        links = [{"file": file.name, "label": f"page {i}"} for i, file in enumerate(files, 1)]
        head = {
            "title": title,
            "extent": _EXTENT,
            "height_colours": spheres.HEIGHT_COLOURS.tolist(),
            "value_colours": spheres.VALUE_COLOURS.tolist(),
            "branch_colours": spheres.BRANCH_COLOURS,
            "pages": links if len(groups) > 1 else [],
        }
        for file, group in zip(files, groups, strict=True):
            group.seek(0)
            document = f'{to_json(head)[:-1]},"cases":[{group.read()}]}}'
            write_atomic(file, template.replace(_PLACE_OF_DATA, document, 1))
            group.close()
    return pages


def nearest_distances(queries: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance [n] of each query to the nearest point; blocks of queries bound the memory."""
    centre = points.mean(axis=0, dtype=np.float64)  # centring reduces cancellation in the squares
    queries, points = queries - centre, points - centre
    squares = (points**2).sum(axis=1)
    distances = []
    for i in range(0, len(queries), _BLOCK):
        part = queries[i : i + _BLOCK]
        least = (squares - 2 * part @ points.T).min(axis=1) + (part**2).sum(axis=1)
        distances.append(np.sqrt(np.maximum(least, 0)))
    return np.concatenate(distances)


def _numbered(path: pathlib.Path, number: int) -> pathlib.Path:
    return path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")


def _encode(case: Case) -> dict[str, Any]:
    samples, truth = np.asarray(case.samples), case.truth
    item: dict[str, Any] = {
        "name": case.name,
        "about": case.about,
        "metrics": list(case.metrics),
        "image": picture_uri(case.image),
        "samples": [_points(sample) for sample in samples],
        "count": samples.shape[1],
        "fc": case.num_fc,
    }
    if truth is not None:
        truth = truth[:: max(1, len(truth) // samples.shape[1])]  # as dense as the prediction
        item["truth"] = _points(truth)
        item["errors"] = [_levels(nearest_distances(s, truth), _ERROR_TOP) for s in samples]
        item["truth_errors"] = [_levels(nearest_distances(truth, s), _ERROR_TOP) for s in samples]
        item["error_top"] = _ERROR_TOP
    if len(samples) > 1:
        # For each output point: its standard deviation over the samples.
        spread = np.sqrt(((samples - samples.mean(axis=0)) ** 2).sum(axis=2).mean(axis=0))
        top = max(float(np.nan_to_num(spread).max()), 1e-3)
        item["spread"], item["spread_top"] = _levels(spread, top), top
    if case.colours is not None:
        item["colours"] = [_base64(colours.astype(np.uint8)) for colours in case.colours]
    return item


def to_json(value: Any) -> str:
    """JSON in one line, escaped because a "<" could end the script element that contains it."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _points(points: np.ndarray) -> str:
    clipped = np.clip(np.nan_to_num(points), -_EXTENT, _EXTENT)
    return _base64(np.rint(clipped / _EXTENT * 32767).astype("<i2"))


def _levels(values: np.ndarray, top: float) -> str:
    levels = np.clip(np.nan_to_num(values / top, nan=1.0), 0, 1)
    return _base64(np.rint(levels * 255).astype(np.uint8))


def _base64(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


def picture_uri(image: np.ndarray) -> str:
    """A data URI of an image [H, W, 3]: PNG if small, else the smaller of PNG and JPEG."""
    best = ""
    for kind, options in (("png", {"optimize": True}), ("jpeg", {"quality": 88})):
        buffer = io.BytesIO()
        Image.fromarray(image).save(buffer, kind, **options)
        uri = f"data:image/{kind};base64," + base64.b64encode(buffer.getvalue()).decode()
        best = uri if not best or len(uri) < len(best) else best
        if len(best) < 20_000:
            break
    return best
