"""Information on a system: FMUs, components, connections and variables."""

import json
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base.errors import CommandError, suggest_names
from ..base.output_files import OutputFile, has_format
from ..base.wording import format_count, is_pattern, matches_pattern
from ..pages.text import to_plain

if TYPE_CHECKING:
    import polars

    from ..study.machines.machine_info import MachineInfo

FORMAT = "emla-info"
VERSION = 1
"""Version of the JSON format."""

JSON_FILE = "the JSON file"
"""Name of the file in error messages."""

is_info = has_format(FORMAT)
"""Recognizes files that `Info.save_json` wrote."""

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


@dataclass(frozen=True, repr=False)
class Info:
    """Content of an FMU, an SSP or a scenario. `info["lift.plant.x_L"]` is one of its variables.

    Attributes:
        name: name of the scenario, or of the file.
        description: one line on its purpose.
        start_time: in s; None if none is defined.
        stop_time: in s; None if none is defined.
        step_size: in s; None if none is defined.
        notes: notes and warnings.
        fmus: FMU files, each once.
        components: components of the system.
        connections: connections between them.
        variables: variables of all components.
        machine: the machine that joints move together; None without one.
    """

    name: str
    description: str
    start_time: float | None = None
    stop_time: float | None = None
    step_size: float | None = None
    notes: tuple[str, ...] = ()
    fmus: tuple[FmuInfo, ...] = ()
    components: tuple[ComponentInfo, ...] = ()
    connections: tuple[ConnectionInfo, ...] = ()
    variables: tuple[VariableInfo, ...] = ()
    machine: "MachineInfo | None" = None

    def __repr__(self) -> str:
        """Return one line: the name, and how much there is."""
        counts = (
            format_count(len(self.components), "component"),
            format_count(len(self.connections), "connection"),
            format_count(len(self.variables), "variable"),
        )
        return f"<Info on {self.name}: {', '.join(counts)}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: FMUs, connections and variables."""
        from .info_cell import render_cell  # it needs this class

        return render_cell(self)

    def __getitem__(self, name: str) -> VariableInfo:
        """Return the variable of this full name; raise CommandError if it does not exist."""
        variable = self._by_name.get(name)
        if variable is None:
            suggestions = suggest_names(name, self._by_name)
            raise CommandError(f"{self.name} has no variable '{name}'; {suggestions}", name=name)
        return variable

    @cached_property
    def _by_name(self) -> dict[str, VariableInfo]:
        return {v.name: v for v in self.variables}

    def matching(self, *patterns: str) -> "Info":
        """Return the same with the matching variables only.

        Args:
            *patterns: a pattern with `*` or `?` matches full names and names inside of a component. A word
                without them is searched in full names and descriptions, in upper or lower case.

        Raises:
            CommandError: a pattern matches no variable.

        Examples:
            >>> import emla_cosim as ec
            >>> [v.name for v in ec.info("lift").matching("*.plant.x_L").variables]
            ['lift.plant.x_L']
        """
        # each pattern must match something, else it is misspelt
        remaining: set[str] = set()
        for pattern in patterns:
            names = {v.name for v in self.variables if _is_match(v, pattern)}
            if not names:
                raise CommandError(
                    f"no variable of {self.name} matches '{pattern}'; write a pattern such as '*.x_L', or "
                    "a word of a name or a description.",
                    pattern=pattern,
                )
            remaining |= names
        return replace(self, variables=tuple(v for v in self.variables if v.name in remaining))

    def to_polars(self) -> "polars.DataFrame":
        """Return the variables as a polars data frame; start values are text."""
        import polars

        columns = {n: [getattr(v, n) for v in self.variables] for n in VariableInfo.__dataclass_fields__}
        for name in ("start", "default"):
            columns[name] = [None if x is None else format_start(x) for x in columns[name]]
        # the types of columns that may be empty
        texts = dict.fromkeys(("start", "default", "unit", "driven_by"), polars.String)
        numbers = dict.fromkeys(("minimum", "maximum"), polars.Float64)
        lists = dict.fromkeys(("choices", "read_by"), polars.List(polars.String))
        return polars.DataFrame(columns, schema_overrides={**texts, **numbers, **lists})

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain data; numbers that are not finite become None.

        `machine` is missing without a machine.
        """
        content = {"format": FORMAT, "version": VERSION, **asdict(replace(self, variables=(), machine=None))}
        del content["machine"]
        content |= {} if self.machine is None else {"machine": self.machine.as_dict()}
        return {**to_plain(content), "variables": [_convert_row(variable) for variable in self.variables]}

    def as_json(self) -> str:
        """Return everything as JSON text, with one line for each variable."""
        content = self.as_dict()
        rows = [json.dumps(row, allow_nan=False) for row in content.pop("variables")]
        # thousands of variables in indented JSON would be hard to read and large
        head = json.dumps(content, indent=1, allow_nan=False).removesuffix("\n}")
        return f'{head},\n "variables": [\n  ' + ",\n  ".join(rows) + "\n ]\n}\n"

    def save_json(self, path: str | Path, overwrite: bool = False) -> None:
        """Write everything to a JSON file.

        Args:
            path: path of the file.
            overwrite: replace a file that emla did not write.

        Raises:
            CommandError: the file must not be written.
            RunError: writing fails.
        """
        file = OutputFile(Path(path), JSON_FILE, is_info, overwrite)
        file.write(self.as_json().encode("utf-8", "replace"))


def format_start(value: float | int | bool | str) -> str:
    """Format a start value for `--set`: 0.14, 8, true, or a name, with all digits."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _convert_row(variable: VariableInfo) -> dict[str, Any]:
    """Convert one of many variables for JSON, faster than `to_plain`; only start values can be infinite."""
    values = vars(variable)
    lists = {name: list(value) for name, value in values.items() if isinstance(value, tuple)}
    return {**values, **lists, "start": to_plain(variable.start), "default": to_plain(variable.default)}


def _is_match(variable: VariableInfo, pattern: str) -> bool:
    """Return whether a variable matches a pattern or contains a word; see `Info.matching`."""
    inside = variable.name.removeprefix(f"{variable.component}.")
    if matches_pattern(variable.name, pattern) or matches_pattern(inside, pattern):
        return True
    word = pattern.casefold()
    return not is_pattern(pattern) and word in f"{variable.name}\n{variable.description}".casefold()
