"""Pictures of an identification: measured over predicted, residuals, intervals and correlations."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...views.plots.style import BLUE, GREY, ORANGE, RED, new_figure
from .data import IdentificationData

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_MOST = 6
"""Most signals of experiments that are drawn: the worst."""


def draw_fit(result: IdentificationData) -> "Figure":
    """Draw for each signal of each experiment what was measured and predicted, and the residuals below."""
    shown = sorted(result.fits, key=lambda one: one.fit)[:_MOST]
    shown = [one for one in result.fits if one in shown]
    figure, grid = new_figure(2, max(len(shown), 1), 3.9, sharex="col")
    for j, one in enumerate(shown):
        rows = result.samples.filter(
            (result.samples["experiment"] == one.experiment) & (result.samples["signal"] == one.signal)
        )
        time, measured, predicted = (rows[name].to_numpy() for name in ("time", "measured", "predicted"))
        unit = f" / {one.unit}" if one.unit else ""
        held_out = ", held out" if one.held_out else ""
        _line(grid[0, j], time, measured, GREY, "measured", ".")
        _line(grid[0, j], time, predicted, BLUE, "predicted", "-")
        _line(grid[1, j], time, predicted - measured, ORANGE, "", "-")
        grid[0, j].set_title(
            f"{one.experiment}{held_out}: fit {100.0 * one.fit:.4g} %", fontsize=10, parse_math=False
        )
        grid[0, j].set_ylabel(f"{one.signal}{unit}", fontsize=8, parse_math=False)
        grid[1, j].set_ylabel(f"predicted - measured{unit}", fontsize=8, parse_math=False)
        grid[1, j].set_xlabel("time / s")
    if shown:
        grid[0, -1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    return figure


def draw_certainty(result: IdentificationData) -> "Figure":
    """Draw the intervals of the estimates within their ranges, and the correlations."""
    count = len(result.estimates)
    figure, grid = new_figure(1, 2, 4.6, max(0.42 * count + 0.6, 2.4), sharex="none")
    _intervals(grid[0, 0], result)
    _correlations(figure, grid[0, 1], result)
    return figure


def _line(axes: "Axes", time: np.ndarray, values: np.ndarray, color: str, label: str, style: str) -> None:
    axes.plot(time, values, style, color=color, label=label, linewidth=1.0, markersize=2.5)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)


def _intervals(axes: "Axes", result: IdentificationData) -> None:
    """Draw each estimate at its place in its range, with its interval as a text beside."""
    for i, one in enumerate(result.estimates):
        width = one.high - one.low
        color = RED if one.interval is None else BLUE
        low, high = (one.low, one.high) if one.interval is None else one.interval
        ends = [float(np.clip((x - one.low) / width, 0.0, 1.0)) for x in (low, high)]
        axes.plot(ends, [i, i], color=color, alpha=0.4, linewidth=5.0, solid_capstyle="butt")
        axes.plot([(one.value - one.low) / width], [i], "o", color=color, markersize=5)
        said = "not identified" if one.error is None else f"{one.value:.4g} ± {one.error:.1g} {one.unit}"
        axes.text(1.04, i, said, fontsize=8, va="center", color=color, parse_math=False)
    names = shorten_names([one.name for one in result.estimates])
    axes.set_yticks(range(len(names)), names, fontsize=8, parse_math=False)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(-0.02, 1.02)
    axes.set_xticks([0.0, 0.5, 1.0], ["low", "range", "high"])
    axes.set_title("interval of 95 %", fontsize=10)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def shorten_names(names: Sequence[str]) -> list[str]:
    """Return names without the components that all have in common."""
    parts = [name.split(".") for name in names]
    common = 0
    while len(names) > 1 and all(len(x) > common + 1 and x[common] == parts[0][common] for x in parts):
        common += 1
    return [".".join(x[common:]) for x in parts]


def _correlations(figure: "Figure", axes: "Axes", result: IdentificationData) -> None:
    values = np.ma.masked_invalid(result.correlations)
    image = axes.imshow(values, cmap="RdBu", vmin=-1.0, vmax=1.0)
    names = shorten_names([one.name for one in result.estimates])
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7, parse_math=False)
    axes.set_yticks(range(len(names)), [""] * len(names))
    for i in range(len(names)):
        for j in range(len(names)):
            if not values.mask.any() or not np.ma.getmaskarray(values)[i, j]:
                shade = "white" if abs(values[i, j]) > 0.6 else "black"
                axes.text(j, i, f"{values[i, j]:.2f}", ha="center", va="center", fontsize=7, color=shade)
    axes.set_title("correlation of the estimates", fontsize=10)
    figure.colorbar(image, ax=axes, shrink=0.8)
