"""Simulated time keeps the pace of the clock."""

import json
import time
from pathlib import Path

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.master import run_loop
from emla_cosim.master.run_loop import Pacing
from tests.support.faulty_systems import line_with_a_fault, run_system
from tests.support.hand_written_fmus import Fault


class Clock:
    """A clock that moves only by work and sleep."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.naps: list[float] = []

    def perf_counter(self) -> float:
        return self.now

    def sleep(self, duration: float) -> None:
        self.naps.append(duration)
        self.now += duration


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(run_loop, "time", clock)
    return clock


def begun(factor: float, simulated: float = 0.0) -> Pacing:
    paced = Pacing(factor)
    paced.begin(simulated)
    return paced


@pytest.mark.parametrize(
    ("factor", "start", "due"),
    # the last one is a run that was continued at 1 s
    [(1.0, 0.0, 1002.0), (4.0, 0.0, 1000.5), (0.5, 0.0, 1004.0), (1.0, 1.0, 1001.0)],
)
def test_wait_ends_at_the_due_time(factor: float, start: float, due: float, clock: Clock) -> None:
    paced = begun(factor, start)
    clock.now += 0.125
    paced.wait(2.0, lambda: False)
    assert clock.now == pytest.approx(due)
    assert (paced.points, paced.overruns, paced.worst) == (1, 0, 0.0)


def test_delays_are_counted_and_made_up(clock: Clock) -> None:
    paced = begun(1.0)
    for worked, arrival in ((0.5, 1001.0), (1.5, 1002.5), (0.0, 1003.0), (1.25, 1004.25), (0.0, 1005.0)):
        clock.now += worked
        paced.wait(paced.points + 1.0, lambda: False)
        assert clock.now == pytest.approx(arrival)
    assert paced.report() == pytest.approx({"factor": 1.0, "points": 5, "overruns": 2, "worst_delay_s": 0.5})


def test_an_interruption_is_noticed_while_waiting(clock: Clock) -> None:
    begun(1.0).wait(100.0, lambda: clock.now > 1000.25)
    assert clock.now < 1000.4
    assert max(clock.naps) <= 0.1


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf")])
def test_invalid_real_time_factors_are_refused(factor: float) -> None:
    with pytest.raises(CommandError, match=f"real-time factor {factor:g} must be a positive number"):
        Pacing(factor)


@pytest.mark.parametrize("options", [{}, {"error_tolerance": 0.5}])
def test_run_keeps_the_pace_and_reports_it(options: dict, faulty_fmu: Path, tmp_path: Path) -> None:
    start = time.perf_counter()
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)
    result = run_system(system, tmp_path, stop_time=0.4, step_size=0.01, real_time=2.0, **options)
    assert result.problem is None
    assert time.perf_counter() - start >= result.wall_s >= 0.2
    metrics = json.loads((tmp_path / "metrics.json").read_text())["run"]
    assert metrics["wall_s"] >= 0.2
    report = metrics["real_time"]
    assert set(report) == {"factor", "points", "overruns", "worst_delay_s"}
    assert report["factor"] == 2.0 and 0 <= report["overruns"] <= report["points"]
    assert 1 <= report["points"] <= 41
    assert json.loads((tmp_path / "run.json").read_text())["settings"]["real_time_factor"] == 2.0
