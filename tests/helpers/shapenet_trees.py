"""Small folders in the published layouts of 3D-R2N2 and Occupancy Networks, written by tests.

The object consists of boxes in ShapeNet's axes (+y up) and has no symmetry. The pictures are made
with the camera matrices of those projects, not with the camera of the package.
"""

import re

import numpy as np
from PIL import Image
from scipy import ndimage

from psgn_jax.data.sources.binvox import Grid

LOWER = np.array([[-0.3, -0.25, -0.2], [-0.3, -0.15, -0.2], [0.2, -0.15, 0.1]])
UPPER = np.array([[0.3, -0.15, 0.2], [-0.2, 0.3, 0.2], [0.3, 0.1, 0.2]])
BOXES = np.stack([LOWER, UPPER], axis=1)
LOW, HIGH = LOWER.min(axis=0), UPPER.max(axis=0)
CENTRE, LONGEST = (LOW + HIGH) / 2, float((HIGH - LOW).max())
VIEWS = [(30.0, 25.0, 0.8), (200.5, 28.0, 0.7), (301.0, 0.0, 0.9), (97.0, 30.0, 0.65)]
COLOUR = (180, 60, 20)


def voxels(size=32):
    """The solid voxels, and the placement of their grid: a cube over the object's longest side."""
    low = CENTRE - LONGEST / 2
    x = low[:, None] + (np.arange(size) + 0.5) * LONGEST / size
    solid = np.zeros((size,) * 3, bool)
    for lower, upper in BOXES:
        inside = (x > lower[:, None]) & (x < upper[:, None])
        solid[np.ix_(*inside)] = True
    return Grid(solid, low, LONGEST)


def surface(rng, count):
    """Points on the faces of the boxes."""
    box = BOXES[rng.integers(len(BOXES), size=count)]
    face = rng.integers(6, size=count)
    points = box[:, 0] + rng.random((count, 3)) * (box[:, 1] - box[:, 0])
    rows = np.arange(count)
    points[rows, face % 3] = box[rows, face // 3, face % 3]
    return points


def published_camera(azimuth, elevation, ratio):
    """K and RT of the z-up world, as written in the projects that use these renderings."""
    focal = 35.0 * 137 / 32.0
    k = np.array([[focal, 0, 68.5], [0, focal, 68.5], [0, 0, 1]])
    sa, ca = np.sin(np.radians(-azimuth)), np.cos(np.radians(-azimuth))
    se, ce = np.sin(np.radians(-elevation)), np.cos(np.radians(-elevation))
    world_to_object = np.array([[ca * ce, -sa, ca * se], [sa * ce, ca, sa * se], [-se, 0, ce]]).T
    object_to_camera = np.diag([1.0, -1, -1]) @ [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    shift = -object_to_camera @ [[ratio * 1.75], [0], [0]]
    return k, np.concatenate([object_to_camera @ world_to_object, shift], axis=1)


BLENDER_FROM_SHAPENET = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def silhouette(view):
    k, rt = published_camera(*view)
    points = surface(np.random.default_rng(5), 200_000)
    seen = k @ (rt[:, :3] @ BLENDER_FROM_SHAPENET @ points.T + rt[:, 3:])
    column, row = np.floor(seen[:2] / seen[2]).astype(int)
    mask = np.zeros((137, 137), bool)
    mask[row, column] = True
    return mask


def write_r2n2(root, names=("a", "b", "c", "d", "e")):
    rows = "".join(f"{a} {e} 0 {r} 25\n" for a, e, r in VIEWS)
    files = "".join(f"{i:02d}.png\n" for i in range(len(VIEWS)))
    seen = [silhouette(view)[..., None] for view in VIEWS]
    pictures = [Image.fromarray(mask * np.array([*COLOUR, 255], np.uint8)) for mask in seen]
    for name in names:
        rendering = root / "ShapeNetRendering" / "03001627" / name / "rendering"
        rendering.mkdir(parents=True)
        for file, picture in zip(files.split(), pictures, strict=True):
            picture.save(rendering / file)
        (rendering / "rendering_metadata.txt").write_text(rows)
        (rendering / "renderings.txt").write_text(files)
        folder = root / "ShapeNetVox32" / "03001627" / name
        folder.mkdir(parents=True)
        write_binvox(folder / "model.binvox", voxels())
    return root


def write_occnet(root, splits=None, synset="03001627"):
    splits = splits or {"train": ["a", "b"], "val": ["c"], "test": ["d"]}
    points = surface(np.random.default_rng(1), 60_000)
    cloud = {
        "points": ((points - CENTRE) / LONGEST).astype(np.float16),
        "loc": CENTRE,
        "scale": np.float64(LONGEST),
    }
    cameras = {}
    for i, view in enumerate(VIEWS):
        k, rt = published_camera(*view)
        world = np.concatenate([rt[:, :3] @ BLENDER_FROM_SHAPENET, rt[:, 3:]], axis=1)
        cameras |= {f"camera_mat_{i}": k, f"world_mat_{i}": world}
    pictures = [np.where(silhouette(view)[..., None], COLOUR, 255) for view in VIEWS]
    for file, names in splits.items():
        for name in names:
            images = root / synset / name / "img_choy2016"
            images.mkdir(parents=True)
            for i, rgb in enumerate(pictures):
                Image.fromarray(rgb.astype(np.uint8)).save(images / f"{i:03d}.jpg", quality=92)
            np.savez(images / "cameras.npz", **cameras)
            np.savez(root / synset / name / "pointcloud.npz", **cloud)
            write_binvox(root / synset / name / "model.binvox", voxels())
        (root / synset / f"{file}.lst").write_text("\n".join(names) + "\n")
    return root


def write_binvox(path, grid):
    """Writes a file in the form of binvox, with numbers to 17 digits."""
    dim = len(grid.cells)
    runs = re.findall(rb"\x00{1,255}|\x01{1,255}", grid.cells.transpose(0, 2, 1).tobytes())
    translate = " ".join(f"{float(t):.17g}" for t in grid.low)
    header = f"#binvox 1\ndim {dim} {dim} {dim}\ntranslate {translate}\nscale {grid.size:.17g}\n"
    data = b"".join(bytes([run[0], len(run)]) for run in runs)
    path.write_bytes(header.encode() + b"data\n" + data)


def share_near_volume(sample):
    """The share of a sample's points that are in an occupied cell or beside one."""
    near = ndimage.binary_dilation(np.pad(sample.occupancy, 2), np.ones((3, 3, 3)))
    cells = np.floor(np.add(sample.points, [1, 1, 0]) * 16).astype(int) + 2
    return near[tuple(cells.clip(0, 35).T)].mean()
