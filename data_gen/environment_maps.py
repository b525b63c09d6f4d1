"""Environment maps: Mitsuba's model of sun and sky, and files of a folder.

`load_maps` starts `python -m data_gen.environment_maps` to compute and read them.
"""

import json
import pathlib
import subprocess
import sys

import numpy as np
from jaxtyping import Float

from data_gen import engine, lights
from data_gen.engine import Variant
from psgn_jax.system import processes

NUM_SUNSKY = 24
"""Number of skies computed with Mitsuba's model of sun and sky."""


def list_maps(folder: str) -> list[pathlib.Path]:
    """The environment maps below a folder, sorted by name.

    Raises:
      ValueError: the folder contains none.
    """
    paths = sorted(
        p for p in pathlib.Path(folder).rglob("*") if p.suffix.lower() in (".hdr", ".exr")
    )
    if not paths:
        raise ValueError(f"light.folder: got {folder!r}, expected a folder of .hdr and .exr files")
    return paths


def load_maps(
    settings: lights.LightSettings, variant: Variant, *, detail: bool = False
) -> Float[np.ndarray, "m h w 3"] | None:
    """The environment maps for the settings; None = procedural skies, made for each view.

    A separate process reads them, because reading EXR files hangs with a single thread. With
    `detail`, and from the source "mixed", they are large enough for the background of images.

    Raises:
      ValueError: the folder has no map, or a map cannot be read.
    """
    if settings.source == "procedural":
        return None
    names = [str(p.resolve()) for p in list_maps(settings.folder)] if settings.folder else []
    size = lights.DETAIL if detail or settings.source == "mixed" else lights.MAP_SIZE
    skies = 0 if settings.source == "folder" else NUM_SUNSKY
    done = subprocess.run(
        processes.python("data_gen.environment_maps"),
        input=json.dumps([variant, names, size, skies]).encode(), capture_output=True,
        check=False, timeout=600, env=processes.environment(),
    )  # fmt: skip
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines() or ["no message"]
        raise ValueError(f"light.source {settings.source!r}: {lines[-1]}")
    kind = np.float64 if size == lights.MAP_SIZE else np.float32
    return np.frombuffer(done.stdout, kind).reshape(-1, *size, 3)


def _write_maps() -> None:
    variant, names, (height, width), skies = json.loads(sys.stdin.read())
    engine.start(*variant, shrink_threads=False)
    # From a clear morning to a hazy noon. Large maps are computed at a quarter of the resolution.
    coarse = max(1, height // 64)
    rng = np.random.default_rng(0)
    maps = []
    for _ in range(skies):
        values = rng.uniform(2, 8), rng.uniform(15, 75), rng.uniform(0.15, 0.5)
        sky = sunsky_map(*values, (height // coarse, width // coarse))
        maps.append(sky.repeat(coarse, axis=0).repeat(coarse, axis=1))
    maps += [_load_map(name, (height, width)) for name in names]
    kind = np.float64 if (height, width) == lights.MAP_SIZE else np.float32
    sys.stdout.buffer.write(np.stack(maps).astype(kind).tobytes())


def _load_map(path: str, size: tuple[int, int]) -> np.ndarray:
    """An environment map [h, w, 3] from an .hdr or .exr file, reduced to `size`.

    Raises:
      ValueError: the file cannot be read, or its width is not twice its height.
    """
    try:
        bitmap = engine.mi.Bitmap(path).convert(
            engine.mi.Bitmap.PixelFormat.RGB, engine.mi.Struct.Type.Float32, srgb_gamma=False
        )
    except Exception as error:
        raise ValueError(f"environment map {path!r}: {error}"[:300]) from error
    pixels = np.array(bitmap)
    height, width = pixels.shape[:2]
    # Folders of maps often contain images of lit spheres as well. Their aspect ratio differs.
    if not 1.8 < width / height < 2.2:
        raise ValueError(
            f"environment map {path!r}: {width} x {height} pixels, expected a width of twice "
            "the height (latitude and longitude)"
        )
    return lights.shrink(pixels, size)


def sunsky_map(
    turbidity: float,
    sun_elevation_degrees: float,
    albedo: float,
    size: tuple[int, int] = lights.MAP_SIZE,
) -> Float[np.ndarray, "h w 3"]:
    """A map of Mitsuba's model of sun and sky, above grey ground.

    The turbidity is from 1 (clear) to 10 (hazy), `albedo` that of the ground.
    """
    mi, elevation = engine.mi, np.deg2rad(sun_elevation_degrees)
    emitter = {
        "type": "sunsky",
        "sun_direction": [float(np.cos(elevation)), 0.0, float(np.sin(elevation))],
        "turbidity": float(turbidity),
        "albedo": float(albedo),
        "sun_scale": 0.0,
        "complex_sun": False,
    }
    sky = mi.load_dict({"type": "scene", "sky": emitter}).emitters()[0]
    toward = lights.directions_of(size)
    above = toward[..., 2] > 0

    def evaluate(away: list) -> np.ndarray:
        hit = engine.dr.zeros(mi.SurfaceInteraction3f)
        hit.wi = mi.Vector3f(*away)
        return np.array(sky.eval(hit), np.float64)

    grid = np.zeros((*size, 3))
    if mi.variant().startswith("scalar"):
        grid[above] = [evaluate((-d).tolist()) for d in toward[above]]
    else:
        columns = (-toward[above]).T.astype(np.float32)
        grid[above] = evaluate([mi.Float(np.ascontiguousarray(c)) for c in columns]).T
    angles = lights.solid_angles(size)[..., None]
    # The sun has a diameter of half a degree, less than a pixel of the map. It is added with an
    # irradiance of about four times that of the sky on a clear day, less in haze.
    energy = (grid * angles).sum(axis=(0, 1))
    row = int((90 - sun_elevation_degrees) / 180 * size[0])
    warm = np.array([1.0, 0.95, 0.85])
    grid[row, 0] += energy.mean() * warm * 4 / np.sqrt(turbidity) / angles[row, 0]
    grid[~above] = albedo * (grid * angles).sum(axis=(0, 1)) / (2 * np.pi) / 2
    return grid


if __name__ == "__main__":
    _write_maps()
