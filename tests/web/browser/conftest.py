import pytest
from helpers import weights as helper

from psgn_jax.weights.run_folder import Trained


@pytest.fixture(scope="session")
def run():
    """A network with a random input and random parameters."""
    # Few points, so that only one bijection with the mirror image is optimal.
    config = helper.config(data__image_size=(96, 128), model__random_size=3, model__fc_points=40)
    return Trained(config, 7, helper.random_params(config), {}, "tiny", "weights", helper.SOURCES)


@pytest.fixture(scope="session")
def site(tmp_path_factory, runtime, run):
    """Folder of the page, with float32 weights."""
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    from psgn_jax.web.browser.build import build_page

    folder = tmp_path_factory.mktemp("site")
    build_page(run, folder, weights="float32", runtime=runtime)
    return folder
