"""Finish the results of `emla run` after an FMU has ended its process.

The parent process completes the results as for an FMU that returns an error: all rows, metrics, run.json,
and an error message with the component, call and time. Metrics are computed from the rows in the table.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...base import crash_page
from ...base.arrays import Vector
from ...base.crash_page import Stage
from ...base.errors import CosimError, join_names
from ...base.interruption import POLITE
from ...base.output_files import UNFINISHED_STATUS
from ...master.instances.measured_calls import decode_call
from ...recorders.file_table import FileTable
from ...recorders.metrics import MetricsRecorder
from ...recorders.recorder import RunLayout, recording
from ...recorders.row_buffer import read_rows, show_rows
from ...run.remarks import describe_lost_values
from ...run.result import Result
from ...run.run_record import COMPLETED
from ...views.output_folder import METRICS, OutputFolder
from ...views.terminal import (
    BarProgress,
    show_error,
    show_interrupted,
    show_result,
    show_warning,
    use_verbosity,
)
from .crash_record import CrashPlan, StartedRun, read_plan


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
        # before `alone`, which removes their file
        rows = None if plan.started_run is None else _read_rows(plan.started_run)
        with output.reserve(), use_verbosity(plan.verbosity):
            message = _save_results(plan, output, cause, ended, rows)
        show_error(message)
    except (CosimError, OSError) as error:
        show_error(f"{cause}; {error}")


def report_late_call(seconds: int, is_requested: bool) -> None:
    """Show which component does not return from a call.

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
    if not _has_all_signals(layout) or layout.every > 1 or first > layout.times.start:
        each = "each step" if layout.every == 1 else f"one of {layout.every} steps"
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
    earlier_rows, steps_per_row = started_run.table_rows - started_run.rows, layout.every
    stored = table.count_stored() - started_run.stored_rows
    next_row = started_run.rows + -started_run.table_rows % steps_per_row + stored * steps_per_row
    if newest is None:
        table.reopen(layout, earlier_rows + next_row)
        table.end()
        return [
            f"Rows after those in {table.path.name} are lost, because they were in the memory of the "
            f"process: the output folder had no file for them ({started_run.why_no_file})."
        ]
    first, rows = newest[0], show_rows(newest[1], started_run.transformations)
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
