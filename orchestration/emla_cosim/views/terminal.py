"""Terminal output of a run: progress, tables of results, messages, files."""

import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.segment import Segment
from rich.table import Table

from ..base.errors import CosimError
from ..base.wording import format_count
from ..pages.text import make_visible
from .formatting import (
    PROFILE_COLUMNS,
    describe_stepping,
    format_figure,
    list_profile_rows,
    list_signal_texts,
)

if TYPE_CHECKING:
    from ..run.result import Result
    from .output_folder import OutputFolder
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress
from rich.text import Text

from ..base.progress import CompatibilityReport, Progress


class _Stderr:
    """The present standard error. Text is dropped if it cannot be written."""

    def write(self, text: str) -> int:
        with suppress(OSError, ValueError):
            sys.stderr.write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError, ValueError):
            sys.stderr.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(sys.stderr, name)


_MOST_SIGNALS = 10
"""Most signals outside their tubes to show."""

_UNFOLDED_WIDTH = 10_000
"""Number of columns that every table fits in."""
_MOST_FIGURES = 20
"""Most signals whose metrics to show."""


class _SafeConsole(Console):
    r"""A console that shows control characters of texts, such as \x1b, and does not execute them.

    Texts come from files of others: names, descriptions, records, data. Sequences of rich itself pass.
    """

    def _render_buffer(self, buffer: Iterable[Segment]) -> str:
        visible = (s if s.control else s._replace(text=make_visible(s.text)) for s in buffer)
        return super()._render_buffer(visible)


OUT, ERR = _SafeConsole(), _SafeConsole(file=cast(IO[str], _Stderr()))
"""Standard output is for results, standard error for progress and errors."""


@dataclass(frozen=True)
class Verbosity:
    """What to show: only errors, or also replacement FMUs whose variables all match."""

    quiet: bool = False
    fit: bool = False


_verbosity = Verbosity()


@contextmanager
def use_verbosity(verbosity: Verbosity) -> Iterator[None]:
    """Set the verbosity inside a `with` block."""
    global _verbosity
    before, _verbosity = _verbosity, verbosity
    try:
        yield
    finally:
        _verbosity = before


def get_verbosity() -> Verbosity:
    """Return the current verbosity."""
    return _verbosity


def show(content: RenderableType, asked_for: bool = False, **how: Any) -> None:
    """Print something, unless `--quiet` is set and it is not the purpose of the command (`asked_for`).

    Raises:
        CosimError: If standard output cannot be written.
    """
    # what a command is for is shown also with --quiet
    if _verbosity.quiet and not asked_for:
        return
    with _report_output_errors():
        OUT.print(content, **how)


def show_table(table: Table) -> None:
    """Print a table as wide as the terminal, or without a terminal so wide that no cell is folded."""
    with _report_output_errors():
        # programs that read the table need whole names
        (OUT if OUT.is_terminal else _SafeConsole(width=_UNFOLDED_WIDTH)).print(table)


def print_exactly(text: str) -> None:
    """Print a text for programs without changes. Raise CosimError if standard output cannot be written."""
    with _report_output_errors():
        OUT.file.write(text)
        OUT.file.flush()


@contextmanager
def _report_output_errors() -> Iterator[None]:
    """Raise CosimError if standard output cannot be written inside a `with` block."""
    try:
        yield
    except (OSError, ValueError) as error:
        # a closed stream raises ValueError, a full disk OSError
        reason = getattr(error, "strerror", None) or error
        raise CosimError(f"the standard output cannot be written: {reason}.") from error


def show_result(
    result: "Result", notes: Sequence[str], output: "OutputFolder", pictures: Sequence[Path]
) -> None:
    """Show the metrics as tables, the statistics of the steps, and the files."""
    for part in _list_metrics(result):
        if isinstance(part, str):
            print_line(part)
        else:
            show(part)
    for note in notes:
        print_line(f"Note: {note}.")
    if result.comparisons:
        _show_agreement(result)
    for table in _list_profile(result):
        show(table)
    for line in describe_stepping(result):
        print_line(line)
    print_line(f"Wrote {output.path}/: {output.results.name}, metrics.json, run.json")
    drawn = [path.name for path in pictures if path.suffix != ".html"]
    if drawn:
        print_line(f"Plots: {', '.join(drawn)}")
    for path in pictures:
        if path.suffix == ".html":
            print_line(f"Report: {path}")


def format_result(result: "Result") -> str:
    """Return remarks, metrics as tables, and the error message of a result as plain text."""
    console = _SafeConsole(file=StringIO(), width=_UNFOLDED_WIDTH, color_system=None, legacy_windows=False)
    messages = [*filter(None, [result.problem]), *describe_stepping(result)]
    for part in (*_list_metrics(result), *_list_profile(result), *messages):
        console.print(part, markup=False, highlight=False, soft_wrap=isinstance(part, str))
    return cast(StringIO, console.file).getvalue().rstrip()


def show_error(sentence: str) -> None:
    """Show an error message."""
    ERR.show_cursor()  # a progress bar may have hidden it
    ERR.print(f"[bold red]Error:[/] {_format_message(sentence)}", highlight=False, soft_wrap=True)


def show_warning(sentence: str) -> None:
    """Show a warning."""
    ERR.print(f"\n[bold yellow]Warning:[/] {_format_message(sentence)}", highlight=False, soft_wrap=True)


def _format_message(sentence: str) -> str:
    """Escape markup, and line breaks of names: lines of a list of problems are indented."""
    # names come from files, and a line break could fake a second message
    return escape(re.sub(r"[\r\n](?!  )", lambda match: repr(match[0])[1:-1], sentence.strip()))


def show_interrupted() -> None:
    """Show that the user interrupted the command."""
    ERR.print("[bold red]Interrupted.[/]")


def show_file(path: Path) -> None:
    """Show a file that was written, with its size."""
    size = path.stat().st_size / 1024
    show(f"{escape(str(path))}  [dim]{size:.0f} KiB[/]", highlight=False, soft_wrap=True)


def print_line(text: str) -> None:
    """Print one line without markup."""
    show(text, markup=False, highlight=False, soft_wrap=True)


def _list_metrics(result: "Result") -> Iterator[Table | str]:
    """Yield the remarks on a result, its metrics by kind, or of signals, and what its joints idealise."""
    from .formatting import describe_idealisations  # it loads NumPy, which most output does not need

    yield from result.remarks
    title = f"{result.name}, {result.end_s - result.times.start:g} s simulated"
    for kind, figures in result.metrics.items():
        if displays := result.displays[kind]:
            rows = [
                (d.label, *(format_figure(f[d.name], d) for f in figures.values()), d.unit) for d in displays
            ]
            yield _make_table(title, [*figures, ""], rows)
    if not any(result.metrics.values()) and result.signals:
        yield from _list_signals(result, title)
    if (idealised := describe_idealisations(result)) is not None:
        yield idealised


def _list_profile(result: "Result") -> Iterator[Table]:
    """Yield a table of where the time went, if it was measured."""
    if not (rows := list_profile_rows(result, _MOST_FIGURES)):
        return
    texts = [(row.name, *row.values) for row in rows]
    yield _make_table("Where the time went", PROFILE_COLUMNS, texts, overflow="fold")


def _make_table(title: str, columns: Iterable[str], rows: Iterable[Iterable[str]], **first: Any) -> Table:
    """Return a table with names in the `first` column; values are at the right, texts without a head not."""
    table = Table(title=escape(title), title_justify="left")
    table.add_column("", **first)
    for column in columns:
        table.add_column(escape(column), justify="right" if column else "left")
    for row in rows:
        table.add_row(*map(escape, row))
    return table


def _list_signals(result: "Result", title: str) -> Iterator[Table | str]:
    """Yield a table with the metrics of the first signals, and how many more there are."""
    names, rows = list_signal_texts(result, _MOST_FIGURES)
    texts = [(signal, *values, unit) for signal, values, unit in rows]
    yield _make_table(title, [*names, ""], texts, overflow="fold")
    if (more := len(result.signals) - _MOST_FIGURES) > 0:
        yield f"The metrics of {more} more signals are in metrics.json."


def _show_agreement(result: "Result") -> None:
    """Show how many signals agree with the reference, and a table of the others, earliest departure first."""
    # it loads NumPy, which most output does not need
    from ..base.tolerances import select_outside

    outside = select_outside(result.comparisons)
    reference = result.record["reference"]["run"]
    agree = format_count(len(result.comparisons), "signal agrees", "signals agree")
    print_line(f"{len(result.comparisons) - len(outside)} of {agree} with {reference}")
    if not outside:
        return
    table = Table("signal", "left tube at / s", "deviation", "allowed", "", "at / s")
    for comparison in outside[:_MOST_SIGNALS]:
        figures = (f"{comparison.left_at:.6g}", f"{comparison.worst:.3g}", f"{comparison.tube.value:.3g}")
        table.add_row(
            escape(comparison.signal), *figures, escape(comparison.unit), f"{comparison.worst_at:.6g}"
        )
    if len(outside) > _MOST_SIGNALS:
        table.add_row(f"and {len(outside) - _MOST_SIGNALS} more, in run.json")
    show(table)


_NOTABLE_VERDICTS = ("is left out", "keeps its start value", "is not used")


class _Rate(ProgressColumn):
    """Units per second of a task that has units."""

    def render(self, task: Task) -> Text:
        """Return the average rate."""
        speed = task.finished_speed or task.speed
        return Text(f"{speed:.3g} {task.fields['unit']}/s" if speed and task.fields.get("unit") else "")


class BarProgress(Progress):
    """Progress as bars on the terminal, one for each task. Use it in a `with` block.

    Examples:
        >>> import emla_cosim as ec
        >>> with ec.BarProgress() as bars:
        ...     simulation = ec.load("lift").prepare(bars)
    """

    def __init__(self) -> None:
        self._bars = RichProgress(
            TextColumn("{task.description:<16}"),
            BarColumn(),
            MofNCompleteColumn(),
            _Rate(),
            TimeRemainingColumn(elapsed_when_finished=True),
            console=ERR,
            disable=get_verbosity().quiet,
        )
        self._task: Any = None

    def __enter__(self) -> "BarProgress":
        self._bars.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bars.stop()

    def begin(self, task: str, total: int, unit: str = "") -> None:
        """Begin a task of `total` units."""
        self._task = self._bars.add_task(escape(task), total=total, unit=unit)

    def advance(self, count: int) -> None:
        """Add completed units."""
        self._bars.advance(self._task, count)

    def note(self, sentence: str) -> None:
        """Print a line above the bars."""
        if get_verbosity().quiet:
            return
        self._bars.console.print(sentence, markup=False, highlight=False, soft_wrap=True)

    def report_replacement(self, fit: CompatibilityReport) -> None:
        """Report a replacement. If variables are converted, missing or left out, show them as a table."""
        if get_verbosity().quiet:
            return
        # a table of matches would hide what does not match
        if not (fit.is_noteworthy or get_verbosity().fit):
            count = fit.same + len(fit.matches)
            fits = "its variable matches" if count == 1 else f"all {count} variables match"
            self.note(f"{fit.fmu} as {fit.component}: {fits} (--show-fit lists them)")
            return
        table = Table(title=escape(f"{fit.fmu} as {fit.component}"), title_justify="left")
        for column in ("", "here", "there", ""):
            table.add_column(column)
        for match in fit.matches:
            style = "bold red" if match.fatal else "yellow" if match.verdict in _NOTABLE_VERDICTS else ""
            table.add_row(
                *map(escape, (match.kind, match.original, match.replacement, match.verdict)), style=style
            )
        if fit.same:
            table.add_row("", f"{fit.same} more", "", "same name and unit")
        self._bars.console.print(table)

    def finish(self) -> None:
        """End the task."""
        task = next(t for t in self._bars.tasks if t.id == self._task)
        self._bars.update(self._task, completed=task.total)
