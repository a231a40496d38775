"""The host of examined FMUs: runs beside exact solutions, and processes that end."""

import multiprocessing
import os
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.model_description import ModelVariable, SimpleType
from scipy.linalg import expm

from emla_cosim.fmu.elements import ElementVariable
from emla_cosim.fmu.unpack import unpack
from emla_cosim.sandbox import child
from emla_cosim.verification.checks._sameness import compare_runs
from emla_cosim.verification.examination import examine_fmu
from emla_cosim.verification.host.experiment import Experiment, make_experiment
from emla_cosim.verification.host.fresh_process import EndedError, in_fresh_process
from emla_cosim.verification.host.hosted_instance import CallError, HostedInstance
from emla_cosim.verification.host.instance_runs import OutputTrajectory, run_alone
from emla_cosim.verification.host.integration import Integration
from emla_cosim.verification.host.other_values import other_of
from emla_cosim.verification.settings import Settings
from emla_cosim.verification.subject import Subject
from emla_cosim.verification.verdict import Verdict
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.examining import examine, list_problems
from tests.support.hand_written_fmus import build_trigger_fmu


def _subject(folder: Path, fault: str = "") -> Subject:
    path = build_good_fmu(folder, fault)
    unpack(path, folder / "fmu")
    return Subject(path, (folder / "fmu").resolve())


@pytest.mark.parametrize(
    ("type_", "start", "other"),
    [("UInt8", 255, 254), ("Int8", 127, 126), ("UInt64", 2**64 - 1, 2**64 - 2), ("Int8", -128, -127)],
)
def test_other_values_fit_into_the_type(type_: str, start: int, other: int) -> None:
    variable = ElementVariable("n", 1, type="Integer", start=str(start), data_type=type_)
    assert other_of(variable) == other


def test_other_values_of_reals_are_near_the_start_value() -> None:
    for type_ in ("Float32", "Float64"):
        assert other_of(ElementVariable("x", 1, type="Real", start="2", data_type=type_)) == pytest.approx(
            2.2
        )


def test_inputs_vary_within_the_limits_of_their_declared_type() -> None:
    declared = SimpleType("Angle", "Real", min="-1", max="1")
    subject: Any = SimpleNamespace(
        of_causality=lambda _: [ModelVariable("u", 1, type="Real", start="0.99", declaredType=declared)],
        description=SimpleNamespace(defaultExperiment=None),
        most_steps=100,
    )
    assert (
        -1.0 <= min(make_experiment(subject).inputs["u"]) < max(make_experiment(subject).inputs["u"]) == 1.0
    )


def _levels(subject: Subject) -> list[float]:
    """The number of ticks of an output clock, which belongs to it, after each step of 0.05 s."""
    instance = HostedInstance(subject)
    instance.initialize({"period": 0.1}, 0.0)
    found = []
    for k in range(10):
        instance.step(0.05 * k, 0.05)
        found.append(instance.get(["level"])[0])
    instance.close()
    return found


def test_variables_of_output_clocks_are_read_when_they_tick(tmp_path: Path) -> None:
    path = build_trigger_fmu(tmp_path / "Triggers.fmu")
    unpack(path, tmp_path / "fmu")
    found = in_fresh_process(_levels, Subject(path, (tmp_path / "fmu").resolve()))
    assert found == [0, 1, 1, 2, 2, 3, 3, 4, 4, 5]


def test_other_values_of_fmi_2_fit_into_32_bits() -> None:
    assert other_of(ModelVariable("n", 1, type="Integer", start=str(2**31 - 1))) == 2**31 - 2


def _exact(course: Experiment) -> np.ndarray:
    """Position and speed of a mass on a spring under a force that is held over each step."""
    matrix = np.array([[0.0, 1.0, 0.0], [-40.0, -1.0, 2.0], [0.0, 0.0, 0.0]])
    step = expm(course.step * matrix)
    state = np.array([0.01, 0.0, 0.0])
    rows = [state[:2]]
    for k in range(len(course.times) - 1):
        state[2] = course.inputs["u"][k]
        state = step @ state
        rows.append(state[:2])
    return np.array(rows)


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_run_is_the_exact_solution(tmp_path: Path, kind: str) -> None:
    """Inputs reach the FMU at the right times, and outputs are those of the end of each step."""
    subject = _subject(tmp_path)
    course = make_experiment(subject)
    found = run_alone(subject, course, kind)
    assert found.names[:2] == ["position", "speed"]
    np.testing.assert_allclose(found.values[:, :2], _exact(course), atol=2e-7)


def test_run_ends_where_the_fmu_asks_to(tmp_path: Path) -> None:
    """The step that it did not do has no row."""
    found = run_alone(_subject(tmp_path, "ASKS_TO_END"))
    assert found.times[-1] == pytest.approx(0.5)


def test_error_comes_back_from_another_process(tmp_path: Path) -> None:
    with pytest.raises(CallError, match="fmi2ExitInitializationMode answered fmi2Error") as caught:
        run_alone(_subject(tmp_path, "INITIALIZATION_ERROR"))
    assert (caught.value.call, caught.value.status) == ("fmi2ExitInitializationMode", 3)


def test_signal_that_ends_another_process_is_named() -> None:
    with pytest.raises(EndedError) as caught:
        in_fresh_process(_end)
    assert caught.value.how == "SIGKILL"


def _end() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


class _Model:
    """x' = slope from x = 0 on; the slope changes its sign at time events, and at x = top."""

    def __init__(self, events: list[float], top: float = 1e9, refuses: int = 0) -> None:
        self.time, self.x, self.slope = 0.0, 0.0, 1.0
        self.events, self.top, self.refuses = list(events), top, refuses
        self.turned = False

    def newDiscreteStates(self) -> tuple[bool, bool, bool, bool, bool, float]:
        if self.events and self.time >= self.events[0] - 1e-12:
            self.events.pop(0)
            self.slope = -self.slope
        if self.x >= self.top and not self.turned:
            self.turned, self.slope = True, -1.0
        return False, False, False, False, bool(self.events), self.events[0] if self.events else 0.0

    def enterEventMode(self) -> None: ...

    def enterContinuousTimeMode(self) -> None: ...

    def completedIntegratorStep(self, **_: Any) -> tuple[bool, bool]:
        return False, False

    def setTime(self, time: float) -> None:
        self.time = time

    def getContinuousStates(self, x: Any, count: int) -> None:
        x[0] = self.x

    def setContinuousStates(self, x: Any, count: int) -> None:
        self.x = x[0]

    def getDerivatives(self, dx: Any, count: int) -> None:
        if self.refuses:
            raise FMICallException("fmi2GetDerivatives", self.refuses)
        dx[0] = self.slope

    def getEventIndicators(self, z: Any, count: int) -> None:
        z[0] = self.top - self.x if not self.turned else 1.0

    def getNominalsOfContinuousStates(self, x: Any, count: int) -> None:
        x[0] = 0.0


def _integration(model: _Model) -> Integration:
    description = SimpleNamespace(numberOfContinuousStates=1, numberOfEventIndicators=1)
    means = SimpleNamespace(completedIntegratorStepNotNeeded=False)
    subject: Any = SimpleNamespace(version=2, description=description, find_kind_element=lambda kind: means)
    integration = Integration(model, subject)
    integration.begin()
    return integration


def test_time_events_happen_when_they_are_due() -> None:
    """Two within one step: up for 0.35, down for 0.25, up again."""
    model = _Model([0.35, 0.6])
    integration = _integration(model)
    integration.step(0.0, 0.5)
    integration.step(0.5, 0.5)
    assert model.x == pytest.approx(0.35 - 0.25 + 0.4, abs=1e-9)


def test_state_events_happen_where_they_are() -> None:
    """Up to the top, and down again."""
    model = _Model([], top=0.7)
    _integration(model).step(0.0, 1.0)
    assert model.x == pytest.approx(0.7 - 0.3, abs=1e-6)


def test_refused_call_is_reported_as_such() -> None:
    """Not as what the solver makes of it."""
    with pytest.raises(FMICallException) as caught:
        _integration(_Model([], refuses=3)).step(0.0, 1.0)
    assert caught.value.function == "fmi2GetDerivatives"


def test_endless_events_raise() -> None:
    """Where each event asks for one at the same time again."""
    model = _Model([])
    model.newDiscreteStates = lambda: (False, False, False, False, True, 0.0)  # type: ignore[method-assign]
    with pytest.raises(RuntimeError, match="more than 1000 events"):
        _integration(model).step(0.0, 1.0)


def test_run_can_be_cut() -> None:
    run = OutputTrajectory(np.arange(3.0), ["y"], np.arange(3.0)[:, None])
    assert run.until(2).values.tolist() == [[0.0], [1.0]]


@pytest.mark.slow
def test_checks_run_in_processes_that_share_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, where processes cannot divide."""
    monkeypatch.setattr(child, "_CONTEXT", multiprocessing.get_context("spawn"))
    settings = Settings(only=("run.finite", "run.ranges", "calls.phases"))
    found = examine_fmu(Subject(build_good_fmu(tmp_path), tmp_path / "fmu", settings))
    assert {f.check: f.verdict for f in found.findings} == dict.fromkeys(settings.only, Verdict.PASSED)


def _run(values: list[list[float]]) -> OutputTrajectory:
    rows = np.array(values)
    return OutputTrajectory(np.arange(len(rows), dtype=float), ["y", "z"], rows)


def test_runs_that_differ_by_rounding_only_warn() -> None:
    """The last bit is worth a warning; more than the tolerance fails; NaN is like NaN alone."""
    wanted = _run([[0.0, 1.0], [1.0, 1.0]])
    assert compare_runs(wanted, wanted, "It").verdict == Verdict.PASSED
    rounded = compare_runs(_run([[0.0, 1.0], [1.0 + 2e-16, 1.0]]), wanted, "It")
    assert rounded.verdict == Verdict.WARNING
    assert "from y at t = 1 s on" in rounded.sentence
    assert compare_runs(_run([[0.0, 1.0], [1.001, 1.0]]), wanted, "It").verdict == Verdict.FAILED
    shorter = compare_runs(_run([[0.0, 1.0]]), wanted, "It")
    assert (shorter.verdict, shorter.sentence) == (Verdict.FAILED, "It ended at t = 0 s, not at t = 1 s.")
    negative = compare_runs(_run([[-0.0, 1.0], [1.0, 1.0]]), wanted, "It")
    assert (negative.verdict, negative.sentence) == (Verdict.PASSED, "It gave the same 2 x 2 values.")
    spoiled = _run([[0.0, 1.0], [np.nan, 1.0]])
    assert compare_runs(spoiled, wanted, "It").verdict == Verdict.FAILED
    assert compare_runs(spoiled, spoiled, "It").verdict == Verdict.PASSED


def test_difference_is_relative_to_the_range_of_an_output() -> None:
    """A difference of 0.001 is much where an output moves by 0.01, and little where it moves by 100."""
    one, other = _run([[0.0, 0.0], [0.01, 100.0]]), _run([[0.001, 0.001], [0.01, 100.0]])
    np.testing.assert_allclose(one.distance(other), [0.1, 1e-5])


@pytest.mark.slow
def test_fmu_of_one_instance_per_process_gets_no_second_one(tmp_path: Path) -> None:
    """Its second instance in a process fails, which `canBeInstantiatedOnlyOncePerProcess` allows."""
    names = ("instance.independent", "instance.reset", "values.shared", "values.reset", "state.serialized")
    assert list_problems(examine(build_good_fmu(tmp_path, "ONLY_ONCE"), *names)) == {}
