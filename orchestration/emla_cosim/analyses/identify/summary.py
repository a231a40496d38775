"""Terminal output of an identification."""

from collections.abc import Iterator

from rich.markup import escape
from rich.table import Table

from ...base.wording import format_count
from .certainty import Estimate
from .fit import Fit
from .result import IdentificationResult


def format_tables(result: IdentificationResult) -> list[Table]:
    """Return the tables of estimates and fits, or of planned experiments."""
    if result.candidates:
        return [_candidates(result)]
    return [_estimates(result), *([_fits(result)] if result.fits else [])]


def format_lines(result: IdentificationResult) -> Iterator[str]:
    """Return what is not identified, notes, and the number of runs."""
    for one in result.estimates:
        if one.problem is not None:
            yield f"{one.name} is not identified: {one.problem}."
    yield from (f"Note: {note.rstrip('.')}." for note in result.notes)
    yield f"{format_count(result.runs, 'run')} in {result.wall_s:.0f} s"


def format_interval(one: Estimate) -> str:
    """Return the interval of an estimate; that of the profile likelihood if there is one."""
    if one.profile is not None:
        low, high = ("open" if x is None else f"{x:.5g}" for x in one.profile)
        return f"{low} … {high} (profile)"
    return "not identified" if one.interval is None else f"{one.interval[0]:.5g} … {one.interval[1]:.5g}"


def format_step_change(one: Estimate) -> str:
    """Return the change of an estimate by half the step, in standard errors; empty without an error."""
    if one.error is None:
        return ""
    return "not judged" if one.step_change is None else f"{one.step_change:.2f}"


def describe_residuals(one: Fit) -> str:
    """Return what the residuals of a fit still contain."""
    if one.related_input is not None:
        return f"related to {one.related_input}"
    return "white" if one.is_white else "correlated in time"


def _estimates(result: IdentificationResult) -> Table:
    table = Table(title=escape(f"Estimates of {result.name}"), title_justify="left")
    for head in ("", "start", "estimate", "std. error", "95 % interval", "", "½ step"):
        table.add_column(head, justify="left" if not head else "right", overflow="fold")
    for one in result.estimates:
        error = "" if one.error is None else f"{one.error:.2g}"
        table.add_row(
            escape(one.name),
            f"{one.start:.5g}",
            f"{one.value:.5g}",
            error,
            format_interval(one),
            escape(one.unit),
            format_step_change(one),
        )
    return table


def _fits(result: IdentificationResult) -> Table:
    table = Table(title="Fit", title_justify="left")
    for head in ("", "", "samples", "fit / %", "R²", "rms", "", "residuals"):
        table.add_column(head, justify="right" if head not in ("", "residuals") else "left", overflow="fold")
    for one in result.fits:
        table.add_row(
            escape(one.experiment + (" (held out)" if one.held_out else "")),
            escape(one.signal),
            str(one.samples),
            f"{100.0 * one.fit:.4g}",
            f"{one.r2:.5g}",
            f"{one.rms:.3g}",
            escape(one.unit),
            escape(describe_residuals(one)),
        )
    return table


def _candidates(result: IdentificationResult) -> Table:
    table = Table(
        title="What each experiment would tell: half widths of the intervals of 95 %", title_justify="left"
    )
    names = list(result.candidates[0].intervals)
    for head in ("", "information / bit", *names):
        table.add_column(escape(head), justify="left" if not head else "right", overflow="fold")
    for one in result.candidates:
        bits = "none" if one.information == -float("inf") else f"{one.information:.1f}"
        widths = ["?" if x is None else f"{x:.3g}" for x in one.intervals.values()]
        table.add_row(escape(one.experiment), bits, *widths)
    return table
