"""The extensions of examples/ work, and CONTRIBUTING says where each belongs in the package."""

import importlib
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import standin
from helpers.commands import ROOT
from helpers.refusals import check_message, refused
from PIL import Image

from data_gen.catalogues import open_catalogue
from data_gen.mesh import UnusableModelError
from data_gen.readers.load import READERS
from psgn_jax import losses
from psgn_jax.data import conversion
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.sources import shapenet
from psgn_jax.evaluation import clouds, table
from psgn_jax.losses.by_name import configured_loss
from psgn_jax.models import networks
from psgn_jax.portable.folder import write_network
from psgn_jax.tasks.run import evaluate_run
from psgn_jax.training import loop
from psgn_jax.weights.run_folder import open_run

REGISTRIES = (
    losses.LOSSES, networks.NETWORKS, clouds.METRICS, conversion.LAYOUTS,
    open_catalogue.CATALOGUES, READERS,
)  # fmt: skip


@pytest.fixture
def example(monkeypatch):
    """Imports an example by name; what it added is gone after the test."""
    monkeypatch.syspath_prepend(str(ROOT))
    before = [dict(registry) for registry in REGISTRIES]
    yield lambda name: importlib.import_module(f"examples.{name}")
    for registry, old in zip(REGISTRIES, before, strict=True):
        registry.clear()
        registry.update(old)
    for name in [name for name in sys.modules if name.startswith("examples.")]:
        del sys.modules[name]


def test_a_loss(example):
    module = example("loss")
    pred, gt = jax.random.uniform(jax.random.key(0), (2, 50, 3))
    loss = configured_loss(standin.config(loss__name="2*chamfer_huber_mean + emd_mean").loss)
    value, terms = loss(pred, gt)
    between = np.linalg.norm(np.asarray(pred)[:, None] - np.asarray(gt), axis=-1)
    want = sum(module.huber(between.min(axis) ** 2).mean() for axis in (0, 1))
    np.testing.assert_allclose(terms["chamfer_huber_mean"], want, rtol=1e-5)
    np.testing.assert_allclose(value, 2 * want + terms["emd_mean"], rtol=1e-5)
    assert jnp.isfinite(jax.grad(lambda x: loss(x, gt)[0])(pred)).all()
    near = gt + 1e-3 * pred
    ratio = module.chamfer_huber_mean(near, gt) / losses.chamfer_sq_mean(near, gt)
    np.testing.assert_allclose(ratio, 1, rtol=1e-3)


def test_a_network_and_a_metric(example, monkeypatch, tmp_path):
    example("network")
    example("metric")
    pred, gt = jnp.eye(3), jnp.array([[0.0, 0, 0], [0, 3, 0]])
    assert clouds.evaluate_pair(pred, gt)["hausdorff_radius"] == 2
    # The names of a configuration are fixed, so one of them stands for the new network.
    monkeypatch.setattr(networks, "build", lambda config: networks.NETWORKS["perceptron"](config))
    config = standin.config(model__name="vanilla", model__random_size=0, train__steps=6)
    state = loop.train(config, tmp_path / "run").state
    assert set(state.params) == {"Dense_0", "Dense_1"}
    run = open_run(tmp_path / "run")
    exported = write_network(run, tmp_path / "export", ("float32",))
    assert exported["files"]["network.onnx"]["largest_difference"] < 1e-5
    evaluation = evaluate_run(run)
    largest = evaluation.metrics["hausdorff_radius"]
    assert (largest**2 >= evaluation.metrics["cd_sq_pred_to_gt_radius2"]).all()
    assert "Hausdorff" in table.text(evaluation)
    assert "hausdorff_radius" in table.csv_text(evaluation)


def test_a_converter_whose_errors_do_not_name_their_model(example, tmp_path, rng):
    example("converter")
    for name in ("good", "torn"):
        folder = tmp_path / "src" / "02691156" / name
        folder.mkdir(parents=True)
        np.savetxt(folder / "points.txt", rng.uniform(-0.3, 0.3, (200, 3)))
        rgba = np.zeros((shapenet.IMAGE_SIDE, shapenet.IMAGE_SIDE, 4), np.uint8)
        rgba[40:90, 40:90] = 255
        Image.fromarray(rgba).save(folder / "view.png")
    (tmp_path / "src" / "02691156" / "torn" / "points.txt").write_text("1 2 three\n")
    _, refused = conversion.convert_models("mine", tmp_path / "src", tmp_path / "out")
    (sample,) = RecordReader(tmp_path / "out", "train")
    assert (sample.category, sample.model_id) == ("plane", "02691156/good")
    (message,) = refused
    check_message(message, "02691156/torn", "'three'")


def test_a_catalogue(example):
    example("catalogue")
    options = open_catalogue.parse_options("boxes", ["flatness=.1"])
    models = open_catalogue.open_catalogue("boxes", "2", **options).models
    model = models[1].load()
    assert len(model.faces) == 12
    assert model.vertices[:, 2].max() < 0.2
    out = np.einsum("fij,fij->fi", model.normals, model.corners() - model.vertices.mean(axis=0))
    assert (out > 0).all()


def test_a_format_of_meshes(example, tmp_path):
    example("mesh_format")
    (tmp_path / "good.raw").write_text("0 0 0 1 0 0 0 1 0\n0 0 0 0 1 0 0 0 1\n")
    (tmp_path / "torn.raw").write_text("0 0 0 1 0 0 0 1\n")
    good, torn = open_catalogue.open_catalogue("folder", tmp_path).models
    assert len(good.load().faces) == 2
    with refused(UnusableModelError, "nine numbers"):
        torn.load()
