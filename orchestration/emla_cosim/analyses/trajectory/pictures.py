"""Pictures of a motion: those of the paper, jerks, and the path of the tip with ground and machine."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from machine_fmu.optimisation.assessment import Course
from machine_fmu.optimisation.obstacles import Obstacle

from ...base.arrays import Vector
from ...study.sketch.parts import MachineParts
from ...study.sketch.scene import actuator_colors, convex_line, paint
from ...study.sketch.workspace import PLANE, THREE_SIDES, View
from ...views.plots.style import BLUE, GREY, ORANGE, RED, new_figure, tidy_axes
from .result import TrajectoryResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = ("forces-and-speeds", "positions-and-accelerations", "path")
"""Names of the pictures."""

_POINTS = 1501

_GROUND, _OBSTACLE = "#d9cbb3", "#e3b5a4"
_MARGIN = 0.4
"""Space around everything that is drawn, m."""


class _PanelRow(NamedTuple):
    """One row of a picture: values by joint, their bounds if there are any, and the factor of both."""

    label: str
    values: np.ndarray
    bounds: Sequence[Sequence[float] | None]
    factor: float


def draw_pictures(result: TrajectoryResult) -> "dict[str, Figure]":
    """Return the pictures by name."""
    times = np.linspace(result.spline.start, result.spline.end, _POINTS)
    course, problem = result.course(times), result.problem
    forces_and_speeds = [
        _PanelRow("force / kN", course.force, (problem.f_LB, problem.f_UB), 1e-3),
        _PanelRow("speed / mm/s", course.v, (problem.v_LB, problem.v_UB), 1e3),
    ]
    positions_and_accelerations = [
        _PanelRow("stroke / m", course.q, (problem.machine.q_LB, problem.machine.q_UB), 1.0),
        _PanelRow("acceleration / mm/s²", course.a, (problem.a_LB, problem.a_UB), 1e3),
        _PanelRow("jerk / mm/s³", course.j, (problem.j_LB, problem.j_UB), 1e3),
    ]
    pictures = (
        _draw_picture(problem.names, times, forces_and_speeds),
        _draw_picture(problem.names, times, positions_and_accelerations),
        _draw_path(result, course),
    )
    return dict(zip(PICTURES, pictures, strict=True))


def _draw_picture(joints: Sequence[str], times: Vector, rows: Sequence[_PanelRow]) -> "Figure":
    figure, axes = new_figure(len(rows), len(joints), 3.2)
    for i, row in enumerate(rows):
        for j, joint in enumerate(joints):
            axes[i, j].plot(times, row.factor * row.values[:, j], color=BLUE, linewidth=1.4)
            for bounds in row.bounds:
                if bounds is not None:
                    axes[i, j].axhline(row.factor * bounds[j], color=RED, linewidth=0.9, linestyle="--")
            tidy_axes(axes[i, j])
            if i == 0:
                axes[i, j].set_title(joint, fontsize=10)
            if i == len(rows) - 1:
                axes[i, j].set_xlabel("time / s", fontsize=9)
        axes[i, 0].set_ylabel(row.label, fontsize=9)
    figure.align_ylabels(axes[:, 0])
    return figure


def _draw_path(result: TrajectoryResult, course: Course) -> "Figure":
    """Return a figure of the tip's path, and the machine at start and end; in space from two sides."""
    problem, machine = result.problem, result.problem.machine
    parts, colors = MachineParts(machine), actuator_colors(machine.names)
    path = machine.tip(course.q, payload=course.payload)
    start, end = parts.postures(course.q[[0, -1]], course.payload[[0, -1]])
    views = (PLANE,) if machine.dimensions == 2 else THREE_SIDES[:2]
    figure, grid = new_figure(1, len(views), 7.0 / len(views), 5.2)
    for axes, view in zip(grid[0], views, strict=True):
        for i, obstacle in enumerate(problem.obstacles):
            _draw_obstacle(axes, obstacle, view, None if i else "obstacles")
        faint = paint(start.values(), view, colors, 0.35, only_moving=True)
        for polygons in (faint, paint(end.values(), view, colors)):
            polygons.add_to(axes)
            axes.update_datalim(np.concatenate(polygons.lines))
        line = view.flatten(path)
        axes.plot(*line.T, color=RED, linewidth=1.8, zorder=5, label="path of the tip")
        axes.plot(*line[0], "o", color=GREY, markersize=5, zorder=5, label="start, faint")
        for i, via in enumerate(problem.via):
            position = view.flatten(np.array([via.tip]))[0]
            axes.plot(*position, "o", color=ORANGE, markersize=5, zorder=6)
            axes.annotate(f"{i + 1}", position, (6, 5), textcoords="offset points", fontsize=9)
        axes.set_aspect("equal")
        axes.margins(0.05)
        if problem.ground_clearance is not None:
            _draw_ground(axes, problem.ground_height, problem.ground_clearance)
        for label, set_label in zip(view.labels, (axes.set_xlabel, axes.set_ylabel), strict=False):
            set_label(label, fontsize=9)
        axes.tick_params(labelsize=8)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="outside upper center", ncols=6, edgecolor="none")
    return figure


def _draw_obstacle(axes: "Axes", obstacle: Obstacle, view: View, label: str | None) -> None:
    from matplotlib.patches import Circle

    corners = view.flatten(np.asarray(obstacle.hull))
    if len(corners) > 1:
        axes.fill(*convex_line(corners).T, color=_OBSTACLE, label=label)
    else:
        axes.add_patch(Circle(tuple(corners[0]), obstacle.growth, color=_OBSTACLE, label=label))


def _draw_ground(axes: "Axes", height: float, clearance: float) -> None:
    low = min(axes.get_ylim()[0], height - _MARGIN)
    axes.axhspan(low, height, color=_GROUND, zorder=0.5, label="ground")
    axes.axhline(height + clearance, color=RED, linewidth=0.9, linestyle="--", label="clearance")
    axes.set_ylim(bottom=low)
