"""Terminal output of an optimised motion."""

from collections.abc import Iterator

from rich.table import Table

from hdrm_fmu.optimisation.assessment import BODY, Clearance, Peak
from hdrm_fmu.optimisation.problem import EndSpeed

from .motion import OptimisedMotion

_READ = {
    EndSpeed.CLIP: "replaced by the bound",
    EndSpeed.EXEMPT: "kept; the bound does not apply at the end",
    EndSpeed.DECIMAL: "divided by ten",
    EndSpeed.REST: "replaced by rest for all joints",
}


def remarks(result: OptimisedMotion) -> Iterator[str]:
    """Return the contradictions in the problem of the user, and how they were resolved."""
    for sentence in result.contradictions:
        read = _READ[result.end_speed] if sentence.startswith("v_E") else "kept"
        yield f"The problem contradicts itself: {sentence}; {read} (--end-speed {result.end_speed})"
    if not result.contradictions and result.end_speed == EndSpeed.REST:
        yield "All joints end at rest (--end-speed rest)"


def format_peaks(result: OptimisedMotion) -> Table:
    """Return a table of forces and speeds with their limits, by joint."""
    table = Table(title="Peaks on a dense grid, with their limits", title_justify="left")
    table.add_column("")
    for peak in result.assessment.peaks:
        table.add_column(peak.joint, justify="right")
    table.add_column("")
    for label, unit, cell in (
        ("force", "kN", lambda p: _part(p.force / 1e3, p.force_bound / 1e3)),
        ("speed", "mm/s", lambda p: _part(1e3 * p.speed, 1e3 * p.speed_bound)),
        ("acceleration", "mm/s²", lambda p: _part(1e3 * p.acceleration, _in_mm(p.acceleration_bound))),
        ("jerk", "mm/s³", lambda p: _part(1e3 * p.jerk, _in_mm(p.jerk_bound))),
        ("stroke", "m", lambda p: f"{p.lowest:.3f} to {p.highest:.3f}"),
    ):
        table.add_row(label, *map(cell, result.assessment.peaks), unit)
    return table


def format_clearances(result: OptimisedMotion) -> Iterator[str]:
    """Return the smallest distances from ground and body."""
    for found in result.assessment.clearances:
        near = found.smallest
        yield (
            f"Smallest distance from the {found.obstacle}: {near.distance:.3g} m, "
            f"required {found.required:g} m, {near.part} after {near.time:.3g} s"
        )


def format_costs(result: OptimisedMotion) -> Table:
    """Return a table of the costs of the motion."""
    figures = result.assessment
    table = Table(title="Cost", title_justify="left", show_header=False)
    for label, value, unit in (
        ("cost J as printed", f"{figures.cost:.0f}", "W² s"),
        ("lower bound ΔE² / (2 t_M)", f"{figures.least_cost:.0f}", "W² s"),
        ("tie-break term", f"{figures.tie_break:.0f}", "W² s"),
        ("gross work of the joints", f"{figures.gross_work:.0f}", "J"),
        ("net work, the change of energy", f"{figures.net_work:.0f}", "J"),
        ("duration t_M", f"{figures.duration:.2f}", "s"),
    ):
        table.add_row(label, value, unit)
    return table


def format_lines(result: OptimisedMotion) -> Iterator[str]:
    """Return how the motion was found, and whether it keeps its bounds on the dense grid."""
    how, solution = result.discretisation, result.solution
    of = f", best of {result.starts} starts" if result.starts > 1 else ""
    parts = f", each span in {how.subdivisions} parts" if how.subdivisions > 1 else ""
    yield (
        f"Degree {how.degree}, {how.knots} knots, {how.points} points between two{parts}: "
        f"{solution.iterations} iterations in {solution.wall_s:.2f} s ({solution.cpu_s:.2f} s CPU){of}"
    )
    beyond = [p for p in result.assessment.peaks if p.excess > 0.0]
    near = [clearance for clearance in result.assessment.clearances if not clearance.is_kept]
    if result.assessment.within_bounds:
        yield "All bounds hold on the dense grid."
    else:
        if beyond:
            yield "; ".join(map(_excess, beyond)) + "; use more --points or --knots"
        yield from map(_shortfall, near)


def _excess(peak: Peak) -> str:
    return f"The {peak.joint} exceeds a bound between points by {100.0 * peak.excess:.2g} % of its width"


def _shortfall(clearance: Clearance) -> str:
    near, what = clearance.smallest, clearance.obstacle
    where = f"{near.part} at x = {near.x:.3g}, y = {near.y:.3g} m after {near.time:.3g} s"
    aid = "move start or end" if what == BODY else "use more --points or --knots"
    too_small = f"{near.distance:.3g} m, required {clearance.required:g} m"
    return f"The distance from the {what} is {too_small}: {where}; {aid}"


def _in_mm(bound: float | None) -> float | None:
    return None if bound is None else 1e3 * bound


def _part(value: float, bound: float | None) -> str:
    return f"{value:.4g}" if bound is None else f"{value:.4g} of {bound:.4g}"
