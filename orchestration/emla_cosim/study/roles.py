"""Which variable plays which role for a joint.

A joint has a plant and a reference of its own, or a part in those of a machine, which have arrays with an
element for each joint.
"""

from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
from typing import TypeVar

from hdrm_fmu.trajectory import JOINTS

from ..base.errors import CommandError, join_names, suggest_names
from ..inputs.data_names import find_data_names

_PLACES: dict[str, tuple[str, ...]] = {
    "x_L": ("{joint}.plant.x_L", "machine.plant.x_L[{element}]"),
    "v_L": ("{joint}.plant.v_L", "machine.plant.v_L[{element}]"),
    "a_L": ("{joint}.plant.a_L", "machine.plant.a_L[{element}]"),
    "x_d": ("{joint}.reference.x_d", "machine.trajectory.x_d[{element}]"),
    "v_d": ("{joint}.reference.v_d", "machine.trajectory.v_d[{element}]"),
    "a_d": ("{joint}.reference.a_d", "machine.trajectory.a_d[{element}]"),
    "F_L": ("machine.manipulator.F_L[{element}]", "machine.plant.F_L[{element}]", "{joint}.disturbance.F_L"),
    "x_hat": ("{joint}.observer.x_hat",),
    "v_hat": ("{joint}.observer.v_hat",),
    "i_q_ref": ("{joint}.controller.i_q_ref",),
    "limited_control": ("{joint}.controller.saturated",),
    "i_limit": ("{joint}.controller.limit.i_max",),
    **{f"theta_{i}": (f"{{joint}}.controller.theta[{i}]",) for i in range(1, 5)},
    **{
        role: (f"{{joint}}.plant.{name}", f"{{joint}}.motor.{name}")
        for role, name in {
            "tau_m": "tau_m",
            "omega_m": "omega_m",
            "P_el": "P_el",
            "P_L": "P_L",
            "N_p": "motor.N_p",
            "Phi_PM": "motor.Phi_PM",
            "u_max": "inverter.u_max",
            "i_q": "i_q",
            "i_d": "i_d",
            "u_q": "inverter.u_q",
            "u_d": "inverter.u_d",
            "limited_inverter": "inverter.saturated",
            "temperature_rise": "motor.temperature_rise",
            "i_max": "motor.i_max",
            "permitted_rise": "motor.permitted_rise",
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
        }.items()
    },
    "q_LB": ("{joint}.plant.screw.q_LB", "machine.plant.screw.q_LB[{element}]"),
    "q_UB": ("{joint}.plant.screw.q_UB", "machine.plant.screw.q_UB[{element}]"),
    "v_max": ("{joint}.plant.screw.v_max", "machine.plant.screw.v_max[{element}]"),
}
"""Where the variable of a role may be, the first that there is."""

INERTIA = ("J_m", "J_c", "J_GB", "M_BS", "rho", "lead")
"""The roles of what makes the inertia of a joint."""

_PARAMETERS = (
    "N_p",
    "Phi_PM",
    "i_limit",
    "i_max",
    "permitted_rise",
    "q_LB",
    "q_UB",
    "u_max",
    "v_max",
    *INERTIA,
)
"""The roles of parameters."""


_T = TypeVar("_T")


class RoleNames(dict[str, _T]):
    """Values by the names of variables, in which many roles are looked for."""

    @cached_property
    def data(self) -> dict[str, str]:
        """Under which name data are read, by the signal in whose place they are."""
        return find_data_names(self)


def find_variable(
    joint: str, role: str, names: Collection[str], roles: Mapping[str, str] | None = None
) -> str | None:
    """The full name of what plays a role for a joint, one of `names`; None where nothing does.

    What `roles` names by joint.role goes before the places above. Where data are read in its place, it is
    theirs. Who asks for many roles gives `RoleNames`.
    """
    given = (roles or {}).get(f"{joint}.{role}")
    places = _names(joint, _PLACES[role]) if given is None else (given,)
    found = next((name for name in places if name in names), None)
    if found is None:
        return None
    data = names.data if isinstance(names, RoleNames) else find_data_names(names)
    return data.get(found, found)


def find_all_joints(names: Iterable[str], roles: Mapping[str, str]) -> list[str]:
    """What may be a joint: the first part of each name, and what has a role."""
    return list(dict.fromkeys([*(n.partition(".")[0] for n in names), *list_given_joints(roles)]))


def list_given_joints(roles: Mapping[str, str]) -> list[str]:
    """The joints that have roles."""
    return list(dict.fromkeys(name.rpartition(".")[0] for name in roles))


def check_roles(roles: Mapping[str, str], signals: Collection[str], parameters: Collection[str]) -> None:
    """Raise CommandError for a role, a signal or a parameter that there is not, and for half a joint."""
    signals, parameters = RoleNames(dict.fromkeys(signals)), RoleNames(dict.fromkeys(parameters))
    for place, name in roles.items():
        joint, _, role = place.rpartition(".")
        if not joint or role not in _PLACES:
            right = f"write JOINT.ROLE, with one of {join_names(_PLACES)} as the role"
            raise CommandError(f"there is no role '{place}'; {right}.", role=place)
        bounds = role in _PARAMETERS
        if name not in (parameters if bounds else signals):
            kind, there = ("parameter", parameters) if bounds else ("signal", signals)
            meant = suggest_names(name, there)
            raise CommandError(f"there is no {kind} '{name}' for the role {place}; {meant}", name=name)
    for joint in list_given_joints(roles):
        missing = [role for role in ("x_L", "x_d") if find_variable(joint, role, signals, roles) is None]
        if missing:
            entries = join_names(f"{joint}.{role}" for role in missing)
            raise CommandError(f"the joint '{joint}' has roles, but nobody plays {entries}: name it too.")


def find_tracked_joints(names: Collection[str], roles: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """Position and reference of each joint that has both among these names."""
    names = RoleNames(dict.fromkeys(names))
    ends = {
        joint: [find_variable(joint, role, names, roles) for role in ("x_L", "x_d")]
        for joint in find_all_joints(names, roles)
    }
    return {joint: (x, x_d) for joint, (x, x_d) in ends.items() if x is not None and x_d is not None}


def list_role_patterns(*roles: str) -> list[str]:
    """Patterns for all names that these roles may have."""
    return list(
        dict.fromkeys(name.format(joint="*", element="*") for role in roles for name in _PLACES[role])
    )


def find_joints(components: Collection[str]) -> list[str]:
    """The joints that have a position and a reference, of a system with components of these names."""
    branches = dict.fromkeys(name.partition(".")[0] for name in components)
    return [b for b in branches if all(_component(b, role, components) for role in ("x_L", "x_d"))]


def _component(joint: str, role: str, components: Collection[str]) -> bool:
    return any(".".join(name.split(".")[:2]) in components for name in _names(joint, _PLACES[role]))


def _names(joint: str, places: Iterable[str]) -> Iterable[str]:
    element = JOINTS.index(joint) + 1 if joint in JOINTS else None
    return (
        place.format(joint=joint, element=element)
        for place in places
        if element is not None or "{element}" not in place
    )
