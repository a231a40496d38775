"""Properties of the RSBA laws; the laws themselves are compared in oracles/test_controller_equations.py."""

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
    values_by_name = dict(zip(names, instance.get([REFERENCE(n) for n in names]), strict=True))
    return SimpleNamespace(**{n.replace("[", "_").rstrip("]"): v for n, v in values_by_name.items()})


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


@given(st.floats(-0.05, 0.05))
def test_approach_speed_can_be_braked(error: float) -> None:
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
    actual = outputs(g, **s)
    assert abs(actual.i_q_ref) <= LIFT.i_max
    assert math.hypot(actual.u_q, actual.u_d) <= LIFT.u_max * (1 + 1e-12)
    at_limit = abs(actual.i_q_ref) == LIFT.i_max or math.hypot(actual.u_q, actual.u_d) > LIFT.u_max * (
        1 - 1e-12
    )
    assert actual.saturated == float(at_limit)


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
