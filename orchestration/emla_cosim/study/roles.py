"""Roles of variables for a joint.

A joint has its own plant and reference, or shares those of a machine, which have arrays with an element
for each joint. Which element is that of a joint follows from the connections of the system.
"""

import math
import re
from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
from typing import TypeVar

from ..base.errors import CommandError, join_names, suggest_names
from ..inputs.input import find_data_names
from ..system.model import System

_MOTION = ("x", "v", "a")

_PATTERNS: dict[str, tuple[str, ...]] = {
    **{
        f"{name}_{end}": tuple(pattern.format(name=f"{name}_{end}") for pattern in patterns)
        for end, patterns in {
            "L": ("{{joint}}.plant.{name}", "machine.plant.{name}[{{element}}]"),
            "d": ("{{joint}}.reference.{name}", "machine.trajectory.{name}[{{element}}]"),
            "c": ("{{joint}}.command.{name}",),
            "s": ("{{joint}}.command.{name}",),
        }.items()
        for name in _MOTION
    },
    "d_2": ("{joint}.disturbance.d_2",),
    "F_L": (
        # first, as it is the sum of what acts
        "{joint}.plant.load.force",  # with the force along the stroke
        "{joint}.plant.F_L",  # data that replace the connection
        "machine.manipulator.F_L[{element}]",
        "machine.plant.F_L[{element}]",
        "{joint}.disturbance.F_L",
    ),
    "F_t": ("{joint}.plant.F_L", "{joint}.disturbance.F_L"),  # the load force without that along the stroke
    "period": ("{joint}.reference.period",),
    "x_load": ("{joint}.plant.load.x",),
    "v_load": ("{joint}.plant.load.v",),
    **{f"f_notch_{i}": (f"{{joint}}.command.notch.frequency[{i}]",) for i in (1, 2)},
    **{f"zeta_notch_{i}": (f"{{joint}}.command.notch.damping_ratio[{i}]",) for i in (1, 2)},
    "z": ("{joint}.command.correction",),
    "z_max": ("{joint}.command.feedback.limit",),
    "k_0": ("{joint}.command.feedback.k_0",),
    "assumed_stiffness": ("{joint}.command.model.stiffness",),
    "start_deflection": ("{joint}.plant.start.deflection",),
    "F_T": ("{joint}.plant.transmission.force",),
    "x_hat": ("{joint}.observer.x_hat",),
    "v_hat": ("{joint}.observer.v_hat",),
    "i_q_ref": ("{joint}.controller.i_q_ref",),
    "limited_control": ("{joint}.controller.saturated",),
    "i_limit": ("{joint}.controller.limit.i_max",),
    **{f"theta_{i}": (f"{{joint}}.controller.theta[{i}]",) for i in range(1, 5)},
    **{
        role: (f"{{joint}}.plant.{name}", f"{{joint}}.motor.{name}")
        for role, name in {
            **{name: name for name in ("tau_m", "omega_m", "P_el", "P_L", "i_q", "i_d")},
            "N_p": "motor.N_p",
            "Phi_PM": "motor.Phi_PM",
            "u_max": "inverter.u_max",
            "u_q": "inverter.u_q",
            "u_d": "inverter.u_d",
            "limited_inverter": "inverter.saturated",
            "temperature_rise": "motor.temperature_rise",
            "i_max": "motor.i_max",
            "permitted_rise": "motor.permitted_rise",
            "ideal_torque": "use_commanded_current",
            "directional": "gearbox.directional",
            "i_N": "motor.i_N",
            "tau_th": "motor.tau_th",
            "lead_error": "screw.lead_error",
            "wobble": "screw.wobble",
            "sigma": "sensor.sigma",
            "resolution": "sensor.resolution",
            "eccentricity": "sensor.eccentricity",
            "sigma_i": "sensor.current.sigma",
            "resolution_i": "sensor.current.resolution",
            "delay": "inverter.delay",
            "dead_time": "inverter.dead_time",
        }.items()
    },
    **{
        role: (f"{{joint}}.plant.{name}",)
        for role, name in {
            "F_C": "friction.F_C",
            "F_S": "friction.F_S",
            "stiffness": "transmission.stiffness",
            "backlash": "transmission.backlash",
        }.items()
    },
    **{
        role: (f"{{joint}}.plant.{name}", f"{{joint}}.motor.{name}", f"machine.plant.{name}[{{element}}]")
        for role, name in {
            "J_m": "motor.J_m",
            "J_c": "coupling.J_c",
            "J_GB": "gearbox.J_GB",
            "M_BS": "screw.M_BS",
            "rho": "gearbox.rho",
            "lead": "screw.lead",
            "eta_GB": "gearbox.eta_GB",
            "B_BS": "screw.B_BS",
            "C_eq": "screw.C_eq",
        }.items()
    },
    **{
        role: (f"{{joint}}.plant.screw.{role}", f"machine.plant.screw.{role}[{{element}}]")
        for role in ("q_LB", "q_UB", "v_max")
    },
}
"""Possible names of a role's variable; the first existing one counts."""

_FALLBACK_ROLES = {f"{name}_{end}": f"{name}_d" for name in _MOTION for end in ("c", "s")}
"""Roles that are those of the reference where no `ScrewCommand` changes it: the commanded motion of the
screw, and the reference motion of the load after the notches."""

INERTIA = ("J_m", "J_c", "J_GB", "M_BS", "rho", "lead")
"""The roles of the parameters that make the inertia of a joint."""

_PARAMETERS = (
    *("N_p", "Phi_PM", "directional", "eta_GB", "i_limit", "ideal_torque", "i_max", "permitted_rise"),
    *("q_LB", "q_UB", "u_max", "v_max", *INERTIA),
    *("F_C", "F_S", "B_BS", "C_eq", "lead_error", "wobble", "stiffness", "backlash"),
    *("sigma", "resolution", "eccentricity", "sigma_i", "resolution_i", "delay", "dead_time"),
    *("i_N", "tau_th", "period", "z_max", "k_0", "assumed_stiffness", "start_deflection"),
    *("f_notch_1", "f_notch_2", "zeta_notch_1", "zeta_notch_2"),
)
"""The roles of parameters."""


_T = TypeVar("_T")


class RoleNames(dict[str, _T]):
    """Values by names of variables, for looking up many roles."""

    @cached_property
    def data(self) -> dict[str, str]:
        """Names of the data by the signals that they replace."""
        return find_data_names(self)


def find_variable(
    joint: str, role: str, names: Collection[str], roles: Mapping[str, str] | None = None
) -> str | None:
    """Return the full name of the variable that has a role for a joint; None if there is none.

    If data replace the variable, return the name of the data. The reference commands the screw if nothing
    else does.

    Args:
        joint: The joint.
        role: The role.
        names: Existing names; use `RoleNames` to look up many roles.
        roles: Names by JOINT.ROLE, which override the default ones.
    """
    override = (roles or {}).get(f"{joint}.{role}")
    candidates = (
        _format_patterns(_PATTERNS[role], joint, find_element(joint, roles))
        if override is None
        else (override,)
    )
    data = names.data if isinstance(names, RoleNames) else find_data_names(names)
    variable = next((data.get(name, name) for name in candidates if name in data or name in names), None)
    # the reference commands the screw if nothing else does
    if variable is None and role in _FALLBACK_ROLES:
        return find_variable(joint, _FALLBACK_ROLES[role], names, roles)
    return variable


def find_values(
    joint: str, parameters: Mapping[str, float], roles: Mapping[str, str] | None, *parameter_roles: str
) -> list[float]:
    """Return the values of a joint's parameters by their roles; NaN for one that does not exist."""
    names = (find_variable(joint, role, parameters, roles) for role in parameter_roles)
    return [math.nan if name is None else parameters[name] for name in names]


def find_all_joints(names: Iterable[str], roles: Mapping[str, str]) -> list[str]:
    """Return possible joints: the first part of each name, and joints with roles."""
    return list(dict.fromkeys([*(n.partition(".")[0] for n in names), *list_joints_with_roles(roles)]))


def list_joints_with_roles(roles: Mapping[str, str]) -> list[str]:
    """Return the joints that have roles."""
    return list(dict.fromkeys(name.rpartition(".")[0] for name in roles))


def check_roles(roles: Mapping[str, str], signals: Collection[str], parameters: Collection[str]) -> None:
    """Raise CommandError for an unknown role or name, or for a joint without position or reference."""
    signals, parameters = RoleNames(dict.fromkeys(signals)), RoleNames(dict.fromkeys(parameters))
    for joint_role, name in roles.items():
        joint, _, role = joint_role.rpartition(".")
        if not joint or role not in _PATTERNS:
            correction = f"write JOINT.ROLE, with one of {join_names(_PATTERNS)} as the role"
            raise CommandError(f"there is no role '{joint_role}'; {correction}.", role=joint_role)
        is_parameter = role in _PARAMETERS
        if name not in (parameters if is_parameter else signals):
            kind, existing = ("parameter", parameters) if is_parameter else ("signal", signals)
            suggestion = suggest_names(name, existing)
            raise CommandError(
                f"there is no {kind} '{name}' for the role {joint_role}; {suggestion}", name=name
            )
    for joint in list_joints_with_roles(roles):
        missing = [role for role in ("x_L", "x_d") if find_variable(joint, role, signals, roles) is None]
        if missing:
            entries = join_names(f"{joint}.{role}" for role in missing)
            raise CommandError(f"the joint '{joint}' has roles, but lacks {entries}; add a signal for each.")


def find_tracked_joints(names: Collection[str], roles: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Return position and commanded position of each screw for which both are among the names."""
    return _find_pairs(("x_L", "x_c"), names, roles)


def find_tracked_loads(names: Collection[str], roles: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Return position and reference position of each load for which both are among the names."""
    return _find_pairs(("x_load", "x_s"), names, roles)


def _find_pairs(
    pair: tuple[str, str], names: Collection[str], roles: Mapping[str, str]
) -> dict[str, tuple[str, str]]:
    """Return the variables of two roles by joint, for joints that have both."""
    names = RoleNames(dict.fromkeys(names))
    ends = {
        joint: [find_variable(joint, role, names, roles) for role in pair]
        for joint in find_all_joints(names, roles)
    }
    return {joint: (x, x_d) for joint, (x, x_d) in ends.items() if x is not None and x_d is not None}


def describe_error(joint: str, reference: str) -> str:
    """Return how messages call the position error from a reference, which they name if it is a command."""
    return (
        f"position error from {reference}" if reference.startswith(f"{joint}.command.") else "position error"
    )


def list_role_patterns(*roles: str) -> list[str]:
    """Return patterns for all possible names of these roles."""
    patterns = (
        pattern
        for role in roles
        for name in (role, _FALLBACK_ROLES.get(role, role))
        for pattern in _PATTERNS[name]
    )
    return list(dict.fromkeys(pattern.format(joint="*", element="*") for pattern in patterns))


def find_joints(system: System) -> list[str]:
    """Return the joints of a system that have position and reference."""
    components = {c.name for c in system.components}
    roles = find_machine_roles(map(str, system.connections))

    def has_component(joint: str, role: str) -> bool:
        names = _format_patterns(_PATTERNS[role], joint, find_element(joint, roles))
        return any(".".join(name.split(".")[:2]) in components for name in names)

    return [joint for joint in system.branches if has_component(joint, "x_L") and has_component(joint, "x_d")]


def find_machine_roles(connections: Iterable[str]) -> dict[str, str]:
    """Return the roles of joints that the trajectory of a machine moves, such as lift.x_d.

    Args:
        connections: Connections as texts, such as "machine.trajectory.x_d[1] -> lift.controller.x_d".
    """
    matches = filter(None, map(_FROM_TRAJECTORY.match, connections))
    return {f"{match['joint']}.{match['role']}": match["name"] for match in matches}


def find_element(joint: str, roles: Mapping[str, str] | None) -> int | None:
    """Return the element of a joint in arrays of its machine, from its roles; None if it has none."""
    for name in _MOTION:
        if match := _ELEMENT.fullmatch((roles or {}).get(f"{joint}.{name}_d", "")):
            return int(match["element"])
    return None


_FROM_TRAJECTORY = re.compile(
    r"(?P<name>machine\.trajectory\.(?P<role>[xva]_d)\[\d+\]) -> (?P<joint>(?!machine\.)[^. ]+)\."
)
_ELEMENT = re.compile(r"machine\.trajectory\.[xva]_d\[(?P<element>\d+)\]")


def _format_patterns(patterns: Iterable[str], joint: str, element: int | None) -> Iterable[str]:
    """Return the names for a joint; without an element, those of arrays are left out."""
    return (
        pattern.format(joint=joint, element=element)
        for pattern in patterns
        if element is not None or "{element}" not in pattern
    )
