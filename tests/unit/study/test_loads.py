"""Metrics and verdict of loads that are not rigid, from rows with known metrics."""

import json
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.recorders.metrics import list_figures
from emla_cosim.study.loads import LoadMetrics, WatchedLoad

STEP = 1e-3
LOAD = WatchedLoad("j", [1, 2, 3, 4], correction=5, limit=1e-3)  # x_load, x_L, x_s, x_c


def evaluate(
    load: Any,
    screw: Any = 0.0,
    stop: float = 2.0,
    start: float = 0.0,
    pieces: int = 1,
    command: Any = 0.0,
    correction: Any = 0.0,
    **criteria: float,
) -> tuple[dict[str, Any], LoadMetrics]:
    """Return the figures of a load and a screw beside a reference at 0, in pieces that are handed on."""
    time = start + STEP * np.arange(round(stop / STEP) + 1)
    signals: tuple[Any, ...] = (load, screw, 0.0, command, correction)
    values: list[Any] = [f(time) if callable(f) else np.full(len(time), f) for f in signals]
    criteria_values = {f"j.{name}": value for name, value in criteria.items()}
    metrics = LoadMetrics([LOAD], criteria_values)
    for rows in np.array_split(np.column_stack([time, *values]), pieces):
        state = json.loads(json.dumps(metrics.state_dict()))
        metrics = LoadMetrics([LOAD], criteria_values)
        metrics.load_state_dict(state)
        metrics.write(rows)
    return dict(metrics.figures()["j"]), metrics


@pytest.mark.parametrize(("pieces", "start"), [(1, 0.0), (7, 5.0)])
def test_load_and_screw_are_judged_separately(start: float, pieces: int) -> None:
    """A load that sags by 0.87 mm is within a window of 1 mm, and outside of one of 0.5 mm."""
    actual, metrics = evaluate(-0.87e-3, start=start, pieces=pieces)
    assert actual["load_reason"] is None and metrics.reason("j") is None
    assert actual["load_within_window"] is True and actual["load_settling_time_s"] == 0.0
    assert actual["load_position_error_m"] == actual["load_deflection_m"] == pytest.approx(0.87e-3)
    assert actual["load_swing_m"] == 0.0
    actual, metrics = evaluate(-0.87e-3, start=start, pieces=pieces, position_window=0.5e-3)
    assert actual["load_within_window"] is False and metrics.reason("j") == actual["load_reason"]
    assert actual["load_reason"] == (
        "The load of j has not settled: its position error was 870 µm at the start and is 870 µm at the end; "
        "its window is 500 µm."
    )
    assert np.isnan(actual["load_settling_time_s"])


def test_load_that_leaves_its_window_after_it_has_settled() -> None:
    """It swings out at 1.5 s; that it was outside for the first 0.6 s does not matter."""

    def load(t: np.ndarray) -> np.ndarray:
        return np.where(t < 0.6, 3e-3, np.where(np.abs(t - 1.5) < 0.02, -1.3e-3, 1e-4))

    actual, metrics = evaluate(load, pieces=3)
    assert actual["load_within_window"] is False and actual["load_settling_time_s"] == pytest.approx(0.6)
    assert metrics.reason("j") == actual["load_reason"]
    assert actual["load_reason"].startswith("The load of j left the position window of 1 mm: its position")
    assert actual["load_reason"].endswith("was largest at t = 1.481 s, 1.3 mm.")
    assert actual["load_position_error_m"] == pytest.approx(1.3e-3)
    actual, _ = evaluate(lambda t: np.where(t < 0.6, 3e-3, 1e-4), pieces=3)
    assert actual["load_within_window"] is True and actual["load_settling_time_s"] == pytest.approx(0.6)


def test_swinging_load_is_outside_its_window() -> None:
    actual, _ = evaluate(lambda t: 0.2e-3 + 1.0e-3 * np.sin(2.0 * np.pi * t), pieces=5)
    assert actual["load_within_window"] is False and "1.2 mm" in actual["load_reason"]
    assert actual["load_swing_m"] == pytest.approx(2e-3)
    assert actual["load_position_error_m"] == pytest.approx(1.2e-3)


def test_errors_before_settling_do_not_count() -> None:
    """The screw comes into its window at 0.8 s; the load was far off before."""

    def screw(t: np.ndarray) -> np.ndarray:
        return np.where(t < 0.8, 5e-3, 0.0)

    actual, _ = evaluate(lambda t: screw(t) + 0.1e-3, screw, pieces=7)
    assert actual["load_within_window"] is True
    assert actual["load_position_error_m"] == pytest.approx(0.1e-3)


@pytest.mark.parametrize(("pieces", "since"), [(1, 0.0), (5, 1.25)])
def test_load_without_a_finite_position(pieces: int, since: float) -> None:
    actual, metrics = evaluate(lambda t: np.where(t >= since, np.nan, 1e-5), pieces=pieces)
    assert actual["load_within_window"] is False
    assert actual["load_reason"] == f"The load of j has no finite position error from t = {since:.6g} s on."
    assert metrics.reason("j") == actual["load_reason"]


def test_screw_is_compared_with_its_command_and_load_with_its_reference() -> None:
    """The screw is 3 mm ahead of a load that is where it is to be."""
    figures, _ = evaluate(1e-5, screw=3e-3, command=3e-3, pieces=3)
    assert figures["load_within_window"] is True and figures["load_evaluated_from_s"] == pytest.approx(0.3)
    assert figures["load_position_error_m"] == pytest.approx(1e-5)
    assert figures["load_deflection_m"] == pytest.approx(3e-3 - 1e-5)


@pytest.mark.parametrize("pieces", [1, 5])
def test_feedback_at_its_limit_is_reported(pieces: int) -> None:
    _, metrics = evaluate(0.0, correction=lambda t: np.where(t < 0.5, 0.0, -1e-3), pieces=pieces)
    (remark,) = metrics.remarks()
    assert "limit of 1 mm at t = 0.5 s" in remark and "j.command.feedback.limit" in remark
    _, metrics = evaluate(0.0, correction=0.999e-3)
    assert metrics.remarks() == []


def test_load_is_not_within_its_window_if_the_screw_has_not_settled() -> None:
    actual, metrics = evaluate(3e-3, screw=3e-3)
    assert actual["load_within_window"] is False and actual["load_reason"] == "j has not settled."
    assert metrics.reason("j") is None  # the joint's own reason says it


def test_short_runs_have_no_verdict() -> None:
    actual, metrics = evaluate(0.0, stop=0.3)
    assert actual["load_within_window"] is False and actual["load_reason"].startswith("too short")
    assert "load_within_window" not in [figure.name for figure in metrics.displays]
    actual, metrics = evaluate(0.0)
    assert next(figure.name for figure in metrics.displays) == "load_within_window"
    metrics.ended_early("it ended.")
    ended = metrics.figures()["j"]
    assert ended["load_reason"] == "it ended." and not ended["load_within_window"]


def test_requirements_find_metrics_of_loads() -> None:
    """`--require` and sweeps find both by joint and name."""
    kinds = {"joints": {"j": {"position_error_m": 1.0, "held": True}}, "loads": {"j": evaluate(0.5e-3)[0]}}
    flat = {name: figure.value for name, figure in list_figures(kinds).items()}
    assert flat["j.position_error_m"] == 1.0 and flat["j.held"] is True
    assert flat["j.load_position_error_m"] == pytest.approx(0.5e-3) and flat["j.load_within_window"] is True


def test_verdict_of_a_joint_includes_its_load() -> None:
    """The lift sags by 0.57 mm on its spring, which its screw does not show without load control."""
    criteria = {"lift.position_window": 0.5e-3}
    with ec.load("study-compliant", stop_time=0.8, load_control="none").prepare() as simulation:
        wide, narrow = simulation.run(recorders=[]), simulation.run(criteria=criteria, recorders=[])
    assert wide.metrics["joints"]["lift"]["held"] and wide.metrics["loads"]["lift"]["load_within_window"]
    joint, load = narrow.metrics["joints"]["lift"], narrow.metrics["loads"]["lift"]
    assert joint["position_error_m"] < 20e-6 and joint["judged"] == ["screw", "load"]
    assert not load["load_within_window"] and load["load_position_error_m"] > 0.5e-3
    assert not joint["held"] and joint["reason"] == load["load_reason"]
    assert narrow.remarks.count(load["load_reason"]) == 1
    assert next(figure.label for figure in narrow.displays["joints"]) == "held (screw and load)"
