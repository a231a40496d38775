"""Load forces and position errors of the joints over time, as panels beside the machine."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Vector
from ...views.plots.style import tidy_axes
from .movement import JOINTS, Movement
from .scene import JOINT_COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

_PARTS = 300
"""Number of parts into which longer curves are divided; each is drawn by its lowest and highest value."""

_TRANSIENT = 0.3
"""Time in s of the initial transient, whose forces and errors would dwarf all others."""


@dataclass(frozen=True)
class Curves:
    """Values of the joints over `time` in s, with a column for each joint."""

    label: str
    time: Vector
    values: Vector

    def draw(self, axes: "Axes", **look: Any) -> "list[Line2D]":
        """Draw a line for each joint, in their order; small values are drawn above large ones."""
        spans = np.ptp(self.values, axis=0)
        return [
            axes.plot(time, values, color=JOINT_COLORS[joint], linewidth=1.1, zorder=zorder, **look)[0]
            for joint, time, values, zorder in zip(
                JOINTS, self.time.T, self.values.T, 2.0 + 1.0 / (1.0 + spans), strict=True
            )
        ]


def build_curves(found: Movement) -> list[Curves]:
    """Return the curves of a movement after the initial transient."""
    late = found.time >= found.time[0] + _TRANSIENT
    part = late if late.sum() > 1 else np.full_like(late, True)
    wanted = []
    if found.forces is not None:
        wanted.append(Curves("load force / kN", *_thin_rows(found.time[part], 1e-3 * found.forces[part])))
    if found.errors is not None:
        wanted.append(Curves("position error / µm", *_thin_rows(found.time[part], 1e6 * found.errors[part])))
    return wanted


def label_panels(axes: "list[Axes]", shown: list[Curves]) -> None:
    """Label the panels, which are one above the other, with a legend above the first."""
    for panel, curve in zip(axes, shown, strict=True):
        panel.set_ylabel(curve.label, fontsize=9)
        tidy_axes(panel)
    if not axes:
        return
    axes[-1].set_xlabel("time / s", fontsize=9)
    lines = axes[0].lines[: len(JOINTS)]
    axes[0].legend(
        lines, JOINTS, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=9, frameon=False
    )


def _thin_rows(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Return two rows for each part, where each column is lowest and highest, and the last row."""
    if len(time) <= 2 * _PARTS:
        return np.repeat(time[:, None], values.shape[1], axis=1), values
    rows = [np.full((1, values.shape[1]), len(time) - 1)]
    for part in reversed(np.array_split(np.arange(len(time)), _PARTS)):
        ends = part[0] + np.stack([values[part].argmin(axis=0), values[part].argmax(axis=0)])
        rows.insert(0, np.sort(ends, axis=0))
    chosen = np.concatenate(rows)
    return time[chosen], np.take_along_axis(values, chosen, axis=0)
