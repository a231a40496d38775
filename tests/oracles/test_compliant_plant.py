"""The plant with a second mass against closed forms, and against SciPy with events at the contacts."""

import math
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fmpy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from emla_cosim.fmu.models import fmu_path
from emla_fmu import EmlaCompliantPlant, EmlaPlant, transmission
from tests.support.in_process import started
from tests.support.reference_drive import Transmission

H = 1e-4
MODEL = "EmlaCompliantPlant"
FREE = {"motor.B_m": 0.0, "gearbox.eta_GB": 1.0, "motor.Phi_PM": 1e-9}
"""No friction, losses or currents: the first mass moves by forces alone."""
M_1 = (2.0 * math.pi / (0.02 / 7.0)) ** 2 * 0.016 + 156.5
"""Mass of the default plant as the load feels it, in kg: J_m behind gear and screw, and M_BS."""


def simulate(
    folder: Path, seconds: float, names: Sequence[str], values: dict[str, Any], model: str = MODEL
) -> list[np.ndarray]:
    """Values at the start and after each step of the native FMU."""
    rows = fmpy.simulate_fmu(
        str(fmu_path(model, "native", folder)),
        stop_time=seconds,
        step_size=H,
        output_interval=H,
        start_values=values,
        output=names,
        fmi_type="CoSimulation",
    )
    assert len(rows) == round(seconds / H) + 1
    return [np.array(rows[name]) for name in names]


# ---- spring and damper --------------------------------------------------------------------------


@pytest.mark.parametrize(("m", "k", "zeta"), [(43.46e3, 1e8, 0.0), (530.0, 6e7, 0.02), (5e3, 3e7, 0.3)])
def test_masses_swing_as_two_masses_on_a_spring(m: float, k: float, zeta: float, fmu_folder: Path) -> None:
    """The deflection of two free masses is that of one reduced mass; their centre of mass rests."""
    reduced = M_1 * m / (M_1 + m)
    values = {
        **FREE,
        "load.m": m,
        "transmission.stiffness": k,
        "transmission.damping": 2.0 * zeta * math.sqrt(k * reduced),
        "start.deflection": 1e-3,
    }
    names = ("transmission.deflection", "x_L", "load.x")
    deflection, x_L, x_load = simulate(fmu_folder, 0.5, names, values)
    t = H * np.arange(len(deflection))
    decay = zeta * math.sqrt(k / reduced)
    omega = math.sqrt(k / reduced) * math.sqrt(1.0 - zeta * zeta)
    expected = 1e-3 * np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))
    assert deflection == pytest.approx(expected, abs=2e-9)
    centre = M_1 * x_L + m * x_load
    assert centre == pytest.approx(np.full_like(t, centre[0]), rel=1e-12)


@pytest.mark.parametrize("backlash", [0.0, 5e-5])
def test_load_at_rest_hangs_on_the_spring(backlash: float, fmu_folder: Path) -> None:
    """57 kN on 100 N/um: 570 um, and half the play; a screw that is held, and much damping."""
    values = {
        "motor.J_m": 1e6,
        "F_L": 57e3,
        "load.m": 1e3,
        "transmission.stiffness": 1e8,
        "transmission.damping": 3e5,
        "transmission.backlash": backlash,
    }
    names = ("transmission.deflection", "x_L", "load.x", "transmission.force", "load.v")
    deflection, x_L, x_load, force, v = (x[-1] for x in simulate(fmu_folder, 0.3, names, values))
    assert deflection == pytest.approx(570e-6 + 0.5 * backlash, rel=1e-5)
    assert x_load == pytest.approx(x_L - deflection, abs=1e-15)
    assert force == pytest.approx(57e3, rel=1e-5)
    assert abs(v) < 1e-6


def test_stiff_transmission_is_a_rigid_plant_with_both_masses(fmu_folder: Path) -> None:
    names = ("x_L", "v_L", "i_q")
    values = {"u_q": 20.0, "u_d": -3.0, "F_L": 4e3, "gearbox.eta_GB": 1.0}
    rigid = simulate(fmu_folder, 0.05, names, {**values, "screw.M_BS": 156.5 + 2e4}, "EmlaPlant")
    stiff = {
        "load.m": 2e4,
        "transmission.stiffness": 1e13,
        "transmission.damping": 1e8,
        "start.deflection": 4e3 / 1e13,
        "solver.internal_step": 2e-6,
    }
    for name, ours, reference in zip(
        names, simulate(fmu_folder, 0.05, names, values | stiff), rigid, strict=True
    ):
        # The spring's own swing, begun by the jump of the acceleration, decays with 3000 1/s. What is left
        # falls with 1 / k: 1.8e-5 of the range here, 1.8e-4 for 1e12 N/m.
        assert ours[50:] == pytest.approx(reference[50:], rel=0.0, abs=2.2e-5 * float(np.ptp(reference))), (
            name
        )


# ---- backlash -----------------------------------------------------------------------------------


def bounced(values: Transmission, start: tuple[float, float], t: np.ndarray) -> np.ndarray:
    """Deflection of two free masses, solved from contact to contact; the play is where no force acts."""
    reduced = M_1 * values.m / (M_1 + values.m)
    half = 0.5 * values.b

    def rates(_: float, s: np.ndarray) -> list[float]:
        return [s[1], -values.force(float(s[0]), float(s[1])) / reduced]

    edges = [lambda _, s, e=edge: s[0] - e for edge in (-2.0 * half, -half, half, 2.0 * half)]
    for edge in edges:
        edge.terminal = True  # type: ignore[attr-defined]
    deflections, s, now = np.full_like(t, np.nan), np.array(start), 0.0
    while now < t[-1]:
        solution = solve_ivp(rates, (now, t[-1]), s, "DOP853", events=edges, dense_output=True, rtol=1e-12,
                             atol=1e-16)  # fmt: skip
        inside = (t >= now) & (t <= solution.t[-1])
        deflections[inside] = solution.sol(t[inside])[0]
        now, s = solution.t[-1], solution.y[:, -1]
        if solution.status == 1:  # begin beyond the edge
            s = s + 1e-12 * s[1] * np.array([1.0, 0.0])
            now += 1e-12
    return deflections


@pytest.mark.parametrize("c", [0.0, 4e4])
def test_backlash_against_scipy_with_events(c: float, fmu_folder: Path) -> None:
    """The load flies through the play and hits both ends several times."""
    values = Transmission(m=5e3, k=1e8, c=c, b=2e-4)
    start_values = {
        **FREE,
        "load.m": values.m,
        "load.v": -0.0503,
        "transmission.stiffness": values.k,
        "transmission.damping": values.c,
        "transmission.backlash": values.b,
        "solver.internal_step": 1e-6,
    }
    (deflection,) = simulate(fmu_folder, 0.2, ["transmission.deflection"], start_values)
    expected = bounced(values, (0.0, 0.0503), H * np.arange(len(deflection)))
    assert np.sum(np.diff(np.sign(expected)) != 0) >= 6
    assert np.abs(expected).max() > values.b
    assert deflection == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


@given(st.floats(-1e-3, 1e-3), st.floats(-0.5, 0.5), st.floats(0.0, 1e-3) | st.just(0.0), st.floats(0.0, 1e6))
def test_force_is_the_reference_and_contacts_never_pull(
    deflection: float, speed: float, backlash: float, c: float
) -> None:
    v = SimpleNamespace(deflection=deflection, v_L=speed, v_load=0.0, stiffness=1e8, damping=c)
    v.backlash = backlash
    force = transmission.force(v)
    assert force == pytest.approx(
        Transmission(1.0, 1e8, c, backlash).force(deflection, speed), rel=1e-9, abs=1e-6
    )
    if backlash > 0.0:
        assert force * deflection >= 0.0
        assert abs(deflection) > 0.5 * backlash or force == 0.0


# ---- the sensor ---------------------------------------------------------------------------------


def test_encoder_is_at_the_motor_or_at_the_load() -> None:
    errors = {"sensor.eccentricity": 1e-3, "screw.lead_error": 1e-4, "screw.wobble": 1e-5}
    deflected = {"start.deflection": 3e-4, **errors}
    at_motor, at_load = (
        started(EmlaCompliantPlant, deflected | {"sensor.at_load": there}) for there in (False, True)
    )
    rigid = started(EmlaPlant, errors)
    assert at_motor["x_measured"] == rigid["x_measured"] != 0.24
    assert at_load["x_measured"] == at_load["load.x"] == 0.24 - 3e-4
    rounded = started(
        EmlaCompliantPlant, {"start.deflection": 3e-4, "sensor.at_load": True, "sensor.resolution": 1e-3}
    )
    assert rounded["x_measured"] == pytest.approx(0.240, abs=1e-15)
