"""Finish the results of `emla run` after an FMU has ended its process, from what it wrote.

The parent process completes the results as for an FMU that returns an error: all rows, metrics, run.json,
and an error message with the component, call and time. Metrics are computed from the rows in the table.
"""

import contextlib
import os
import pickle
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base import crash_page
from ...base.arrays import Vector
from ...base.crash_page import Stage
from ...base.errors import CosimError, join_names
from ...base.interruption import POLITE
from ...base.output_files import UNFINISHED_STATUS
from ...base.units import LinearTransformation
from ...master.instances.measured_calls import decode_call
from ...recorders.file_table import FileTable
from ...recorders.metrics import MetricsRecorder
from ...recorders.recorder import Pause, Recorder, RunLayout, recording
from ...recorders.row_buffer import RowFile, convert_rows, read_rows
from ...recorders.table import Table
from ...run.remarks import describe_lost_values
from ...run.result import Result
from ...run.run_record import COMPLETED
from ...run.scenarios.scenario import Scenario
from ...run.simulation import Simulation
from ...views.output_folder import METRICS, OutputFolder
from ...views.terminal import (
    BarProgress,
    Verbosity,
    get_verbosity,
    show_error,
    show_interrupted,
    show_result,
    show_warning,
    use_verbosity,
)


@dataclass(frozen=True)
class StartedRun:
    """A run before its first step.

    Attributes:
        result: The result so far.
        layout: What recorders know.
        transformations: Transformations of signals that recorders get in another unit, by position.
        row_file: The file of the newest rows; None if they are in the memory of the process.
        why_no_file: Why there is no file.
        rows: Number of rows so far.
        table_rows: Number of rows that the table received, with those of a run that this one continues.
        stored_rows: Number of rows in the table.
        at: Clock in s that is the same in all processes.
    """

    result: Result
    layout: RunLayout
    transformations: Mapping[int, LinearTransformation]
    row_file: Path | None
    why_no_file: str
    rows: int
    table_rows: int
    stored_rows: int
    at: float


@dataclass(frozen=True)
class CrashPlan:
    """Scenario and output folder of a run, and the run itself when its first step begins.

    Attributes:
        name: Name of the scenario.
        components: Names of its components.
        folder: The output folder.
        output: Other arguments of `OutputFolder`.
        notes: Remarks on the scenario.
        verbosity: What the command shows.
        started_run: The run; None before its first step.
    """

    name: str
    components: Sequence[str]
    folder: Path
    output: Mapping[str, Any]
    notes: Sequence[str]
    verbosity: Verbosity
    started_run: StartedRun | None = None


def read_plan() -> CrashPlan | None:
    """Return the plan that an ended process left, or None. Raises any error if it is not readable."""
    path = crash_page.read_note()
    return pickle.loads(Path(path).read_bytes()) if path else None


class CrashRecorder(Recorder):
    """Keep the newest rows in a file, and write the plan to another. It is the run's last recorder.

    It does nothing without a supervising process.
    """

    def __init__(self, scenario: Scenario, folder: Path, output: Mapping[str, Any]) -> None:
        """Write that a run of the scenario begins, with the arguments of its `OutputFolder`."""
        names = [c.name for c in scenario.system.components]
        self._plan = CrashPlan(scenario.name, names, folder, output, scenario.notes, get_verbosity())
        self._folder = folder.resolve()  # an FMU may change the working folder
        self._rows: RowFile | None = None
        self._why_no_file = ""
        self._is_needed = crash_page.is_shared()
        self._write_plan()

    def __str__(self) -> str:
        return "the record of the run"

    def set_run(self, simulation: Simulation, table: Recorder) -> None:
        """Set the simulation whose run is recorded, and its table."""
        self._simulation, self._table = simulation, table

    def map_rows(self, size: int) -> Any:
        """Return the memory of a file in the output folder; None if there cannot be one."""
        if self._is_needed:
            try:
                self._rows = RowFile(self._folder, size)
            except OSError as error:
                self._why_no_file = error.strerror or str(error)
        return None if self._rows is None else self._rows.memory

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Keep the layout of the run."""
        self._layout = layout

    def pause(self, run: Pause) -> None:
        """Write the plan before the first step."""
        if not self._is_needed or self._plan.started_run is not None:
            return
        if isinstance(self._table, FileTable):  # a registered format can only be written by its own process
            started_run = StartedRun(
                replace(self._simulation.so_far(), table=None),
                self._layout,
                run.transformations,
                None if self._rows is None else self._rows.path,
                self._why_no_file,
                crash_page.current_activity().rows,
                run.state_dict()[Table.key]["rows"],
                self._table.count_stored(),
                time.monotonic(),
            )
            self._plan = replace(self._plan, started_run=started_run)
            self._write_plan()
        crash_page.current_activity().stage = Stage.STEPPING

    def end(self) -> None:
        """Note that all rows are recorded, and remove their file."""
        crash_page.current_activity().stage = Stage.ROWS_WRITTEN
        self.close()

    def note_files_written(self) -> None:
        """Note on the crash page that all files of the run are written."""
        crash_page.current_activity().stage = Stage.FILES_WRITTEN

    def close(self) -> None:
        """Remove the file of rows. Errors are ignored."""
        if self._rows is not None:
            with contextlib.suppress(OSError):
                self._rows.remove()
            self._rows = None

    def _write_plan(self) -> None:
        """Write the plan, and its path on the crash page. May raise OSError."""
        if self._is_needed:
            descriptor, name = tempfile.mkstemp(prefix="emla-plan-")
            with os.fdopen(descriptor, "wb") as stream:
                pickle.dump(self._plan, stream)
            crash_page.write_note(name)


def rescue_results(how: str, ended: float) -> None:
    """Finish the results of a run whose process ended at a time in s, and show the error message.

    Args:
        how: Name of the signal or exit code that ended the process.
        ended: Time of the end in s.
    """
    try:
        plan = read_plan()
        cause = _explain_end(how, _list_calls(plan))
    except Exception:  # an FMU overwrote memory
        show_error(f"the process of the run ended ({how}), and the data it left are not readable.")
        return
    if plan is None:
        if how in {number.name for number in POLITE}:  # it ended before its own handler was set
            show_interrupted()
        else:
            show_error(f"the process of the run ended ({how}) before it began.")
        return
    try:
        output = OutputFolder(plan.folder, **plan.output)
        # before `reserve`, which removes their file
        rows = None if plan.started_run is None else _read_rows(plan.started_run)
        with output.reserve(), use_verbosity(plan.verbosity):
            message = _save_results(plan, output, cause, ended, rows)
        show_error(message)
    except (CosimError, OSError) as error:
        show_error(f"{cause}; {error}")


def report_late_call(seconds: int, is_requested: bool) -> None:
    """Show which component does not return from a call; a quiet command only says so once it is to end.

    Args:
        seconds: Time since the call began.
        is_requested: Whether the run was asked to end.
    """
    plan = read_plan()
    calls = _list_calls(plan)
    if plan is None or not calls or (plan.verbosity.quiet and not is_requested):
        return
    ends = "Press Ctrl-C again to end the run now"
    if not is_requested:
        ends = "The run waits. Press Ctrl-C twice to end it"
    show_warning(f"no answer from {_join_calls(calls)} for {seconds} s. {ends}; the results so far are kept.")


def _list_calls(plan: CrashPlan | None) -> list[tuple[str, str]]:
    """Return the components that are called, each with its call."""
    calls = [decode_call(activity) for activity in crash_page.list_busy_activities()]
    return [(plan.components[i], call) for i, call in calls if plan is not None and i is not None]


def _join_calls(calls: Sequence[tuple[str, str]]) -> str:
    return join_names([f"{component} in {call}" for component, call in calls])


def _explain_end(how: str, calls: Sequence[tuple[str, str]]) -> str:
    """Return why the process ended, from the calls of components that were in progress.

    With several threads the component that ended it is not known.
    """
    if how == "SIGKILL":  # no process sends it to itself
        where = f"with {_join_calls(calls)}" if calls else "possibly out of memory"
        return f"the process was killed, {where}"
    if len(calls) > 1:
        return f"one of {_join_calls(calls)} ended the process ({how})"
    for component, call in calls:
        return f"{component} ended the process in {call} ({how})"
    return f"the process ended ({how})"


def _read_rows(started_run: StartedRun) -> tuple[int, Vector] | None:
    """Return the number of rows before the newest ones, and these; None if they are not in a file."""
    activity = crash_page.current_activity()
    if started_run.row_file is None or activity.stage >= Stage.ROWS_WRITTEN:
        return None
    return read_rows(started_run.row_file, 1 + len(started_run.layout.names), activity.rows)


def _save_results(
    plan: CrashPlan, output: OutputFolder, cause: str, ended: float, newest: tuple[int, Vector] | None
) -> str:
    """Write the results that can be written, and return the error message."""
    so_far = f"The results so far are in {output.path}."
    earlier = output.status()
    if crash_page.current_activity().stage == Stage.FILES_WRITTEN and earlier != UNFINISHED_STATUS:
        complete_message = f"{cause}, when the results were complete."
        problem = complete_message if earlier in ("", COMPLETED) else f"{earlier} Then {complete_message}"
        output.change_record(status=problem)
        return f"{problem} {so_far}"
    if plan.started_run is None:
        is_stepping = crash_page.current_activity().stage == Stage.STEPPING
        problem = f"the run ended{'' if is_stepping else ' before its first step'}: {cause}."
        if (output.path / METRICS).exists():  # the run had not begun its folder
            return f"{problem} The earlier results in {output.path} stay."
        output.change_record(scenario=plan.name, status=problem)
        return f"{problem} {so_far}"
    result = _finish_result(plan.started_run, output, cause, ended, newest)
    plots, animated, report = (plan.output[name] for name in ("plots", "animated", "report"))
    with BarProgress() as progress:
        result, pictures = output.keep(result, plots, progress, animated, report, plan.notes)
    show_result(result, plan.notes, output, pictures)
    return f"{result.problem} {so_far}"


def _finish_result(
    started_run: StartedRun, output: OutputFolder, cause: str, ended: float, newest: tuple[int, Vector] | None
) -> Result:
    """Complete the table, and return the result with the metrics of its rows."""
    table, layout, before = output.table(), started_run.layout, started_run.result
    assert isinstance(table, FileTable)
    metrics, remarks, first, end = MetricsRecorder(), list[str](), np.nan, before.end_s
    with recording(table):
        if crash_page.current_activity().stage < Stage.ROWS_WRITTEN:
            remarks += _append_rows(started_run, table, newest)
        table.open()
        metrics.begin(_reduce_to_table(layout))
        if not _has_all_signals(layout):
            metrics.kinds.clear()
        for rows in table.blocks():
            first, end = rows[0, 0] if np.isnan(first) else first, float(rows[-1, 0])
            metrics.write(rows)
    problem = f"the run ended at t = {end:.6g} s: {cause}."
    metrics.ended_early(problem)
    if not _has_all_signals(layout) or layout.steps_per_row > 1 or first > layout.times.start:
        each = "each step" if layout.steps_per_row == 1 else f"one of {layout.steps_per_row} steps"
        unrecorded = "" if _has_all_signals(layout) else ", with those of its signals alone"
        remarks.append(
            f"The metrics were computed from the rows in {table.path.name}: {each} from "
            f"t = {first:.6g} s on{unrecorded}."
        )
    remarks = [*describe_lost_values(before.record), *metrics.remarks(), *remarks]
    return replace(
        before,
        table=table,
        metrics=metrics.figures(),
        signals=metrics.signals(),
        coupling={},  # its errors need the FMUs
        remarks=remarks,
        steps=crash_page.current_activity().rows - started_run.rows,
        simulated_s=end - before.end_s,
        end_s=end,
        wall_s=ended - started_run.at,
        problem=problem,
        record={**before.record, "status": problem, "remarks": remarks},
    )


def _append_rows(started_run: StartedRun, table: FileTable, newest: tuple[int, Vector] | None) -> list[str]:
    """Append the rows that the table has not stored yet. Return remarks on rows that are lost."""
    layout, count = started_run.layout, crash_page.current_activity().rows
    # a run that continues an earlier one counts its rows from its own start
    earlier_rows, steps_per_row = started_run.table_rows - started_run.rows, layout.steps_per_row
    stored = table.count_stored() - started_run.stored_rows
    next_row = started_run.rows + -started_run.table_rows % steps_per_row + stored * steps_per_row
    if newest is None:
        table.reopen(layout, earlier_rows + next_row)
        table.end()
        return [
            f"Rows after those in {table.path.name} are lost, because they were in the memory of the "
            f"process: the output folder had no file for them ({started_run.why_no_file})."
        ]
    first, rows = newest[0], convert_rows(newest[1], started_run.transformations)
    rows[:, layout.text_columns] = np.nan  # rows with texts are in the table
    if count - 1 < next_row < count - 1 + steps_per_row:
        next_row = count - 1  # only the last row may be missing, which was not due
    table.reopen(layout, earlier_rows + max(next_row, first))
    if len(rows := rows[max(next_row - first, 0) :]):
        table.write(rows)
    table.end()
    return []


def _has_all_signals(layout: RunLayout) -> bool:
    """Return whether the table has all signals of the run."""
    return list(layout.recorded) == list(range(len(layout.names)))


def _reduce_to_table(layout: RunLayout) -> RunLayout:
    """Return the layout of the rows in the table."""
    if not _has_all_signals(layout):
        names, units = ([values[i] for i in layout.recorded] for values in (layout.names, layout.units))
        recorded = range(len(names))
        layout = replace(layout, names=names, units=units, recorded=recorded, roles={}, criteria={})
    return layout
