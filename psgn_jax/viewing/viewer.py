"""A viewer for point clouds: an HTML file that works offline and without other files.

It shows the image, the predicted cloud and the ground truth. A slider chooses one of several
samples; a mouse or a finger turns the clouds. Points are coloured by height, branch, error,
certainty, or from the image; a button shows the surface in their place. A content security policy
forbids all requests. Coordinates are stored as int16 with an error below 1e-4 units.
"""

import base64
import dataclasses
import io
import json
import pathlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial import KDTree

from psgn_jax.system.files import write_atomic
from psgn_jax.viewing import spheres
from psgn_jax.viewing.surface_file import TexturedMesh

_HEAD = pathlib.Path(__file__).with_name("head.html")
_TEMPLATE = pathlib.Path(__file__).with_name("viewer.html")
_SURFACE_SCRIPT = pathlib.Path(__file__).with_name("surface.js")
CLOUD_SCRIPT = pathlib.Path(__file__).with_name("cloud.js")
"""An ES module that draws clouds in a browser."""

MAX_BYTES = 5_000_000
"""Largest size of a page, unless a single case is larger."""

_EXTENT = 2.0  # largest stored coordinate; objects extend to about 1
_ERROR_TOP, _SPREAD_TOP = 0.2, 0.3  # distances (unit) at the end of the colour scale


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """An image with its predictions, as shown on the page.

    Attributes:
      name: a unique name; `page.html#NAME` opens the case.
      image: uint8 [H, W, 3].
      samples: float32 [k, n, 3], predictions in the project's frame.
      truth: float32 [m, 3].
      num_fc: number of points of the fc branch, the first points.
      colours: uint8 [k, n, 3], from the image.
      surfaces: of the samples that have one; the page shows them, or the points.
      spread: float32 [k, n], how far each point varies between draws (`prediction.draws`).
      about: a short text, such as the category.
      metrics: a short text for each sample.
      camera: `intrinsics` and `extrinsics` of the image, which is then shown behind the cloud.
    """

    name: str
    image: np.ndarray
    samples: np.ndarray
    truth: np.ndarray | None = None
    num_fc: int = 0
    colours: np.ndarray | None = None
    surfaces: Sequence[TexturedMesh | None] = ()
    spread: np.ndarray | None = None
    about: str = ""
    metrics: tuple[str, ...] = ()
    camera: tuple[np.ndarray, np.ndarray] | None = None


FIELDS = (
    "points", "colours", "seen", "branch", "photo", "to_view", "intrinsics", "extrinsics"
)  # fmt: skip
"""The arrays of a prediction that `case_of` needs; it also reads `spread`, if there is one."""


def case_of(
    name: str, arrays: Mapping[str, np.ndarray], surfaces: Sequence[TexturedMesh | None] = ()
) -> Case:
    """The case for the arrays of a prediction's NPZ file; its image is the photo."""
    to_photo = np.linalg.inv(arrays["to_view"].astype(np.float64))
    return Case(
        name,
        arrays["photo"],
        arrays["points"],
        num_fc=int((arrays["branch"] == 0).sum()),
        colours=arrays["colours"] if arrays["seen"].any() else None,
        surfaces=surfaces,
        spread=arrays.get("spread"),
        camera=(to_photo @ arrays["intrinsics"], arrays["extrinsics"]),
    )


def document_of(cases: Sequence[Case]) -> str:
    """One page, as HTML text."""
    return _page("psgn_jax", [to_json(_encode(case)) for case in cases], [])


def _page(title: str, cases: Sequence[str], pages: Sequence[Mapping[str, str]]) -> str:
    head = {
        "title": title,
        "extent": _EXTENT,
        "height_colours": spheres.HEIGHT_COLOURS.tolist(),
        "value_colours": spheres.VALUE_COLOURS.tolist(),
        "branch_colours": spheres.BRANCH_COLOURS,
        "pages": pages,
    }
    return document(_TEMPLATE, f'{to_json(head)[:-1]},"cases":[{",".join(cases)}]}}')


def write_pages(
    path: str | pathlib.Path, cases: Iterable[Case], *, title: str = "psgn_jax"
) -> dict[str, pathlib.Path]:
    """Writes one page, or several that link to each other: `page.html`, `page-2.html`, ...

    Only one page is in memory at a time. Returns {name of a case: its page}.

    Raises:
      ValueError: a name occurs twice.
    """
    path = pathlib.Path(path)
    room = MAX_BYTES - len(document(_TEMPLATE, "")) - 4096
    pages: dict[str, pathlib.Path] = {}
    texts: list[str] = []
    number = 1

    def file(number: int) -> pathlib.Path:
        return path if number == 1 else path.with_stem(f"{path.stem}-{number}")

    def write(*, last: bool) -> None:
        links = {number - 1: "previous page"} if number > 1 else {}
        links |= {} if last else {number + 1: "next page"}
        near = [{"file": file(n).name, "label": label} for n, label in links.items()]
        write_atomic(file(number), _page(title, texts, near))

    for case in cases:
        if case.name in pages:
            raise ValueError(f"cases: the name {case.name!r} occurs twice; accepted: each once")
        text = to_json(_encode(case))
        if texts and sum(map(len, texts)) + len(texts) + len(text) > room:
            write(last=False)
            texts.clear()
            number += 1
        texts.append(text)
        pages[case.name] = file(number)
    write(last=True)
    return pages


def document(template: pathlib.Path, data: str, **pieces: str) -> str:
    """Fills a template; the page makes no requests.

    `/*NAME*/` is the place of the piece NAME, `/*CLOUD*/` of `cloud.js`, `/*SURFACE*/` of
    `surface.js`, and `/*HEAD*/` of `head.html`, which contains `data`, a JSON text.
    """
    pieces["HEAD"] = _HEAD.read_text(encoding="utf-8")
    for name, script in (("CLOUD", CLOUD_SCRIPT), ("SURFACE", _SURFACE_SCRIPT)):
        pieces[name] = script.read_text(encoding="utf-8").replace("export ", "")
    text = template.read_text(encoding="utf-8")
    for name, piece in pieces.items():
        text = text.replace(f"/*{name}*/", piece, 1)
    return text.replace("/*DATA*/", data, 1)


def nearest_distances(queries: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance [n] of each query to the nearest point; non-finite points are far away."""
    near, far = (np.nan_to_num(a, nan=1e9, posinf=1e9, neginf=-1e9) for a in (points, queries))
    return KDTree(near).query(far)[0]


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
        truth = spheres.thinned(truth, samples[0])
        item["truth"] = _points(truth)
        item["errors"] = [_levels(nearest_distances(s, truth), _ERROR_TOP) for s in samples]
        item["truth_errors"] = [_levels(nearest_distances(truth, s), _ERROR_TOP) for s in samples]
        item["error_top"] = _ERROR_TOP
    if case.spread is not None:
        item["spread"] = [_levels(spread, _SPREAD_TOP) for spread in case.spread]
        item["spread_top"] = _SPREAD_TOP
    if case.colours is not None:
        item["colours"] = [_base64(colours.astype(np.uint8)) for colours in case.colours]
    if any(case.surfaces):
        item["surfaces"] = [surface and _mesh(surface) for surface in case.surfaces]
    if case.camera is not None:
        (fx, skew, cx), (_, fy, cy) = case.camera[0][:2].tolist()
        height, width = case.image.shape[:2]
        item["camera"] = {"k": [fx, skew, cx, fy, cy], "rows": case.camera[1].tolist()}
        item["camera"]["size"] = [width, height]
    return item


def to_json(value: Any) -> str:
    """JSON in one line; "<" is escaped, because it could end the script element."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _points(points: np.ndarray) -> str:
    clipped = np.clip(np.nan_to_num(points), -_EXTENT, _EXTENT)
    return _base64(np.rint(clipped / _EXTENT * 32767).astype("<i2"))


def _mesh(surface: TexturedMesh) -> dict[str, str]:
    return {
        "vertices": _points(surface.vertices),
        "normals": _base64(np.rint(127 * np.clip(surface.normals, -1, 1)).astype(np.int8)),
        "uv": _base64(np.rint(65535 * np.clip(surface.uv, 0, 1)).astype("<u2")),
        "faces": _base64(surface.faces.astype("<u2")),
        "texture": picture_uri(surface.texture),
    }


def _levels(values: np.ndarray, top: float) -> str:
    levels = np.clip(np.nan_to_num(values / top, nan=1.0), 0, 1)
    return _base64(np.rint(levels * 255).astype(np.uint8))


def _base64(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


def picture_uri(image: np.ndarray) -> str:
    """A data URI of an image [H, W, 3], the shorter of PNG and JPEG."""
    png, jpeg = io.BytesIO(), io.BytesIO()
    Image.fromarray(image).save(png, "png", optimize=True)
    Image.fromarray(image).save(jpeg, "jpeg", quality=88)
    content = min(png.getvalue(), jpeg.getvalue(), key=len)
    kind = "png" if content.startswith(b"\x89PNG") else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
