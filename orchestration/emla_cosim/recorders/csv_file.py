"""Write and read results.csv, in the format of the FMI cross-check: the first column is `time`."""

import contextlib
import csv
import os
from collections.abc import Iterator, Sequence
from io import BytesIO, StringIO
from pathlib import Path
from typing import IO, Any

import polars

from ..base.arrays import Vector
from .file_table import FileTable, frame_rows
from .recorder import RunLayout

_BLOCK = 2**22


class CsvFile(FileTable):
    r"""Recorder that writes a table to a CSV file during the run, line by line.

    Numbers have as many digits as are needed to read back the same double. A run that continues another one
    continues its file. Integers have no decimal point, Booleans are 0 or 1, enumerations the numbers of their
    values. Texts are quoted; a line break in one is written as \n.

    Args:
        path: path of the file.
        overwrite: replace a file that emla did not write.

    Examples:
        >>> import emla_cosim as ec
        >>> result = ec.load("lift", stop_time=0.01).prepare().run(recorders=[ec.CsvFile("rows.csv")])
        >>> result["lift.plant.x_L"].shape
        (11,)
    """

    batch_rows, batch_seconds = 2000, 0.2  # with fewer rows, most of the time goes into the columns

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Create the file with its header, or open it to continue.

        Raises:
            OSError: The file cannot be written.
            CommandError: The existing file was not written by a run.
        """
        super().begin(layout, state)
        self.check_file()
        if state is not None and "bytes" not in state:  # the earlier table has another format
            state = None
        length, line = (int(state["bytes"]), str(state["line"])) if state is not None else (0, "")
        continued = state is not None and _can_continue(self.path, self._header, length, line.encode())
        if continued:
            self._stream = self.path.open("r+b", buffering=0)
            self._stream.truncate(length)
            self._stream.seek(length)
            self._length, self._line = length, line
        else:
            self.path.unlink(missing_ok=True)
            self._stream = self.path.open("xb", buffering=0)  # "x": a file that appears now stays
            self._length, self._line = 0, ""
            self._write_lines(self._header)

    @property
    def _header(self) -> bytes:
        return polars.DataFrame(schema=dict.fromkeys(self.names, polars.Float64)).write_csv().encode()

    @property
    def _text_types(self) -> dict[str, type[polars.DataType]]:
        return {n: polars.String for n, signal_type in self.types.items() if signal_type.is_text}

    def is_ours(self, path: Path) -> bool:
        """Return whether a file has the columns that this run writes."""
        with path.open("rb") as stream:
            return stream.read(len(self._header)) == self._header

    def end(self) -> None:
        """Append the last row if it was not due, and close the file.

        Raises:
            OSError: The file cannot be written, or was removed or replaced during the run.
        """
        try:
            super().end()
        finally:
            in_place = self._is_in_place()
            self._stream.close()
        if not in_place:
            raise OSError(0, "it was removed or replaced while the run wrote to it")

    def state_dict(self) -> Any:
        """Return the number of rows received, the length of the file in bytes, and its last line."""
        return {**super().state_dict(), "bytes": self._length, "line": self._line}

    def reopen(self, layout: RunLayout, rows: int) -> None:
        """Continue the file that another process left, after its last whole line; see `FileTable.reopen`."""
        super().begin(layout, {"rows": rows})
        self._stream = self.path.open("r+b", buffering=0)
        self._length = _measure_lines(self._stream)
        self._stream.seek(self._stream.truncate(self._length))
        self._line = ""

    def count_stored(self) -> int:
        """Return the number of whole rows in the file. Raises OSError."""
        with self.path.open("rb") as stream:
            _read_header(stream)
            return sum(block.count(b"\n") for block in iter(lambda: stream.read(_BLOCK), b""))

    def blocks(self) -> Iterator[Vector]:
        """Yield the rows of the whole table. Raises OSError."""
        with self.path.open("rb") as stream:
            _read_header(stream)
            while lines := stream.readlines(_BLOCK):
                schema = dict.fromkeys(self.names, polars.Float64) | self._text_types
                yield frame_rows(polars.read_csv(b"".join(lines), has_header=False, schema=schema))

    def append(self, rows: Vector) -> None:
        """Store rows, those with texts at once: texts are in this process only. Raises OSError."""
        if self._text_types:
            self.store(rows)
        else:
            super().append(rows)

    def store(self, rows: Vector) -> None:
        """Write these rows. Raises OSError."""
        text = BytesIO()
        frame = self.frame(rows)
        frame = frame.with_columns(
            polars.col(polars.Boolean).cast(polars.Int8),
            polars.col(polars.String)
            .str.replace_all("\r", "\\r", literal=True)
            .str.replace_all("\n", "\\n", literal=True),
        )
        # quotes tell texts from numbers; without texts the style makes no difference
        frame.write_csv(text, include_header=False, quote_style="non_numeric")
        self._write_lines(text.getvalue())

    def open(self) -> None:
        """Read the column names from the file. Raises OSError."""
        with self.path.open("rb") as stream:
            self.names = next(csv.reader(StringIO(_read_header(stream).decode("utf-8-sig"), newline="")), [])

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Return columns by name, without those that the file does not have; see `Table.read`."""
        self.drain()
        columns = {name: f"column_{i}" for i, name in enumerate(self.names)}
        types = dict.fromkeys(self.names, polars.Float64) | self._text_types
        with self.path.open("rb") as stream:
            lines = _read_header(stream).count(b"\n")  # polars keeps doubled quotes in names
        table = polars.scan_csv(
            self.path,
            has_header=False,
            skip_lines=lines,
            schema={column: types[name] for name, column in columns.items()},
        ).select([columns[n] for n in names if n in columns])
        if most is not None:
            table = table.gather_every(max(-(-self.count_stored() // most), 1))
        frame = table.collect()
        return {n: frame[columns[n]].to_numpy() for n in names if n in columns}

    def _is_in_place(self) -> bool:
        """Return whether the open file is still the one at the path."""
        try:
            return os.path.samestat(os.fstat(self._stream.fileno()), self.path.stat())
        except OSError:
            return False

    def _write_lines(self, text: bytes) -> None:
        """Append whole lines. If the disk is full, keep the lines that fit, without an incomplete one."""
        written = 0
        try:
            while written < len(text):
                written += self._stream.write(memoryview(text)[written:]) or 0
        except OSError:
            written = text.rfind(b"\n", 0, written) + 1
            with contextlib.suppress(OSError):  # a device cannot be truncated
                self._stream.seek(self._stream.truncate(self._length + written))
            raise
        finally:
            self._length += written
            self._line = text[text.rfind(b"\n", 0, max(written - 1, 0)) + 1 : written].decode() or self._line


def _can_continue(path: Path, header: bytes, length: int, line: bytes) -> bool:
    """Whether a file has this header, and this line before this length in bytes."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        begins = stream.read(len(header)) == header
        stream.seek(max(length - len(line), 0))
        return begins and stream.read(len(line)) == line


def _read_header(stream: IO[bytes]) -> bytes:
    """Read the first row of a file. It has several lines if a name contains line breaks."""
    header = stream.readline()
    while header.count(b'"') % 2 and (line := stream.readline()):
        header += line
    return header


def _measure_lines(stream: IO[bytes]) -> int:
    """Return the length of a file up to its last line break."""
    end = stream.seek(0, os.SEEK_END)
    while end > 0:
        begin = stream.seek(max(end - _BLOCK, 0))
        if (last := stream.read(end - begin).rfind(b"\n")) >= 0:
            return begin + last + 1
        end = begin
    return 0
