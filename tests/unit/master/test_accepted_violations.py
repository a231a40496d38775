"""What FMUs do against the standard and is accepted: the same remarks in this process and in others."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.system.model import System
from tests.support.hand_written_fmus import build_event_fmu
from tests.support.tiers import mostly_slow

UNEXPECTED_RETURN = 4
TIMES: dict[str, Any] = {"step_size": 0.125, "stop_time": 1.0}


@pytest.fixture(scope="module")
def events(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU that returns early without declaring it, with `fault` = 4."""
    return build_event_fmu(tmp_path_factory.mktemp("events") / "Events.fmu", early=False)


def remark(name: str) -> str:
    return (
        f"{name} returned early from doStep at t = 0 s, although its model description does not have "
        "mightReturnEarlyFromDoStep; the rest of the step followed as another one."
    )


def start_values(fault: int) -> dict[str, Any]:
    return {"a.period": 0.3, "a.threshold": 0.35, "a.fault": fault, "b.period": 0.3, "b.threshold": 0.35}


@pytest.mark.parametrize("isolate", mostly_slow([["a"], ["a", "b"], ["b"], []], [["a"]]), ids=str)
def test_early_returns_are_reported_wherever_the_fmu_runs(events: Path, isolate: list[str]) -> None:
    system = System.of({"a": events, "b": events}, [], start_values(UNEXPECTED_RETURN))
    with ec.load(system, isolate=isolate, **TIMES).prepare() as simulation:
        first = simulation.run()
        second = simulation.run()
        assert first.remarks == second.remarks == [remark("a")]
        assert simulation.run(set={"a.fault": 0}).remarks == []
        second_run = simulation.run(set={"b.fault": UNEXPECTED_RETURN})
        assert second_run.remarks == [remark("a"), remark("b")]
    assert np.array_equal(first["a.x"], second_run["a.x"])


@pytest.mark.parametrize("isolate", mostly_slow([True, False], [False]))
def test_early_returns_are_reported_in_the_middle_of_a_run(events: Path, isolate: bool) -> None:
    system = System.of({"a": events}, [], {"a.fault": UNEXPECTED_RETURN})
    with ec.load(system, isolate=isolate, **TIMES).prepare() as simulation:
        simulation.start()
        assert simulation.so_far().remarks == []
        simulation.advance(0.125)
        assert simulation.so_far().remarks == [remark("a")]
        assert simulation.finish().remarks == [remark("a")]
        simulation.start()
        assert simulation.so_far().remarks == []


@pytest.mark.parametrize("isolate", mostly_slow([True, False], [True]))
def test_step_that_is_not_completed_reports_its_early_return(events: Path, isolate: bool) -> None:
    """The FMU asks for the end in the event after the early return, within the same step."""
    values = {"a.fault": UNEXPECTED_RETURN, "a.period": 0.3, "a.end": 0.3}
    with ec.load(System.of({"a": events}, [], values), step_size=2.0, stop_time=2.0).prepare(
        isolate=isolate
    ) as simulation:
        ended, early_return = simulation.run().remarks
        assert "a asked to end the simulation during updateDiscreteStates at t = 0.3 s" in ended
        assert early_return == remark("a")
