"""The RSBA laws against the printed equations, and each repair's switch."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import hypothesis.strategies as st
import pytest
from hypothesis import given

from emla_cosim.study.joint import start_values
from fmublock.instance import Instance
from rsba_fmu import RsbaController, gains
from tests.support.in_process import started
from tests.support.joint_data import LIFT, PUBLISHED, ROBUST

REFERENCE = RsbaController.layout().reference


def controller(g: gains.RsbaGains, **values: float) -> Instance:
    """A controller of the lift past initialization."""
    return started(RsbaController, {**start_values(RsbaController, LIFT, g), **values})


def outputs(g: gains.RsbaGains, **values: float) -> Any:
    """Outputs of such a controller by name."""
    instance = controller(g, **values)
    names = ("u_q", "u_d", "i_q_ref", "saturated", "P[1]", "P[2]", "P[3]", "P[4]")
    found = dict(zip(names, instance.get([REFERENCE(n) for n in names]), strict=True))
    return SimpleNamespace(**{n.replace("[", "_").rstrip("]"): v for n, v in found.items()})


signals = st.fixed_dictionaries(
    {
        "x_hat": st.floats(0.2, 0.3),
        "v_hat": st.floats(-0.1, 0.1),
        "i_q": st.floats(-50, 50),
        "i_d": st.floats(-5, 5),
        "x_d": st.floats(0.2, 0.3),
        "v_d": st.floats(-0.1, 0.1),
        "a_d": st.floats(-1, 1),
        "theta[1]": st.floats(0, 10),
        "theta[2]": st.floats(0, 10),
        "theta[3]": st.floats(0, 10),
        "theta[4]": st.floats(0, 10),
    }
)


def test_without_x_2d_the_speed_error_counts_the_reference_speed() -> None:
    at_rest_on_target = {"x_hat": 0.25, "x_d": 0.25, "v_hat": 0.05, "v_d": 0.05}
    printed, repaired = PUBLISHED["lift"], ROBUST["lift"]
    assert outputs(printed, **at_rest_on_target).P_2 == pytest.approx(0.05)  # wants to slow down
    assert outputs(repaired, **at_rest_on_target).P_2 == 0.0


def test_fed_acceleration_is_the_torque_that_the_inertia_needs() -> None:
    still = outputs(ROBUST["lift"], a_d=0.0).i_q_ref
    moving = outputs(ROBUST["lift"], a_d=0.5).i_q_ref
    torque = 1.5 * LIFT.N_p * LIFT.Phi_PM * (moving - still)
    assert torque == pytest.approx(LIFT.A_eq * 0.5)


@given(st.floats(-0.05, 0.05))
def test_the_approach_speed_can_be_braked(error: float) -> None:
    """Within k e, monotone, and v^2 / 2 never more than a_max over the distance left."""
    g = ROBUST["lift"]
    # on the reference's speed, -a_1 is what P_2 shows beyond the speed error
    speed = outputs(g, x_hat=error).P_2
    k, a = g.beta[0] / 2, g.a_max
    assert abs(speed) <= k * abs(error) * (1 + 1e-12)
    assert speed * error >= 0
    assert 0.5 * speed * speed <= a * abs(error) * (1 + 1e-9)
    if abs(error) > a / (k * k):
        assert abs(speed) == pytest.approx(math.sqrt(2 * a * (abs(error) - a / (2 * k * k))))
    else:
        assert abs(speed) == pytest.approx(k * abs(error))


@given(signals)
def test_limits_hold_and_are_reported(s: dict[str, float]) -> None:
    g = ROBUST["lift"]
    found = outputs(g, **s)
    assert abs(found.i_q_ref) <= LIFT.i_max
    assert math.hypot(found.u_q, found.u_d) <= LIFT.u_max * (1 + 1e-12)
    at_limit = abs(found.i_q_ref) == LIFT.i_max or math.hypot(found.u_q, found.u_d) > LIFT.u_max * (1 - 1e-12)
    assert found.saturated == float(at_limit)


def test_adaptation_stops_while_saturated_and_at_its_largest_value() -> None:
    saturated = controller(ROBUST["lift"], x_hat=0.1)
    assert saturated.get([REFERENCE("saturated")]) == [1.0]
    assert saturated.block.derivatives(saturated._v)["theta"][:2] == [0.0, 0.0]
    at_top = {f"theta[{i}]": 1e6 for i in range(1, 5)}
    free = controller(ROBUST["lift"], v_hat=1e-9, i_d=0.1, **at_top)
    rates = free.block.derivatives(free._v)["theta"]
    assert all(rate <= 0.0 for rate in rates)


@given(theta_max=st.floats(1.0, 1e8), step=st.floats(1e-6, 1e-2), error=st.floats(-0.1, 0.1))
def test_no_step_jumps_over_the_largest_adaptation(theta_max: float, step: float, error: float) -> None:
    """With nothing but the freeze switched on, adaptation wants 1e9 within a tenth of a millisecond."""
    only_frozen = replace(PUBLISHED["lift"], freeze_adaptation=True)
    instance = controller(only_frozen, **{"limit.theta_max": theta_max}, x_hat=error)
    for k in range(5):
        instance.do_step(k * step, step)
        theta = instance.get([REFERENCE(f"theta[{i}]") for i in range(1, 5)])
        assert max(theta) <= theta_max * (1 + 1e-12)
        assert min(theta) >= 0.0


def test_published_adaptation_knows_no_limit() -> None:
    """At the published start the tilt joint's theta_2 grows by thousands within 0.1 ms."""
    instance = controller(PUBLISHED["tilt"], x_hat=0.358, x_d=0.389)
    instance.do_step(0.0, 1e-4)
    assert instance.get([REFERENCE("theta[2]")])[0] > 400
    assert abs(instance.get([REFERENCE("i_q_ref")])[0]) > 1e5
