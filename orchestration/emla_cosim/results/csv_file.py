"""results.csv: the FMI cross-check form, first column `time`."""

import contextlib
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from pathlib import Path

import numpy as np
import polars

from ..master.slaves.slave import Vector

_BLOCK = 2**20


@dataclass(frozen=True)
class Position:
    """How far a results.csv is: rows that came, due or not, bytes of those that were due, the last line."""

    rows: int
    bytes: int
    line: str


class CsvFile:
    """Writes every n-th row, and the last one, to a CSV file as they come.

    Numbers have the digits that bring back the same double. A file that comes past `after`, where an
    earlier run of the same columns was put aside, is cut there and continued; without such a file
    a new one begins with the rows that follow.
    """

    def __init__(self, path: Path, names: list[str], every: int, after: Position | None = None) -> None:
        """Create the file with its header, or open it to continue; raises OSError."""
        self._columns = ["time", *names]
        self._every = every
        self._last: Vector | None = None
        header = (",".join(_quoted(c) for c in self._columns) + "\n").encode()
        self._seen = after.rows if after is not None else 0
        if after is not None and _continues(path, header, after):
            self._stream = path.open("r+b", buffering=0)
            self._stream.truncate(after.bytes)
            self._stream.seek(after.bytes)
            self._length, self._line = after.bytes, after.line
        else:
            self._stream = path.open("wb", buffering=0)
            self._length, self._line = 0, ""
            self._write_lines(header)

    @property
    def position(self) -> Position:
        """How far the file is, to continue it from here."""
        return Position(self._seen, self._length, self._line)

    def write(self, rows: Vector) -> None:
        """Append those of the rows that are due."""
        due = -self._seen % self._every
        self._last = None
        self._append(rows[due :: self._every])
        self._seen += len(rows)
        self._last = None if (self._seen - 1) % self._every == 0 else rows[-1:].copy()

    def close(self) -> None:
        """Append the last row if it was not due, and close the file."""
        try:
            if self._last is not None:
                self._append(self._last)
        finally:
            self._stream.close()

    def _append(self, rows: Vector) -> None:
        if len(rows):
            frame = polars.from_numpy(np.ascontiguousarray(rows), schema=self._columns)
            text = BytesIO()
            frame.write_csv(text, include_header=False)
            self._write_lines(text.getvalue())

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


def _continues(path: Path, header: bytes, after: Position) -> bool:
    """Whether a file has these columns and was at this position once."""
    line = after.line.encode()
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        begins = stream.read(len(header)) == header
        stream.seek(max(after.bytes - len(line), 0))
        return begins and stream.read(len(line)) == line


def _quoted(name: str) -> str:
    return f'"{name}"' if "," in name or '"' in name else name


def read_results(path: Path, names: list[str], most: int | None = None) -> dict[str, Vector]:
    """Columns of a results.csv by name; a name that the file does not have is left out.

    Of a file with more than `most` rows only every n-th row is kept, so that memory stays small.
    """
    present = polars.read_csv(path, n_rows=0).columns
    chosen = [n for n in names if n in present]
    every = 1 if most is None else max(-(-(_lines(path) - 1) // most), 1)
    source = path if every == 1 else _thinned(path, every)
    frame = polars.read_csv(source, columns=chosen, schema_overrides=dict.fromkeys(chosen, polars.Float64))
    return {name: frame[name].to_numpy() for name in chosen}


def _lines(path: Path) -> int:
    with path.open("rb") as stream:
        return sum(block.count(b"\n") for block in iter(lambda: stream.read(_BLOCK), b""))


def _thinned(path: Path, every: int) -> bytes:
    """The header, and of the lines after it every n-th one."""
    with path.open("rb") as stream:
        return next(stream) + b"".join(islice(stream, 0, None, every))
