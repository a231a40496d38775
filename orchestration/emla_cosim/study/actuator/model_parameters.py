"""Parameters of a system with overrides, and model parameters that do not match a changed plant."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

from emla_fmu import motion_law

from ...base.errors import CommandError, join_names
from ...base.quantities import parse_quantity
from ...base.wording import matches_pattern
from ...run.options import Options
from ...system.model import System, Value
from ..joints.motions import read_plant_table, resting_deflection
from ..load_control import approach_duration
from ..roles import find_element, find_machine_roles

_CONTROLLER_AND_OBSERVER, _CONTROLLER = ("controller", "observer"), ("controller",)

_LOAD = ("command", "load_observer")

_GEAR = ("gearbox.rho", "screw.lead")

_STIFFNESS, _MASS, _BACKLASH = "transmission.stiffness", "load.m", "transmission.backlash"
_LEVEL = "disturbance.load.level[1]"

_MAX_NAMES = 6
"""Number of parameters that a warning names."""


@dataclass(frozen=True)
class _AssumedValue:
    """A model parameter of a joint's components, or a start value for a load at rest.

    Attributes:
        sources: The parameters from which it follows: of the plant, or of the disturbance.
        value: Computes it from an object with these parameters under the last part of their names.
        is_scale: Whether it is only proportional to this value, as a gain is.
    """

    name: str
    models: tuple[str, ...]
    sources: tuple[str, ...]
    value: Callable[[Any], float]
    is_scale: bool = False


def _make_frequency_gain(name: str, power: int) -> _AssumedValue:
    """Return a gain that is proportional to a power of the frequency of the load."""
    return _AssumedValue(
        name, _LOAD, (_STIFFNESS, _MASS), lambda p: math.sqrt(p.stiffness / p.m) ** power, is_scale=True
    )


_ASSUMED_VALUES = (
    _AssumedValue("model.R_s", _CONTROLLER, ("motor.R_s",), attrgetter("R_s")),
    _AssumedValue("model.L_d", _CONTROLLER, ("motor.L_d",), attrgetter("L_d")),
    _AssumedValue("model.L_q", _CONTROLLER, ("motor.L_q",), attrgetter("L_q")),
    _AssumedValue("model.Phi_PM", _CONTROLLER_AND_OBSERVER, ("motor.Phi_PM",), attrgetter("Phi_PM")),
    _AssumedValue("model.N_p", _CONTROLLER_AND_OBSERVER, ("motor.N_p",), attrgetter("N_p")),
    _AssumedValue("model.C_eq", _CONTROLLER, ("screw.C_eq",), attrgetter("C_eq")),
    _AssumedValue("limit.u_max", _CONTROLLER, ("inverter.u_max",), attrgetter("u_max")),
    _AssumedValue("limit.v_max", _CONTROLLER, ("screw.v_max",), attrgetter("v_max")),
    _AssumedValue("model.alpha_RL", _CONTROLLER, _GEAR, motion_law.alpha_RL),
    _AssumedValue(
        "model.A_eq",
        _CONTROLLER_AND_OBSERVER,
        ("motor.J_m", "coupling.J_c", "gearbox.J_GB", "screw.M_BS", *_GEAR),
        motion_law.A_eq,
        is_scale=True,  # on a machine, it has its mass
    ),
    _AssumedValue(
        "model.B_eq", _CONTROLLER_AND_OBSERVER, ("motor.B_m", "screw.B_BS", *_GEAR), motion_law.B_eq
    ),
    _AssumedValue("model.stiffness", _LOAD, (_STIFFNESS,), attrgetter("stiffness")),
    _AssumedValue("model.m_load", _LOAD, (_MASS,), attrgetter("m")),
    _AssumedValue("model.backlash", _LOAD, (_BACKLASH,), attrgetter("backlash")),
    _AssumedValue("model.damping", _LOAD, ("transmission.damping",), attrgetter("damping")),
    _AssumedValue(
        "approach.duration", _LOAD, (_STIFFNESS, _MASS), lambda p: approach_duration(p.m, p.stiffness)
    ),
    _AssumedValue("F_hat", _LOAD, (_LEVEL,), attrgetter("level")),
    _AssumedValue(
        "start.deflection",
        ("plant",),
        (_STIFFNESS, _BACKLASH, _LEVEL),
        lambda p: resting_deflection(p.level, p.stiffness, p.backlash),
    ),
    # poles relative to the frequency of the load
    _make_frequency_gain("feedback.k_0", 1),
    _make_frequency_gain("feedback.k_2", -1),
    _make_frequency_gain("l_1", 1),
    _make_frequency_gain("l_2", 2),
    _make_frequency_gain("l_3", 3),
)


@dataclass(frozen=True)
class _StaleValue:
    """A model parameter that does not match a changed plant: name, changes, and matching value."""

    name: str
    changed: tuple[str, ...]
    matching_value: float


def describe_stale_parameters(system: System, options: Options) -> Iterator[str]:
    """Yield a warning, without full stop, for each joint whose plant changes while its models do not."""
    if options.follow_models:
        return
    for joint, stale in _find_stale_by_joint(system, options).items():
        changed_names = list(dict.fromkeys(name for entry in stale for name in entry.changed))
        verb = "changes" if len(changed_names) == 1 else "change"
        keep = "keeps its value" if len(stale) == 1 else "keep their values"
        is_actuator = any(entry.name.split(".")[1] in _CONTROLLER_AND_OBSERVER for entry in stale)
        yield (
            f"{_shorten_names(changed_names)} {verb}, but {_shorten_names([entry.name for entry in stale])} "
            f"{keep}; --follow-models (follow_models = true in a file) changes "
            f"{'it' if len(stale) == 1 else 'them'} too"
            f"{f', and --actuator {joint}=FILE the whole actuator' if is_actuator else ''}"
        )


def _shorten_names(names: Sequence[str]) -> str:
    """Return the first names as a list in a message, and the number of the others."""
    more = len(names) - _MAX_NAMES
    return join_names([*names[:_MAX_NAMES], f"{more} more"] if more > 0 else names)


def follow_plant_changes(system: System, options: Options) -> Mapping[str, Value]:
    """Return the values, by full name, that make the models of all joints match their changed plants."""
    stale = (entry for entries in _find_stale_by_joint(system, options).values() for entry in entries)
    return {entry.name: entry.matching_value for entry in stale if math.isfinite(entry.matching_value)}


def _find_stale_by_joint(system: System, options: Options) -> dict[str, list[_StaleValue]]:
    """Return the mismatched model parameters by joint; joints without any are left out."""
    components = {c.name: c.parameters for c in system.components if c.name not in options.replace}
    joints = dict.fromkeys(name.partition(".")[0] for name in components)
    # nothing changes a plant without overrides
    if not options.set:
        return {}
    roles = find_machine_roles(map(str, system.connections))
    stale_by_joint = {
        j: list(_find_stale_values(j, find_element(j, roles), components, options)) for j in joints
    }
    return {joint: stale for joint, stale in stale_by_joint.items() if stale}


def _find_stale_values(
    joint: str, element: int | None, components: Mapping[str, Mapping[str, Value]], options: Options
) -> Iterator[_StaleValue]:
    """Yield the model parameters of a joint that do not match its overridden plant."""
    for assumed in _ASSUMED_VALUES:
        plant = [_read_parameter(joint, element, name, components, options) for name in assumed.sources]
        changed_names = tuple(entry.name for entry in plant if entry.is_changed)
        if not changed_names:
            continue
        nominal = _compute_value(assumed, [entry.before for entry in plant])
        matching_value = _compute_value(assumed, [entry.after for entry in plant])
        if _is_same(matching_value, nominal):
            continue
        for component in assumed.models:
            name = f"{joint}.{component}.{assumed.name}"
            current = components.get(f"{joint}.{component}", {}).get(assumed.name)
            if current is not None and not any(matches_pattern(name, key) for key in options.set):
                old_value = _read_float(name, current, {})
                # a value that is nominal follows exactly, without the rounding of a ratio
                scaled = assumed.is_scale and old_value != nominal
                value = old_value * matching_value / nominal if scaled else matching_value
                yield _StaleValue(name, changed_names, value)


@dataclass(frozen=True)
class _Parameter:
    """A parameter of a plant: its full name, and its values before and after the overrides."""

    name: str
    before: float
    after: float

    @property
    def is_changed(self) -> bool:
        return not _is_same(self.after, self.before)


def _read_parameter(
    joint: str,
    element: int | None,
    parameter: str,
    components: Mapping[str, Mapping[str, Value]],
    options: Options,
) -> _Parameter:
    """Return a plant's parameter for a joint; if two joints share the plant, the changed one.

    A parameter that no component has is 0.
    """
    component, _, variable_name = parameter.partition(".")
    if parameter == _LEVEL and f"{joint}.disturbance" in components:
        return _read_start_force(joint, components, options)
    if component == "disturbance":
        candidates = [(f"{joint}.disturbance", variable_name)]
    else:
        candidates = [(f"{joint}.plant", parameter), (f"{joint}.motor", parameter)]
    if element is not None:
        candidates.append(("machine.plant", f"{parameter}[{element}]"))
    parameters = [
        _Parameter(name, _read_float(name, value, {}), _read_float(name, value, options.set))
        for name, value in (
            (f"{component}.{variable}", components.get(component, {}).get(variable))
            for component, variable in candidates
        )
        if value is not None
    ]
    # lead and ratio are in both halves of a merged plant; either one can be set
    return max(parameters, key=lambda parameter: parameter.is_changed, default=_Parameter("", 0.0, 0.0))


def _read_start_force(
    joint: str, components: Mapping[str, Mapping[str, Value]], options: Options
) -> _Parameter:
    """Return the load force of a joint in N at its start, with the force along the stroke if it has one."""
    level = _LEVEL.partition(".")[2]
    name, value = f"{joint}.{_LEVEL}", components[f"{joint}.disturbance"].get(level)
    if value is None:
        return _Parameter("", 0.0, 0.0)
    before, after = _read_float(name, value, {}), _read_float(name, value, options.set)
    plant = components.get(f"{joint}.plant", {})

    def read_stroke_force(overrides: Mapping[str, Value]) -> float:
        def read(variable: str) -> float | None:
            return read_number(f"{joint}.plant.{variable}", plant.get(variable), overrides)

        table, x = read_plant_table(read), read("start.x_L")
        return 0.0 if table is None or x is None else table.force_at(x - (read("start.deflection") or 0.0))

    if not any(variable.startswith("load.table.force") for variable in plant):
        return _Parameter(name, before, after)
    changed = name if not _is_same(before, after) else f"{joint}.plant.load.table"
    return _Parameter(changed, before + read_stroke_force({}), after + read_stroke_force(options.set))


def _read_float(name: str, value: Value, overrides: Mapping[str, Value]) -> float:
    number = read_number(name, value, overrides)
    return math.nan if number is None else number


def _is_same(first: float, second: float) -> bool:
    """Return whether two numbers differ by rounding at most, such as that of a unit conversion."""
    return math.isclose(first, second, rel_tol=1e-12)


def _compute_value(assumed: _AssumedValue, plant: Sequence[float]) -> float:
    """Return a model parameter for the values of its sources; NaN if undefined, as for a lead of 0."""
    names = [source.rpartition(".")[2].partition("[")[0] for source in assumed.sources]
    try:
        return assumed.value(SimpleNamespace(**dict(zip(names, plant, strict=True))))
    except (ZeroDivisionError, OverflowError):
        return math.nan


def get_number(system: System, options: Options, component: str, variable: str) -> float | None:
    """Return a start value in the unit of its model; None if it is unknown before the run."""
    match = next((c for c in system.components if c.name == component), None)
    if match is None or not follows_start_values(component, options):
        return None
    return read_number(f"{component}.{variable}", match.parameters.get(variable), options.set)


def read_number(name: str, value: Value | None, overrides: Mapping[str, Value]) -> float | None:
    """Return a start value as a number in the unit of its model; None if it is unknown before the run.

    Args:
        name: The full name of the variable.
        value: The value in the system: a number, a text with a unit, or None.
        overrides: Values by name or pattern. Names win over patterns, later patterns over earlier ones.
    """
    for pattern, override in overrides.items():
        if matches_pattern(name, pattern):
            value = override
    value = overrides.get(name, value)
    if value in ("true", "false"):
        return float(value == "true")
    if isinstance(value, str):
        try:
            return parse_quantity(value, name).si_number
        except CommandError:
            return None  # a name of an enumeration, or a unit known only with the FMU
    return None if value is None else float(value)


def follows_start_values(component: str, options: Options) -> bool:
    """Return whether a component's outputs follow from its start values: no FMU and no data replaces it.

    Data without names of signals drive the signals that their columns name.
    """
    from_data = any(
        not source.signals or any(name.startswith(f"{component}.") for name in source.signals)
        for source in options.input
    )
    return component not in options.replace and not from_data
