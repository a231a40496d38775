"""Result of a run: signals as arrays, metrics, statistics of the run, and how to save them."""

import difflib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base.arrays import REAL, SignalType, Vector
from ..base.errors import CommandError, check_choice
from ..base.extras import LEFT_OUT, has_extra, require_extra
from ..base.tolerances import Comparison, Tolerance, compare_signal, find_tolerance
from ..base.units import SiUnit
from ..base.values import convert_value
from ..base.wording import find_name
from ..master.stepping.timing import CommunicationPoints
from ..recorders.metrics import Figures, MetricDisplay
from ..recorders.table import Table
from ..system.model import find_main_component
from .agreement import align_values, find_common_signals
from .output_options import PLOT_FORMATS

if TYPE_CHECKING:
    import pandas
    import polars
    from matplotlib.figure import Figure

    from ..inputs.stored_runs import StoredRun


@dataclass(frozen=True, repr=False)
class Result:
    """Signals, metrics and record of a run.

    `result["lift.plant.x_L"]` is a signal as an array, with one value for each of `result.time`.

    Attributes:
        name: name of the scenario.
        units: unit of each signal by name.
        times: start, stop and communication points, in s.
        table: recorder that kept the rows; None if no recorder keeps a table.
        metrics: metrics by kind, by object (such as the joint) and by name, as in metrics.json.
        displays: labels and units of the metrics that tables show.
        remarks: warnings to read before the metrics.
        steps: number of communication steps of this run.
        simulated_s: simulated time of this run, in s.
        end_s: time that was reached, in s.
        wall_s: wall time of this run, in s.
        stepping: how the steps were made, as in run.json.
        pacing: how real time was kept; None without `real_time`.
        problem: error message if the run ended early or misses a requirement, otherwise None.
        interrupted: whether Ctrl-C or a signal ended the run.
        stopped_when: condition of `stop_when` that ended the run; None if it did not.
        discrete: names of the signals that hold their values between rows.
        early_end: message on the condition or the FMU that ended the run before its stop time; None if
            neither did.
        record: content of run.json.
        comparisons: signals with those of the run that the option `reference` names.
        parameters: parameters of all components, by full name; Booleans are 0 or 1, Strings are left out.
        signals: `minimum`, `maximum`, `rms` and `final` of each recorded signal, from all communication
            points, in its unit; NaN where a value was NaN.
        roles: value of the option `roles`.
        notes: notes on the scenario with the values of this run, without full stops.
        coupling: error of the coupling by bond and by connection, as in metrics.json.
        profile: time and calls of each FMU, the master and the recorders; None without the option `profile`.
        types: types of the signals that are no Reals, with the names of enumerations, by name.

    Examples:
        >>> import emla_cosim as ec
        >>> result = ec.load("lift", stop_time=0.01).prepare().run()
        >>> result.time[-1], str(result.units["lift.plant.x_L"])
        (np.float64(0.01), 'm')
    """

    name: str
    units: Mapping[str, SiUnit | None]
    times: CommunicationPoints
    table: Table | None
    metrics: Mapping[str, Figures]
    displays: Mapping[str, Sequence[MetricDisplay]]
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
    types: Mapping[str, SignalType] = field(default_factory=dict)
    stopped_when: str | None = None
    early_end: str | None = None
    discrete: frozenset[str] = frozenset()
    profile: Mapping[str, Any] | None = None

    def __repr__(self) -> str:
        """Return one line: scenario, time, steps and number of signals."""
        content = "no table" if self.table is None else f"{len(self.names)} signals"
        return f"<Result of {self.name}: until {self.end_s:g} s, {self.steps} steps, {content}>"

    def __str__(self) -> str:
        """Return the tables of metrics that `emla run` prints."""
        from ..views.terminal import format_result

        return format_result(self)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: verdict, metrics, what is idealised, and a picture."""
        from ..views.notebook_cells import render_cell

        return render_cell(self)

    def __getitem__(self, name: str) -> Vector:
        """Return a signal as an array of shape (rows,), in its unit.

        Reals are float64, Integers and Enumerations int32, Booleans bool, and Strings objects.

        Raises:
            CommandError: the signal was not kept.
        """
        return self.read([name])[name]

    @property
    def time(self) -> Vector:
        """Times of the rows in s, shape (rows,)."""
        return self["time"]

    @property
    def names(self) -> list[str]:
        """Names of the signals that were kept."""
        return self._table.names[1:]

    @property
    def run_figures(self) -> dict[str, Any]:
        """Number of steps, wall time in s and steps per second, as in metrics.json."""
        return run_figures(self.steps, self.wall_s)

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Return several signals.

        Args:
            names: names of signals, or `time`. With one FMU, the names of its variables are enough.
            most: of a table with more rows, return only every n-th row. Default: all rows.

        Returns:
            An array of shape (rows,) by name.

        Raises:
            CommandError: a signal was not kept.
        """
        stored_names, main = self._table.names, find_main_component(self.record)
        full_names = {name: find_name(name, stored_names, main) or name for name in names}
        for name, full in full_names.items():
            if full not in stored_names:
                near = difflib.get_close_matches(str(name), stored_names, n=3, cutoff=0.5)
                advice = (
                    f"; did you mean {' or '.join(near)}?" if near else "; `names` lists those that were."
                )
                raise CommandError(f"the signal '{name}' was not recorded{advice}", name=name, near=near)
        # two names can mean one signal
        table = self._table.read(list(dict.fromkeys(full_names.values())), most)
        return {n: self.types.get(full, REAL).convert(table[full]) for n, full in full_names.items()}

    def to_polars(self) -> "polars.DataFrame":
        """Return all rows as a polars data frame, with `time` as its first column."""
        import polars

        return polars.DataFrame(self.read(self._table.names))

    def to_pandas(self) -> "pandas.DataFrame":
        """Return all rows as a pandas data frame, with `time` as its index.

        Raises:
            CommandError: pandas is not installed.
        """
        require_extra("pandas", "a pandas data frame")
        import pandas

        return pandas.DataFrame(self.read(self._table.names)).set_index("time")

    def plot(self, *names: str, title: str | None = None, layout: str = "screen") -> "Figure":
        """Draw signals over time, with one panel for each unit.

        Args:
            *names: names of signals, or patterns such as `lift.*.x_*`.
            title: title of the figure. Default: the name of the scenario on a screen, none on paper.
            layout: `screen`, or `one-column` and `two-columns` for the columns of a paper: 88 mm and 181 mm
                wide, with letters of 8 points.

        Returns:
            A matplotlib figure.

        Raises:
            CommandError: no signal has one of the names, or the layout does not exist.
        """
        from ..views.plots.overlay import plot_signals

        return plot_signals(self, names, title, layout)

    def compare(
        self, reference: "str | Path | StoredRun", tolerance: Mapping[str, Tolerance | float] | None = None
    ) -> tuple[Comparison, ...]:
        """Compare each signal with that of a saved run, in a tube around the saved one.

        Args:
            reference: folder of results, or a table of results.
            tolerance: width of the tubes by name or pattern of signals. A number is relative to the range of
                the signal. Default: 1e-3.

        Returns:
            One comparison for each signal that both runs have.

        Raises:
            CommandError: there is no saved run, or a tolerance is wrong.

        Examples:
            >>> import emla_cosim as ec
            >>> result = ec.load("lift", stop_time=0.01).prepare().run()
            >>> pictures = result.save("kept", plots=False)
            >>> all(one.left_at is None for one in result.compare("kept"))
            True
        """
        from ..inputs.stored_runs import StoredRun, open_stored_run  # importing it loads polars

        tolerances = convert_value(tolerance or {}, Mapping[str, Tolerance], "the tolerance")
        stored = reference
        if not isinstance(stored, StoredRun):
            stored = open_stored_run(convert_value(reference, Path, "the reference"))
        names = find_common_signals(self.names, stored)
        table = self.read(["time", *names])
        expected = stored.read(["time", *names], units=self.units, types=self.types)
        for columns, where in ((table, "the result"), (expected, f"the reference run '{stored.path}'")):
            if not len(columns["time"]):
                raise CommandError(f"{where} has no rows.")
        return tuple(
            compare_signal(
                name,
                str(self.units.get(name) or ""),
                table["time"],
                *align_values(table["time"], table[name], expected["time"], expected[name]),
                find_tolerance(name, tolerances),
                name in self.discrete,
            )
            for name in names
        )

    def save(
        self,
        folder: str | Path,
        plots: bool = True,
        animate: bool = False,
        report: bool = False,
        overwrite: bool = False,
        plot_format: str = "png",
    ) -> list[Path]:
        """Write the table, metrics.json, run.json and pictures to a folder.

        Args:
            folder: output folder; it is created if needed.
            plots: draw pictures.
            animate: add an animation of the manipulator, a GIF.
            report: add a page, report.html.
            overwrite: replace files that emla did not write.
            plot_format: file format of the pictures: png, pdf or svg.

        Returns:
            Paths of the pictures.

        Raises:
            CommandError: the folder cannot be written, or there is nothing to animate.
            RunError: the disk is full.
        """
        from ..views.animation import check_animated
        from ..views.output_folder import OutputFolder

        check_choice("plot format", plot_format, PLOT_FORMATS)
        if animate:
            check_animated(self.name, self.names, self.names, self.roles)
        if plots and not has_extra("plots"):
            plots = False
            warnings.warn(LEFT_OUT, stacklevel=2)
        output = OutputFolder(
            convert_value(folder, Path, "the folder"),
            self.record["settings"]["output_format"],
            plots=plots,
            plot_format=plot_format,
            animated=animate,
            report=report,
            overwrite=overwrite,
        )
        with output.reserve():
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
