"""Plant and FOC beside motulator's machine: a surface PMSM in stationary coordinates, an inertia."""

import math
from typing import Any

import numpy as np
import pytest
from motulator.common.utils import complex2abc
from motulator.drive import model
from motulator.drive.utils import SynchronousMachinePars

from emla_cosim.study.joint import start_values
from emla_fmu import EmlaPlant
from rsba_fmu import FocController
from tests.support import reference_model as paper
from tests.support.in_process import started
from tests.support.joint_data import LIFT

SAMPLE, SAMPLES = 1e-4, 1500
MOVE = paper.Motion((0.24, 0.2418), (0.0,), (0.12,))
"""Up to 0.028 m/s: 62 rad/s at the motor, 495 rad/s electrical."""
LOAD, LOAD_START = 20.0, 0.08
"""N m at the motor, and when they come in s."""
ROTARY = {"M_BS": 0.0, "eta_GB": 1.0}
"""The motor alone: no mass at the screw, no loss in the gearbox."""
J = LIFT.J_m
GAINS = {"k_p": 150.0, "k_v": 300.0, "w_c": 1500.0, "w_i": 150.0, "omega_d": 300.0, "A_eq": LIFT.alpha_RL * J}


class Drive:
    """Our controller, sampled: measurements in, voltages for the next sample out."""

    def __init__(self) -> None:
        self.controller, self.k = started(FocController, start_values(FocController, LIFT, GAINS)), 0

    def __call__(self, x: float, v: float, i_q: float, i_d: float) -> tuple[float, float]:
        c = self.controller
        x_d, v_d, a_d = paper.reference(MOVE, self.k * SAMPLE)
        measurements = {"x_hat": x, "v_hat": v, "i_q": i_q, "i_d": i_d, "x_d": x_d, "v_d": v_d, "a_d": a_d}
        for name, value in measurements.items():
            c[name] = value
        c.do_step(self.k * SAMPLE, SAMPLE)
        self.k += 1
        return c["u_q"], c["u_d"]


def ours() -> np.ndarray:
    """x, v, i_q, i_d at the samples, the voltage a sample late."""
    plant, drive = started(EmlaPlant, start_values(EmlaPlant, LIFT, ROTARY)), Drive()
    rows, late = [], (0.0, 0.0)
    for k in range(SAMPLES):
        rows.append([plant[n] for n in ("x_L", "v_L", "i_q", "i_d")])
        voltages = drive(*rows[-1])
        plant["u_q"], plant["u_d"] = late
        plant["F_L"] = LOAD * LIFT.alpha_RL if k * SAMPLE >= LOAD_START - 1e-9 else 0.0
        plant.do_step(k * SAMPLE, SAMPLE)
        late = voltages
    return np.array(rows)


class MotulatorControl:
    """The same controller as motulator's control system: phase currents in, duty ratios out."""

    def __init__(self) -> None:
        self.drive, self.rows = Drive(), []
        self.turned, self.last = 0.0, 0.0

    def __call__(self, mdl: Any) -> tuple[float, Any]:
        angle = mdl.mechanics.meas_position()
        self.turned += (angle - self.last + math.pi) % (2.0 * math.pi) - math.pi
        self.last = angle
        theta_e, w_M = LIFT.N_p * angle, mdl.mechanics.meas_speed()
        i_a, i_b, i_c = mdl.machine.meas_currents()
        i_s = (2.0 * i_a - i_b - i_c) / 3.0 + 1j * (i_b - i_c) / math.sqrt(3.0)
        i = i_s * np.exp(-1j * theta_e)
        self.rows.append([0.24 + self.turned / LIFT.alpha_RL, w_M / LIFT.alpha_RL, i.imag, i.real])
        u_q, u_d = self.drive(*self.rows[-1])
        # where the axes will be in the middle of the sample that the voltage is held for
        ahead = theta_e + 1.5 * SAMPLE * LIFT.N_p * w_M
        u_s = (u_d + 1j * u_q) * np.exp(1j * ahead)
        return SAMPLE, 0.5 + complex2abc(u_s / mdl.converter.u_dc)

    def post_process(self) -> None:
        """motulator asks for it."""


def motulators() -> np.ndarray:
    pars = SynchronousMachinePars(n_p=LIFT.N_p, R_s=LIFT.R_s, L_d=LIFT.L_d, L_q=LIFT.L_q, psi_f=LIFT.Phi_PM)
    mechanics = model.StiffMechanicalSystem(
        J=J, B_L=LIFT.B_m, tau_L=lambda t: LOAD * (t >= LOAD_START - 1e-9)
    )
    mdl = model.Drive(
        converter=model.VoltageSourceConverter(u_dc=1000.0),
        machine=model.SynchronousMachine(pars),
        mechanics=mechanics,
    )
    control = MotulatorControl()
    model.Simulation(mdl, control).simulate(t_stop=SAMPLES * SAMPLE, max_step=SAMPLE)
    return np.array(control.rows[:SAMPLES])


def test_plant_and_foc_move_as_with_motulators_machine() -> None:
    """A move, then a load in a step; in motulator the voltage does not turn with the axes."""
    expected, actual = motulators(), ours()
    largest = np.abs(expected).max(axis=0)
    difference = np.abs(actual - expected).max(axis=0)
    assert difference[0] < 1e-7
    assert difference[1] < 0.001 * largest[1]
    assert difference[2] < 0.01 * largest[2]
    assert difference[3] < 0.001 * largest[2]
    # it moved, and the load was taken up
    assert actual[-1, 0] == pytest.approx(0.2418, abs=2e-5)
    assert actual[-1, 2] == pytest.approx(LOAD / (1.5 * LIFT.N_p * LIFT.Phi_PM), rel=0.02)
