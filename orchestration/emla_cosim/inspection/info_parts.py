"""Rows of information on a system: FMUs, components, connections and variables."""

from dataclasses import dataclass

Start = float | int | bool | str
"""A start value: number, Boolean or text; for an enumeration, the name of its literal."""


@dataclass(frozen=True)
class FmuInfo:
    """What an FMU file says about itself. Times are in s, or None if missing.

    `kinds` are `CoSimulation`, `ModelExchange` and `ScheduledExecution`; `platforms` are those of its
    binaries; `size` is the size of its file in bytes.
    """

    path: str
    model: str
    description: str
    fmi_version: str
    kinds: tuple[str, ...]
    platforms: tuple[str, ...]
    start_time: float | None
    stop_time: float | None
    step_size: float | None
    tolerance: float | None
    tool: str
    version: str
    author: str
    license: str
    guid: str
    sha256: str
    size: int


@dataclass(frozen=True)
class ComponentInfo:
    """A component of a system. `fmu` is the index of its file among the FMUs."""

    name: str
    model: str
    fmu: int


@dataclass(frozen=True)
class ConnectionInfo:
    """An output that drives an input, by full names: input = factor * output + offset, in the FMUs' units."""

    output: str
    input: str
    factor: float
    offset: float


@dataclass(frozen=True)
class VariableInfo:
    """A variable of a system, by its name in options, `component.variable`.

    Attributes:
        fmu_name: Its name in the FMU.
        start: Start value with all changes of the scenario, or None if the FMU calculates it.
        default: Start value of the FMU alone.
        unit: Unit of the values, of `minimum` and of `maximum`, or None.
        choices: Literals of an enumeration.
        driven_by: Output that drives an input.
        read_by: Inputs that an output drives.
        settable: Whether `--set` accepts it.
    """

    name: str
    component: str
    fmu_name: str
    causality: str
    variability: str
    type: str
    unit: str | None
    start: Start | None
    default: Start | None
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    description: str
    driven_by: str | None
    read_by: tuple[str, ...]
    settable: bool
