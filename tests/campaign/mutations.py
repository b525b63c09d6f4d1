"""Mutated inputs: meshes, images, records, manifests, weights and files of predictions.

Each input is a valid one in which some bytes, words or fields are changed. Reading it must, within
20 seconds and `MOST_MEMORY`, give a correct result or an error that the docstring of the reader
names; never another exception.
"""

import contextlib
import dataclasses
import io
import json
import pathlib
import random
import resource
import signal
import time
import warnings
import zlib
from collections.abc import Callable, Iterator
from typing import Any

import msgpack
import numpy as np
from helpers import drawn_solids
from helpers.obj_text import CUBE, FACES, png
from PIL import Image

from campaign.frame import Finding
from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model
from psgn_jax.data import photo, schema
from psgn_jax.data.codec import decode, encode
from psgn_jax.data.dataset import RecordReader, write_dataset
from psgn_jax.data.manifest import MANIFEST
from psgn_jax.data.schema import RecordError
from psgn_jax.viewing.predictions import PredictionFileError, read_prediction

SECONDS = 20
MOST = 2000
"""Largest number of inputs of one kind in a part, so that fast kinds leave time for slow ones."""
MOST_MEMORY = 2 << 30
"""Largest growth of this process's peak resident memory while it reads one input, bytes."""

_WORDS = (
    b"0", b"-1", b"1e300", b"nan", b"inf", b"99999999999999999999", b"[" * 2000, b"\0", b"\xff",
    b"../../etc/passwd", b"\n", b"", b"true", b"1.5", b"#", b"//", b"\\",
)  # fmt: skip
_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2**31, 10**30, 1.5, 1e300, "", "x", "../x", "a\nb", [], [1], {}, {"a": 1},
    [[[[]]]],
)  # fmt: skip


class _TooLong(BaseException):
    pass


@contextlib.contextmanager
def _within(seconds: float) -> Iterator[None]:
    def stop(number: int, frame: Any) -> None:
        raise _TooLong

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def attempt(read: Callable[[], str], accepted: type[Exception], name: str) -> str:
    """Reads an input; returns what did not hold. `read` returns what is wrong with its result."""
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        with _within(SECONDS), warnings.catch_warnings():
            warnings.simplefilter("error")
            wrong = read()
    except _TooLong:
        return f"over {SECONDS} s: {name}"
    except accepted as error:
        wrong = f"a message of several lines, {str(error)[:200]!r}" if "\n" in str(error) else ""
    except BaseException as error:
        wrong = f"{type(error).__name__}: {error}"
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory)
    if grown > MOST_MEMORY:
        wrong = wrong or f"{grown / 1e6:.0f} MB more memory"
    return wrong and f"{wrong}: {name}"


def mutated(rng: random.Random, data: bytes) -> bytes:
    """Some bytes or words of a file changed, removed, repeated or moved."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        at = rng.randrange(len(out) + 1)
        end = min(len(out), at + rng.choice((1, 2, 4, 8, 64, 1000)))
        kind = rng.randrange(6)
        if kind == 0 and at < len(out):
            out[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del out[at:end]
        elif kind == 2:
            out[at:at] = out[at:end]
        elif kind == 3:
            out[at:end] = rng.choice(_WORDS)
        elif kind == 4:
            out[at:end] = rng.randbytes(end - at)
        elif rng.random() < 0.3:
            del out[at:]
    return bytes(out)


def mutated_tree(rng: random.Random, tree: Any) -> Any:
    """A tree of dicts and lists with one value replaced, removed or doubled."""
    copy = json.loads(json.dumps(tree)) if not _has_bytes(tree) else msgpack.unpackb(
        msgpack.packb(tree)
    )  # fmt: skip
    places = list(_places(copy))
    container, key = rng.choice(places)
    kind = rng.randrange(4)
    if kind == 0:
        del container[key]
    elif kind == 1 and isinstance(container, list):
        container.append(container[key])
    elif isinstance(container[key], bytes):
        container[key] = mutated(rng, container[key])
    else:
        container[key] = rng.choice(_VALUES)
    return copy


def _has_bytes(tree: Any) -> bool:
    return any(isinstance(c[k], bytes) for c, k in _places(tree))


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in list(items):
        yield tree, key
        if isinstance(value, dict | list):
            yield from _places(value)


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[Finding]:
    """Tries as many mutated inputs of each kind as there is time for."""
    makers = (_meshes, _images, _records, _manifests, _predictions, _weights)
    findings = []
    for number, maker in enumerate(makers):
        own = folder / maker.__name__[1:]
        own.mkdir()
        finding = Finding(
            f"mutated {own.name}: a correct result or a documented error, {SECONDS} s, memory"
        )
        left = (deadline - time.monotonic()) / (len(makers) - number)
        end = time.monotonic() + max(left, 0)
        for wrong in maker(rng, own):
            finding.add(wrong)
            if time.monotonic() > end or finding.tried >= MOST:
                break
        findings.append(finding)
    return findings


def _meshes(rng: random.Random, folder: pathlib.Path) -> Iterator[str]:
    import trimesh

    ball = trimesh.creation.icosphere(1)
    good = {f"a.{kind}": ball.export(file_type=kind) for kind in ("stl", "ply", "off", "glb")}
    good = {name: data.encode() if isinstance(data, str) else data for name, data in good.items()}
    (folder / "x.png").write_bytes(png((1, 2, 3)))
    good["m.mtl"] = b"newmtl a\nKd 1 0 0\nmap_Kd -s 1 1 x.png\nd 0.5\nnewmtl b\nKd .1 .2 .3\n"
    good["a.obj"] = (
        f"mtllib m.mtl\n{CUBE}vt 0 0\nusemtl a\n{FACES}usemtl b\nf 1/1 2/1 3/1\n".encode()
    )
    while True:
        for name, data in good.items():
            changed = mutated(rng, data)
            (folder / "m.mtl").write_bytes(good["m.mtl"])
            (folder / "a.obj").write_bytes(good["a.obj"])
            (folder / name).write_bytes(changed)
            path = folder / ("a.obj" if name == "m.mtl" else name)

            def read(path: pathlib.Path = path) -> str:
                model = load_model(path)
                if not np.isfinite(model.vertices).all() or not np.isfinite(model.normals).all():
                    return "coordinates that are not finite"
                reach = np.linalg.norm(model.vertices, axis=1).max()
                return "" if abs(reach - 1) < 1e-3 else f"a radius of {reach}"

            yield attempt(read, UnusableModelError, f"{name} {changed.hex()[:1500]}")


def _images(rng: random.Random, folder: pathlib.Path) -> Iterator[str]:
    picture = Image.new("RGB", (60, 40), (191, 191, 191))
    picture.paste((200, 60, 20), (10, 10, 40, 30))
    good = {}
    for kind in ("PNG", "JPEG", "GIF", "BMP", "TIFF", "WEBP", "PPM", "TGA"):
        stream = io.BytesIO()
        picture.save(stream, kind)
        good[kind] = stream.getvalue()
    while True:
        for kind, data in good.items():
            changed = mutated(rng, data)
            (folder / "a").write_bytes(changed)

            def read() -> str:
                found = photo.read_photo(folder / "a")
                shape = found.image.shape
                if found.image.dtype != np.uint8 or len(shape) != 3 or shape[2] != 3:
                    return f"an image {found.image.dtype} {shape}"
                return "" if min(shape[:2]) >= photo.MIN_SIDE else f"an image of {shape}"

            yield attempt(read, photo.PhotoError, f"{kind} {changed.hex()[:1500]}")


def _records(rng: random.Random, folder: pathlib.Path) -> Iterator[str]:
    sample = next(iter(drawn_solids.samples(1, seed=3, image_size=(24, 32))))
    sample = dataclasses.replace(sample, points=sample.points[:100], normals=None)
    data = encode(sample)
    tree = msgpack.unpackb(data[4:])
    while True:
        changed = mutated(rng, data)

        def refuse(changed: bytes = changed) -> str:
            decode(changed)
            return "" if changed == data else "bytes with a wrong checksum were taken"

        yield attempt(refuse, ValueError, f"bytes {changed.hex()[:1500]}")
        body = _packed(rng, tree)
        crafted = zlib.crc32(body).to_bytes(4, "little") + body

        def read(crafted: bytes = crafted) -> str:
            schema.validate(decode(crafted))
            return ""

        yield attempt(read, ValueError, f"fields {crafted.hex()[:1500]}")


def _packed(rng: random.Random, tree: Any) -> bytes:
    """The msgpack bytes of a mutated tree whose integers fit into 64 bits."""
    while True:
        with contextlib.suppress(OverflowError):
            return msgpack.packb(mutated_tree(rng, tree))


def _manifests(rng: random.Random, folder: pathlib.Path) -> Iterator[str]:
    good = folder / "set"
    samples = list(drawn_solids.samples(6, seed=4, image_size=(24, 32)))
    write_dataset(good, {"train": samples}, source="campaign", records_per_shard=2)
    known = {RecordReader(good, "train").read(i) for i in range(6)}
    text = (good / MANIFEST).read_bytes()
    tree = json.loads(text)
    while True:
        by_bytes = rng.random() < 0.5
        changed = mutated(rng, text) if by_bytes else json.dumps(mutated_tree(rng, tree)).encode()
        (good / MANIFEST).write_bytes(changed)

        def read() -> str:
            reader = RecordReader(good, "train")
            reader.verify()
            records = [reader.read(i) for i in range(len(reader))]
            if not set(records) <= known or len(set(records)) < len(records):
                return "records that are not those of the set"
            return ""

        yield attempt(read, RecordError, changed.decode("latin1")[:1500])


def _predictions(rng: random.Random, folder: pathlib.Path) -> Iterator[str]:
    fields = {
        "points": np.zeros((2, 50, 3), np.float32),
        "branch": np.zeros(50, np.uint8),
        "image": np.zeros((24, 32, 3), np.uint8),
    }
    stream = io.BytesIO()
    np.savez(stream, **fields)
    while True:
        changed = mutated(rng, stream.getvalue())
        (folder / "a.npz").write_bytes(changed)

        def read() -> str:
            found = read_prediction(folder / "a.npz", tuple(fields))
            return "" if found["points"].shape[1:] == (50, 3) else "points of another shape"

        yield attempt(read, PredictionFileError, changed.hex()[:1500])


def _weights(rng: random.Random, folder: pathlib.Path) -> Iterator[str]:
    from helpers import weights as tiny

    from psgn_jax.training.state import named_leaves
    from psgn_jax.weights.file import WeightsError, read_weights, write_weights

    made = tiny.weights(tiny.config(), "float32")
    path = folder / "w.safetensors"
    write_weights(path, made)
    good, leaves = path.read_bytes(), named_leaves(made.params)
    while True:
        changed = mutated(rng, good)
        path.write_bytes(changed)

        def read() -> str:
            found = named_leaves(read_weights(path).params)
            same = found.keys() == leaves.keys() and all(
                np.array_equal(found[name], leaves[name]) for name in leaves
            )
            return "" if same else "other parameters were taken"

        yield attempt(read, WeightsError, f"{len(changed)} bytes")
