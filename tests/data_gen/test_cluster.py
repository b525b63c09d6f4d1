"""Rendering on a Dask cluster of two workers. Skipped without Dask or Mitsuba."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import warnings

import pytest
from helpers import processes
from helpers.small_renders import SMALL, contents

from data_gen import cluster, job, pool, settings
from data_gen.catalogues.open_catalogue import open_catalogue
from data_gen.engine import Variant, has_mitsuba
from data_gen.render_model import Context
from psgn_jax.data.manifest import load_manifest

distributed = pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.skipif(not has_mitsuba(), reason="Mitsuba is not installed"),
    # Dask's own warnings: of ports, of the log and of processes that were killed.
    pytest.mark.filterwarnings("ignore"),
]

ROOT = pathlib.Path(__file__).resolve().parents[2]
SOURCE = "chair=2,table=2,couch=2"
OPTIONS = settings.parse(SMALL)


@pytest.fixture(scope="module")
def dask():
    """A cluster of two worker processes with one thread each."""
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = str(ROOT)
    with (
        warnings.catch_warnings(action="ignore"),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None,
            scheduler_port=0, silence_logs=50,
        ) as found,
    ):  # fmt: skip
        yield found
    os.environ.pop("PYTHONPATH")
    if before is not None:
        os.environ["PYTHONPATH"] = before


@pytest.mark.slow
def test_same_bytes_as_the_local_job_though_a_worker_is_killed_and_the_job_broken_off(
    dask, tmp_path
):
    source = open_catalogue("procedural", SOURCE)
    local = job.render_catalogue(source, tmp_path / "local", OPTIONS)
    assert local.samples == 6

    def broken_off(tasks, context):
        for number, result in enumerate(cluster.render_on(dask.scheduler_address, tasks, context)):
            if number == 2:
                raise KeyboardInterrupt
            yield result

    with pytest.raises(KeyboardInterrupt):
        job.render_catalogue(source, tmp_path / "out", OPTIONS, render=broken_off)
    assert not load_manifest(tmp_path / "out", allow_incomplete=True).complete

    todo = []

    def with_a_death(tasks, context):
        todo.extend(tasks)
        victim = next(iter(dask.workers.values())).pid
        for number, result in enumerate(cluster.render_on(dask.scheduler_address, tasks, context)):
            if number == 0:
                os.kill(victim, signal.SIGKILL)
            yield result

    again = job.render_catalogue(source, tmp_path / "out", OPTIONS, render=with_a_death)
    assert len(todo) == 4
    assert (again.exit_code, again.statuses) == (0, {"ok": 6})
    assert contents(tmp_path / "out") == contents(tmp_path / "local")


@pytest.mark.slow
def test_a_scheduler_that_is_killed_ends_the_command_in_one_line(tmp_path):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    place, log = tmp_path / "scheduler.json", tmp_path / "log"

    def start(module, *arguments, **options):
        return subprocess.Popen(
            [sys.executable, "-m", module, *arguments], env=environment, cwd=tmp_path, **options
        )

    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = ["--no-dashboard", f"--scheduler-file={place}"]
    scheduler = start("distributed.cli.dask_scheduler", "--port=0", *dask, **quiet)
    started = [scheduler]
    try:
        assert processes.wait_until(place.exists)
        address = json.loads(place.read_text())["address"]
        worker = ["--nworkers=1", "--nthreads=1", "--death-timeout=60"]
        started.append(start("distributed.cli.dask_worker", *worker, *dask, **quiet))
        small = ["--config.views=1", "--config.job.variant=scalar", "--scheduler", address]
        with log.open("w") as file:
            started.append(
                start("data_gen.render", "--catalogue=procedural", "--source=chair=400",
                      "--out=out", *small, stdout=file, stderr=file)
            )  # fmt: skip
        assert processes.wait_until(lambda: " of 400 inputs, " in log.read_text())
        scheduler.kill()
        assert started[-1].wait(120) == 2
        text = log.read_text()
        assert "Traceback" not in text
        assert text.splitlines()[-1] == (
            f"error: --scheduler={address}: the connection was lost; run the command again, "
            "which continues"
        )
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait(60)


def test_a_scheduler_that_is_not_there_is_told(monkeypatch):
    real = distributed.Client
    monkeypatch.setattr(
        distributed, "Client", lambda address, **options: real(address, **{**options, "timeout": 1})
    )
    with pytest.raises(RuntimeError, match="no scheduler answers"):
        list(cluster.render_on("tcp://127.0.0.1:9", [], None))


def test_renderers_are_told_apart_from_models_that_cannot_start(tmp_path):
    context = Context(OPTIONS, "procedural", Variant("no such variant"), None)
    entry = open_catalogue("procedural", "table=1").models[0]
    with pytest.raises(RuntimeError, match="before they were ready"):
        pool.Renderer(context).render(0, entry)
