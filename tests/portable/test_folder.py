# ruff: noqa: E402

import hashlib
import json
import os
import pathlib
import runpy
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import linen as nn
from helpers import weights as helper
from helpers.commands import psgn
from helpers.refusals import check_message, refused
from PIL import ExifTags, Image

onnx = pytest.importorskip("onnx")

from psgn_jax.config.experiment import ConfigError
from psgn_jax.models.layers import convolve
from psgn_jax.portable import folder, onnx_file
from psgn_jax.portable.network import InputSpec, PortableNetwork
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.system.onnx_runtime import session
from psgn_jax.weights.file import write_weights
from psgn_jax.weights.run_folder import Trained


def make_run(size=(48, 64), **changes):
    config = helper.config(data__image_size=size, **changes)
    return Trained(config, 7, helper.random_params(config), {}, "tiny", "weights")


@pytest.mark.parametrize("changes", [
    {"model__name": "two_branch", "model__compute_dtype": "bfloat16"},  # r comes late; float32
    {"model__name": "hourglass", "size": (18, 24)},  # pads
], ids=lambda changes: changes["model__name"])  # fmt: skip
def test_the_files_give_the_points_of_jax(changes):
    network = PortableNetwork(make_run(model__random_size=3, **changes))
    run = session(onnx_file.to_onnx(network, network.inputs, "points", "float32", {}))
    arrays = folder.drawn_inputs(network)
    arrays["r"] = np.random.default_rng(0).normal(size=(8, 2, 3)).astype(np.float32)
    expected = np.asarray(jax.jit(network.__call__)(*arrays.values()))
    assert expected.shape[:-2] == (8, 2)
    first = {key: array[:1, :1] if key == "r" else array[:1] for key, array in arrays.items()}
    np.testing.assert_allclose(run(arrays), expected, atol=1e-5)
    np.testing.assert_allclose(run(first), expected[:1, :1], atol=1e-5)


def any_network(x, r):
    """Operations that the networks of this package do not have in this form."""
    kernel = jnp.linspace(-1, 1, 108).reshape(3, 3, 3, 4)
    y = nn.silu(x[..., 1:] * jnp.array([[[[2.0, 0.5, 1]]]])).transpose(0, 2, 1, 3)
    y = jnp.where(y > 0.2, y, -1.0).repeat(2, axis=1)
    y = nn.avg_pool(jnp.pad(y, ((0, 0), (1, 1), (2, 0), (0, 0)), mode="edge"), (2, 2), (2, 2))
    y = convolve(y, kernel, stride=2)
    y = jnp.clip(jnp.concatenate([y, jnp.ones_like(y[..., :1])], axis=-1), 0, 6)
    y = y.reshape(y.shape[0], 1, -1)
    return jnp.maximum(y, r) @ jnp.eye(60, 5) + r[..., :5]


def test_a_new_network_needs_no_code_for_its_file():
    shapes = {"x": ("batch", 8, 6, 4), "r": ("batch", "draws", 60)}
    inputs = [InputSpec(name, "float32", shape) for name, shape in shapes.items()]
    run = session(onnx_file.to_onnx(any_network, inputs, "y", "float32", {}))
    rng = np.random.default_rng(0)
    x, r = (rng.normal(size=shape).astype("f4") for shape in ((2, 8, 6, 4), (2, 3, 60)))
    np.testing.assert_allclose(run({"x": x, "r": r}), any_network(x, r), atol=1e-5)
    for function, *names in ((jnp.sort, "'sort'"), (lambda x: x.reshape(len(x), -1), "x.shape[0]")):
        with refused(folder.ExportError, *names):
            onnx_file.to_onnx(function, inputs[:1], "y", "float32", {})


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    out = tmp_path_factory.mktemp("export")
    source = "/home/ada/runs/tiny/."
    run = make_run(model__random_size=3)._replace(sources=helper.SOURCES, source=source)
    about = folder.write_folder(run, out / "network")
    return run, out / "network", about


def test_what_the_folder_says_of_itself(exported):
    _, out, about = exported
    assert json.loads((out / "network.json").read_text()) == about
    assert sorted(about["files"]) == ["network.onnx", "network_float16.onnx"]
    for name, row in about["files"].items():
        content = (out / name).read_bytes()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (row["bytes"], row["sha256"])
    assert np.shape(about["latents"]) == (1 + folder.LATENTS, 3)
    (own,) = (p.value for p in onnx.load(out / "network.onnx").metadata_props if p.key == "name")
    assert about["name"] == own == "tiny"  # without the folders of this machine
    text = (out / "README.md").read_text()
    assert "`r` | float32 [batch, draws, 3]" in text
    assert "chairs: CC-BY-3.0 (7 models: Ada, Bo)" in text
    assert "${" not in text
    full, half = (about["files"][name] for name in ("network.onnx", "network_float16.onnx"))
    assert full["largest_difference"] < 1e-5 < half["largest_difference"] < 1e-2
    assert half["bytes"] < 0.8 * full["bytes"]


@pytest.mark.parametrize(("size", "random_size", "alpha"), [((48, 64), 0, 255), ((60, 60), 3, 60)])
def test_the_python_example_predicts_the_networks_cloud(size, random_size, alpha, tmp_path):
    """Of a photo that is turned by its EXIF data; the example needs no package of ours."""
    run = make_run(size, model__random_size=random_size, model__fc_points=30)
    folder.write_folder(run, tmp_path, weights=("float32",))
    rgba = np.random.default_rng(0).integers(0, 256, (90, 140, 4), dtype=np.uint8)
    rgba[..., 3] = 0
    rgba[20:70, 30:110, 3] = alpha
    rgba[30:40, 60:70, 3] = 0
    turned = Image.Exif()
    turned[ExifTags.Base.Orientation] = 6
    Image.fromarray(np.rot90(rgba)).save(tmp_path / "photo.png", exif=turned)
    installed = str(pathlib.Path(onnx.__file__).parents[1])  # but not the clone
    environment = {**os.environ, "PYTHONPATH": installed, "PYTHONSAFEPATH": "1"}
    command = [sys.executable, "example.py", "photo.png", "cloud.xyz"]
    options = {"cwd": tmp_path, "env": environment, "timeout": 60, "text": True}
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, **options).stdout
    check_message(printed, "cloud.xyz", "network's cloud", "not fitted to the mask")
    expected = Predictor(run)(tmp_path / "photo.png", refine=False)
    np.testing.assert_array_equal(expected.photo.image, rgba[..., :3])
    np.testing.assert_allclose(np.loadtxt(tmp_path / "cloud.xyz"), expected.points[0], atol=1e-5)
    framed = runpy.run_path(str(tmp_path / "example.py"))["framed"]
    image, mask = framed(Image.fromarray(rgba))
    np.testing.assert_array_equal(image, expected.view.image)
    np.testing.assert_array_equal(mask, expected.view.mask)
    about = tmp_path / "network.json"
    about.write_text(about.read_text().replace(folder.FORMAT, "psgn_jax network 3"))
    failed = subprocess.run(command, stderr=subprocess.PIPE, **options)
    assert failed.returncode == 1
    check_message(failed.stderr, "network.json", "psgn_jax network 3")


def test_refused(tmp_path, monkeypatch):
    run = make_run()
    for stored in folder.ONNX_NAMES:
        with monkeypatch.context() as patch, refused(folder.ExportError, stored, "1e-09"):
            patch.setitem(folder.LARGEST_DIFFERENCE, stored, 1e-9)
            folder.write_folder(run, tmp_path, weights=(stored,))
    with refused(ConfigError, "int4", "float32, float16"):
        folder.write_folder(run, tmp_path, weights=("int4",))
    broken = jax.tree.map(lambda leaf: leaf * np.nan, run.params)
    with refused(folder.ExportError, "not finite"):
        folder.write_folder(run._replace(params=broken), tmp_path)
    with refused(ConfigError, "'rgb'"):
        folder.write_folder(make_run(data__inputs=("rgb", "mask", "depth")), tmp_path)
    assert not list(tmp_path.iterdir())


def test_the_command(tmp_path):
    write_weights(tmp_path / "tiny.safetensors", helper.weights(helper.config()))
    flags = ["--weights=tiny.safetensors", "--out=out", "--weights_as=float16"]
    psgn("export", *flags, cwd=tmp_path)
    about = json.loads((tmp_path / "out" / "network.json").read_text())
    assert about["name"] == "tiny"
    assert list(about["files"]) == ["network_float16.onnx"]
    assert about["sources"] == helper.SOURCES
