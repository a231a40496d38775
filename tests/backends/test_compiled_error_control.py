"""Error control in compiled code does what it does in Python: the same bits, errors and reports."""

from collections import Counter
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.master.algorithms.gauss_seidel import GaussSeidel
from emla_cosim.master.stepping import error_control, step_size_control
from emla_cosim.master.stepping.error_control import ErrorControl
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.run.result import Result
from tests.support.faulty_fmu import Fault, build_faulty_fmu
from tests.support.faulty_systems import line_with_a_fault, loop_with_a_fault, open_system
from tests.support.simulated import begun, recorded
from tests.support.tiers import mostly_slow

WAYS: dict[str, dict[str, Any]] = {
    "jacobi": {"algorithm": "jacobi"},
    "gauss-seidel with lines": {"algorithm": "gauss-seidel", "extrapolation": "fmu"},
    "strong": {"algorithm": "strong"},
    "strong with middles": {"algorithm": "strong", "extrapolation": "master"},
}

FAULTS = [
    *(Fault.NONE, Fault.DISCARD, Fault.ERROR, Fault.FATAL, Fault.NAN_Y, Fault.NAN_Z, Fault.TERMINATE),
    *(Fault.GET_REAL, Fault.SET_REAL, Fault.PENDING, Fault.GET_STATE, Fault.WARNING, Fault.NEGATIVE),
]
CASES = [(fault, way) for fault in FAULTS for way in WAYS]
FEW = [
    (Fault.NONE, "jacobi"),
    (Fault.DISCARD, "jacobi"),
    (Fault.DISCARD, "strong"),
    (Fault.ERROR, "gauss-seidel with lines"),
    (Fault.FATAL, "jacobi"),
    (Fault.NAN_Y, "strong with middles"),
    (Fault.NAN_Z, "jacobi"),
    (Fault.TERMINATE, "gauss-seidel with lines"),
    (Fault.GET_REAL, "strong"),
    (Fault.SET_REAL, "jacobi"),
    (Fault.GET_STATE, "gauss-seidel with lines"),
    (Fault.WARNING, "strong"),
]


@pytest.fixture(scope="module")
def faulty_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_faulty_fmu(tmp_path_factory.mktemp("faulty"))


def run_both(scenario: ec.Scenario, **options: Any) -> tuple[Result, Result]:
    """The results of a run with and without compiled code, of the same instances."""
    found = []
    for compiled in (True, False):
        with scenario.prepare() as simulation:
            table = ec.TimeSeries()
            found.append(simulation.attempt(recorders=[table], compiled=compiled, **options))
    assert [result.stepping["compiled"] for result in found] == [True, False]
    return found[0], found[1]


def assert_same(compiled: Result, here: Result) -> None:
    rows, expected = (np.column_stack(list(r.read(["time", *r.names]).values())) for r in (compiled, here))
    assert rows.tobytes() == expected.tobytes()
    assert compiled.problem == here.problem
    assert (compiled.steps, compiled.end_s) == (here.steps, here.end_s)
    assert {**compiled.stepping, "compiled": False} == here.stepping
    np.testing.assert_equal(compiled.coupling, here.coupling)
    np.testing.assert_equal(compiled.metrics, here.metrics)
    assert compiled.remarks == here.remarks


@pytest.mark.parametrize(("fault", "way"), mostly_slow(CASES, FEW))
@pytest.mark.parametrize("interval", [None, 0.1])
def test_faults_end_a_run_alike(fault: Fault, way: str, interval: float | None, faulty_fmu: Path) -> None:
    make = loop_with_a_fault if way.startswith("strong") else line_with_a_fault
    system = make(faulty_fmu, fault, 0.35)
    scenario = ec.load(system, stop_time=1.0, step_size=0.1, error_tolerance=0.01, **WAYS[way])
    compiled, here = run_both(scenario, output_interval=interval)
    assert_same(compiled, here)
    if fault is Fault.DISCARD:
        assert here.stepping["rejected_steps"] > 5


@pytest.mark.parametrize("longest", [0.02, 0.05])
def test_steps_that_an_fmu_discards_are_tried_shorter(longest: float, faulty_fmu: Path) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0, longest=longest)
    compiled, here = run_both(ec.load(system, stop_time=1.0, step_size=0.1, error_tolerance=0.1))
    assert here.problem is None and here.stepping["rejected_steps"] > 0
    assert_same(compiled, here)


LIFT = [
    ("jacobi", 1e-3, None),
    ("gauss-seidel with lines", 1e-4, 1e-3),
    ("strong", 1e-3, 1e-3),
    ("strong with middles", 1e-3, None),
]


@pytest.mark.parametrize(("way", "tolerance", "interval"), LIFT)
def test_lift_has_the_same_bits(way: str, tolerance: float, interval: float | None, fmu_folder: Path) -> None:
    scenario = ec.load(
        "lift",
        stop_time=0.001,
        error_tolerance=tolerance,
        output_interval=interval,
        fmus=fmu_folder,
        **WAYS[way],
    )
    compiled, here = run_both(scenario)
    assert here.steps > 20
    assert_same(compiled, here)


def test_a_run_continues_with_and_without_compiled_code(fmu_folder: Path, tmp_path: Path) -> None:
    """A checkpoint of one is continued by the other."""
    scenario = ec.load("lift", error_tolerance=1e-3, output_interval=1e-3, fmus=fmu_folder)
    ends = []
    for first, second in [(True, False), (False, True)]:
        path = tmp_path / f"{first}"
        with scenario.prepare(stop_time=0.002, checkpoint=path) as simulation:
            simulation.run(compiled=first)
        with scenario.prepare(stop_time=0.005, resume=path) as simulation:
            result = simulation.run(compiled=second)
        ends.append(result.to_polars())
    assert ends[0].equals(ends[1])


class Shuffled(ErrorControl):
    """Error control whose signals have random roles, so that every rule applies to some."""

    seed = 0
    rules: ClassVar[Counter[str]] = Counter()

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        random = np.random.default_rng(self.seed)
        for flags in (self._instant, self._unread, self._beside, self._looked_at):
            flags[:] = random.random(len(flags)) < 0.3
        self._looked_at[:] = random.random(len(self._looked_at)) < 0.8
        self._jumped[:] = random.random(len(self._jumped)) < 0.5
        self._per_unit = bool(random.random() < 0.5)
        if self._kernel is not None:
            self._kernel.use(self._controlled())

    def _jumps(self, step: float, errors: Any, allowed: float) -> Any:
        found = super()._jumps(step, errors, allowed)
        self.rules["jump"] += int(found.any())
        self.rules["beside"] += int(step < error_control.UNREAD * self.times.step)
        return found

    def _bends(self, step: float, errors: Any) -> Any:
        found = super()._bends(step, errors)
        self.rules["bend"] += int(found.any())
        return found

    def _judge_each_step(self) -> None:
        self.rules["crawl"] += self._kernel is None
        super()._judge_each_step()


SHUFFLED = [
    (0, {"jump", "beside", "bend"}, False),
    (1, {"jump", "beside", "bend"}, True),  # no step is short enough in the end
    (2, {"jump", "beside", "bend", "crawl"}, False),
]
"""Seeds, the rules that apply then, and whether the run fails."""


@pytest.mark.parametrize(("seed", "rules", "fails"), SHUFFLED)
def test_every_rule_for_errors_is_the_same(
    seed: int, rules: set[str], fails: bool, fmu_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(step_size_control, "ErrorControl", Shuffled)
    monkeypatch.setattr(Shuffled, "seed", seed)
    monkeypatch.setattr(Shuffled, "rules", Counter())
    compiled, here = run_both(
        ec.load(
            "lift",
            stop_time=0.0003,
            error_tolerance=[1e-3, 1e-5][seed % 2],
            fmus=fmu_folder,
            largest_step=2e-4,
            **list(WAYS.values())[seed],
        )
    )
    assert_same(compiled, here)
    assert {rule for rule, count in Shuffled.rules.items() if count} == rules
    assert (here.problem is not None) == fails


def test_events_and_watched_steps_are_the_same(faulty_fmu: Path) -> None:
    """Steps end at each event, and the history of lines begins anew there."""

    def run(compiled: bool) -> tuple[list[list[float]], list[list[float]], int]:
        seen: list[list[float]] = []
        with open_system(line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)) as assembly:
            times = make_communication_points(1.0, 0.1)
            algorithm = begun(assembly.network, GaussSeidel("fmu"), times)
            events = [0.31, 0.5, 0.77]
            stepping = ErrorControl(algorithm, times, 1e-3, 0.25, events=events, compiled=compiled)
            assert stepping.is_compiled == compiled
            stepping.watch = lambda time, signals: seen.append([time, *signals])
            rows = recorded(stepping).tolist()
            return rows, seen, stepping.report()["rejected_steps"]

    rows, seen, rejected = run(compiled=True)
    assert (rows, seen, rejected) == run(compiled=False)
    assert [row[0] for row in rows] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert {0.31, 0.5, 0.77} <= {row[0] for row in seen}
