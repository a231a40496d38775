"""The output folder of a run: its files by name."""

import contextlib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError, RunError
from ..base.files import UNFINISHED, place_of, writing_to, written_whole
from ..base.progress import Progress
from ..recorders.coupling.coupling import COUPLING
from ..recorders.metrics import SIGNALS
from ..recorders.recorder import Outline, Recorder, recording
from ..recorders.registry import TABLES
from ..recorders.table import Table
from ..run.result import Result
from ..sandbox.locking import alone
from .animation import ANIMATIONS, animate
from .plots.plotting import FIGURES, draw

METRICS, RECORD, REPORT = "metrics.json", "run.json", "report.html"


def results_folder(name: str) -> Path:
    """Where the results of a scenario go unless told otherwise; a name cannot lead elsewhere."""
    return Path("results") / (re.sub(r"[^\w.-]+", "_", name).strip("._") or "run")


class OutputFolder:
    """A folder for the results of one run; an earlier run's files stay until `clear`."""

    def __init__(self, path: Path, form: str = "csv") -> None:
        """Make the folder and see that it can be written; CommandError if not.

        `form` is that of the table of results, a name of `TABLES`.
        """
        self.path, self.form = path, form
        self.results = path / f"results.{form}"
        self._make = TABLES[form]
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._place = path.resolve()
            with TemporaryFile(dir=path):
                pass
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise CommandError(f"the output folder '{path}' cannot be written: {reason}.") from error
        for file in self.files:
            place_of(file, "the file of results")

    @property
    def files(self) -> list[Path]:
        """All files that a run may write here."""
        return [self.results, *(self.path / name for name in _names())]

    @contextlib.contextmanager
    def alone(self, heir_of: int | None = None) -> Iterator[None]:
        """No other run writes here meanwhile; CommandError where one does. See `locking.alone`.

        What was not complete when an earlier run was killed is removed.
        """
        with alone(self._place, heir_of):
            with contextlib.suppress(OSError):
                for left in self._place.glob(f"{UNFINISHED}*"):
                    left.unlink()
            yield

    def recorders(self, continued: bool) -> list[Recorder]:
        """What writes the table of results while a run goes on, which may continue one in this folder."""
        return [_Clearing(self, continued), self.table()]

    def table(self) -> Table:
        """What writes the table of results."""
        return self._make(self._place / self.results.name)

    def clear(self, keep_results: bool = False) -> None:
        """Remove what an earlier run left under the same names, but no links. May raise OSError."""
        tables = [] if keep_results else [f"results.{form}" for form in TABLES]
        for name in (*_names(), *tables):
            if not (self._place / name).is_symlink():
                (self._place / name).unlink(missing_ok=True)

    def write_table(self, result: Result) -> None:
        """Write the table of a result that has it in memory. Raises RunError."""
        kept = result.read(["time", *result.names])
        columns = list(kept)[1:]
        units = [result.units[name] for name in columns]
        table = self.table()
        with recording(table):
            self.clear()
            table.begin(Outline(columns, units, result.times, range(len(columns))))
            try:
                table.write(_rows(kept))
            finally:
                table.end()

    def keep(
        self,
        result: Result,
        plots: bool,
        progress: Progress,
        animated: bool = False,
        report: bool = False,
        notes: Sequence[str] = (),
    ) -> tuple[Result, list[Path]]:
        """`write`, with a failure among the problems of the result."""
        try:
            return result, self.write(result, plots, progress, animated, report, notes)
        except RunError as error:
            return replace(result, problem=" ".join(filter(None, (result.problem, str(error))))), []

    def write(
        self,
        result: Result,
        plots: bool,
        progress: Progress | None = None,
        animated: bool = False,
        report: bool = False,
        notes: Sequence[str] = (),
    ) -> list[Path]:
        """Write metrics.json, run.json and, if wanted, pictures, a page and animations, which are returned.

        `notes` are sentences for the page on what was read. Raises RunError, also where Ctrl-C ends an
        animation.
        """
        told = progress or Progress()
        with writing_to(self.path):
            figures = {**result.metrics, COUPLING: result.coupling, SIGNALS: result.signals}
            self._write_json(METRICS, {**_without_nan(figures), "run": _run_metrics(result)})
            self._write_json(RECORD, result.record)
            written = list[Path]()
            if report:
                from .run_page.page import page

                told.begin("writing the report", 1)
                with written_whole(self._place / REPORT) as stream:
                    stream.write(page(result, notes).encode("utf-8", "replace"))
                written.append(self.path / REPORT)
                told.advance(1)
            if result.steps == 0 or result.table is None:
                return written
            if plots:
                told.begin("drawing plots", len(FIGURES))
                written += draw(result, self._place, lambda _: told.advance(1))
            if animated:
                written += animate(result, self._place, told)
            return written

    def change_record(self, **entries: Any) -> None:
        """Write run.json with these entries, and those that it has. Raises RunError."""
        with writing_to(self.path):
            self._write_json(RECORD, self._record() | entries)

    def status(self) -> str:
        """What run.json says of how the run ended; empty where there is none."""
        with writing_to(self.path):
            return str(self._record().get("status", ""))

    def _record(self) -> dict[str, Any]:
        """What run.json holds; nothing where it cannot be understood."""
        place = self._place / RECORD
        try:
            found = json.loads(place.read_text(encoding="utf-8")) if place.is_file() else {}
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}

    def _write_json(self, name: str, content: object) -> None:
        with written_whole(self._place / name) as stream:
            stream.write((json.dumps(content, indent=2) + "\n").encode())


def _names() -> list[str]:
    """Names of all files but the table of results."""
    pictures = *(f"{figure}.png" for figure in FIGURES), *(f"{name}.gif" for name in ANIMATIONS)
    return [METRICS, RECORD, REPORT, *pictures]


class _Clearing(Recorder):
    """Removes what an earlier run left when a run begins, and not before: a wrong command leaves it alone."""

    def __init__(self, folder: OutputFolder, continued: bool) -> None:
        self._folder, self._continued = folder, continued

    def __str__(self) -> str:
        return str(self._folder.results)

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Remove it, but for a table of results that is continued."""
        self._folder.clear(keep_results=self._continued)


def _rows(columns: Mapping[str, Vector]) -> Vector:
    return np.column_stack(list(columns.values()))


def _run_metrics(result: Result) -> dict[str, Any]:
    found = result.run_figures
    if result.pacing is not None:
        found["real_time"] = result.pacing
    return found


def _without_nan(value: Any) -> Any:
    """Figures with null where one does not exist: JSON has no NaN."""
    if isinstance(value, Mapping):
        return {name: _without_nan(inner) for name, inner in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
