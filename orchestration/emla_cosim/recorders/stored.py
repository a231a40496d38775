"""Read the table of a run that was kept in a folder."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
    """A table of results on disk: `names` of its columns, without time; sentences call it `what`."""

    path: Path
    names: Sequence[str]
    table: Table
    what: str = _REFERENCE

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Columns by name, `time` in s among them if it is named. Raises CommandError.

        Of more than `most` rows only every n-th may be given.
        """
        return readable(f"{self.what}, '{self.path}',", lambda: self.table.read(names, most))


def open_stored_run(place: Path, what: str = _REFERENCE) -> StoredRun:
    """The run in a folder of results, or in a table of its own; CommandError where there is none.

    Sentences call it `what`.
    """
    kept = [place / name for name in table_names()] if place.is_dir() else [place]
    path = next((p for p in kept if p.exists()), None)
    if path is None:
        missing = f"has no {' or '.join(table_names())}" if place.is_dir() else "is not there"
        raise CommandError(f"{what}, '{place}', {missing}.")
    if not path.is_file():
        raise CommandError(f"{what}, '{path}', cannot be read: it is no file.")
    table = TABLES[format_of(path)](path)
    readable(f"{what}, '{path}',", table.open)
    names = table.names
    if names[:1] != ["time"] or len(names) < 2:
        raise CommandError(f"{what}, '{path}', must have 'time' as its first column, and signals.")
    return StoredRun(path, names[1:], table, what)


def readable(label: str, read: Callable[[], _T]) -> _T:
    """Return what `read` returns; CommandError that begins with `label` for whatever it raises."""
    try:
        return read()
    except Exception as error:  # polars has many kinds
        reason = getattr(error, "strerror", None) or (str(error) or type(error).__name__).splitlines()[0]
        raise CommandError(f"{label} cannot be read: {reason.rstrip('.')}.") from error
