"""Finish the results of `emla run` after an FMU has ended its process.

The run writes its state to files. The parent process completes the results from them as for an FMU that
returns an error: all rows, all metrics, run.json, and an error message with the component, call and time.
"""

import contextlib
import os
import pickle
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...base.errors import CosimError, join_names
from ...base.progress import Progress
from ...base.units import LinearTransformation
from ...master.instances.call_codes import decode_call
from ...recorders.metrics import MetricsRecorder
from ...recorders.recorder import Outline, Pause, Recorder, RowBuffer, recording
from ...recorders.table import Table
from ...run.lost_values import describe_lost_values
from ...run.result import Result
from ...run.run_record import COMPLETED
from ...run.scenarios.scenario import Scenario
from ...run.simulation import Simulation
from ...sandbox import black_box
from ...sandbox.interruption import POLITE
from ...views.output_folder import OutputFolder
from ...views.progress_bars import BarProgress
from ...views.terminal import (
    Verbosity,
    get_verbosity,
    show_error,
    show_interrupted,
    show_result,
    show_warning,
    use_verbosity,
)

_SELDOM = 1.0
"""Wall time in s between two copies of the recorders' memory if a copy is slow."""


@dataclass(frozen=True)
class _StartedRun:
    """State of a run when its first step begins."""

    result: Result
    outline: Outline
    shown: Mapping[int, LinearTransformation]
    rows: int
    at: float
    """Clock in s that is the same in all processes."""


@dataclass(frozen=True)
class _RunState:
    """State of a run: scenario, output folder and progress."""

    name: str
    components: Sequence[str]
    folder: Path
    form: str
    plots: bool
    plot_format: str
    animate: bool
    report: bool
    notes: Sequence[str]
    overwrite: bool
    process: int
    wanted: Verbosity
    stepping: bool = False
    """Whether the first step began. `begun` is then None if it was too large to write."""
    begun: _StartedRun | None = None
    rows_written: bool = False
    files_written: bool = False


class CrashRecorder(Recorder):
    """Write what another process needs to finish the results of a run. It is the run's last recorder."""

    def __init__(self, scenario: Scenario, output: OutputFolder) -> None:
        """Write that a run of the scenario begins, with its output folder."""
        names = [c.name for c in scenario.system.components]
        self._told = _RunState(
            scenario.name,
            names,
            output.path,
            output.form,
            scenario.options.plots,
            output.plot_format,
            scenario.options.animate,
            scenario.options.report,
            scenario.notes,
            output.overwrite,
            os.getpid(),
            get_verbosity(),
        )
        self._quick = output.table().quick_memory
        self._run: Pause | None = None
        self._memory: Mapping[str, Any] = {}
        self._looked, self._at = time.monotonic(), 0.0
        self._write_state()

    def __str__(self) -> str:
        return "the record of the run"

    def watch(self, simulation: Simulation) -> None:
        """Set the simulation whose run is recorded."""
        self._simulation = simulation

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Keep the outline of the run."""
        self._outline = outline

    def pause(self, run: Pause) -> None:
        """Write the state of the run before its first step."""
        if self._run is not None:
            return
        self._run = run
        self._look()
        result = replace(self._simulation.so_far(), table=None)
        rows = self._memory[Table.key]["rows"]
        begun = _StartedRun(result, self._outline, run.shown, rows, time.monotonic())
        if not self._write_state(stepping=True, begun=begun):
            self._write_state(begun=None)

    def write(self, rows: Any) -> None:
        """Note that the other recorders have received these rows."""
        if self._run is None:
            return
        if self._quick or time.monotonic() - self._looked >= _SELDOM:
            self._look()
        else:
            self._write_memory(follows=False)

    def end(self) -> None:
        """Note that all rows are recorded."""
        self._write_state(rows_written=True)

    def keep(self) -> None:
        """Note that all files are written."""
        self._write_state(files_written=True)

    def _look(self) -> None:
        assert self._run is not None
        self._looked = time.monotonic()
        self._memory = self._run.memory(now=True)
        self._at = self._run.stepping.time
        self._write_memory(follows=True)

    def _write_memory(self, follows: bool) -> None:
        """Write the memory of the recorders, the time, and whether the rows in the buffer come next."""
        black_box.write_message(pickle.dumps((self._memory, follows, self._at)), black_box.MEMORY)

    def _write_state(self, **changed: Any) -> bool:
        """Write what has changed, and return whether there was room for it."""
        self._told = replace(self._told, **changed)
        return black_box.write_message(pickle.dumps(self._told))


def rescue_results(how: str, ended: float) -> None:
    """Finish the results of a run whose process ended at a time in s, and show the error message.

    Args:
        how: Name of the signal or exit code that ended the process.
        ended: Time of the end in s.
    """
    message = black_box.read_message()
    if not message:
        if how in {number.name for number in POLITE}:  # it ended before its own handler was set
            show_interrupted()
            return
        show_error(f"the process of the run ended ({how}) before it began.")
        return
    try:
        told: _RunState = pickle.loads(message)
        busy = [decode_call(present) for present in black_box.list_busy_activities()]
        cause = _cause(how, [(told.components[s], call) for s, call in busy if s is not None])
    except Exception:  # an FMU overwrote memory
        show_error(f"the process of the run ended ({how}), and the data it left are not readable.")
        return
    try:
        output = OutputFolder(
            told.folder,
            told.form,
            plots=told.plots,
            plot_format=told.plot_format,
            animated=told.animate,
            report=told.report,
            overwrite=told.overwrite,
        )
        with output.alone(heir_of=told.process), use_verbosity(told.wanted):
            problem = _save_results(told, output, cause, ended)
        show_error(f"{problem} The results so far are in {output.path}.")
    except (CosimError, OSError) as error:
        show_error(f"{cause}; {error}")


def report_late_call(seconds: int, asked: bool) -> None:
    """Show which component does not return from a call.

    Args:
        seconds: Time since the call began.
        asked: Whether the run was asked to end.
    """
    state: _RunState = pickle.loads(black_box.read_message())
    busy = [decode_call(present) for present in black_box.list_busy_activities()]
    calls = [f"{state.components[i]} in {call}" for i, call in busy if i is not None]
    if not calls or (state.wanted.quiet and not asked):
        return
    what = f"no answer from {join_names(calls)} for {seconds} s."
    ends = "Press Ctrl-C again to end the run now" if asked else "The run waits. Press Ctrl-C twice to end it"
    show_warning(f"{what} {ends}; the results so far are kept.")


def _cause(how: str, calls: Sequence[tuple[str, str]]) -> str:
    """Return why the process ended, from the calls of components that were in progress.

    With several threads the component that ended it is not known.
    """
    where = [f"{component} in {call}" for component, call in calls]
    if how == "SIGKILL":  # no process sends it to itself
        return (
            "the process was killed, "
            f"{f'with {join_names(where)}' if where else 'perhaps because memory ran out'}"
        )
    if len(calls) > 1:
        return f"one of {join_names(where)} ended the process ({how})"
    for component, call in calls:
        return f"{component} ended the process in {call} ({how})"
    return f"the process ended ({how})"


def _save_results(told: _RunState, output: OutputFolder, cause: str, ended: float) -> str:
    """Write the results that can be written, and return the error message."""
    if told.files_written:
        earlier = output.status()
        whole = f"{cause}, when the results were complete."
        problem = whole if earlier in ("", COMPLETED) else f"{earlier} Then {whole}"
        output.change_record(status=problem)
        return problem
    if told.begun is None or not black_box.read_message(black_box.MEMORY):
        problem = f"the run ended{'' if told.stepping else ' before its first step'}: {cause}."
        output.change_record(scenario=told.name, status=problem)
        return problem
    result = _finish_result(told.begun, output, cause, ended, told.rows_written)
    drawing = told.plots or told.animate or told.report
    with BarProgress() if drawing else contextlib.nullcontext(Progress()) as progress:
        result, pictures = output.keep(result, told.plots, progress, told.animate, told.report, told.notes)
    show_result(result, told.notes, output, pictures)
    return str(result.problem)


def _finish_result(
    begun: _StartedRun, output: OutputFolder, cause: str, ended: float, written: bool
) -> Result:
    """Return the result with all recorded rows. If they are `written`, the table has them already."""
    memory, follows, end = pickle.loads(black_box.read_message(black_box.MEMORY))
    table, metrics = output.table(), MetricsRecorder()
    table.share_memory()
    metrics.begin(begun.outline, memory[metrics.key])
    count = memory[table.key]["rows"]
    if not written:
        with recording(table):
            table.begin(begun.outline, memory[table.key])
            table.recover(memory[table.key])
        rows = RowBuffer(1 + len(begun.outline.names), [table, metrics], shown=begun.shown)
        if follows and (last := rows.recover()) is not None:
            end = last
        rows.end()
        count = table.memory()["rows"]
    problem = f"the run ended at t = {end:.6g} s: {cause}."
    before, steps = begun.result, count - begun.rows
    remarks = [*describe_lost_values(before.record), *metrics.remarks()]
    return replace(
        before,
        table=None if written else table,
        metrics=metrics.figures(),
        signals=metrics.signals(),
        coupling=metrics.coupling(),
        remarks=remarks,
        steps=steps,
        simulated_s=end - before.end_s,
        end_s=end,
        wall_s=ended - begun.at,
        problem=problem,
        record={**before.record, "status": problem, "remarks": remarks},
    )
