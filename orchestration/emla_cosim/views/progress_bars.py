"""Progress bars in the terminal."""

from typing import Any

from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress
from rich.table import Table
from rich.text import Text

from ..base.progress import CompatibilityReport, Progress
from .terminal import ERR, get_verbosity

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
