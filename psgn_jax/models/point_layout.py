"""The number of points that a PointOutNet predicts, its output grid and its branches."""

from typing import Any, NamedTuple, get_args

from psgn_jax.config import ModelConfig, Version, has_deconv_branch

VERSIONS: tuple[str, ...] = get_args(Version)
RANDOM_AT = ("bottleneck", "fc")


class OutputGrid(NamedTuple):
    """Size of the point grid of a deconv branch: 24 rows, 32 columns, 1 point per cell by default.

    It is (0, 0, 0) without a deconv branch.
    """

    height: int
    width: int
    points_per_cell: int


class Branches(NamedTuple):
    """Indices of the points that each branch predicts."""

    fc: range
    deconv: range


def scaled_widths(widths: tuple[int, ...], multiplier: float) -> tuple[int, ...]:
    """Widths times `multiplier`, rounded to multiples of 8, at least 8; unchanged if it is 1.

    Raises:
      ValueError: a width or the multiplier is not positive.
    """
    if multiplier <= 0:
        raise wrong_field("width_multiplier", multiplier, "a positive number")
    if any(width < 1 for width in widths):
        raise wrong_field("widths", widths, "positive integers")
    if multiplier == 1:
        return tuple(widths)
    return tuple(max(8, 8 * round(width * multiplier / 8)) for width in widths)


def padded_size(image_size: tuple[int, int], num_levels: int) -> tuple[int, int]:
    """Image size after padding: the next multiples of `2 ** (num_levels - 1)`.

    Raises:
      ValueError: a side is smaller than half of `2 ** (num_levels - 1)`; there would be more
        padding than image.
    """
    divisor = 2 ** (num_levels - 1)
    if min(image_size) < divisor / 2:
        raise wrong_field(
            "image_size",
            tuple(image_size),
            f"sides of at least {max(1, divisor // 2)} pixels, half of 2^{num_levels - 1} "
            f"(there are {num_levels} widths)",
        )
    height, width = (-(-side // divisor) * divisor for side in image_size)
    return height, width


def output_grid(config: ModelConfig) -> OutputGrid:
    """The grid of the deconv branch; (0, 0, 0) for `vanilla`.

    Raises:
      ValueError: a field is out of range.
    """
    levels = len(config.widths)
    if config.name not in VERSIONS:
        raise wrong_field("name", config.name, f"one of {VERSIONS}")
    if levels < 2:
        raise wrong_field("widths", config.widths, "at least two levels")
    height, width = padded_size(config.image_size, levels)
    if not has_deconv_branch(config.name):
        return OutputGrid(0, 0, 0)
    if not 0 <= config.deconv_level <= levels - 2:
        raise wrong_field(
            "deconv_level", config.deconv_level, f"0 to {levels - 2}, above the bottleneck"
        )
    if config.deconv_channels < 3 or config.deconv_channels % 3:
        raise wrong_field("deconv_channels", config.deconv_channels, "a positive multiple of 3")
    cell = 2**config.deconv_level
    return OutputGrid(height // cell, width // cell, config.deconv_channels // 3)


def branch_of_point(config: ModelConfig) -> Branches:
    """The point indices of each branch: fc 0 to 255, deconv 256 to 1,023 by default.

    Raises:
      ValueError: a field is out of range.
    """
    grid = output_grid(config)
    lowest = 0 if has_deconv_branch(config.name) else 1
    if config.fc_points < lowest:
        raise wrong_field("fc_points", config.fc_points, f"at least {lowest}")
    deconv_points = grid.height * grid.width * grid.points_per_cell
    return Branches(
        range(config.fc_points), range(config.fc_points, config.fc_points + deconv_points)
    )


def num_points(config: ModelConfig) -> int:
    """Number of points of one prediction, 1,024 by default.

    Raises:
      ValueError: a field is out of range.
    """
    branches = branch_of_point(config)
    return len(branches.fc) + len(branches.deconv)


def wrong_field(field: str, value: Any, accepted: str) -> ValueError:
    """The error for a wrong field of `ModelConfig`."""
    return ValueError(f"model.{field}={value!r}: accepted: {accepted}")
