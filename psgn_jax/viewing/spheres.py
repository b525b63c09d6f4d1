"""Draws clouds as in the paper: points are small shaded spheres that cast a shadow on the ground.

We rasterise spheres with their normals into a depth buffer, shade them and darken the gaps between
them, at twice the picture's resolution.
"""

import io
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from psgn_jax.data import camera
from psgn_jax.system.files import write_atomic

RADIUS = 0.028
"""Radius of a sphere (unit): half the distance of neighbours if 1,024 points are spread evenly over
a typical surface."""

BRANCH_COLOURS = ((226, 114, 62), (70, 130, 180))
"""Colours of points of the fully connected and of the deconvolution branch."""

# By height, from the ground up.
HEIGHT_COLOURS = np.array(
    [[61, 82, 120], [66, 128, 150], [110, 170, 148], [205, 190, 120], [224, 134, 88]], np.float64
)
# By value, from small to large, perceptually uniform.
VALUE_COLOURS = np.array(
    [[48, 30, 110], [124, 38, 128], [200, 62, 100], [245, 130, 70], [252, 220, 140]], np.float64
)

# Direction toward the light, in the frame of the camera (x right, y down, z forward).
_KEY = np.array([-0.5, -0.75, -0.6]) / np.linalg.norm([0.5, 0.75, 0.6])
_AMBIENT, _DIFFUSE, _SPECULAR = 0.42, 0.62, 0.16
_OVERSAMPLING = 2
_SHADOW_SLANT = (-0.25, 0.3)  # shift of the shadow per unit of height: toward the camera, right
_SHADOW_DARKNESS = 0.42


Clouds = Mapping[str, tuple[np.ndarray, ArrayLike]]
"""Title -> points [n, 3] in the project's frame, and their colours uint8 [n, 3] or [3]."""


def colours_by_height(points: np.ndarray) -> np.ndarray:
    """Colours uint8 [n, 3] by height; the scale is z from 0 to 1."""
    stops, height = range(len(HEIGHT_COLOURS)), np.nan_to_num(points[:, 2].astype(np.float64))
    position = np.clip(height, 0, 1) * stops[-1]
    channels = [np.interp(position, stops, channel) for channel in HEIGHT_COLOURS.T]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


def by_height(clouds: Mapping[str, np.ndarray]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Clouds [n, 3] with their colours by height."""
    return {name: (points, colours_by_height(points)) for name, points in clouds.items()}


def colours_by_branch(branch: np.ndarray) -> np.ndarray:
    """Colours uint8 [n, 3] by branch: 0 is fc, 1 is deconv."""
    return np.array(BRANCH_COLOURS, np.uint8)[branch.astype(int)]


def render(
    points: np.ndarray,
    colours: np.ndarray,
    intrinsics: np.ndarray,
    extrinsics: np.ndarray,
    size: tuple[int, int],
    *,
    radius: float = RADIUS,
    shadow: bool = True,
) -> np.ndarray:
    """Draws a cloud as shaded spheres on white, uint8 [height, width, 3].

    Args:
      points: [n, 3] in the project's frame; points that are not finite or behind the camera are
        left out.
      colours: uint8 [n, 3].
      intrinsics: [3, 3] in pixels of an image of `size`, (height, width).
      extrinsics: [3, 4], from the project's frame to the camera's.
      radius: radius of the spheres, in units.
      shadow: whether to draw a shadow on the ground z = 0.
    """
    keep = np.isfinite(points).all(axis=1)
    points, colours = points[keep].astype(np.float64), colours[keep]
    height, width = size[0] * _OVERSAMPLING, size[1] * _OVERSAMPLING
    intrinsics = np.diag([_OVERSAMPLING, _OVERSAMPLING, 1.0]) @ intrinsics
    canvas = np.full((height, width, 3), 255.0)
    if shadow and len(points):
        canvas *= _ground_light(points, radius, intrinsics, extrinsics, (height, width))[..., None]
    pixels, depth = camera.project(points, intrinsics, extrinsics)
    front = depth > 0.05
    pixels, depth, colours = pixels[front], depth[front], colours[front]
    hit, normal, surface, owner = _stamp(pixels, depth, radius, float(intrinsics[0, 0]), canvas)
    if len(hit):
        lit = _lit(normal, colours[owner].astype(np.float64))
        nearness = np.full(height * width, np.nan)
        nearness[hit] = surface
        lit *= _openness(nearness.reshape(height, width), radius).reshape(-1)[hit, None]
        canvas.reshape(-1, 3)[hit] = lit
    full = Image.fromarray(np.rint(np.clip(canvas, 0, 255)).astype(np.uint8))
    return np.asarray(full.reduce(_OVERSAMPLING))


def turned(extrinsics: np.ndarray, degrees: float) -> np.ndarray:
    """Extrinsics [3, 4] that show the object rotated by an angle about the vertical axis."""
    cosine, sine = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return np.concatenate([extrinsics[:, :3] @ turn, extrinsics[:, 3:]], axis=1)


_WIDEST = 4  # largest width of a picture, divided by its height


def panels(
    case: Mapping[str, Any],
    clouds: Clouds,
    turns: Sequence[float] = (0, 75),
    *,
    height: int = 192,
    radius: Mapping[str, float] | None = None,
) -> dict[str, np.ndarray]:
    """Pictures of a sample: its image, and clouds as its camera sees them, then rotated.

    Args:
      case: `image` uint8 [h, w, 3], `intrinsics` and `extrinsics`.
      turns: angles about the vertical axis in degrees.
      radius: title -> radius of the spheres; default `RADIUS`.

    Returns:
      `image`, TITLE, and `TITLE, ANGLE degrees` -> uint8 [height, w, 3].
    """
    shape = case["image"].shape[:2]
    # Very wide images are squeezed, to bound the memory for a record.
    size = (height, max(1, min(round(shape[1] * (height / shape[0])), _WIDEST * height)))
    intrinsics = camera.scale_intrinsics(case["intrinsics"], shape, size)
    image = Image.fromarray(case["image"]).resize(size[::-1], Image.Resampling.BICUBIC)
    drawn = {"image": np.asarray(image)}
    for angle in turns:
        view = turned(case["extrinsics"], angle)
        for title, (points, colours) in clouds.items():
            paint = np.broadcast_to(np.asarray(colours, np.uint8), points.shape)
            ball = (radius or {}).get(title, RADIUS)
            name = f"{title}, {angle:g} degrees" if angle else title
            drawn[name] = render(points, paint, intrinsics, view, size, radius=ball)
    return drawn


def sheet(rows: Sequence[tuple[str, Mapping[str, np.ndarray]]], *, columns: int) -> Image.Image:
    """Draws many cases in one picture, `columns` beside each other.

    Args:
      rows: label and titled pictures of each case, all of the same height. The label stands over
        the first picture, the titles over the others.
    """
    lengths = [sum(picture.shape[1] for picture in pictures.values()) for _, pictures in rows]
    wide, high = max(lengths), next(iter(rows[0][1].values())).shape[0]
    font = ImageFont.load_default(max(10, high // 14))
    margin, head = 12, max(16, high // 9)
    columns = min(columns, len(rows))
    lines = -(-len(rows) // columns)
    size = columns * (wide + margin) + margin, lines * (high + head) + margin
    page = Image.new("RGB", size, "white")
    pen = ImageDraw.Draw(page)
    for i, (label, pictures) in enumerate(rows):
        left, top = margin + i % columns * (wide + margin), i // columns * (high + head) + 4
        for j, (title, picture) in enumerate(pictures.items()):
            page.paste(Image.fromarray(picture), (left, top + head - 4))
            grey = 130 if j else 60
            pen.text(
                (left + 8 * bool(j), top), title if j else label, font=font, fill=(grey, grey, grey)
            )
            left += picture.shape[1]
    return page


def thinned(truth: np.ndarray, pred: np.ndarray) -> np.ndarray:
    """Every k-th true point, about as many as predicted, for a fair comparison by eye."""
    return truth[:: max(1, len(truth) // max(1, len(pred)))]


def turntable(points: np.ndarray, colours: np.ndarray, path: str | pathlib.Path) -> None:
    """Writes a GIF of a cloud rotating about the vertical axis, at 12.5 frames a second."""
    size = 240, 320
    intrinsics, extrinsics = camera.default_camera(size)
    pictures = [
        render(points, colours, intrinsics, turned(extrinsics, angle), size)
        for angle in range(0, 360, 10)
    ]
    first, *others = [Image.fromarray(picture).quantize(128) for picture in pictures]
    buffer = io.BytesIO()
    first.save(buffer, "gif", save_all=True, append_images=others, duration=80, loop=0)
    write_atomic(path, buffer.getvalue(), sync=False)


def check_picture(path: str | pathlib.Path, flag: str) -> None:
    """Raises ValueError if `write_picture` does not support the format of `path`."""
    if pathlib.Path(path).suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ValueError(f"{flag}={path}: accepted: a name that ends with .png or .jpg")


def write_picture(picture: Image.Image, path: str | pathlib.Path) -> None:
    """Writes a picture atomically, in the format of its suffix."""
    buffer = io.BytesIO()
    picture.save(buffer, Image.registered_extensions()[pathlib.Path(path).suffix.lower()])
    write_atomic(path, buffer.getvalue(), sync=False)


def _stamp(
    pixels: np.ndarray, depth: np.ndarray, radius: float, focal: float, canvas: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rasterises spheres: (flat pixel, normal, depth, index of the point) of each hit."""
    height, width = canvas.shape[:2]
    on_screen = focal * radius / np.maximum(depth, 0.05)
    reach = int(min(np.ceil(on_screen.max(initial=0.0)), 96)) + 1
    steps = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    offsets = offsets[(offsets**2).sum(axis=1) <= (reach + 1) ** 2]
    limit = 4.0 * max(height, width)
    pixels = np.clip(pixels, -limit, 2 * limit)
    corner = np.floor(pixels).astype(int)
    # Offset of each pixel's centre from the centre of the sphere, in radii.
    fraction = (corner + 0.5 - pixels) / on_screen[:, None]
    across = fraction[:, 0, None] + offsets[:, 0] / on_screen[:, None]
    down = fraction[:, 1, None] + offsets[:, 1] / on_screen[:, None]
    forward = 1 - across**2 - down**2
    column, row = corner[:, 0, None] + offsets[:, 0], corner[:, 1, None] + offsets[:, 1]
    inside = (forward > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    owner = np.broadcast_to(np.arange(len(depth))[:, None], inside.shape)[inside]
    flat = (row * width + column)[inside]
    rise = np.sqrt(forward[inside])
    surface = depth[owner] - radius * rise
    # Of several fragments in a pixel, the last assignment remains: the nearest.
    far_first = np.argsort(-surface, kind="stable")
    nearest = np.full(height * width, -1)
    nearest[flat[far_first]] = far_first
    hit = np.flatnonzero(nearest >= 0)
    winner = nearest[hit]
    normal = np.stack([across[inside], down[inside], -rise], axis=1)[winner]
    return hit, normal, surface[winner], owner[winner]


def _lit(normal: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Soft light from the upper left: ambient, wrapped diffuse and a weak highlight."""
    sky = 0.5 - 0.5 * normal[:, 1]  # 1 on top, 0 below
    diffuse = np.clip((normal @ _KEY + 0.25) / 1.25, 0, 1)
    half = _KEY + np.array([0, 0, -1.0])
    shine = np.clip(normal @ (half / np.linalg.norm(half)), 0, 1) ** 24
    light = _AMBIENT * (0.65 + 0.5 * sky) + _DIFFUSE * diffuse
    return colour * light[:, None] + 255 * _SPECULAR * shine[:, None]


def _openness(depth: np.ndarray, radius: float) -> np.ndarray:
    """Ambient occlusion: 1 in front of the surroundings, down to .62 in gaps behind them."""
    empty = np.isnan(depth)
    near, far = np.nanmin(depth), np.nanmax(depth)
    span = max(far - near, 1e-6)
    # Empty pixels get the largest finite depth, so that silhouettes do not dominate.
    filled = np.where(empty, 1.0, (depth - near) / span)
    around = ndimage.gaussian_filter(filled, max(2.0, depth.shape[0] / 64))
    behind = (filled - around) * span
    return 1 - 0.38 * np.clip(behind / (6 * radius), 0, 1)


def _ground_light(
    points: np.ndarray,
    radius: float,
    intrinsics: np.ndarray,
    extrinsics: np.ndarray,
    size: tuple[int, int],
) -> np.ndarray:
    """Light on the ground z = 0 at each pixel; 1 = no shadow."""
    # The shadow falls to the right and away from the camera.
    rotation = extrinsics[:, :3]
    right, toward = rotation[0, :2], -rotation[2, :2]
    toward = toward / max(float(np.linalg.norm(toward)), 1e-9)
    high = np.maximum(points[:, 2:], 0)
    slant = _SHADOW_SLANT[1] * right + _SHADOW_SLANT[0] * toward
    feet = np.concatenate([points[:, :2] + high * slant, 0 * high], axis=1)
    pixels, depth = camera.project(feet, intrinsics, extrinsics)
    inside = (depth > 0.05) & ((pixels >= 0) & (pixels < size[::-1])).all(axis=1)
    column, row = pixels[inside].astype(int).T
    # Higher points cast a softer, weaker shadow.
    share, ball = np.clip(high[inside, 0] / 0.6, 0, 1), radius * intrinsics[0, 0] / depth[inside]
    total = np.zeros(size)
    for weights, blur in ((1 - share, 1.5), (0.8 * share, 4.0)):
        layer = np.bincount(row * size[1] + column, weights * 1.7 * ball**2, total.size)
        sigma = blur * float(np.median(ball)) if len(ball) else 1.0
        total += ndimage.gaussian_filter(layer.reshape(size), (sigma / 2, sigma), mode="constant")
    return 1 - _SHADOW_DARKNESS * (1 - np.exp(-1.6 * total))
