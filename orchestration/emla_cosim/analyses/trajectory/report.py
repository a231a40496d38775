"""The report of an optimized motion: cost, peaks and distances, its pictures and files."""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from machine_fmu.optimisation.assessment import BODY, GROUND, Clearance, Course, Peak, Swing
from machine_fmu.optimisation.obstacles import Obstacle
from machine_fmu.optimisation.problem import EndSpeed, MotionProblem

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.extras import has_extra, require_extra
from ...base.files import check_output_files, report_write_errors
from ...base.output_files import OutputFile, has_mark, is_page
from ...study.machines.motion import WHAT, check_trajectory
from ...study.sketch.parts import MachineParts
from ...study.sketch.scene import actuator_colors, build_polygons, convex_line
from ...study.sketch.workspace import PLANE, THREE_SIDES, View
from ...views.plots.style import BLUE, GREY, ORANGE, RED, is_picture, new_figure, tidy_axes, to_png
from ..frame.outputs import is_drawn, render_page
from ..frame.report import Report, ReportTable, Section, Text
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
    """Draw a panel for each row and joint over time, with the bounds as dashed lines."""
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
        faint = build_polygons(start.values(), view, colors, 0.35, only_moving=True)
        for polygons in (faint, build_polygons(end.values(), view, colors)):
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


_READINGS = {
    EndSpeed.CLIP: "replaced by the bound",
    EndSpeed.EXEMPT: "kept; the bound does not apply at the end",
    EndSpeed.DECIMAL: "divided by ten",
    EndSpeed.REST: "replaced by rest for all joints",
}


_MAX_COLUMNS = 3
"""Most joints of a table."""


def build_report(result: TrajectoryResult) -> Report:
    """Return the report of a motion."""
    section = Section(
        lines=list(_list_assumptions(result)),
        tables=[_tabulate_cost(result), *_tabulate_peaks(result)],
        pictures={name: name.replace("-", " ") for name in PICTURES},
        under=[*_list_distances(result), *_describe_outcome(result)],
    )
    return Report("Trajectory", "motion of least cost", [f"{result.assessment.duration:.2f} s"], [section])


def _list_assumptions(result: TrajectoryResult) -> Iterator[str]:
    """Yield the contradictions in the problem, how they were resolved, and what does not move."""
    for sentence in result.contradictions:
        read = _READINGS[result.end_speed] if sentence.startswith("v_E") else "kept"
        yield f"The problem contradicts itself: {sentence}; {read} (--end-speed {result.end_speed})"
    if result.swings:
        swings = ", ".join(f"{swing.name} {_format_deflection(swing)}" for swing in result.swings)
        yield (
            "What swings freely hangs as at rest, without swinging. Accelerations would deflect it by up to: "
            f"{swings}"
        )
    if not result.contradictions and result.end_speed == EndSpeed.REST:
        yield "All joints end at rest (--end-speed rest)"


def _tabulate_peaks(result: TrajectoryResult) -> Iterator[ReportTable]:
    """Yield tables of forces and speeds with their limits, by joint; a few joints in each."""
    figures: list[tuple[str, str, Callable[[Peak], str]]] = [
        ("force", "kN", lambda p: _format(p.force / 1e3, p.force_bound / 1e3)),
        ("speed", "mm/s", lambda p: _format(1e3 * p.speed, 1e3 * p.speed_bound)),
        ("acceleration", "mm/s²", lambda p: _format(1e3 * p.acceleration, _to_mm(p.acceleration_bound))),
        ("jerk", "mm/s³", lambda p: _format(1e3 * p.jerk, _to_mm(p.jerk_bound))),
        ("stroke", "m", lambda p: f"{p.lowest:.3f} to {p.highest:.3f}"),
    ]
    for first in range(0, len(result.assessment.peaks), _MAX_COLUMNS):
        peaks = result.assessment.peaks[first : first + _MAX_COLUMNS]
        rows = [[label, *map(cell, peaks), unit] for label, unit, cell in figures]
        header, title = ["", *(x.joint for x in peaks), ""], "Peaks on a dense grid, with their limits"
        yield ReportTable(title, header, rows, texts=(0, len(header) - 1))


def _tabulate_cost(result: TrajectoryResult) -> ReportTable:
    figures = result.assessment
    rows = [
        ("cost J as printed", f"{figures.cost:.0f}", "W² s"),
        ("lower bound ΔE² / (2 t_M)", f"{figures.least_cost:.0f}", "W² s"),
        ("tie-break term", f"{figures.tie_break:.0f}", "W² s"),
        ("gross work of the joints", f"{figures.gross_work:.0f}", "J"),
        ("net work, the change of energy", f"{figures.net_work:.0f}", "J"),
        ("duration t_M", f"{figures.duration:.2f}", "s"),
    ]
    return ReportTable("Cost", ("", "", ""), rows, texts=(0, 2))


def _list_distances(result: TrajectoryResult) -> Iterator[str]:
    """Yield the smallest distances from ground and body."""
    for clearance in result.assessment.clearances:
        near = clearance.smallest
        yield (
            f"Smallest distance from {_name_obstacle(clearance)}: {near.distance:.3g} m, "
            f"required {clearance.required:g} m, {near.part} after {near.time:.3g} s"
        )


def _describe_outcome(result: TrajectoryResult) -> Iterator[Text | str]:
    """Yield how the motion was found, and whether it keeps its bounds on the dense grid."""
    how, solution = result.discretisation, result.solution
    attempts = f", best of {result.starts} starts" if result.starts > 1 else ""
    parts = f", each span in {how.subdivisions} parts" if how.subdivisions > 1 else ""
    yield (
        f"Degree {how.degree}, {how.knots} knots, {how.points} points between two{parts}: "
        f"{solution.iterations} iterations in {solution.wall_s:.2f} s ({solution.cpu_s:.2f} s CPU){attempts}"
    )
    if result.assessment.within_bounds:
        yield "All bounds hold on the dense grid."
        return
    if exceeding := [peak for peak in result.assessment.peaks if peak.excess > 0.0]:
        excesses = [
            f"The {peak.joint} exceeds a bound between points by {100.0 * peak.excess:.2g} % of its width"
            for peak in exceeding
        ]
        yield Text(f"{'; '.join(excesses)}; use more --points or --knots", is_failure=True)
    for clearance in result.assessment.clearances:
        if not clearance.is_kept:
            yield Text(_describe_shortfall(clearance), is_failure=True)


def _describe_shortfall(clearance: Clearance) -> str:
    """Return a message on a distance that is too small: where, when, and what to do."""
    near, obstacle = clearance.smallest, clearance.obstacle
    coordinates = zip("xyz", (near.x, near.y, near.z), strict=True)
    position = ", ".join(f"{axis} = {value:.3g}" for axis, value in coordinates if value is not None)
    where = f"{near.part} at {position} m after {near.time:.3g} s"
    aid = "move start or end" if obstacle == BODY else "use more --points or --knots"
    too_small = f"{near.distance:.3g} m, required {clearance.required:g} m"
    return f"The distance from {_name_obstacle(clearance)} is {too_small}: {where}; {aid}"


def _name_obstacle(clearance: Clearance) -> str:
    """Return what a text calls the obstacle of a clearance."""
    return f"the {clearance.obstacle}" if clearance.obstacle in (GROUND, BODY) else clearance.obstacle


def _format_deflection(swing: Swing) -> str:
    if swing.unit == "rad":
        return f"{math.degrees(swing.deflection):.2g}°"
    return f"{swing.deflection:.2g} {swing.unit}"


def _to_mm(bound: float | None) -> float | None:
    return None if bound is None else 1e3 * bound


def _format(value: float, bound: float | None) -> str:
    return f"{value:.4g}" if bound is None else f"{value:.4g} of {bound:.4g}"


_PAYLOAD_MARK = "# emla-cosim payload 1\n"


class MotionFiles:
    """The files to write. They are checked before anything is computed.

    Args:
        path: The trajectory file.
        problem: The problem.
        source: What the user passed as the problem, such as a file.
        overwrite: Whether to replace files that emla did not write.
        plots: Whether to draw pictures.
        report: Whether to write a page.

    Raises:
        CommandError: A file may not be replaced, or is that of the problem.
    """

    def __init__(
        self, path: Path, problem: MotionProblem, source: object, overwrite: bool, plots: bool, report: bool
    ) -> None:
        if (suffix := path.suffix.lower()) in (".png", ".html"):
            subject = "pictures do" if suffix == ".png" else "page does"
            raise CommandError(f"the trajectory '{path}' must not end in {suffix}, as its {subject}.")
        if report:
            require_extra("plots", "a page")
        drawn = [path.with_name(f"{path.stem}-{name}.png") for name in PICTURES]
        pictures = drawn if plots and has_extra("plots") else []
        page = path.with_suffix(".html")
        self._possible = [*drawn, page]
        used = {Path(source): "the problem"} if isinstance(source, (str, Path)) else {}
        check_output_files({path: WHAT} | dict.fromkeys(pictures, "the picture"), used)
        self._path, self._overwrite = path, overwrite
        check_trajectory(path, overwrite)
        self._pictures = [OutputFile(picture, "the picture", is_picture, overwrite) for picture in pictures]
        self._page = self._payload = None
        if report:
            self._page = OutputFile(page, "the page", is_page, overwrite)
        if len(problem.loads) > 1:
            payload = path.with_name(f"{path.stem}-payload.csv")
            is_ours = has_mark(_PAYLOAD_MARK.encode())
            self._payload = OutputFile(payload, "the payload", is_ours, overwrite)

    @property
    def paths(self) -> list[Path]:
        """All files, the trajectory first."""
        further = [self._payload, *self._pictures, self._page]
        return [self._path, *(file.path for file in further if file is not None)]

    def write(self, result: TrajectoryResult) -> None:
        """Write all files, and remove pictures and pages of the motion before. Raises RunError."""
        result.save(self._path, self._overwrite)
        with report_write_errors(self._path.parent):
            for path in self._possible:
                if path not in self.paths and is_drawn(path):
                    path.unlink()
        if self._payload is not None:
            self._payload.write(_format_payload(result).encode())
        figures = draw_pictures(result) if self._pictures or self._page else {}
        pictures = {name: to_png(figure) for name, figure in figures.items()}
        for file, picture in zip(self._pictures, pictures.values(), strict=False):
            file.write(picture)
        if self._page is not None:
            self._page.write(render_page(build_report(result), pictures))


def _format_payload(result: TrajectoryResult) -> str:
    """Return times in s and the payloads in kg from then on, as data for an input of a scenario."""
    spline = result.spline
    rows = [(spline.start + x.first * (spline.end - spline.start), x.payload) for x in result.problem.loads]
    lines = "".join(f"{time!r},{float(payload)!r}\n" for time, payload in rows)
    return f"{_PAYLOAD_MARK}time [s],payload [kg]\n{lines}"
