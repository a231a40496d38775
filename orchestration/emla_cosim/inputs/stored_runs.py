"""Tables of earlier runs and references."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..base.arrays import REAL, SignalType, Vector
from ..base.errors import CommandError
from ..base.output_files import UNFINISHED_STATUS
from ..base.units import SiUnit
from ..recorders.registry import table_names
from .data_tables import DataTable
from .loaded_input import read_times
from .table_files import read_table

_REFERENCE = "the run to compare with"


@dataclass(frozen=True)
class StoredRun:
    """A table of results on disk.

    Attributes:
        path: The file.
        data: Its table.
        time: The position of the column of times.
        times: The times in s, shape (n,).
        prefix: Text that names of signals have and the columns lack.
    """

    path: Path
    data: DataTable
    time: int
    times: Vector
    prefix: str = ""

    @property
    def names(self) -> list[str]:
        """The names of the columns, without time."""
        return [self.prefix + h.name for i, h in enumerate(self.data.headers) if i != self.time and h.name]

    @property
    def units(self) -> dict[str, str]:
        """The names of units by signal, as far as the table has them."""
        return {self.prefix + h.name: h.unit for h in self.data.headers if h.unit is not None}

    @property
    def types(self) -> dict[str, SignalType]:
        """The types of signals, as far as the table has them."""
        return {self.prefix + name: type_ for name, type_ in self.data.types.items()}

    @property
    def notes(self) -> list[str]:
        """What users should know of how it was read, as sentences."""
        return [f"{self.data.label} {note}." for note in self.data.notes]

    def read(
        self,
        names: Sequence[str],
        most: int | None = None,
        units: Mapping[str, SiUnit | None] | None = None,
        types: Mapping[str, SignalType] | None = None,
    ) -> dict[str, Any]:
        """Return columns by name, without those that the table does not have.

        Args:
            names: Names of the columns; `time` is in s.
            most: If the table has more rows, only every n-th row is returned.
            units: Units to convert columns to. Default: those of the table.
            types: Types of the columns. Default: those of the table.

        Returns:
            An array of shape (rows,) by name: of doubles, or of texts for a String.

        Raises:
            CommandError: The file cannot be read, or has other units or types.
        """
        positions = {self.prefix + h.name: i for i, h in enumerate(self.data.headers) if i != self.time}
        positions = {name: positions[name] for name in names if name in positions}
        types = self.types if types is None else types
        self.data.load([p for name, p in positions.items() if types.get(name, REAL).kind == "Real"])
        stride = 1 if most is None else max(-(-len(self.times) // most), 1)
        columns: dict[str, Any] = {"time": self.times[::stride]}
        for name, position in positions.items():
            type_ = types.get(name, REAL)
            if type_.kind == "Real":
                unit = None if units is None else units.get(name)
                values, _ = self.data.in_unit(position, name, unit, has_gaps=True)
            else:
                values = self.data.values(position, type_, has_gaps=True)
            columns[name] = values[::stride]
        return {name: columns[name] for name in names if name in columns}

    def match_names(self, names: Sequence[str]) -> None:
        """Give columns with the elements of arrays in each cell the names of these signals."""
        self.data.match_names(dict.fromkeys(names), self.prefix)

    def of_component(self, component: str) -> "StoredRun":
        """Return the table with the names of a system of one component, if it has those of its variables."""
        prefix = f"{component}."
        if any(name.startswith(prefix) for name in self.names):
            return self
        return replace(self, prefix=prefix)


def open_stored_run(folder: Path, subject: str = _REFERENCE, start: float = 0.0) -> StoredRun:
    """Open the table of an earlier run.

    Args:
        folder: A folder of results, or a table.
        subject: Name of the run in error messages.
        start: The start time in s of the run that is compared with it.

    Raises:
        CommandError: There is no table, or it cannot be read.
    """
    candidates = [folder]
    if folder.is_dir():  # a run's output, or the one reference of an FMU in the layout of the cross-check
        solutions = sorted(folder.glob("*_ref.csv"))
        candidates = [*(folder / name for name in table_names()), *(solutions if len(solutions) == 1 else [])]
    path = next((p for p in candidates if p.exists()), None)
    if path is None:
        missing = f"has no {' or '.join(table_names())}" if folder.is_dir() else "does not exist"
        raise CommandError(f"{subject}, '{folder}', {missing}.")
    if not path.is_file():
        raise CommandError(f"{subject}, '{path}', cannot be read: it is not a file.")
    is_result = path.name in table_names()
    data = read_table(path, subject, is_result=is_result)
    if is_result and _is_unfinished(path.parent):
        data.notes.append("has only the rows so far of a run that has not finished")
    if len(data.headers) < 2:
        raise CommandError(f"{subject}, '{path}', must have a column of times, and signals.")
    return StoredRun(path, data, *read_times(data, start=start, is_raw=is_result, least=0))


def _is_unfinished(folder: Path) -> bool:
    """Return whether the run.json in a folder says that its run has not finished."""
    try:
        record = json.loads((folder / "run.json").read_bytes())
    except (OSError, ValueError, RecursionError):  # a table without a readable record is complete
        return False
    return isinstance(record, dict) and record.get("status") == UNFINISHED_STATUS
