"""Inputs as users write them: data, the signals that they drive, and settings."""

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fmublock.table import ENDS, INTERPOLATIONS

from ..base.arrays import Vector
from ..base.errors import CommandError, check_choice
from ..base.files import hash_if_readable
from ..base.option import FileOrObject
from ..base.quantities import parse_quantity
from ..base.units import find_unit
from ..recorders.registry import TABLES
from .measurement_files import MEASUREMENT_ENDINGS

_TEXTS = (".tsv", ".txt", ".dat")
"""File extensions read as CSV, beside those of `TABLES`."""

NAME = "input"
"""The name of a table's component; a second one is input_2."""

_OWN_NAME = re.compile(rf"{NAME}(?:_\d+)?")

SHIFT_TO_START = "start"
"""The value of `shift` with which the data begin at the start of the run."""

_DEFAULTS = {"time": None, "interpolation": "linear", "end": "hold", "shift": None}
_SETTINGS = tuple(_DEFAULTS)

_COMMA = re.compile(r",(?![^\[\]]*\])")
"""A comma between parts of an input, not one in an index such as `u[1,2]`."""


def table_endings() -> tuple[str, ...]:
    """Return the file extensions of tables."""
    return (*(f".{name.lower()}" for name in TABLES), *_TEXTS, *MEASUREMENT_ENDINGS)


def is_data(text: str) -> bool:
    """Return whether a text is an input with a file of data, such as `data.csv:interpolation=held`."""
    return _split_parts(text.strip()) is not None


def _split_parts(text: str) -> re.Match[str] | None:
    """Return a match with the `file` of an input and the `rest` of the text; None without such a file."""
    endings = "|".join(map(re.escape, table_endings()))
    return re.fullmatch(rf"(?P<file>.+?(?:{endings}))(?::(?P<rest>.*))?", text, re.IGNORECASE | re.DOTALL)


@dataclass(frozen=True)
class Column:
    """A column of data that drives a signal.

    Args:
        column: name of the column; it may contain the unit, "Force [kN]", and a derivative, "der(x [mm])".
        unit: unit of the values. Default: the one in the name, otherwise that of the signal.
        derivative: order of the time derivative to use, 0 to 2.

    Raises:
        CommandError: the order is not 0, 1 or 2.
    """

    column: str
    unit: str | None = None
    derivative: int = 0

    def __post_init__(self) -> None:
        if self.derivative not in (0, 1, 2):
            raise CommandError(
                f"the derivative of the column '{self.column}' has the order {self.derivative}; "
                "it must be 0, 1 or 2."
            )

    @classmethod
    def of_text(cls, text: str) -> "Column":
        """Return the column of this name."""
        return cls(text)

    def __str__(self) -> str:
        unit = f" [{self.unit}]" if self.unit is not None else ""
        return "der(" * self.derivative + self.column + unit + ")" * self.derivative


@dataclass(frozen=True)
class Input(FileOrObject):
    """Data over time that drive signals.

    Before the first row, the values of that row apply.

    Args:
        file: CSV, Parquet, MDF or TDMS file, or another format of `TABLES`.
        signals: column by full name of the signal that it drives. Default: columns drive the signals of the
            same name.
        columns: names or patterns of columns that drive the signals of the same name.
        time: column with the times, in s if it has no unit. Default: the column called time or t.
        interpolation: values between rows: held, linear or cubic.
        end: values after the last row: hold, repeat or stop (which ends the run).
        shift: time to add to the times, in s or with a unit, such as "-5 s"; with start, the first row is at
            the start of the run. With a time, numbers are never taken as seconds since 1970.
        data: instead of a file, a data frame of polars or pandas, or a mapping of names to arrays of shape
            (n,).

    Raises:
        CommandError: the arguments contradict each other.

    Examples:
        >>> import emla_cosim as ec
        >>> load = ec.Input(
        ...     data={"time": [0.0, 0.01], "force": [0.0, 5e3]}, signals={"lift.disturbance.F_L": "force"}
        ... )
        >>> result = ec.load("lift", input=[load], stop_time=0.01).prepare().run()
        >>> result.steps
        100
    """

    file: Path | None = None
    signals: Mapping[str, Column] = field(default_factory=dict)
    columns: Sequence[str] = ()
    time: str | None = None
    interpolation: str = "linear"
    end: str = "hold"
    shift: str | float | None = None
    data: Any = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            CommandError: If a field is invalid.
        """
        if self.file is not None:
            object.__setattr__(self, "file", Path(self.file))
        if (self.file is None) == (self.data is None):
            raise CommandError("an input needs either a file or, in Python, data.")
        if self.data is not None and not (isinstance(self.data, Mapping) or hasattr(self.data, "columns")):
            raise CommandError("the data of an input must be a frame, or a mapping of names to arrays.")
        signals = {s: c if isinstance(c, Column) else Column(str(c)) for s, c in self.signals.items()}
        object.__setattr__(self, "signals", signals)
        check_choice("interpolation", self.interpolation, INTERPOLATIONS)
        check_choice("end of an input", self.end, ENDS)
        self.shift_times(np.zeros(1), 0.0)  # raises CommandError if the shift is not a time

    @classmethod
    def of_text(cls, text: str) -> "Input":
        """Return the input that a text of the command line describes.

        Args:
            text: FILE, or FILE:SIGNAL=COLUMN,...,end=repeat.

        Raises:
            CommandError: the text cannot be read.
        """
        match = _split_parts(text.strip())
        if match is None or not match["rest"]:
            return cls(Path(match["file"] if match is not None else text.strip()))
        settings = dict[str, str]()
        signals: dict[str, Column] = {}
        columns = []
        for part in _COMMA.split(match["rest"]):
            name, equals, value = (x.strip() for x in part.partition("="))
            if not name or (equals and not value):
                raise CommandError(
                    f"the input '{text}' cannot be read; write FILE:SIGNAL=COLUMN,...,end=repeat, such as "
                    "measured.csv:lift.disturbance.F_L=Force."
                )
            if equals and name in (settings.keys() | signals.keys()):
                raise CommandError(f"the input '{text}' sets '{name}' twice; remove one.")
            if not equals:
                columns.append(name)
            elif name in _SETTINGS:
                settings[name] = value
            else:
                signals[name] = Column(value)
        return cls(Path(match["file"]), signals, columns, **settings)

    def shift_times(self, times: Vector, start: float) -> Vector:
        """Return times of the data in the time of a run.

        Args:
            times: Times in the data in s, shape (n,).
            start: The start of the run in s.

        Raises:
            CommandError: If the shift is not a time.
        """
        if self.shift is None:
            return times
        if self.shift == SHIFT_TO_START:
            return times - times[0] + start
        shift = parse_quantity(str(self.shift), f"the shift of {self.label}, a time or {SHIFT_TO_START},")
        return times + shift.in_unit(find_unit("s"), f"the shift of {self.label}")

    def within(self, folder: Path) -> "Input":
        """Return the input with its file in a folder; that of an absolute path stays."""
        return self if self.file is None else dataclasses.replace(self, file=folder / self.file)

    @property
    def label(self) -> str:
        """Name of the input in messages."""
        return f"the input '{self.file}'" if self.file is not None else "the input of data"

    @property
    def is_text(self) -> bool:
        """Whether `str(self)` describes the input completely."""
        if self.file is None:
            return False
        read = Input.of_text(str(self))
        return (read.file, read._list_settings()) == (self.file, self._list_settings())

    def __str__(self) -> str:
        settings = {name: getattr(self, name) for name in _SETTINGS}
        parts = [*(f"{s}={c}" for s, c in self.signals.items()), *self.columns]
        parts += [f"{name}={x}" for name, x in settings.items() if x != _DEFAULTS[name]]
        return f"{self.file}:{','.join(parts)}" if parts else str(self.file)

    def record(self) -> dict[str, Any]:
        """Return the entry of run.json; its SHA-256 is None if the file cannot be read."""
        if self.file is None:
            return {"data": "given in Python", **self._list_settings()}
        return {"file": str(self.file), "sha256": hash_if_readable(self.file), **self._list_settings()}

    def repeatable(self) -> dict[str, Any] | None:
        """Return the value of the option that repeats the input; None for data in Python."""
        return None if self.file is None else {"file": str(self.file), **self._list_settings()}

    def _list_settings(self) -> dict[str, Any]:
        """Return signals, columns and settings as plain data by name, without the data."""
        signals = {s: str(c) for s, c in self.signals.items()}
        settings = {n: getattr(self, n) for n in _SETTINGS if n != "shift" or self.shift is not None}
        return {"signals": signals, "columns": list(self.columns), **settings}


def find_data_names(names: Iterable[str]) -> dict[str, str]:
    """Return the names of data signals by the signal that they replace.

    Args:
        names: The names to search.
    """
    signals: dict[str, str] = {}
    for name in names:
        if name.startswith(NAME):
            component, _, signal = name.partition(".")
            if _OWN_NAME.fullmatch(component):
                signals.setdefault(signal, name)
    return signals
