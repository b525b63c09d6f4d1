"""One model to its samples, and the processes that do it; LLVM looked for and tried out.

With `shader.py` the only importer of Mitsuba, and only inside of processes that render: LLVM may
abort a process, and that process must not be the user's.

    python -m data_gen.worker smoke [LIBRARY]

renders a triangle with an LLVM library (or without one, in scalar mode) and says so by its exit
code.

    python -m data_gen.worker serve FD

is a rendering process that `data_gen.pool` talks to through the open pipe of that number.
"""

import dataclasses
import hashlib
import importlib.util
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import msgpack
import numpy as np
import scipy.ndimage
import scipy.spatial
from jaxtyping import Float
from PIL import Image

from data_gen import cameras, lights, meshes, photo, scene, shader, surroundings
from data_gen.catalogues import Entry
from data_gen.settings import Settings
from psgn_jax.data import records, schema

# Versions of LLVM, best first. 14 is refused by Dr.Jit, 15 and 16 abort the process.
_LLVM_VERSIONS = (19, 20, 18, 17, 21, 22)

_LLVM_FOLDERS = (
    "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib",
    "/usr/lib/llvm-*/lib", "/usr/local/lib", "/opt/homebrew/opt/llvm*/lib",
    "/usr/local/opt/llvm*/lib",
)  # fmt: skip

NO_LLVM = (
    "no usable LLVM library: rendering in scalar mode, some five times slower. "
    "`apt-get install libllvm19` (Debian, Ubuntu) or `brew install llvm@19` (macOS) mends that; "
    "a library elsewhere is named by the variable DRJIT_LIBLLVM_PATH"
)

ROOT = pathlib.Path(__file__).resolve().parents[1]
"""The folder that this package lies in."""

# A rendering process that nothing comes to for so long ends: its job may be gone.
_IDLE_SECONDS = 600.0

NO_MITSUBA = "Mitsuba is not installed: `pip install 'psgn-jax[render]'`"


# --- The variant ------------------------------------------------------------------------------


class Variant(NamedTuple):
    """How to start Mitsuba: name of the variant, and path of the LLVM library or ""."""

    name: str
    libllvm: str = ""


def has_mitsuba() -> bool:
    """Whether Mitsuba is installed; it is not imported."""
    return importlib.util.find_spec("mitsuba") is not None


def llvm_candidates() -> list[str]:
    """LLVM libraries of this machine that may serve, best first."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH", "")
    found: dict[int, str] = {}
    for folder in _LLVM_FOLDERS:
        root = pathlib.Path("/")
        for path in sorted(root.glob(f"{folder[1:]}/libLLVM*")):
            match = re.fullmatch(
                r"libLLVM(?:-(\d+)(?:\.\d+)*)?(?:\.so(?:\.(\d+)(?:\.\d+)*)?|\.dylib)", path.name
            )
            version = int((match and (match[1] or match[2])) or 0)
            if version in _LLVM_VERSIONS:
                found.setdefault(version, str(path))
    rest = [found[v] for v in _LLVM_VERSIONS if v in found]
    return [named, *rest] if named else rest


def _smoke(library: str, variant: str) -> bool:
    """Whether a process can render with this library."""
    environment = {**os.environ, "DRJIT_LIBLLVM_PATH": library}
    environment["PYTHONPATH"] = os.pathsep.join(
        [str(ROOT), *filter(None, [environment.get("PYTHONPATH")])]
    )
    try:
        done = subprocess.run(
            [sys.executable, "-m", "data_gen.worker", "smoke", variant, library],
            env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            timeout=180, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def choose_variant(wanted: str = "auto") -> tuple[Variant, str]:
    """The variant to render with, tried out in a process of its own, and a message or "".

    Args:
      wanted: "llvm", "scalar", or "auto" = LLVM where it works.

    Raises:
      RuntimeError: Mitsuba is not installed or does not run, or LLVM was wanted and is not usable.
    """
    if not has_mitsuba():
        raise RuntimeError(NO_MITSUBA)
    if wanted != "scalar":
        for library in llvm_candidates():
            if _smoke(library, "llvm_ad_rgb"):
                return Variant("llvm_ad_rgb", library), ""
        if wanted == "llvm":
            raise RuntimeError(f"job.variant 'llvm': {NO_LLVM}")
    if not _smoke("", "scalar_rgb"):
        raise RuntimeError("Mitsuba is installed but does not run: `python -m data_gen.worker "
                           "smoke scalar_rgb` shows why")  # fmt: skip
    return Variant("scalar_rgb"), "" if wanted == "scalar" else NO_LLVM


def _smoke_test(variant: str, library: str) -> None:
    shader.start(variant, library)
    corners = np.array([[[-1, -1, 0], [1, -1, 0], [0, 1, 0]]], np.float32)
    mesh = shader.Mesh(corners)
    down = np.array([[0, 0, -1]], np.float32)
    hits = mesh.cast(np.array([[0, 0, 2], [5, 5, 2]], np.float32), np.repeat(down, 2, axis=0))
    if hits.face.tolist() != [0, -1] or abs(hits.t[0] - 2) > 1e-5:
        raise SystemExit(f"wrong hits: {hits}")


# --- Environment maps -------------------------------------------------------------------------


def load_maps(
    settings: lights.LightSettings, variant: Variant, *, detail: bool = False
) -> Float[np.ndarray, "m h w 3"] | None:
    """The environment maps of the settings; None = procedural skies, made for each view.

    Args:
      settings: of the light.
      variant: of Mitsuba.
      detail: whether they are of the size that a picture's background takes; those of the source
        "mixed" always are.

    A process of its own reads them: it keeps its threads, without which EXR files hang.

    Raises:
      ValueError: the folder has no map, or one cannot be read.
    """
    if settings.source == "procedural":
        return None
    names = []
    if settings.source == "folder" or (settings.source == "mixed" and settings.folder):
        names = [str(p.resolve()) for p in lights.list_maps(settings.folder)]
    size = lights.DETAIL if detail or settings.source == "mixed" else lights.MAP_SIZE
    skies = 0 if settings.source == "folder" else lights.NUM_SUNSKY
    request = json.dumps({"variant": variant, "names": names, "size": size, "skies": skies})
    done = subprocess.run(
        [sys.executable, "-m", "data_gen.worker", "maps"],
        input=request.encode(), capture_output=True, check=False, timeout=600,
        cwd=ROOT,
    )  # fmt: skip
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines() or ["no message"]
        raise ValueError(f"light.source {settings.source!r}: {lines[-1]}")
    kind = np.float64 if size == lights.MAP_SIZE else np.float32
    return np.frombuffer(done.stdout, kind).reshape(-1, *size, 3)


def _write_maps() -> None:
    request = json.loads(sys.stdin.read())
    shader.start(*request["variant"], shrink_threads=False)
    size = (request["size"][0], request["size"][1])
    # From a clear morning to a hazy noon; a quarter of the rows and columns do for a large map.
    coarse = max(1, size[0] // 64)
    rng = np.random.default_rng(0)
    maps = [
        shader.sunsky_map(
            rng.uniform(2, 8), rng.uniform(15, 75), rng.uniform(0.15, 0.5),
            (size[0] // coarse, size[1] // coarse),
        ).repeat(coarse, axis=0).repeat(coarse, axis=1)
        for _ in range(request["skies"])
    ]  # fmt: skip
    maps += [shader.load_map(name, size) for name in request["names"]]
    kind = np.float64 if size == lights.MAP_SIZE else np.float32
    sys.stdout.buffer.write(np.stack(maps).astype(kind).tobytes())


# --- One model --------------------------------------------------------------------------------


def model_seed(seed: int, source: str, model_id: str) -> int:
    """A model's own seed: it depends on nothing but these, not on order or number of models."""
    text = f"{seed}/{source}/{model_id}".encode("utf-8", "surrogatepass")
    return int.from_bytes(hashlib.sha256(text).digest()[:8], "big") >> 1


def check_view(
    picture: shader.Picture,
    camera: cameras.Camera,
    points: Float[np.ndarray, "n 3"],
    tree: scipy.spatial.cKDTree,
) -> dict[str, float]:
    """Figures that tell whether a view is sound.

    Args:
      picture: the view.
      camera: its camera.
      points: of the surface, in the view-aligned frame.
      tree: of the points in the model's frame.

    Returns:
      coverage: part of the image that the mask covers; edge: pixels of the mask at the image's
      border; luminance: mean of the mask's pixels, 0 to 255; inside: part of the points that
      project into the mask grown by one pixel; depth: median distance of back-projected pixels
      from the nearest point; before: part of the points that lie in front of the visible surface.
    """
    mask = picture.mask
    height, width = mask.shape
    border = mask[0].sum() + mask[-1].sum() + mask[1:-1, 0].sum() + mask[1:-1, -1].sum()
    pixels, z = cameras.project(points, camera)
    cells = np.floor(pixels).astype(int)
    here = ((cells >= 0) & (cells < [width, height])).all(axis=1) & (z > 0)
    column, row = cells[here].T
    grown = scipy.ndimage.binary_dilation(mask, np.ones((3, 3)))
    # The farthest surface within a pixel: points near a silhouette project beside it.
    far = np.where(mask, picture.depth, np.inf)
    near = scipy.ndimage.minimum_filter(far, size=3)
    median = float("nan")
    rows, columns = np.nonzero(mask)
    if len(rows):
        some = slice(None, None, max(1, len(rows) // 400))
        rows, columns = rows[some], columns[some]
        k = camera.intrinsics
        rays = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))]).T @ np.linalg.inv(k).T
        inside = rays * picture.depth[rows, columns][:, None] - camera.extrinsics[:, 3]
        world = inside @ camera.extrinsics[:, :3] @ camera.rotation
        median = float(np.median(tree.query(world)[0]))
    return {
        "coverage": round(float(mask.mean()), 5),
        "edge": int(border),
        "luminance": round(float(picture.image[mask].mean()) if mask.any() else 0.0, 2),
        "inside": round(float(grown[row, column].sum() / len(points)), 6),
        "depth": round(median, 5),
        "before": round(float((z[here] < near[row, column] - 0.02).mean()), 6),
    }


def _objection(checks: Mapping[str, float], settings: Settings) -> str:
    """Why a view is refused, "" if it is not."""
    limits = settings.checks
    if checks["coverage"] < limits.coverage:
        return f"the object covers {checks['coverage']:.5f} of the image, under {limits.coverage}"
    if checks["edge"]:
        return f"{checks['edge']} pixels of the object touch the image's edge"
    if checks["inside"] < limits.inside:
        return f"{checks['inside']:.4f} of the points lie in the mask, under {limits.inside}"
    if not checks["depth"] <= limits.depth:
        return f"the depth is {checks['depth']:.4f} off the points, over {limits.depth}"
    if checks["luminance"] < limits.luminance:
        return f"brightness {checks['luminance']:.1f} is under {limits.luminance}: a black image"
    return ""


def _background(rng: np.random.Generator, settings: Settings, pictures: list[str]) -> Any:
    """What is behind the object: a grey, or an image in [0, 1]."""
    height, width = settings.camera.image_size
    if settings.image.background in ("grey", "surroundings"):
        return scene.BACKGROUND
    if settings.image.background == "folder":
        with Image.open(pictures[int(rng.integers(len(pictures)))]) as opened:
            whole = opened.convert("RGB")
        scale = max(height / whole.height, width / whole.width) * rng.uniform(1, 1.5)
        size = max(width, round(whole.width * scale)), max(height, round(whole.height * scale))
        array = np.asarray(whole.resize(size), np.float32) / 255
        top = int(rng.integers(size[1] - height + 1))
        left = int(rng.integers(size[0] - width + 1))
        return array[top : top + height, left : left + width]
    # Clouds of two colours: noise at several sizes.
    low, high = rng.random((2, 3))
    noise = np.zeros((height, width))
    for cells in (2, 4, 8, 16):
        grid = rng.random((cells + 1, cells + 1))
        zoomed = scipy.ndimage.zoom(grid, (height / cells, width / cells), order=1)
        noise += zoomed[:height, :width] / cells
    noise = (noise - noise.min()) / max(float(np.ptp(noise)), 1e-9)
    return (low + noise[..., None] * (high - low)).astype(np.float32)


def list_pictures(folder: str) -> list[str]:
    """The pictures below a folder, by name.

    Raises:
      ValueError: there is none, or a file that is none.
    """
    found = sorted(
        str(p.resolve()) for p in pathlib.Path(folder).rglob("*")
        if p.suffix.lower() in (".png", ".jpg", ".jpeg")
    )  # fmt: skip
    if not found:
        raise ValueError(f"image.background_folder: {folder!r} has no .png or .jpg file")
    for path in found:
        try:
            Image.open(path).close()
        except (OSError, Image.DecompressionBombError) as error:
            raise ValueError(f"image.background_folder: {path} is no picture: {error}") from None
    return found


@dataclasses.dataclass(frozen=True, eq=False)
class Context:
    """What a worker needs besides the models."""

    settings: Settings
    source: str
    variant: Variant
    maps: np.ndarray | None
    pictures: list[str]


def render_model(entry: Entry, context: Context) -> tuple[list[bytes], dict[str, Any]]:
    """All samples of a model as records, and the line that reports on it.

    The line's `status` is "ok", or "refused" with a `reason`; a refused model has no samples.
    """
    settings = context.settings
    seed = model_seed(settings.seed, context.source, entry.model_id)
    seconds: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(name: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        seconds[name] = round(seconds.get(name, 0.0) + now - clock, 4)
        clock = now

    line: dict[str, Any] = {
        "model_id": entry.model_id,
        "category": entry.category,
        "split": entry.split,
        "status": "refused",
        "reason": "",
        "seed": seed,
        "samples": 0,
    }
    done: list[bytes] = []
    views = []
    try:
        model = entry.load()
        lap("load")
        line |= {
            "faces": len(model.faces),
            "materials": len(model.materials),
            "warnings": list(model.warnings),
        }
        surface = meshes.sample_surface(model, settings.num_points, seed)
        # A few hundred searches a view: a tree that is made fast serves better than a good one.
        tree = scipy.spatial.cKDTree(surface.points, compact_nodes=False, balanced_tree=False)
        lap("points")
        surfaces = scene.flatten(model)
        outline = meshes.outline(model)
        mesh = shader.Mesh(surfaces.corners)
        lap("mesh")
        parameters = _plain(model.parameters)
        for view in range(settings.views):
            rng = np.random.default_rng([seed, view])
            camera = cameras.draw(rng, settings.camera, outline)
            light, around = surroundings.draw(rng, settings.light, context.maps)
            behind = _background(rng, settings, context.pictures)
            shown = scene.Scene(surfaces, camera, light, behind)
            lap("light")
            photographed = settings.image.shading == "photo"
            picture = shader.render(
                mesh,
                shown,
                side=0 if photographed else settings.image.samples,
                soft_edges=settings.image.soft_edges,
            )
            if settings.image.shading == "path":
                picture = _traced(picture, shown, around.radiance, settings, seed + view)
            elif photographed:
                picture = _photographed(picture, mesh, shown, around, settings, rng)
            lap("render")
            points = (surface.points @ camera.rotation.T).astype(np.float32)
            checks = check_view(picture, camera, points, tree)
            views.append({"view": view, **camera.parameters(), **checks})
            objection = _objection(checks, settings)
            lap("check")
            if objection:
                raise meshes.UnusableModelError(f"view {view}: {objection}")
            normals = (surface.normals @ camera.rotation.T).astype(np.float32)
            occupancy = meshes.solid_occupancy(model, camera.rotation)
            lap("occupancy")
            extra = {
                "seed": seed,
                # Takes a point of the model's frame to the sample's.
                "rotation": np.round(camera.rotation, 9).tolist(),
                "camera": camera.parameters(),
                "parameters": parameters,
            }
            sample = schema.Sample(
                image=picture.image,
                mask=picture.mask,
                depth=picture.depth,
                points=points,
                normals=normals,
                occupancy=occupancy,
                intrinsics=camera.intrinsics.astype(np.float32),
                extrinsics=camera.extrinsics.astype(np.float32),
                category=entry.category,
                model_id=entry.model_id,
                view=view,
                source=context.source,
                extra=json.dumps(extra, sort_keys=True, allow_nan=False),
            )
            done.append(records.encode(sample, point_bits=settings.point_bits))
            lap("encode")
        line["status"] = "ok"
    except meshes.UnusableModelError as error:
        line["reason"], done = str(error), []
    except MemoryError:
        line["reason"], done = "it takes more memory than there is", []
    line["samples"] = len(done)
    line["views"] = views
    line["seconds"] = seconds
    line["megabytes"] = round(peak_megabytes())
    return done, line


def _traced(
    picture: shader.Picture, shown: scene.Scene, radiance: np.ndarray, settings: Settings, seed: int
) -> shader.Picture:
    """The picture with path-traced colours."""
    # As bright as local shading: a white surface in full light has the same brightness.
    strength = shown.lights.colours.sum() + 3 * shown.lights.sky.mean()
    radiance = lights.shrink(radiance)
    flux = (radiance * lights.solid_angles(lights.MAP_SIZE)[..., None]).sum()
    colours = shader.path_trace(
        shown,
        radiance * (strength * np.pi / max(flux, 1e-9)),
        samples=settings.image.path_samples,
        seed=seed % 2**31,
    )
    if not settings.image.soft_edges:
        # Hard edges: a pixel's colour is the object's own, where its centre sees it.
        opacity = np.where(picture.mask, picture.opacity, 0)[..., None]
        colours = np.concatenate(
            [colours[..., :3] / np.maximum(colours[..., 3:], 1e-3) * opacity, opacity], axis=-1
        )
    return picture._replace(image=shader.compose(colours, shown.background))


def _photographed(
    picture: shader.Picture,
    mesh: shader.Mesh,
    shown: scene.Scene,
    around: surroundings.Surroundings,
    settings: Settings,
    rng: np.random.Generator,
) -> shader.Picture:
    """The picture with the colours of a photograph."""
    image = shader.photograph(
        mesh,
        shown,
        picture,
        around,
        photo.draw_ground(rng, settings.image.ground, around, shown.camera),
        film=settings.film,
        side=settings.image.samples,
        soft_edges=settings.image.soft_edges,
        rays=settings.image.rays,
        show_surroundings=settings.image.background == "surroundings",
        rng=rng,
    )
    return picture._replace(image=image)


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return round(value, 9) if np.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int)) else str(value)


def peak_megabytes() -> float:
    """The most memory that this process has had."""
    try:
        with open("/proc/self/status") as file:
            for text in file:
                if text.startswith("VmHWM"):
                    return int(text.split()[1]) / 1024
    except OSError:
        pass
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


# --- The process ------------------------------------------------------------------------------


def work_path(folder: pathlib.Path, model_id: str) -> pathlib.Path:
    """Where a model's samples lie until its shard is written."""
    name = hashlib.sha256(model_id.encode("utf-8", "surrogatepass")).hexdigest()[:24]
    return folder / f"{name}.model"


def serve(connection: Connection) -> None:
    """A rendering process: takes a `Context`, says None, takes entries, sends results.

    A result is (line, `pack_result`). It ends when None comes, the other side is gone or nothing
    has come for ten minutes.
    """
    # Ctrl-C goes to all processes of a terminal; the one that watches this one ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    context: Context = connection.recv()
    shader.start(*context.variant)
    connection.send(None)  # ready
    while connection.poll(_IDLE_SECONDS):
        try:
            entry = connection.recv()
        except (EOFError, ConnectionResetError):
            return
        if entry is None:
            return
        started = time.perf_counter()
        try:
            data, line = render_model(entry, context)
        except Exception as error:
            # Something that nobody has thought of: it ends with this model.
            what = f"{type(error).__name__}: {error}".splitlines()[0][:300]
            data, line = [], failure(entry, "error", what)
        line["seconds_total"] = round(time.perf_counter() - started, 3)
        try:
            connection.send((line, pack_result(line, data)))
        except (BrokenPipeError, ConnectionResetError):
            return
        del data
        shader.release()


def failure(entry: Entry, status: str, reason: str) -> dict[str, Any]:
    """The line of a model that no samples came of."""
    return {
        "model_id": entry.model_id,
        "category": entry.category,
        "split": entry.split,
        "status": status,
        "reason": reason,
        "samples": 0,
    }


def pack_result(line: Mapping[str, Any], data: list[bytes]) -> bytes:
    """A model's line and records as one block of bytes."""
    packed: bytes = msgpack.packb({"line": json.dumps(line), "records": data})
    return packed


def write_result(folder: pathlib.Path, model_id: str, content: bytes) -> None:
    """Leaves what `pack_result` made in a file that appears whole or not at all."""
    path = work_path(folder, model_id)
    temporary = path.with_suffix(f".{os.getpid()}.tmp")
    temporary.write_bytes(content)
    temporary.replace(path)


def read_result(path: pathlib.Path) -> tuple[dict[str, Any], list[bytes]]:
    """What `write_result` left.

    Raises:
      ValueError: the file is damaged.
    """
    try:
        content = msgpack.unpackb(path.read_bytes())
        return json.loads(content["line"]), list(content["records"])
    except Exception as error:
        # msgpack has many ways to fail.
        raise ValueError(f"{path}: damaged ({error})") from error


if __name__ == "__main__":
    if sys.argv[1:2] == ["smoke"]:
        _smoke_test(*(sys.argv[2:4] + ["scalar_rgb", ""][len(sys.argv) - 2 :])[:2])
    elif sys.argv[1:2] == ["maps"]:
        _write_maps()
    elif sys.argv[1:2] == ["serve"]:
        with Connection(int(sys.argv[2])) as _pipe:
            serve(_pipe)
    else:
        sys.exit(__doc__)
