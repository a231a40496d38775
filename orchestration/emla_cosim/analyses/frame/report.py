"""The report of an analysis as data, for the terminal, Markdown, its page and notebooks."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, NamedTuple

from rich.box import SIMPLE
from rich.console import Group
from rich.table import Table
from rich.text import Text as Styled

_MOST_COLUMNS = 8
"""A table with more columns has no lines between them in the terminal."""


class Text(NamedTuple):
    """A message or the text of a cell; it can be the best of its row, or report a failure."""

    text: str
    is_best: bool = False
    is_failure: bool = False

    def styled(self) -> Styled:
        """Return the text for the terminal; a star marks the best one also without colours."""
        style = "bold green" if self.is_best else "bold red" if self.is_failure else ""
        return Styled(f"{self.text} *" if self.is_best else self.text, style)


@dataclass(frozen=True)
class ReportTable:
    """A table of a report.

    Attributes:
        title: Title.
        header: Heads of the columns; line breaks are for the terminal.
        rows: Cells by row; a cell with properties is a `Text`.
        under: Sentences below the table.
        lines: Numbers of the rows that follow a line.
        texts: Numbers of the columns with texts, which are aligned on the left.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[Text | str]]
    under: Sequence[str] = ()
    lines: Collection[int] = ()
    texts: Collection[int] = (0,)

    @property
    def cells(self) -> list[list[Text]]:
        """All cells by row."""
        return [[cell if isinstance(cell, Text) else Text(cell) for cell in row] for row in self.rows]

    def rich(self) -> Group:
        """Return the table for the terminal, with its title, which may be wider."""
        is_wide = len(self.header) > _MOST_COLUMNS
        style: dict[str, Any] = {"box": SIMPLE, "padding": (0, 1, 0, 0), "pad_edge": False} if is_wide else {}
        table = Table(show_header=any(self.header), **style)
        for number, head in enumerate(self.header):
            is_text = number in self.texts
            table.add_column(
                Styled(head, overflow="fold", no_wrap=False),
                justify="left" if is_text else "right",
                overflow="fold" if is_text else "ellipsis",
                no_wrap=not is_text,
            )
        for number, row in enumerate(self.cells):
            if number in self.lines:
                table.add_section()
            table.add_row(*(cell.styled() for cell in row))
        return Group(Styled(self.title, style="table.title"), table)

    def markdown(self) -> str:
        """Return the table as Markdown."""
        columns = range(len(self.header))
        texts = [[_cell_to_markdown(cell) for cell in row] for row in self.cells]
        heads = [_escape_cell(head) for head in self.header]
        width = [max(3, *(len(row[i]) for row in [heads, *texts])) for i in columns]
        rule = ["-" * w if i in self.texts else f"{'-' * (w - 1)}:" for i, w in enumerate(width)]
        rows = [[text.ljust(w) for text, w in zip(row, width, strict=True)] for row in [heads, rule, *texts]]
        under = "".join(f"\n{sentence}\n" for sentence in self.under)
        return f"{self.title}\n\n" + "".join(f"| {' | '.join(row)} |\n" for row in rows) + under


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes:
        title: Title on the page.
        lines: Sentences before the tables.
        tables: Tables.
        pictures: What the pictures of this part show, by their file names.
        under: Sentences after the tables.
        is_detail: Whether only the page has this part, not the terminal.
        most: Most `lines` that the terminal shows. Default: all.
    """

    title: str = ""
    lines: Sequence[Text | str] = ()
    tables: Sequence[ReportTable] = ()
    pictures: Mapping[str, str] = field(default_factory=dict)
    under: Sequence[Text | str] = ()
    is_detail: bool = False
    most: int | None = None


@dataclass(frozen=True)
class Report:
    """What a person reads of a result.

    Attributes:
        kind: Kind of the analysis, such as "Sizing".
        name: Name of what was examined.
        facts: Short facts for the head of the page, such as "200 runs".
        sections: Parts in the order in which they are read.
    """

    kind: str
    name: str
    facts: Sequence[str]
    sections: Sequence[Section]


def _escape_cell(text: str) -> str:
    return text.replace("\n", " ").replace("|", "\\|")


def _cell_to_markdown(cell: Text) -> str:
    text = _escape_cell(cell.text)
    return f"**{text}**" if cell.is_best else text


class ReportedResult:
    """Base of results with a report: that of `build_report` in the module `report` beside their class."""

    def _build_report(self) -> "Report":
        # imported on first use: it needs the class of the result, and loads what only reports need
        return import_module(".report", type(self).__module__.rpartition(".")[0]).build_report(self)

    def __repr__(self) -> str:
        """Return one line: the kind of analysis, its name, and short facts."""
        report = self._build_report()
        return f"<{report.kind} of {report.name}: {', '.join(report.facts)}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the report without its pictures, which `plot` draws."""
        from ...pages.page import Plots, render_template  # importing it loads jinja2

        return render_template(__package__ or "", "report_cell.html", Plots(), report=self._build_report())
