import json
import os
import signal
import subprocess
import sys

import pytest
from helpers import processes
from helpers.commands import ROOT
from helpers.refusals import check_message
from helpers.solid_models import SMALL, contents

from data_gen import cluster, job, settings
from data_gen.catalogues.open_catalogue import open_catalogue
from data_gen.engine import has_mitsuba

distributed = pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.skipif(not has_mitsuba(), reason="Mitsuba is not installed"),
    # Dask's own warnings: of ports, of the log and of processes that were killed.
    pytest.mark.filterwarnings("ignore"),
]

OPTIONS = settings.parse({**SMALL, "job": {**SMALL["job"], "models_per_worker": 2}})


@pytest.fixture
def dask(monkeypatch):
    """A cluster of two worker processes with one thread each."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    workers = {"n_workers": 2, "threads_per_worker": 1, "processes": True}
    quiet = {"dashboard_address": None, "scheduler_port": 0, "silence_logs": 50}
    with distributed.LocalCluster(**workers, **quiet) as found:
        yield found


@pytest.mark.slow
def test_same_bytes_as_the_local_job_though_worker_and_job_are_killed(dask, here, tmp_path):
    source = open_catalogue("procedural", "chair=2,table=2,couch=2")
    job.render_catalogue(source, tmp_path / "local", OPTIONS, render=here)

    def disturbed(tasks, context):
        victim = next(iter(dask.workers.values())).pid
        for number, result in enumerate(cluster.render_on(dask.scheduler_address, tasks, context)):
            if len(tasks) == 6 and number == 4:  # of three blocks of two, one is finished
                raise KeyboardInterrupt
            if len(tasks) < 6 and number == 0:
                os.kill(victim, signal.SIGKILL)
            yield result

    with pytest.raises(KeyboardInterrupt):
        job.render_catalogue(source, tmp_path / "out", OPTIONS, render=disturbed)
    done = job.render_catalogue(source, tmp_path / "out", OPTIONS, render=disturbed)
    assert (done.exit_code, done.statuses) == (0, {"ok": 6})
    assert contents(tmp_path / "out") == contents(tmp_path / "local")


@pytest.mark.slow
def test_a_scheduler_that_is_killed_ends_the_command_in_one_line(tmp_path):
    place, log = tmp_path / "scheduler.json", tmp_path / "log"
    started = []

    def start(*command, log=os.devnull):
        # The command tries to connect again for this time.
        wait = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "2s"}
        with open(log, "w") as file:
            started.append(subprocess.Popen([sys.executable, "-m", *command], cwd=tmp_path,
                                            env=os.environ | wait | {"PYTHONPATH": str(ROOT)},
                                            stdout=file, stderr=file))  # fmt: skip
        return started[-1]

    dask = ["--no-dashboard", f"--scheduler-file={place}"]
    scheduler = start("distributed.cli.dask_scheduler", "--port=0", *dask)
    try:
        start("distributed.cli.dask_worker", "--nworkers=1", "--nthreads=1", *dask)
        assert processes.wait_until(place.exists)
        address = json.loads(place.read_text())["address"]
        command = start("data_gen.render", "--catalogue=procedural", "--source=chair=400",
                        "--out=out", "--config.views=1", "--config.job.variant=scalar",
                        "--scheduler", address, log=log)  # fmt: skip
        assert processes.wait_until(lambda: "samples/s" in log.read_text())
        scheduler.kill()
        assert command.wait(60) == 2
        text = log.read_text()
        assert "Traceback" not in text
        check_message(text.splitlines()[-1], "error: ", f"--scheduler={address}")
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait(60)
