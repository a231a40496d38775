"""Parameters of a system with overrides, and model parameters that do not match a changed plant."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

from emla_fmu import motion_law

from ...base.errors import CommandError, join_names
from ...base.patterns import matches_pattern
from ...base.quantities import parse_quantity
from ...run.options import Options
from ...system.model import System, Value
from ..joints.motions import resting_deflection
from ..joints.stroke_table import table_of_plant
from ..load_control import approach_duration
from ..roles import find_element, machine_roles

_BOTH, _CONTROLLER = ("controller", "observer"), ("controller",)

_LOAD = ("command", "load_observer")

_GEAR = ("gearbox.rho", "screw.lead")

_STIFFNESS, _MASS, _BACKLASH = "transmission.stiffness", "load.m", "transmission.backlash"
_LEVEL = "disturbance.load.level[1]"

_MOST_NAMED = 6
"""Number of parameters that a warning names."""


@dataclass(frozen=True)
class _AssumedValue:
    """A model parameter of a joint's components, or a start value for a load at rest.

    Attributes:
        of: The parameters from which it follows: of the plant, or of the disturbance.
        value: Computes it from an object with these parameters under the last part of their names.
        is_scale: Whether it is only proportional to this value, as a gain is.
    """

    name: str
    whose: tuple[str, ...]
    of: tuple[str, ...]
    value: Callable[[Any], float]
    is_scale: bool = False


def _gain(name: str, power: int) -> _AssumedValue:
    """Return a gain that is proportional to a power of the frequency of the load."""
    return _AssumedValue(
        name, _LOAD, (_STIFFNESS, _MASS), lambda p: math.sqrt(p.stiffness / p.m) ** power, is_scale=True
    )


_ASSUMED_VALUES = (
    _AssumedValue("model.R_s", _CONTROLLER, ("motor.R_s",), attrgetter("R_s")),
    _AssumedValue("model.L_d", _CONTROLLER, ("motor.L_d",), attrgetter("L_d")),
    _AssumedValue("model.L_q", _CONTROLLER, ("motor.L_q",), attrgetter("L_q")),
    _AssumedValue("model.Phi_PM", _BOTH, ("motor.Phi_PM",), attrgetter("Phi_PM")),
    _AssumedValue("model.N_p", _BOTH, ("motor.N_p",), attrgetter("N_p")),
    _AssumedValue("model.C_eq", _CONTROLLER, ("screw.C_eq",), attrgetter("C_eq")),
    _AssumedValue("limit.u_max", _CONTROLLER, ("inverter.u_max",), attrgetter("u_max")),
    _AssumedValue("limit.v_max", _CONTROLLER, ("screw.v_max",), attrgetter("v_max")),
    _AssumedValue("model.alpha_RL", _CONTROLLER, _GEAR, motion_law.alpha_RL),
    _AssumedValue(
        "model.A_eq",
        _BOTH,
        ("motor.J_m", "coupling.J_c", "gearbox.J_GB", "screw.M_BS", *_GEAR),
        motion_law.A_eq,
        is_scale=True,  # on a machine, it has its mass
    ),
    _AssumedValue("model.B_eq", _BOTH, ("motor.B_m", "screw.B_BS", *_GEAR), motion_law.B_eq),
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
    _gain("feedback.k_0", 1),
    _gain("feedback.k_2", -1),
    _gain("l_1", 1),
    _gain("l_2", 2),
    _gain("l_3", 3),
)


@dataclass(frozen=True)
class _StaleValue:
    """A model parameter that does not match a changed plant: name, changes, and matching value."""

    name: str
    changed: tuple[str, ...]
    fitting: float


def describe_stale_parameters(system: System, options: Options) -> Iterator[str]:
    """Yield a warning, without full stop, for each joint whose plant changes while its models do not."""
    if options.follow_models:
        return
    for joint, found in _by_joint(system, options).items():
        changed = list(dict.fromkeys(name for one in found for name in one.changed))
        verb, keep = ("changes" if len(changed) == 1 else "change"), ("keeps its value", "keep their values")
        is_actuator = any(one.name.split(".")[1] in _BOTH for one in found)
        yield (
            f"{_shorten_names(changed)} {verb}, but {_shorten_names([one.name for one in found])} "
            f"{keep[len(found) > 1]}; --follow-models (follow_models = true in a file) changes "
            f"{'it' if len(found) == 1 else 'them'} too"
            f"{f', and --actuator {joint}=FILE the whole actuator' if is_actuator else ''}"
        )


def _shorten_names(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    return join_names([*names[:_MOST_NAMED], f"{more} more"] if more > 0 else names)


def follow_plant_changes(system: System, options: Options) -> Mapping[str, Value]:
    """Return the values, by full name, that make the models of all joints match their changed plants."""
    stale = (one for found in _by_joint(system, options).values() for one in found)
    return {one.name: one.fitting for one in stale if math.isfinite(one.fitting)}


def _by_joint(system: System, options: Options) -> dict[str, list[_StaleValue]]:
    """Return the mismatched model parameters by joint; joints without any are left out."""
    components = {c.name: c.parameters for c in system.components if c.name not in options.replace}
    joints = dict.fromkeys(name.partition(".")[0] for name in components)
    if not options.set:
        return {}
    roles = machine_roles(map(str, system.connections))
    found = {j: list(_find_stale(j, find_element(j, roles), components, options)) for j in joints}
    return {joint: stale for joint, stale in found.items() if stale}


def _find_stale(
    joint: str, element: int | None, components: Mapping[str, Mapping[str, Value]], options: Options
) -> Iterator[_StaleValue]:
    for belief in _ASSUMED_VALUES:
        plant = {
            parameter: _parameter(joint, element, parameter, components, options) for parameter in belief.of
        }
        changed = tuple(one.name for one in plant.values() if one.is_changed)
        if not changed:
            continue
        was = _value(belief, {parameter: one.before for parameter, one in plant.items()})
        fitting = _value(belief, {parameter: one.after for parameter, one in plant.items()})
        if _is_same(fitting, was):
            continue
        for who in belief.whose:
            name = f"{joint}.{who}.{belief.name}"
            present = components.get(f"{joint}.{who}", {}).get(belief.name)
            if present is not None and not any(matches_pattern(name, key) for key in options.set):
                before = _number(name, present, {})
                scaled = belief.is_scale and before != was
                value = before * fitting / was if scaled else fitting
                yield _StaleValue(name, changed, value)


@dataclass(frozen=True)
class _Parameter:
    """A parameter of a plant: its full name, and its values before and after the overrides."""

    name: str
    before: float
    after: float

    @property
    def is_changed(self) -> bool:
        return not _is_same(self.after, self.before)


def _parameter(
    joint: str,
    element: int | None,
    parameter: str,
    components: Mapping[str, Mapping[str, Value]],
    options: Options,
) -> _Parameter:
    """Return a plant's parameter for a joint; if two joints share the plant, the changed one.

    A parameter that no component has is 0.
    """
    component, _, rest = parameter.partition(".")
    if parameter == _LEVEL and f"{joint}.disturbance" in components:
        return _force_at_start(joint, components, options)
    if component == "disturbance":
        places = [(f"{joint}.disturbance", rest)]
    else:
        places = [(f"{joint}.plant", parameter), (f"{joint}.motor", parameter)]
    if element is not None:
        places.append(("machine.plant", f"{parameter}[{element}]"))
    found = [
        _Parameter(name, _number(name, value, {}), _number(name, value, options.set))
        for name, value in (
            (f"{component}.{variable}", components.get(component, {}).get(variable))
            for component, variable in places
        )
        if value is not None
    ]
    return max(found, key=lambda one: one.is_changed, default=_Parameter("", 0.0, 0.0))


def _force_at_start(
    joint: str, components: Mapping[str, Mapping[str, Value]], options: Options
) -> _Parameter:
    """Return the load force of a joint in N at its start, with the force along the stroke if it has one."""
    level = _LEVEL.partition(".")[2]
    name, value = f"{joint}.{_LEVEL}", components[f"{joint}.disturbance"].get(level)
    if value is None:
        return _Parameter("", 0.0, 0.0)
    before, after = _number(name, value, {}), _number(name, value, options.set)
    plant = components.get(f"{joint}.plant", {})

    def along(overrides: Mapping[str, Value]) -> float:
        def read(variable: str) -> float | None:
            return value_of(f"{joint}.plant.{variable}", plant.get(variable), overrides)

        table, x = table_of_plant(read), read("start.x_L")
        return 0.0 if table is None or x is None else table.force_at(x - (read("start.deflection") or 0.0))

    if not any(variable.startswith("load.table.force") for variable in plant):
        return _Parameter(name, before, after)
    changed = name if not _is_same(before, after) else f"{joint}.plant.load.table"
    return _Parameter(changed, before + along({}), after + along(options.set))


def _number(name: str, value: Value, overrides: Mapping[str, Value]) -> float:
    found = value_of(name, value, overrides)
    return math.nan if found is None else found


def _is_same(one: float, other: float) -> bool:
    """Return whether two numbers differ by rounding at most, such as that of a unit conversion."""
    return math.isclose(one, other, rel_tol=1e-12)


def _value(belief: _AssumedValue, plant: Mapping[str, float]) -> float:
    """Return the value of a model parameter for a plant; NaN if it is undefined, as for a lead of 0."""
    try:
        return belief.value(
            SimpleNamespace(**{p.rpartition(".")[2].partition("[")[0]: x for p, x in plant.items()})
        )
    except (ZeroDivisionError, OverflowError):
        return math.nan


def get_number(system: System, options: Options, component: str, variable: str) -> float | None:
    """Return a start value in the unit of its model; None if it is unknown before the run."""
    found = next((c for c in system.components if c.name == component), None)
    if found is None or not is_own(component, options):
        return None
    return value_of(f"{component}.{variable}", found.parameters.get(variable), options.set)


def value_of(name: str, value: Value | None, overrides: Mapping[str, Value]) -> float | None:
    """Return a start value as a number in the unit of its model; None if it is unknown before the run.

    Args:
        name: The full name of the variable.
        value: The value in the system: a number, a text with a unit, or None.
        overrides: Values by name or pattern. Names win over patterns, later patterns over earlier ones.
    """
    for pattern, given in overrides.items():
        if matches_pattern(name, pattern):
            value = given
    value = overrides.get(name, value)
    if value in ("true", "false"):
        return float(value == "true")
    if isinstance(value, str):
        try:
            return parse_quantity(value, name).si_number
        except CommandError:
            return None  # a name of an enumeration, or a unit known only with the FMU
    return None if value is None else float(value)


def is_own(component: str, options: Options) -> bool:
    """Return whether a component's outputs follow from its start values: no FMU and no data replaces it.

    Data without names of signals drive the signals that their columns name.
    """
    from_data = any(
        not source.signals or any(name.startswith(f"{component}.") for name in source.signals)
        for source in options.input
    )
    return component not in options.replace and not from_data
