import pathlib
import shutil
import types
import zlib

import numpy as np
import pytest
from helpers import drawn_solids as solids
from scipy.spatial.transform import Rotation

from psgn_jax.data import camera, schema
from psgn_jax.data.dataset import write_dataset


def random_sample(rng, *, num_points=200, **changes):
    size = 24, 32
    mask = rng.random(size) < 0.4
    intrinsics, extrinsics = camera.default_camera(size)
    fields = {
        "image": rng.integers(0, 256, (*size, 3), np.uint8),
        "mask": mask,
        "depth": np.where(mask, rng.uniform(2, 5, size), 0).astype(np.float32),
        "points": rng.uniform(-1, 1, (num_points, 3)).astype(np.float32),
        "occupancy": rng.random((32, 32, 32)) < 0.3, "intrinsics": intrinsics,
        "extrinsics": extrinsics, "category": "chair", "model_id": "m1", "view": 3,
        "source": "test",
    }  # fmt: skip
    return schema.Sample(**(fields | changes))


@pytest.fixture
def sample(rng):
    return random_sample(rng)


@pytest.fixture(scope="session")
def dataset(tmp_path_factory) -> pathlib.Path:
    """Drawn solids at 48x64 pixels: 37 training samples in 4 shards, 11 validation samples in 2."""
    folder = tmp_path_factory.mktemp("solids")
    splits = {
        "train": solids.samples(37, seed=0, image_size=(48, 64)),
        "validation": solids.samples(11, seed=1, image_size=(48, 64)),
    }
    write_dataset(folder, splits, source="solids", records_per_shard=10)
    return folder


@pytest.fixture
def copied(dataset, tmp_path):
    """A copy of the data set, which a test may change."""
    return pathlib.Path(shutil.copytree(dataset, tmp_path / "copied"))


def authors_content(seed=0, validation=False):
    """The content of a file in the authors' layout: a torus, seen by their camera.

    The tube is thicker in validation files, so that their shapes are not those of training files.
    """
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_euler("x", 0.3 + seed) * Rotation.from_euler("y", -np.deg2rad(20))
    rotation = rotation.as_matrix().astype(np.float32)
    # In the model's frame axis 0 points down. Its value is 0 on the ground (points / 255 = 0.7).
    points = solids.torus_points(rng, 0.7, 0.3 if validation else 0.2, 16384)
    model = np.stack([-0.2 - points[:, 2], points[:, 0], points[:, 1]], axis=1)
    codes = np.clip(np.rint((model * 0.4 + [0.7, 0.5, 0.5]) * 255), 0, 255).astype(np.uint8)
    # Draw the exact points, by the formulas of the reference instead of the package's functions.
    q = (codes / 255 - [0.7, 0.5, 0.5]) / 0.4 @ rotation
    z = 3.6 - q[:, 2]
    column = np.floor(128 + 400 * q[:, 1] / z).astype(int)
    row = np.floor(96 + 400 * (q[:, 0] + 0.252) / z).astype(int)
    depth = np.zeros((192, 256), np.uint16)
    order = np.argsort(-z)
    code = np.rint((3 - z / 1.8) / 2 * 65535).astype(np.uint16)
    depth[row[order], column[order]] = code[order]
    colour = np.full((192, 256, 3), 191, np.uint8)
    colour[depth > 0] = [10, 20, 200]  # BGR: red
    names = [f"{'f' if validation else 'a'}{seed:03d}{i:028x}" for i in range(32)]
    views = {"colour": colour, "depth": depth, "rotation": rotation, "points": codes}
    return {name: np.repeat(value[None], 32, axis=0) for name, value in views.items()} | {
        "other": np.zeros((32, 1024, 4), np.uint16),
        "names": "\n".join(names).encode(),
    }


def authors_bytes(content):
    return b"".join(v if isinstance(v, bytes) else v.tobytes() for v in content.values())


@pytest.fixture(scope="session")
def authors_file(tmp_path_factory) -> pathlib.Path:
    path = tmp_path_factory.mktemp("authors") / "0.gz"
    path.write_bytes(zlib.compress(authors_bytes(authors_content()), 1))
    return path


def damage(shard, record):
    """Flips a bit of a record in its file (which splits long records at block boundaries)."""
    data = bytearray(shard.read_bytes())
    at = data.find(record[:16])
    assert at > 0
    data[at + 10] ^= 4
    shard.write_bytes(data)


@pytest.fixture(scope="session")
def make():
    """The functions above, for tests that need variations."""
    return types.SimpleNamespace(
        sample=random_sample, content=authors_content, content_bytes=authors_bytes, damage=damage
    )
