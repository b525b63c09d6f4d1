"""All measurements on a GPU, in parts of at most 8 minutes, in one table.

    python tests/bench/gpu.py                     # all parts, the most important first
    python tests/bench/gpu.py --parts a b         # some parts
    python tests/bench/gpu.py --tiny              # every part on a CPU, to test that it runs

a  device, versions, the test suite on CUDA
b  kernels of the losses against the plain path: correctness and speed
c  training steps of the three networks: float32, TF32 and bfloat16, batches of 32 to 256
f  a training that resumes where the last call stopped; writes its weights and its log
d  the host's loader against data on the device
e  memory of the training steps

Each part runs in a separate process, which is ended after --limit seconds. It appends each figure
to WORK/rows.jsonl as soon as it is measured; later calls append to the same file. OUT/gpu.md is a
Markdown table of the latest figures of all calls. The table also lists measurements for which there
was no time. To get them, run the part again (compiled programs are kept), or restrict c and e with
--networks and --batches. --data names a folder of records; without it, synthetic samples are used.
"""

import argparse
import contextlib
import dataclasses
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

ORDER = ("a", "b", "c", "f", "d", "e")
TITLES = {
    "a": "device and tests",
    "b": "kernels of the losses",
    "c": "training step",
    "d": "data",
    "e": "memory",
    "f": "training",
}
NETWORKS = ("two_branch", "vanilla", "hourglass")
TINY_MODEL = {
    "widths": (4, 6, 8), "fc_points": 16, "fc_widths": (16,), "deconv_level": 1,
}  # fmt: skip


class Part:
    """Writes the figures of one part, and keeps its time limit."""

    def __init__(self, name, arguments):
        self.arguments, self.tiny = arguments, arguments.tiny
        self._name = name
        self._rows = pathlib.Path(arguments.work) / "rows.jsonl"
        self._until = time.monotonic() + 0.85 * arguments.limit

    def row(self, what, value, remark=""):
        entry = {"part": self._name, "what": what, "value": value, "remark": remark}
        with self._rows.open("a") as file:
            file.write(json.dumps(entry) + "\n")
        print(f"{self._name} | {what} | {value} | {remark}", flush=True)

    @property
    def left(self):
        """Seconds that are left; after that, a case is not begun, and its row is "not measured"."""
        return self._until - time.monotonic()


@contextlib.contextmanager
def failing_softly(part, what):
    """Context that turns an error into a row, so that the other cases are still measured."""
    try:
        yield
    except Exception as error:
        part.row(what, "failed", " ".join(f"{type(error).__name__} {error}".split())[:300])


def seconds_of(call, budget, least=5):
    """Median, least and largest seconds of a call, after a first call that compiles."""
    import jax

    jax.block_until_ready(call())
    times, begin = [], time.perf_counter()
    while len(times) < least or (time.perf_counter() - begin < budget and len(times) < 50):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return float(np.median(times)), min(times), max(times)


# --- a: device and tests -----------------------------------------------------------------------


def device(part):
    import jax
    import jaxlib

    found = jax.devices()
    part.row("device", f"{len(found)} x {found[0].device_kind}", found[0].platform)
    part.row("Python, jax, jaxlib", f"{sys.version.split()[0]}, {jax.__version__}, "
             f"{jaxlib.__version__}")  # fmt: skip
    query = ["nvidia-smi", "--query-gpu=driver_version,memory.total,clocks.max.sm",
             "--format=csv,noheader"]  # fmt: skip
    with contextlib.suppress(OSError, subprocess.CalledProcessError):
        shown = subprocess.run(query, capture_output=True, text=True, check=True).stdout
        part.row("driver, memory, clock", shown.strip())
    folders = ["tests/training/test_launch.py"]
    if not part.tiny:
        folders = [f"tests/{name}" for name in ("losses", "models", "metrics", "training", "tasks")]
    platforms = "cpu" if found[0].platform == "cpu" else "cuda,cpu"
    log = pathlib.Path(part.arguments.out) / "tests.log"
    with log.open("w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", "-q", "--maxfail=40", *folders],
            stdout=file, stderr=subprocess.STDOUT, cwd=ROOT,
            env=os.environ | {"JAX_PLATFORMS": platforms},
        )  # fmt: skip
        try:
            process.wait(max(60.0, part.left))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    lines = log.read_text().strip().splitlines() or [""]
    part.row("tests " + " ".join(folders), lines[-1].strip("= ") or "no output",
             f"exit code {process.returncode}; {log.name}")  # fmt: skip


# --- b: kernels --------------------------------------------------------------------------------


def kernels(part):
    import jax
    import kernels as bench

    from psgn_jax import losses
    from psgn_jax.losses.kernels import auction, chamfer

    interpret = jax.default_backend() != "gpu"
    if interpret and not part.tiny:
        return part.row("kernels", "not measured", f"no GPU: {jax.default_backend()}")
    for name, module in () if interpret else (("Chamfer", chamfer), ("auction", auction)):
        with failing_softly(part, f"{name} kernel on a small problem"):
            part.row(f"{name} kernel on a small problem", "right" if module.trial() else "wrong")
    rate, pairs = bench.lane_rate(), 2 if part.tiny else 32
    sizes = [(40, 70)] if part.tiny else [(1024, 16384), (1024, 1024), (1024, 4096)]
    for n, m in sizes:
        a, b = bench.clouds("near", pairs, n, m, np.random.default_rng(0))
        truth = None
        for with_kernels in (False, True):
            bench.path(with_kernels, interpret)
            what = f"Chamfer {pairs} x {n} x {m}, {'kernel' if with_kernels else 'plain'}"
            with failing_softly(part, what):
                batch = jax.vmap(losses.chamfer_sq_mean)
                both = jax.value_and_grad(lambda a, b, batch=batch: batch(a, b).sum(), (0, 1))
                compiling, forward, value = bench.measure(batch, (a, b), 1.0)
                _, backward, _ = bench.measure(both, (a, b), 1.0)
                truth = value if truth is None else truth
                floor = 1e3 * pairs * n * m * 8 / rate if rate else None
                over = f"{forward / floor:.1f} times the floor; goal 3; " if floor else ""
                part.row(what, f"{forward:.3f} ms, with gradient {backward:.3f} ms",
                         f"{over}compiled in {compiling:.0f} s; largest relative difference "
                         f"{abs(value / truth - 1).max():.1e}")  # fmt: skip
    for kind in ("near", "far"):
        n = 32 if part.tiny else 1024
        a, b = bench.clouds(kind, pairs, n, n, np.random.default_rng(0))
        for with_kernels in (False, True):
            bench.path(with_kernels, interpret)
            what = f"EMD {pairs} x {n}, {kind}, {'kernel' if with_kernels else 'plain'}"
            with failing_softly(part, what):
                solve = jax.vmap(losses.assign)
                compiling, forward, found = bench.measure(solve, (a, b), 2.0)
                bijections = (np.sort(found.index, axis=1) == np.arange(n)).all()
                part.row(what, f"{forward:.2f} ms",
                         f"goal 15 ms; compiled in {compiling:.0f} s; bijections: {bijections}; "
                         f"worst gap {float(found.gap.max()):.4f}")  # fmt: skip


# --- c and e: training steps -------------------------------------------------------------------


def configuration(part, name, batch, dtype="float32", loss="chamfer_sq_mean"):
    from psgn_jax.config import parse

    model = {"name": name, "compute_dtype": dtype}
    data = {"num_points": 1024 if "emd" in loss else 4096}
    if part.tiny:
        model |= TINY_MODEL
        data = {"image_size": (16, 32)}
        data["num_points"] = 144 if "emd" in loss else 64  # 144: as many as predicted (8 x 16 + 16)
    tree = {"model": model, "data": data, "train": {"batch_size": batch, "steps": 1000},
            "loss": {"name": loss}, "optim": {"ema_decay": 0.999}}  # fmt: skip
    return parse(tree)


def prepared_step(config):
    """State, batch and compiled training step of a configuration."""
    import jax

    from psgn_jax import tasks
    from psgn_jax.training import state as state_lib
    from psgn_jax.training import step as step_lib

    task = tasks.create(config, pathlib.Path("."))
    tx = state_lib.optimizer(config.optim, config.train.steps)
    mesh = step_lib.data_mesh(jax.devices()[:1])
    rng, (height, width) = np.random.default_rng(0), config.data.image_size
    count = config.train.batch_size
    batch = {
        "image": rng.integers(0, 255, (count, height, width, 3), np.uint8),
        "mask": rng.random((count, height, width)) < 0.5,
        "points": rng.normal(0, 0.3, (count, config.data.num_points, 3)).astype(np.float32),
    }
    replicated = jax.sharding.NamedSharding(mesh, step_lib.P())
    create = jax.jit(lambda: task.create(tx), out_shardings=replicated)
    return create, step_lib.put_batch(batch, mesh, task.keys), task.train_step(tx, mesh)


def matmul_rate(precision, size):
    """Operations per second of a matrix product, as the peak of the device."""
    import jax
    import jax.numpy as jnp

    dtype = jnp.bfloat16 if precision == "bfloat16" else jnp.float32
    setting = "float32" if precision == "float32" else "tensorfloat32"
    with jax.default_matmul_precision(setting):
        product = jax.jit(jnp.matmul)
        x = jnp.ones((size, size), dtype)
        _, least, _ = seconds_of(lambda: product(x, x), 0.5)
    return 2 * size**3 / least


def steps(part):
    import jax

    precisions = {"TF32": "tensorfloat32", "bfloat16": "bfloat16", "float32": "float32"}
    peaks = {}
    for label, precision in precisions.items():
        with failing_softly(part, f"matrix product, {label}"):
            peaks[label] = matmul_rate(precision, 256 if part.tiny else 8192)
            part.row(f"matrix product, {label}", f"{peaks[label] / 1e12:.1f} TFLOP/s")
    cases = [("two_branch", 32, "TF32", "chamfer_sq_mean"),
             ("two_branch", 32, "TF32", "emd_mean")]  # fmt: skip
    batches, networks = part.arguments.batches, part.arguments.networks
    if part.tiny:
        batches = [4]
        cases = [(name, 4, label, loss) for name, _, label, loss in cases]
    cases += [(name, batch, label, "chamfer_sq_mean")
              for batch in batches for name in networks for label in precisions]  # fmt: skip
    for case in dict.fromkeys(cases):
        name, batch, label, loss = case
        what = f"{name}, batch {batch}, {label}, {loss}"
        if part.left < 0:
            part.row(what, "not measured", "no time left")
            continue
        with failing_softly(part, what):
            dtype = "bfloat16" if label == "bfloat16" else "float32"
            setting = "float32" if label == "float32" else "tensorfloat32"
            with jax.default_matmul_precision(setting):
                seconds, flops = step_seconds(configuration(part, name, batch, dtype, loss))
            median, least, most = seconds
            share = f"{flops / median / peaks[label]:.2f} of the peak" if label in peaks else ""
            goal = "; goal 6 ms" if (name, batch) == ("two_branch", 32) else ""
            part.row(what, f"{1e3 * median:.2f} ms, {batch / median:.0f} samples/s",
                     f"{1e3 * least:.2f} to {1e3 * most:.2f} ms; {share}{goal}")  # fmt: skip


def step_seconds(config):
    """(Median, least, largest) seconds of a training step, and its operations."""
    import jax

    create, batch, train_step = prepared_step(config)
    state = create()
    flops = (jax.jit(train_step).lower(state, batch).cost_analysis() or {}).get("flops", 0.0)

    def run():
        nonlocal state
        state, metrics = train_step(state, batch)
        return metrics["loss"]

    return seconds_of(run, 1.0), flops


def memory(part):
    import jax

    statistics = jax.devices()[0].memory_stats() or {}
    if "bytes_limit" in statistics:
        part.row("memory for JAX", f"{statistics['bytes_limit'] / 1e9:.1f} GB")
    for batch in [4] if part.tiny else part.arguments.batches:
        for name in part.arguments.networks:
            what = f"{name}, batch {batch}, float32"
            if part.left < 0:
                part.row(what, "not measured", "no time left")
                continue
            with failing_softly(part, what):
                create, data, train_step = prepared_step(configuration(part, name, batch))
                state = jax.eval_shape(create)
                found = jax.jit(train_step).lower(state, data).compile().memory_analysis()
                total = found.temp_size_in_bytes + found.argument_size_in_bytes
                part.row(what, f"{total / 1e6:,.1f} MB",
                         f"{found.temp_size_in_bytes / 1e6:,.1f} MB of it temporary")  # fmt: skip


# --- d: data -----------------------------------------------------------------------------------


def records(part):
    """A folder of records: --data, or synthetic samples that are written once."""
    if part.arguments.data:
        return part.arguments.data
    from helpers import drawn_solids

    from psgn_jax.data.dataset import write_dataset
    from psgn_jax.data.manifest import MANIFEST

    folder = pathlib.Path(part.arguments.work) / ("drawn_tiny" if part.tiny else "drawn")
    if not (folder / MANIFEST).exists():
        size, count = ((16, 32), 24) if part.tiny else ((192, 256), 600)
        splits = {
            "train": drawn_solids.samples(count, seed=0, image_size=size),
            "validation": drawn_solids.samples(count // 4, seed=1, image_size=size),
        }
        write_dataset(folder, splits, source="solids")
    return str(folder)


def data(part):
    import jax

    from psgn_jax.data import loader, on_device
    from psgn_jax.training import step as step_lib

    base = configuration(part, "two_branch", 4 if part.tiny else 32)
    plain = dataclasses.replace(base.data, path=records(part), cache_gb=0.0)
    augmented = dataclasses.replace(plain, flip=True, stretch=0.15, colour_jitter=0.2)
    mesh, keys = step_lib.data_mesh(jax.devices()[:1]), ("image", "mask", "points")
    batch_size, budget = base.train.batch_size, 1.0 if part.tiny else 8.0
    given = {"batch_size": batch_size, "seed": 0, "start_step": 0}

    def host(cfg):
        return step_lib.put_batches(loader.train_batches(cfg, **given), mesh, keys)

    def device(cfg):
        return on_device.train_batches(cfg, mesh, keys=keys, **given)

    def cached(cfg):
        return host(dataclasses.replace(cfg, cache=True))

    create, _, train_step = prepared_step(base)
    for label, cfg in (("", plain), (", augmented", augmented)):
        for name, make in (("device", device), ("host, cached", cached), ("host", host)):
            what = f"batches of the {name}{label}"
            with failing_softly(part, what):
                begin = time.perf_counter()
                batches = make(cfg)
                jax.block_until_ready(next(batches))
                started = time.perf_counter() - begin
                median, *_ = seconds_of(lambda b=batches: next(b), budget)
                state = create()

                def train(b=batches):
                    nonlocal state
                    state, metrics = train_step(state, next(b))
                    return metrics["loss"]

                whole, *_ = seconds_of(train, budget)
                batches.close()
                part.row(what, f"{batch_size / median:.0f} samples/s",
                         f"with the step of {base.model.name}: {batch_size / whole:.0f}; "
                         f"first batch after {started:.1f} s")  # fmt: skip


# --- f: a training -----------------------------------------------------------------------------


def training(part):
    from psgn_jax.training.log import read_metrics

    arguments = part.arguments
    run = pathlib.Path(arguments.work) / ("run_tiny" if part.tiny else "run")
    out = pathlib.Path(arguments.out)
    flags = list(arguments.train_flags)
    config = "debug" if part.tiny else arguments.config
    if part.tiny:
        flags += ["--config.train.steps=6", "--config.train.eval_every=3",
                  "--config.data.image_size=(16,32)", "--config.data.num_points=64",
                  "--config.data.num_eval_points=64", "--config.model.widths=(4,6,8)",
                  "--config.model.deconv_level=1", "--config.train.images_every=0"]  # fmt: skip
    command = [sys.executable, "-m", "psgn_jax.main", f"--config={config}", f"--workdir={run}",
               f"--config.data.path={records(part)}", "--config.data.on_device=True",
               *flags]  # fmt: skip
    metrics = run / "metrics.jsonl"
    before = max((entry["step"] for entry in read_metrics(metrics)), default=0)
    log = out / "training.log"
    with log.open("a") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, cwd=ROOT)
        try:
            process.wait(max(20.0, part.left - 40))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGTERM)  # the training saves a checkpoint and ends
            process.wait()
    entries = read_metrics(metrics)
    after = max((entry["step"] for entry in entries), default=0)
    speeds = [e["samples_per_second"] for e in entries if "samples_per_second" in e]
    state = {0: "done", 143: "continues at the next call"}.get(process.returncode, "failed")
    part.row(f"training {config}, steps {before} to {after}", state,
             f"median {np.median(speeds or [np.nan]):.0f} samples/s; {log.name}")  # fmt: skip
    for entry in [e for e in entries if e["kind"] == "eval"][-1:]:
        scores = {k: round(entry[k], 6) for k in ("cd_sq_radius2", "emd_radius") if k in entry}
        part.row(f"evaluation at step {entry['step']}", json.dumps(scores))
    if metrics.exists():
        shutil.copy(metrics, out / "metrics.jsonl")
    export(part, run, out)


def export(part, run, out):
    """Exports the best weights in half precision, as one file or in pieces of --piece_mb."""
    path = run / "weights.safetensors"
    subprocess.run([sys.executable, "-m", "psgn_jax.weights", "export", f"--workdir={run}",
                    f"--out={path}"], check=True, cwd=ROOT, capture_output=True)  # fmt: skip
    content = path.read_bytes()
    size = int(part.arguments.piece_mb * 1e6) or len(content)
    pieces = [content[i : i + size] for i in range(0, len(content), size)]
    first, last = (int(n) for n in part.arguments.pieces.split(":"))
    for number, piece in enumerate(pieces):
        if first <= number < last:
            name = path.name if len(pieces) == 1 else f"{path.name}.{number:02d}"
            (out / name).write_bytes(piece)
    remark = f"in {len(pieces)} pieces: cat {path.name}.* > {path.name}" if pieces[1:] else ""
    part.row("weights", f"{len(content) / 1e6:.1f} MB", remark)


PARTS = {"a": device, "b": kernels, "c": steps, "d": data, "e": memory, "f": training}


# --- the command -------------------------------------------------------------------------------


def table(rows):
    """The latest figures as a Markdown table, in the order of the parts."""
    latest = {(row["part"], row["what"]): row for row in rows}
    lines = ["| | measured | figure | remark |", "|---|---|---|---|"]
    for row in sorted(latest.values(), key=lambda row: row["part"]):
        cells = (TITLES[row["part"]], row["what"], row["value"], row["remark"])
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def run_part(name, argv, limit):
    """Runs a part in a separate process; returns whether it ended by itself."""
    command = [sys.executable, str(pathlib.Path(__file__).resolve()), *argv, "--one", name]
    process = subprocess.Popen(command, start_new_session=True)
    try:
        return process.wait(limit) == 0
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return False


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="*", default=list(ORDER), choices=ORDER)
    parser.add_argument("--tiny", action="store_true", help="small cases, for a test on a CPU")
    parser.add_argument("--work", default="build/gpu", help="kept between calls: rows, the run")
    parser.add_argument("--out", default="", help="the table, logs and weights; default: WORK/out")
    parser.add_argument("--limit", type=float, default=480.0, help="seconds of a part, at most")
    parser.add_argument("--data", default="", help="folder of records for d and f")
    parser.add_argument("--networks", nargs="*", default=list(NETWORKS), help="of c and e")
    parser.add_argument("--batches", nargs="*", type=int, default=[32, 64, 128, 256])
    parser.add_argument("--config", default="authors", help="configuration of f")
    parser.add_argument("--train_flags", nargs="*", default=[], metavar="config.NAME=VALUE",
                        type=lambda text: f"--{text}", help="fields of f")  # fmt: skip
    parser.add_argument("--piece_mb", type=float, default=0.0, help="f: size of a piece of weights")
    parser.add_argument("--pieces", default="0:99", help="f: the pieces that are written")
    parser.add_argument("--one", default="", choices=["", *ORDER], help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    arguments.out = arguments.out or str(pathlib.Path(arguments.work) / "out")
    for folder in (arguments.work, arguments.out):
        pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
    if arguments.tiny:
        os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
    compiled = pathlib.Path(arguments.work).absolute() / "compiled"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(compiled))
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(ROOT), os.getenv("PYTHONPATH"))))
    if arguments.one:
        return PARTS[arguments.one](Part(arguments.one, arguments))
    rows = pathlib.Path(arguments.work) / "rows.jsonl"
    failed = []
    for name in arguments.parts:
        begin = time.monotonic()
        ended = run_part(name, sys.argv[1:], arguments.limit)
        seconds = time.monotonic() - begin
        if not ended:
            failed.append(name)
        part = Part(name, arguments)
        part.row("seconds of this part", f"{seconds:.0f}", "" if ended else "did not end by itself")
        text = rows.read_text().splitlines()
        (pathlib.Path(arguments.out) / "gpu.md").write_text(table(map(json.loads, text)))
    print(f"\n{(pathlib.Path(arguments.out) / 'gpu.md').read_text()}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
