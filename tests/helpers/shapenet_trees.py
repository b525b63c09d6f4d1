"""Small folders in the published layouts of 3D-R2N2 and Occupancy Networks, written by tests.

The object consists of boxes in ShapeNet's axes (+y up) and has no symmetry. The pictures are made
with the camera matrices of those projects, not with the camera of the package.
"""

import base64
import json
import zlib

import numpy as np
from PIL import Image

from psgn_jax.data.sources.binvox import Binvox

BOXES = np.array(
    [
        [[-0.3, -0.25, -0.2], [0.3, -0.15, 0.2]],
        [[-0.3, -0.15, -0.2], [-0.2, 0.3, 0.2]],
        [[0.2, -0.15, 0.1], [0.3, 0.1, 0.2]],
    ]
)
LOW, HIGH = BOXES[:, 0].min(axis=0), BOXES[:, 1].max(axis=0)
CENTRE, LONGEST = (LOW + HIGH) / 2, float((HIGH - LOW).max())
VIEWS = [(30.0, 25.0, 0.8), (200.5, 28.0, 0.7), (301.0, 0.0, 0.9), (97.0, 30.0, 0.65)]
COLOUR = (180, 60, 20)


def voxels(size=32):
    """The solid voxels, and the placement of their grid: a cube over the object's longest side."""
    low = CENTRE - LONGEST / 2
    x = low[:, None] + (np.arange(size) + 0.5) * LONGEST / size
    solid = np.zeros((size,) * 3, bool)
    for box in BOXES:
        inside = [(x[a] > box[0, a]) & (x[a] < box[1, a]) for a in range(3)]
        solid |= inside[0][:, None, None] & inside[1][None, :, None] & inside[2][None, None]
    return Binvox(solid, low, LONGEST)


def surface(rng, count):
    """Points on the faces of the boxes, and outward normals."""
    box = BOXES[rng.integers(len(BOXES), size=count)]
    face = rng.integers(6, size=count)
    points = box[:, 0] + rng.random((count, 3)) * (box[:, 1] - box[:, 0])
    rows = np.arange(count)
    points[rows, face % 3] = box[rows, face // 3, face % 3]
    normals = np.zeros((count, 3))
    normals[rows, face % 3] = np.where(face < 3, -1, 1)
    return points, normals


def published_camera(azimuth, elevation, ratio):
    """K and RT of the z-up world, as written in the projects that use these renderings."""
    focal = 35.0 * 137 / 32.0
    k = np.array([[focal, 0, 68.5], [0, focal, 68.5], [0, 0, 1]])
    sa, ca = np.sin(np.radians(-azimuth)), np.cos(np.radians(-azimuth))
    se, ce = np.sin(np.radians(-elevation)), np.cos(np.radians(-elevation))
    world_to_object = np.array([[ca * ce, -sa, ca * se], [sa * ce, ca, sa * se], [-se, 0, ce]]).T
    object_to_camera = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    fix = np.diag([1.0, -1, -1])
    rotation = fix @ object_to_camera @ world_to_object
    shift = fix @ -object_to_camera @ [[ratio * 1.75], [0], [0]]
    return k, np.concatenate([rotation, shift], axis=1)


BLENDER_FROM_SHAPENET = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def silhouette(view):
    k, rt = published_camera(*view)
    points, _ = surface(np.random.default_rng(5), 200_000)
    seen = k @ (rt[:, :3] @ BLENDER_FROM_SHAPENET @ points.T + rt[:, 3:])
    column, row = np.floor(seen[:2] / seen[2]).astype(int)
    mask = np.zeros((137, 137), bool)
    mask[row, column] = True
    return mask


def write_r2n2(root, names=("a", "b", "c", "d", "e"), synset="03001627"):
    rows = [f"{a} {e} 0 {r} 25" for a, e, r in VIEWS]
    pictures = []
    for view in VIEWS:
        mask = silhouette(view)
        rgba = np.zeros((137, 137, 4), np.uint8)
        rgba[mask] = (*COLOUR, 255)
        pictures.append(Image.fromarray(rgba))
    for name in names:
        rendering = root / "ShapeNetRendering" / synset / name / "rendering"
        rendering.mkdir(parents=True)
        for i, picture in enumerate(pictures):
            picture.save(rendering / f"{i:02d}.png")
        (rendering / "rendering_metadata.txt").write_text("\n".join(rows) + "\n")
        (rendering / "renderings.txt").write_text(
            "".join(f"{i:02d}.png\n" for i in range(len(VIEWS)))
        )
        folder = root / "ShapeNetVox32" / synset / name
        folder.mkdir(parents=True)
        write_binvox(folder / "model.binvox", voxels())
    return root


def write_occnet(root, splits=None, synset="03001627"):
    splits = splits or {"train": ["a", "b"], "val": ["c"], "test": ["d"]}
    rng = np.random.default_rng(1)
    points, normals = surface(rng, 60_000)
    cloud = {
        "points": ((points - CENTRE) / LONGEST).astype(np.float16),
        "normals": normals.astype(np.float16),
        "loc": CENTRE,
        "scale": np.float64(LONGEST),
    }
    cameras = {}
    for i, view in enumerate(VIEWS):
        k, rt = published_camera(*view)
        cameras[f"camera_mat_{i}"] = k
        world = np.concatenate([rt[:, :3] @ BLENDER_FROM_SHAPENET, rt[:, 3:]], axis=1)
        cameras[f"world_mat_{i}"] = world
    for file, names in splits.items():
        for name in names:
            images = root / synset / name / "img_choy2016"
            images.mkdir(parents=True)
            for i, view in enumerate(VIEWS):
                rgb = np.where(silhouette(view)[..., None], COLOUR, 255).astype(np.uint8)
                Image.fromarray(rgb).save(images / f"{i:03d}.jpg", quality=92)
            np.savez(images / "cameras.npz", **cameras)
            np.savez(root / synset / name / "pointcloud.npz", **cloud)
            write_binvox(root / synset / name / "model.binvox", voxels())
        (root / synset / f"{file}.lst").write_text("\n".join(names) + "\n")
    return root


def write_binvox(path, grid):
    """Writes a file in the form of binvox, with numbers to 17 digits."""
    dim = len(grid.solid)
    flat = grid.solid.transpose(0, 2, 1).reshape(-1)
    edges = np.concatenate([[0], np.flatnonzero(flat[1:] != flat[:-1]) + 1, [flat.size]])
    lengths = np.diff(edges)
    pieces = -(-lengths // 255)
    counts = np.full(pieces.sum(), 255)
    counts[np.cumsum(pieces) - 1] = lengths - 255 * (pieces - 1)
    values = np.repeat(flat[edges[:-1]], pieces)
    translate = " ".join(f"{float(t):.17g}" for t in grid.translate)
    header = f"#binvox 1\ndim {dim} {dim} {dim}\ntranslate {translate}\nscale {grid.scale:.17g}\n"
    data = np.stack([values, counts], axis=1).astype(np.uint8).tobytes()
    path.write_bytes(header.encode() + b"data\n" + data)


def grid_of_extra(extra):
    """The volume in `Sample.extra`: cells, bool [n, n, n], and `grid_to_frame`, float64 [3, 4]."""
    content = json.loads(extra)
    size = content["grid_size"]
    packed = zlib.decompress(base64.b64decode(content["grid"]))
    bits = np.unpackbits(np.frombuffer(packed, np.uint8), count=size**3)
    return bits.reshape(size, size, size).astype(bool), np.array(content["grid_to_frame"])
