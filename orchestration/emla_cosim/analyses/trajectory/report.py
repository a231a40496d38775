"""What people read of an optimised motion: cost, peaks, distances, and whether bounds hold."""

from collections.abc import Callable, Iterator

from machine_fmu.optimisation.assessment import BODY, Clearance, Peak
from machine_fmu.optimisation.problem import EndSpeed

from ..frame.report import Report, ReportTable, Section, Text
from .pictures import PICTURES
from .result import TrajectoryResult

_READ = {
    EndSpeed.CLIP: "replaced by the bound",
    EndSpeed.EXEMPT: "kept; the bound does not apply at the end",
    EndSpeed.DECIMAL: "divided by ten",
    EndSpeed.REST: "replaced by rest for all joints",
}


def build_report(result: TrajectoryResult) -> Report:
    """Return the report of a motion."""
    section = Section(
        lines=list(_assumptions(result)),
        tables=[_cost_table(result), _peak_table(result)],
        pictures={name: name.replace("-", " ") for name in PICTURES},
        under=[*_distances(result), *_judgement(result)],
    )
    return Report("Trajectory", "motion of least cost", [f"{result.assessment.duration:.2f} s"], [section])


def _assumptions(result: TrajectoryResult) -> Iterator[str]:
    """Yield the contradictions in the problem of the user, and how they were resolved."""
    for sentence in result.contradictions:
        read = _READ[result.end_speed] if sentence.startswith("v_E") else "kept"
        yield f"The problem contradicts itself: {sentence}; {read} (--end-speed {result.end_speed})"
    if not result.contradictions and result.end_speed == EndSpeed.REST:
        yield "All joints end at rest (--end-speed rest)"


def _peak_table(result: TrajectoryResult) -> ReportTable:
    """Return forces and speeds with their limits, by joint."""
    peaks = result.assessment.peaks
    cells: list[tuple[str, str, Callable[[Peak], str]]] = [
        ("force", "kN", lambda p: _with_bound(p.force / 1e3, p.force_bound / 1e3)),
        ("speed", "mm/s", lambda p: _with_bound(1e3 * p.speed, 1e3 * p.speed_bound)),
        ("acceleration", "mm/s²", lambda p: _with_bound(1e3 * p.acceleration, _in_mm(p.acceleration_bound))),
        ("jerk", "mm/s³", lambda p: _with_bound(1e3 * p.jerk, _in_mm(p.jerk_bound))),
        ("stroke", "m", lambda p: f"{p.lowest:.3f} to {p.highest:.3f}"),
    ]
    rows = [[label, *map(cell, peaks), unit] for label, unit, cell in cells]
    header = ["", *(peak.joint for peak in peaks), ""]
    return ReportTable("Peaks on a dense grid, with their limits", header, rows, texts=(0, len(header) - 1))


def _cost_table(result: TrajectoryResult) -> ReportTable:
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


def _distances(result: TrajectoryResult) -> Iterator[str]:
    """Yield the smallest distances from ground and body."""
    for clearance in result.assessment.clearances:
        near = clearance.smallest
        yield (
            f"Smallest distance from the {clearance.obstacle}: {near.distance:.3g} m, "
            f"required {clearance.required:g} m, {near.part} after {near.time:.3g} s"
        )


def _judgement(result: TrajectoryResult) -> Iterator[Text | str]:
    """Yield how the motion was found, and whether it keeps its bounds on the dense grid."""
    how, solution = result.discretisation, result.solution
    of = f", best of {result.starts} starts" if result.starts > 1 else ""
    parts = f", each span in {how.subdivisions} parts" if how.subdivisions > 1 else ""
    yield (
        f"Degree {how.degree}, {how.knots} knots, {how.points} points between two{parts}: "
        f"{solution.iterations} iterations in {solution.wall_s:.2f} s ({solution.cpu_s:.2f} s CPU){of}"
    )
    if result.assessment.within_bounds:
        yield "All bounds hold on the dense grid."
        return
    if beyond := [peak for peak in result.assessment.peaks if peak.excess > 0.0]:
        excesses = [
            f"The {peak.joint} exceeds a bound between points by {100.0 * peak.excess:.2g} % of its width"
            for peak in beyond
        ]
        yield Text(f"{'; '.join(excesses)}; use more --points or --knots", is_failure=True)
    for clearance in result.assessment.clearances:
        if not clearance.is_kept:
            yield Text(_describe_shortfall(clearance), is_failure=True)


def _describe_shortfall(clearance: Clearance) -> str:
    near, what = clearance.smallest, clearance.obstacle
    where = f"{near.part} at x = {near.x:.3g}, y = {near.y:.3g} m after {near.time:.3g} s"
    aid = "move start or end" if what == BODY else "use more --points or --knots"
    too_small = f"{near.distance:.3g} m, required {clearance.required:g} m"
    return f"The distance from the {what} is {too_small}: {where}; {aid}"


def _in_mm(bound: float | None) -> float | None:
    return None if bound is None else 1e3 * bound


def _with_bound(value: float, bound: float | None) -> str:
    return f"{value:.4g}" if bound is None else f"{value:.4g} of {bound:.4g}"
