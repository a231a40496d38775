"""Error control: the error over a whole run, the longest step, and events."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.inputs.input import Input
from emla_cosim.inputs.loaded_input import input_events, row_distance
from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.master.stepping import control_tables
from emla_cosim.master.stepping.error_control import REMARK_THRESHOLD, ErrorControl, default_largest_step
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.study.loading import load
from emla_cosim.study.loads import scheduled_times
from emla_cosim.system.fault import Fault
from tests.support.faulty_systems import line_with_a_fault
from tests.support.hand_written_fmus import Fault as FmuFault
from tests.support.linear import LinearSlave, Whole, connected
from tests.support.simulated import begun, recorded
from tests.support.step_control import LARGEST_GROWTH
from tests.support.tiers import mostly_slow
from tests.support.two_masses import Part, elastic_load, rigid_load


def controlled(
    part: Part, name: str, extrapolation: str, tolerance: float, stop: float, first: float = 1e-3
) -> ErrorControl:
    times = make_communication_points(stop, first)
    return ErrorControl(begun(connected(*part), ALGORITHMS[name](extrapolation), times), times, tolerance)


def error_of(rows: np.ndarray, part: Part) -> float:
    """The largest error of a signal, relative to its largest value, against the closed form."""
    closed_form = Whole(*part)
    exact = np.array([closed_form.outputs(t) for t in rows[:, 0]])
    return float((np.abs(rows[:, 1:] - exact).max(axis=0) / np.abs(exact).max(axis=0)).max())


# ---- the error of a whole run -------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", mostly_slow([1e-2, 1e-3], [1e-2]))
@pytest.mark.parametrize("ratio", [1.0, 3e3])
def test_followed_inputs_keep_the_error_of_a_run_near_the_tolerance(ratio: float, tolerance: float) -> None:
    """A load that answers an acceleration with a force, as heavy as what drives it and much heavier."""
    part = rigid_load(ratio)
    stepping = controlled(part, "strong", "fmu", tolerance, 1.0)
    error = error_of(recorded(stepping), part)
    assert 1e-3 * tolerance < error < 10.0 * tolerance
    assert stepping.remarks() == []


@pytest.mark.slow
def test_error_keeps_its_bound_as_a_run_becomes_longer() -> None:
    """Two periods."""
    part = rigid_load(1e3)
    assert error_of(recorded(controlled(part, "strong", "fmu", 0.1, 20.0, 0.05)), part) < 1.0


@pytest.mark.parametrize(
    ("name", "extrapolation"),
    mostly_slow(product(ALGORITHMS, ["none", "master"]), [("jacobi", "none"), ("gauss-seidel", "master")]),
)
def test_held_inputs_get_a_remark_with_the_ratio(
    name: str, extrapolation: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where steps would become too short, the errors of all steps add up to about what the run makes."""
    monkeypatch.setattr(control_tables, "SHORT_STEP_FRACTION", 1e-3)
    part, tolerance = elastic_load(), 1e-4
    stepping = controlled(part, name, extrapolation, tolerance, 2.0)
    error = error_of(recorded(stepping), part)
    (remark,) = stepping.remarks()
    estimated = stepping.report()["estimated_error"]
    assert error > REMARK_THRESHOLD * tolerance
    assert 0.5 * error < estimated < 10.0 * error
    assert f"{estimated / tolerance:.2g} times the error tolerance {tolerance:g}" in remark


def test_notes_before_the_run_name_the_limits_of_the_tolerance() -> None:
    part = elastic_load()
    notes_for_held, notes_for_followed = (
        controlled(part, "strong", way, 1e-2, 0.05).notes() for way in ("none", "fmu")
    )
    assert "inputs are held" in notes_for_held[0] and notes_for_followed == []


def test_accurate_held_inputs_get_no_remark() -> None:
    """The neighbour: a load on a soft spring, and a run of few steps."""
    part = elastic_load()
    stepping = controlled(part, "strong", "none", 1e-2, 0.05)
    assert error_of(recorded(stepping), part) < 0.1
    assert stepping.remarks() == []


# ---- how long steps become ----------------------------------------------------------------------


def rest(until: float = np.inf, jump: float = 1.0) -> Part:
    """A source at rest that jumps at a time, and a lag of 0.05 s that follows it."""
    lag = LinearSlave("lag", [[-20.0]], [20.0], [1.0], [[0.0]], [0.0])
    source = LinearSlave("source", [[0.0]], [], [1.0], np.empty((1, 0)), [0.0])

    def advance(u: np.ndarray, x: np.ndarray, time: float, step: float) -> list[float]:
        return [jump if time + step >= until else 0.0]

    source._advance = advance
    return [source, lag], [(0, 0, 1, 0)]


def test_no_step_is_longer_than_the_largest_and_growth_is_bounded() -> None:
    """At rest nothing but these bounds keeps steps short."""
    times = make_communication_points(10.0, 1e-3)
    assert default_largest_step(times) == pytest.approx(0.2)
    for largest, expected in ((None, 0.2), (0.03, 0.03), (1e-4, 1e-4)):
        stop = 10.0 if expected > 1e-3 else 0.05
        times = make_communication_points(stop, 1e-3)
        algorithm = begun(connected(*rest()), ALGORITHMS["jacobi"]("fmu"), times)
        steps = np.diff(recorded(ErrorControl(algorithm, times, 1e-3, largest=largest))[:, 0])
        assert steps.max() == pytest.approx(expected, rel=1e-6)
        assert (steps[1:-2] <= LARGEST_GROWTH * steps[:-3] * (1.0 + 1e-9)).all()


@pytest.mark.parametrize(
    ("name", "extrapolation"),
    mostly_slow(
        product(ALGORITHMS, ["none", "fmu"]), [("jacobi", "fmu"), ("gauss-seidel", "fmu"), ("strong", "none")]
    ),
)
def test_steps_end_at_events_and_no_line_covers_them(name: str, extrapolation: str) -> None:
    """A jump at 1.2345 s, known before, against the lag's closed form."""
    at, times = 1.2345, make_communication_points(2.0, 1e-3)

    def simulated(events: Sequence[float]) -> tuple[np.ndarray, float]:
        algorithm = begun(connected(*rest(until=at)), ALGORITHMS[name](extrapolation), times)
        rows = recorded(ErrorControl(algorithm, times, 1e-3, events=events))
        passed = np.maximum(rows[:, 0] - at, 0.0)
        return rows, float(np.abs(rows[:, 2] - (1.0 - np.exp(-20.0 * passed))).max())

    rows, error = simulated([-1.0, at, 5.0])
    assert at in rows[:, 0]
    assert error < 1e-3
    assert at not in simulated([])[0][:, 0]


def test_events_match_faults_held_data_and_schedules() -> None:
    data = {"time": [0.0, 1.0, 2.0, 3.0], "j.a.u": [1.0, 1.0, 4.0, 4.0]}
    stepwise = Input(data=data, interpolation="held")
    repeated = Input(data=data, interpolation="held", end="repeat")
    linear = Input(data={"time": [0.5, 0.6, 0.8], "j.b.u": [1.0, 1.0, 4.0]})
    faults = [Fault("j.a.u", "offset", 1.5, 0.25, 1.0), Fault("j.a.u", "freeze", 7.0)]
    assert sorted(input_events([stepwise], faults, {}, 0.0, 9.0)) == [1.5, 1.75, 2.0, 3.0, 7.0]
    assert sorted(input_events([repeated], [], {}, 0.0, 8.0)) == [2.0, 3.0, 5.0, 6.0, 8.0, 9.0]
    assert sorted(input_events([linear], [], {}, 0.0, 9.0)) == [0.5, 0.8]
    assert row_distance([stepwise, linear]) == pytest.approx(0.15)
    assert row_distance([stepwise]) == row_distance([]) == np.inf
    parameters = {"j.d.load.start[2]": 0.7, "j.d.load.ramp": 0.5, "j.d.supply.start": 3.0}
    assert sorted(scheduled_times(parameters)) == pytest.approx([0.7, 1.2, 3.0, 3.0])


def test_run_meets_the_events_of_its_options_and_its_load() -> None:
    """Also where it begins at another time than 0."""
    simulation = load("lift", stop_time=0.02).prepare()
    result = simulation.run(
        start_time=0.01,
        stop_time=0.02,
        error_tolerance=0.1,
        largest_step=1e-3,
        set={"lift.disturbance.load.start[2]": 0.0123456, "lift.disturbance.load.ramp": 0.005},
    )
    times = np.asarray(result["time"])
    assert {0.0123456, 0.0173456} <= set(times.round(9))
    assert np.diff(times).max() <= 1e-3 * (1.0 + 1e-9)
    assert result.stepping["largest_step_s"] == 1e-3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"largest_step": 1e-3}, "--largest-step needs --error-tolerance. Set both"),
        ({"largest_step": 0.0, "error_tolerance": 0.1}, "the largest step 0 must be a positive number"),
    ],
)
def test_invalid_largest_steps(options: dict[str, float], message: str) -> None:
    with pytest.raises(CommandError, match=message):
        load("lift", stop_time=0.03, **options).prepare().run()


@pytest.mark.parametrize(
    ("options", "interval"),
    [
        ({"error_tolerance": 1e-3, "output_interval": 0.25}, 0.25),
        ({"error_tolerance": 1e-3}, None),
        ({"output_interval": 0.2}, 0.2),
        ({"output_interval": 0.2, "start_time": 0.3}, 0.2),
        ({}, 0.1),
    ],
)
def test_interval_of_rows_is_recorded(
    options: dict[str, Any], interval: float | None, faulty_fmu: Path
) -> None:
    """Error control meets it whatever the step size is; without one it records every step."""
    system = line_with_a_fault(faulty_fmu, FmuFault.NONE, 0.0)
    with load(system, algorithm="jacobi", stop_time=1.0, step_size=0.1).prepare() as simulation:
        result = simulation.run(**options)
    assert result.record["settings"]["output_interval_s"] == (interval and pytest.approx(interval))
    if interval is not None:
        assert np.diff(result.time)[:-1] == pytest.approx(interval)
