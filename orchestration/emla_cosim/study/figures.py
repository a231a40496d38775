"""The pictures of joints, and of those that move a machine together."""

from collections.abc import Collection, Mapping

from ..results.plotting import Curve, Panel, Picture
from ..results.style import GREY, ORANGE
from .roles import variable

JOINT_FIGURES: dict[str, Picture] = {
    "tracking": Picture(
        "Tracking",
        (
            Panel(
                "position / m",
                (Curve("reference", "x_d", ORANGE, dashed=True), Curve("screw", "x_L")),
            ),
            Panel(
                "speed / (m/s)",
                (Curve("screw", "v_L"), Curve("reference", "v_d", ORANGE, dashed=True)),
            ),
        ),
        of="joints",
        find=variable,
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
            ),
            Panel("d axis / A", (Curve("actual", "i_d"),)),
        ),
        of="joints",
        find=variable,
    ),
    "voltages": Picture(
        "Motor voltages after the inverter's limit",
        (
            Panel("q axis / V", (Curve("", "u_q"),)),
            Panel("d axis / V", (Curve("", "u_d"),)),
        ),
        of="joints",
        find=variable,
    ),
    "torque": Picture(
        "Motor torque and load",
        (
            Panel("motor torque / (N m)", (Curve("", "tau_m"),)),
            Panel("load force / kN", (Curve("", "F_L", GREY, scale=1e-3),)),
        ),
        of="joints",
        find=variable,
    ),
    "observer": Picture(
        "Observer errors",
        (
            Panel("position / µm", (Curve("", "x_hat", less="x_L", scale=1e6),)),
            Panel("speed / (mm/s)", (Curve("", "v_hat", less="v_L", scale=1e3),)),
        ),
        of="joints",
        find=variable,
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
