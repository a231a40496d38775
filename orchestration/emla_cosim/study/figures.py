"""The pictures of joints."""

from ..results.plotting import Curve, Panel, Picture
from ..results.style import GREY, ORANGE

JOINT_FIGURES: dict[str, Picture] = {
    "tracking": Picture(
        "Tracking",
        (
            Panel(
                "position / m",
                (Curve("reference", "reference.x_d", ORANGE, dashed=True), Curve("screw", "plant.x_L")),
            ),
            Panel(
                "speed / (m/s)",
                (Curve("screw", "plant.v_L"), Curve("reference", "reference.v_d", ORANGE, dashed=True)),
            ),
        ),
        of="joints",
    ),
    "errors": Picture(
        "Tracking errors",
        (
            Panel("position / mm", (Curve("", "plant.x_L", less="reference.x_d", scale=1e3),)),
            Panel("position / µm, settled", (Curve("", "plant.x_L", less="reference.x_d", scale=1e6),), True),
            Panel(
                "speed / (mm/s), settled", (Curve("", "plant.v_L", less="reference.v_d", scale=1e3),), True
            ),
        ),
        of="joints",
    ),
    "currents": Picture(
        "Motor currents",
        (
            Panel(
                "q axis / A",
                (
                    Curve("actual", "plant.i_q"),
                    Curve("commanded", "controller.i_q_ref", ORANGE, dashed=True),
                ),
            ),
            Panel("d axis / A", (Curve("actual", "plant.i_d"),)),
        ),
        of="joints",
    ),
    "voltages": Picture(
        "Motor voltages after the inverter's limit",
        (
            Panel("q axis / V", (Curve("", "plant.inverter.u_q"),)),
            Panel("d axis / V", (Curve("", "plant.inverter.u_d"),)),
        ),
        of="joints",
    ),
    "torque": Picture(
        "Motor torque and load",
        (
            Panel("motor torque / (N m)", (Curve("", "plant.tau_m"),)),
            Panel("load force / kN", (Curve("", "disturbance.F_L", GREY, scale=1e-3),)),
        ),
        of="joints",
    ),
    "observer": Picture(
        "Observer errors",
        (
            Panel("position / µm", (Curve("", "observer.x_hat", less="plant.x_L", scale=1e6),)),
            Panel("speed / (mm/s)", (Curve("", "observer.v_hat", less="plant.v_L", scale=1e3),)),
        ),
        of="joints",
    ),
}
"""The pictures of a joint by file name."""
