"""The report of a sweep: statuses, figures, sensitivities, the worst variants, pictures."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import polars

from ...base.errors import CommandError
from ...base.wording import format_count
from ...master.instances.fmu_instance import is_requested_end
from ...recorders.metrics import MetricDisplay
from ...run.remarks import has_lost_values_remark
from ...views.formatting import format_figure
from ..frame.outputs import Outputs
from ..frame.report import Report, ReportTable, Section
from ..variants.measures import DIED, DIVERGED, DONE, FAILED, PROBLEM, REFUSED, STATUS, VARIANT, to_parquet
from .charts import draw_bands, draw_sobol, draw_tornado
from .columns import display_of, figure_values, is_truth, main_figure
from .result import NOT_HELD, RECORD, SERIES, TABLE, SweepResult
from .scatter import draw_figures, draw_map
from .sensitivity import (
    ONE_AT_A_TIME,
    SALTELLI,
    Statements,
    all_sobol_indices,
    local_sensitivities,
    make_statements,
    sobol_indices,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MAX_FACTORS, _MAX_WORST = 12, 5
"""Most factors in a table of sensitivities, and most of the worst variants to show."""

_WORST_FILE, _MAX_LETTERS = "worst.txt", 1600
"""The file with the commands of the worst variants, if they have more letters."""

PICTURES: dict[str, tuple["Callable[[SweepResult, Sequence[str]], Figure]", str]] = {
    "bands": (draw_bands, "Percentiles of the signals over time"),
    "figures": (draw_figures, "Figures against the strongest factors, a point for each variant"),
    "tornado": (draw_tornado, "Figures with each factor alone low and high"),
    "sobol": (draw_sobol, "Sobol indices with their confidence"),
    "map": (draw_map, "Outcomes over the two strongest factors"),
}
"""Functions that draw the pictures of `SweepResult.plot` from a result and names, and what these show.

They raise CommandError if the result has no data for the picture.
"""


def draw_pictures(result: SweepResult) -> "Iterator[tuple[str, Figure]]":
    """Yield each picture that suits a result, with its file name."""
    # a tornado shows all that one factor at a time has to show
    kinds = ("bands", "tornado") if result.sampling == ONE_AT_A_TIME else PICTURES
    for kind in kinds:
        try:
            figure = result.plot(kind)
        except CommandError:  # the result has nothing for it
            continue
        yield f"{kind}.png", figure


def build_report(result: SweepResult) -> Report:
    """Return the report of a sweep."""
    figure, statements = main_figure(result), make_statements(result)
    sections = [Section(lines=[status_line(result), *([] if statements is None else statements.sentences)])]
    if figure is not None and result.is_done.any():
        sections.append(Section(tables=[tabulate_figures(result)]))
        if statements is not None and statements.quantiles:
            sections.append(Section(tables=[_tabulate_intervals(result, statements)], is_detail=True))
        sections += _list_sensitivities(result, figure)
    if figure is not None and len(result.variants):
        commands = _list_worst_commands(result)
        if result.folder is not None and _has_long_commands(commands):
            commands = [f"Commands to run each of them alone are in {result.folder / _WORST_FILE}."]
        sections.append(Section(tables=[_tabulate_worst(result, figure)], under=commands))
    pictures = {f"{kind}.png": caption for kind, (_, caption) in PICTURES.items()}
    sections.append(Section("Plots", pictures=pictures, is_detail=True))
    sections.append(Section("Notes", [f"{note}." for note in result.notes], is_detail=True))
    factors = format_count(len(result.factors), "factor")
    facts = [format_count(result.variants.height, "variant"), factors, f"sampling {result.sampling}"]
    return Report("Sweep", result.name, facts, sections)


def status_line(result: SweepResult) -> str:
    """Return the number of variants, in total and for each status."""
    statuses = [str(status) for status in result.variants[STATUS].to_list()]
    names = dict.fromkeys([DONE, DIVERGED, REFUSED, FAILED, DIED, *statuses])
    counts = {name: f"{statuses.count(name)} {name}" for name in names if name in statuses}
    if not_held := int((result.outcomes == NOT_HELD).sum()):
        counts[DONE] += f" ({not_held} of them {NOT_HELD})"
    line = f"{format_count(len(statuses), 'variant')}: {', '.join(counts.values()) or 'none'}"
    if ended := sum(is_requested_end(problem) for problem in result.variants[PROBLEM].to_list()):
        line += f". FMUs ended {ended} of them before the stop time: their figures are of shorter runs"
    if ignoring := sum(has_lost_values_remark(problem) for problem in result.variants[PROBLEM].to_list()):
        line += f". In {ignoring} of them, FMUs did not take start values: the column '{PROBLEM}' says which"
    return line


def tabulate_figures(result: SweepResult) -> ReportTable:
    """Tabulate minimum, median, 95 % quantile and maximum of figures over variants that are done.

    Booleans have counts. Verdicts come first, since the other figures depend on them.
    """
    rows = list[list[str]]()
    for figure in dict.fromkeys([*result.verdicts, *result.figures]):
        display, values = display_of(result, figure), figure_values(result, figure)
        values = values[~np.isnan(values)]
        if is_truth(result, figure):
            cells = ["", "", "", f"{int(values.sum())} of {len(values)} yes"]
        else:
            numbers = np.percentile(values, [0, 50, 95, 100]) if len(values) else np.full(4, np.nan)
            cells = [format_figure(float(number), display) for number in numbers]
        rows.append([display.label, *cells, display.unit])
    title = f"Figures of the variants that are done ({int(result.is_done.sum())})"
    return ReportTable(title, ("", "least", "median", "95 %", "largest", ""), rows, texts=(0, 5))


def _tabulate_intervals(result: SweepResult, statements: Statements) -> ReportTable:
    rows = list[list[str]]()
    for figure, intervals in statements.quantiles.items():
        display = display_of(result, figure)
        cells = [text for x in intervals.values() for text in _format_interval(x, display)]
        rows.append([display.label, *cells, display.unit])
    names = next(iter(statements.quantiles.values()))
    header = ["", *(head for name in names for head in (name, "interval")), ""]
    title = "Quantiles of the figures, with intervals of 95 % confidence"
    return ReportTable(title, header, rows, texts=(0, len(header) - 1))


def _format_interval(interval: Mapping[str, float], display: MetricDisplay) -> tuple[str, str]:
    value, low, high = (format_figure(interval[name], display) for name in ("value", "low", "high"))
    if math.isinf(interval["low"]):
        return value, "too few variants" if math.isinf(interval["high"]) else f"up to {high}"
    return value, f"from {low}" if math.isinf(interval["high"]) else f"{low} to {high}"


def _list_sensitivities(result: SweepResult, figure: str) -> list[Section]:
    """Return a section with sensitivities, or why there are none; empty for samplings without them."""
    tables = {SALTELLI: tabulate_sobol_indices, ONE_AT_A_TIME: tabulate_sensitivities}
    if result.sampling not in tables:
        return []
    try:
        return [Section(tables=[tables[result.sampling](result, figure)])]
    except CommandError as error:  # there are too few variants
        return [Section(lines=[str(error)])]


def tabulate_sobol_indices(result: SweepResult, figure: str) -> ReportTable:
    """Tabulate the Sobol indices of a figure, the largest total first. Errors: as `sobol_indices`."""
    indices = sobol_indices(result, figure)
    first = zip(indices.first, indices.first_confidence, strict=True)
    total = zip(indices.total, indices.total_confidence, strict=True)
    cells = [
        [f"{value:.2f} ± {width:.2f}" for value, width in pair] for pair in zip(first, total, strict=True)
    ]
    rows = [[indices.factors[i], *cells[i]] for i in np.argsort(-indices.total, kind="stable")]
    left_out = f", {indices.left_out} left out" if indices.left_out else ""
    label = display_of(result, figure).label
    title = f"Sobol indices of {label}, from {indices.groups} base samples{left_out}"
    under = [] if indices.warning is None else [f"Warning: {indices.warning}"]
    return ReportTable(title, ("", "first order", "total"), _limit_rows(rows), under)


def tabulate_sensitivities(result: SweepResult, figure: str) -> ReportTable:
    """Tabulate a figure with each factor alone low and high, the largest effect first.

    Errors are those of `local_sensitivities`.
    """
    display = display_of(result, figure)
    unit = f" in {display.unit}" if display.unit else ""
    rows = [
        [row.factor, *(_format_figure(result, figure, x) for x in (row.low, row.nominal, row.high))]
        for row in local_sensitivities(result, figure)
    ]
    title = f"{display.label}{unit}, each factor alone"
    return ReportTable(title, ("", "low", "nominal", "high"), _limit_rows(rows))


def _limit_rows(rows: list[list[str]]) -> list[list[str]]:
    """Return the first rows; of more, a last row has the number."""
    if (rest := len(rows) - _MAX_FACTORS) <= 0:
        return rows
    return [*rows[:_MAX_FACTORS], [f"and {rest} with less effect", *[""] * (len(rows[0]) - 1)]]


def find_worst_variants(result: SweepResult, figure: str, count: int) -> polars.DataFrame:
    """Return the rows of the worst variants: not completed, then not held, then without the figure.

    Then follow the largest numbers, or false before true. Equal variants are sorted by number.

    Raises:
        CommandError: The sweep does not have the figure.
    """
    values = figure_values(result, figure)
    severity = np.where(np.isnan(values), np.inf, -values if is_truth(result, figure) else values)
    is_held = result.outcomes != NOT_HELD
    # the last key is the first to be compared
    order = np.lexsort((result.variants[VARIANT].to_numpy(), -severity, is_held, result.is_done))
    return result.variants[order[:count]]


def _tabulate_worst(result: SweepResult, figure: str) -> ReportTable:
    display = display_of(result, figure)
    outcomes = dict(zip(result.variants[VARIANT], result.outcomes, strict=True))
    worst = find_worst_variants(result, figure, _MAX_WORST).select(VARIANT, figure, PROBLEM).rows()
    rows = [
        [str(number), str(outcomes[number]), _format_figure(result, figure, value), problem or ""]
        for number, value, problem in worst
    ]
    head = f"{display.label} / {display.unit}" if display.unit else display.label
    return ReportTable("The worst variants", ("variant", "status", head, ""), rows, texts=(1, 3))


def _list_worst_commands(result: SweepResult) -> list[str]:
    """Return lines with the commands that run the worst variants alone."""
    if (figure := main_figure(result)) is None:
        return []
    worst = find_worst_variants(result, figure, _MAX_WORST)[VARIANT]
    lines = [line for number in worst if (line := result.command(number))]
    head = "Command to run it alone:" if len(lines) == 1 else "Commands to run each alone:"
    return [head, *lines] if lines else []


def _format_worst_commands(result: SweepResult) -> str | None:
    """Return the content of the file with the commands of the worst variants; None if they are short."""
    lines = _list_worst_commands(result)
    return "\n".join([f"# {lines[0]}", *lines[1:], ""]) if _has_long_commands(lines) else None


def _has_long_commands(commands: Sequence[str]) -> bool:
    return sum(map(len, commands)) > _MAX_LETTERS


def _format_figure(result: SweepResult, figure: str, value: float | bool | None) -> str:
    if value is None:
        return "none"
    value = bool(value) if is_truth(result, figure) else float(value)
    return format_figure(value, display_of(result, figure))


def _build_record(result: SweepResult) -> dict[str, Any]:
    """Return the record with what follows from all variants: statements and Sobol indices."""
    record = dict(result.record)
    if (statements := make_statements(result)) is not None:
        record |= statements.record()
    if result.complete and result.sampling == SALTELLI:
        record["sobol"] = {name: indices.record() for name, indices in all_sobol_indices(result).items()}
    return record


OUTPUTS = Outputs[SweepResult](
    subject="sweep",
    name="sweep",
    record=_build_record,
    tables={TABLE: lambda result: to_parquet(result.variants), _WORST_FILE: _format_worst_commands},
    report=build_report,
    draw=draw_pictures,
    pictures=tuple(f"{kind}.png" for kind in PICTURES),
    folders=(SERIES,),
    record_file=RECORD,
)
