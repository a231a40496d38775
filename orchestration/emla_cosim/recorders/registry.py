"""Recorders by name: the formats of a table of results, and what else a user may ask for."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from .recorder import Recorder
from .table import Table


def _import_table(module: str, name: str) -> Callable[[Path], Table]:
    """A table of this class, whose module is imported when the first one is made."""
    return lambda path: getattr(import_module(f".{module}", __package__), name)(path)


TABLES: dict[str, Callable[[Path], Table]] = {
    "csv": _import_table("csv_file", "CsvFile"),
    "parquet": _import_table("parquet_file", "ParquetFile"),
}
"""What makes a table of a path, by the name of its format, which is also the ending of the file's name."""

DEFAULT_FORMAT = "csv"
"""Format of files with any other ending."""


def format_of(path: Path) -> str:
    """Return the format of a table by the ending of its name."""
    name = path.name.lower()
    return max((one for one in TABLES if name.endswith(f".{one.lower()}")), key=len, default=DEFAULT_FORMAT)


def table_names(stem: str = "results") -> list[str]:
    """Return the names that a table of results can have, one for each format."""
    return [f"{stem}.{name}" for name in TABLES]


RECORDERS: dict[str, type[Recorder]] = {}
"""Further recorders: dataclasses whose fields are options. One is made when an option of its is given."""
