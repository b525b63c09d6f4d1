"""A page with a small network, and a server for it."""

import functools
import http.server
import os
import threading

import pytest
from helpers import weights as helper

from psgn_jax.config.experiment import ConfigError
from psgn_jax.web.page import browser_runtime
from psgn_jax.weights.run_folder import Trained


@pytest.fixture(scope="session")
def runtime():
    """Folder or archive of onnxruntime-web: `PSGN_BROWSER_RUNTIME`, or "" for the cache and npm."""
    given = os.environ.get("PSGN_BROWSER_RUNTIME", "")
    try:
        browser_runtime.runtime_files(given)
    except ConfigError as error:
        pytest.skip(str(error))
    return given


@pytest.fixture(scope="session")
def run():
    """A network with a random input and random parameters."""
    config = helper.config(
        data__image_size=(96, 128),
        model__name="two_branch",
        model__random_size=3,
        model__fc_points=40,
        model__deconv_level=1,
    )
    return Trained(config, 7, helper.random_params(config), {}, "tiny", "weights", helper.SOURCES)


@pytest.fixture(scope="session")
def site(tmp_path_factory, runtime, run):
    """Folder of the page, with float32 weights."""
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    from psgn_jax.web.page.build import build_page

    folder = tmp_path_factory.mktemp("site")
    build_page(run, folder, weights="float32", runtime=runtime)
    return folder


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A plain file server, such as `python -m http.server`."""

    def log_message(self, *_):
        pass


@pytest.fixture(scope="session")
def serve():
    """Serves a folder; returns its address."""
    servers = []

    def start(folder):
        handler = functools.partial(Quiet, directory=str(folder))
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}/"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()
