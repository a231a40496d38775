"""The mechanics of actuators, whose motor torques move a machine."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from fmublock import Parameter

_ABOUT: Mapping[str, tuple[str, str | None, str, float | None, Any]] = {
    "J_m": ("motor.J_m", "kg.m2", "Rotor inertia", 0.0, 0.01),
    "B_m": ("motor.B_m", "N.m.s/rad", "Viscous friction of the rotor", 0.0, 1.67e-3),
    "J_c": ("coupling.J_c", "kg.m2", "Coupling inertia", 0.0, 0.0),
    "rho": ("gearbox.rho", None, "Screw turns per motor turn (gear ratio 1/rho)", 1e-9, 1.0),
    "J_GB": ("gearbox.J_GB", "kg.m2", "Gearbox inertia at the motor", 0.0, 0.0),
    "eta_GB": ("gearbox.eta_GB", None, "Efficiency of gearbox and screw", 1e-3, 0.9),
    "lead": ("screw.lead", "m", "Screw travel per turn", 1e-9, 0.01),
    "B_BS": ("screw.B_BS", "N.s/m", "Viscous friction of the screw", 0.0, 0.0),
    "C_eq": ("screw.C_eq", "N", "Torque per travel as printed; 0 is a rigid screw", 0.0, 0.0),
    "F_2": ("uncertainty.F_2", None, "Modelling error of g_2 as a fraction (84)", None, 0.0),
    "v_max": ("screw.v_max", "m/s", "Largest speed of the screw", 0.0, 0.2),
}
"""Name, unit, meaning, lowest and default value of the parameters of actuators, by attribute."""

_LARGEST = {"eta_GB": 1.0}
_SYMBOLS = {"lead": "l_i"}


def actuator_parameters(count: int, values: Mapping[str, Sequence[float]]) -> dict[str, Parameter]:
    """Return the parameters of actuators by attribute, each a vector.

    Args:
        count: The number of actuators.
        values: Start values by attribute, where they are not the default.
    """
    return {
        attribute: Parameter(
            list(values.get(attribute, [default] * count)),
            shape=count,
            unit=unit,
            minimum=minimum,
            maximum=_LARGEST.get(attribute),
            name=name,
            symbol=_SYMBOLS.get(attribute),
            description=about,
        )
        for attribute, (name, unit, about, minimum, default) in _ABOUT.items()
    }


def actuator_values(sources: Sequence[Any]) -> dict[str, list[float]]:
    """Return start values by attribute, from objects with these attributes, one for each actuator."""
    attributes = [attribute for attribute in _ABOUT if sources and hasattr(sources[0], attribute)]
    return {attribute: [getattr(source, attribute) for source in sources] for attribute in attributes}


def screw_forces(v: Any, masses: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """Return the forces of the screws in N without their inertia, and this inertia in kg: A_eq/D_eq.

    The force is (tau_m - (1 + F_2) (B_eq v + C_eq x) + A_eq d_2) / D_eq: this is (5) of each actuator, with
    d_2 and F_2 as in (26) and (84), of which the manipulator gives the rest.

    Args:
        v: Values of the block.
        masses: Mass of each actuator without its motor, kg.
    """
    forces, inertias = [], []
    for i, M_BS in enumerate(masses):
        alpha = 2.0 * math.pi / (v.rho[i] * v.lead[i])  # motor angle per travel (4)
        A_eq = alpha * (v.J_m[i] + v.J_c[i] + v.J_GB[i] + M_BS / (alpha * alpha))  # (6)
        B_eq = alpha * (v.B_m[i] + v.B_BS[i] / (alpha * alpha))
        uncertain = (1.0 + v.F_2[i]) * (B_eq * v.v_L[i] + v.C_eq[i] * v.x_L[i])
        torque = v.tau_m[i] - uncertain + A_eq * v.d_2[i]
        forces.append(torque * alpha * v.eta_GB[i])
        inertias.append(A_eq * alpha * v.eta_GB[i])
    return forces, inertias
