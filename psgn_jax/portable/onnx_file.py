"""Writes a PointOutNet as an ONNX file, from its parameters. Only this file imports onnx.

The graph repeats the network of `models.point_out_net` operator by operator. Feature maps are
stored as [b, c, h, w], the layout of ONNX's convolutions.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from psgn_jax.config.experiment import Config, has_deconv_branch
from psgn_jax.models import efficientnet, layers, mask_net, networks
from psgn_jax.models.inputs import BACKGROUND
from psgn_jax.portable.network import PortableNetwork

OPSET, IR_VERSION = 17, 8
"""Versions that onnxruntime has supported since 1.12 (2022), in browsers too."""

_TYPES = {"uint8": TensorProto.UINT8, "bool": TensorProto.BOOL, "float32": TensorProto.FLOAT}


def to_onnx(network: PortableNetwork, stored: str, texts: Mapping[str, str]) -> bytes:
    """The content of an ONNX file; its inputs and output are described in `portable.network`.

    Args:
      stored: the type in which kernels are stored; arithmetic is float32 in every case. "float16"
        halves the size of the file. "int8" reduces it to a quarter: integers with one scale for
        each output channel. Runtimes convert both to float32 once, at loading.
    """
    graph = _Graph(network.params, stored, network.config)
    points = graph.points()
    sizes = ["batch", "draws"] if network.config.model.random_size else ["batch"]
    inputs = [
        helper.make_tensor_value_info(item.name, _TYPES[item.dtype], item.shape)
        for item in network.inputs
    ]
    return _file(graph, inputs, points, "points", [*sizes, network.num_points, 3], texts)


def mask_network_to_onnx(params: Mapping[str, Any], side: int) -> bytes:
    """The ONNX file of a `models.mask_net.MaskNet`, its kernels stored as float16.

    It maps `image`, uint8 [1, side, side, 3], to `probabilities`, float32 [1, side / 2, side / 2].
    """
    graph = _Graph(params, "float16")
    inputs = [helper.make_tensor_value_info("image", TensorProto.UINT8, [1, side, side, 3])]
    half = [1, side // 2, side // 2]
    return _file(graph, inputs, graph.mask(side), "probabilities", half, {})


def _file(
    graph: "_Graph",
    inputs: Sequence[onnx.ValueInfoProto],
    result: str,
    name: str,
    shape: Sequence[int | str],
    texts: Mapping[str, str],
) -> bytes:
    """The content of a file with one output, the tensor `result` of the graph."""
    graph.nodes.append(helper.make_node("Identity", [result], [name]))
    output = helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
    model = helper.make_model(
        helper.make_graph(graph.nodes, "network", inputs, [output], graph.constants),
        opset_imports=[helper.make_opsetid("", OPSET)],
        producer_name="psgn_jax",
    )
    model.ir_version = IR_VERSION
    helper.set_model_props(model, dict(texts))
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString())


class _Graph:
    """The nodes and constants of the graph. A tensor is represented by its name.

    With a random input, a tensor has either one row for each image or one row for each image and
    draw. `_drawn` has the names of the latter.
    """

    def __init__(self, params: Mapping[str, Any], stored: str, config: Config | None = None):
        self.params, self.stored = params, stored
        if config is not None:
            self.config = config
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []
        self._drawn: set[str] = set()

    def node(self, operator: str, *inputs: str, **attributes: Any) -> str:
        """Appends a node; its output has one row per draw if one of its inputs does."""
        name = f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [name], name, **attributes))
        if self._drawn.intersection(inputs):
            self._drawn.add(name)
        return name

    def constant(self, array: Any, dtype: Any = np.float32) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(array, dtype), name))
        return name

    def integers(self, *values: int) -> str:
        return self.constant(values, np.int64)

    def kernel(self, array: np.ndarray, channel: int) -> str:
        """A kernel, whose axis `channel` is that of the output channels, in the stored type."""
        if self.stored == "float16":
            half = self.constant(array, np.float16)
            return self.node("Cast", half, to=TensorProto.FLOAT)
        if self.stored == "int8":
            others = tuple(axis for axis in range(array.ndim) if axis != channel)
            scale = np.abs(array).max(axis=others, keepdims=True) / np.float32(127)
            scale = np.where(scale > 0, scale, 1)
            levels = self.constant(np.rint(array / scale), np.int8)
            level = self.node("Cast", levels, to=TensorProto.FLOAT)
            return self.node("Mul", level, self.constant(scale))
        return self.constant(array)

    # --- layers -------------------------------------------------------------------------------

    def conv(self, x: str, layer: Mapping[str, Any], stride: int = 1, groups: int = 1) -> str:
        kernel = self.kernel(np.transpose(layer["kernel"], (3, 2, 0, 1)), 0)
        bias, strides = self.constant(layer["bias"]), [stride, stride]
        options = {"strides": strides, "group": groups, "auto_pad": "SAME_UPPER"}
        return self.node("Conv", x, kernel, bias, **options)

    def up(self, x: str, layer: Mapping[str, Any]) -> str:
        """`models.layers.ConvTranspose` with stride 2.

        JAX pads the input, with a zero after each pixel, by `k - 1 - pads`, and correlates it with
        the kernel. ONNX convolves, and crops `pads` from the full result.
        """
        flipped = np.asarray(layer["kernel"])[::-1, ::-1]
        size = len(flipped)
        before = size - 1 - (size + 1) // 2
        pads = [before, before, size - 2 - before, size - 2 - before]
        kernel = self.kernel(np.transpose(flipped, (2, 3, 0, 1)), 1)
        bias = self.constant(layer["bias"])
        return self.node("ConvTranspose", x, kernel, bias, strides=[2, 2], pads=pads)

    def dense(self, x: str, layer: Mapping[str, Any]) -> str:
        y = self.node("MatMul", x, self.kernel(np.asarray(layer["kernel"]), 1))
        return self.node("Add", y, self.constant(layer["bias"])) if "bias" in layer else y

    def relu(self, x: str) -> str:
        return self.node("Relu", x)

    def relu6(self, x: str) -> str:
        return self.node("Clip", x, self.constant(0), self.constant(6))

    def per_draw(self, x: str) -> str:
        """Repeats the rows of feature maps for each draw."""
        if x in self._drawn:
            return x
        ones = self.integers(1, 1, 1)
        draws = self.node("Shape", "r", start=1, end=2)
        sizes = self.node("Concat", self.integers(1), draws, ones, axis=0)
        x = self.node("Expand", self.node("Unsqueeze", x, self.integers(1)), sizes)
        x = self.rows(x)
        self._drawn.add(x)
        return x

    def rows(self, x: str) -> str:
        """Merges the axes of images and draws."""
        shape = self.node("Shape", x, start=2)
        return self.node("Reshape", x, self.node("Concat", self.integers(-1), shape, axis=0))

    def add(self, x: str, y: str) -> str:
        if self._drawn.intersection((x, y)):
            x, y = self.per_draw(x), self.per_draw(y)
        return self.node("Add", x, y)

    # --- parts of the network -----------------------------------------------------------------

    def bottleneck(self, x: str, params: Mapping[str, Any]) -> str:
        x = self.conv(x, params["down"], stride=2)
        if "random" in params:
            model = self.config.model
            sides = networks.build(model).padded_size
            height, width = (side >> (len(model.widths) - 1) for side in sides)
            shape = self.integers(-1, height, width, params["down"]["bias"].size)
            r = self.node("Reshape", self.dense(self.rows("r"), params["random"]), shape)
            r = self.node("Transpose", r, perm=[0, 3, 1, 2])
            self._drawn.add(r)
            x = self.add(x, r)
        return self.relu(x)

    def encoder(self, x: str, params: Mapping[str, Any]) -> tuple[list[str], str]:
        features = []
        for level in range(len(self.config.model.widths) - 1):
            if level:
                x = self.relu(self.conv(x, params[f"level{level}_down"], stride=2))
            i = 0
            while f"level{level}_conv{i}" in params:
                x = self.relu(self.conv(x, params[f"level{level}_conv{i}"]))
                i += 1
            features.append(x)
        return features, self.bottleneck(x, params["bottleneck"])

    def lite0(self, image: str, params: Mapping[str, Any]) -> list[str]:
        """The maps of `EfficientNetLite0`, of strides 2 to 32."""
        image = self.node("Mul", image, self.constant(255 / 128))
        image = self.node("Sub", image, self.constant(127 / 128))
        x = self.relu6(self.conv(image, params["stem"], 2))
        maps = {}
        for number, shape in enumerate(efficientnet.BLOCKS):
            layer, y = params[f"block{number}"], x
            if shape.expansion > 1:
                y = self.relu6(self.conv(y, layer["expand"]))
            groups = layer["depthwise"]["bias"].size
            y = self.relu6(self.conv(y, layer["depthwise"], shape.stride, groups))
            y = self.conv(y, layer["project"])
            x = maps[shape.map_stride] = self.node("Add", x, y) if shape.residual else y
        scales = efficientnet.SCALES
        return [self.node("Mul", y, self.constant(scales[stride])) for stride, y in maps.items()]

    def photo_encoder(self, x: str, params: Mapping[str, Any]) -> tuple[list[str], str]:
        """`PhotoEncoder`: the image and the maps of EfficientNet-Lite0, and the bottleneck."""
        features = [x]
        image = self.node("Slice", x, self.integers(0), self.integers(3), self.integers(1))
        others = self.node("Slice", x, self.integers(3), self.integers(99), self.integers(1))
        for y in self.lite0(image, params[efficientnet.NAME]):
            others = self.node("AveragePool", others, kernel_shape=[2, 2], strides=[2, 2])
            features.append(self.node("Concat", y, others, axis=1))
        return features, self.bottleneck(features[-1], params["bottleneck"])

    def merge(self, x: str, skip: str, params: Mapping[str, Any]) -> str:
        moved = self.up(x, params["up"]) if "up" in params else self.conv(x, params["down"], 2)
        x = self.relu(self.add(moved, self.conv(skip, params["skip"])))
        return self.relu(self.conv(x, params["conv"]))

    def decoder(
        self, x: str, features: Sequence[str], params: Mapping[str, Any], levels: Sequence[int]
    ) -> list[str]:
        """`Decoder` or `Reencoder`: replaces the features of these levels, one after the other."""
        features = list(features)
        for level in levels:
            x = features[level] = self.merge(x, features[level], params[f"level{level}"])
        return features

    def fully_connected(self, bottlenecks: Sequence[str], params: Mapping[str, Any]) -> str:
        *first, last = [self.flat(x) for x in bottlenecks]
        x = self.dense(last, params["hidden0"])
        for flat in first:
            y = self.relu(self.dense(flat, params["first_pass"]))
            x = self.node("Add", x, self.dense(y, params["carry"]))
        x = self.relu(x)
        for i in range(1, len(self.config.model.fc_widths)):
            x = self.relu(self.dense(x, params[f"hidden{i}"]))
        return self.node("Reshape", self.dense(x, params["points"]), self.integers(0, -1, 3))

    def flat(self, x: str) -> str:
        return self.node("Flatten", self.node("Transpose", x, perm=[0, 2, 3, 1]), axis=1)

    def image(self) -> str:
        """The input channels [b, c, h, w] (`models.inputs.stack_channels`), padded."""
        colour = self.node("Cast", "image", to=TensorProto.FLOAT)
        colour = self.node("Div", colour, self.constant(255))
        mask = self.node("Unsqueeze", "mask", self.integers(3))
        planes = {
            "rgb": self.node("Where", mask, colour, self.constant(BACKGROUND)),
            "mask": self.node("Cast", self.node("Not", mask), to=TensorProto.FLOAT),
        }
        x = self.node("Concat", *[planes[name] for name in self.config.data.inputs], axis=3)
        model = self.config.model
        target = networks.build(model).padded_size
        extra = [new - old for new, old in zip(target, model.image_size, strict=True)]
        if any(extra):
            low, high = [e // 2 for e in extra], [e - e // 2 for e in extra]
            x = self.node("Pad", x, self.integers(0, *low, 0, 0, *high, 0), mode="edge")
        return self.node("Transpose", x, perm=[0, 3, 1, 2])

    def mask(self, side: int) -> str:
        """`models.mask_net.MaskNet` of the input `image`."""
        image = self.node("Cast", "image", to=TensorProto.FLOAT)
        image = self.node("Div", image, self.constant(255))
        image = self.node("Transpose", image, perm=[0, 3, 1, 2])
        *finer, coarse = self.lite0(image, self.params[efficientnet.NAME])
        params = self.params["decoder"]
        where = np.transpose(mask_net.positions(side // 32, side // 32), (0, 3, 1, 2))
        x = self.node("Concat", coarse, self.constant(where), axis=1)
        for stride in mask_net.WIDTHS:
            x = self.conv(x, params[f"project{stride}"])
            if stride < 32:
                factors = self.constant([1, 1, 2, 2])
                options = {"mode": "nearest", "coordinate_transformation_mode": "asymmetric"}
                x = self.node("Resize", x, "", factors, **options, nearest_mode="floor")
                x = self.node("Add", x, self.conv(finer.pop(), params[f"skip{stride}"]))
            x = self.relu(x)
            for i in range(mask_net.CONVOLUTIONS[stride]):
                x = self.relu(self.conv(x, params[f"conv{stride}_{i}"]))
        logits = self.conv(x, params["logits"])
        return self.node("Squeeze", self.node("Sigmoid", logits), self.integers(1))

    def points(self) -> str:
        model, params = self.config.model, self.params
        encoder = self.photo_encoder if model.name == "lite0" else self.encoder
        features, x = encoder(self.image(), params["encoder"])
        bottlenecks, last = [x], len(features)
        if model.name == "hourglass":
            top = min(1, model.deconv_level)
            up, down = range(last - 1, top - 1, -1), range(top + 1, last)
            features = self.decoder(x, features, params["first_decoder"], up)
            features = self.decoder(features[top], features, params["reencoder"], down)
            x = self.bottleneck(features[-1], params["reencoder"]["bottleneck"])
            bottlenecks.append(x)
        clouds = []
        if model.fc_points:
            clouds.append(self.fully_connected(bottlenecks, params["fc"]))
        if has_deconv_branch(model.name):
            levels = range(last - 1, model.deconv_level - 1, -1)
            x = self.decoder(x, features, params["decoder"], levels)[model.deconv_level]
            x = self.conv(self.relu(self.conv(x, params["deconv_conv"])), params["deconv_points"])
            x = self.node("Transpose", x, perm=[0, 2, 3, 1])
            offset = layers.grid_offset(*networks.build(model).grid)
            x = self.node("Add", x, self.constant(offset))
            clouds.append(self.node("Reshape", x, self.integers(0, -1, 3)))
        cloud = self.node("Concat", *clouds, axis=1)
        if not self._drawn:
            return cloud
        shape = self.node("Concat", self.node("Shape", "r", end=2), self.integers(-1, 3), axis=0)
        return self.node("Reshape", cloud, shape)
