"""Which variable plays which role for a joint.

A joint has a plant and a reference of its own, or a part in those of a machine, which have arrays with an
element for each joint.
"""

from collections.abc import Collection, Iterable

from hdrm_fmu.trajectory import JOINTS

from ..inputs.placing import data_of

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
    **{
        role: (f"{{joint}}.plant.{name}", f"{{joint}}.motor.{name}")
        for role, name in {
            "tau_m": "tau_m",
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
    "q_LB": ("{joint}.plant.screw.q_LB", "machine.plant.screw.q_LB[{element}]"),
    "q_UB": ("{joint}.plant.screw.q_UB", "machine.plant.screw.q_UB[{element}]"),
    "v_max": ("{joint}.plant.screw.v_max", "machine.plant.screw.v_max[{element}]"),
}
"""Where the variable of a role may be, the first that there is."""


def variable(joint: str, role: str, names: Collection[str]) -> str | None:
    """The full name of what plays a role for a joint, one of `names`; None where nothing does.

    Where data are read in its place, it is theirs.
    """
    found = next((name for name in _names(joint, _PLACES[role]) if name in names), None)
    return None if found is None else data_of(found, names)


def tracked(names: Collection[str]) -> dict[str, tuple[str, str]]:
    """Position and reference of each joint that has both among these names."""
    ends = {
        joint: [variable(joint, role, names) for role in ("x_L", "x_d")]
        for joint in dict.fromkeys(name.partition(".")[0] for name in names)
    }
    return {joint: (x, x_d) for joint, (x, x_d) in ends.items() if x is not None and x_d is not None}


def patterns(*roles: str) -> list[str]:
    """Patterns for all names that these roles may have."""
    return list(
        dict.fromkeys(name.format(joint="*", element="*") for role in roles for name in _PLACES[role])
    )


def joints(components: Collection[str]) -> list[str]:
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
