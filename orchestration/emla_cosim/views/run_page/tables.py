"""Ending, metrics and settings of a run as texts."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ...recorders.metrics import MetricDisplay, list_figures
from ...run.result import Result
from ..formatting import PROFILE_COLUMNS, format_figure, format_value, list_profile_rows

MOST = 1000
"""Most rows of a table; the files have all of them."""


BONDS = (
    MetricDisplay("energy_error", "energy created or destroyed by the coupling", 100.0, "%"),
    MetricDisplay("energy_error_J", "the same in joules", 1.0, "J"),
    MetricDisplay("energy_exchanged_J", "energy exchanged", 1.0, "J"),
)
"""Labels and units of the metrics of power bonds."""


MARGINS = (
    MetricDisplay("phase_deg", "phase margin", 1.0, "°"),
    MetricDisplay("gain_up_dB", "gain margin, up", 1.0, "dB"),
    MetricDisplay("gain_down_dB", "gain margin, down", 1.0, "dB"),
    MetricDisplay("delay_s", "delay margin", 1e3, "ms"),
    MetricDisplay("Ms", "sensitivity Ms"),
)
"""Labels and units of stability margins."""


@dataclass(frozen=True)
class FigureTable:
    """Metrics of one kind: subjects as columns, and rows with label, values and unit; maybe with a title."""

    kind: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...], str], ...]
    title: str = ""


@dataclass(frozen=True)
class StartValueRow:
    """A start value that differs from that of the FMU."""

    name: str
    value: str
    unit: str
    default: str


def describe_ending(result: Result) -> tuple[str, list[str]]:
    """Return passed, warning or failed, and sentences with the reasons."""
    if result.interrupted:
        reason = result.problem or f"interrupted at t = {result.end_s:.6g} s."
        return "warning", [f"{reason[:1].upper()}{reason[1:]}", *result.remarks]
    if result.problem is not None:
        return "failed", [f"Failed: {result.problem}", *result.remarks]
    if result.remarks:
        return "warning", list(result.remarks)
    verdicts = [figure.value for figure in list_figures(result.metrics).values() if figure.is_verdict]
    more = "; all joints held" if verdicts and all(verdicts) else ""
    return "passed", [f"Completed{more}."]


def list_figure_tables(result: Result) -> Iterator[FigureTable]:
    """Yield the tables that the terminal also shows."""
    for kind, figures in result.metrics.items():
        if displays := result.displays.get(kind, ()):
            yield _build_table(kind, figures, displays)
    bonds = {name: figures for name, figures in result.coupling.items() if BONDS[0].name in figures}
    if bonds:
        yield _build_table("power bonds", bonds, BONDS)


def _build_table(
    kind: str, figures: Mapping[str, Mapping[str, Any]], displays: Iterable[MetricDisplay], title: str = ""
) -> FigureTable:
    rows = tuple(
        (
            display.label,
            tuple(format_figure(f[display.name], display) for f in figures.values()),
            display.unit,
        )
        for display in displays
    )
    return FigureTable(kind, tuple(figures), rows, title)


def list_margin_tables(result: Result) -> Iterator[FigureTable]:
    """Yield the table of stability margins that the run was given, if there are any."""
    if (margins := result.record.get("margins")) is not None:
        nothing = dict.fromkeys((display.name for display in MARGINS), math.nan)
        loops = {
            name: nothing | {n: x for n, x in loop.items() if x is not None}
            for name, loop in margins["loops"].items()
        }
        title = f"Stability margins of {margins['scenario']} at {margins['at_s']:g} s"
        yield _build_table("margins", loops, MARGINS, title)


def list_profile_tables(result: Result) -> Iterator[FigureTable]:
    """Yield the table of where the time went, if it was measured."""
    if profile_rows := list_profile_rows(result, MOST):
        rows = tuple((row.name, row.values, "") for row in profile_rows)
        yield FigureTable("profile", PROFILE_COLUMNS, rows, "Where the time went")


def list_settings(result: Result) -> list[tuple[str, str]]:
    """Return the options in effect."""
    return [(name, format_value(value)) for name, value in result.record.get("settings", {}).items()]


def list_start_values(result: Result) -> list[StartValueRow]:
    """Return the start values that differ from those of the FMUs."""
    return [
        StartValueRow(
            f"{component}.{name}",
            _format_number(entry["value"]),
            str(entry["unit"] or ""),
            _format_number(entry["default"]),
        )
        for component, about in result.record.get("components", {}).items()
        for name, entry in about.get("changed", {}).items()
    ]


def _format_number(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else format_value(value)
