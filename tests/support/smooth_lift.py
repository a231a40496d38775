"""The lift joint in smooth motion, as a system of FMUs and as one equation."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from emla_cosim.study.loading import load
from emla_cosim.system.model import System
from tests.support import reference_model as paper

# The lift joint of the study in the middle of its move, with a number wherever the paper's own
# makes a term vanish: L_d = L_q hides reluctance, 0 hides a part's inertia, friction and stiffness.
MOVE_TIME = 15.0 * 0.026 / (8.0 * 0.0607)
MOTION = paper.Motion(waypoints=(0.244, 0.270), starts=(-0.3 * MOVE_TIME,), durations=(MOVE_TIME,))
PLANT = paper.Actuator(
    L_d=2.0e-3,
    J_c=1e-3,
    J_GB=5e-4,
    B_BS=50.0,
    C_eq=2.0,
    u_max=math.sqrt(2.0) * 315.0,
    F=(0.01, 0.002, 0.001),  # (84)
)
SURROUNDINGS = paper.Surroundings(
    levels=(57e3,),
    sines_2=((0.8, 8.0, 0.0), (0.7, 20.0, 0.0)),  # (82)
    arctan_2=1.2,
    decay_2=3.0,
    cosines_3=((0.42, 8.0, math.pi / 3.0), (0.032, 5.0, -math.pi / 2.0)),  # (83)
    cosine_4=(-0.15, 12.0, math.pi / 6.0),
)
M_0 = 1e-4
"""m of the observer. Its own 1e-6 lets f feel the kink of |y_bar| where y_bar is as small as the
distance travelled in a step, so that the error has no expansion in powers of the step."""
x_0, v_0, _ = paper.reference(MOTION, 0.0)
START = {
    "x_L": x_0 + 3e-6,  # within a_max / k^2 = 7.5e-6 m, where limit_acceleration does nothing
    "v_L": v_0 + 1e-3,
    "i_q": 5.0,
    "i_d": 2.0,
    "x_hat": x_0 + 3.5e-6,
    "v_hat": v_0,
    "eta_hat": 1.0,
}
"""What is not here starts from 0."""
_OWNERS = dict.fromkeys(paper.JOINT_STATES[:4], "plant") | dict.fromkeys(paper.JOINT_STATES[4:9], "observer")
STATE_SIGNALS = tuple(f"lift.{_OWNERS.get(state, 'controller')}.{state}" for state in paper.JOINT_STATES)
"""Names of the signals that are `JOINT_STATES`, in their order."""


def lift(gains: str = "robust") -> System:
    """The lift joint as the scenario has it with these gains, in the setting above."""
    start_values = {
        "plant.motor.L_d": PLANT.L_d,
        "plant.coupling.J_c": PLANT.J_c,
        "plant.gearbox.J_GB": PLANT.J_GB,
        "plant.screw.B_BS": PLANT.B_BS,
        "plant.screw.C_eq": PLANT.C_eq,
        "controller.model.C_eq": PLANT.C_eq,
        "plant.sensor.resolution": 0.0,
        "observer.m_0": M_0,
        "reference.move.start[1]": MOTION.starts[0],
        "plant.start.x_L": START["x_L"],
        "observer.start.x_hat": START["x_hat"],
        **{f"plant.{name}": START[name] for name in ("v_L", "i_q", "i_d")},
        "observer.start.eta_hat": START["eta_hat"],
        "observer.v_hat": START["v_hat"],
    }
    if gains == "compensated":  # with its gain of the position, braking begins at a tenth of the distance
        start_values["controller.limit.a_max"] = 12.0
    system = load("lift", gains=gains).system
    return system.with_parameters({f"lift.{name}": value for name, value in start_values.items()})


def joint(system: System) -> paper.Joint:
    """The same joint for the reference model: gains from the scenario, all else from the paper."""
    c: Mapping[str, Any] = system.component("lift.controller").parameters
    o: Mapping[str, Any] = system.component("lift.observer").parameters
    beta, zeta, delta, sigma = (
        (c[f"{name}[1]"], c[f"{name}[2]"], c[f"{name}[3]"], c[f"{name}[4]"])
        for name in ("beta", "zeta", "delta", "sigma")
    )
    nominal = paper.Actuator().known  # the controller knows neither of the plant's changes but C_eq
    controller = paper.Controller(
        replace(nominal, C_eq=PLANT.C_eq),
        beta,
        zeta,
        delta,
        sigma,
        x_2d_in_a_1=False,
        feed_acceleration=True,
        a_max=c["limit.a_max"],
        i_max=190.0 / (1.5 * 8 * 0.15),  # tau_max of Table IV
        u_max=PLANT.u_max,
        theta_max=1e6,
        freeze=True,
        compensate=bool(c["compensate"]),
        v_max=c["limit.v_max"] if c["limit_speed"] else math.inf,
        weaken=bool(c["weaken_field"]),
        u_reserve=c["limit.u_reserve"],
        i_reserve=c["limit.i_reserve"],
        omega_u=c["omega_u"],
    )
    observer = paper.Observer(
        alpha=(o["alpha_1"], o["alpha_2"]),
        Q=(o["Q_11"], o["Q_12"], o["Q_22"]),
        H_0=o["H_0"],
        m_0=M_0,
        m_decay=o["m_decay"],
        ell=o["ell"],
        knows_command=o["use_model"],
        A_2=float(nominal.A[1]),
        friction=nominal.B_eq / nominal.A_eq,
        measures_current=o["use_measured_current"],
        omega_d=o["omega_d"],
        omega_r=o["omega_r"],
        ahead=o["ahead"],
    )
    return paper.Joint(PLANT, observer, controller, MOTION, SURROUNDINGS)


def whole(times: np.ndarray, gains: str = "robust") -> paper.Vector:
    """The joint as one equation: a row of `JOINT_STATES` for each of the times in s."""
    equation = joint(lift(gains))
    start = [START.get(name, 0.0) for name in paper.JOINT_STATES]
    return paper.solve(lambda t, s: paper.joint_rates(equation, t, s), start, times, rtol=1e-11, atol=1e-16)
