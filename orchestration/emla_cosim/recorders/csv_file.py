"""results.csv: the FMI cross-check form, first column `time`."""

import contextlib
import csv
import os
from collections.abc import Sequence
from io import BytesIO, StringIO
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.files import real_place
from .file_table import FileTable
from .recorder import Outline

_BLOCK = 2**20


class CsvFile(FileTable):
    """Recorder that writes a table to a CSV file during the run, line by line.

    Numbers have as many digits as are needed to read back the same double. A run that continues another one
    continues its file.

    Args:
        path: path of the file.
        overwrite: replace a file that emla did not write.

    Examples:
        >>> import emla_cosim as ec
        >>> result = ec.load("lift", stop_time=0.01).prepare().run(recorders=[ec.CsvFile("rows.csv")])
        >>> result["lift.plant.x_L"].shape
        (11,)
    """

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Create the file with its header, or open it to continue.

        Raises OSError; CommandError for a file that is somebody else's.
        """
        super().begin(outline, memory)
        header = polars.DataFrame(schema=dict.fromkeys(self.names, polars.Float64)).write_csv().encode()
        real_place(self.path)  # a device or a folder is no place for it
        length, line = (int(memory["bytes"]), str(memory["line"])) if memory is not None else (0, "")
        continued = memory is not None and _can_continue(self.path, header, length, line.encode())
        self.claim(continued)
        if continued:
            self._stream = self.path.open("r+b", buffering=0)
            self._stream.truncate(length)
            self._stream.seek(length)
            self._length, self._line = length, line
        else:
            self._stream = self.path.open("wb", buffering=0)
            self._length, self._line = 0, ""
            self._write_lines(header)

    def end(self) -> None:
        """Append the last row if it was not due, and close the file.

        Raises OSError, also where the rows went to a file that is no more at its place.
        """
        try:
            super().end()
            if not self._in_place():
                raise OSError(0, "it was removed or replaced while the run wrote to it")
        finally:
            self._stream.close()
        self.settle()

    def memory(self) -> Any:
        """How far the file is: rows that came, bytes of those that were due, the last line."""
        return {**super().memory(), "bytes": self._length, "line": self._line}

    def append(self, rows: Vector) -> None:
        """Write these rows."""
        text = BytesIO()
        frame = polars.from_numpy(np.ascontiguousarray(rows), schema=self.names)
        frame.write_csv(text, include_header=False)
        self._write_lines(text.getvalue())

    def open(self) -> None:
        """Take the names of the columns from the file. Raises OSError."""
        self.names = read_column_names(self.path)

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Columns by name; one that the file does not have is left out."""
        return read_csv(self.path, names, most)

    def _in_place(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._stream.fileno()), self.path.stat())
        except OSError:
            return False

    def _write_lines(self, text: bytes) -> None:
        """Append whole lines; where not all of them fit, those that do, and none in part."""
        written = 0
        try:
            while written < len(text):
                written += self._stream.write(memoryview(text)[written:]) or 0
        except OSError:
            written = text.rfind(b"\n", 0, written) + 1
            with contextlib.suppress(OSError):  # a device cannot be cut
                self._stream.seek(self._stream.truncate(self._length + written))
            raise
        finally:
            self._length += written
            self._line = text[text.rfind(b"\n", 0, max(written - 1, 0)) + 1 : written].decode() or self._line


def _can_continue(path: Path, header: bytes, length: int, line: bytes) -> bool:
    """Whether a file has these columns and was once of this length, with this last line."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        begins = stream.read(len(header)) == header
        stream.seek(max(length - len(line), 0))
        return begins and stream.read(len(line)) == line


def read_csv(path: Path, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
    """Columns of a results.csv by name; a name that the file does not have is left out.

    Of a file with more than `most` rows only every n-th row is kept, so that memory stays small.
    """
    with path.open("rb") as stream:
        header = _header(stream)
    present = _names(header)
    columns = {name: f"column_{i}" for i, name in enumerate(present)}
    chosen = {n: columns[n] for n in names if n in columns}
    every = 1 if most is None else max(-(-(_lines(path) - header.count(b"\n")) // most), 1)
    source = path if most is None else _thin_lines(path, every)
    frame = polars.read_csv(  # whose own reading of a header leaves quotes doubled
        source,
        has_header=False,
        skip_rows=1,
        columns=list(chosen.values()),
        schema=dict.fromkeys(columns.values(), polars.Float64),
    )
    return {name: frame[column].to_numpy() for name, column in chosen.items()}


def read_column_names(path: Path) -> list[str]:
    """The names of the columns of a results.csv. Raises OSError; UnicodeDecodeError where it is no text."""
    with path.open("rb") as stream:
        return _names(_header(stream))


def _names(header: bytes) -> list[str]:
    return next(csv.reader(StringIO(header.decode("utf-8-sig"), newline="")), [])


def _header(stream: IO[bytes]) -> bytes:
    """The first row of a file, of more than one line where a name has an end of line in it."""
    header = stream.readline()
    while header.count(b'"') % 2 and (line := stream.readline()):
        header += line
    return header


def _lines(path: Path) -> int:
    with path.open("rb") as stream:
        return sum(block.count(b"\n") for block in iter(lambda: stream.read(_BLOCK), b""))


def _thin_lines(path: Path, every: int) -> bytes:
    """The header, and of the lines after it every n-th one, but not one that is still being written."""
    with path.open("rb") as stream:
        header = _header(stream)
        rows = stream.read() if every == 1 else b"".join(islice(stream, 0, None, every))
    return header + rows[: rows.rfind(b"\n") + 1]
