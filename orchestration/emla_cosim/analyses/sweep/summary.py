"""Format a sweep for the terminal: statuses, figures, sensitivities, the worst variants."""

import numpy as np
import polars
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from ...base.errors import CommandError
from ...base.wording import format_count
from ...master.instances.fmu_instance import tells_requested_end
from ...recorders.metrics import MetricDisplay
from ...run.remarks import tells_lost_values
from ...views.terminal import format_figure
from ..variants.data import DIED, DIVERGED, DONE, FAILED, PROBLEM, REFUSED, STATUS, VARIANT
from .columns import (
    NOT_HELD,
    check_figure,
    display_of,
    figure_values,
    is_done,
    is_truth,
    main_figure,
    read_outcomes,
)
from .result import SweepResult
from .sensitivity import ONE_AT_A_TIME, SALTELLI, local_sensitivities, sobol_indices

_MOST_FACTORS = 12
"""Most factors in a table of sensitivities."""

WORST = 5
"""Default number of the worst variants shown."""


def format_summary(
    result: SweepResult, figure: str | None = None, count: int = WORST
) -> list[RenderableType]:
    """Format all parts of the summary.

    Args:
        result: The sweep.
        figure: Figure for sensitivities and worst variants. Default: the first that varies.
        count: Number of the worst variants.

    Raises:
        CommandError: The sweep does not have the figure.
    """
    parts: list[RenderableType] = [status_line(result)]
    if figure is None:
        figure = main_figure(result)
    if figure is not None:
        check_figure(result, figure)
        if is_done(result).any():
            parts += [figures_table(result), *_sensitivities(result, figure)]
        if len(result.variants):
            parts.append(worst_table(result, figure, count))
    return parts


def status_line(result: SweepResult) -> Text:
    """Return the number of variants, in total and for each status."""
    statuses = [str(status) for status in result.variants[STATUS].to_list()]
    names = dict.fromkeys([DONE, DIVERGED, REFUSED, FAILED, DIED, *statuses])
    counts = {name: f"{statuses.count(name)} {name}" for name in names if name in statuses}
    if wrong := int((read_outcomes(result) == NOT_HELD).sum()):
        counts[DONE] += f" ({wrong} of them {NOT_HELD})"
    line = f"{format_count(len(statuses), 'variant')}: {', '.join(counts.values()) or 'none'}"
    if ended := sum(tells_requested_end(problem) for problem in result.variants[PROBLEM].to_list()):
        line += f". FMUs ended {ended} of them before the stop time: their figures are of shorter runs"
    if lost := sum(tells_lost_values(problem) for problem in result.variants[PROBLEM].to_list()):
        line += f". In {lost} of them, FMUs did not take start values: the column '{PROBLEM}' says which"
    return Text(line)


def figures_table(result: SweepResult) -> RenderableType:
    """Tabulate minimum, median, 95 % quantile and maximum of figures over variants that are done.

    Booleans have counts. Verdicts come first, since the other figures depend on them.
    """
    title = f"Figures of the variants that are done ({int(is_done(result).sum())})"
    table = _new_table("least", "median", "95 %", "largest")
    table.add_column("")
    for figure in dict.fromkeys([*result.verdicts, *result.figures]):
        shown, values = display_of(result, figure), figure_values(result, figure)
        known = values[~np.isnan(values)]
        if is_truth(result, figure):
            cells = ["", "", "", f"{int(known.sum())} of {len(known)} yes"]
        else:
            values = np.percentile(known, [0, 50, 95, 100]) if len(known) else np.full(4, np.nan)
            cells = [format_figure(float(value), shown) for value in values]
        table.add_row(escape(shown.label), *cells, escape(shown.unit))
    return _add_title(title, table)


def _sensitivities(result: SweepResult, figure: str) -> list[RenderableType]:
    tables = {SALTELLI: sobol_table, ONE_AT_A_TIME: local_table}
    if result.sampling not in tables:
        return []
    try:
        return [tables[result.sampling](result, figure)]
    except CommandError as error:  # there are too few variants
        return [Text(str(error))]


def sobol_table(result: SweepResult, figure: str) -> RenderableType:
    """Tabulate the Sobol indices of a figure, the largest total first. Errors: as `sobol_indices`."""
    found = sobol_indices(result, figure)
    left_out = f", {found.left_out} left out" if found.left_out else ""
    title = f"Sobol indices of {display_of(result, figure).label}, from {found.groups} base samples{left_out}"
    table = _new_table("first order", "total")
    strongest = np.argsort(-found.total, kind="stable")
    for i in strongest[:_MOST_FACTORS]:
        table.add_row(
            escape(found.factors[i]),
            f"{found.first[i]:.2f} ± {found.first_confidence[i]:.2f}",
            f"{found.total[i]:.2f} ± {found.total_confidence[i]:.2f}",
        )
    _tell_rest(table, len(strongest))
    titled = _add_title(title, table)
    return titled if found.warning is None else Group(titled, Text(f"Warning: {found.warning}"))


def local_table(result: SweepResult, figure: str) -> RenderableType:
    """Tabulate a figure with each factor alone low and high, the largest effect first.

    Errors are those of `local_sensitivities`.
    """
    shown = display_of(result, figure)
    unit = f" in {shown.unit}" if shown.unit else ""
    table = _new_table("low", "nominal", "high")
    rows = local_sensitivities(result, figure)
    for row in rows[:_MOST_FACTORS]:
        values = (row.low, row.nominal, row.high)
        table.add_row(escape(row.factor), *(_format_figure(result, figure, shown, value) for value in values))
    _tell_rest(table, len(rows))
    return _add_title(f"{shown.label}{unit}, each factor alone", table)


def _new_table(*heads: str) -> Table:
    """Return a table with a column of names, and columns of numbers."""
    table = Table()
    table.add_column("", overflow="fold")
    for head in heads:
        table.add_column(head, justify="right")
    return table


def _tell_rest(table: Table, factors: int) -> None:
    """Add a last row with the number of omitted factors."""
    if (rest := factors - _MOST_FACTORS) > 0:
        table.add_row(f"and {rest} with less effect", style="dim")


def find_worst_variants(result: SweepResult, figure: str, count: int = WORST) -> polars.DataFrame:
    """Return the rows of the worst variants: not done, then not held, then without the figure.

    Then follow the largest numbers, or false before true. Equal variants are sorted by number.

    Raises:
        CommandError: The sweep does not have the figure.
    """
    values = figure_values(result, figure)
    badness = np.where(np.isnan(values), np.inf, -values if is_truth(result, figure) else values)
    held = read_outcomes(result) != NOT_HELD
    order = np.lexsort((result.variants[VARIANT].to_numpy(), -badness, held, is_done(result)))
    return result.variants[order[:count]]


def worst_table(result: SweepResult, figure: str, count: int = WORST) -> RenderableType:
    """Tabulate the worst variants (see `find_worst_variants`), each with its problem."""
    rows, shown = find_worst_variants(result, figure, count), display_of(result, figure)
    head = f"{shown.label} / {shown.unit}" if shown.unit else shown.label
    table = Table()
    table.add_column("variant", justify="right")
    table.add_column("status")
    table.add_column(escape(head), justify="right", overflow="fold", max_width=26)
    table.add_column("", overflow="fold", ratio=1)
    ended = dict(zip(result.variants[VARIANT], read_outcomes(result), strict=True))
    for row in rows.iter_rows(named=True):
        table.add_row(
            str(row[VARIANT]),
            escape(str(ended[row[VARIANT]])),
            _format_figure(result, figure, shown, row[figure]),
            escape(row[PROBLEM] or ""),
        )
    return _add_title("The worst variants", table)


def list_worst_commands(result: SweepResult, figure: str | None = None, count: int = WORST) -> list[str]:
    """Return lines with the commands that run the worst variants. `figure` is as in `format_summary`."""
    figure = figure or main_figure(result)
    if figure is None:
        return []
    lines = [line for n in find_worst_variants(result, figure, count)[VARIANT] if (line := result.command(n))]
    return [f"What runs {'it' if len(lines) == 1 else 'each'} alone:", *lines] if lines else []


def _format_figure(result: SweepResult, figure: str, shown: MetricDisplay, value: float | bool | None) -> str:
    if value is None:
        return "none"
    return format_figure(bool(value) if is_truth(result, figure) else float(value), shown)


def _add_title(title: str, table: Table) -> RenderableType:
    """Put a title above a table. It may be wider than the table."""
    return Group(Text(title, style="table.title"), table)
