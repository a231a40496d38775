"""The report of an optimised motion: cost, peaks, distances, and whether bounds hold."""

import math
from collections.abc import Callable, Iterator

from machine_fmu.optimisation.assessment import BODY, GROUND, Clearance, Peak, Swing
from machine_fmu.optimisation.problem import EndSpeed

from ..frame.report import Report, ReportTable, Section, Text
from .pictures import PICTURES
from .result import TrajectoryResult

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
        under=[*_list_distances(result), *_list_judgement(result)],
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


def _list_judgement(result: TrajectoryResult) -> Iterator[Text | str]:
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
