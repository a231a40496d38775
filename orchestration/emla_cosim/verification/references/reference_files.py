"""Read reference files in the format of the FMI cross-check.

`<Model>_ref.csv` is the solution, `<Model>_in.csv` has the inputs, if there are any, and
`<Model>_ref.opt` has times. `<Model>_ref.toml` has start values (`set`), the width of tubes (`tolerance`),
and the origin of the reference (`made_by`).
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.files import read_text
from ...base.values import convert_value
from ...recorders.tubes.tolerance import Tolerance, parse_tolerances

_OPTIONS = ("StartTime", "StopTime", "StepSize", "OutputIntervalLength")
"""Entries of `_ref.opt` for the run, all in s. A step of 0 means that the solver chooses it."""

_KEYS = ("made_by", "set", "tolerance")


@dataclass(frozen=True)
class ReferenceSolution:
    """A reference solution with its inputs and settings.

    Attributes:
        folder: Folder of the files.
        solution: Columns by name, `time` in s first.
        inputs: Columns by name, `time` in s first; empty if there are none.
        start: Start time in s.
        stop: Stop time in s.
        step: Communication step in s; None if the files have none.
        interval: Time in s between rows of the solution, if longer than `step`; None if the files have none.
        start_values: Start values by name.
        tolerance: Tolerances by name or pattern.
        made_by: Origin of the reference.
    """

    folder: Path
    solution: Mapping[str, Vector]
    inputs: Mapping[str, Vector]
    start: float
    stop: float
    step: float | None
    interval: float | None = None
    start_values: Mapping[str, Any] = field(default_factory=dict)
    tolerance: Mapping[str, Tolerance] = field(default_factory=dict)
    made_by: str = ""


def reference_folder(fmu: Path, given: Path | None) -> Path | None:
    """Return the folder with the references of an FMU, or None.

    Look in `given` and in its subfolder with the FMU's name; by default in the FMU's folder and its parent.
    """
    around = (fmu.parent, fmu.parent.parent) if given is None else (given, given / fmu.stem)
    return next((f for f in around if solution_file(f, fmu.stem).is_file()), None)


def solution_file(folder: Path, name: str) -> Path:
    """Return the path of the solution."""
    return folder / f"{name}_ref.csv"


def read_reference(folder: Path, name: str) -> ReferenceSolution:
    """Read the reference files with this name. Raise CommandError if they are invalid."""
    solution = read_columns(solution_file(folder, name), "the reference")
    given = folder / f"{name}_in.csv"
    options = _options(folder / f"{name}_ref.opt")
    about = _about(folder / f"{name}_ref.toml")
    time = solution["time"]
    step = options.get("StepSize", 0.0) or options.get("OutputIntervalLength", 0.0)
    return ReferenceSolution(
        folder=folder,
        solution=solution,
        inputs=read_columns(given, "the inputs") if given.is_file() else {},
        start=options.get("StartTime", float(time[0])),
        stop=options.get("StopTime", float(time[-1])),
        step=step if step > 0.0 else None,
        interval=options.get("OutputIntervalLength"),
        **about,
    )


def read_columns(path: Path, what: str) -> dict[str, Vector]:
    """Read the columns of a CSV file by name, `time` first.

    Args:
        path: The file.
        what: Name of the file in messages: `the inputs`.

    Raises:
        CommandError: The file is not a table of numbers, or times decrease. Times of events may repeat.
    """
    from ...recorders.csv_file import (  # loads polars, which FMUs without references do not need
        read_column_names,
        read_csv,
    )

    try:
        found = read_csv(path, read_column_names(path))
    except OSError as error:
        raise CommandError(f"{what} '{path}' cannot be read: {error.strerror or error}.") from error
    except Exception as error:  # polars has many kinds
        raise CommandError(f"{what} '{path}' is not a table of numbers: {_line(error)}.") from error
    if next(iter(found), None) != "time":
        raise CommandError(f"{what} '{path}' must have 'time' as its first column.")
    time = found["time"]
    if not len(time) or not np.isfinite(time).all() or (np.diff(time) < 0.0).any():
        raise CommandError(f"{what} '{path}' must have rows, with times that do not decrease.")
    return found


def _options(path: Path) -> dict[str, float]:
    """Read the entries of a `_ref.opt` file; return none if the file does not exist."""
    if not path.is_file():
        return {}
    found = {}
    for line in read_text(path, "the options of the reference").splitlines():
        name, _, value = (part.strip() for part in line.partition("//")[0].partition(","))
        if name not in _OPTIONS:
            continue  # RelTol is the tolerance of the reference's solver, not one for comparisons
        try:
            found[name] = float(value)
        except ValueError:
            raise CommandError(f"'{path}' has '{line.strip()}'; write {name}, NUMBER.") from None
        if not np.isfinite(found[name]):
            raise CommandError(f"'{path}' has {name} = {value}; it must be a finite number.")
    return found


def _about(path: Path) -> dict[str, Any]:
    """Read the TOML file of the reference; return nothing if it does not exist."""
    if not path.is_file():
        return {}
    where = f"'{path}'"
    try:
        table = tomllib.loads(read_text(path, "what belongs to the reference"))
    except tomllib.TOMLDecodeError as error:
        raise CommandError(f"{where} is not valid TOML: {error}.") from error
    if wrong := [key for key in table if key not in _KEYS]:
        raise CommandError(f"{where} has the unknown key '{wrong[0]}'; allowed are {', '.join(_KEYS)}.")
    return {
        "start_values": convert_value(table.get("set", {}), Mapping[str, Any], f"'set' of {where}"),
        "tolerance": parse_tolerances(table.get("tolerance", {}), where),
        "made_by": str(table.get("made_by", "")),
    }


def _line(error: Exception) -> str:
    return " ".join(str(error).split(".")[0].split()) or type(error).__name__
