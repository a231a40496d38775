"""The result of a comparison."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import polars

from .data import CompareData
from .pictures import draw_pictures
from .tables import build_tables, describe_lost_joints
from .text_table import TextTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class CompareResult(CompareData):
    """Rows and tables of a comparison of controllers.

    Attributes:
        rows: polars data frame with a row for each scenario, case, joint, controller, set of gains and seed.
            `held` is the verdict, `lost_at_s` and `why` say when and why a joint was not held; `observer` and
            `reserves` may differ between controllers, `random` tells whether seeds matter; the metrics have
            units in their names.
        errors: position errors in m over `time` in s, one frame for each run by its number, with a column for
            each joint, if they were kept.
        table: name of the tables, or None.
        complete: whether all runs are done.
        wall_s: wall time in s.
        notes: reserves of each controller, and what was left out.
        folder: output folder; None without one.
    """

    @property
    def grids(self) -> list[TextTable]:
        """Tables in the order in which they are shown."""
        return build_tables(self)

    @property
    def lost(self) -> polars.DataFrame:
        """Rows of the joints that were not held."""
        return self.rows.filter(~polars.col("held"))

    def markdown(self) -> str:
        """Return all tables as Markdown, the content of comparison.md."""
        tables = "\n".join(grid.markdown() for grid in self.grids)
        lines = "".join(f"- {line}\n" for line in describe_lost_joints(self))
        lost = f"\nNot held:\n\n{lines}" if lines else ""
        return tables + lost + "".join(f"\n{note}\n" for note in self.notes)

    def figures(self) -> "dict[str, Figure]":
        """Return the pictures by name, as matplotlib figures."""
        return draw_pictures(self)
