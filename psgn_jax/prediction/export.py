"""Writes predicted clouds as files, with colours from the image.

All formats use the project's frame (`data.schema`): right-handed, **+z up**, +y to the right of the
image, +x toward the camera, origin on the ground, unit = radius of the bounding hemisphere. In
programs in which y points up (many OBJ viewers), rotate the cloud by -90 degrees about x. Files are
written under a temporary name and then renamed.
"""

import io
import pathlib
from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial import KDTree

from psgn_jax.data import camera
from psgn_jax.data.framing import Framed
from psgn_jax.system.files import write_atomic

UNSEEN = (150, 150, 150)
"""Colour of the points of a cloud of which no point is visible in the image."""

# Radius of the disc of a point, and largest distance of a visible point behind the nearest disc
# (unit). Compared with depth maps, for 1,024 points of the authors' surfaces, the precision of the
# visible points is 82 % and the recall 80 %.
_RADIUS, _DEPTH_TOLERANCE = 0.04, 0.08

_FRAME = "frame: right-handed, +z up, +y image right, +x to the camera; unit: bounding hemisphere"


def colours_from_view(points: np.ndarray, view: Framed) -> tuple[np.ndarray, np.ndarray]:
    """Colours of the points that are visible in the image.

    Each point is a disc of radius .04 that faces the camera. A point is visible if no disc is more
    than .08 in front of its centre and its pixel is on the mask.

    Returns:
      Colours uint8 [n, 3] and visibility bool [n]. A hidden point has the colour of the nearest
      visible one; if none is visible, all have the colour `UNSEEN`.
    """
    height, width = view.mask.shape
    pixels, depth = camera.project(points, view.intrinsics, view.extrinsics)
    front = np.isfinite(pixels).all(axis=1) & (depth > 1e-3)
    colours = np.tile(np.array(UNSEEN, np.uint8), (len(points), 1))
    seen = np.zeros(len(points), np.bool_)
    if not front.any():
        return colours, seen
    pixels, depth = np.clip(pixels[front], -width, 2 * width), depth[front]
    corner = np.floor(pixels).astype(int)
    reach = float(view.intrinsics[0, 0]) * _RADIUS / depth
    most = int(min(reach.max(), 64)) + 1
    steps = np.arange(-most, most + 1)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    offsets = offsets[(offsets**2).sum(axis=1) <= most**2]
    far_first = np.argsort(-depth, kind="stable")
    covered = (offsets**2).sum(axis=1) <= np.square(reach[far_first])[:, None]
    column = corner[far_first, 0, None] + offsets[:, 0]
    row = corner[far_first, 1, None] + offsets[:, 1]
    covered &= (column >= 0) & (column < width) & (row >= 0) & (row < height)
    nearest = np.full(height * width, np.inf)
    # If a pixel has several values, the last assignment remains: that of the nearest disc.
    layers = np.broadcast_to(depth[far_first, None], covered.shape)
    nearest[(row * width + column)[covered]] = layers[covered]
    inside = (corner >= 0).all(axis=1) & (corner < (width, height)).all(axis=1)
    column, row = np.clip(corner, 0, (width - 1, height - 1)).T
    visible = inside & view.mask[row, column]
    visible &= depth <= nearest[row * width + column] + _DEPTH_TOLERANCE
    seen[front] = visible
    colours[seen] = view.image[row[visible], column[visible]]
    if seen.any():
        _, nearest_seen = KDTree(points[seen]).query(points[~seen])
        colours[~seen] = colours[seen][nearest_seen]
    return colours, seen


def stray_points(points: np.ndarray) -> np.ndarray:
    """Points of a cloud [n, 3] that lie apart from all others: bool [n].

    A point is a stray if the distance to its fourth nearest neighbour is more than 5 times the
    median of this distance over the cloud (ours). Exports leave strays out, and the normal form
    does not consider them. Metrics always use all points.
    """
    if len(points) < 5:
        return np.zeros(len(points), np.bool_)
    distance = KDTree(points).query(points, [5])[0][:, 0]  # the nearest is the point itself
    return np.asarray(distance > 5 * np.median(distance))


def ply(points: np.ndarray, colours: np.ndarray) -> bytes:
    """Binary little-endian PLY: float x, y, z and uchar red, green, blue of each vertex."""
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {_FRAME}",
        f"element vertex {len(points)}",
        *(f"property float {name}" for name in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        "end_header",
    ]
    rows = np.empty(len(points), [("point", "<f4", 3), ("colour", "u1", 3)])
    rows["point"], rows["colour"] = points, colours
    return ("\n".join(head) + "\n").encode() + rows.tobytes()


def xyz(points: np.ndarray, colours: np.ndarray | None = None) -> bytes:
    """A line `x y z` for each point, without header or colours; most programs can read this."""
    return "".join(f"{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in points.tolist()).encode()


def obj(points: np.ndarray, colours: np.ndarray) -> bytes:
    """OBJ: `v x y z r g b` (colours in [0, 1]), and a `p` element so that viewers show points."""
    lines = [f"# {_FRAME}"]
    for (x, y, z), (r, g, b) in zip(points.tolist(), (colours / 255).tolist(), strict=True):
        lines.append(f"v {x:.6f} {y:.6f} {z:.6f} {r:.4f} {g:.4f} {b:.4f}")
    lines.append("p " + " ".join(map(str, range(1, len(points) + 1))))
    return ("\n".join(lines) + "\n").encode()


def glb(points: np.ndarray, colours: np.ndarray) -> bytes:
    """Binary glTF with one primitive of points. glTF's y axis points up: (x, y, z) -> (y, z, x).

    Raises:
      ValueError: trimesh is not installed.
    """
    try:
        import trimesh
    except ImportError:
        raise ValueError("a .glb file needs trimesh: pip install trimesh") from None
    cloud = trimesh.PointCloud(points[:, [1, 2, 0]], colors=colours)
    content: bytes = trimesh.Scene(cloud).export(file_type="glb")
    return content


MAKERS: Mapping[str, Callable[[np.ndarray, np.ndarray], bytes]]
MAKERS = {"ply": ply, "xyz": xyz, "obj": obj, "glb": glb}
FORMATS = (*MAKERS, "npz")
DEFAULT_FORMATS = ("ply", "xyz", "obj", "npz")


def write_clouds(
    folder: pathlib.Path,
    name: str,
    points: np.ndarray,
    colours: np.ndarray,
    formats: tuple[str, ...] = DEFAULT_FORMATS,
    *,
    drawn: np.ndarray | None = None,
    **arrays: np.ndarray,
) -> list[pathlib.Path]:
    """Writes the clouds of an image; returns the files.

    The names are `name.ply` and so on; for several clouds `name_0.ply`, `name_1.ply`, ... The file
    `name.npz` contains `points`, `colours` and `arrays`.

    Args:
      points: float32 [k, n, 3].
      colours: uint8 [k, n, 3].
      drawn: bool [k, n], the points to write (the NPZ file has all); None = all.
    """
    files = {}
    for suffix in formats:
        if suffix == "npz":
            buffer = io.BytesIO()
            np.savez(buffer, allow_pickle=False, points=points, colours=colours, **arrays)
            files[folder / f"{name}.npz"] = buffer.getvalue()
            continue
        for k in range(len(points)):
            numbered = f"{name}_{k}" if len(points) > 1 else name
            kept = slice(None) if drawn is None else drawn[k]
            content = MAKERS[suffix](points[k][kept], colours[k][kept])
            files[folder / f"{numbered}.{suffix}"] = content
    for file, content in files.items():
        write_atomic(file, content, sync=False)
    return list(files)
