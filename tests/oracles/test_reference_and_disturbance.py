"""Motion profile and disturbances against closed forms."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.study.loading import load
from emla_cosim.study.systems import STUDY
from emla_fmu import Disturbance, Reference
from emla_fmu.disturbance import LEVELS
from emla_fmu.reference import MOVES, rest_to_rest
from tests.support.in_process import started


def outputs_at(times: np.ndarray, step: float, values: Mapping[str, Any]) -> Any:
    """Outputs of the disturbance at these times, multiples of the step; `values` are also of inputs."""
    instance, k = started(Disturbance, values), 0
    rows, names = [], ("F_L", "d_2", "d_3", "d_4")
    for time in times:
        while k < round(time / step):
            instance.do_step(k * step, step)
            k += 1
        rows.append([instance[name] for name in names])
    return SimpleNamespace(**dict(zip(names, np.array(rows).T, strict=True)))


def evaluate(time: float, **parameters: Any) -> dict[str, float]:
    """The reference at one time, straight from its equations."""
    parameters_ = Reference.layout().parameters
    defaults = {v.attribute: v.nested([s.start for s in v.scalars()]) for v in parameters_}
    return Reference().outputs(SimpleNamespace(**{**defaults, **parameters, "time": time}))


@given(
    time=st.floats(0.0, 20.0),
    moves=st.lists(
        st.tuples(st.floats(0.0, 1.0), st.floats(0.1, 5.0), st.floats(0.0, 2.0)), min_size=1, max_size=MOVES
    ),
)
def test_speed_and_acceleration_are_the_derivatives(
    time: float, moves: list[tuple[float, float, float]]
) -> None:
    """Against complex-step-free central differences of the position, away from corners of a_d."""
    x, start, duration, t = [0.2], [], [], 0.0
    for target, T, dwell in moves:
        x.append(target)
        start.append(t)
        duration.append(T)
        t += T + dwell
    x += [x[-1]] * (MOVES + 1 - len(x))
    start += [t] * (MOVES - len(start))
    duration += [1.0] * (MOVES - len(duration))
    profile = {"x": x, "start": start, "duration": duration}
    h = 1e-4
    corners = np.array([c for s, T in zip(start, duration, strict=True) for c in (s, s + T)])
    if np.abs(corners - time).min() < 2 * h:
        return
    before, middle, after = (evaluate(time + d, **profile) for d in (-h, 0.0, h))
    assert middle["v_d"] == pytest.approx((after["x_d"] - before["x_d"]) / (2 * h), abs=1e-3)
    assert middle["a_d"] == pytest.approx((after["v_d"] - before["v_d"]) / (2 * h), abs=1e-1)


def test_rest_to_rest_move_meets_its_ends_and_its_peak_speed() -> None:
    move = rest_to_rest(0.244, 0.270, 0.0607)
    T = move["duration"][0]
    assert pytest.approx(0.80, abs=0.005) == T
    assert evaluate(0.0, **move) == pytest.approx({"x_d": 0.244, "v_d": 0.0, "a_d": 0.0})
    assert evaluate(T, **move) == pytest.approx({"x_d": 0.270, "v_d": 0.0, "a_d": 0.0}, abs=1e-12)
    assert evaluate(T / 2, **move)["v_d"] == pytest.approx(0.0607)
    assert evaluate(99.0, **move)["x_d"] == pytest.approx(0.270)


@pytest.mark.parametrize("joint", STUDY)
def test_equations_98_and_99_as_printed(joint: str) -> None:
    """With the parameters of the scenario that has the paper's; tilt's d_2 has a random part from 0 to 2."""
    t, v_L = np.arange(0, 1.0, 0.05), 0.05
    parameters = load("published").system.component(f"{joint}.disturbance").parameters
    outputs = outputs_at(t, 0.01, {**parameters, "v_L": v_L})
    sines = {
        "lift": 0.8 * np.sin(8 * t) + 0.7 * np.sin(20 * t) + 1.2 * np.arctan(v_L) * np.exp(-3 * t),
        "tilt": 0.8 * np.sin(7 * t) + 0.95 * np.sin(18 * t),
        "telescope": 0.9 * np.sin(65 * t) - 0.3 * np.sin(50 * t + np.pi / 4),
    }[joint]
    random = outputs.d_2 - sines
    if joint == "tilt":
        assert 0.0 < random.min() < 0.4 and 1.6 < random.max() < 2.0
    else:
        assert random == pytest.approx(np.zeros_like(t), abs=1e-12)
    assert outputs.d_3 == pytest.approx(0.42 * np.cos(8 * t + np.pi / 3) + 0.032 * np.sin(5 * t), abs=1e-12)
    assert outputs.d_4 == pytest.approx(-0.15 * np.cos(12 * t + np.pi / 6), abs=1e-12)


def test_random_part_is_uniform_held_and_seeded() -> None:
    times = np.arange(0, 1.0, 1e-4)
    first = outputs_at(times, 1e-4, {"d_2.high": 2.0}).d_2
    assert 0.0 < first.min() < 0.01 and 1.99 < first.max() < 2.0
    assert first.mean() == pytest.approx(1.0, abs=4 * 2 / np.sqrt(12 * len(times)))
    assert len(np.unique(first)) == len(first)
    assert np.array_equal(first, outputs_at(times, 1e-4, {"d_2.high": 2.0}).d_2)
    with_another_seed = outputs_at(times, 1e-4, {"d_2.high": 2.0, "d_2.seed": 5}).d_2
    assert not np.isin(first, with_another_seed).any()


def test_random_values_hold_for_their_sample_time_whatever_the_step() -> None:
    """Four steps of 25 us per sample of 0.1 ms: the same sequence, each value four times."""
    coarse, fine = (outputs_at(np.arange(0, 0.01, h), h, {"d_2.high": 2.0}).d_2 for h in (1e-4, 2.5e-5))
    assert np.array_equal(fine, np.repeat(coarse, 4))


def test_before_zero_the_first_random_value_holds() -> None:
    """A run from t < 0 comes to the same values from t = 0 on."""

    def drawn(start: float, count: int) -> list[float]:
        instance = started(Disturbance, {"d_2.high": 2.0}, start)
        values = [instance["d_2"]]
        for k in range(count):
            instance.do_step(start + k * 1e-4, 1e-4)
            values.append(instance["d_2"])
        return values

    from_before_zero, from_zero = drawn(-0.01, 200), drawn(0.0, 100)
    assert from_before_zero[:100] == [from_zero[0]] * 100
    assert from_before_zero[100:] == from_zero
    assert len(set(from_zero)) == 101


def test_disturbance_as_force_does_not_act_as_acceleration() -> None:
    t = np.arange(0, 1.0, 0.05)
    values = {"d_2.amplitude": [0.8, 0.7], "d_2.omega": [8.0, 20.0], "load.level": [1e3] * LEVELS}
    force, acceleration = (outputs_at(t, 0.01, {**values, "d_2.is_force": x}) for x in (True, False))
    assert (force.d_2 == 0.0).all() and (acceleration.F_L == 1e3).all()
    assert force.F_L == pytest.approx(1e3 - acceleration.d_2)
