"""The manipulator as a load: motion in, forces out."""

from typing import Any

from fmublock import DefaultExperiment, Input, Output

from . import kinematics
from .dynamics import inverse_dynamics
from .machine import Machine, closes_at


class HdrmManipulator(Machine):
    """Load forces of the 3-DoF manipulator by recursive Newton-Euler inverse dynamics.

    Lift, tilt and telescope are elements 1, 2 and 3. The names are those of the actuators' outputs.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-3)

    x_L = Input((0.244, 0.389, 0.499), shape=3, unit="m", nominal=0.1, symbol="q_i", description="Stroke")
    v_L = Input(shape=3, unit="m/s", nominal=0.1, symbol=r"\dot{q}_i", description="Speed of a stroke")
    a_L = Input(shape=3, unit="m/s2", symbol=r"\ddot{q}_i", description="Acceleration of a stroke")

    F_L = Output(
        shape=3,
        unit="N",
        nominal=1e4,
        description="Load force, positive against extension",
    )
    tip_x = Output(unit="m", name="tip.x", description="Horizontal position of the tip from O1")
    tip_y = Output(unit="m", name="tip.y", description="Height of the tip above O1")

    def conditions(self, v: Any) -> dict[str, Any]:
        """Return the conditions of the machine, also at the actuators' initial strokes."""
        return {**super().conditions(v), **closes_at(v, v.x_L, "x_L")}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the forces for the motion, and the position of the tip."""
        tip_x, tip_y = kinematics.tip(v, v.x_L)
        return {
            "F_L": inverse_dynamics(v, v.x_L, v.v_L, v.a_L, v.payload),
            "tip_x": tip_x,
            "tip_y": tip_y,
        }
