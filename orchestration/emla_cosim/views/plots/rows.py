"""Rows of a table that a plot shows."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from ...base.arrays import Vector

MOST_ROWS = 200_000
"""Of longer tables plots show only every n-th row."""


class Table(Protocol):
    """What has columns of rows."""

    def read(self, names: Sequence[str], most: int | None = None) -> Mapping[str, Vector]:
        """Return columns by name, at most this many rows of them."""
        ...


def read_rows(table: Table, names: Sequence[str]) -> tuple[dict[str, Vector], str]:
    """Return columns and `time` by name, and a note on rows that are left out, empty if none is."""
    data = dict(table.read(["time", *names], MOST_ROWS))
    shown = len(data["time"])
    if 2 * shown <= MOST_ROWS:  # a longer table would fill more than half
        return data, ""
    rows = len(table.read(["time"])["time"])
    return data, f"{shown:,} of {rows:,} rows drawn" if shown < rows else ""
