"""The registry of table formats and of optional recorders."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from .recorder import Recorder
from .table import Table


def _import_table(module: str, name: str) -> Callable[[Path], Table]:
    """Return a constructor that imports the module of the class on its first call."""
    return lambda path: getattr(import_module(f".{module}", __package__), name)(path)


TABLES: dict[str, Callable[[Path], Table]] = {
    "csv": _import_table("csv_file", "CsvFile"),
    "parquet": _import_table("parquet_file", "ParquetFile"),
}
"""Constructors of tables from a path, by format. The format is also the ending of the file name."""

DEFAULT_FORMAT = "csv"
"""Format of files with any other ending."""


def format_of(path: Path) -> str:
    """Return the format of a table by the ending of its name."""
    name = path.name.lower()
    return max(
        (table_format for table_format in TABLES if name.endswith(f".{table_format.lower()}")),
        key=len,
        default=DEFAULT_FORMAT,
    )


def table_names() -> list[str]:
    """Return the names that a table of results can have, one for each format."""
    return [f"results.{name}" for name in TABLES]


RECORDERS: dict[str, type[Recorder]] = {}
"""Optional recorders: dataclasses whose fields are options. A run has those whose options the user sets."""
