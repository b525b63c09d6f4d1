"""Environment maps from files, and from Mitsuba's model of sun and sky."""

import functools
import hashlib
import json
import pathlib
import subprocess
import sys

import numpy as np
from jaxtyping import Float

from data_gen import engine, lights
from data_gen.engine import Variant
from data_gen.lights import Map
from psgn_jax.system import processes

NUM_SUNSKY = 24


def _paths(folder: str) -> list[pathlib.Path]:
    """The map files in a folder, sorted; ValueError if there are none."""
    found = pathlib.Path(folder).expanduser().rglob("[!.]*")
    paths = [p for p in found if p.suffix.lower() in (".hdr", ".exr") and p.is_file()]
    if not paths:
        raise ValueError(f"light.folder: got {folder!r}, expected a folder of .hdr and .exr files")
    return sorted(paths)


def fingerprint(folder: str) -> str:
    """A hash of the map files in a folder; ValueError if there are none."""
    contents = [hashlib.sha256(path.read_bytes()).hexdigest() for path in _paths(folder)]
    return hashlib.sha256("".join(contents).encode()).hexdigest()[:16]


def load_maps(folder: str, variant: Variant, size: tuple[int, int]) -> Float[np.ndarray, "m h w 3"]:
    """The environment maps in a folder, reduced to a size.

    A separate process reads them, because Mitsuba hangs at EXR files if it has a single thread.

    Raises:
      ValueError: the folder has no map, or a map cannot be read.
    """
    names = [str(p.resolve()) for p in _paths(folder)]
    done = subprocess.run(
        processes.python("data_gen.environment_maps"),
        input=json.dumps([variant.name, names, size]).encode(), capture_output=True,
        check=False, timeout=600, env=variant.environment(),
    )  # fmt: skip
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines() or ["no message"]
        raise ValueError(f"light.folder {folder!r}: {lines[-1]}")
    return np.frombuffer(done.stdout, _kind(size)).reshape(-1, *size, 3)


def _kind(size: tuple[int, int]) -> type:
    """The type of a map's values: less precise for large maps."""
    return np.float64 if tuple(size) == lights.MAP_SIZE else np.float32


def load_map(path: str, size: tuple[int, int]) -> np.ndarray:
    """An environment map [h, w, 3] from an .hdr or .exr file, reduced to `size`."""
    try:
        bitmap = engine.mi.Bitmap(path).convert(
            engine.mi.Bitmap.PixelFormat.RGB, engine.mi.Struct.Type.Float32, srgb_gamma=False
        )
    except Exception as error:
        raise ValueError(f"environment map {path!r}: {error}"[:300]) from error
    pixels = np.array(bitmap)
    height, width = pixels.shape[:2]
    # Such folders often contain images of lit spheres, too. Their aspect ratio differs.
    if not 1.8 < width / height < 2.2:
        what = f"{width} x {height} pixels, expected a width of twice the height"
        raise ValueError(f"environment map {path!r}: {what}")
    return lights.shrink(pixels, size)


@functools.lru_cache(maxsize=NUM_SUNSKY)
def sunsky(number: int, size: tuple[int, int]) -> Map:
    """One of `NUM_SUNSKY` maps of Mitsuba's model, from a clear morning to a hazy noon."""
    low, high = (2, 15, 0.15), (8, 75, 0.5)
    drawn = np.random.default_rng(0).uniform(low, high, (NUM_SUNSKY, 3))
    turbidity, elevation, albedo = drawn[number].tolist()
    mi, up = engine.mi, np.deg2rad(elevation)
    emitter = {
        "type": "sunsky", "sun_direction": [float(np.cos(up)), 0.0, float(np.sin(up))],
        "turbidity": turbidity, "albedo": albedo, "sun_scale": 0.0, "complex_sun": False,
    }  # fmt: skip
    sky = mi.load_dict({"type": "scene", "sky": emitter}).emitters()[0]
    coarse = max(1, size[0] // 64)  # a quarter of the resolution in large maps
    small = size[0] // coarse, size[1] // coarse
    toward = lights.directions_of(small)
    above = toward[..., 2] > 0

    def evaluate(away: list) -> np.ndarray:
        hit = engine.dr.zeros(mi.SurfaceInteraction3f)
        hit.wi = mi.Vector3f(*away)
        return np.array(sky.eval(hit), np.float64)

    grid = np.zeros((*small, 3))
    if mi.variant().startswith("scalar"):
        grid[above] = [evaluate((-d).tolist()) for d in toward[above]]
    else:
        columns = (-toward[above]).T.astype(np.float32)
        grid[above] = evaluate([mi.Float(np.ascontiguousarray(c)) for c in columns]).T
    angles = lights.solid_angles(small)[..., None]
    # The sun, half a degree wide, is smaller than a pixel of the map. On a clear day its irradiance
    # is about four times the irradiance of the sky, in haze it is less.
    energy = (grid * angles).sum(axis=(0, 1))
    row = int((90 - elevation) / 180 * small[0])
    warm = np.array([1.0, 0.95, 0.85])
    grid[row, 0] += energy.mean() * warm * 4 / np.sqrt(turbidity) / angles[row, 0]
    grid[~above] = albedo * (grid * angles).sum(axis=(0, 1)) / (2 * np.pi) / 2
    return grid.repeat(coarse, axis=0).repeat(coarse, axis=1).astype(_kind(size))


if __name__ == "__main__":  # the process of `load_maps`
    _variant, _names, _size = json.loads(sys.stdin.read())
    engine.start(_variant, shrink_threads=False)
    _maps = np.stack([load_map(name, _size) for name in _names])
    sys.stdout.buffer.write(_maps.astype(_kind(_size)).tobytes())
