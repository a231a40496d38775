"""Limits of the controllers that RSBA is compared with, their gains by rule, and RSBA as a cascade."""

import math
from dataclasses import asdict, replace

import hypothesis.strategies as st
import pytest
from hypothesis import given

from emla_cosim.study.controllers import CONTROLLERS
from emla_cosim.study.joint import start_values
from rsba_fmu import FocController, RsbaController, foc_gains
from tests.support.in_process import started
from tests.support.joint_data import COMPENSATED, EMLAS, LIFT, gains_of, observers

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
    controller, emla = CONTROLLERS[name], EMLAS[joint]
    assert isinstance(controller.model, type)
    gains = gains_of(name, list(controller.gains)[gain_set])[joint]
    instance = started(controller.model, start_values(controller.model, emla, gains))
    reference = instance.layout.reference
    for k, given_now in enumerate(inputs):
        for variable, value in given_now.items():
            instance.set([reference(variable)], [value])
        instance.do_step(k * 1e-4, 1e-4)
        outputs = {n: instance.get([reference(n)])[0] for n in ("u_q", "u_d", "i_q_ref")}
        assert all(map(math.isfinite, outputs.values()))
        assert math.hypot(outputs["u_q"], outputs["u_d"]) <= min(emla.u_max, given_now["u_available"])
        assert abs(outputs["i_q_ref"]) <= emla.i_max


near = {name: st.floats(0.2, 0.3) for name in ("x_hat", "x_d")}
slow = {name: st.floats(-0.05, 0.05) for name in ("v_hat", "v_d")}
currents = {name: st.floats(-50.0, 50.0) for name in ("i_q", "i_d")}
accelerations = {"a_d": st.floats(-0.5, 0.5), "d_hat": st.floats(-1.0, 1.0)}


@given(st.fixed_dictionaries(near | slow | currents | accelerations))
def test_without_adaptation_rsba_asks_for_the_current_of_the_cascade(inputs: dict[str, float]) -> None:
    """But for P_1 / A_2 of (39), a part in k_p k_v: the recommended gains are those of a P-P cascade."""
    of_rsba = replace(COMPENSATED["lift"], weaken_field=False)
    assert of_rsba.zeta == (0.0,) * 4 and observers("compensated")["lift"].H_0 == 0.0
    k_p, k_v = 0.5 * of_rsba.beta[0], 0.5 * of_rsba.beta[1]
    far = {"i_max": 1e6, "u_max": 1e9, "u_available": 1e9}  # limits that nothing reaches
    of_foc = {"k_p": k_p, "k_v": k_v, "a_max": of_rsba.a_max, "weaken_field": False}
    rsba = started(RsbaController, start_values(RsbaController, LIFT, asdict(of_rsba), far) | inputs)
    foc = started(FocController, start_values(FocController, LIFT, of_foc, far) | inputs)
    A_2 = 1.5 * LIFT.N_p * LIFT.Phi_PM / rsba["model.A_eq"]
    expected = (inputs["x_hat"] - inputs["x_d"]) / A_2
    assert foc["i_q_ref"] - rsba["i_q_ref"] == pytest.approx(expected, abs=1e-9)


def test_rule_gives_every_loop_half_of_what_its_delays_allow() -> None:
    rule = foc_gains.rule(1e-4, 4000.0, a_max=1.0)
    assert rule.w_c == pytest.approx(1.0 / (2.0 * 1.5e-4))
    assert rule.k_v + rule.omega_d == pytest.approx(1.0 / (2.0 * (1.0 / rule.w_c + 2.0 / 4000.0)))
    # s^2 + k_v s + k_p k_v: damped by 1 / sqrt(2)
    assert rule.k_v / (2.0 * math.sqrt(rule.k_p * rule.k_v)) == pytest.approx(math.sqrt(0.5))
