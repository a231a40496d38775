"""What a drive has beside the paper's plant: delay, sensors, losses, heating, and the numbers for the study.

The equations themselves are compared in `test_monolithic`, point by point.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson

from emla_cosim.study.joint import start_values
from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.systems import STUDY, derive_current_seed
from emla_fmu import EmlaPlant, end_stops, friction, inverter
from fmublock.instance import Instance, StepDiscardedError
from tests.support import in_process
from tests.support.joint_data import DRIVES, EMLAS
from tests.support.tiers import mostly_slow

STATES = ("x_L", "v_L", "i_q", "i_d")
H = 1e-4


def started(values: Mapping[str, Any], time: float = 0.0) -> Instance:
    return in_process.started(EmlaPlant, values, time, "plant")


def run_steps(plant: Instance, demands: Iterable[tuple[float, float]], h: float = H) -> list[list[float]]:
    """States after each step with these voltages demanded."""
    rows = []
    for u_q, u_d in demands:
        plant["u_q"], plant["u_d"] = u_q, u_d
        plant.do_step(plant.time, h)
        rows.append([plant[name] for name in STATES])
    return rows


# ---- computing delay ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("delay", "steps"), [(1e-4, 1), (1.4e-4, 1), (1.6e-4, 2), (3e-4, 3), (3.2e-3, 32), (1e-5, 1)]
)
def test_voltage_is_delayed_by_whole_steps(delay: float, steps: int) -> None:
    """The same bits as without a delay, and 0 V before."""
    demands = [(float(a), float(b)) for a, b in np.random.default_rng(1).normal(scale=50.0, size=(40, 2))]
    states = run_steps(started({"inverter.delay": delay}), demands)
    late = [(0.0, 0.0)] * steps + demands[: len(demands) - steps]
    assert states == run_steps(started({}), late)
    assert started({}).get_state() != states  # that they moved at all
    assert states[-1] != run_steps(started({}), demands)[-1]


def test_outputs_show_the_delayed_voltage() -> None:
    plant = started({"inverter.delay": H})
    run_steps(plant, [(30.0, 4.0)])
    # the outputs belong to the voltage of the step that comes
    assert plant["inverter.u_q"] == 30.0
    plant["u_q"] = 50.0
    plant.do_step(plant.time, H)
    assert plant["inverter.u_q"] == 50.0


def test_limit_matches_the_supply_when_the_voltage_takes_effect() -> None:
    plant = started({"inverter.delay": H, "inverter.u_max": 100.0})
    run_steps(plant, [(100.0, 0.0)])
    plant["supply.sag"] = 0.3
    plant["u_q"] = 60.0
    plant.do_step(plant.time, H)
    assert plant["inverter.u_available"] == pytest.approx(70.0)
    assert (plant["inverter.u_q"], plant["inverter.saturated"]) == (60.0, 0.0)


def test_run_that_starts_before_zero_is_delayed_too() -> None:
    """The first step's length is not known then: the delay is right from the second step on."""
    demands = [(20.0, 0.0)] * 5
    states = run_steps(started({"inverter.delay": 2 * H}, time=-1.0), demands)
    assert states[0] == run_steps(started({}, time=-1.0), [(0.0, 0.0)])[0]
    assert states[2] != states[1]


def test_delay_of_more_than_32_steps_is_refused() -> None:
    plant = started({"inverter.delay": 3.3e-3})
    before = plant.get_state()
    with pytest.raises(StepDiscardedError, match=r"inverter\.delay_in_steps_of_at_most_32 became inf"):
        plant.do_step(0.0, H)
    assert plant.get_state() == before
    plant.do_step(0.0, 2 * H)  # 16.5 steps are not too many


# ---- current sensors ----------------------------------------------------------------------------


def test_noise_of_currents_has_its_size_and_does_not_affect_the_position() -> None:
    quiet = started({"sensor.sigma": 1e-6, "i_q": 5.0})
    noisy = started({"sensor.sigma": 1e-6, "i_q": 5.0, "sensor.current.sigma": 0.02})
    draws, positions = [], []
    for _ in range(1500):
        quiet.do_step(quiet.time, H)
        noisy.do_step(noisy.time, H)
        positions.append(noisy["x_measured"] - quiet["x_measured"])
        draws.append([noisy["i_q_measured"] - noisy["i_q"], noisy["i_d_measured"] - noisy["i_d"]])
    assert not any(positions)
    q, d = np.array(draws).T / 0.02
    # of 1500 draws from N(0, 1) these are 0.026, 0.018 and 0.026, each one standard deviation
    for values in (q, d):
        assert abs(values.mean()) < 0.1
        assert values.std() == pytest.approx(1.0, abs=0.07)
        assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 0.1
    assert abs(np.corrcoef(q, d)[0, 1]) < 0.1


# ---- what takes energy, and never gives it ------------------------------------------------------

signed = st.floats(-1.0, 1.0)


@st.composite
def lossy(draw: st.DrawFn) -> dict[str, float]:
    """Parameters with all losses of some size, by attribute."""
    F_C = draw(st.floats(0.0, 5e3))
    return {
        "eta_GB": draw(st.floats(0.3, 1.0)),
        "directional": 1.0,
        "eta_back": draw(st.sampled_from([0.0, 1.0]) | st.floats(-0.5, 1.0)),
        "F_C": F_C,
        "F_S": F_C * draw(st.floats(1.0, 3.0)),
        "v_S": draw(st.floats(1e-3, 2e-2)),
        "v_0": draw(st.floats(1e-4, 1e-2)),
        "dead_time": draw(st.floats(0.0, 5e-6)),
        "i_0": draw(st.floats(3.0, 9.0)),  # less makes the current stiff
        "stop_stiffness": draw(st.floats(1e7, 2e9)),
        "stop_damping": draw(st.floats(0.0, 20.0)),
    }


@settings(deadline=None, max_examples=100)
@given(lossy(), signed, signed, signed, signed, signed)
def test_losses_never_deliver_power(
    values: dict[str, float], x: float, v_L: float, i_q: float, i_d: float, F_L: float
) -> None:
    """At any point: friction, gears and dead time take power; a stop what its spring does not store."""
    fixed = {"N_p": 8, "rho": 1 / 7, "lead": 0.02, "u_max": 445.0, "sag": 0.0, "f_PWM": 1e4}
    acting = {"x_L": 0.3 * x, "v_L": 0.2 * v_L, "i_q": 99.0 * i_q, "i_d": 99.0 * i_d, "F_L": 6e4 * F_L}
    v = SimpleNamespace(**values, **fixed, **acting, q_LB=-0.1, q_UB=0.1)
    rounding = 1e-9
    assert friction.friction_force(v) * v.v_L >= 0.0
    assert (friction.directional_load(v, v.F_L) - v.F_L) * v.v_L >= -rounding
    e_q, e_d = inverter.dead_time_error(v)
    assert e_q * v.i_q + e_d * v.i_d <= rounding
    depth = max(v.q_LB - v.x_L, v.x_L - v.q_UB, 0.0)
    outside = math.copysign(1.0, v.x_L)
    force = end_stops.stop_force(v)
    assert force * outside <= 0.0  # never pulls
    stored = v.stop_stiffness * depth * depth * v.v_L * outside
    assert force * v.v_L + stored <= 1e-12 * abs(stored)


@settings(deadline=None, max_examples=6)
@given(lossy(), st.floats(-0.1, 0.1), st.floats(-300.0, 300.0), st.floats(-6e4, 6e4))
def test_plant_in_motion_creates_no_energy(
    values: dict[str, float], v_L: float, u_q: float, F_L: float
) -> None:
    """What is delivered and stored is at most what came in, into a stop and out of it again too."""
    names = EmlaPlant.layout()
    by_name = {p.name: values[p.attribute] for p in names.parameters if p.attribute in values}
    low, high = 0.239, 0.2405  # within reach
    lossless = {"screw.q_LB": low, "screw.q_UB": high, "motor.B_m": 0.0, "motor.R_s": 0.0, "v_L": v_L}
    plant = started({**by_name, **lossless, "u_q": u_q, "F_L": F_L})
    emla = EMLAS["lift"]
    M = emla.alpha_RL * (emla.J_m + emla.M_BS / emla.alpha_RL**2) * emla.alpha_RL

    def stored() -> float:
        depth = max(low - plant["x_L"], plant["x_L"] - high, 0.0)
        magnetic = 0.75 * 2.4e-3 * (plant["i_q"] ** 2 + plant["i_d"] ** 2)
        return 0.5 * M * plant["v_L"] ** 2 + magnetic + values["stop_stiffness"] * depth**3 / 3.0

    before, h = stored(), 2e-5
    powers, sizes = [plant["P_el"] - plant["P_L"]], []
    for _ in range(200):
        plant.do_step(plant.time, h)
        powers.append(plant["P_el"] - plant["P_L"])
        sizes.append(stored() + abs(plant["P_el"]) * 200 * h)
    came_in = float(simpson(powers, dx=h))
    assert stored() - before - came_in <= 1e-4 * max(sizes)


@pytest.mark.parametrize(("F_C", "F_S", "stribeck"), [(300.0, 0.0, -300.0), (0.0, 500.0, 500.0)])
def test_friction_acts_with_either_of_its_levels(F_C: float, F_S: float, stribeck: float) -> None:
    v = SimpleNamespace(v_L=0.02, F_C=F_C, F_S=F_S, v_S=5e-3, v_0=1e-3)
    expected = (F_C + stribeck / (1.0 + 4.0**2)) * 0.02 / math.hypot(0.02, 1e-3)
    assert friction.friction_force(v) == pytest.approx(expected, rel=1e-12)


def test_back_driving_efficiency_0_means_that_of_the_same_friction() -> None:
    v = SimpleNamespace(eta_GB=0.8, eta_back=0.0, v_0=1e-6, rho=1.0, lead=0.01)
    for v.v_L, F_L, factor in ((0.1, 1e4, 1.0 / 0.8), (-0.1, 1e4, 0.75), (0.1, -1e4, 0.75), (0.0, 1e4, 1.0)):
        assert friction.directional_load(v, F_L) == pytest.approx(F_L * factor)


# ---- heating ------------------------------------------------------------------------------------


def test_rated_current_ends_at_the_permitted_rise_and_more_of_it_is_reported() -> None:
    """Without voltage, resistance and motion the current stays."""
    still = {"motor.R_s": 0.0, "motor.Phi_PM": 1e-9, "v_L": 0.0, "solver.internal_step": 1e-3}
    winding = {"motor.i_N": 20.0, "motor.permitted_rise": 80.0, "motor.tau_th": 0.2}
    rated = started({**still, **winding, "i_q": 12.0, "i_d": -16.0})
    rated.do_step(0.0, 2.0)
    assert rated["motor.load"] == pytest.approx(1.0, rel=1e-4)
    assert rated["motor.temperature_rise"] == pytest.approx(80.0 * (1.0 - math.exp(-10.0)), rel=1e-4)
    assert rated.left_limits() == []
    hot = started({**still, **winding, "i_q": 24.0, "i_d": -32.0})
    # t = tau ln(nu / (nu - 1)) with nu = 4
    hot.do_step(0.0, 0.2 * math.log(4.0 / 3.0) * 1.01)
    assert [s for s in hot.left_limits() if "motor.temperature_rise" in s]


# ---- numbers ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", mostly_slow(["lift", "tilt", "telescope"], ["lift"]))
def test_stop_holds_a_drive_at_its_largest_speed(name: str) -> None:
    emla = EMLAS[name]
    values = start_values(EmlaPlant, emla, asdict(DRIVES[name]))
    plant = started({**values, "start.x_L": emla.q_UB - 1e-4, "v_L": emla.v_max})
    deepest = 0.0
    for _ in range(2500):
        plant.do_step(plant.time, H)
        deepest = max(deepest, plant["x_L"] - emla.q_UB)
    # 10 mm hold all inertia; damping, friction and back-EMF shorten the way
    assert 2e-3 < deepest < 10e-3
    assert plant["v_L"] < 0.0


def test_seeds_of_currents_are_seeds_and_differ() -> None:
    joint_seeds = [seed for joint in STUDY if (seed := load_joint(joint).seed) is not None]
    seeds = [derive_current_seed(seed) for seed in joint_seeds]
    assert len({*seeds, *joint_seeds}) == 6
    assert all(1 <= seed <= 2147483646 for seed in seeds)
