"""Picture of the tip's path, with ground and machine."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hdrm_fmu.base import base_corners
from hdrm_fmu.kinematics import outline, tip
from hdrm_fmu.parameters import HdrmParameters

from ...base.arrays import Vector
from ...views.plots.style import BLUE, GREY, ORANGE, RED, new_figure
from .motion import OptimisedMotion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GROUND, _BODY = "#d9cbb3", "#c9ced6"
_BOOMS = ("lift_boom", "outer_boom", "inner_boom")
_TRIANGLES = ("lift_triangle", "tilt_triangle")
_MARGIN = 0.4
"""Space around everything that is drawn, m."""


def draw_path(result: OptimisedMotion, times: Vector) -> "Figure":
    """Return a figure of the tip's path in the plane, and the machine at start and end."""
    problem, machine = result.problem, result.problem.machine
    strokes = result.spline.evaluated(times)
    path = np.array([tip(machine, q) for q in strokes.tolist()])
    figure, grid = new_figure(1, 1, 7.0, 5.2)
    axes = grid[0, 0]
    _draw_base(axes, machine)
    for row, color, name in ((0, GREY, "start"), (-1, BLUE, "end")):
        _draw_machine(axes, outline(machine, strokes[row].tolist()), color, name)
    axes.plot(*path.T, color=ORANGE, linewidth=1.8, label="path of the tip")
    for i, via in enumerate(problem.via):
        axes.plot(*via.tip, "o", color=ORANGE, markersize=5)
        axes.annotate(f"{i + 1}", via.tip, (6, 5), textcoords="offset points", fontsize=9)
    axes.set_aspect("equal")
    axes.margins(0.05)
    if problem.ground_clearance is not None:
        _draw_ground(axes, problem.ground_height, problem.ground_clearance)
    axes.set_xlabel("x / m", fontsize=9)
    axes.set_ylabel("y / m", fontsize=9)
    axes.tick_params(labelsize=8)
    figure.legend(fontsize=8, loc="outside upper center", ncols=5, edgecolor="none")
    return figure


def _draw_base(axes: "Axes", machine: HdrmParameters) -> None:
    from scipy.spatial import ConvexHull

    corners = np.array(base_corners(machine))
    axes.fill(*corners[ConvexHull(corners).vertices].T, color=_BODY)


def _draw_machine(axes: "Axes", lines: Mapping[str, Sequence[Any]], color: str, name: str) -> None:
    for part in _TRIANGLES:
        axes.plot(*np.array(lines[part]).T, color=color, linewidth=1.0)
    for i, part in enumerate(_BOOMS):
        axes.plot(*np.array(lines[part]).T, color=color, linewidth=2.4, label=name if i == 0 else None)


def _draw_ground(axes: "Axes", height: float, clearance: float) -> None:
    low = min(axes.get_ylim()[0], height - _MARGIN)
    axes.axhspan(low, height, color=_GROUND, zorder=0.5, label="ground")
    axes.axhline(height + clearance, color=RED, linewidth=0.9, linestyle="--", label="clearance")
    axes.set_ylim(bottom=low)
