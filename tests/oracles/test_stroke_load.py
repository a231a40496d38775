"""A load along the stroke against the closed form of a lever, and against a machine of one actuator."""

import math
from pathlib import Path

import fmpy
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from emla_cosim.fmu.models import fmu_path
from emla_cosim.study.machines.schema import load_machine
from emla_fmu import EmlaAxis
from emla_fmu.stroke_load import POINTS, SMOOTH
from fmublock import Instance
from machine_fmu.model import MachineModel

FREE = {"motor.B_m": 0.0, "gearbox.eta_GB": 1.0, "motor.Phi_PM": 1e-9}
"""No friction, losses or currents: the screw moves by forces alone."""
M = (2.0 * math.pi / (0.02 / 7.0)) ** 2 * 0.016 + 156.5
"""Mass of the default plant as the load feels it, in kg."""
A, B, LENGTH, WEIGHT, ARM = 1.2, 0.4, 0.9, 25e3, 2.0
"""A boom on a pin: distances in m from the pin to both ends of the actuator, length of the retracted
actuator, weight in N and its distance in m from the pin. The side A is horizontal."""


def lever(x: np.ndarray) -> np.ndarray:
    """The force in N on the actuator, from the angle by the law of cosines and the virtual work."""
    length = LENGTH + x
    angle = np.arccos((A**2 + B**2 - length**2) / (2.0 * A * B))
    per_travel = length / (A * B * np.sin(angle))  # d angle / d length
    return WEIGHT * ARM * np.cos(angle - math.pi / 2.0) * per_travel


def table(position: np.ndarray, force: np.ndarray) -> dict[str, float]:
    values: dict[str, float] = {"load.table.interpolation": SMOOTH}
    for name, numbers in (("position", position), ("force", force)):
        values |= {f"load.table.{name}[{i}]": float(x) for i, x in enumerate(numbers, 1)}
    return values


def test_lever_acts_at_each_instant_of_a_long_step(fmu_folder: Path) -> None:
    """The screw falls by 6 cm in four communication steps, as in the closed form."""
    position = np.linspace(0.0, 0.5, POINTS)
    rows = fmpy.simulate_fmu(
        str(fmu_path("EmlaAxis", "native", fmu_folder)),
        stop_time=0.4,
        step_size=0.1,
        output_interval=0.1,
        start_values={**FREE, **table(position, lever(position)), "start.x_L": 0.3},
        output=["x_L", "v_L", "load.force"],
        fmi_type="CoSimulation",
    )
    fall = solve_ivp(
        lambda _, s: [s[1], -lever(s[0]) / M], (0.0, 0.4), [0.3, 0.0], rtol=1e-11, t_eval=rows["time"]
    )
    assert rows["x_L"][0] - rows["x_L"][-1] > 0.02
    assert rows["x_L"] == pytest.approx(fall.y[0], abs=2e-6)
    assert rows["v_L"] == pytest.approx(fall.y[1], abs=2e-5)
    assert rows["load.force"] == pytest.approx(lever(rows["x_L"]), rel=1e-3)


def test_forces_match_a_machine_with_one_actuator() -> None:
    """The lift table at rest, at strokes between the points of the table."""
    model = MachineModel(load_machine("lift_table"))

    def at_rest(stroke: np.ndarray) -> np.ndarray:
        still = np.zeros((len(stroke), 1))
        return model.forces(stroke[:, np.newaxis], still, still)[:, 0]

    position = np.linspace(model.q_LB[0], model.q_UB[0], POINTS)
    values, between = table(position, at_rest(position)), np.linspace(0.03, 0.22, 7)
    expected, actual = at_rest(between), []
    for x in between:
        axis = Instance(EmlaAxis())
        for name, value in {**values, "start.x_L": float(x)}.items():
            axis[name] = value
        axis.enter_initialization()
        axis.exit_initialization()
        actual.append(axis["load.force"])
    assert np.ptp(expected) > 2e3
    assert actual == pytest.approx(expected.tolist(), rel=1e-4)
