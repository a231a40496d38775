"""What came out of a run: signals as arrays, metrics, how it went; and how it is kept."""

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
    """How a run went, and what it gave.

    `result["lift.plant.x_L"]` is a signal as an array, with one value for each of `time`; its unit is
    in `units`. `metrics` has figures by kind, by what they are of, and by name, as in metrics.json;
    `remarks` are sentences to be read before them.
    `signals` has `minimum`, `maximum`, `rms` and `final` value of every recorded signal by its full name,
    in its unit and from every communication point; NaN where a value was NaN.
    `problem` is None, or the sentence that says why the run ended early, or what is not as required;
    `interrupted` says whether somebody wanted it so. `steps`, `simulated_s` and
    `wall_s` are those of this run, which may have continued another one; `end_s` is the time reached.
    `stepping` says how the steps were made, `pacing` how real time was kept, `record` is run.json.
    `comparisons` are signals beside those of the run that the option `reference` names; `parameters` are
    the parameters of all components that are numbers, by full name. `roles` are those of the option.
    `notes` are sentences, without their stops, on the scenario with the values of this run.
    `coupling` has what the exchange of values cost, by bond and by connection, as in metrics.json.
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
        """A signal at the times of `time`, in its unit; CommandError names the choices if there is none."""
        return self.read([name])[name]

    @property
    def time(self) -> Vector:
        """The times of the rows in s."""
        return self["time"]

    @property
    def names(self) -> list[str]:
        """The signals that were kept."""
        return self._table.names[1:]

    @property
    def run_figures(self) -> dict[str, Any]:
        """Figures of the run itself, as in metrics.json: how many steps, and how long they took."""
        return run_figures(self.steps, self.wall_s)

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Some signals, or `time`, by name; of more than `most` rows only every n-th may be given.

        Raises CommandError for a signal that was not kept.
        """
        known = self._table.names
        for name in names:
            if name not in known:
                near = difflib.get_close_matches(str(name), known, n=3, cutoff=0.5)
                meant = f"; did you mean {' or '.join(near)}?" if near else "; `names` has those that are."
                raise CommandError(f"no signal '{name}' was kept{meant}", name=name, near=near)
        return self._table.read(names, most)

    def to_polars(self) -> "polars.DataFrame":
        """All rows as a polars data frame, `time` first."""
        import polars

        return polars.DataFrame(self.read(self._table.names))

    def to_pandas(self) -> "pandas.DataFrame":
        """All rows as a pandas data frame with `time` as its index; CommandError without pandas."""
        try:
            import pandas
        except ImportError as error:
            raise CommandError(
                "a pandas data frame needs pandas: pip install 'emla-cosim[pandas]'."
            ) from error

        return pandas.DataFrame(self.read(self._table.names)).set_index("time")

    def plot(self, *names: str) -> "Figure":
        """Draw signals over time, a panel per unit; a pattern such as `lift.*.x_*` means all that fit."""
        from ..views.plots.overlay import plot_signals

        return plot_signals(self, names)

    def compare(
        self, reference: str | Path, tolerance: Mapping[str, Tolerance | float] | None = None
    ) -> tuple[Comparison, ...]:
        """Hold every signal against that of a run that was saved, in a tube in value and time around it.

        `reference` is a folder of results, or a table; `tolerance` says how wide tubes are, by name or
        pattern, a number relative to the signal's range. Raises CommandError where there is no such run.
        """
        from ..recorders.stored import open_stored_run  # which loads polars

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
        """Write results.csv, metrics.json, run.json and pictures to a folder; returns the pictures.

        `animate` adds an animation, as a GIF, and `report` a page, report.html. Files that emla did not write
        are only replaced with `overwrite`. Raises CommandError where the folder cannot be written, or nothing
        can be animated; RunError where the disk is full.
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
            raise CommandError("the run kept no table; hand in a recorder such as TimeSeries.")
        return self.table


def run_figures(steps: int = 0, wall_s: float = 0.0) -> dict[str, Any]:
    """What metrics.json says of a run with so many steps in this wall time in s."""
    return {"steps": steps, "wall_s": wall_s, "steps_per_s": steps / wall_s if wall_s > 0 else 0.0}
