"""The manipulator at instants along its path, with its workspace, and the way of its tip."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...arrays import Vector
from ...results.plotting import Drawing
from ...results.result import Result
from ...results.style import BLUE, RED, tidied
from .curves import curves, dress
from .movement import Movement, movement, recorded_signals
from .scene import DARK, draw_ghost, draw_machine, draw_scene, draw_wanted, draw_way, machine_and_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INSTANTS = 5
"""So many postures are drawn, the first and the last among them."""


class ManipulatorPicture(Drawing):
    """The machine in its workspace on the left; the tip's path, forces and errors on the right."""

    def signals(self, result: Result) -> Iterable[str]:
        """Strokes made and wanted, forces, and payload."""
        return recorded_signals(result)

    def drawn(self, result: Result, data: Mapping[str, Vector]) -> "Figure | None":
        """The picture of a run with a manipulator whose strokes were kept."""
        found = movement(result, data)
        return None if found is None else _drawn(found)


def _drawn(found: Movement) -> "Figure":
    shown = curves(found)
    figure, machine, (path, *panels) = machine_and_panels(1 + len(shown), (10.5, 6.2), 120)
    _draw_postures(machine, found)
    _draw_path(path, found)
    for panel, curve in zip(panels, shown, strict=True):
        curve.draw(panel)
    dress(panels, shown)
    figure.align_ylabels([path, *panels])
    return figure


def _instants(found: Movement) -> list[int]:
    """The rows at which the machine is drawn, at equal distances in time."""
    times = np.linspace(found.time[0], found.time[-1], INSTANTS)
    return [int(row) for row in np.searchsorted(found.time, times)]


def _draw_postures(axes: "Axes", found: Movement) -> None:
    draw_scene(axes, found.p)
    *before, last = _instants(found)
    for row in before:
        draw_ghost(axes, found.p, found.strokes[row], found.payload[row])
    draw_machine(axes, found.p, found.strokes[last], found.payload[last])
    draw_way(axes, found)
    draw_wanted(axes, found)
    axes.text(0.03, 0.99, "where the tip can be", color=BLUE, fontsize=9, transform=axes.transAxes, va="top")
    if found.payload[last] > 0.0:
        place = found.path[last] + (0.3, 0.12)
        axes.text(*place, f"{found.payload[last]:.4g} kg", color=DARK, fontsize=9)


def _draw_path(axes: "Axes", found: Movement) -> None:
    """The way of the tip, large, and when it was where."""
    draw_way(axes, found)
    draw_wanted(axes, found)
    for row in _instants(found):
        axes.plot(found.path[row, 0], found.path[row, 1], "o", color=RED, markersize=4.5, zorder=7)
        axes.annotate(
            f"{found.time[row]:.3g} s", found.path[row], (7.0, -3.0), textcoords="offset points", fontsize=8
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x / m", fontsize=9)
    axes.set_ylabel("tip, y / m", fontsize=9)
    tidied(axes)
    axes.margins(0.12)
