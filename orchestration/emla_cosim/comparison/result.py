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
    """The result of a comparison of controllers.

    Attributes:
        rows: A row for each scenario, case, joint, controller, set of gains and seed. `seed` is the held-out
            one, or None if nothing is random or the seeds are those of the scenario. `held` says whether the
            joint was held; if not, `lost_at_s` and `why` say when and why. Then follow the figures of
            metrics.json under their names, in the units that these names end with.
        errors: By the number in `rows`: the position error in m over `time` in s, with a column for each
            joint. Only comparisons that draw errors have them.
        table: One of `TABLES`, or None.
        complete: Whether all runs are there.
        wall_s: How long they took, in s.
        notes: The reserves of each controller, and what was left out.
        folder: The output folder, if there is one.
    """

    @property
    def grids(self) -> list[TextTable]:
        """The tables, in the order in which they are shown."""
        return build_tables(self)

    @property
    def lost(self) -> polars.DataFrame:
        """The rows of the joints that were not held."""
        return self.rows.filter(~polars.col("held"))

    def markdown(self) -> str:
        """Return all tables as Markdown, the text of comparison.md."""
        tables = "\n".join(grid.markdown() for grid in self.grids)
        lines = "".join(f"- {line}\n" for line in describe_lost_joints(self))
        lost = f"\nNot held:\n\n{lines}" if lines else ""
        return tables + lost + "".join(f"\n{note}\n" for note in self.notes)

    def figures(self) -> "dict[str, Figure]":
        """Return the pictures by name."""
        return draw_pictures(self)
