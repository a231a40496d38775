"""The output folder of a run and its files."""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from ..base.arrays import Texts, Vector
from ..base.errors import CommandError, RunError
from ..base.extras import require_extra
from ..base.files import report_write_errors
from ..base.output_files import UNFINISHED_STATUS
from ..base.progress import Progress
from ..pages.text import to_plain
from ..recorders.bond_energies import COUPLING
from ..recorders.metrics import SIGNALS
from ..recorders.parquet_file import explain_foreign_parts
from ..recorders.recorder import Recorder, RunLayout, recording
from ..recorders.registry import TABLES, table_names
from ..recorders.table import Table
from ..run.output_options import PLOT_FORMATS
from ..run.result import Result
from .animation import ANIMATIONS, animate
from .folder import Folder
from .plots.pictures import FIGURES, draw_figures

METRICS, RECORD, REPORT = "metrics.json", "run.json", "report.html"


def results_folder(name: str) -> Path:
    """Return the default output folder of a scenario. Names cannot lead out of `results/`."""
    return Path("results") / (re.sub(r"[^\w.-]+", "_", name).strip("._") or "run")


class OutputFolder(Folder):
    """The folder for the results of one run. Files of an earlier run stay until `begin`."""

    subject = "results"
    record_file = RECORD

    def __init__(
        self,
        path: Path,
        form: str = "csv",
        *,
        plots: bool = True,
        plot_format: str = "png",
        animated: bool = False,
        report: bool = False,
        overwrite: bool = False,
    ) -> None:
        """Check that the files can be written, and create the folder.

        Args:
            path: The folder.
            form: Format of the table of results, a name of `TABLES`.
            plots: Whether plots are written.
            plot_format: Format of plots, one of `PLOT_FORMATS`.
            animated: Whether animations are written.
            report: Whether a page is written.
            overwrite: Whether to replace files that emla did not write.

        Raises:
            CommandError: If the folder or a file cannot be written, or emla did not write the existing one.
            MissingExtraError: If a page or an animation needs packages that are not installed.
        """
        if report or animated:
            require_extra("plots", "a page" if report else "an animation")
        self.form, self.results, self.plot_format = form, path / f"results.{form}", plot_format
        pictures, animations = [f"{name}.{plot_format}" for name in FIGURES], [f"{n}.gif" for n in ANIMATIONS]
        self.files = [self.results.name, METRICS, RECORD]
        self.files += [REPORT] * report + pictures * plots + animations * animated
        plotted = [f"{name}.{ending}" for name in FIGURES for ending in PLOT_FORMATS]
        # files of an earlier run with other options must not stay beside those of this run
        possible = [*table_names(), METRICS, RECORD, REPORT, *plotted, *animations]
        self.pictures = [name for name in possible if name not in self.files]
        super().__init__(path, overwrite)
        try:
            path.mkdir(parents=True, exist_ok=True)
            # only trying tells whether a folder can be written
            with TemporaryFile(dir=path):
                pass
        except OSError as error:
            raise CommandError(f"the output folder '{path}' cannot be written: {error.strerror}.") from error

    def check_files(self, names: Iterable[str]) -> None:
        """Check also the folder for parts of the table; see `Folder.check_files`."""
        super().check_files(names)
        with report_write_errors(self.path):
            problem = explain_foreign_parts(self._real_path / self.results.name)
        if problem is not None:
            raise CommandError(f"{problem}, or choose another output folder.")

    def recorders(self, scenario: str, continued: bool) -> list[Recorder]:
        """Return recorders that begin the folder and write its table; `continued` extends the present one."""
        return [_FolderStarter(self, scenario, continued), self.table()]

    def table(self) -> Table:
        """Return the recorder for the table of results."""
        return TABLES[self.form](self._real_path / self.results.name)

    def begin(self, scenario: str, keep_results: bool = False) -> None:
        """Remove the files of an earlier run, and write run.json for the one that begins.

        Raises:
            CommandError: If a file that emla did not write has appeared.
            RunError: If writing fails.
        """
        self.check_files((*self.files, *self.pictures))
        retained = [RECORD, *(table_names() if keep_results else ())]
        # the record is replaced, so that the folder has one at any time; a full disk has room for it now
        self.remove(name for name in (*self.files, *self.pictures) if name not in retained)
        self.write_json(RECORD, {"scenario": scenario, "status": UNFINISHED_STATUS})

    def write_table(self, result: Result) -> None:
        """Write the table of a result that has it in memory. Raises RunError."""
        data = result.read(["time", *result.names])
        columns = list(data)[1:]
        units = [result.units[name] for name in columns]
        types = {name: kind for name, kind in result.types.items() if name in columns}
        texts = Texts()
        table = self.table()
        with recording(table):
            self.begin(result.name)
            layout = RunLayout(columns, units, result.times, range(len(columns)), types=types, texts=texts)
            table.begin(layout)
            try:
                table.write(_encode_rows(data, texts))
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
        interrupted: Callable[[], bool] = lambda: False,
    ) -> tuple[Result, list[Path]]:
        """Save as `save` does, but add a failure to the problems of the result."""
        try:
            return result, self.save(result, plots, progress, animated, report, notes, interrupted)
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
        interrupted: Callable[[], bool] = lambda: False,
    ) -> list[Path]:
        """Write metrics.json, run.json and, if selected, plots, a page and animations.

        `notes` are remarks for the page, without full stops. `interrupted` tells whether the user wants to
        end the command. Plots are then removed.

        Returns:
            The files of plots, page and animations.

        Raises:
            RunError: If writing fails, or plots or an animation are interrupted.
        """
        reporter = progress or Progress()
        figures = {**result.metrics, COUPLING: result.coupling, SIGNALS: result.signals}
        pacing = {} if result.pacing is None else {"real_time": result.pacing}
        self.write_json(METRICS, {**to_plain(figures), "run": {**result.run_figures, **pacing}})
        self.write_json(RECORD, result.record)
        written = list[Path]()
        if report:
            from .run_page.page import render_page

            reporter.begin("writing the report", 1)
            written.append(self.write(REPORT, render_page(result, notes).encode("utf-8", "replace")))
            reporter.advance(1)
        # there is nothing to draw
        if result.steps == 0 or result.table is None:
            return written
        if plots:
            written += self._draw_all(result, reporter, interrupted)
        if animated:
            written += [self.path / name for name in animate(result, self.open, reporter)]
        return written

    def _draw_all(self, result: Result, progress: Progress, interrupted: Callable[[], bool]) -> list[Path]:
        """Draw the plots, all or none."""
        progress.begin("drawing plots", len(FIGURES))
        written, figures = list[Path](), draw_figures(result)
        try:
            while not interrupted():
                if (named_figure := next(figures, None)) is None:
                    return written
                name, figure = named_figure
                written += [self.draw(f"{name}.{self.plot_format}", figure)] if figure is not None else []
                progress.advance(1)
        # some plots of a run beside those of an earlier one would mislead
        except BaseException:
            self.remove(path.name for path in written)
            raise
        self.remove(path.name for path in written)
        raise RunError("the plots were interrupted.")

    def change_record(self, **entries: Any) -> None:
        """Add or replace entries of run.json. Raises RunError."""
        self.write_json(RECORD, self._read_record() | entries)

    def status(self) -> str:
        """Return the status in run.json; an empty text without a valid run.json."""
        with report_write_errors(self.path):
            return str(self._read_record().get("status", ""))

    def _read_record(self) -> dict[str, Any]:
        """Return the content of run.json; empty if it is missing or invalid."""
        path = self._real_path / RECORD
        try:
            content = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        except ValueError:
            return {}
        return content if isinstance(content, dict) else {}


class _FolderStarter(Recorder):
    """Begins the folder when a run begins, but not after an invalid command."""

    def __init__(self, folder: OutputFolder, scenario: str, continued: bool) -> None:
        self._folder, self._scenario, self._continued = folder, scenario, continued

    def __str__(self) -> str:
        return str(self._folder.results)

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Begin the folder, and keep a table of results that is continued; see `OutputFolder.begin`."""
        self._folder.begin(self._scenario, keep_results=self._continued)


def _encode_rows(columns: Mapping[str, Any], texts: Texts) -> Vector:
    """Return columns as rows of numbers; texts become their numbers in `texts`, which keeps them."""
    numbers = (
        np.array([texts.encode(text) for text in values]) if values.dtype == object else values
        for values in columns.values()
    )
    return np.column_stack([values.astype(float) for values in numbers])
