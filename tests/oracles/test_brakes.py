"""Holding brakes against closed forms: rest without creep, slip under a constant force, and release."""

import math
from pathlib import Path

import fmpy
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from emla_cosim.fmu.models import build, fmu_path

FREE = {"motor.B_m": 0.0, "gearbox.eta_GB": 1.0, "motor.Phi_PM": 1e-9}
"""No friction, losses or currents: the screw moves by forces alone."""
ALPHA = 2.0 * math.pi * 7.0 / 0.02
J = 0.016 + 156.5 / ALPHA**2
"""Inertia of the default plant at the motor, in kg m2."""
FORCE = 40e3
STATIC = FORCE / ALPHA
"""Load force in N, and its torque at the motor in N m."""
OMEGA, ZETA = 2.0 * math.pi * 100.0, 0.2


def run(model: str, flavour: str, folder: Path, torque: float, stop: float, **more: float) -> np.ndarray:
    values = {**FREE, "brake.torque": torque, "F_L": FORCE, "brake.engaged": 1.0, "inverter.disabled": 1.0}
    return fmpy.simulate_fmu(
        str(fmu_path(model, flavour, folder)),
        stop_time=stop,
        step_size=1e-3,
        output_interval=1e-3,
        start_values={**values, **more},
        output=["x_L", "v_L", "brake.tau", "brake.angle", "brake.slip", "P_el"],
        fmi_type="CoSimulation",
    )


def test_load_at_rest_does_not_creep(fmu_folder: Path) -> None:
    """For 30 s, at 1 % below the torque of the brake; the angle is that of a spring."""
    rows = run(
        "EmlaAxis", "native", fmu_folder, 1.01 * STATIC, 30.0, **{"brake.angle": -STATIC / (J * OMEGA**2)}
    )
    assert np.abs(rows["x_L"] - rows["x_L"][0]).max() < 1e-12
    assert rows["brake.slip"][-1] == 0.0
    assert rows["brake.tau"] == pytest.approx(-STATIC, rel=1e-9)
    assert not rows["P_el"].any()


@pytest.mark.parametrize("excess", [0.8, 1.5])
def test_sudden_load_swings_or_slips_as_solved_by_scipy(excess: float, fmu_folder: Path) -> None:
    """A sudden load reaches up to twice its torque: less brake slips first, then holds, or never holds."""
    limit = STATIC / excess if excess > 1.0 else 1.3 * STATIC
    spring, damper = J * OMEGA**2, 2.0 * ZETA * J * OMEGA

    def rates(_t: float, s: np.ndarray) -> list[float]:
        _, w, angle, _ = s
        slips = spring * abs(angle) >= limit and angle * w > 0.0
        tau = min(max(spring * angle + damper * w, -limit), limit)
        return [w / ALPHA, (-STATIC - tau) / J, 0.0 if slips else w, abs(w) / ALPHA if slips else 0.0]

    rows = run("EmlaAxis", "native", fmu_folder, limit, 0.1, **{"solver.internal_step": 5e-6})
    start = [0.24, 0.0, 0.0, 0.0]
    expected = solve_ivp(
        rates, (0.0, 0.1), start, rtol=1e-9, atol=1e-12, max_step=1e-5, t_eval=rows["time"]
    ).y
    scale = abs(expected[0] - 0.24).max()
    assert rows["x_L"] == pytest.approx(expected[0], abs=1e-3 * scale)
    assert rows["brake.slip"] == pytest.approx(expected[3], abs=1e-3 * scale)
    assert (rows["brake.slip"][-1] > 0.0) and (
        excess > 1.0 or rows["v_L"][-1] == pytest.approx(0.0, abs=1e-6)
    )


def test_slip_matches_a_constant_torque(fmu_folder: Path) -> None:
    """Once it slips, x'' = (F - tau alpha) / m."""
    rows = run("EmlaAxis", "native", fmu_folder, 0.6 * STATIC, 0.2)
    late = rows[rows["time"] >= 0.05]
    a = -0.4 * FORCE / (J * ALPHA**2)
    t = late["time"] - late["time"][0]
    fall = late["x_L"][0] + late["v_L"][0] * t + 0.5 * a * t**2
    assert late["x_L"] == pytest.approx(fall, abs=1e-9)
    assert late["brake.tau"] == pytest.approx(-0.6 * STATIC, rel=1e-12)


@pytest.mark.parametrize("model", ["EmlaAxis", "EmlaCompliantAxis"])
def test_both_flavours_have_the_same_bits(model: str, fmu_folder: Path) -> None:
    build(model, "python", [], fmu_folder)
    rows = [run(model, flavour, fmu_folder, 0.9 * STATIC, 0.05) for flavour in ("native", "python")]
    assert rows[0].tobytes() == rows[1].tobytes()
