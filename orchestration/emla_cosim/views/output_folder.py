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
from ..base.files import remove_unfinished, writing_to, written_whole
from ..base.ownership import OutputFiles, has_entries
from ..base.progress import Progress
from ..recorders.coupling.coupling import COUPLING
from ..recorders.metrics import SIGNALS
from ..recorders.parquet_file import strange_parts
from ..recorders.recorder import Outline, Recorder, recording
from ..recorders.registry import TABLES, table_names
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
        self.path, self.form, self.overwrite = path, form, overwrite
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
        self._names = [self.results.name, METRICS, RECORD]
        self._names += [REPORT] * report + _pictures() * plots + _animations() * animated
        known = [*table_names(), METRICS, RECORD, REPORT]
        self._known = [*known, *_pictures(), *_animations()]
        self._files = OutputFiles(self._place, path, RECORD, _is_record, self._known, overwrite)
        self.check()

    @property
    def files(self) -> list[Path]:
        """All files that a run may write here."""
        return [self.path / name for name in self._names]

    def check(self) -> None:
        """Raise CommandError where one of the files cannot be written, or somebody else wrote it."""
        self._files.check(self._names, "the file of results")
        with writing_to(self.path):
            problem = strange_parts(self._place / self.results.name)
        if problem is not None:
            raise CommandError(f"{problem}, or choose another output folder.")

    @contextlib.contextmanager
    def alone(self, heir_of: int | None = None) -> Iterator[None]:
        """No other run writes here meanwhile; CommandError where one does. See `locking.alone`.

        What was not complete when an earlier run was killed is removed.
        """
        with alone(self._place, heir_of):
            remove_unfinished(self._place)
            yield

    def recorders(self, continued: bool) -> list[Recorder]:
        """What writes the table of results while a run goes on, which may continue one in this folder."""
        return [_Clearing(self, continued), self.table()]

    def table(self) -> Table:
        """What writes the table of results."""
        return self._make(self._place / self.results.name)

    def clear(self, keep_results: bool = False) -> None:
        """Remove what an earlier run left, and list what this one writes. May raise OSError."""
        kept = table_names() if keep_results else []
        self._files.remove([n for n in self._known if n not in kept], self._names)
        self._files.claim(self._names)

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
        with writing_to(self.path):
            self._files.claim(self._names)
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
        """See `write`. Raises OSError."""
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
            self._files.claim([RECORD])
            self._write_json(RECORD, self._record() | entries)
            self._files.settle()

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


def _is_record(path: Path) -> bool:
    """Return whether a run wrote this run.json, also one that ended too early to say more."""
    return has_entries("scenario", "status")(path) or has_entries("settings", "versions")(path)


def _pictures() -> list[str]:
    return [f"{figure}.png" for figure in FIGURES]


def _animations() -> list[str]:
    return [f"{name}.gif" for name in ANIMATIONS]


class _Clearing(Recorder):
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


def _without_nan(value: Any) -> Any:
    """Figures with null where one does not exist: JSON has no NaN."""
    if isinstance(value, Mapping):
        return {name: _without_nan(inner) for name, inner in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
