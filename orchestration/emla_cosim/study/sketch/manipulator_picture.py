"""The manipulator at instants along its path, with its workspace and the path of its tip."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ...run.result import Result
from ...views.plots.pictures import Drawing
from ...views.plots.style import BLUE, RED
from .curves import build_curves, label_panels
from .movement import Movement, read_movement, recorded_signals
from .scene import DARK, EDGE, draw_ghost, draw_machine, draw_scene, draw_wanted, draw_way, machine_and_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INSTANTS = 5
"""Number of postures that are drawn, including the first and the last."""

_INSET = (0.04, 0.62, 0.46, 0.33)
"""Where the enlarged path is drawn: left, bottom, width and height as parts of the machine's axes."""

_SMALLEST = 1e-2
"""Size in m below which a path is not enlarged."""


class ManipulatorPicture(Drawing):
    """The machine in its workspace on the left; the tip's path, forces and errors on the right."""

    def signals(self, result: Result) -> Iterable[str]:
        """Return the signals of actual and reference strokes, forces, and payload."""
        return recorded_signals(result)

    def drawn(self, result: Result, data: Mapping[str, Vector]) -> "Figure | None":
        """Draw a run with a manipulator; None if its strokes were not recorded."""
        found = read_movement(result, data)
        return None if found is None else _draw_picture(found)


def _draw_picture(found: Movement) -> "Figure":
    shown = build_curves(found)
    figure, machine, panels = machine_and_panels(len(shown), (9.8, 6.0), 120)
    _draw_postures(machine, found)
    _draw_path(machine.inset_axes(_INSET), found)
    for panel, curve in zip(panels, shown, strict=True):
        curve.draw(panel)
    label_panels(panels, shown)
    figure.align_ylabels(panels)
    return figure


def select_instants(found: Movement) -> list[int]:
    """Return the rows at which the machine is drawn, at equal distances along the path of its tip."""
    way = np.concatenate([[0.0], np.hypot(*np.diff(found.path, axis=0).T).cumsum()])
    return [int(row) for row in np.searchsorted(way, np.linspace(0.0, way[-1], INSTANTS))]


def _draw_postures(axes: "Axes", found: Movement) -> None:
    draw_scene(axes, found.p)
    *before, last = select_instants(found)
    for row in before:
        draw_ghost(axes, found.p, found.strokes[row], found.payload[row])
    draw_machine(axes, found.p, found.strokes[last], found.payload[last])
    draw_way(axes, found)
    axes.text(0.98, 0.02, "reach of the tip", color=BLUE, fontsize=9, transform=axes.transAxes, ha="right")
    if found.payload[last] > 0.0:
        x, y = found.path[last]
        axes.text(x + 0.3, y + 0.12, f"{found.payload[last]:.4g} kg", color=DARK, fontsize=9)


def _draw_path(axes: "Axes", found: Movement) -> None:
    """Draw the enlarged path of the tip, with times."""
    from matplotlib.ticker import MultipleLocator

    draw_way(axes, found)
    draw_wanted(axes, found)
    rows = select_instants(found)
    axes.plot(*found.path[rows].T, "o", color=RED, markersize=4, zorder=7)
    for row in _select_separate(found.path, rows):
        place = (6.0, 4.0 if row == rows[-1] else -3.0)
        axes.annotate(
            f"{found.time[row]:.3g} s", found.path[row], place, textcoords="offset points", fontsize=8
        )
    low, high = found.path.min(axis=0), found.path.max(axis=0)
    size, (x, y) = max((high - low).max(), _SMALLEST), 0.5 * (low + high)
    square = _grid(size)
    axes.set_title(f"path of the tip, squares of {square:g} m", fontsize=9, loc="left")
    axes.set_aspect("equal", adjustable="datalim")
    axes.update_datalim([(x - 0.5 * size, y - 0.5 * size), (x + 0.5 * size, y + 0.5 * size)])
    axes.margins(0.15)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(square))
    axes.tick_params(labelbottom=False, labelleft=False, length=0)
    axes.grid(alpha=0.4)
    axes.patch.set_alpha(0.8)
    for spine in axes.spines.values():
        spine.set_color(EDGE)


def _select_separate(path: Vector, rows: Sequence[int]) -> list[int]:
    """Return the rows, the last one first, whose places have room for a label."""
    room = 0.12 * np.ptp(path, axis=0).max()
    found = list[int]()
    for row in reversed(rows):
        if all(np.hypot(*(path[row] - path[other])) > room for other in found):
            found.append(row)
    return found


def _grid(size: float) -> float:
    """Return a round number of which about five are as long as `size`."""
    power = 10.0 ** math.floor(math.log10(size / 5.0))
    return next(power * n for n in (1, 2, 5, 10) if power * n >= 0.99 * size / 5.0)
