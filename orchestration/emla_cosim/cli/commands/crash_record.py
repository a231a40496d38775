"""Write what another process needs to finish the results of `emla run` after an FMU has ended its process."""

import contextlib
import os
import pickle
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...base import crash_page
from ...base.crash_page import Stage
from ...base.units import LinearTransformation
from ...recorders.file_table import FileTable
from ...recorders.recorder import Pause, Recorder, RunLayout
from ...recorders.row_buffer import RowFile
from ...recorders.table import Table
from ...run.result import Result
from ...run.scenarios.scenario import Scenario
from ...run.simulation import Simulation
from ...views.terminal import Verbosity, get_verbosity


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
        begun: The run.
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

    def watch(self, simulation: Simulation, table: Recorder) -> None:
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
        self._outline = layout

    def pause(self, run: Pause) -> None:
        """Write the plan before the first step."""
        if not self._is_needed or self._plan.started_run is not None:
            return
        if isinstance(self._table, FileTable):  # a registered format can only be written by its own process
            started_run = StartedRun(
                replace(self._simulation.so_far(), table=None),
                self._outline,
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

    def keep(self) -> None:
        """Note that all files are written."""
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
