"""The two-branch network in PyTorch, layer for layer, for comparison in `step.py`.

Only the benchmark uses it. Padding is symmetric, unlike TensorFlow's SAME, which pads one side
more: the number of operations is the same, and PyTorch is fastest with symmetric padding.
"""

import itertools

import torch
from torch import nn
from torch.nn import functional


class TwoBranch(nn.Module):
    """The network "two_branch" of `psgn_jax.models.point_out_net`, without random input."""

    def __init__(
        self, in_channels, image_size, widths, fc_points, fc_widths, deconv_level, deconv_channels
    ):
        super().__init__()
        last = len(widths) - 1
        self.levels = nn.ModuleList()
        channels = in_channels
        for level, width in enumerate(widths[:-1]):
            convs = [_conv(channels, width, 3, stride=2)] if level else []
            for i in range(3 if level == last - 1 else 2):
                convs.append(_conv(channels if level == i == 0 else width, width, 3))
            self.levels.append(nn.ModuleList(convs))
            channels = width
        self.bottleneck = _conv(channels, widths[-1], 5, stride=2)
        cells = (image_size[0] >> last) * (image_size[1] >> last)
        sizes = [cells * widths[-1], *fc_widths, 3 * fc_points]
        self.fc = nn.ModuleList(nn.Linear(n, m) for n, m in itertools.pairwise(sizes))
        self.ups, self.skips, self.merged = nn.ModuleList(), nn.ModuleList(), nn.ModuleList()
        channels = widths[-1]
        for width in reversed(widths[deconv_level:-1]):
            half = width // 2
            up = {"stride": 2, "padding": 2, "output_padding": 1}
            self.ups.append(nn.ConvTranspose2d(channels, half, 5, **up))
            self.skips.append(_conv(width, half, 3))
            self.merged.append(_conv(half, half, 3))
            channels = half
        self.deconv_conv = _conv(channels, channels, 3)
        self.deconv_points = _conv(channels, deconv_channels, 3)

    def forward(self, x):
        """[b, c, h, w] to [b, points, 3]."""
        features = []
        for level in self.levels:
            for conv in level:
                x = functional.relu(conv(x))
            features.append(x)
        x = functional.relu(self.bottleneck(x))
        flat = x.flatten(1)
        for dense in self.fc[:-1]:
            flat = functional.relu(dense(flat))
        clouds = [self.fc[-1](flat).reshape(len(flat), -1, 3)]
        for up, skip, merged in zip(self.ups, self.skips, self.merged, strict=True):
            x = functional.relu(up(x) + skip(features.pop()))
            x = functional.relu(merged(x))
        x = self.deconv_points(functional.relu(self.deconv_conv(x)))
        clouds.append(x.permute(0, 2, 3, 1).reshape(len(x), -1, 3))
        return torch.cat(clouds, 1)


def _conv(channels, width, size, stride=1):
    return nn.Conv2d(channels, width, size, stride=stride, padding=size // 2)
