"""The manipulator and the mechanics of its three actuators, merged."""

import math
from typing import Any

from fmublock import DefaultExperiment, Input, Output, Parameter, State

from . import kinematics
from .dynamics import energy, forward_dynamics, inverse_dynamics
from .machine import Machine, closes_at
from .manipulator import HdrmManipulator


class HdrmPlant(Machine):
    """3-DoF manipulator with the mechanics of its three actuators: motor torques in, motion out.

    This is the reference for three actuators and a manipulator that exchange motion and force. Lift, tilt
    and telescope are elements 1, 2 and 3.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-3)

    internal_step = Parameter(
        1e-3,
        unit="s",
        minimum=1e-9,
        name="solver.internal_step",
        description="Longest internal integration step (classical Runge-Kutta)",
    )

    tau_m = Input(shape=3, unit="N.m", nominal=10.0, description="Motor torque that drives the screw")
    d_2 = Input(shape=3, unit="m/s2", description="Disturbance of the screw's acceleration")
    J_m = Parameter(
        (0.016, 0.0105, 0.00085),
        shape=3,
        unit="kg.m2",
        minimum=0.0,
        name="motor.J_m",
        description="Rotor inertia",
    )
    B_m = Parameter(
        1.67e-3,
        shape=3,
        unit="N.m.s/rad",
        minimum=0.0,
        name="motor.B_m",
        description="Viscous friction of the rotor",
    )
    J_c = Parameter(
        0.0, shape=3, unit="kg.m2", minimum=0.0, name="coupling.J_c", description="Coupling inertia"
    )
    rho = Parameter(
        (1.0 / 7.0, 1.0 / 5.0, 1.0),
        shape=3,
        minimum=1e-9,
        name="gearbox.rho",
        description="Screw turns per motor turn (gear ratio 1/rho)",
    )
    J_GB = Parameter(
        0.0,
        shape=3,
        unit="kg.m2",
        minimum=0.0,
        name="gearbox.J_GB",
        description="Gearbox inertia at the motor",
    )
    eta_GB = Parameter(
        0.9,
        shape=3,
        minimum=1e-3,
        maximum=1.0,
        name="gearbox.eta_GB",
        description="Efficiency of gearbox and screw",
    )
    lead = Parameter(
        (0.02, 0.01, 0.01),
        shape=3,
        unit="m",
        minimum=1e-9,
        name="screw.lead",
        symbol="l_i",
        description="Screw travel per turn",
    )
    B_BS = Parameter(
        0.0,
        shape=3,
        unit="N.s/m",
        minimum=0.0,
        name="screw.B_BS",
        description="Viscous friction of the screw",
    )
    C_eq = Parameter(
        0.0,
        shape=3,
        unit="N",
        minimum=0.0,
        name="screw.C_eq",
        description="Torque per travel as printed; 0 is a rigid screw",
    )
    F_2 = Parameter(
        0.0,
        shape=3,
        name="uncertainty.F_2",
        description="Modelling error of g_2 as a fraction (84)",
    )
    v_max = Parameter(
        (0.136, 0.1, 0.21),
        shape=3,
        unit="m/s",
        minimum=0.0,
        name="screw.v_max",
        description="Largest speed of the screw",
    )
    x_L_start = Parameter(
        (0.244, 0.389, 0.499), shape=3, unit="m", name="start.x_L", description="Initial screw position"
    )
    v_L_start = Parameter(0.0, shape=3, unit="m/s", name="start.v_L", description="Initial screw speed")

    x_L = State(
        x_L_start,
        shape=3,
        unit="m",
        nominal=0.1,
        limits=(Machine.q_LB, Machine.q_UB),
        symbol="q_i",
        description="Screw position",
    )
    v_L = State(
        v_L_start,
        shape=3,
        unit="m/s",
        nominal=0.1,
        limits=v_max,
        symbol=r"\dot{q}_i",
        description="Screw speed",
    )

    a_L = Output(shape=3, unit="m/s2", symbol=r"\ddot{q}_i", description="Screw acceleration")
    F_L, tip_x, tip_y = HdrmManipulator.F_L, HdrmManipulator.tip_x, HdrmManipulator.tip_y
    energy = Output(
        unit="J",
        nominal=1e4,
        description="Energy of manipulator and actuators; potential energy relative to O1",
    )

    def conditions(self, v: Any) -> dict[str, Any]:
        """Return the conditions of the machine, also at the initial strokes."""
        return {**super().conditions(v), **closes_at(v, v.x_L_start, "start.x_L")}

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return speeds and accelerations of the three screws."""
        return {"x_L": v.v_L, "v_L": self.acceleration(v)}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return accelerations, the forces between actuators and manipulator, tip, and energy."""
        a_L = self.acceleration(v)
        tip_x, tip_y = kinematics.tip(v, v.x_L)
        return {
            "a_L": a_L,
            "F_L": inverse_dynamics(v, v.x_L, v.v_L, a_L, v.payload),
            "tip_x": tip_x,
            "tip_y": tip_y,
            "energy": energy(v, v.x_L, v.v_L, v.payload, self.reflected_inertia(v)),
        }

    def acceleration(self, v: Any) -> list[Any]:
        """Return the screw accelerations in m/s2.

        (M + diag(A_eq/D_eq)) a = (tau_m - (1 + F_2) (B_eq v + C_eq x) + A_eq d_2) / D_eq - bias: this is
        (5) of each actuator, with d_2 and F_2 as in (26) and (84), solved together with the manipulator.
        """
        force = []
        for i in range(3):
            alpha = self.alpha_RL(v, i)
            B_eq = alpha * (v.B_m[i] + v.B_BS[i] / (alpha * alpha))
            uncertain = (1.0 + v.F_2[i]) * (B_eq * v.v_L[i] + v.C_eq[i] * v.x_L[i])
            torque = v.tau_m[i] - uncertain + self.A_eq(v, i) * v.d_2[i]
            force.append(torque * alpha * v.eta_GB[i])
        return forward_dynamics(v, v.x_L, v.v_L, force, v.payload, self.reflected_inertia(v))

    def reflected_inertia(self, v: Any) -> list[Any]:
        """Return A_eq/D_eq of the actuators in kg: the inertia of motor, gear and screw at the screw."""
        return [self.A_eq(v, i) * self.alpha_RL(v, i) * v.eta_GB[i] for i in range(3)]

    def A_eq(self, v: Any, i: int) -> Any:
        """Return the motor torque per screw acceleration of an actuator, in kg m (6)."""
        alpha = self.alpha_RL(v, i)
        return alpha * (v.J_m[i] + v.J_c[i] + v.J_GB[i] + v.M_BS[i] / (alpha * alpha))

    def alpha_RL(self, v: Any, i: int) -> Any:
        """Return the motor angle per screw travel of an actuator, 2 pi / (rho l), in rad/m (4)."""
        return 2.0 * math.pi / (v.rho[i] * v.lead[i])
