"""`tests/bench/gpu.py --tiny` runs every part on a CPU, so that it is known to run on a GPU."""

import os
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]


@pytest.mark.slow
def test_every_part_runs(tmp_path):
    done = subprocess.run(
        [sys.executable, str(ROOT / "tests/bench/gpu.py"), "--tiny", f"--work={tmp_path / 'work'}",
         f"--out={tmp_path / 'out'}", "--limit=1200"],
        capture_output=True, text=True, cwd=tmp_path, timeout=3600,
        env={**os.environ, "JAX_PLATFORMS": "cpu"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    table = (tmp_path / "out" / "gpu.md").read_text()
    for title in ("device and tests", "kernels of the losses", "training step", "data", "memory"):
        assert f"| {title} | " in table
    assert "| failed |" not in table
    assert "not measured" not in table
    assert "bijections: True" in table
    assert "| training debug, steps 0 to 6 | done |" in table
    assert {"metrics.jsonl", "training.log", "weights.safetensors"} <= set(
        os.listdir(tmp_path / "out")
    )
