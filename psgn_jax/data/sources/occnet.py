"""Reads the ShapeNet subset of Occupancy Networks.

The published layout (github.com/autonomousvision/occupancy_networks, `im2mesh/data`):

    <synset>/train.lst, val.lst, test.lst            names of models, one per line
    <synset>/<model>/pointcloud.npz                  points [N, 3], loc [3], scale
    <synset>/<model>/model.binvox                    3D-R2N2's voxels of the model (optional here)
    <synset>/<model>/img_choy2016/000.jpg .. 023.jpg 137x137 on white, no alpha
    <synset>/<model>/img_choy2016/cameras.npz        camera_mat_<i> [3, 3], world_mat_<i> [3, 4]

`points` are normalised; ShapeNet's coordinates (y up) are `points * scale + loc`. `world_mat` maps
ShapeNet's coordinates to the camera's frame, and `camera_mat` maps camera coordinates to pixels of
the 137x137 image (`get_camera_args` there). The voxels fill the cube [-1/2, 1/2]^3 of the
normalised points (`VoxelGrid` there). We call the split `val` `validation`. A folder that is no
synset of ShapeNet is a further category, with the folder's name.

The images have no mask. Our mask consists of the pixels to which the points project, with gaps of
one pixel closed, whatever the object's colour. The 100,000 points of a file leave no wider gaps. A
view is left out unless at least 80 % of the pixels that are clearly not white are within two pixels
of the mask.
"""

import pathlib
import zlib
from collections.abc import Callable

import numpy as np

from psgn_jax.data import camera, schema
from psgn_jax.data.sources import binvox, shapenet
from psgn_jax.system.untrusted import read_npz

NUM_VIEWS = shapenet.NUM_VIEWS
SPLITS = {"train": "train", "val": "validation", "test": "test"}
IMAGES = "img_choy2016"

_MAX_POINTS = 1 << 21
_MAX_LIST = 1 << 22
_NOT_WHITE = 225
_LEAST_INSIDE = 0.8
_NEAR_PIXELS = 2


def models(source: pathlib.Path) -> tuple[list[tuple[str, str, str]], list[str]]:
    """All models as (split, synset, name), and a message for each problem.

    Problems are a folder without lists, a list that cannot be used, and a wrong or repeated name.
    """
    if not source.is_dir():
        raise ValueError(f"SRC {str(source)!r}: there is no such folder")
    usable: list[tuple[str, str, str]] = []
    messages: list[str] = []
    listed: set[tuple[str, str]] = set()
    for folder in sorted(p for p in source.iterdir() if p.is_dir()):
        if not any((folder / f"{file}.lst").is_file() for file in SPLITS):
            messages.append(f"{folder}: no category, it has no train.lst, val.lst or test.lst")
            continue
        for file, split in SPLITS.items():
            path = folder / f"{file}.lst"
            if not path.is_file() or path.stat().st_size > _MAX_LIST:
                messages.append(f"{path}: missing, or far too long")
                continue
            for name in path.read_text("utf-8-sig", "replace").split():
                # Names become paths: refuse names that lead out of the folder.
                if pathlib.PurePath(name).name != name or name == ".." or "\0" in name:
                    messages.append(f"{path}: {name[:60]!r} is not the name of a model")
                elif (folder.name, name) in listed:
                    messages.append(f"{path}: {name[:60]!r} is listed a second time")
                else:
                    listed.add((folder.name, name))
                    usable.append((split, folder.name, name))
    if not usable:
        raise ValueError(f"SRC {str(source)!r}: no <synset>/train.lst, val.lst or test.lst there")
    return usable, messages


def input_files(source: pathlib.Path, synset: str, name: str) -> list[pathlib.Path]:
    """The paths whose size and time show whether a model has changed."""
    folder = source / synset / name
    files = ("pointcloud.npz", "model.binvox", f"{IMAGES}/cameras.npz", IMAGES)
    return [folder / file for file in files]


def open_model(
    source: pathlib.Path, synset: str, name: str, num_points: int
) -> Callable[[int], schema.Sample]:
    """Reads a model; returns a function that reads view i. All views have the same points.

    The points are a random subset of the file's, the same in every run. Both functions raise
    ValueError or OSError, which names the file.
    """
    cloud_path, voxel_path, camera_path, images = input_files(source, synset, name)
    points, loc, scale = _read_cloud(cloud_path)
    world = (points * scale + loc) @ shapenet.TO_WORLD.T
    solid = None
    if voxel_path.exists():
        cells = binvox.read(voxel_path).cells
        solid = shapenet.world_grid(binvox.Grid(cells, loc - scale / 2, scale))
    origin, unit = shapenet.object_frame(world, cloud_path)
    keys = [f"{kind}_mat_{i}" for i in range(shapenet.NUM_VIEWS) for kind in ("world", "camera")]
    cameras = _arrays(camera_path, dict.fromkeys(keys, 16))
    rng = np.random.default_rng(zlib.crc32(f"{synset}/{name}".encode()))
    chosen = rng.permutation(len(world))[:num_points]
    model = shapenet.ShapeNetModel("occnet", synset, name, world[chosen], solid, origin, unit)

    def read(view: int) -> schema.Sample:
        path = images / f"{view:03d}.jpg"
        eye, inner = _camera(cameras, view, camera_path)
        image = shapenet.read_image(path, "JPEG", "RGB")
        mask = _silhouette(world, eye, inner, image, path)
        image = np.where(mask[..., None], image, np.uint8(schema.BACKGROUND_GREY))
        return model.sample(view, eye, inner, image, mask)

    return read


def _arrays(path: pathlib.Path, limits: dict[str, int]) -> dict[str, np.ndarray]:
    try:
        return read_npz(path, limits)
    except ValueError as error:
        raise ValueError(f"{path}: damaged, or not a file of arrays ({error})") from None


def _read_cloud(path: pathlib.Path) -> tuple[np.ndarray, np.ndarray, float]:
    limits = {"points": 3 * _MAX_POINTS, "loc": 3, "scale": 1}
    arrays = _arrays(path, limits)
    for key in limits:
        if key not in arrays:
            raise ValueError(f"{path}: no array {key!r}, it has {sorted(arrays)}")
    points = arrays["points"].astype(np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise ValueError(f"{path}: points {points.shape}, expected [n, 3]")
    loc, scale = (arrays[key].astype(np.float64).reshape(-1) for key in ("loc", "scale"))
    usual = loc.shape == (3,) and scale.shape == (1,) and scale[0] > 0
    if not (usual and np.isfinite(loc).all() and np.isfinite(scale).all()):
        got = f"loc {loc.tolist()}, scale {scale.tolist()}"
        raise ValueError(f"{path}: {got}, expected finite numbers and scale > 0")
    if not np.isfinite(points).all():
        raise ValueError(f"{path}: expected finite points")
    return points, loc, float(scale[0])


def _camera(
    cameras: dict[str, np.ndarray], view: int, path: pathlib.Path
) -> tuple[np.ndarray, np.ndarray]:
    """World-to-camera matrix [3, 4] and intrinsics [3, 3] of a view."""
    for key, shape in ((f"world_mat_{view}", (3, 4)), (f"camera_mat_{view}", (3, 3))):
        if key not in cameras or cameras[key].shape != shape:
            raise ValueError(f"{path}: no {key} {list(shape)}")
    outer = cameras[f"world_mat_{view}"].astype(np.float64)
    inner = cameras[f"camera_mat_{view}"].astype(np.float64)
    eye = np.concatenate([outer[:, :3] @ shapenet.TO_WORLD.T, outer[:, 3:]], axis=1)
    try:
        schema.check_camera(inner, eye)
    except ValueError as error:
        raise ValueError(f"{path}: view {view}: {error}") from None
    return eye, inner


def _silhouette(
    points: np.ndarray, eye: np.ndarray, inner: np.ndarray, image: np.ndarray, path: pathlib.Path
) -> np.ndarray:
    """The mask of the module, bool [H, W]; ValueError if it does not fit the image."""
    mask = shapenet.drawn_mask(*camera.project(points, inner, eye), image.shape[:2])
    seen = np.argwhere(image.min(axis=2) < _NOT_WHITE)[:, ::-1] + 0.5
    inside = camera.inside_mask(seen, mask, _NEAR_PIXELS).mean() if len(seen) else 0.0
    if inside < _LEAST_INSIDE or not mask.any():
        raise ValueError(
            f"{path}: the points project to {inside:.0%} of the pixels that are not white, "
            f"expected {_LEAST_INSIDE:.0%}; camera, shape and image disagree"
        )
    return mask
