"""Load forces and position errors of the joints over time, as panels beside the machine."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...arrays import Vector
from ...results.style import tidied
from .movement import JOINTS, Movement
from .scene import JOINT_COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

_PARTS = 300
"""Of longer curves the lowest and the highest value of so many parts are drawn; a panel is that wide."""

_TRANSIENT = 0.3
"""Time in s after which errors are small enough to show."""


@dataclass(frozen=True)
class Curves:
    """Values of the joints over `time` in s; a column for each."""

    label: str
    time: Vector
    values: Vector

    def draw(self, axes: "Axes", **look: Any) -> "list[Line2D]":
        """A line for each joint."""
        return [
            axes.plot(self.time, values, color=JOINT_COLORS[joint], linewidth=1.1, **look)[0]
            for joint, values in zip(JOINTS, self.values.T, strict=True)
        ]


def curves(found: Movement) -> list[Curves]:
    """What a movement has values for."""
    wanted = []
    if found.forces is not None:
        wanted.append(Curves("load force / kN", *_shortened(found.time, 1e-3 * found.forces)))
    if found.errors is not None:
        late = found.time >= found.time[0] + _TRANSIENT
        part = late if late.sum() > 1 else np.full_like(late, True)
        errors = _shortened(found.time[part], 1e6 * found.errors[part])
        wanted.append(Curves("position error / µm", *errors))
    return wanted


def dress(axes: "list[Axes]", shown: list[Curves]) -> None:
    """Labels of the panels, one above the other, and who is who above the first."""
    for panel, curve in zip(axes, shown, strict=True):
        panel.set_ylabel(curve.label, fontsize=9)
        tidied(panel)
    if not axes:
        return
    axes[-1].set_xlabel("time / s", fontsize=9)
    lines = axes[0].lines[: len(JOINTS)]
    axes[0].legend(
        lines, JOINTS, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=9, frameon=False
    )


def _shortened(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    """At most two rows for each part: the lowest and the highest value of each column."""
    if len(time) <= 2 * _PARTS:
        return time, values
    parts = np.array_split(np.arange(len(time)), _PARTS)
    ends = [row for part in parts for row in (part[0], part[-1])]
    extremes = [bound for part in parts for bound in (values[part].min(axis=0), values[part].max(axis=0))]
    return time[ends], np.array(extremes)
