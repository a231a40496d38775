"""The pictures of joints, and of those that move a machine together."""

from collections.abc import Collection, Mapping

from ..views.plots.plotting import Bound, Curve, Panel, Picture
from ..views.plots.style import GREEN, GREY, ORANGE, PURPLE, RED
from .roles import variable

_STROKE = Bound("stroke", ("q_UB",), ("q_LB",))
_SPEED = Bound("largest speed", ("v_max",))
_CURRENT = Bound("largest current of the controller", ("i_limit",))
_VOLTAGE = Bound("longest voltage vector", ("u_max",))
_TORQUE = Bound("largest torque of the controller", ("N_p", "Phi_PM", "i_limit"), scale=1.5)

JOINT_FIGURES: dict[str, Picture] = {
    "tracking": Picture(
        "Tracking",
        (
            Panel(
                "position / m",
                (Curve("reference", "x_d", ORANGE, dashed=True), Curve("screw", "x_L")),
                bound=_STROKE,
            ),
            Panel(
                "speed / (m/s)",
                (Curve("screw", "v_L"), Curve("reference", "v_d", ORANGE, dashed=True)),
                bound=_SPEED,
            ),
        ),
        of="joints",
        find=variable,
        moving="v_d",
    ),
    "errors": Picture(
        "Tracking errors",
        (
            Panel("position / mm", (Curve("", "x_L", less="x_d", scale=1e3),)),
            Panel("position / µm, settled", (Curve("", "x_L", less="x_d", scale=1e6),), True),
            Panel("speed / (mm/s), settled", (Curve("", "v_L", less="v_d", scale=1e3),), True),
        ),
        of="joints",
        find=variable,
        moving="v_d",
    ),
    "currents": Picture(
        "Motor currents",
        (
            Panel(
                "q axis / A",
                (
                    Curve("actual", "i_q"),
                    Curve("commanded", "i_q_ref", ORANGE, dashed=True),
                ),
                bound=_CURRENT,
            ),
            Panel("d axis / A", (Curve("actual", "i_d"),), bound=_CURRENT),
        ),
        of="joints",
        find=variable,
        moving="v_d",
    ),
    "voltages": Picture(
        "Motor voltages after the inverter's limit",
        (
            Panel("q axis / V", (Curve("", "u_q"),), bound=_VOLTAGE),
            Panel("d axis / V", (Curve("", "u_d"),), bound=_VOLTAGE),
        ),
        of="joints",
        find=variable,
        moving="v_d",
    ),
    "torque": Picture(
        "Motor torque and load",
        (
            Panel("motor torque / (N m)", (Curve("", "tau_m"),), bound=_TORQUE),
            Panel("load force / kN", (Curve("", "F_L", GREY, scale=1e-3),)),
        ),
        of="joints",
        find=variable,
        moving="v_d",
    ),
    "power": Picture(
        "Power and energy",
        (
            Panel(
                "power / kW",
                (
                    Curve("electrical", "P_el", scale=1e-3),
                    Curve("at the shaft", "tau_m", PURPLE, times="omega_m", scale=1e-3),
                    Curve("into the load", "P_L", GREEN, scale=1e-3),
                ),
            ),
            Panel(
                "energy / kJ",
                (
                    Curve("electrical", "P_el", scale=1e-3, integrated=True),
                    Curve("into the load", "P_L", GREEN, scale=1e-3, integrated=True),
                    Curve("losses and motion", "P_el", RED, less="P_L", scale=1e-3, integrated=True),
                ),
            ),
        ),
        of="joints",
        find=variable,
        moving="v_d",
    ),
    "adaptation": Picture(
        "Adaptation of the controller",
        (
            Panel(
                "theta of position and speed",
                (Curve("position", "theta_1"), Curve("speed", "theta_2", ORANGE)),
            ),
            Panel(
                "theta of currents",
                (Curve("q axis", "theta_3"), Curve("d axis", "theta_4", ORANGE)),
            ),
        ),
        of="joints",
        find=variable,
        moving="v_d",
    ),
    "observer": Picture(
        "Observer errors",
        (
            Panel("position / µm", (Curve("", "x_hat", less="x_L", scale=1e6),)),
            Panel("speed / (mm/s)", (Curve("", "v_hat", less="v_L", scale=1e3),)),
        ),
        of="joints",
        find=variable,
        moving="v_d",
    ),
}
"""The pictures of a joint by file name; their signals are roles."""


def _in_machine(joint: str, role: str, names: Collection[str], roles: Mapping[str, str]) -> str | None:
    """`variable` where joints move a machine together."""
    there = any(name.startswith("machine.") for name in names)
    return variable(joint, role, names, roles) if there else None


MACHINE_FIGURES: dict[str, Picture] = {
    "forces": Picture(
        "Forces and speeds of the pistons",
        (
            Panel("load force / kN", (Curve("", "F_L", scale=1e-3),)),
            Panel(
                "speed / (mm/s)",
                (
                    Curve("piston", "v_L", scale=1e3),
                    Curve("reference", "v_d", ORANGE, scale=1e3, dashed=True),
                ),
            ),
        ),
        of="joints",
        find=_in_machine,
    ),
    "motion": Picture(
        "Positions and accelerations of the pistons",
        (
            Panel("position / m", (Curve("piston", "x_L"), Curve("reference", "x_d", ORANGE, dashed=True))),
            Panel(
                "acceleration / (m/s²), settled",
                (Curve("piston", "a_L"), Curve("reference", "a_d", ORANGE, dashed=True)),
                late=True,
            ),
        ),
        of="joints",
        find=_in_machine,
    ),
}
"""The pictures of a machine's joints by file name, as the paper's figures 8 and 9 have them."""
