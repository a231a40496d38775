"""Read reference files in the format of the FMI cross-check.

`<Model>_ref.csv` is the solution, `<Model>_in.csv` has the inputs, if there are any, and
`<Model>_ref.opt` has times. `<Model>_ref.toml` has start values (`set`), the width of tubes (`tolerance`),
and the origin of the reference (`made_by`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from ...base.arrays import Vector
from ...base.class_structs import record
from ...base.errors import CommandError
from ...base.files import read_text
from ...base.toml_structs import describe, read_toml
from ...base.values import convert_value
from ...recorders.tubes.tolerance import Tolerance
from .related_result import find_related_result

_OPTIONS = ("StartTime", "StopTime", "StepSize", "OutputIntervalLength")
"""Entries of `_ref.opt` for the run, all in s. A step of 0 means that the solver chooses it."""

_SOLUTION = "_ref.csv"
"""End of the name of a solution."""


class ReferenceTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What belongs to a reference solution."""

    made_by: Annotated[str, describe("origin of the reference")] = ""
    set: Annotated[Mapping[str, Any], describe("start values by name")] = msgspec.field(default_factory=dict)
    tolerance: Annotated[
        dict[str, record(Tolerance)],  # type: ignore[valid-type]
        describe("tolerances by name or pattern of signals"),
    ] = msgspec.field(default_factory=dict)


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


def find_solution(fmu: Path, given: Path | None, unpacked: Path | None = None) -> Path | None:
    """Return the file with the reference solution of an FMU, or None.

    Args:
        fmu: The FMU file.
        given: Folder with references; they may be in a subfolder with the FMU's name. Default: the folder of
            the FMU, the one above, then the FMU itself.
        unpacked: Folder with the content of the FMU.

    Raises:
        CommandError: The FMU's list of related files cannot be read.
    """
    around = (fmu.parent, fmu.parent.parent) if given is None else (given, given / fmu.stem)
    name = f"{fmu.stem}{_SOLUTION}"
    found = next((folder / name for folder in around if (folder / name).is_file()), None)
    return (
        find_related_result(unpacked) if found is None and given is None and unpacked is not None else found
    )


def read_reference(solution: Path) -> ReferenceSolution:
    """Read a solution and the files that belong to it. Raise CommandError if they are invalid.

    Files belong to a solution `NAME_ref.csv` by their names.
    """
    columns = read_columns(solution, "the reference")
    name = solution.name.removesuffix(_SOLUTION)
    given = solution.with_name(f"{name}_in.csv")
    options = _options(solution.with_name(f"{name}_ref.opt"))
    about = _about(solution.with_name(f"{name}_ref.toml"))
    time = columns["time"]
    step = options.get("StepSize", 0.0) or options.get("OutputIntervalLength", 0.0)
    return ReferenceSolution(
        folder=solution.parent,
        solution=columns,
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
    label = f"'{path}'"
    content = read_toml(read_text(path, "what belongs to the reference"), label)
    table = convert_value(content, ReferenceTable, label)
    return {"start_values": table.set, "tolerance": table.tolerance, "made_by": table.made_by}


def _line(error: Exception) -> str:
    return " ".join(str(error).split(".")[0].split()) or type(error).__name__
