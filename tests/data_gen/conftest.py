import pytest

from data_gen import engine
from data_gen.render_model import render_model
from psgn_jax.data.shards import Result


@pytest.fixture
def write(tmp_path):
    """Writes a text or bytes to a file of the test's folder; returns its path."""

    def write(name, content):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture(scope="session")
def trimesh():
    return pytest.importorskip("trimesh")


@pytest.fixture(scope="session")
def started():
    """Mitsuba in this process, in the variant without LLVM."""
    if not engine.has_mitsuba():
        pytest.skip("Mitsuba is not installed")
    engine.start("scalar_rgb")


@pytest.fixture(scope="session")
def here(started):
    """A `pool.Pool` that renders in this process."""

    def render(tasks, context):
        for number, entry in tasks:
            records, line = render_model(entry, context)
            yield Result(number, line, {entry.split: records})

    return render
