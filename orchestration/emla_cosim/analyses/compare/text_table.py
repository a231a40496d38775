"""A text table for the terminal and for Markdown."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rich.markup import escape
from rich.table import Table


class Cell(NamedTuple):
    """The text of a cell, and whether it is the best of its row or reports a loss."""

    text: str
    best: bool = False
    lost: bool = False


def resolution(value: float) -> float:
    """Return the value of the last digit with which `format_rounded` shows a number."""
    return min(1.0, 10.0 ** (math.floor(math.log10(abs(value))) - 2)) if value else 0.0


@dataclass(frozen=True)
class TextTable:
    """A table: its title, remarks below it, and the numbers of the rows that follow a line."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    under: Sequence[str] = ()
    lines: Sequence[int] = ()

    def markdown(self) -> str:
        """Return the table as Markdown."""
        columns = range(len(self.header))
        texts = [[_mark_cell(cell) for cell in row] for row in self.rows]
        heads = [_plain(head) for head in self.header]
        width = [max(3, *(len(row[i]) for row in [heads, *texts])) for i in columns]
        rule = [f"{'-' * (w - 1)}:" if i else "-" * w for i, w in enumerate(width)]
        rows = [[text.ljust(w) for text, w in zip(row, width, strict=True)] for row in [heads, rule, *texts]]
        said = "".join(f"\n{sentence}\n" for sentence in self.under)
        return f"{self.title}\n\n" + "".join(f"| {' | '.join(row)} |\n" for row in rows) + said

    def rich(self) -> Table:
        """Return the table for the terminal."""
        table = Table(title=escape(self.title), title_justify="left")
        for number, head in enumerate(self.header):
            table.add_column(escape(head), justify="right" if number else "left")
        for number, row in enumerate(self.rows):
            if number in self.lines:
                table.add_section()
            table.add_row(*map(_style_cell, row))
        return table


def _plain(text: str) -> str:
    return text.replace("\n", " ").replace("|", "\\|")


def _mark_cell(cell: Cell) -> str:
    text = _plain(cell.text)
    return f"**{text}**" if cell.best else text


def _style_cell(cell: Cell) -> str:
    text = escape(f"{cell.text} *" if cell.best else cell.text)  # visible also without colours
    style = "bold green" if cell.best else "bold red" if cell.lost else ""
    return f"[{style}]{text}[/]" if style and text else text
