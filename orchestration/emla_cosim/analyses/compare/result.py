"""The result of a comparison: a row for each scenario, case, joint, controller, set of gains and seed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars

from ...recorders.metrics import HELD, MetricDisplay
from ...study.loads import LoadFigures, LoadMetrics
from ...study.metrics import CONVERGENCE_TIME, SHOWN_WITH_LOAD, JointFigures, JointMetrics
from ..frame.report import ReportedResult, ReportTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .plan import ComparisonPlan

PAPER, ROBUSTNESS, STABILITY, MARGINS = "paper", "robustness", "stability", "margins"
TABLES = (PAPER, ROBUSTNESS, STABILITY, MARGINS)
"""Comparisons with tables of their own."""

FIGURES = tuple(f.name for f in fields(JointFigures) if f.type is float)
"""Columns with figures of a joint, by their names in metrics.json."""

LOAD_FIGURES = tuple(f.name for f in fields(LoadFigures) if f.type is float)
"""Columns with figures of a joint's load, which exist if a load is not rigid."""

LOST_AT, WHY, SEED = "lost_at_s", "why", "seed"
"""Columns that say when and why a joint was not held (`HELD`), and the held-out seed."""

RANDOM, OBSERVER, RESERVES = "random", "observer", "reserves"
"""Columns that say whether random sequences affect the run, and what may differ between controllers."""

LABELS = ("scenario", "case", "joint", "controller", "gains")
"""Columns that tell the rows of runs apart, except for seeds."""

COLUMNS: Mapping[str, Any] = {
    "run": polars.Int64,
    **dict.fromkeys(LABELS, polars.String),
    OBSERVER: polars.String,
    RESERVES: polars.String,
    SEED: polars.Int64,
    RANDOM: polars.Boolean,
    HELD: polars.Boolean,
    LOST_AT: polars.Float64,
    WHY: polars.String,
    **dict.fromkeys(FIGURES, polars.Float64),
    "x": polars.Float64,
    "y": polars.Float64,
}

DISPLAYS: dict[str, MetricDisplay] = {
    display.name: display for display in (*LoadMetrics.displays, *JointMetrics.displays, CONVERGENCE_TIME)
}
"""How tables and pictures show a figure."""

Row = Mapping[str, Any]


@dataclass(frozen=True, repr=False)
class CompareResult(ReportedResult):
    """Rows and tables of a comparison of controllers.

    Attributes:
        name: name of the scenario.
        table: name of the tables, or None.
        rows: polars data frame with a row for each scenario, case, joint, controller, set of gains and seed.
            `held` is the verdict, `lost_at_s` and `why` say when and why a joint was not held; `observer` and
            `reserves` may differ between controllers, `random` tells whether seeds matter; the metrics have
            units in their names.
        entrants: the controllers with their gains, as CONTROLLER/SET.
        errors: position errors in m over `time` in s, one frame for each run by its number, with a column for
            each joint, if they were kept.
        motions: `reference` in m and `load` in N over `time` in s, by scenario and joint, if errors were
            kept.
        notes: reserves of each controller, and what was left out.
        complete: whether all runs are done.
        wall_s: wall time in s.
        folder: output folder; None without one.
        plan: all runs, also those that an interrupt prevented.
    """

    name: str
    table: str | None
    rows: polars.DataFrame
    entrants: Sequence[str]
    errors: Mapping[int, polars.DataFrame] = field(default_factory=dict)
    motions: Mapping[tuple[str, str], polars.DataFrame] = field(default_factory=dict)
    notes: Sequence[str] = ()
    complete: bool = True
    wall_s: float = 0.0
    folder: Path | None = None
    plan: "ComparisonPlan | None" = field(default=None, compare=False)

    def group(self, *by: str) -> dict[tuple[Any, ...], list[Row]]:
        """Return the rows, grouped by the values of these columns."""
        return group_rows(self.rows.rows(named=True), *by)

    @property
    def grids(self) -> list[ReportTable]:
        """Tables in the order in which they are shown."""
        from .report import build_tables  # it needs this class

        return build_tables(self)

    @property
    def failed_rows(self) -> polars.DataFrame:
        """Rows of the joints that were not held."""
        return self.rows.filter(~polars.col(HELD))

    def markdown(self) -> str:
        """Return all tables as Markdown, the content of comparison.md."""
        from .report import describe_lost_joints

        tables = "\n".join(grid.markdown() for grid in self.grids)
        lines = "".join(f"- {line}\n" for line in describe_lost_joints(self))
        failures = f"\nNot held:\n\n{lines}" if lines else ""
        return tables + failures + "".join(f"\n{note}\n" for note in self.notes)

    def figures(self) -> "dict[str, Figure]":
        """Return the pictures by name, as matplotlib figures."""
        from .pictures import draw_pictures

        return draw_pictures(self)


def choose_displays(rows: Sequence[Row]) -> Mapping[str, MetricDisplay]:
    """Return how to show figures: those of screws are called so beside loads that are not rigid."""
    return DISPLAYS | {display.name: display for display in SHOWN_WITH_LOAD if _has_load(rows)}


def choose_position_error(rows: Sequence[Row]) -> MetricDisplay:
    """Return the position error that counts: of the load if it is not rigid, else of the screw."""
    return DISPLAYS["load_position_error_m" if _has_load(rows) else "position_error_m"]


def _has_load(rows: Sequence[Row]) -> bool:
    return any(row.get("load_position_error_m") is not None for row in rows)


def label_variant(row: Row) -> str:
    """Return the controller of a row with its gains."""
    return f"{row['controller']}/{row['gains']}"


def group_rows(rows: Sequence[Row], *by: str) -> dict[tuple[Any, ...], list[Row]]:
    """Return rows grouped by the values of these columns, in their order."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in by), []).append(row)
    return groups
