"""The winding temperature of a repeated cycle, against cycles that are integrated one after another."""

import json
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.study.metrics import JointMetrics
from tests.support.tiers import examples

SIGNALS = ("plant.x_L", "plant.v_L", "plant.tau_m", "plant.motor.temperature_rise")
NAMES = [f"j.{name}" for name in (*SIGNALS, "reference.x_d", "reference.v_d")]
PERMITTED, TAU = 80.0, 10.0
WINDING = {"motor.i_N": 10.0, "motor.permitted_rise": PERMITTED, "motor.tau_th": TAU}
STEP = 0.05


def warm(load: np.ndarray, start: float = 0.0, tau: float = TAU) -> np.ndarray:
    """The temperature rise under a copper load that is constant in each step, one value more than loads."""
    rises = [start]
    for value in load:
        target = PERMITTED * value
        rises.append(target + (rises[-1] - target) * math.exp(-STEP / tau))
    return np.array(rises)


def rows_of(rises: np.ndarray, error: float = 0.0) -> np.ndarray:
    """A joint that is held from the start on, unless it has an error, with this temperature rise."""
    rows = np.zeros((len(rises), 1 + len(NAMES)))
    rows[:, 0], rows[:, 1], rows[:, 4] = np.arange(len(rises)) * STEP, error, rises
    return rows


def watch(
    rows: np.ndarray,
    sizes: tuple[int, ...] = (10_000,),
    over: float = 1e9,
    more: Mapping[str, float] = MappingProxyType({}),
) -> JointMetrics:
    """The metrics of rows that come in blocks of these sizes, and pass through a checkpoint between them."""
    parameters = {f"j.plant.{name}": x for name, x in WINDING.items()} | dict(more)
    criteria = {"j.over_temperature": over}
    start = number = 0
    metrics = JointMetrics(NAMES, parameters, criteria=criteria)
    while start < len(rows):
        size = sizes[number % len(sizes)]
        metrics.write(rows[start : start + size])
        start, number = start + size, number + 1
        state = json.loads(json.dumps(metrics.state_dict()))
        metrics = JointMetrics(NAMES, parameters, criteria=criteria)
        metrics.load_state_dict(state)
    return metrics


def heat_of(metrics: JointMetrics) -> dict[str, Any]:
    return dict(metrics.figures()["j"]["heat"])


@given(
    seed=st.integers(0, 10_000),
    moves=st.integers(1, 8),
    steps=st.integers(5, 60),
    start=st.sampled_from([0.0, 20.0, 300.0]),
)
def test_repeated_cycle_agrees_with_many_cycles(seed: int, moves: int, steps: int, start: float) -> None:
    """A cycle of several moves with other loads; what comes before it does not count."""
    cycle = np.repeat(np.random.default_rng(seed).uniform(0.0, 3.0, moves), steps)
    cycle = np.tile(cycle, max(1, math.ceil(25 / len(cycle))))
    before = np.full(6, 50.0)  # a start with a large current, for the 0.3 s that do not count
    rises = warm(np.concatenate([before, cycle]), start)
    heat = heat_of(watch(rows_of(rises)))
    many = warm(np.tile(cycle, 1 + int(12.0 * TAU / (len(cycle) * STEP))), rises[6])
    last = many[-len(cycle) - 1 :]
    assert heat["from_s"] == pytest.approx(0.3) and heat["until_s"] == pytest.approx(STEP * (len(rises) - 1))
    assert heat["steady_rise_K"] == pytest.approx(last.max(), rel=1e-4)
    assert heat["copper_load"] == pytest.approx(cycle.mean(), rel=1e-3)
    assert heat["mean_rise_K"] == pytest.approx(PERMITTED * cycle.mean(), rel=1e-3)


@pytest.mark.parametrize("load", [1.0, 1.3, 1.79, 4.0])
@pytest.mark.parametrize("over", [0.05, 0.4])
def test_predicted_trip_agrees_with_repeated_cycles(load: float, over: float) -> None:
    """One cycle of a heavy and a light half predicts when the tenth or so trips."""
    cycle = np.repeat([1.5 * load, 0.5 * load], 40)
    rises = warm(np.concatenate([np.full(6, load), cycle]))
    many = warm(np.tile(cycle, 100), rises[-1])
    threshold = PERMITTED * (1.0 + over)
    metrics = watch(rows_of(rises), over=over)
    at, trip = heat_of(metrics)["trips_at_s"], metrics.figures()["j"]["trip"]
    if rises.max() > threshold:
        assert trip is not None
    elif many.max() < threshold:
        assert math.isnan(at)
    else:
        expected = STEP * (len(rises) - 1 + int(np.argmax(many > threshold)))
        assert at == pytest.approx(expected, abs=2.0 * STEP)
    remarks = [text for text in metrics.remarks() if "above ambient" in text]
    is_beyond = many[-len(cycle) :].max() > PERMITTED and trip is None
    assert len(remarks) == is_beyond
    if remarks and not math.isnan(at):
        assert f"and the drive trips at t = {at:.4g} s." in remarks[0]


def test_whole_periods_of_a_motion_count() -> None:
    cycle = np.repeat([2.0, 0.0], 60)  # 6 s
    rises = warm(np.tile(cycle, 3)[:300])
    heat = heat_of(watch(rows_of(rises), more={"j.reference.period": 6.0}))
    assert (heat["from_s"], heat["until_s"]) == pytest.approx((3.0, 15.0))
    assert heat["copper_load"] == pytest.approx(1.0, rel=1e-3)
    assert heat_of(watch(rows_of(rises)))["copper_load"] == pytest.approx(2.0 * 174 / 294, rel=1e-3)


@examples(5, 50, deadline=None)
@given(seed=st.integers(0, 10_000), sizes=st.lists(st.integers(150, 900), min_size=1, max_size=3))
def test_figures_do_not_depend_on_blocks_of_rows(seed: int, sizes: list[int]) -> None:
    rises = warm(np.random.default_rng(seed).uniform(0.0, 3.0, 1500))  # more rows than samples are kept
    metrics = watch(rows_of(rises), tuple(sizes))
    np.testing.assert_equal(heat_of(metrics), heat_of(watch(rows_of(rises))))


def test_long_runs_need_few_samples() -> None:
    cycle = np.repeat([3.0, 0.0], 40)
    metrics = watch(rows_of(warm(np.tile(cycle, 250))))
    assert len(metrics.state_dict()["heat"]["0"]["times"]) <= 1024
    assert heat_of(metrics)["copper_load"] == pytest.approx(1.5, rel=2e-3)


def test_excessive_heat_is_the_first_remark_and_no_verdict() -> None:
    rows = rows_of(warm(np.full(100, 1.79)))
    metrics = watch(rows, over=0.05)
    figures = metrics.figures()["j"]
    assert figures["held"] is True and figures["steady_rise_K"] == pytest.approx(1.79 * PERMITTED)
    trip = math.ceil(TAU * math.log(1.79 / (1.79 - 1.05)) / STEP) * STEP
    assert metrics.remarks() == [
        "j: repeated, the 4.7 s from t = 0.3 s on heat the winding to 143.2 K above ambient, with 1.79 times "
        f"its rated losses; 80 K are permitted, and the drive trips at t = {trip:.4g} s."
    ]
    assert [display.name for display in metrics.displays][:2] == ["held", "steady_rise_K"]
    rows[:, 2], limit = 3.0, {"j.plant.screw.v_max": 2.9}
    assert "winding" in watch(rows, more=limit).remarks()[0]
    assert "touched its speed limit" in watch(rows, more=limit).remarks()[1]


def test_rated_losses_are_permitted() -> None:
    assert not any("winding" in text for text in watch(rows_of(warm(np.full(100, 1.0)))).remarks())
    assert any("winding" in text for text in watch(rows_of(warm(np.full(100, 1.01)))).remarks())


def test_trip_ends_the_cycle() -> None:
    rises = warm(np.concatenate([np.full(100, 1.79), np.full(100, 500.0)]))
    metrics = watch(rows_of(rises), over=1.0)
    figures = metrics.figures()["j"]
    assert figures["held"] is False and figures["heat"]["until_s"] == figures["trip"]["time_s"]
    assert not any("repeated" in text for text in metrics.remarks())


@pytest.mark.parametrize(
    ("rows", "changes"),
    [
        (rows_of(warm(np.full(100, 2.0))), {"motor.i_N": 0.0}),
        (rows_of(warm(np.full(100, 2.0))), {"use_commanded_current": 1.0}),
        (rows_of(warm(np.full(20, 2.0))), {}),  # 0.7 s of it count
        (rows_of(warm(np.full(100, 2.0)), error=0.1), {}),
    ],
    ids=["no thermal data", "ideal torque", "short", "not settled"],
)
def test_no_temperature_without_a_cycle(rows: np.ndarray, changes: dict[str, float]) -> None:
    metrics = watch(rows, more={f"j.plant.{name}": x for name, x in changes.items()})
    figures = metrics.figures()["j"]
    assert figures["heat"] is None and math.isnan(figures["steady_rise_K"])
    assert not any("winding" in text for text in metrics.remarks())
    assert any(display.name == "steady_rise_K" for display in metrics.displays) == (not changes)


def test_not_finite_temperature_has_no_figure() -> None:
    rises = warm(np.full(100, 2.0))
    rises[50:] = np.nan
    assert watch(rows_of(rises)).figures()["j"]["heat"] is None
