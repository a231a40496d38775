"""Event mode and early return of FMI 3.0 FMUs: time events, state events and discrete inputs."""

from typing import Any

import fmpy
import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import RunError
from emla_cosim.master.algorithms.registry import Jacobi
from emla_cosim.master.instances.event_mode_instance import EventModeInstance
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.system.model import System
from tests.support.faulty_systems import open_system
from tests.support.simulated import simulated
from tests.unit.master.conftest import run

PERIOD, THRESHOLD, STOP = 0.3, 0.35, 2.0
ENDLESS_UPDATES, ENDLESS_RETURNS, UNEXPECTED_EVENT, UNEXPECTED_RETURN, NO_TIME, DISCARD = range(1, 7)
VALUES = {"a.period": PERIOD, "a.threshold": THRESHOLD}


def step_as_whole(times: Any, length: float) -> Any:
    """Return how many whole lengths fit into each time."""
    return np.floor(np.asarray(times) / length + 1e-9)


@pytest.mark.parametrize(
    ("flags", "options"),
    [
        ({}, {}),
        ({"early": False}, {}),
        ({"events": False}, {}),
        ({"varies": False, "early": False}, {}),
        ({}, {"start_time": 1.0, "stop": 1.0 + STOP}),
        ({}, {"isolate": ["a"]}),
        ({}, {"algorithm": "strong"}),
        ({"events": False}, {"algorithm": "strong"}),
        ({}, {"error_tolerance": 1e-3, "output_interval": 0.125}),  # which goes back in each step
    ],
    ids=str,
)
def test_events_happen_at_their_times(build: Any, flags: dict[str, bool], options: dict[str, Any]) -> None:
    """Compare with the closed form. Without early return, a state event is at the end of a step."""
    result = run(System.of({"a": build(**flags)}, [], VALUES), **options)
    times = np.asarray(result["time"]) - options.get("start_time", 0.0)
    assert len(times) == 17
    bounces = step_as_whole(times, THRESHOLD)
    assert np.array_equal(result["a.count"], step_as_whole(times, PERIOD))
    assert np.array_equal(result["a.bounces"], bounces)
    assert np.allclose(result["a.x"], times - bounces * THRESHOLD, rtol=0.0, atol=1e-12)


def test_one_step_can_have_several_events(build: Any) -> None:
    result = run(System.of({"a": build()}, [], VALUES), step=2.0)
    assert [result[f"a.{name}"][-1] for name in ("count", "bounces")] == [6, 5]
    assert result["a.x"][-1] == pytest.approx(2.0 - 5 * THRESHOLD, abs=1e-12)
    assert result["a.updates"][-1] == 2 * (1 + 6 + 5)  # at the start, and for each event


def test_fmpy_has_the_same_results(build: Any) -> None:
    path, outputs = build(), ["x", "bounces"]
    result = run(System.of({"a": path}, [], {"a.threshold": THRESHOLD}))
    fmpy_result = fmpy.simulate_fmu(
        str(path),
        stop_time=STOP,
        output_interval=0.125,
        start_values={"threshold": THRESHOLD},
        output=outputs,
        use_event_mode=True,
        early_return_allowed=True,
    )
    last = {round(row["time"], 9): row for row in fmpy_result}  # the value after the event
    for name in outputs:
        expected = [last[round(t, 9)][name] for t in result["time"]]
        assert np.array_equal(result[f"a.{name}"], expected), name


def test_discrete_inputs_change_in_event_mode(build: Any) -> None:
    """The FMU refuses them otherwise, and latches them at events: here they are its only events."""
    fmus = {"a": build(), "b": build()}
    result = run(System.of(fmus, ["a.count -> b.n"], VALUES), algorithm="jacobi")
    assert np.array_equal(result["b.latched"][1:], result["a.count"][:-1])
    changes = np.cumsum(np.diff(result["a.count"]) != 0)
    assert np.array_equal(result["b.updates"][2:], 2 * (1 + changes[:-1]))


def test_input_that_is_set_by_hand_is_latched(build: Any) -> None:
    with ec.load(
        System.of({"a": build()}, [], VALUES), step_size=0.125, stop_time=STOP
    ).prepare() as simulation:
        simulation.start()
        simulation["a.n"] = 7
        simulation.advance(0.125)
        assert simulation["a.latched"] == 7


def test_fmu_can_end_the_simulation(build: Any) -> None:
    system = System.of({"a": build()}, [], {**VALUES, "a.end": 0.6})
    ended = run(system)
    assert "asked to end the simulation during updateDiscreteStates at t = 0.6 s" in ended.remarks[0]
    assert run(system, step=0.1, stop=0.6)["a.count"][-1] == 2  # the event at the end belongs to the run


@pytest.mark.parametrize(
    ("fault", "flags", "words"),
    [
        (ENDLESS_UPDATES, {}, "answered updateDiscreteStates at t = 0 s with a request for more, 1000 times"),
        (ENDLESS_RETURNS, {}, "answered doStep at t = 0 s with a request for more, 1001 times"),
        (
            UNEXPECTED_EVENT,
            {"events": False},
            "doStep at t = 0 s with a request for event mode, which is not allowed",
        ),
        (
            UNEXPECTED_RETURN,
            {"early": False, "varies": False},
            "doStep at t = 0 s with an early return, which is not allowed",
        ),
        (NO_TIME, {}, "nextEventTime = NaN"),
        (
            DISCARD,
            {},
            "answered doStep at t = 0.625 s with fmi3Discard. Parts of 0.000122 s are ",
        ),
    ],
)
def test_faults_end_the_run(build: Any, fault: int, flags: dict[str, bool], words: str) -> None:
    values = {"a.fault": fault, "a.threshold": THRESHOLD, "a.end": 0.72}
    with pytest.raises(RunError, match=words):
        run(System.of({"a": build(**flags)}, [], values))


def test_events_are_handled_in_c(build: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """With an oracle in Python, the matrix of `tests/backends` would not notice steps in Python."""

    def fail(*arguments: Any) -> None:
        raise AssertionError("a step in Python")

    monkeypatch.setattr(EventModeInstance, "do_step", fail)
    for options in ({}, {"algorithm": "strong"}, {"error_tolerance": 1e-3}):
        assert run(System.of({"a": build()}, [], VALUES), **options)["a.count"][-1] == 6


def test_discrete_input_out_of_range_ends_the_run(build: Any) -> None:
    system = System.of({"a": build(), "b": build()}, ["a.count -> b.n"], VALUES)
    words = "b got a value that it cannot accept: its input n is Int32 and cannot be 3000000000"
    with open_system(system) as assembly:
        assembly.network.factors[1][:] = 1.5e9
        with pytest.raises(RunError, match=words):
            simulated(assembly.network, Jacobi(), make_communication_points(STOP, 0.125))
