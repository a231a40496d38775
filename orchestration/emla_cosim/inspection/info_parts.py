"""Rows of information on a system: FMUs, components, connections and variables."""

from dataclasses import dataclass, field

Start = float | int | bool | str
"""A start value: number, Boolean or text; for an enumeration, the name of its literal."""


@dataclass(frozen=True)
class FmuInfo:
    """Model description of an FMU file.

    Attributes:
        path: path of the file.
        model: name of the model.
        description: one line on its purpose.
        fmi_version: such as 2.0.
        kinds: `CoSimulation`, `ModelExchange` and `ScheduledExecution`, as far as supported.
        platforms: platforms it has binaries for.
        start_time: of the default experiment, in s, or None.
        stop_time: of the default experiment, in s, or None.
        step_size: of the default experiment, in s, or None.
        tolerance: relative tolerance of the default experiment, or None.
        tool: generation tool.
        version: version of the model.
        author: author of the model.
        license: license of the model.
        guid: identifier of the model.
        sha256: hash of the file.
        size: size of the file in bytes.
        capabilities: flags that are set, by kind.
        terminals: names of terminals; those inside of another one have its name and a dot before theirs.
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
    capabilities: dict[str, tuple[str, ...]] = field(default_factory=dict)
    terminals: tuple[str, ...] = ()


@dataclass(frozen=True)
class ComponentInfo:
    """Component of a system.

    Attributes:
        name: path with dots.
        model: name of the model.
        fmu: position of its file in `Info.fmus`.
    """

    name: str
    model: str
    fmu: int


@dataclass(frozen=True)
class ConnectionInfo:
    """Connection from an output to an input: input = factor * output + offset.

    Attributes:
        output: full name of the output.
        input: full name of the input.
        factor: in units of the input per unit of the output, as their FMUs declare them.
        offset: in the unit of the input.
    """

    output: str
    input: str
    factor: float
    offset: float


@dataclass(frozen=True)
class VariableInfo:
    """Variable of a system.

    Attributes:
        name: full name, `component.variable`.
        component: name of the component.
        fmu_name: name in the FMU.
        causality: as in the FMU, such as input, output or parameter.
        variability: as in the FMU, such as fixed, tunable or continuous.
        type: Real, Integer, Boolean, String or Enumeration.
        unit: unit of all values; None without one.
        start: start value in the scenario; None if the FMU computes it.
        default: start value of the FMU; None if the FMU computes it.
        minimum: smallest value allowed, or None.
        maximum: largest value allowed, or None.
        choices: names of the values of an enumeration.
        description: one line on its meaning.
        driven_by: full name of the output that is connected to an input, or None.
        read_by: full names of the inputs that are connected to an output.
        settable: whether `set` accepts it.
        data_type: type of FMI 3.0, such as Float32 or Int8; for FMI 2.0, `type`.
        dimensions: size of the array that it is or belongs to; empty for a scalar.
        clocks: names of the Clocks that it belongs to.
        interval_variability: of a Clock, such as constant or triggered.
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
    data_type: str = ""
    dimensions: tuple[int, ...] = ()
    clocks: tuple[str, ...] = ()
    interval_variability: str = ""
