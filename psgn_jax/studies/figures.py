"""Figures of the studies; the only module that imports matplotlib (extra `experiments`)."""

import importlib.util
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from psgn_jax.config.experiment import ConfigError

Figure = Any  # of matplotlib, which we import where it draws

COLOURS = ("#969696", "#c5b096", "#4682b4", "#e2723e")
_DPI = 100


def check_installed() -> None:
    """Raises `ConfigError` if matplotlib is missing."""
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigError("figures need matplotlib: pip install 'psgn-jax[experiments]'")


def blank(width: float, height: float) -> Figure:
    """An empty figure with a size in pixels."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, layout="constrained")


def png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", bbox_inches="tight")
    return buffer.getvalue()


def bars(
    charts: Mapping[str, Mapping[str, Sequence[float]]],
    groups: Sequence[str],
    *,
    errors: Mapping[str, Sequence[float]] | None = None,
    colours: Sequence[str] = COLOURS,
) -> Figure:
    """Charts of grouped bars, one below the other; bars are labelled with their values.

    `charts` is title -> name -> a value for each of `groups`; `errors` half an error bar for each.
    """
    count = len(next(iter(charts.values())))
    figure = blank(max(860, 40 * count * len(groups)), 300 * len(charts))
    places, width = np.arange(len(groups)), 0.8 / count
    axes_of = figure.subplots(len(charts), squeeze=False)[:, 0]
    for axes, (title, series) in zip(axes_of, charts.items(), strict=True):
        for i, (name, values) in enumerate(series.items()):
            left, error = places + (i - (count - 1) / 2) * width, (errors or {}).get(name)
            drawn = axes.bar(left, values, width, yerr=error, label=name, color=colours[i])
            axes.bar_label(drawn, fmt="%.2f", fontsize=7, padding=2)
        axes.set_xticks(places, groups, fontsize=9)
        axes.set_title(title, fontsize=11, loc="left", pad=24)
        axes.margins(y=0.1)
        axes.legend(fontsize=8, ncols=count, loc="lower left", bbox_to_anchor=(0, 1))
        axes.spines[["top", "right"]].set_visible(False)
    return figure


Curve = tuple[np.ndarray, np.ndarray]
"""Numbers of samples seen [k], and the metric of each seed [seeds, k]."""


def curves(charts: Mapping[str, Mapping[str, Curve]]) -> Figure:
    """A chart for each title: its curves, with bands of the standard error over the seeds."""
    from matplotlib import ticker

    columns = min(4, len(charts))
    rows = -(-len(charts) // columns)
    figure = blank(640 * columns, 460 * rows)
    for number, (title, several) in enumerate(charts.items(), 1):
        axes = figure.add_subplot(rows, columns, number)
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
    """Rows of panels, with `labels` on the left. A title is not repeated below the same title.

    A row is title -> panel: an image uint8 [h, w, 3], or values [h, w] for a colour map, NaN white.
    `scale` is the range of the colour map, with a colour bar; None = a range for each panel.
    """
    columns = max(map(len, rows))
    height, width = next(iter(rows[0].values())).shape[:2]
    figure = blank(columns * (width + 8) + 40, len(rows) * (height + 26) + 20 + 60 * bool(scale))
    axes = figure.subplots(len(rows), columns, squeeze=False)
    values: Any = None
    above = [""] * columns
    for ax in axes.flat:
        ax.set(xticks=[], yticks=[])
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
