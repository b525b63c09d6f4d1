"""Figures of the studies: bar charts, and grids of images.

This is the only module that imports matplotlib (extra `experiments`).
"""

import importlib.util
import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from psgn_jax.config.experiment import ConfigError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    Figure = Any

COLOURS = ("#969696", "#c5b096", "#4682b4", "#e2723e")
_DPI = 100


def check_installed() -> None:
    """Raises `ConfigError` if matplotlib is missing."""
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigError("figures need matplotlib: pip install 'psgn-jax[experiments]'")


def blank(width: float, height: float) -> Figure:
    """An empty figure; its size is in pixels."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, layout="constrained")


def png(figure: Figure) -> bytes:
    """The figure as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", bbox_inches="tight")
    return buffer.getvalue()


class Bars(NamedTuple):
    """A chart of grouped bars.

    Attributes:
      title: title of the chart.
      groups: names of the groups, along the axis.
      series: name -> a value for each group; NaN = no bar.
      errors: name -> half lengths of the error bars.
    """

    title: str
    groups: Sequence[str]
    series: Mapping[str, Sequence[float]]
    errors: Mapping[str, Sequence[float]] = {}


def bars(charts: Sequence[Bars], colours: Sequence[str] = COLOURS) -> Figure:
    """Charts of grouped bars below each other; each bar is labelled with its value."""
    most = max(len(chart.groups) * len(chart.series) for chart in charts)
    figure = blank(max(860, 40 * most), 300 * len(charts))
    for axes, chart in zip(figure.subplots(len(charts), squeeze=False)[:, 0], charts, strict=True):
        places, width = np.arange(len(chart.groups)), 0.8 / len(chart.series)
        for i, (name, values) in enumerate(chart.series.items()):
            left = places + (i - (len(chart.series) - 1) / 2) * width
            errors = chart.errors.get(name)
            drawn = axes.bar(left, values, width, yerr=errors, label=name, color=colours[i])
            axes.bar_label(drawn, fmt="%.2f", fontsize=7, padding=2)
        axes.set_xticks(places, chart.groups, fontsize=9)
        axes.set_title(chart.title, fontsize=11, loc="left", pad=24)
        axes.margins(y=0.1)
        axes.legend(fontsize=8, ncols=len(chart.series), loc="lower left", bbox_to_anchor=(0, 1))
        axes.spines[["top", "right"]].set_visible(False)
    return figure


class Curve(NamedTuple):
    """A metric of the runs of one configuration against the samples seen.

    Attributes:
      samples: numbers of samples, [k].
      values: of each seed, [seeds, k].
    """

    samples: np.ndarray
    values: np.ndarray


def curves(charts: Mapping[str, Mapping[str, Curve]]) -> Figure:
    """Charts by title: a line for each curve, with a band of the standard error over the seeds.

    Lines differ by dashes and markers as well as by colour.
    """
    from matplotlib import ticker

    figure = blank(640 * len(charts), 460)
    for axes, (title, several) in zip(
        figure.subplots(1, len(charts), squeeze=False)[0], charts.items(), strict=True
    ):
        for i, (name, (samples, values)) in enumerate(several.items()):
            colour, mean = COLOURS[i % len(COLOURS)], values.mean(axis=0)
            dash, marker = ("-", "--", ":", "-.")[i // len(COLOURS) % 4], "osv^DPX*"[i % 8]
            axes.plot(samples, mean, dash, color=colour, marker=marker, markersize=5, label=name)
            if len(values) > 1:
                error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
                axes.fill_between(samples, mean - error, mean + error, color=colour, alpha=0.25)
        axes.set(xscale="log", yscale="log", xlabel="training samples seen", ylabel=title)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(ticker.LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
            axis.set_major_formatter(ticker.StrMethodFormatter("{x:g}"))
            axis.set_minor_formatter(ticker.NullFormatter())
        axes.grid(which="both", alpha=0.3)
        axes.legend(fontsize=8)
    return figure


def grid(
    rows: Sequence[Mapping[str, np.ndarray]],
    *,
    labels: Sequence[str] = (),
    scale: tuple[float, float] | None = None,
    scale_title: str = "",
) -> Figure:
    """Rows of panels. The title of a panel is drawn unless the panel above has the same title.

    Args:
      rows: title -> panel: an image uint8 [h, w, 3], or values [h, w], shown with a colour map and
        NaN in white.
      labels: labels of the rows, on the left.
      scale: common range of the values of all panels, shown as a colour bar; None = a range for
        each panel.
      scale_title: title of the colour bar.
    """
    columns = max(map(len, rows))
    height, width = next(iter(rows[0].values())).shape[:2]
    figure = blank(columns * (width + 8) + 40, len(rows) * (height + 26) + 20 + 60 * bool(scale))
    axes = figure.subplots(len(rows), columns, squeeze=False)
    values: Any = None
    above = [""] * columns
    for ax in axes.flat:
        ax.set_xticks([])
        ax.set_yticks([])
        ax.spines[:].set_visible(False)
    for i, row in enumerate(rows):
        for j, (title, panel) in enumerate(row.items()):
            if panel.ndim == 2:
                low, high = scale or (None, None)
                values = axes[i, j].imshow(panel, cmap="viridis", vmin=low, vmax=high)
            else:
                axes[i, j].imshow(panel)
            if title != above[j]:
                axes[i, j].set_title(title, fontsize=10)
                above[j] = title
        if labels:
            axes[i, 0].set_ylabel(labels[i], fontsize=9)
    if scale and values is not None:
        figure.colorbar(values, ax=axes, location="bottom", label=scale_title, shrink=0.4)
    return figure
