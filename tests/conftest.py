"""Shared fixtures. Strict promotion is set before anything is traced.

On a CPU, programs are compiled without LLVM's optimisation and, before jaxlib 0.11, without MLIR,
because the tests mostly compile. With an empty `XLA_FLAGS=` they run the compiled code that users
run.
"""

import functools
import gc
import http.server
import importlib.metadata
import os
import pathlib
import shutil
import threading

os.environ.setdefault("JAX_PLATFORMS", "cpu")
if os.environ["JAX_PLATFORMS"] == "cpu":
    flags = ["--xla_backend_optimization_level=0", "--xla_cpu_parallel_codegen_split_count=1"]
    if importlib.metadata.version("jaxlib").startswith("0.10."):  # jaxlib 0.11 lacks the flag
        flags.append("--xla_cpu_use_fusion_emitters=false")
    os.environ.setdefault("XLA_FLAGS", " ".join(flags))

import jax
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache
from jaxtyping import config as jaxtyping_config
from jaxtyping import install_import_hook

from psgn_jax.system.terminal import quiet_orbax

jax.config.update("jax_numpy_rank_promotion", "raise")
gc.disable()  # until the tests are collected

# The shapes and dtypes that annotations promise are checked at every call, in tests only.
CHECKED = ["psgn_jax.losses", "psgn_jax.models", "psgn_jax.evaluation"]
install_import_hook(CHECKED, "beartype.beartype")


def pytest_collection_finish():
    """Modules stay: to look through them at each garbage collection costs a tenth of the time."""
    gc.freeze()
    gc.enable()


_AUTHORS = pathlib.Path(__file__).resolve().parents[2] / "shared" / "psgn_batches"


@pytest.fixture(scope="session", autouse=True)
def quiet():
    """Orbax's threads may print errors that were raised as well; commands suppress them, too."""
    quiet_orbax()


@pytest.fixture(scope="module")
def keep_compiled(tmp_path_factory):
    """Each program is compiled once for all tests of the module.

    JAX keeps no program that calls oneDNN, so XLA computes the convolutions.
    """
    own = {
        "jax_compilation_cache_dir": str(tmp_path_factory.mktemp("compiled")),
        "jax_persistent_cache_min_compile_time_secs": 0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }
    before = {name: jax.config.values[name] for name in own}

    def use(values):
        for name, value in values.items():
            jax.config.update(name, value)
        compilation_cache.reset_cache()

    use(own)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PSGN_CONVOLUTIONS", os.environ.get("PSGN_CONVOLUTIONS", "xla"))
        yield
    use(before)


@pytest.fixture(scope="session")
def authors_batches() -> pathlib.Path:
    """Folder with the authors' published batches; `PSGN_AUTHORS_BATCHES` overrides the place."""
    path = pathlib.Path(os.environ.get("PSGN_AUTHORS_BATCHES", _AUTHORS))
    if not path.is_dir():
        pytest.skip(f"the authors' batches are not at {path}")
    return path


@pytest.fixture(scope="module")
def browser():
    """Chromium, if installed. It is closed before the next module, as asyncio needs."""
    api = pytest.importorskip("playwright.sync_api")
    names = ("chromium", "chromium-browser", "google-chrome")
    path = next(filter(None, map(shutil.which, names)), None)
    if path is None:
        pytest.skip("no Chromium")
    with api.sync_playwright() as playwright:
        flags = ["--no-sandbox", "--enable-unsafe-swiftshader"]  # WebGL without a GPU
        browser = playwright.chromium.launch(executable_path=path, args=flags)
        yield browser
        browser.close()


@pytest.fixture
def opened(browser):
    """Opens pages; at the end they must have logged nothing, and asked no other host."""
    complaints, requests, contexts = [], [], []

    def open_page(address, *, complain=True, **options):
        contexts.append(browser.new_context(**options))
        page = contexts[-1].new_page()
        if complain:
            page.on("console", lambda message: complaints.append(message.text))
            page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(address)
        return page

    yield open_page
    for context in contexts:
        context.close()
    # WebGL without a GPU logs that reading its pixels takes time.
    assert [text for text in complaints if "GL Driver Message" not in text] == []
    own = ("file:", "data:", "blob:", "http://127.0.0.1:")
    assert [url for url in requests if not url.startswith(own)] == []


@pytest.fixture(scope="session")
def runtime():
    """Folder or archive of onnxruntime-web: `PSGN_BROWSER_RUNTIME`, or "" for the cache and npm."""
    from psgn_jax.config.experiment import ConfigError
    from psgn_jax.web.browser.runtime import runtime_files

    given = os.environ.get("PSGN_BROWSER_RUNTIME", "")
    try:
        runtime_files(given)
    except ConfigError as error:
        pytest.skip(str(error))
    return given


@pytest.fixture(scope="session")
def serve():
    """Serves a folder plainly, as `python -m http.server` does; returns its address."""
    servers = []

    def start(folder):
        handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}/"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def unchecked_annotations(monkeypatch):
    """What a user has, who runs without the hook: the library's own errors for wrong arguments."""
    monkeypatch.setattr(jaxtyping_config, "jaxtyping_disable", True)
