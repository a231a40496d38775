"""Read reference files in the format of the FMI cross-check.

`<Model>_ref.csv` is the solution, `<Model>_in.csv` has the inputs, if there are any, and
`<Model>_ref.opt` has times. `<Model>_ref.toml` has start values (`set`), the width of tubes (`tolerance`),
and the origin of the reference (`made_by`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from emla_cosim.base.arrays import Vector
from emla_cosim.base.errors import CommandError
from emla_cosim.base.files import read_text
from emla_cosim.base.tolerances import Tolerance
from emla_cosim.base.toml_structs import describe, read_toml, record
from emla_cosim.base.values import convert_value
from emla_cosim.fmu.elements import number_range
from emla_cosim.fmu.interface import Interface

from ..host.experiment import NUMERIC

OPTIONS = ("StartTime", "StopTime", "StepSize", "OutputIntervalLength")
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
        solution: Columns by name, `time` in s first.
        inputs: Columns by name, `time` in s first; empty if there are none.
        start: Start time in s.
        stop: Stop time in s.
        step: Communication step in s; None if the files have none.
        interval: Time in s between rows of the solution, if longer than `step`; None if the files have none.
        start_values: Start values by name.
        tolerance: Tolerances by name or pattern.
        notes: What users should know of how the tables were read.
        solver_tolerance: Relative tolerance of the FMU's solver; None for that of the default experiment.
    """

    solution: Mapping[str, Vector]
    inputs: Mapping[str, Vector]
    start: float
    stop: float
    step: float | None
    interval: float | None = None
    start_values: Mapping[str, Any] = field(default_factory=dict)
    tolerance: Mapping[str, Tolerance] = field(default_factory=dict)
    notes: Sequence[str] = ()
    solver_tolerance: float | None = None


def find_solution(fmu: Path, reference_folder: Path | None) -> Path | None:
    """Return the file with the reference solution beside an FMU, or None.

    Args:
        fmu: The FMU file.
        reference_folder: Folder with references; they may be in a subfolder with the FMU's name. Default: the
            folder of the FMU, then the one above.
    """
    folders = (
        (fmu.parent, fmu.parent.parent)
        if reference_folder is None
        else (reference_folder, reference_folder / fmu.stem)
    )
    name = f"{fmu.stem}{_SOLUTION}"
    return next((folder / name for folder in folders if (folder / name).is_file()), None)


def list_companions(solution: Path) -> list[Path]:
    """Return the files that belong to a solution by their names: inputs, times, the rest.

    The solution is `NAME_ref.csv`, or `NAME_out.csv` as in the Reference FMUs.
    """
    name = solution.name.removesuffix(_SOLUTION).removesuffix("_out.csv").removesuffix(".csv")
    return [solution.with_name(f"{name}_{end}") for end in ("in.csv", "ref.opt", "ref.toml")]


def read_tolerance(solution: Path) -> Mapping[str, Tolerance]:
    """Return the tolerances of a solution by name or pattern, which may have none.

    Raises:
        CommandError: The file with them is invalid.
    """
    return _read_about(list_companions(solution)[-1]).tolerance


def read_reference(solution: Path, interface: Interface | None = None) -> ReferenceSolution:
    """Read a solution and the files that belong to it.

    Files belong to a solution `NAME_ref.csv` by their names.

    Args:
        solution: The file.
        interface: The variables of the FMU; default: columns are numbers in the units of the FMU.

    Raises:
        CommandError: If a file is invalid, or does not fit the variables.
    """
    input_file, options_file, about_file = list_companions(solution)
    options = _read_options(options_file)
    start = options.get("StartTime", 0.0)
    columns, notes = read_columns(solution, "the reference", interface, start, has_gaps=True)
    inputs = dict[str, Vector]()
    if input_file.is_file():
        inputs, more = read_columns(input_file, "the inputs", interface, start)
        notes = [*notes, *more]
    about = _read_about(about_file)
    time = columns["time"]
    step = options.get("StepSize", 0.0) or options.get("OutputIntervalLength", 0.0)
    return ReferenceSolution(
        solution=columns,
        inputs=inputs,
        start=options.get("StartTime", float(time[0])),
        stop=options.get("StopTime", float(time[-1])),
        step=step if step > 0.0 else None,
        interval=options.get("OutputIntervalLength"),
        start_values=about.set,
        tolerance=about.tolerance,
        notes=notes,
    )


def read_columns(
    path: Path,
    description: str,
    interface: Interface | None = None,
    start: float = 0.0,
    has_gaps: bool = False,
) -> tuple[dict[str, Vector], list[str]]:
    """Read the columns of a table, in the units and types of an FMU's variables.

    Args:
        path: The file.
        description: Name of the file in messages: `the inputs`.
        interface: The variables; columns with other names are not converted.
        start: The start of the run in s.
        has_gaps: Whether cells may be empty or not finite.

    Returns:
        The columns by name, `time` in s first, without those of texts; and what users should know of how they
        were read.

    Raises:
        CommandError: The file is not a table of values of the variables, or times decrease.
    """
    from emla_cosim.inputs.loaded_input import read_times
    from emla_cosim.inputs.table_files import (
        read_table,  # loads polars, which FMUs without references do not need
    )

    data = read_table(path, description)
    variables = interface.variables if interface is not None else {}
    data.match_names(variables)
    time, times = read_times(data, start=start, least=1)
    columns = {"time": times}
    texts = [h.name for h in data.headers if h.name in variables and variables[h.name].type not in NUMERIC]
    read = [i for i, h in enumerate(data.headers) if i != time and h.name and h.name not in texts]
    data.load(read)
    for position in read:
        header = data.headers[position]
        data.find(header.name)  # raises CommandError if it is not unique
        if interface is None:
            columns[header.name] = data.numbers(position, has_gaps=has_gaps)
            continue
        if header.name not in variables:  # an error, or not compared
            columns[header.name] = np.full(len(times), np.nan)
            continue
        type_, limits = interface.signal_type(header.name), number_range(variables[header.name])
        if type_.kind == "Real":
            unit = interface.unit(header.name)
            columns[header.name], _ = data.in_unit(position, header.name, unit, has_gaps=has_gaps)
        else:
            columns[header.name] = data.values(position, type_, has_gaps, limits)
    notes = [*data.notes, *(f"has the column '{name}', which is not of numbers" for name in texts)]
    return columns, [f"{data.label} {note}." for note in notes]


def _read_options(path: Path) -> dict[str, float]:
    """Read the entries of a `_ref.opt` file; return none if the file does not exist."""
    if not path.is_file():
        return {}
    options = {}
    for line in read_text(path, "the options of the reference").splitlines():
        name, _, value = (part.strip() for part in line.partition("//")[0].partition(","))
        if name not in OPTIONS:
            continue  # RelTol is the tolerance of the reference's solver, not one for comparisons
        try:
            options[name] = float(value)
        except ValueError:
            raise CommandError(f"'{path}' has '{line.strip()}'; write {name}, NUMBER.") from None
        if not np.isfinite(options[name]):
            raise CommandError(f"'{path}' has {name} = {value}; it must be a finite number.")
    return options


def _read_about(path: Path) -> ReferenceTable:
    """Read the TOML file of the reference, which may not exist."""
    if not path.is_file():
        return ReferenceTable()
    label = f"'{path}'"
    content = read_toml(read_text(path, "what belongs to the reference"), label)
    return convert_value(content, ReferenceTable, label)
