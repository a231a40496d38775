"""The forms in which a table of results can be written, by name."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from .table import Table


def _imported(module: str, name: str) -> Callable[[Path], Table]:
    """A table of this class, whose module is imported when the first one is made."""
    return lambda path: getattr(import_module(f".{module}", __package__), name)(path)


TABLES: dict[str, Callable[[Path], Table]] = {
    "csv": _imported("csv_file", "CsvFile"),
    "parquet": _imported("parquet_file", "ParquetFile"),
}
"""What makes a table of a path, by the name of its form, which is also the ending of the file's name."""
