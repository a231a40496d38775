"""Joint files as structs of msgspec, with tables of gains and of parameters of blocks."""

import inspect
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NoReturn, get_args, get_origin, get_type_hints

import msgspec

from emla_fmu import Disturbance, EmlaPlant, observer_gains
from emla_fmu.drive import DriveParameters
from emla_fmu.observer_gains import ObserverGains
from emla_fmu.parameters import EmlaParameters
from fmublock import Block
from fmublock.variables import Variable

from ...base.errors import CommandError
from ...base.option import RUN
from ...base.table_entries import Location
from ...base.toml_structs import describe, dotted, extend_struct, one_of, quantity
from ...run.scenarios.scenario_file import with_options
from ..actuator.actuator import Actuator, read_tables
from ..actuator.entries import ACTUATOR
from ..controllers import CONTROLLERS
from .motions import Brake, Compliance, JointExperiment, Load, LoadFeedback, Move, StartPosition

OBSERVER_RULES: Mapping[str, Callable[..., ObserverGains]] = {
    "published": observer_gains.published,
    "robust": observer_gains.robust,
    "compensated": observer_gains.compensated,
    "damped": observer_gains.damped,
}
"""Rules that compute the gains of an observer."""


@dataclass(frozen=True)
class ObserverSet:
    """Gains of an observer; `estimate` is its initial position in m, if not that of the screw."""

    gains: ObserverGains
    estimate: float | None = None


@dataclass(frozen=True)
class GainSet:
    """A set of gains of a controller, with its observer.

    `on_machine` are the gains of a joint that moves a whole machine.
    """

    controller: Any
    observer: ObserverSet
    on_machine: Any


class GainTable(msgspec.Struct, frozen=True, kw_only=True):
    """A table with the arguments of a function that returns gains, and further entries."""

    function: ClassVar[Callable[..., Any]]
    arguments: ClassVar[Sequence[str]]

    def __post_init__(self) -> None:
        """Compute the gains, so that arguments that cannot be used are reported with the table."""
        self.gains()

    def gains(self) -> Any:
        """Return the gains."""
        return self.function(**{name: getattr(self, name) for name in self.arguments})


def build_gain_tables(
    name: str,
    values: Callable[..., Any],
    rules: Mapping[str, Callable[..., Any]],
    further: Sequence[tuple[str, Any] | tuple[str, Any, Any]] = (),
) -> Mapping[str | None, type[GainTable]]:
    """Return the structs of a table of gains, by its rule.

    Args:
        name: The beginning of the names of the structs.
        values: The class of the gains, for a table without a rule.
        rules: Functions that return gains, by rule.
        further: Further fields of the table.
    """
    tables: dict[str | None, type[GainTable]] = {None: _build_gain_table(f"{name} gains", values, further)}
    for rule, function in rules.items():
        tag = ("rule", Annotated[Literal[rule], describe("rule for the gains")])  # type: ignore[valid-type]
        tables[rule] = _build_gain_table(f"{name} gains by {rule}", function, [tag, *further])
    return tables


def _build_gain_table(name: str, function: Callable[..., Any], further: Sequence[Any]) -> type[GainTable]:
    """Return the struct of a function: its arguments, and further fields."""
    hints = get_type_hints(function)
    fields = list[Any]()
    for argument_name, argument in inspect.signature(function).parameters.items():
        default = () if argument.default is argument.empty else (argument.default,)
        fields.append((argument_name, _get_file_type(hints[argument_name]), *default))
    about = " ".join((inspect.getdoc(function) or "").partition("\n")[0].split())
    table = extend_struct(GainTable, name.replace(" ", "_"), [*fields, *further], about)
    # a plain function would become a method of the struct
    table.function, table.arguments = staticmethod(function), [field[0] for field in fields]
    return table


def _get_file_type(hint: Any) -> Any:
    """Return the type of an argument in a file, where numbers can be texts."""
    if get_origin(hint) is tuple:
        return tuple[tuple(_get_file_type(part) for part in get_args(hint))]
    return Annotated[float, quantity("")] if hint is float else hint


@cache
def build_observer_table() -> Any:
    """Return the type of a table with gains of an observer."""
    estimate = Annotated[float, quantity("m", "initial position of the observer", 0.36)]
    tables = build_gain_tables("observer", ObserverGains, OBSERVER_RULES, [("estimate", estimate, None)])
    return Annotated[Any, one_of("rule", tables, "gains of an observer")]


def build_controllers_struct() -> type[msgspec.Struct]:
    """Return the struct of the table with the sets of gains of each controller."""
    observer = Annotated[str | build_observer_table(), describe("set [observer.NAME], or a table", "robust")]  # type: ignore[valid-type]
    fields = list[Any]()
    for name, controller in CONTROLLERS.items():
        if controller.gain_type is None:
            continue
        machine = build_gain_tables(f"{name} machine", controller.gain_type, controller.rules)
        further = [
            ("observer", observer),
            ("on_machine", Annotated[Any, one_of("rule", machine, "gains on a whole machine")], None),
        ]
        tables = build_gain_tables(name, controller.gain_type, controller.rules, further)
        set_ = Annotated[Any, one_of("rule", tables, "a set of gains")]
        sets = [(key, set_, msgspec.UNSET) for key in controller.gains]
        fields.append((name, extend_struct(msgspec.Struct, f"{name}_sets", sets), msgspec.UNSET))
    return extend_struct(msgspec.Struct, "controllers", fields)


def build_block_struct(block: type[Block], reserved: Mapping[str, str]) -> type[msgspec.Struct]:
    """Return the struct with the parameters of a block; its attributes are those of the block.

    Args:
        block: The block.
        reserved: Parameters that another table sets, each with what to do instead.
    """
    fields: list[Any] = [
        (
            variable.attribute,
            _build_reserved_field(reserved[str(variable.name)])
            if str(variable.name) in reserved
            else _get_field_type(variable),
            msgspec.field(name=str(variable.name), default=msgspec.UNSET),
        )
        for variable in block.layout().parameters
    ]
    return extend_struct(msgspec.Struct, block.__name__, fields)


def _build_reserved_field(remedy: str) -> Any:
    """Return the type of a field that refuses every value, with a message that ends with `remedy`."""

    def refuse(_value: Any, at: Location, _folder: Path | None) -> NoReturn:
        raise CommandError(f"{at.label} must not be set here; {remedy}.")

    return Annotated[Any, describe(read=refuse, extra_json_schema={"not": {}})]


def _get_field_type(variable: Variable) -> Any:
    """Return the type of a parameter: a number, or a tuple of them for an array."""
    if variable.fmi_type != "Real":
        type_ = bool if variable.fmi_type == "Boolean" else int
        return Annotated[type_, describe(variable.description)]
    number = Annotated[float, quantity(variable.unit or "", variable.description)]
    return tuple[(number,) * math.prod(variable.shape)] if variable.shape else number


def _list_fmi_names(block: type[Block], attributes: Iterable[str]) -> set[str]:
    return {str(x.name) for x in block.layout().parameters if x.attribute in set(attributes)}


_SEED = "write it as seed, before the first table"
_RESERVED_OF_DISTURBANCE = {
    **dict.fromkeys(
        _list_fmi_names(Disturbance, ("level", "level_start", "ramp", "ripple", "ripple_omega")),
        "write the load in [load]",
    ),
    "d_2.seed": _SEED,
}
_RESERVED_OF_PLANT = {
    **dict.fromkeys(
        _list_fmi_names(EmlaPlant, DriveParameters.__dataclass_fields__), "write it in [actuator] or [drive]"
    ),
    **dict.fromkeys(
        _list_fmi_names(EmlaPlant, [*EmlaParameters.__dataclass_fields__, "i_max", "i_range"]),
        "it follows from [actuator]",
    ),
    "sensor.seed": _SEED,
    "sensor.current.seed": "it follows from seed",
    "start.x_L": "write it as x_L in [start]",
    "use_commanded_current": "the scenario decides it",
}

DISTURBANCE = build_block_struct(Disturbance, _RESERVED_OF_DISTURBANCE)
PLANT = build_block_struct(EmlaPlant, _RESERVED_OF_PLANT)


class Cells(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Figures of the paper; in normalised averages they are ratios. The names are those of `JointFigures`."""

    position_error_m: Annotated[float, quantity("m", "position error")]
    velocity_error_m_s: Annotated[float, quantity("m/s", "speed error")]
    torque_effort_N_m: Annotated[float, quantity("N.m", "torque effort")]
    convergence_time_s: Annotated[float, quantity("s", "convergence time")]

    def __iter__(self) -> Iterator[float]:
        return iter(msgspec.structs.astuple(self))


class RunTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The options of the joint's scenario."""

    stop_time: Annotated[float, quantity("s", "stop time in s", 10.0)]
    step_size: Annotated[float, quantity("s", "communication step in s", 1e-4)]


class DriveTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Entries of the actuator in scenarios with a realistic drive."""

    always: Annotated[bool, describe("whether the joint always runs with these entries")] = False
    inverter: Mapping[str, Any] | None = None
    sensor: Mapping[str, Any] | None = None
    friction: Mapping[str, Any] | None = None
    stop: Mapping[str, Any] | None = None
    thermal: Mapping[str, Any] | None = None


class Tuning(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Data for `emla tune`: the convergence time to beat, and values for the case with noise."""

    convergence_time: Annotated[float, quantity("s", "convergence time to beat", 0.085)] | None = None
    noisy: Annotated[
        dict[str, Annotated[int | float, describe("number")]], dotted("start values of the case with noise")
    ] = msgspec.field(default_factory=dict)


def _read_actuator(value: Any, at: Location, folder: Path | None) -> Actuator:
    """Read the actuator, inline or from the file that the entry names."""
    label = f"[actuator] of {at.file}"
    if isinstance(value, str):
        path = (folder or Path()) / value
        label, value = f"the actuator '{path}'", read_tables(path)[0]
    if not isinstance(value, Mapping):
        raise CommandError(f"{label} is {value!r}; it must be a table, or the path of a file.")
    # two places for the same gains could differ
    if "control" in value:
        raise CommandError(
            f"{label} has the table 'control'; remove it, since [gains] of a joint file has all gains.",
            key="control",
        )
    return Actuator.of_tables(value, label)


class JointTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All data of a joint."""

    # `joint_struct` has the types of fields that are Any here

    kind: Literal["joint"]
    description: Annotated[str, describe("line that `emla list` shows")]
    sample_time: Annotated[float, quantity("s", "sample time of observer and controller", 1e-4, gt=0.0)]
    seed: Annotated[int, describe("start of the random sequences")] | None = None
    run: Any
    actuator: Any
    drive: DriveTable = DriveTable()
    start: Annotated[StartPosition, describe("start position of the screw")]
    reference: Annotated[Move, describe("motion of the joint")]
    load: Annotated[Load, describe("load force")]
    disturbance: Any
    plant: Any
    compliance: Compliance | None = None
    load_feedback: LoadFeedback = LoadFeedback()
    brake: Brake | None = None
    observers: Any = msgspec.field(name="observer")
    gains: Any
    tuning: Tuning | None = None
    experiments: dict[str, JointExperiment] = msgspec.field(default_factory=dict, name="experiment")
    printed: dict[str, dict[str, Cells]] = msgspec.field(default_factory=dict, name="paper")


KEYS = frozenset(JointTable.__struct_encode_fields__) - {"description", "actuator", "gains"}
"""Entries that a scenario file does not support."""


def joint_struct() -> type[JointTable]:
    """Return the struct of joint files, with the options and the controllers that are registered."""
    about = "data of motor, screw, inverter and sensor, or the path of a file"
    observers = dict[str, build_observer_table()]  # type: ignore[misc]
    return extend_struct(
        JointTable,
        "Joint",
        [
            ("run", Annotated[with_options(RunTable, "Run", RUN), describe("options of its scenario")]),
            ("actuator", Annotated[str | ACTUATOR, describe(about, read=_read_actuator)]),
            ("disturbance", Annotated[DISTURBANCE, dotted("parameters of the disturbance")], DISTURBANCE()),
            ("plant", Annotated[PLANT, dotted("parameters of the plant")], PLANT()),
            ("observers", observers, msgspec.field(default_factory=dict, name="observer")),
            ("gains", build_controllers_struct(), None),
        ],
    )
