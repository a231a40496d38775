"""The output folder of a run: its files by name."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError, RunError
from ..base.files import report_write_errors
from ..base.ownership import has_entries
from ..base.progress import Progress
from ..recorders.coupling.coupling_cost import COUPLING
from ..recorders.metrics import SIGNALS
from ..recorders.parquet_file import strange_parts
from ..recorders.recorder import Outline, Recorder, recording
from ..recorders.registry import TABLES, table_names
from ..recorders.table import Table
from ..run.result import Result
from .animation import ANIMATIONS, animate
from .folder import Folder
from .pages.plain import to_plain
from .plots.pictures import FIGURES, drawn

METRICS, RECORD, REPORT = "metrics.json", "run.json", "report.html"


def results_folder(name: str) -> Path:
    """Where the results of a scenario go unless told otherwise; a name cannot lead elsewhere."""
    return Path("results") / (re.sub(r"[^\w.-]+", "_", name).strip("._") or "run")


def _is_record(path: Path) -> bool:
    """Return whether a run wrote this run.json, also one that ended too early to say more."""
    return has_entries("scenario", "status")(path) or has_entries("settings", "versions")(path)


class OutputFolder(Folder):
    """A folder for the results of one run; an earlier run's files stay until `clear`."""

    what = "results"
    record_file, is_record = RECORD, _is_record

    def __init__(
        self,
        path: Path,
        form: str = "csv",
        *,
        plots: bool = True,
        animated: bool = False,
        report: bool = False,
        overwrite: bool = False,
    ) -> None:
        """Make the folder, and check that its files can be written.

        Args:
            path: The folder.
            form: Format of the table of results, a name of `TABLES`.
            plots: Pictures are written, too.
            animated: Animations are written, too.
            report: A page is written, too.
            overwrite: Replace files that emla did not write.

        Raises:
            CommandError: The folder or one of the files cannot be written, or somebody else wrote it.
        """
        self.form, self.results = form, path / f"results.{form}"
        pictures, animations = [f"{name}.png" for name in FIGURES], [f"{name}.gif" for name in ANIMATIONS]
        self.files = [self.results.name, METRICS, RECORD]
        self.files += [REPORT] * report + pictures * plots + animations * animated
        known = [*table_names(), METRICS, RECORD, REPORT, *pictures, *animations]
        self.pictures = [name for name in known if name not in self.files]
        try:
            path.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=path):
                pass
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise CommandError(f"the output folder '{path}' cannot be written: {reason}.") from error
        super().__init__(path, overwrite)

    def check_files(self, names: Iterable[str]) -> None:
        """Raise CommandError where one of these files cannot be written, or somebody else wrote it."""
        super().check_files(names)
        with report_write_errors(self.path):
            problem = strange_parts(self._place / self.results.name)
        if problem is not None:
            raise CommandError(f"{problem}, or choose another output folder.")

    def check(self) -> None:
        """`check_files` for all files that a run may write here."""
        self.check_files(self.files)

    def recorders(self, continued: bool) -> list[Recorder]:
        """What writes the table of results while a run goes on, which may continue one in this folder."""
        return [_FolderClearer(self, continued), self.table()]

    def table(self) -> Table:
        """What writes the table of results."""
        return TABLES[self.form](self._place / self.results.name)

    def clear(self, keep_results: bool = False) -> None:
        """Remove what an earlier run left, and list what this one writes. May raise OSError."""
        kept = table_names() if keep_results else []
        self._files.remove([n for n in (*self.files, *self.pictures) if n not in kept], self.files)
        self._files.claim(self.files)

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
        """`save`, with a failure among the problems of the result."""
        try:
            return result, self.save(result, plots, progress, animated, report, notes)
        except RunError as error:
            return replace(result, problem=" ".join(filter(None, (result.problem, str(error))))), []

    def save(
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
        with report_write_errors(self.path):
            self._files.claim(self.files)
            written = self._write(result, plots, progress or Progress(), animated, report, notes)
            self._files.settle()
            return written

    def _write(
        self,
        result: Result,
        plots: bool,
        told: Progress,
        animated: bool,
        report: bool,
        notes: Sequence[str],
    ) -> list[Path]:
        """See `save`. Raises OSError."""
        figures = {**result.metrics, COUPLING: result.coupling, SIGNALS: result.signals}
        self.write_json(METRICS, {**to_plain(figures), "run": _run_metrics(result)})
        self.write_json(RECORD, result.record)
        written = list[Path]()
        if report:
            from .run_page.page import render_page

            told.begin("writing the report", 1)
            written.append(self.write(REPORT, render_page(result, notes).encode("utf-8", "replace")))
            told.advance(1)
        if result.steps == 0 or result.table is None:
            return written
        if plots:
            told.begin("drawing plots", len(FIGURES))
            for name, figure in drawn(result):
                written += [self.draw(f"{name}.png", figure)] if figure is not None else []
                told.advance(1)
        if animated:
            written += animate(result, self._place, told)
        return written

    def change_record(self, **entries: Any) -> None:
        """Write run.json with these entries, and those that it has. Raises RunError."""
        with report_write_errors(self.path):
            self.write_json(RECORD, self._record() | entries)
            self._files.settle()

    def status(self) -> str:
        """What run.json says of how the run ended; empty where there is none."""
        with report_write_errors(self.path):
            return str(self._record().get("status", ""))

    def _record(self) -> dict[str, Any]:
        """What run.json holds; nothing where it cannot be understood."""
        place = self._place / RECORD
        try:
            found = json.loads(place.read_text(encoding="utf-8")) if place.is_file() else {}
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}


class _FolderClearer(Recorder):
    """Removes what an earlier run left when a run begins, and not before: a wrong command leaves it alone."""

    def __init__(self, folder: OutputFolder, continued: bool) -> None:
        self._folder, self._continued = folder, continued

    def __str__(self) -> str:
        return str(self._folder.results)

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Remove it, but for a table of results that is continued.

        Raises CommandError where somebody else's file was put there meanwhile.
        """
        self._folder.check()
        self._folder.clear(keep_results=self._continued)


def _rows(columns: Mapping[str, Vector]) -> Vector:
    return np.column_stack(list(columns.values()))


def _run_metrics(result: Result) -> dict[str, Any]:
    found = result.run_figures
    if result.pacing is not None:
        found["real_time"] = result.pacing
    return found
