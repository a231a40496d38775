"""Write and read results.parquet, which also has the units of the signals."""

import contextlib
import json
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import polars

from ..base.arrays import COLUMN_TYPES, SignalType, Vector, read_types, write_types
from ..base.files import write_atomically
from ..base.units import COLUMN_UNITS
from .file_table import FileTable, frame_rows
from .recorder import RunLayout

_BLOCK = 2**20
"""Number of values in a block that is read."""

_PART_NAMES = re.compile(r"\d{6,}\.parquet|\.unfinished-[\w-]+")
"""Names of files that a run leaves in the folder of parts."""


class ParquetFile(FileTable):
    """Recorder that writes a table to a Parquet file.

    During the run, finished parts are in a folder beside the file, `results.parquet.parts`. At the end they
    become one file. Integers, Booleans and Strings have columns of their type; an enumeration has the numbers
    of its values, and the metadata has their names.

    Args:
        path: path of the file.
        overwrite: replace a file that emla did not write.

    Examples:
        >>> import emla_cosim as ec
        >>> result = ec.load("lift", stop_time=0.01).prepare().run(recorders=[ec.ParquetFile("rows.parquet")])
        >>> result["lift.plant.x_L"].shape
        (11,)
    """

    batch_rows, batch_seconds = sys.maxsize, 1.0  # each batch is a part of the file

    def __init__(self, path: str | Path, overwrite: bool = False) -> None:
        super().__init__(path, overwrite)
        self._parts = parts_of(self.path)

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Create the folder of parts. If the run continues another one, its earlier rows are the first part.

        Raises:
            OSError: The folder cannot be created, or has files that no run wrote.
            CommandError: The existing file was not written by a run.
        """
        self._begin_columns(layout, state)
        if state is not None and "kept" not in state:  # the earlier table has another format
            state = None
        earlier = self._read_earlier_rows(int(state["kept"])) if state is not None else None
        self._file = self.check_file()
        self._remove_parts()
        self._parts.mkdir()
        self._count = self._rows = 0
        if earlier is not None:  # before the file is removed, so that no kill loses its rows
            self._write_part(earlier)
            self.path.unlink(missing_ok=True)  # only a finished run has the file

    def _begin_columns(self, layout: RunLayout, state: Any = None) -> None:
        """Begin the columns, and the metadata with their units and types."""
        super().begin(layout, state)
        units = {n: str(layout.units[i]) for n, i in zip(self.names[1:], layout.recorded, strict=True)}
        self._metadata = {
            COLUMN_UNITS: json.dumps({"time": "s"} | {n: u for n, u in units.items() if u != "None"})
        }
        if self.types:
            self._metadata[COLUMN_TYPES] = json.dumps(write_types(self.types))

    def reopen(self, layout: RunLayout, rows: int) -> None:
        """Continue the parts that another process left; see `FileTable.reopen`."""
        self._begin_columns(layout, {"rows": rows})
        self._file = self.check_file()
        if self.path.is_file():  # it has the rows of parts that are already removed
            self._remove_parts()
            self._parts.mkdir()
            self.path.rename(self._parts / f"{0:06}.parquet")
        self._count, self._rows = len(self._list_parts()), self.count_stored()

    def count_stored(self) -> int:
        """Return the number of rows in the file, or in the parts before it is finished. Raises OSError."""
        files = [self.path] if self.path.is_file() else self._list_parts()
        with _convert_polars_errors():
            return int(polars.scan_parquet(files).select(polars.len()).collect().item()) if files else 0

    def blocks(self) -> Iterator[Vector]:
        """Yield the rows of the finished table. Raises OSError."""
        table, size = polars.scan_parquet(self.path), max(_BLOCK // len(self.names), 1)
        with _convert_polars_errors():
            for first in range(0, self._rows, size):
                yield frame_rows(table.slice(first, size).collect())

    def store(self, rows: Vector) -> None:
        """Write these rows as a part. Raises OSError."""
        self._write_part(self.frame(rows))

    def end(self) -> None:
        """Append the last row if it was not due, and join the parts to one file."""
        super().end()
        parts = self._list_parts()
        empty = polars.LazyFrame(schema=self.schema)
        table = polars.scan_parquet(parts) if parts else empty
        with _convert_polars_errors(), write_atomically(self.path, self._file.check_again) as stream:
            table.sink_parquet(stream, metadata=self._metadata)
        self._remove_parts()

    def is_ours(self, path: Path) -> bool:
        """Return whether a file is a Parquet file with the units of a run."""
        try:
            return '"time": "s"' in polars.read_parquet_metadata(path).get(COLUMN_UNITS, "")
        except polars.exceptions.PolarsError:
            return False

    def state_dict(self) -> Any:
        """Return the numbers of rows received and of rows in the parts."""
        return {**super().state_dict(), "kept": self._rows}

    def open(self) -> None:
        """Read the column names from the file. Raises OSError or errors of polars."""
        schema = polars.read_parquet_schema(self.path)
        self.names = list(schema)
        declared = read_types(polars.read_parquet_metadata(self.path).get(COLUMN_TYPES))
        texts = {n: SignalType("String") for n, kind in schema.items() if kind == polars.String}
        self.types = texts | {n: t for n, t in declared.items() if n in schema}
        self._rows = int(polars.scan_parquet(self.path).select(polars.len()).collect().item())

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Return columns by name, without those that the file does not have; see `Table.read`."""
        table = polars.scan_parquet(self.path)
        columns = [n for n in names if n in self.names]
        frame = table.select(columns)
        if most is not None:
            frame = frame.gather_every(max(-(-self._rows // most), 1))
        frame_read = frame.with_columns(polars.col(polars.String).fill_null("")).collect()
        return {
            column.name: (column if column.dtype == polars.String else column.cast(polars.Float64)).to_numpy()
            for column in frame_read
        }

    def _write_part(self, rows: polars.DataFrame) -> None:
        with _convert_polars_errors(), write_atomically(self._parts / f"{self._count:06}.parquet") as stream:
            rows.write_parquet(stream, compression="lz4", statistics=False)  # `end` compresses more
        self._count, self._rows = self._count + 1, self._rows + len(rows)

    def _list_parts(self) -> list[Path]:
        return sorted(self._parts.glob("*.parquet"))

    def _remove_parts(self) -> None:
        """Remove the folder of parts if it exists; OSError if it has files that no run wrote."""
        if (problem := explain_foreign_parts(self.path)) is not None:
            raise OSError(problem)
        if not self._parts.is_dir():
            return
        for part in list(self._parts.iterdir()):
            part.unlink()
        self._parts.rmdir()

    def _read_earlier_rows(self, rows: int) -> polars.DataFrame | None:
        """Return the first rows of an earlier run; None if it has other columns or too few rows."""
        for source in filter(None, (self.path, self._list_parts())):  # a file, or parts of an interrupted run
            try:
                earlier_rows = polars.read_parquet(source)
            except (OSError, polars.exceptions.PolarsError):
                continue
            if list(earlier_rows.schema.items()) == list(self.schema.items()) and len(earlier_rows) >= rows:
                return earlier_rows.head(rows)
        return None


def parts_of(path: Path) -> Path:
    """Return the folder of parts of a table."""
    return path.with_name(f"{path.name}.parts")


def explain_foreign_parts(path: Path) -> str | None:
    """Return why a table's folder of parts is not one of a run; None if it is, or does not exist.

    Raises:
        OSError: The folder cannot be read.
    """
    parts = parts_of(path)
    if parts.is_symlink() or (parts.exists() and not parts.is_dir()):
        return f"'{parts}' is not a folder of a run; move it away"
    entries = list(parts.iterdir()) if parts.is_dir() else []
    unexpected = sorted(
        p.name for p in entries if not (_PART_NAMES.fullmatch(p.name) and p.is_file() and not p.is_symlink())
    )
    return f"no run wrote '{unexpected[0]}' in the folder '{parts}'; move it away" if unexpected else None


@contextlib.contextmanager
def _convert_polars_errors() -> Iterator[None]:
    """Turn errors of polars into OSError."""
    try:
        yield
    except polars.exceptions.PolarsError as error:
        raise OSError(str(error).rpartition("error: ")[2]) from error  # the last part has the reason
