"""results.csv: the FMI cross-check form, first column `time`."""

from pathlib import Path

import numpy as np
import polars

from ..master.slave import Vector


class CsvFile:
    """Writes every n-th row, and the last one, to a CSV file as they come.

    Numbers have the digits that bring back the same double.
    """

    def __init__(self, path: Path, names: list[str], every: int) -> None:
        """Create the file with its header; raises OSError."""
        self._columns = ["time", *names]
        self._every = every
        self._seen = 0
        self._last: Vector | None = None
        self._stream = path.open("wb")
        self._stream.write((",".join(_quoted(c) for c in self._columns) + "\n").encode())

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


def _quoted(name: str) -> str:
    return f'"{name}"' if "," in name or '"' in name else name


def read_results(path: Path, names: list[str]) -> dict[str, Vector]:
    """Columns of a results.csv by name; a name that the file does not have is left out."""
    present = polars.read_csv(path, n_rows=0).columns
    chosen = [n for n in names if n in present]
    frame = polars.read_csv(path, columns=chosen, schema_overrides=dict.fromkeys(chosen, polars.Float64))
    return {name: frame[name].to_numpy() for name in chosen}
