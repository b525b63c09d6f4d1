"""The folder of `psgn export`: its files give JAX's points, its examples need no clone."""

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
from PIL import Image

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


def arrays_for(network, images, draws=2, seed=0):
    rng = np.random.default_rng(seed)
    sizes = {"batch": images, "draws": draws}
    arrays = {}
    for item in network.inputs:
        shape = [sizes.get(s, s) for s in item.shape]
        noise = rng.normal(size=shape)
        arrays[item.name] = {
            "uint8": (128 + 50 * noise).clip(0, 255).astype(np.uint8),
            "bool": noise > 0,
            "float32": noise.astype(np.float32),
        }[item.dtype]
    return arrays


@pytest.mark.parametrize("changes", [
    {"model__name": "two_branch"},  # r comes late
    {"model__name": "hourglass", "size": (18, 24)},  # pads
], ids=lambda changes: changes["model__name"])  # fmt: skip
def test_the_files_give_the_points_of_jax(changes):
    network = PortableNetwork(make_run(model__random_size=3, **changes))
    run = session(onnx_file.to_onnx(network, network.inputs, "points", "float32", {}))
    program = jax.export.deserialize(bytearray(network.stablehlo()))
    arrays = arrays_for(network, images=3)
    expected = np.asarray(network.compiled(*arrays.values()))
    assert expected.shape[:-2] == (3, 2)
    first = {key: array[:1, :1] if key == "r" else array[:1] for key, array in arrays.items()}
    np.testing.assert_allclose(run(arrays), expected, atol=1e-5)
    np.testing.assert_allclose(run(first), expected[:1, :1], atol=1e-5)
    np.testing.assert_allclose(program.call(*arrays.values()), expected, atol=1e-5)


def test_a_network_trained_in_bfloat16_computes_in_float32():
    network = PortableNetwork(make_run(model__compute_dtype="bfloat16"))
    assert network.config.model.compute_dtype == "float32"


def test_small_weights():
    network = PortableNetwork(make_run(model__name="two_branch", model__widths=(8, 16, 32)))
    inputs = folder.drawn_inputs(network)
    expected = np.asarray(network.compiled(*inputs.values()))
    sizes, errors = [], []
    for stored in folder.ONNX_NAMES:
        content = onnx_file.to_onnx(network, network.inputs, "points", stored, {})
        sizes.append(len(content))
        errors.append(np.abs(session(content)(inputs) - expected).max())
    assert sizes[1] < 0.6 * sizes[0]
    assert errors[0] < 1e-5 < errors[1] < 1e-3


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
    with pytest.raises(folder.ExportError, match="ONNX: the operation 'sort' of the network"):
        onnx_file.to_onnx(jnp.sort, inputs[:1], "y", "float32", {})


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
    assert sorted(about["files"]) == ["network.onnx", "network.stablehlo", "network_float16.onnx"]
    for name, row in about["files"].items():
        content = (out / name).read_bytes()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (row["bytes"], row["sha256"])
    assert np.shape(about["latents"]) == (1 + folder.LATENTS, 3)
    (own,) = (p.value for p in onnx.load(out / "network.onnx").metadata_props if p.key == "name")
    assert about["name"] == own == "tiny"  # without the folders of this machine
    text = (out / "README.md").read_text()
    assert "`r` | float32 [batch, draws, 3]" in text
    assert "chairs: CC-BY-3.0 (Ada, Bo)" in text
    assert "${" not in text
    assert 0 < about["files"]["network_float16.onnx"]["largest_difference"] < 1e-2


def without_this_package():
    """The environment of a process that can import installed packages, but not the clone."""
    installed = str(pathlib.Path(onnx.__file__).parents[1])
    return {**os.environ, "PYTHONPATH": installed, "PYTHONSAFEPATH": "1"}


@pytest.mark.parametrize(("size", "random_size", "alpha"), [((48, 64), 0, 255), ((60, 60), 3, 60)])
def test_the_python_example_predicts_as_this_package(
    size, random_size, alpha, tmp_path, monkeypatch
):
    run = make_run(size, model__random_size=random_size, model__fc_points=30)
    last = run.params["fc"]["points"]
    last["kernel"] *= np.float32(0.002)
    points = np.random.default_rng(1).uniform((-0.3, -0.2, 0), (0.3, 0.2, 0.15), (30, 3))
    points[:2, 1] = 0.8  # beside the mask
    last["bias"][:] = points.ravel()
    folder.write_folder(run, tmp_path, weights=("float32",), stablehlo=False)
    rgba = np.random.default_rng(0).integers(0, 256, (90, 140, 4), dtype=np.uint8)
    rgba[..., 3] = 0
    rgba[20:70, 30:110, 3] = alpha
    rgba[30:40, 60:70, 3] = 0
    Image.fromarray(rgba).save(tmp_path / "photo.png")
    command = [sys.executable, "example.py", "photo.png", "cloud.xyz"]
    environment = without_this_package() | {"PYTHONSAFEPATH": ""}  # it imports `silhouette`
    subprocess.run(command, check=True, cwd=tmp_path, env=environment, timeout=60)
    expected = Predictor(run)(rgba)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "cloud.xyz"), expected.points[0], atol=1e-4)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "silhouette", raising=False)
    framed = runpy.run_path(str(tmp_path / "example.py"))["framed"]
    image, mask = framed(Image.fromarray(rgba))
    np.testing.assert_array_equal(image, expected.view.image)
    np.testing.assert_array_equal(mask, expected.view.mask)


def test_stablehlo_is_called_with_jax_alone(exported, tmp_path):
    run, out, _ = exported
    network = PortableNetwork(run)
    arrays = arrays_for(network, 2)
    np.savez(tmp_path / "inputs.npz", **arrays)
    code = (
        "import jax, numpy as np, sys\n"
        "from jax import export\n"
        f"data = open({str(out / 'network.stablehlo')!r}, 'rb').read()\n"
        "a = np.load('inputs.npz')\n"
        "points = export.deserialize(bytearray(data)).call(a['image'], a['mask'], a['r'])\n"
        "assert not any(m.startswith(('psgn_jax', 'flax')) for m in sys.modules)\n"
        "np.save('points.npy', points)\n"
    )
    command = [sys.executable, "-c", code]
    subprocess.run(command, check=True, cwd=tmp_path, env=without_this_package(), timeout=60)
    expected = network.compiled(*arrays.values())
    np.testing.assert_allclose(np.load(tmp_path / "points.npy"), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("stored", "factor", "message"),
    [
        ("float32", 1.0002, r"differ from JAX's by 0\.0002, expected"),
        ("float32", np.nan, "differ from JAX's by nan"),
        ("float16", 1.02, r"float16 file's points differ from JAX's by 0\.02, expected"),
    ],
)
def test_a_file_that_differs_is_refused(stored, factor, message):
    expected = np.ones((2, 5, 3), np.float32)
    assert folder.check(stored, expected, expected) == 0
    with pytest.raises(folder.ExportError, match=message):
        folder.check(stored, expected * np.float32(factor), expected)


def test_wrong_arguments(tmp_path):
    run = make_run()
    with pytest.raises(ConfigError, match=r"^weights stored as int4: accepted: "):
        folder.write_folder(run, tmp_path, weights=("int4",))
    broken = jax.tree.map(lambda leaf: leaf * np.nan, run.params)
    with pytest.raises(folder.ExportError, match="not finite"):
        folder.write_folder(run._replace(params=broken), tmp_path)
    deep = make_run(data__inputs=("rgb", "mask", "depth"))
    with pytest.raises(ConfigError, match="an export expects a network with the inputs 'rgb'"):
        folder.write_folder(deep, tmp_path)
    assert not list(tmp_path.iterdir())


def test_the_command(tmp_path):
    weights = helper.weights(helper.config())
    write_weights(tmp_path / "tiny.safetensors", weights)
    flags = ["--weights=tiny.safetensors", "--out=out", "--weights_as=float16", "--nostablehlo"]
    psgn("export", *flags, cwd=tmp_path)
    about = json.loads((tmp_path / "out" / "network.json").read_text())
    assert about["name"] == "tiny"
    assert list(about["files"]) == ["network_float16.onnx"]
    assert about["sources"] == helper.SOURCES
