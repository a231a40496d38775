"""The controllers that RSBA is compared with: their loops beside an independent one, and their limits."""

import math
from dataclasses import asdict, replace
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.study.controllers import CONTROLLERS
from emla_cosim.study.joint import start_values
from emla_fmu import EmlaPlant
from fmublock import Block
from rsba_fmu import AnatcController, CacController, FocController, RsbaController, drive_laws, foc_gains
from tests.support import reference_controllers as independent
from tests.support import reference_model as paper
from tests.support.continuous import Continuous
from tests.support.in_process import started
from tests.support.joint_data import COMPENSATED, EMLAS, LIFT, gains_of, observers
from tests.support.tiers import mostly_slow

COMPARED = (FocController, CacController, AnatcController)

# ---- the loop ---------------------------------------------------------------------------------------

MOVE = paper.Motion((0.242, 0.262), (0.0,), (0.6,))
LOAD, UNTIL = 20e3, 0.04

FOC: dict[str, Any] = {"k_p": 150.0, "k_v": 300.0, "w_c": 1500.0, "w_i": 150.0, "omega_d": 300.0}
CAC: dict[str, Any] = {
    "k": (150.0, 500.0, 3.0, 1.0, 3.0),
    "varpi": (0.05, 0.2, 0.5, 0.0, 0.5),
    "m": (6e4, 1e5, 1e5),
    "omega_n": (1500.0, 3000.0),
}
ANATC: dict[str, Any] = {
    "k_1": 150.0,
    "k_2": 4.0,
    "lambda_1": 500.0,
    "lambda_2": 20.0,
    "g": 5.0,
    "w_c": 1500.0,
}
LOOPS = {
    FocController: (FOC, independent.Foc(**FOC), 3),
    CacController: (CAC, independent.Cac(**CAC), 11),
    AnatcController: (ANATC, independent.Anatc(**ANATC), 6),
}


RESERVES = {"u_reserve": 0.2, "i_reserve": 0.1}


@pytest.mark.parametrize("block", mostly_slow(COMPARED, [FocController, AnatcController]))
def test_the_loop_is_that_of_an_independent_implementation(block: type[Block]) -> None:
    """Plant and controller with true states, from 2 mm beside the reference, through the current's limit."""
    gains, reference, count = LOOPS[block]
    gains, reference = {**gains, **RESERVES}, replace(reference, limits=independent.Limits(**RESERVES))
    times = np.linspace(0.0, UNTIL, 21)
    ours = _ours(block, gains, times)
    theirs = _theirs(reference, count, times)
    moved = np.ptp(theirs, axis=0)
    assert np.all(np.abs(ours - theirs) <= 5e-6 * moved + 1e-10)
    assert moved[0] > 1e-3
    assert np.max(theirs[:, 2]) > 0.9 * (1.0 - RESERVES["i_reserve"]) * 105.0


def _ours(block: type[Block], gains: dict[str, Any], times: np.ndarray) -> np.ndarray:
    plant, controller = Continuous(EmlaPlant, {"x_L_start": 0.24, "v_L": 0.0}), Continuous(block, gains)

    def rates(t: float, s: Any) -> Any:
        wires: dict[str, float] = dict(zip(("x_d", "v_d", "a_d"), paper.reference(MOVE, t), strict=True))
        wires |= dict(zip(("x_hat", "v_hat", "i_q", "i_d"), map(float, s[:4]), strict=True))
        u = controller.outputs(t, s[4:], wires)
        plant.outputs(t, [*s[:4], 0.0], {"u_q": u["u_q"], "u_d": u["u_d"], "F_L": LOAD})
        return np.concatenate([plant.rates()[:4], controller.rates()])  # no winding grows warm

    start = [0.24, 0.0, 0.0, 0.0, *controller.start()]
    return paper.solve(rates, start, times, rtol=1e-9, atol=1e-11)


def _theirs(reference: Any, count: int, times: np.ndarray) -> np.ndarray:
    actuator = paper.Actuator()

    def rates(t: float, s: Any) -> Any:
        x_L, v_L, i_q, i_d = map(float, s[:4])
        at = independent.Given((x_L, v_L, i_q, i_d), paper.reference(MOVE, t))
        rate, shown = reference.evaluate(t, s[4:], at)
        u = paper.PlantInputs(u_q=shown["u_q"], u_d=shown["u_d"], F_L=LOAD)
        return np.concatenate([paper.plant_rates(actuator, s[:4], u), rate])

    return paper.solve(rates, [0.24, *[0.0] * (3 + count)], times, rtol=1e-9, atol=1e-11)


# ---- limits -----------------------------------------------------------------------------------------

anything = st.floats(-1e6, 1e6)
signals = st.fixed_dictionaries(
    dict.fromkeys(("x_hat", "v_hat", "d_hat", "i_q", "i_d", "x_d", "v_d", "a_d"), anything)
    | {"u_available": st.just(0.0) | st.floats(1e-6, 1e6)}
)
names = st.sampled_from(["foc", "cac", "anatc"])


@given(names, st.integers(0, 1), st.sampled_from(sorted(EMLAS)), st.lists(signals, min_size=1, max_size=4))
def test_current_and_voltage_stay_within_their_limits(
    name: str, gain_set: int, joint: str, inputs: list[dict[str, float]]
) -> None:
    """And everything stays finite, as long as the inputs are."""
    chosen, emla = CONTROLLERS[name], EMLAS[joint]
    assert isinstance(chosen.model, type)
    gains = gains_of(name, list(chosen.gains)[gain_set])[joint]
    instance = started(chosen.model, start_values(chosen.model, emla, gains))
    reference = instance.layout.reference
    for k, given_now in enumerate(inputs):
        for variable, value in given_now.items():
            instance.set([reference(variable)], [value])
        instance.do_step(k * 1e-4, 1e-4)
        found = {n: instance.get([reference(n)])[0] for n in ("u_q", "u_d", "i_q_ref")}
        assert all(map(math.isfinite, found.values()))
        assert math.hypot(found["u_q"], found["u_d"]) <= min(emla.u_max, given_now["u_available"])
        assert abs(found["i_q_ref"]) <= emla.i_max


def at(block: type[Block], **inputs: float) -> tuple[dict[str, float], Continuous]:
    """Outputs of a controller of the lift in one instant, with a bandwidth of the currents of 2000 rad/s.

    The CAC-type controller's command filter stands at 104 A.
    """
    of_cac = {"k": (200.0, 200.0, 4.8, 1.0, 4.8), "i_c": 104.0}
    fast = of_cac if block is CacController else {"w_c": 2000.0}
    controller = Continuous(block, LIFT, fast)
    return controller.outputs(0.0, controller.start(), inputs), controller


@pytest.mark.parametrize("block", COMPARED)
def test_decoupling_survives_saturation(block: type[Block]) -> None:
    """u_d stays what keeps i_d at rest, although the voltage that is asked for in q is far too long."""
    found, _ = at(block, v_hat=0.04, i_q=30.0, x_d=0.5)
    omega_e = LIFT.N_p * LIFT.alpha_RL * 0.04
    assert found["u_d"] == pytest.approx(-omega_e * 30.0 * LIFT.L_q, rel=1e-12)
    assert found["u_q"] == pytest.approx(math.sqrt(LIFT.u_max**2 - found["u_d"] ** 2), rel=1e-12)
    assert found["saturated"] == 1.0


@pytest.mark.parametrize("block", COMPARED)
def test_a_sagging_supply_leaves_back_emf_its_voltage(block: type[Block]) -> None:
    """With all of it in d, nothing would hold i_q against the back-EMF of a braking motor."""
    found, _ = at(block, v_hat=0.08, i_q=-100.0, u_available=300.0, weaken_field=0.0)
    emf = LIFT.N_p * LIFT.alpha_RL * 0.08 * LIFT.Phi_PM
    assert found["u_d"] == pytest.approx(math.sqrt(300.0**2 - emf**2), rel=1e-12)
    assert found["u_q"] == pytest.approx(emf, rel=1e-12)


def test_the_field_is_weakened_until_the_voltage_holds_what_is_asked_for() -> None:
    """At 0.09 m/s; without the switch i_d stays 0, and less of i_q can be had."""
    v = Continuous(FocController, LIFT).v
    v.v_hat, omega_e = 0.09, LIFT.N_p * LIFT.alpha_RL * 0.09
    u = drive_laws.steady_voltage(v)
    i_q = 0.99 * drive_laws.current_limit(v, u)
    i_d = drive_laws.weakening_current(v, i_q, u)
    flux = math.hypot(LIFT.Phi_PM + LIFT.L_d * i_d, LIFT.L_q * i_q)
    assert omega_e * flux == pytest.approx(0.95 * LIFT.u_max)
    assert -LIFT.Phi_PM / LIFT.L_d <= i_d < 0.0
    v.weaken_field = 0.0
    less = drive_laws.current_limit(v, u)
    assert 0.0 < less < i_q
    assert drive_laws.weakening_current(v, less, u) == pytest.approx(0.0, abs=1e-9)
    assert omega_e * math.hypot(LIFT.Phi_PM, LIFT.L_q * less) == pytest.approx(0.95 * LIFT.u_max)


@given(
    st.fixed_dictionaries(
        {
            "x_hat": st.floats(0.2, 0.3),
            "v_hat": st.floats(-0.05, 0.05),
            "x_d": st.floats(0.2, 0.3),
            "v_d": st.floats(-0.05, 0.05),
            "a_d": st.floats(-0.5, 0.5),
            "d_hat": st.floats(-1.0, 1.0),
            "i_q": st.floats(-50.0, 50.0),
            "i_d": st.floats(-50.0, 50.0),
        }
    )
)
def test_without_adaptation_rsba_asks_for_the_current_of_the_cascade(inputs: dict[str, float]) -> None:
    """But for P_1 / A_2 of (39), a part in k_p k_v: the recommended gains are those of a P-P cascade."""
    of_rsba = replace(COMPENSATED["lift"], weaken_field=False)
    assert of_rsba.zeta == (0.0,) * 4 and observers("compensated")["lift"].H_0 == 0.0
    k_p, k_v = 0.5 * of_rsba.beta[0], 0.5 * of_rsba.beta[1]
    far = {"i_max": 1e6, "u_max": 1e9, "u_available": 1e9}  # limits that nothing reaches
    of_foc = {"k_p": k_p, "k_v": k_v, "a_max": of_rsba.a_max, "weaken_field": False}
    rsba = Continuous(RsbaController, LIFT, {**asdict(of_rsba), **far})
    foc = Continuous(FocController, LIFT, {**of_foc, **far})
    i_rsba, i_foc = (one.outputs(0.0, one.start(), inputs)["i_q_ref"] for one in (rsba, foc))
    A_2 = 1.5 * LIFT.N_p * LIFT.Phi_PM / rsba.v.A_eq
    assert i_foc - i_rsba == pytest.approx((inputs["x_hat"] - inputs["x_d"]) / A_2, abs=1e-9)


@pytest.mark.parametrize("block", COMPARED)
def test_known_disturbance_is_taken_up_by_the_current(block: type[Block]) -> None:
    k_t = 1.5 * LIFT.N_p * LIFT.Phi_PM / LIFT.A_eq
    inputs = {"x_hat": 0.25, "x_d": 0.25, "d_hat": -0.5}
    if block is CacController:  # what its command filter will answer
        _, controller = at(block, **inputs)
        wanted = controller.block.derivatives(controller.v)["i_c_rate"] / 10000.0**2 + 104.0
    else:
        wanted = at(block, **inputs)[0]["i_q_ref"]
    assert wanted == pytest.approx(0.5 / k_t, rel=5e-3)  # ANATC's smooth limit takes a little


def test_rule_gives_every_loop_half_of_what_its_delays_allow() -> None:
    rule = foc_gains.rule(1e-4, 4000.0, a_max=1.0)
    assert rule.w_c == pytest.approx(1.0 / (2.0 * 1.5e-4))
    assert rule.k_v + rule.omega_d == pytest.approx(1.0 / (2.0 * (1.0 / rule.w_c + 2.0 / 4000.0)))
    # s^2 + k_v s + k_p k_v: damped by 1 / sqrt(2)
    assert rule.k_v / (2.0 * math.sqrt(rule.k_p * rule.k_v)) == pytest.approx(math.sqrt(0.5))


@pytest.mark.parametrize(("v_d", "u_available"), [(0.0, 1e4), (0.0, 200.0), (-0.1, 200.0)])
def test_the_approach_is_no_faster_than_motor_and_supply(v_d: float, u_available: float) -> None:
    """Up to the base speed all of the motor's torque can be had; the reference itself may be faster."""
    found, _ = at(FocController, x_d=0.5, v_d=v_d, u_available=u_available)
    assert found["v_ref"] > 0.0
    omega_e = LIFT.N_p * LIFT.alpha_RL * found["v_ref"]
    held = omega_e * math.hypot(LIFT.Phi_PM, LIFT.L_q * LIFT.i_max)
    if v_d == 0.0:
        assert held == pytest.approx(min(LIFT.u_max, u_available), rel=1e-9)
    else:
        assert found["v_ref"] == pytest.approx(1.02 * abs(v_d))
    assert found["v_ref"] < LIFT.v_max
