"""Pictures of a motion: those of the paper, jerks, and the path of the tip with ground and machine."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hdrm_fmu.base import base_corners
from hdrm_fmu.kinematics import outline, tip
from hdrm_fmu.parameters import HdrmParameters
from machine_fmu.optimisation.assessment import Course
from machine_fmu.optimisation.problem import MotionProblem
from machine_fmu.trajectory import JOINTS

from ...base.arrays import Vector
from ...views.plots.style import BLUE, GREY, ORANGE, RED, new_figure, tidy_axes
from .result import TrajectoryResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = ("forces-and-speeds", "positions-and-accelerations", "path")
"""Names of the pictures."""

_POINTS = 1501

_GROUND, _BODY = "#d9cbb3", "#c9ced6"
_BOOMS = ("lift_boom", "outer_boom", "inner_boom")
_TRIANGLES = ("lift_triangle", "tilt_triangle")
_MARGIN = 0.4
"""Space around everything that is drawn, m."""


class _PanelRow(NamedTuple):
    """One row of a picture: values by joint, their bounds if there are any, and a label."""

    label: str
    values: np.ndarray
    bounds: Sequence[Sequence[float]] = ()


def draw_pictures(result: TrajectoryResult) -> "dict[str, Figure]":
    """Return the pictures by name."""
    times = np.linspace(result.spline.start, result.spline.end, _POINTS)
    seen, problem = result.course(times), result.problem
    rows = (_forces_and_speeds(seen, problem), _positions_and_accelerations(seen, problem))
    *by_joint, path = PICTURES
    figures = {name: _picture(times, some) for name, some in zip(by_joint, rows, strict=True)}
    return {**figures, path: _draw_path(result, times)}


def _forces_and_speeds(seen: Course, problem: MotionProblem) -> tuple[_PanelRow, _PanelRow]:
    forces = [[x / 1e3 for x in bounds] for bounds in (problem.f_LB, problem.f_UB)]
    speeds = [[x * 1e3 for x in bounds] for bounds in (problem.v_LB, problem.v_UB)]
    return (
        _PanelRow("force / kN", seen.force / 1e3, (forces[0], forces[1])),
        _PanelRow("speed / mm/s", seen.v * 1e3, (speeds[0], speeds[1])),
    )


def _positions_and_accelerations(seen: Course, problem: MotionProblem) -> tuple[_PanelRow, ...]:
    machine = problem.machine
    accelerations, jerks = (
        [[x * 1e3 for x in bounds] for bounds in pair if bounds is not None]
        for pair in ((problem.a_LB, problem.a_UB), (problem.j_LB, problem.j_UB))
    )
    return (
        _PanelRow("stroke / m", seen.q, (machine.q_LB, machine.q_UB)),
        _PanelRow("acceleration / mm/s²", seen.a * 1e3, accelerations),
        _PanelRow("jerk / mm/s³", seen.j * 1e3, jerks),
    )


def _picture(times: Vector, rows: Sequence[_PanelRow]) -> "Figure":
    figure, axes = new_figure(len(rows), len(JOINTS), 3.2)
    for i, row in enumerate(rows):
        for j, joint in enumerate(JOINTS):
            _panel(axes[i, j], times, row, j)
            if i == 0:
                axes[i, j].set_title(joint, fontsize=10)
            if i == len(rows) - 1:
                axes[i, j].set_xlabel("time / s", fontsize=9)
        axes[i, 0].set_ylabel(row.label, fontsize=9)
    figure.align_ylabels(axes[:, 0])
    return figure


def _panel(axes: "Axes", times: Vector, row: _PanelRow, joint: int) -> None:
    axes.plot(times, row.values[:, joint], color=BLUE, linewidth=1.4)
    for bounds in row.bounds:
        axes.axhline(bounds[joint], color=RED, linewidth=0.9, linestyle="--")
    tidy_axes(axes)


def _draw_path(result: TrajectoryResult, times: Vector) -> "Figure":
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
