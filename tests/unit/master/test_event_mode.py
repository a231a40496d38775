"""Event mode and early return of FMI 3.0 FMUs: time events, state events and discrete inputs."""

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import RunError
from emla_cosim.fmu.file import open_fmu
from emla_cosim.fmu.log import FmuLog
from emla_cosim.master.instances.event_mode_instance import EventModeInstance
from emla_cosim.master.instances.instance_kinds import make_instance
from emla_cosim.system.model import System
from tests.support.hand_written_fmus import build_event_fmu
from tests.support.tiers import mostly_slow

PERIOD, THRESHOLD, STOP = 0.3, 0.35, 2.0
ENDLESS_UPDATES, ENDLESS_RETURNS, UNEXPECTED_EVENT, UNEXPECTED_RETURN, NO_TIME, DISCARD = range(1, 7)
FLAGS = [{}, {"early": False}, {"events": False}, {"varies": False, "early": False}]
OPTIONS: list[dict[str, Any]] = [{}, {"isolate": ["a"]}, {"algorithm": "strong"}]
BY_DEFAULT = [*((flags, {}) for flags in FLAGS), ({}, OPTIONS[1]), ({}, OPTIONS[2])]
VALUES = {"a.period": PERIOD, "a.threshold": THRESHOLD}


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder, built = tmp_path_factory.mktemp("events"), dict[str, Path]()

    def get(**options: bool) -> Path:
        name = "Events" + "".join(f"{k}{v}" for k, v in sorted(options.items()))
        if name not in built:
            built[name] = build_event_fmu(folder / f"{name}.fmu", **options)
        return built[name]

    return get


def run(system: System, step: float = 0.125, stop: float = STOP, **options: Any) -> ec.Result:
    with ec.load(system, step_size=step, stop_time=stop, **options).prepare() as simulation:
        return simulation.run()


def whole(times: Any, length: float) -> Any:
    """Return how many whole lengths fit into each time."""
    return np.floor(np.asarray(times) / length + 1e-9)


@pytest.mark.parametrize(
    ("flags", "options"), mostly_slow([*BY_DEFAULT, ({"events": False}, OPTIONS[2])], BY_DEFAULT), ids=str
)
def test_events_happen_at_their_times(build: Any, flags: dict[str, bool], options: dict[str, Any]) -> None:
    """Compare with the closed form. Without early return, a state event is at the end of a step."""
    found = run(System.of({"a": build(**flags)}, [], VALUES), **options)
    times = np.asarray(found["time"])
    assert len(times) == 17
    bounces = whole(times, THRESHOLD)
    assert np.array_equal(found["a.count"], whole(times, PERIOD))
    assert np.array_equal(found["a.bounces"], bounces)
    assert np.allclose(found["a.x"], times - bounces * THRESHOLD, rtol=0.0, atol=1e-12)


def test_one_step_can_have_several_events(build: Any) -> None:
    found = run(System.of({"a": build()}, [], VALUES), step=2.0)
    assert [found[f"a.{name}"][-1] for name in ("count", "bounces")] == [6, 5]
    assert found["a.x"][-1] == pytest.approx(2.0 - 5 * THRESHOLD, abs=1e-12)
    assert found["a.updates"][-1] == 2 * (1 + 6 + 5)  # at the start, and for each event


def test_fmpy_has_the_same_results(build: Any) -> None:
    path, outputs = build(), ["x", "bounces"]
    found = run(System.of({"a": path}, [], {"a.threshold": THRESHOLD}))
    other = fmpy.simulate_fmu(
        str(path),
        stop_time=STOP,
        output_interval=0.125,
        start_values={"threshold": THRESHOLD},
        output=outputs,
        use_event_mode=True,
        early_return_allowed=True,
    )
    last = {round(row["time"], 9): row for row in other}  # the value after the event
    for name in outputs:
        expected = [last[round(t, 9)][name] for t in found["time"]]
        assert np.array_equal(found[f"a.{name}"], expected), name


def test_start_time_shifts_the_events(build: Any) -> None:
    with ec.load(
        System.of({"a": build()}, [], VALUES), step_size=0.125, start_time=1.0, stop_time=3.0
    ).prepare() as s:
        found = s.run()
    times = np.asarray(found["time"])
    assert times[0] == 1.0
    assert np.array_equal(found["a.count"], whole(times - 1.0, PERIOD))


@pytest.mark.parametrize("isolate", mostly_slow([[], ["b"]], [[]]))
def test_discrete_inputs_change_in_event_mode(build: Any, isolate: list[str]) -> None:
    """The FMU refuses them otherwise, and latches them at events: here they are its only events."""
    fmus = {"a": build(), "b": build()}
    found = run(System.of(fmus, ["a.count -> b.n"], VALUES), isolate=isolate, algorithm="jacobi")
    assert np.array_equal(found["b.latched"][1:], found["a.count"][:-1])
    changes = np.cumsum(np.diff(found["a.count"]) != 0)
    assert np.array_equal(found["b.updates"][2:], 2 * (1 + changes[:-1]))


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
            "doStep at t = 0 s with it asked for event mode, which is not allowed",
        ),
        (
            UNEXPECTED_RETURN,
            {"early": False, "varies": False},
            "doStep at t = 0 s with it returned early, which is not allowed",
        ),
        (NO_TIME, {}, "nextEventTime = NaN"),
        (DISCARD, {}, "answered doStep at t = 0.625 s with fmi3Discard"),
    ],
)
def test_faults_end_the_run(build: Any, fault: int, flags: dict[str, bool], words: str) -> None:
    values = {"a.fault": fault, "a.threshold": THRESHOLD, "a.end": 0.72}
    with pytest.raises(RunError, match=words):
        run(System.of({"a": build(**flags)}, [], values))


def test_undeclared_early_returns_are_accepted_with_a_remark(build: Any) -> None:
    values = {**VALUES, "a.fault": UNEXPECTED_RETURN, "a.threshold": THRESHOLD, "a.end": 0.72}
    ended = run(System.of({"a": build(early=False)}, [], values))
    assert ended.problem is None
    assert any("a returned early from doStep at t = " in remark for remark in ended.remarks)


def test_resumed_run_is_the_same(build: Any, tmp_path: Path) -> None:
    """The time of the next event and the discrete inputs are in the checkpoint."""
    system = System.of({"a": build(), "b": build()}, ["a.count -> b.n"], VALUES)
    whole_run = run(system)
    run(system, stop=0.625, checkpoint=tmp_path / "c")
    resumed = run(system, resume=tmp_path / "c")
    names = [n for n in whole_run.names if n != "time"]
    assert "b.latched" in names
    for name in names:
        assert np.array_equal(resumed[name], whole_run[name][-len(resumed[name]) :]), name


def test_restored_state_has_its_events_again(build: Any, tmp_path: Path) -> None:
    file = open_fmu(build(), tmp_path / "a")
    instance = make_instance("a", file, ["n", "u"], ["count", "latched", "x"], FmuLog())
    assert isinstance(instance, EventModeInstance)
    try:
        instance.set_start_values([(file.variables["period"], PERIOD)])
        instance.enter_initialization(0.0)
        instance.exit_initialization()
        state, seen = None, []
        for _ in range(2):
            if state is None:
                state = instance.save()
            else:
                instance.restore(state)
            instance.inputs[:] = 5.0, 2.0
            instance.set_inputs()
            instance.do_step(0.0, 1.0)
            instance.get_outputs()
            seen.append(instance.outputs.tolist())
        assert seen == [[3.0, 5.0, pytest.approx(2.0)]] * 2
        instance.forget(state)
    finally:
        instance.close()
