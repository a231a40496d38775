"""results.csv: the FMI cross-check form, first column `time`."""

from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import polars

from ..master.slaves.slave import Vector

_BLOCK = 2**20


@dataclass(frozen=True)
class Position:
    """How far a results.csv is: rows that came, due or not, and bytes of those that were due."""

    rows: int
    bytes: int


class CsvFile:
    """Writes every n-th row, and the last one, to a CSV file as they come.

    Numbers have the digits that bring back the same double. A file that reaches `after`, where an
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
        if after is not None and _continues(path, header, after.bytes):
            self._stream = path.open("r+b")
            self._stream.truncate(after.bytes)
            self._stream.seek(after.bytes)
        else:
            self._stream = path.open("wb")
            self._stream.write(header)

    @property
    def position(self) -> Position:
        """How far the file is, to continue it from here."""
        return Position(self._seen, self._stream.tell())

    def write(self, rows: Vector) -> None:
        """Append those of the rows that are due."""
        due = -self._seen % self._every
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
            frame.write_csv(self._stream, include_header=False)
            self._stream.flush()


def _continues(path: Path, header: bytes, length: int) -> bool:
    """Whether a file has these columns and is at least so long."""
    if not path.is_file() or path.stat().st_size < length:
        return False
    with path.open("rb") as stream:
        return stream.read(len(header)) == header


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
