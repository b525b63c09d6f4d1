"""Kills, file errors, damage and hostile input, many times at random; counts what held.

    python tests/bench/reliability.py --minutes=60 [--seed=0] [--part=kill ...] --out=campaign-0

kill: a command gets one to three signals at random moments and is started again. Must hold: the
exit code of the signal, no traceback, no process left, and the result of an undisturbed command.

fault: one file operation of a command fails, or is the last one before a kill, or the disk is full
from then on. Must hold: exit code, one line, no traceback; the next start gives the result of an
undisturbed one.

damage: one file of a finished run or data set is changed, cut off or removed, and read. Must hold:
the result of the undamaged one, or exit code 2 and one line.

input: bytes or fields of a mesh, image, record, manifest, prediction or weights file are changed.
Must hold: within 20 s and 2 GiB a correct result, or the reader's documented error in one line.

The time is divided equally among the parts. `--out` gets a line of JSON for each trial that did not
hold, and `table.md`. The random choices depend on the seed; the moments of kills also on the speed
of the machine. Needs Linux, the extra `dev`, and a C compiler for `fault`. The exit code is 1 if
anything did not hold.
"""

import argparse
import collections
import dataclasses
import errno
import functools
import io
import itertools
import json
import os
import pathlib
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
import warnings
import zlib

import msgpack
import numpy as np
from PIL import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from helpers import drawn_solids, processes, standin
from helpers import weights as tiny
from helpers.commands import ROOT
from helpers.obj_text import CUBE, FACES, png
from helpers.shapenet_trees import write_r2n2
from helpers.small_runs import quick_environment, write_config, write_solids

from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model
from psgn_jax.data import photo, schema
from psgn_jax.data.codec import decode, encode
from psgn_jax.data.dataset import RecordReader, write_dataset
from psgn_jax.data.manifest import MANIFEST
from psgn_jax.data.schema import RecordError
from psgn_jax.viewing.predictions import PredictionFileError, read_prediction
from psgn_jax.weights.checkpoint import Checkpoints
from psgn_jax.weights.file import WeightsError, read_weights, write_weights
from psgn_jax.weights.leaves import named_leaves

FAULTS = {  # letter of `faults.c`, error number, accepted exit codes
    "EIO": ("e", errno.EIO, {0, 1, 2}),
    "no room": ("f", errno.ENOSPC, {0, 2, 5}),
    "short write": ("s", 0, {0, 2, 5}),
    "kill": ("k", 0, {0, 2, -9}),
}
TIMES = ("seconds", "samples_per_second", "seconds_per_sample")  # they depend on the clock


def make_commands(work):
    """Writes the inputs of all commands.

    Returns name -> (arguments of Python, those of a command that reads a damaged result). `{out}`
    is the folder of the result.
    """
    write_solids(work / "records")
    write_r2n2(work / "r2n2")
    photos, meshes = work / "photos", work / "meshes"
    photos.mkdir()
    meshes.mkdir()
    for number in range(4):
        picture(number).save(photos / f"{number}.png")
        (meshes / f"{number}.obj").write_text(CUBE + FACES)
    changes = {"train__steps": 24, "train__checkpoint_every": 4}
    config = standin.config(data__path=str(work / "records"), **changes)
    file = write_config(work / "tiny.py", config)
    train = ["-m", "psgn_jax.main", f"--config={file}", "--workdir={out}"]
    render = [
        "data_gen/render.py", "--catalogue=folder", f"--source={meshes}", "--out={out}",
        "--config.views=1", "--config.job.workers=1", "--config.models_per_shard=1",
        "--config.num_points=3000", "--config.job.variant=scalar", "--config.image.samples=1",
        "--config.camera.image_size=(24, 32)",
    ]  # fmt: skip
    run = f"--workdir={work / 'train'}"
    psgn = ["-m", "psgn_jax.commands.psgn"]
    convert = [*psgn, "convert", "r2n2", str(work / "r2n2"), "{out}", "--views=4"]
    read_records = (*psgn, "inspect", "{out}", f"--sheet={work / 'sheet.png'}")
    return {
        "train": (train, (*psgn, "evaluate", "--workdir={out}")),
        "train, 2 workers": ([*train, "--config.data.num_workers=2"], ()),
        "render": (render, read_records),
        "convert": (convert, read_records),
        "predict": ([*psgn, "predict", str(photos), run, "--out={out}"], ()),
        "evaluate": ([*psgn, "evaluate", run, "--out={out}/t", "--report={out}/gallery"], ()),
    }


def picture(number=0):
    """An object before the authors' grey."""
    image = Image.new("RGB", (80, 60), (191, 191, 191))
    image.paste((200, 60, 20 * number), (20, 15, 50 + number, 45))
    return image


def result_of(out):
    """The result in a folder without times: leaves of the last checkpoint, or contents of files."""

    def untimed(text):
        tree = json.loads(text)
        return {k: v for k, v in tree.items() if k not in TIMES} if isinstance(tree, dict) else tree

    if (out / "checkpoints").is_dir():
        last = Checkpoints(out / "checkpoints", read_only=True).restore_newest()
        lines = (out / "metrics.jsonl").read_text().splitlines()
        return (contents(last.leaves) if last else {}) | {"metrics": list(map(untimed, lines))}
    paths = [p for p in out.rglob("*") if p.is_file() and p.name[0] != "."]
    return {
        path.relative_to(out): (untimed if path.suffix == ".json" else bytes)(path.read_bytes())
        for path in paths
        if path.name != "models.jsonl"
    }


def contents(arrays):
    return {name: array.tobytes() for name, array in arrays.items()}


class Campaign:
    """The inputs, the commands and their undisturbed results, in a folder."""

    def __init__(self, work, rng):
        self.work, self.rng, self.log = work, rng, work / "log"
        self.environment = quick_environment(work) | {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
        self.commands = make_commands(work)
        self.results = {}

    def result(self, name):
        """The result of an undisturbed command, which stays in `work / name`."""
        if name not in self.results:
            _, wrong = self.run(self.commands[name][0], self.work / name, {0})
            if wrong:
                raise SystemExit(f"{name} fails undisturbed: {wrong}")
            self.results[name] = result_of(self.work / name)
        return self.results[name]

    def start(self, words, out, **variables):
        """Starts a command in a process group of its own; its output goes to `log`."""
        with open(self.log, "w") as log:
            return subprocess.Popen(
                [sys.executable, *(word.format(out=out) for word in words)], stdout=log, stderr=log,
                cwd=ROOT, env=self.environment | variables, text=True, start_new_session=True,
            )  # fmt: skip

    def wrong_end(self, code, accepted):
        """What did not hold when a command ended, or ""."""
        text = self.log.read_text(errors="replace")
        bad = code not in accepted or (code >= 0 and "Traceback" in text)
        return f"it ends with {code}: {text[-600:]}" if bad else ""

    def run(self, words, out, accepted, **variables):
        """Runs a command to its end; returns its exit code and what did not hold."""
        code = self.start(words, out, **variables).wait(600)
        return code, self.wrong_end(code, accepted)

    def again(self, name, out):
        """Runs a disturbed command to its end; returns what did not hold."""
        _, wrong = self.run(self.commands[name][0], out, {0})
        if wrong:
            return f"the next start: {wrong}"
        if result_of(out) != self.result(name):
            return "the result differs from an undisturbed one"
        # `predict` and `evaluate` leave the temporary files of other processes alone.
        left = [] if name in ("predict", "evaluate") else [*out.rglob("*tmp*")]
        return f"left behind: {left}" if left else ""

    def kill(self, out):
        name = self.rng.choice(list(self.commands))
        others = [signal.SIGTERM, signal.SIGINT] if name.startswith("train") else []
        for _ in range(self.rng.randint(1, 3)):
            number = self.rng.choice([signal.SIGKILL] * 4 + others)
            send = self.rng.choice((os.kill, os.killpg))
            kind = f"{name}: {number.name} to the {'group' if send is os.killpg else 'process'}"
            process = self.start(self.commands[name][0], out)
            time.sleep(self.rng.uniform(0, 12))
            send(process.pid, number)
            if wrong := self.wrong_end(process.wait(120), {0, -number, 128 + number}):
                return kind, wrong
            if not processes.wait_until(lambda of=process.pid: not processes.of_group(of), 15):
                return kind, f"processes live on: {processes.of_group(process.pid)}"
        return kind, self.again(name, out)

    def fault(self, out):
        library = self.work / "faults.so"
        if not library.exists():
            source = pathlib.Path(__file__).with_name("faults.c")
            build = ["cc", "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"]
            subprocess.run(build, check=True)
        name, fault = self.rng.choice(list(self.commands)), self.rng.choice(list(FAULTS))
        letter, number, codes = FAULTS[fault]
        at = int(2 ** self.rng.uniform(0, 8))
        variables = {"LD_PRELOAD": str(library), "PSGN_FAULT": f"{letter}:{number}:{at}:{out}"}
        _, wrong = self.run(self.commands[name][0], out, codes, **variables)
        wrong = wrong or self.again(name, out)
        return f"{name}: {fault}", wrong and f"operation {at}: {wrong}"

    def damage(self, out):
        name = self.rng.choice([name for name, (_, reader) in self.commands.items() if reader])
        self.result(name)
        shutil.copytree(self.work / name, out)
        file = self.rng.choice(sorted(p for p in out.rglob("*") if p.is_file()))
        data = file.read_bytes()
        damages = {
            "bytes changed": mutated(self.rng, data),
            "cut off": data[: self.rng.randrange(len(data) + 1)],
            "zeros": bytes(len(data)),
            "noise": self.rng.randbytes(self.rng.randrange(1, 5000)),
            "another text": self.rng.choice([b"", b"[]", b"null", b'{"a": {}}', b"[" * 100_000]),
            "removed": None,
        }
        damage = self.rng.choice(list(damages))
        content = damages[damage]
        file.unlink() if content is None else file.write_bytes(content)
        words, reader = self.commands[name]
        _, wrong = self.run(reader, out, {0, 1, 2})
        if not wrong:
            code, wrong = self.run(words, out, {0, 2})
            if not wrong and code == 0 and name == "train" and result_of(out) != self.result(name):
                wrong = "the result differs from an undisturbed one"
        return f"{name}: {damage}", wrong and f"{file.relative_to(out)}: {wrong}"


SECONDS, MEMORY = 20, 2 << 30  # for reading one input; growth of the peak memory in bytes

IMAGE_FORMATS = ("PNG", "JPEG", "GIF", "BMP", "TIFF", "WEBP", "PPM", "TGA")

_WORDS = (
    b"0", b"-1", b"1e300", b"nan", b"inf", b"99999999999999999999", b"[" * 2000, b"\0", b"\xff",
    b"../../etc/passwd", b"\n", b"", b"true", b"1.5", b"#", b"//", b"\\",
)  # fmt: skip
_VALUES = (
    None, True, -1, 0, 1, 2**31, 10**18, 1.5, 1e300, "", "x", "../x", "a\nb", [], [1], {}, {"a": 1},
)  # fmt: skip


def mutated(rng, data):
    """Some bytes or words of a file changed, removed, repeated or replaced."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        at = rng.randrange(len(out) + 1)
        end = min(len(out), at + rng.choice((1, 2, 4, 8, 64, 1000)))
        word = (b"", out[at:end] * 2, rng.choice(_WORDS), rng.randbytes(end - at))
        out[at:end] = rng.choice(word)
    return bytes(out)


def places(node):
    """Each container and key in a tree of dicts and lists."""
    for key in node if isinstance(node, dict) else range(len(node)):
        yield node, key
        if isinstance(node[key], dict | list):
            yield from places(node[key])


def mutated_tree(rng, tree):
    """A tree of dicts and lists with one value replaced or removed."""
    copy = msgpack.unpackb(msgpack.packb(tree))
    container, key = rng.choice(list(places(copy)))
    if rng.random() < 0.25:
        del container[key]
    elif isinstance(container[key], bytes):
        container[key] = mutated(rng, container[key])
    else:
        container[key] = rng.choice(_VALUES)
    return copy


def mutated_json(rng, data):
    return json.dumps(mutated_tree(rng, json.loads(data))).encode()


def mutated_record(rng, data):
    """A record with one value replaced or removed, and the right checksum."""
    body = msgpack.packb(mutated_tree(rng, msgpack.unpackb(data[4:])))
    return zlib.crc32(body).to_bytes(4, "little") + body


def hostile_inputs(folder):
    """Rows of a kind of input, its file, contents, a change, a reader, and the accepted error.

    The reader returns whether what it read is right.
    """
    import trimesh

    ball = trimesh.creation.icosphere(1)
    meshes = {f"a.{kind}": ball.export(file_type=kind) for kind in ("stl", "ply", "off", "glb")}
    meshes = {n: data.encode() if isinstance(data, str) else data for n, data in meshes.items()}
    (folder / "x.png").write_bytes(png((1, 2, 3)))
    material = b"newmtl a\nKd 1 0 0\nmap_Kd -s 1 1 x.png\nd 0.5\nnewmtl b\nKd .1 .2 .3\n"
    shape = f"mtllib m.mtl\n{CUBE}vt 0 0\nusemtl a\n{FACES}usemtl b\nf 1/1 2/1 3/1\n".encode()
    meshes |= {"m.mtl": material, "a.obj": shape}
    images = [io.BytesIO() for _ in IMAGE_FORMATS]
    for stream, kind in zip(images, IMAGE_FORMATS, strict=True):
        picture().save(stream, kind)
    solids = list(drawn_solids.samples(6, seed=4, image_size=(24, 32)))
    record = encode(dataclasses.replace(solids[0], points=solids[0].points[:100], normals=None))
    write_dataset(folder / "set", {"train": solids}, source="campaign", records_per_shard=2)
    known = {RecordReader(folder / "set", "train").read(i) for i in range(6)}
    fields = {"points": np.zeros((2, 50, 3), "f4"), "branch": np.zeros(50, "u1")}
    fields["image"] = np.zeros((24, 32, 3), "u1")
    np.savez(folder / "a.npz", **fields)
    made = tiny.weights(tiny.config(), "float32")
    write_weights(folder / "w.safetensors", made)

    def mesh(name):
        model = load_model(folder / ("a.obj" if name == "m.mtl" else name))
        size = np.linalg.norm(model.vertices, axis=1).max()
        return abs(size - 1) < 1e-3 and np.isfinite(model.normals).all()

    def image():
        array = photo.read_photo(folder / "image").image
        return array.dtype == np.uint8 and array.shape[2:] == (3,)

    def record_bytes():
        changed = (folder / "record").read_bytes()
        decode(changed)
        return changed == record

    def record_fields():
        schema.validate(decode((folder / "record").read_bytes()))
        return True

    def data_set():
        reader = RecordReader(folder / "set", "train")
        reader.verify()
        records = [reader.read(i) for i in range(len(reader))]
        return set(records) <= known and len(set(records)) == len(records)

    def prediction():
        return read_prediction(folder / "a.npz", tuple(fields))["points"].shape[1:] == (50, 3)

    def weights():
        read = read_weights(folder / "w.safetensors")
        return contents(named_leaves(read.params)) == contents(named_leaves(made.params))

    names = (f"set/{MANIFEST}", "a.npz", "w.safetensors")
    manifest, archive, stored = ((folder / name).read_bytes() for name in names)
    pictures = [stream.getvalue() for stream in images]
    rows = [
        ("image", "image", pictures, mutated, image, photo.PhotoError),
        ("record, bytes", "record", [record], mutated, record_bytes, ValueError),
        ("record, fields", "record", [record], mutated_record, record_fields, ValueError),
        ("manifest, bytes", names[0], [manifest], mutated, data_set, RecordError),
        ("manifest, fields", names[0], [manifest], mutated_json, data_set, RecordError),
        ("prediction", names[1], [archive], mutated, prediction, PredictionFileError),
        ("weights", names[2], [stored], mutated, weights, WeightsError),
    ]
    for name, data in meshes.items():
        reader = functools.partial(mesh, name)
        rows.append((f"mesh {name}", name, [data], mutated, reader, UnusableModelError))
    return [(kind, folder / name, *rest) for kind, name, *rest in rows]


def attempt(read, accepted):
    """Reads an input; returns what did not hold."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.signal(signal.SIGALRM, signal.default_int_handler)  # raises KeyboardInterrupt
    signal.alarm(SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            wrong = "" if read() else "a wrong result"
    except accepted as error:
        wrong = f"a message of several lines: {error}" if "\n" in str(error) else ""
    except BaseException as error:
        wrong = f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    return wrong or (f"{grown / 1e6:.0f} MB more memory" if grown > MEMORY else "")


PARTS = ("kill", "fault", "damage", "input")


def trials(part, work, seed):
    """Trials of a part, without end: what was done, and what did not hold, or ""."""
    rng = random.Random(f"{seed} {part}")
    if part == "input":
        rows = hostile_inputs(work)
        for kind, file, contents, change, read, refused in itertools.cycle(rows):
            for _, other, good, *_ in rows:
                other.write_bytes(good[0])
            file.write_bytes(change(rng, rng.choice(contents)))
            yield kind, attempt(read, refused)
    campaign = Campaign(work, rng)
    campaign.result("train")  # which `predict` and `evaluate` read
    while True:
        trial = work / "trial"
        shutil.rmtree(trial, ignore_errors=True)
        try:
            yield getattr(campaign, part)(trial)
        except Exception as error:  # a result that cannot be read has not held
            yield "a result that cannot be read", f"{type(error).__name__}: {error}"


def main():
    """Runs the campaign; returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--part", action="append", choices=PARTS, help="default: all")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    arguments = parser.parse_args()
    out = arguments.out.absolute()
    out.mkdir(parents=True)
    results, chosen = collections.defaultdict(list), arguments.part or PARTS
    for part in chosen:
        work = out / "work"
        work.mkdir()
        end = time.monotonic() + 60 * arguments.minutes / len(chosen)
        for kind, wrong in trials(part, work, arguments.seed):
            results[f"| `{part}` | {kind} |"].append(not wrong)
            if wrong:
                trial = sum(map(len, results.values()))
                line = {"part": part, "kind": kind, "trial": trial, "wrong": wrong}
                with open(out / "failures.jsonl", "a") as file:
                    file.write(json.dumps(line) + "\n")
            if time.monotonic() > end:
                break
        shutil.rmtree(work)
    rows = [f"{key} {len(held)} | {sum(held)} |" for key, held in sorted(results.items())]
    table = "\n".join(["| part | what | tried | held |", "|---|---|---|---|", *rows, ""])
    (out / "table.md").write_text(table)
    sys.stdout.write(table)
    return 0 if all(map(all, results.values())) else 1


if __name__ == "__main__":
    sys.exit(main())
