"""Read the table of an earlier run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from ..base.arrays import Vector
from ..base.errors import CommandError
from .registry import TABLES, format_of, table_names
from .table import Table

_T = TypeVar("_T")

_REFERENCE = "the run to compare with"


@dataclass(frozen=True)
class StoredRun:
    """A table of results on disk.

    Args:
        path: The file.
        names: Names of the columns, without time.
        table: The opened table.
        what: Name of the run in error messages.
        prefix: Text that `names` have and the columns of the table lack.
    """

    path: Path
    names: Sequence[str]
    table: Table
    what: str = _REFERENCE
    prefix: str = ""

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Return columns by name, without those that the table does not have.

        Args:
            names: Names of the columns; `time` is in s.
            most: If the table has more rows, only every n-th row may be returned.

        Raises:
            CommandError: The file cannot be read.
        """
        columns = [name.removeprefix(self.prefix) for name in names]
        found = readable(f"{self.what}, '{self.path}',", lambda: self.table.read(columns, most))
        return {name: found[column] for name, column in zip(names, columns, strict=True) if column in found}

    def of_component(self, component: str) -> "StoredRun":
        """Return the table with the names of a system of one component, if it has those of its variables."""
        prefix = f"{component}."
        if any(name.startswith(prefix) for name in self.names):
            return self
        return replace(self, names=[f"{prefix}{name}" for name in self.names], prefix=prefix)


def open_stored_run(place: Path, what: str = _REFERENCE) -> StoredRun:
    """Open the table of an earlier run.

    Args:
        place: A folder of results, or a table.
        what: Name of the run in error messages.

    Raises:
        CommandError: There is no table, or it cannot be read.
    """
    kept = [place]
    if place.is_dir():  # a run's output, or the one reference of an FMU in the layout of the cross-check
        solutions = sorted(place.glob("*_ref.csv"))
        kept = [*(place / name for name in table_names()), *(solutions if len(solutions) == 1 else [])]
    path = next((p for p in kept if p.exists()), None)
    if path is None:
        missing = f"has no {' or '.join(table_names())}" if place.is_dir() else "does not exist"
        raise CommandError(f"{what}, '{place}', {missing}.")
    if not path.is_file():
        raise CommandError(f"{what}, '{path}', cannot be read: it is not a file.")
    table = TABLES[format_of(path)](path)
    readable(f"{what}, '{path}',", table.open)
    names = table.names
    if names[:1] != ["time"] or len(names) < 2:
        raise CommandError(f"{what}, '{path}', must have 'time' as its first column, and signals.")
    return StoredRun(path, names[1:], table, what)


def readable(label: str, read: Callable[[], _T]) -> _T:
    """Return the result of `read`. Turn all its errors into a CommandError that begins with `label`."""
    try:
        return read()
    except Exception as error:  # polars raises errors of many types
        reason = getattr(error, "strerror", None) or (str(error) or type(error).__name__).splitlines()[0]
        raise CommandError(f"{label} cannot be read: {reason.rstrip('.')}.") from error
