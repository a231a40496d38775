"""Actuators and load of the machine, coupled or merged, in motion that shows errors of steps."""

import numpy as np

from emla_cosim.base.arrays import Vector
from emla_cosim.run.result import Result
from emla_cosim.run.simulation import Simulation
from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.roles import find_variable
from tests.support.hdrm_runs import JOINTS

SAMPLE = 1e-4
"""Time in s after which controllers, observers and disturbances act, whatever the communication step."""

STOP = 0.02

_DISTURBING = ("amplitude[1]", "amplitude[2]", "arctan", "high", "low")


def column(result: Result, role: str) -> Vector:
    """The signal of a role, a column for each joint."""
    names = [find_variable(joint, role, result.names, result.roles) for joint in JOINTS]
    return np.column_stack([np.asarray(result[str(name)]) for name in names])


def positions(
    simulation: Simulation, parts: int, extrapolation: str, quiet: bool, stop_time: float = STOP
) -> Vector:
    """Positions of the joints at 10 kHz, stepped in so many parts of a sample; `quiet` is without d_2."""
    sampled = {f"{j}.{role}": parts for j in JOINTS for role in ("disturbance", "observer", "controller")}
    result = simulation.run(
        set=_start(f"{JOINTS[0]}.motor.tau_m" in simulation.names, quiet),
        step_size=SAMPLE / parts,
        output_interval=SAMPLE,
        stop_time=stop_time,
        step_multiples=sampled,
        extrapolation=extrapolation,
        coupling_tolerance=1e-11,
    )
    return column(result, "x_L")


def _start(merged: bool, quiet: bool) -> dict[str, float]:
    """Start values without offset and without rounding of the sensor."""
    values = dict[str, float]()
    for i, joint in enumerate(JOINTS, 1):
        q = load_joint(joint).reference.q_S
        values[f"machine.plant.start.x_L[{i}]" if merged else f"{joint}.plant.start.x_L"] = q
        values[f"{joint}.observer.start.x_hat"] = q
        values[f"{joint}.{'motor' if merged else 'plant'}.sensor.resolution"] = 0.0
        if quiet:
            values |= {f"{joint}.disturbance.d_2.{term}": 0.0 for term in _DISTURBING}
    return values
