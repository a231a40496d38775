"""Load forces and position errors of the actuators over time, as panels beside the machine."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Vector
from ...views.plots.style import tidy_axes
from .movement import Movement

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

_PARTS = 300
"""Number of parts into which longer curves are divided; each is drawn by its lowest and highest value."""

_TRANSIENT = 0.3
"""Time in s of the initial transient, whose forces and errors would dwarf all others."""

_LEGEND_COLUMNS = 3
"""Most columns of the legend."""


@dataclass(frozen=True)
class Curves:
    """Values of the actuators over `time` in s, with a column for each; `colors` are theirs by name."""

    label: str
    time: Vector
    values: Vector
    colors: Mapping[str, str]

    def draw(self, axes: "Axes", **look: Any) -> "list[Line2D]":
        """Draw a line for each actuator, in their order; small values are drawn above large ones."""
        spans = np.ptp(self.values, axis=0)
        return [
            axes.plot(time, values, color=color, linewidth=1.1, zorder=zorder, **look)[0]
            for color, time, values, zorder in zip(
                self.colors.values(), self.time.T, self.values.T, 2.0 + 1.0 / (1.0 + spans), strict=True
            )
        ]


def build_curves(movement: Movement, colors: Mapping[str, str]) -> list[Curves]:
    """Return the curves of a movement after the initial transient; `colors` are those of the actuators."""
    is_late = movement.time >= movement.time[0] + _TRANSIENT
    part = is_late if is_late.sum() > 1 else np.full_like(is_late, True)
    curves = []
    for label, scale, values in (
        ("load force / kN", 1e-3, movement.forces),
        ("position error / µm", 1e6, movement.errors),
    ):
        if values is not None:
            curves.append(Curves(label, *_thin_rows(movement.time[part], scale * values[part]), colors))
    return curves


def label_panels(axes: "list[Axes]", curves: list[Curves]) -> None:
    """Label the panels, which are one above the other, with a legend above the first."""
    for panel, curve in zip(axes, curves, strict=True):
        panel.set_ylabel(curve.label, fontsize=9)
        tidy_axes(panel)
    if not axes:
        return
    axes[-1].set_xlabel("time / s", fontsize=9)
    names = list(curves[0].colors)
    lines = axes[0].lines[: len(names)]
    axes[0].legend(
        lines,
        names,
        ncols=_LEGEND_COLUMNS,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        fontsize=9,
        frameon=False,
    )


def _thin_rows(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Return two rows for each part, where each column is lowest and highest, and the last row."""
    if len(time) <= 2 * _PARTS:
        return np.repeat(time[:, None], values.shape[1], axis=1), values
    # so that curves reach the end of the time
    rows = [np.full((1, values.shape[1]), len(time) - 1)]
    for part in reversed(np.array_split(np.arange(len(time)), _PARTS)):
        ends = part[0] + np.stack([values[part].argmin(axis=0), values[part].argmax(axis=0)])
        rows.insert(0, np.sort(ends, axis=0))
    row_numbers = np.concatenate(rows)
    return time[row_numbers], np.take_along_axis(values, row_numbers, axis=0)
