"""What came out of a comparison."""

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
    """What came out of a comparison of controllers.

    `rows` has a row for each scenario, case, joint, controller, set of gains and seed: `seed` is the
    held-out one, None where nothing is random or the seeds are the scenario's; `held` is the verdict of
    metrics.json, `lost_at_s` and `why` say when and why a joint was not held; then come the figures of
    metrics.json under their names, with units in these. `errors` has the position errors in m over `time`
    in s of each run, by the number in `rows`, in columns by joint, where they were kept. `table` is one of
    `TABLES`, or None. `complete` says whether all runs are there, `wall_s` how long they took. `notes` say
    what each controller keeps in reserve, and what was left out. `folder` is where everything was written,
    if anywhere.
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
        """All tables as Markdown: what comparison.md holds."""
        tables = "\n".join(grid.markdown() for grid in self.grids)
        lines = "".join(f"- {line}\n" for line in describe_lost_joints(self))
        lost = f"\nNot held:\n\n{lines}" if lines else ""
        return tables + lost + "".join(f"\n{note}\n" for note in self.notes)

    def figures(self) -> "dict[str, Figure]":
        """The pictures by name."""
        return draw_pictures(self)
