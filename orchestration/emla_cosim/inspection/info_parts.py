"""What is told of a system: FMUs, components, connections and variables, each as a row of a table."""

from dataclasses import dataclass

Start = float | int | bool | str
"""A start value: a number, a Boolean, a text; an enumeration's by the name of its literal."""


@dataclass(frozen=True)
class FmuInfo:
    """What an FMU file says of itself; times in s, None where it says none.

    `kinds` are `CoSimulation`, `ModelExchange` and `ScheduledExecution`, `platforms` what it has binaries
    for, `size` the bytes of its file.
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
    """A component of a system; `fmu` is the place of its file among the FMUs."""

    name: str
    model: str
    fmu: int


@dataclass(frozen=True)
class ConnectionInfo:
    """An output that drives an input, by full names: input = factor output + offset, in their FMUs' units."""

    output: str
    input: str
    factor: float
    offset: float


@dataclass(frozen=True)
class VariableInfo:
    """A variable of a system, by the name that options call it, `component.variable`.

    `fmu_name` is what its FMU calls it. `start` is the value that it starts from, with all that the scenario
    sets, `default` that of the FMU alone; None where the FMU calculates it. `unit` is None where there is
    none; values, `minimum` and `maximum` are in it. `choices` are the literals of an enumeration.
    `driven_by` is the output that drives an input, `read_by` are the inputs that an output drives.
    `settable` says whether `--set` takes it.
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
