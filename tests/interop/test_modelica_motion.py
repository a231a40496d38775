"""The Modelica package against the native FMUs: the same motion.

rumoca simulates the package with a solver of its own, at tight tolerance. The FMUs are stepped by
FMPy with inputs that move within the step, or by our master.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emla_cosim.fmu.models import fmu_path
from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.algorithms.registry import GaussSeidel, Strong
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.study.loading import load
from emla_cosim.system.model import System
from fmublock.variables import DiscreteState, Output, State
from machine_fmu.spline import Spline, trajectory_parameters
from tests.support import smooth_lift
from tests.support.modelica_package import SCALARS, Array, compiled, driven, joint_source, name_in
from tests.support.modelica_package import simulated as simulated_by_rumoca
from tests.support.sessions import Session
from tests.support.simulated import simulated

FUNCTIONS = {"sin": np.sin, "cos": np.cos, "exp": np.exp}

pytestmark = pytest.mark.slow

CURRENT_DRAWS = ("random", "noise_q", "noise_d")


@dataclass(frozen=True)
class Motion:
    """A block with start values, and inputs as expressions of `time` that Modelica and Python read alike.

    `count` steps are done, and the values after every `steps_per_row`-th compared. `rests` is what does not
    move. `tolerance` is a largest difference per largest value.
    """

    model: str
    values: Mapping[str, Any] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)
    step: float = 1e-5
    count: int = 4000
    steps_per_row: int = 100
    rests: frozenset[str] = frozenset()
    tolerance: float = 1e-7

    @property
    def times(self) -> Array:
        return np.arange(0, self.count + 1, self.steps_per_row) * self.step

    def names(self) -> list[str]:
        """Everything that moves and that both have, by FMI name. An ideal sensor draws no noise there."""
        moving = (State, DiscreteState, Output)
        names = [s.name for s in SCALARS[self.model].values() if isinstance(s.variable, moving)]
        ideal = "sensor.sigma" not in self.values
        drawn = ("sensor.random", "sensor.noise", *(f"sensor.current.{n}" for n in CURRENT_DRAWS))
        unknown = set(drawn) if ideal else set()
        return [n for n in names if name_in(self.model, n) is not None and n not in unknown]

    def in_modelica(self) -> dict[str, Array]:
        source = f"model Driven\n{driven(self.model, self.values, self.inputs)}\nend Driven;"
        signals = simulated_by_rumoca(compiled(source, "Driven"), self.times)
        return {name: signals[f"c.{name_in(self.model, name)}"] for name in self.names()}

    def in_fmu(self, session: Session) -> dict[str, Array]:
        slave = session.instance(self.model, running=False)
        session.set(slave, **self.values)
        inputs, half = list(self.inputs), 0.5 * np.arange(2 * self.count + 1) * self.step
        u = np.array([_evaluated(self.inputs[name], half) for name in inputs])
        references = session.references(inputs)
        if inputs:
            slave.setReal(references, u[:, 0])
        slave.exitInitializationMode()
        rows = [session.get(slave, *self.names())]
        for k in range(self.count):
            if inputs:  # which move along a parabola
                begin, middle, end = u[:, 2 * k], u[:, 2 * k + 1], u[:, 2 * k + 2]
                slope = (4.0 * middle - 3.0 * begin - end) / self.step
                curvature = 4.0 * (begin - 2.0 * middle + end) / self.step**2
                slave.setReal(references, begin)
                orders = [1] * len(inputs) + [2] * len(inputs)
                slave.setRealInputDerivatives(references * 2, orders, [*slope, *curvature])
            slave.doStep(k * self.step, self.step)
            if (k + 1) % self.steps_per_row == 0:
                rows.append(session.get(slave, *self.names()))
        return dict(zip(self.names(), np.array(rows).T, strict=True))


def _evaluated(expression: str, times: Array) -> Array:
    return eval(expression, {**FUNCTIONS, "time": times}) + np.zeros_like(times)


def differences(signals: Mapping[str, Array], expected: Mapping[str, Array]) -> dict[str, float]:
    """Largest difference of every signal per its largest value."""
    assert list(signals) == list(expected)
    largest = {name: np.abs(values).max() or 1.0 for name, values in expected.items()}
    return {name: float(np.abs(signals[name] - expected[name]).max() / largest[name]) for name in signals}


def elements(name: str, *values: float) -> dict[str, float]:
    return {f"{name}[{i}]": value for i, value in enumerate(values, 1)}


# ---- single blocks ------------------------------------------------------------------------------

PLANT_INPUTS = {
    "u_q": "30.0 * sin(40.0 * time) + 20.0",
    "u_d": "25.0 * cos(25.0 * time)",
    "i_q_ref": "20.0 * sin(30.0 * time)",
    "F_L": "4000.0 * cos(10.0 * time)",
    "d_2": "0.8 * sin(8.0 * time) + 0.7 * sin(20.0 * time)",
    "d_3": "0.42 * cos(8.0 * time)",
    "d_4": "-0.15 * cos(12.0 * time)",
    "supply.sag": "0.1 * sin(9.0 * time) * sin(9.0 * time)",
}
PLANT = {  # a number wherever the default makes a term vanish
    "motor.L_d": 2.0e-3,
    "motor.R_s": 0.2,
    "motor.N_p": 7,
    "coupling.J_c": 1e-3,
    "gearbox.J_GB": 5e-4,
    "gearbox.eta_GB": 0.8,
    "screw.B_BS": 50.0,
    "screw.C_eq": 2.0,
    "inverter.u_max": 45.0,  # sometimes less than the demanded voltage
    "uncertainty.F_2": 0.01,
    "uncertainty.F_3": 0.02,
    "uncertainty.F_4": 0.03,
    "start.x_L": 0.3,
    "v_L": 0.01,
    "i_q": 5.0,
    "i_d": 2.0,
}
DRIVE = {  # what a drive has beside the paper's plant, smooth enough for the tolerance
    "inverter.dead_time": 2e-6,
    "inverter.f_PWM": 1e4,
    "inverter.i_0": 5.0,
    "friction.F_C": 300.0,
    "friction.F_S": 450.0,
    "friction.v_S": 0.03,
    "friction.v_0": 0.01,
    "gearbox.directional": True,
    "gearbox.eta_back": 0.7,
    "stop.stiffness": 4e8,
    "stop.damping": 3.0,
    "screw.q_LB": 0.2995,
    "screw.q_UB": 0.3005,
    "motor.i_N": 10.0,
    "motor.permitted_rise": 80.0,
    "motor.tau_th": 0.5,
}
WINDING = frozenset({"motor.load", "motor.temperature_rise"})
"""What rests while no rated current is given."""
MOTOR = {name: x for name, x in {**PLANT, **DRIVE}.items() if name in SCALARS["EmlaMotor"] and name != "v_L"}
MOTOR_INPUTS = {
    **{name: law for name, law in PLANT_INPUTS.items() if name in SCALARS["EmlaMotor"]},
    "x_L": "0.3 + 1e-3 * sin(30.0 * time)",
    "v_L": "0.03 * cos(30.0 * time)",
}
OBSERVER_INPUTS = {
    "y": "0.245 + 0.004 * sin(6.0 * time) - 0.002 * cos(15.0 * time)",
    "i_q_ref": "4.0 * cos(7.0 * time)",
    "i_q": "3.0 * cos(9.0 * time)",
}
W = 400.0
OBSERVER = {  # the repaired gains with slower poles, so that the innovation is above rounding
    "alpha_1": 2.0 * W,
    "alpha_2": W * W,
    "Q_11": 1.0,
    "Q_12": 0.1,
    "Q_22": 1.2,
    "H_0": 1.0,
    "m_0": 16.0 / W**2,
    "m_decay": 0.5,
    "ell": 2.0,
    "use_model": True,
    "model.A_eq": 30.0,
    "start.x_hat": 0.243,
}
MOTION = {
    "x_d": "0.246 - 0.006 * cos(12.0 * time)",
    "v_d": "0.072 * sin(12.0 * time)",
    "a_d": "0.864 * cos(12.0 * time)",
}
REPAIRED_INPUTS = {
    **MOTION,
    "x_hat": f"{MOTION['x_d']} + 4e-4 * cos(60.0 * time)",
    "v_hat": f"{MOTION['v_d']} - 0.02 * sin(60.0 * time)",
    "i_q": "30.0 * cos(23.0 * time)",
    "i_d": "20.0 * sin(11.0 * time)",
}
REPAIRED = {
    **elements("beta", 800.0, 2000.0, 5000.0, 5000.0),
    **elements("zeta", 0.4, 0.3, 0.2, 0.1),
    **elements("delta", 1.0, 1.1, 1.2, 1.3),
    **elements("sigma", 1.0, 2.0, 3.0, 4.0),
    **elements("theta", 0.0, 1.0, 2.0, 3.0),
    "x_2d_in_a_1": False,
    "feed_acceleration": True,
    "limit_acceleration": True,
    "limit_current": True,
    "limit_voltage": True,
    "model.L_d": 2.0e-3,
    "model.C_eq": 2.0,
    "limit.a_max": 1.0,
    "limit.i_max": 300.0,
    "limit.u_max": 1000.0,
}
COMPENSATED = {
    "compensate": True,
    "limit_speed": True,
    "weaken_field": True,
    "measure_supply": True,
    "omega_u": 200.0,
    "limit.v_max": 0.08,
    "limit.u_reserve": 0.2,
    "limit.i_reserve": 0.1,
    "limit.u_max": 300.0,
}
COMPENSATED_INPUTS = {"d_hat": "0.5 * sin(20.0 * time)", "u_available": "280.0 + 50.0 * sin(35.0 * time)"}
REFERENCE = {
    **elements("waypoint", 0.05, 0.13, 0.21, 0.30, 0.23, 0.17, 0.11, 0.08, 0.05),
    **elements("move.start", 0.03, 0.15, 0.26, 0.39, 0.50, 0.605, 0.71, 0.80),
    **elements("move.duration", 0.12, 0.10, 0.11, 0.09, 0.095, 0.105, 0.08, 0.06),
    "period": 0.91,
}
DISTURBANCE = {
    **elements("load.level", 7e3, 20e3, 40e3, 60e3, 70e3, -5e3),
    **elements("load.start", 0.0, 0.1, 0.25, 0.4, 0.6, 0.7),
    "load.ramp": 0.05,
    "load.ripple": 5e3,
    **elements("d_2.amplitude", 0.8, 0.7),
    **elements("d_2.omega", 8.0, 20.0),
    **elements("d_2.phase", 0.1, 0.8),
    "d_2.arctan": 1.2,
    "d_2.decay": 3.0,
    "d_2.low": -0.5,
    "d_2.high": 2.0,
    "d_2.sample_time": 2e-3,
    "d_2.seed": 7,
    **elements("d_3.amplitude", 0.42, 0.032),
    **elements("d_3.omega", 8.0, 5.0),
    **elements("d_3.phase", 1.0, -1.5),
    "d_4.amplitude": -0.15,
    "d_4.omega": 12.0,
    "d_4.phase": 0.5,
    "supply.depth": 0.2,
    "supply.start": 0.3005,
    "supply.duration": 0.1,
}
SPEED = {"v_L": "0.06 * sin(2.0 * time)"}
MACHINE = {  # a number wherever the default makes two things the same
    "lift.a": 1.2,
    "lift.b": 0.45,
    "lift.L_0": 0.9,
    "lift.delta": -1.1,
    "lift.epsilon": -0.2,
    "tilt.a": 1.3,
    "tilt.epsilon": -0.3,
    "tube.share": 0.4,
    **elements("housing.c", 0.3, 0.35, 0.45),
    **elements("tube.c", 0.25, 0.45, 0.6),
    "payload.J": 0.1,
    "gravity": 9.9,
}
STROKES = {
    "x_L[1]": "0.25 + 0.2 * sin(3.0 * time)",
    "x_L[2]": "0.35 - 0.2 * cos(4.0 * time)",
    "x_L[3]": "0.5 + 0.4 * sin(5.0 * time)",
    "v_L[1]": "0.6 * cos(3.0 * time)",
    "v_L[2]": "0.8 * sin(4.0 * time)",
    "v_L[3]": "2.0 * cos(5.0 * time)",
    "a_L[1]": "-1.8 * sin(3.0 * time)",
    "a_L[2]": "3.2 * cos(4.0 * time)",
    "a_L[3]": "-10.0 * sin(5.0 * time)",
    "payload.m": "400.0 + 100.0 * cos(6.0 * time)",
}
MERGED = {
    **MACHINE,
    **elements("coupling.J_c", 1e-3, 2e-3, 1e-4),
    **elements("gearbox.J_GB", 2e-3, 1e-3, 2e-4),
    **elements("gearbox.eta_GB", 0.8, 0.85, 0.95),
    **elements("screw.B_BS", 50.0, 40.0, 30.0),
    **elements("screw.C_eq", 2.0, 1.0, 0.5),
    **elements("uncertainty.F_2", 0.1, 0.2, 0.3),
    **elements("start.x_L", 0.25, 0.35, 0.5),
    **elements("start.v_L", 0.01, -0.02, 0.03),
}
TORQUES = {
    "tau_m[1]": "30.0 + 40.0 * cos(9.0 * time)",
    "tau_m[2]": "7.0 + 30.0 * cos(12.0 * time)",
    "tau_m[3]": "-5.0 + 2.0 * cos(7.0 * time)",
    "d_2[1]": "0.8 * sin(8.0 * time)",
    "d_2[2]": "0.5 * sin(20.0 * time)",
    "d_2[3]": "0.6 * cos(15.0 * time)",
    "payload.m": "400.0 + 100.0 * cos(6.0 * time)",
}
CURVE = trajectory_parameters(
    Spline(
        3,
        [0.105] * 4 + [0.2, 0.35, 0.5, 0.75] + [0.905] * 4,  # no jump where it is compared
        {
            "lift": [0.2, 0.3, 0.1, 0.25, 0.22, 0.4, 0.31, 0.28],
            "tilt": [0.4, 0.38, 0.45, 0.5, 0.42, 0.41, 0.35, 0.33],
            "telescope": [0.5, 0.6, 0.2, 0.3, 0.7, 0.8, 0.1, 0.4],
        },
    )
)

MOTIONS = {
    "manipulator": Motion("HdrmManipulator", MACHINE, STROKES, step=1e-3, count=1000, steps_per_row=10),
    "merged plant": Motion("HdrmPlant", MERGED, TORQUES, step=1e-3, count=500, steps_per_row=10),
    "trajectory": Motion("Trajectory", CURVE, step=1e-3, count=1000, steps_per_row=10),
    "plant": Motion("EmlaPlant", PLANT, PLANT_INPUTS, rests=WINDING),
    "plant of a drive": Motion("EmlaPlant", {**PLANT, **DRIVE}, PLANT_INPUTS, tolerance=1e-6),
    "plant with sensors": Motion(
        "EmlaPlant",
        {
            "sensor.sigma": 5e-6,
            "sensor.resolution": 1e-6,
            "sensor.seed": 12345,
            "sensor.current.sigma": 0.02,
            "sensor.current.resolution": 0.01,
            "sensor.current.seed": 54321,
        },
        {"u_q": "5.0 * sin(40.0 * time)"},
        step=1e-4,  # sensor.period
        count=500,
        steps_per_row=1,
        rests=WINDING | {"inverter.u_d", "inverter.u_available", "inverter.saturated", "P_L"},
    ),
    "motor of a drive": Motion("EmlaMotor", MOTOR, MOTOR_INPUTS),
    "damped observer": Motion(
        "EmlaObserver",
        {**OBSERVER, "use_measured_current": True, "omega_d": W / 3.0, "omega_r": W / 8.0, "ahead": 4e-4},
        OBSERVER_INPUTS,
    ),
    "repaired controller": Motion(
        "RsbaController",
        REPAIRED,
        REPAIRED_INPUTS,
        step=5e-6,
        count=8000,
        steps_per_row=80,
        rests=frozenset({"z_q", "z_d"}),
    ),
    "compensated controller": Motion(
        "RsbaController",
        {**REPAIRED, **COMPENSATED},
        {**REPAIRED_INPUTS, **COMPENSATED_INPUTS},
        step=5e-6,
        count=8000,
        steps_per_row=80,
        tolerance=1.5e-3,  # the FMU knows the voltage of the step before, 5 us late
    ),
    "controller that stops adapting": Motion(
        "RsbaController",
        {**REPAIRED, "freeze_adaptation": True, "limit.i_max": 450.0, "limit.u_max": 2000.0},
        REPAIRED_INPUTS,
        rests=frozenset({"z_q", "z_d"}),
        tolerance=2e-3,  # limit.band is 1e-3
    ),
    "reference": Motion("Reference", REFERENCE, step=1e-3, count=1200, steps_per_row=7),
    "disturbance": Motion("Disturbance", DISTURBANCE, SPEED, step=1e-3, count=1000, steps_per_row=1),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_a_block_moves_as_its_fmu(name: str, sessions: dict[str, Session]) -> None:
    motion = MOTIONS[name]
    expected = motion.in_fmu(sessions[motion.model])
    assert {n for n, values in expected.items() if np.ptp(values) == 0.0} == motion.rests
    deviations = differences(motion.in_modelica(), expected)
    assert {n: d for n, d in deviations.items() if d > motion.tolerance} == {}


# ---- the joint and the study in closed loop -----------------------------------------------------


def native_run(
    system: System, folder: Path, algorithm: Algorithm, step: float, times: Array
) -> dict[str, Array]:
    """All outputs of our FMUs at these times, by the names that they have in Modelica."""
    with Assembly(
        system, {c.name: fmu_path(c.model, "native", folder) for c in system.components}
    ) as assembly:
        rows = simulated(
            assembly.network, algorithm, make_communication_points(times[-1], step), round(times[1] / step)
        )
        names = assembly.network.names
    return {_renamed(system, name): rows[:, 1 + i] for i, name in enumerate(names)}


def _renamed(system: System, signal: str) -> str:
    component, name = system.split(signal)
    return f"{component.name}.{name_in(component.model, name)}"


def test_the_joint_moves_as_its_fmus(fmu_folder: Path) -> None:
    """In smooth motion within the limits. Its FMUs come there with the square of their step."""
    times, step, system = np.arange(51) * 1e-3, 1e-5, smooth_lift.lift()
    source = f"model Closed\n{joint_source('lift', system)}\nend Closed;"
    signals = simulated_by_rumoca(compiled(source, "Closed"), times)
    coarse, fine = (native_run(system, fmu_folder, Strong("fmu"), h, times) for h in (2.0 * step, step))
    limit = {name: (4.0 * fine[name] - coarse[name]) / 3.0 for name in fine}
    compared = {name: signals[name] for name in limit}
    assert max(differences(compared, fine).values()) > 1e-5
    assert {n: d for n, d in differences(compared, limit).items() if d > 1e-6} == {}


STUDY_TOLERANCES = {
    "plant.x_L": 1e-6,
    "plant.v_L": 1e-3,
    "plant.tau_m": 5e-3,
    "observer.x_hat": 1e-6,
    "observer.v_hat": 1e-3,
    "controller.P[1]": 1e-4,
    "controller.i_q_ref": 5e-3,
    "controller.theta[1]": 1e-2,
    "disturbance.d_2": 1e-5,
    "reference.x_d": 1e-12,
}
"""Largest difference per largest value: here motors saturate, encoders round and random values jump."""


def test_the_study_moves_as_its_fmus(fmu_folder: Path) -> None:
    """From its start millimetres away from the reference, with all limits and disturbances."""
    times, system = np.arange(101) * 1e-3, load("study").system
    source = "model Three\n  EMLA.Study study;\nend Three;"
    results = simulated_by_rumoca(compiled(source, "Three"), times, 1e-6)
    expected = native_run(system, fmu_folder, GaussSeidel("fmu"), 1e-5, times)
    for name, tolerance in STUDY_TOLERANCES.items():
        signals = {s: expected[s] for s in (f"{joint}.{name}" for joint in system.branches)}
        different = differences({s: results[f"study.{s}"] for s in signals}, signals)
        assert {s: d for s, d in different.items() if d > tolerance} == {}
