"""Result of a run: signals as arrays, metrics, statistics of the run, and how to save them."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..base.units import SiUnit
from ..base.values import convert_value
from ..master.stepping.timing import CommunicationPoints
from ..recorders.metrics import Figures, Shown
from ..recorders.table import Table
from ..recorders.tubes.signal_comparison import Comparison
from ..recorders.tubes.tolerance import Tolerance
from .agreement import compare_with_stored

if TYPE_CHECKING:
    import pandas
    import polars
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Result:
    """Signals, metrics and statistics of a run.

    `result["lift.plant.x_L"]` is a signal as an array, with a value for each element of `time`.

    Attributes:
        units: Units of the signals, by name.
        metrics: Metrics by kind, subject and name, as in metrics.json.
        remarks: Messages to read before the metrics.
        signals: `minimum`, `maximum`, `rms` and `final` value of every recorded signal, by its full name and
            in its unit, over all communication points; NaN if a value was NaN.
        problem: Message that says why the run ended early or which requirement is not met, or None.
        interrupted: Whether the user interrupted the run.
        steps, simulated_s, wall_s: Extent of this run, without the part before its checkpoint.
        end_s: Simulated time reached.
        stepping: Statistics of the steps.
        pacing: Statistics of real-time pacing.
        record: Content of run.json.
        comparisons: Comparisons with the run that the option `reference` names.
        parameters: Numeric parameters of all components, by full name.
        roles: The option `roles`.
        notes: Remarks on the scenario with the values of this run, without full stops.
        coupling: Errors of the coupling, by bond and by connection, as in metrics.json.
    """

    name: str
    units: Mapping[str, SiUnit | None]
    times: CommunicationPoints
    table: Table | None
    metrics: Mapping[str, Figures]
    shown: Mapping[str, Sequence[Shown]]
    remarks: Sequence[str]
    steps: int
    simulated_s: float
    end_s: float
    wall_s: float
    stepping: Mapping[str, Any]
    pacing: Mapping[str, float] | None
    problem: str | None
    interrupted: bool
    record: Mapping[str, Any]
    comparisons: Sequence[Comparison] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    signals: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    roles: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    coupling: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Vector:
        """Return a signal at the times of `time`, in its unit. Raise CommandError if it does not exist."""
        return self.read([name])[name]

    @property
    def time(self) -> Vector:
        """Times of the rows in s."""
        return self["time"]

    @property
    def names(self) -> list[str]:
        """Names of the recorded signals."""
        return self._table.names[1:]

    @property
    def run_figures(self) -> dict[str, Any]:
        """Statistics of the run as in metrics.json: number of steps and durations."""
        return run_figures(self.steps, self.wall_s)

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Read signals, or `time`, by name.

        Args:
            names: Names of signals.
            most: Largest number of rows. If there are more, every n-th row may be returned.

        Raises:
            CommandError: If a signal was not recorded.
        """
        known = self._table.names
        for name in names:
            if name not in known:
                near = difflib.get_close_matches(str(name), known, n=3, cutoff=0.5)
                meant = f"; did you mean {' or '.join(near)}?" if near else "; `names` lists those that were."
                raise CommandError(f"the signal '{name}' was not recorded{meant}", name=name, near=near)
        return self._table.read(names, most)

    def to_polars(self) -> "polars.DataFrame":
        """Return all rows as a polars data frame; the first column is `time`."""
        import polars

        return polars.DataFrame(self.read(self._table.names))

    def to_pandas(self) -> "pandas.DataFrame":
        """Return all rows as a pandas data frame, indexed by `time`. Raise CommandError without pandas."""
        try:
            import pandas
        except ImportError as error:
            raise CommandError(
                "a pandas data frame needs pandas: pip install 'emla-cosim[pandas]'."
            ) from error

        return pandas.DataFrame(self.read(self._table.names)).set_index("time")

    def plot(self, *names: str) -> "Figure":
        """Plot signals over time, a panel per unit. Patterns such as `lift.*.x_*` select several signals."""
        from ..views.plots.overlay import plot_signals

        return plot_signals(self, names)

    def compare(
        self, reference: str | Path, tolerance: Mapping[str, Tolerance | float] | None = None
    ) -> tuple[Comparison, ...]:
        """Compare every signal with that of a saved run, in a tube in value and time around it.

        Args:
            reference: Output folder of a run, or a table.
            tolerance: Width of the tubes relative to a signal's range, by name or pattern.

        Raises:
            CommandError: If there is no such run.
        """
        from ..recorders.stored import open_stored_run  # importing it loads polars

        given = convert_value(tolerance or {}, Mapping[str, Tolerance], "the tolerance")
        stored = open_stored_run(convert_value(reference, Path, "the reference"))
        return compare_with_stored(self.names, self.read, self.units, stored, given)

    def save(
        self,
        folder: str | Path,
        plots: bool = True,
        animate: bool = False,
        report: bool = False,
        overwrite: bool = False,
    ) -> list[Path]:
        """Write results.csv, metrics.json, run.json and plots to a folder.

        Args:
            folder: Output folder.
            plots: Whether to write plots.
            animate: Whether to write an animation (GIF).
            report: Whether to write a page, report.html.
            overwrite: Whether to replace files that emla did not write.

        Returns:
            The plot files.

        Raises:
            CommandError: If the folder cannot be written, or the run cannot be animated.
            RunError: If the disk is full.
        """
        from ..views.animation import check_animated
        from ..views.output_folder import OutputFolder

        if animate:
            check_animated(self.name, self.names, self.names)
        output = OutputFolder(
            convert_value(folder, Path, "the folder"),
            self.record["settings"]["output_format"],
            plots=plots,
            animated=animate,
            report=report,
            overwrite=overwrite,
        )
        with output.alone():
            output.write_table(self)
            return output.save(self, plots, animated=animate, report=report)

    @property
    def _table(self) -> Table:
        if self.table is None:
            raise CommandError("the run has no table; use a recorder such as TimeSeries.")
        return self.table


def run_figures(steps: int = 0, wall_s: float = 0.0) -> dict[str, Any]:
    """Return the statistics of a run for metrics.json, from its steps and its wall time in s."""
    return {"steps": steps, "wall_s": wall_s, "steps_per_s": steps / wall_s if wall_s > 0 else 0.0}
