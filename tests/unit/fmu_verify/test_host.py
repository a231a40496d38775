"""The host of examined FMUs: runs beside exact solutions, and processes that end."""

import ctypes
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.model_description import ModelVariable, SimpleType
from scipy.linalg import expm

from emla_cosim.base.crash_page import read_note
from emla_cosim.fmu.elements import ElementVariable
from fmu_verify.check import Verdict
from fmu_verify.checks._sameness import compare_runs
from fmu_verify.examination import examine_fmu
from fmu_verify.host.experiment import (
    Experiment,
    OutputTrajectory,
    make_experiment,
    read_span,
    run_alone,
    step_instance,
)
from fmu_verify.host.hosted_instance import CallError, HostedInstance
from fmu_verify.host.other_values import choose_other
from fmu_verify.host.process_state import BYTE, fill_memory
from fmu_verify.settings import Settings
from fmu_verify.subject import Subject
from fmu_verify.subprocess_run import in_fresh_process
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.editing import setting
from tests.support.broken.examining import examine, list_problems, unpacked
from tests.support.hand_written_fmus import build_event_fmu, build_integrated_fmu, build_trigger_fmu


def _subject(folder: Path, fault: str = "") -> Subject:
    return unpacked(build_good_fmu(folder, fault))


@pytest.mark.parametrize(
    ("data_type", "start", "expected"),
    [
        ("UInt8", 255, 254),
        ("UInt64", 2**64 - 1, 2**64 - 2),
        ("Int8", -128, -127),
        ("", 2**31 - 1, 2**31 - 2),
        ("Float32", 2, pytest.approx(2.2)),
    ],
)
def test_other_values_fit_into_the_type(data_type: str, start: int, expected: object) -> None:
    """The variable without a data type is an Integer of FMI 2.0."""
    kind = {"type": "Real" if data_type == "Float32" else "Integer", "start": str(start)}
    more = {"data_type": data_type} if data_type else {}
    make: Any = ElementVariable if data_type else ModelVariable
    assert choose_other(make("n", 1, **kind, **more)) == expected


def test_inputs_vary_within_the_limits_of_their_declared_type() -> None:
    declared = SimpleType("Angle", "Real", min="-1", max="1")
    subject: Any = SimpleNamespace(
        version=2,
        of_causality=lambda _: [ModelVariable("u", 1, type="Real", start="0.99", declaredType=declared)],
        description=SimpleNamespace(defaultExperiment=None),
        most_steps=100,
    )
    values = make_experiment(subject).inputs["u"]
    assert -1.0 <= min(values) < max(values) == 1.0


def _levels(subject: Subject) -> list[float]:
    """The number of ticks of an output clock, which belongs to it, after each step of 0.05 s."""
    instance = HostedInstance(subject)
    instance.initialize({"period": 0.1}, 0.0)
    levels = []
    for k in range(10):
        instance.step(0.05 * k, 0.05)
        levels.append(instance.get(["level"])[0])
    instance.close()
    return levels


@pytest.mark.parametrize(
    ("internal", "step"), [("0.04", 0.04), ("0.005", 0.01), ("0.0003", 0.0099), ("5", 0.01)]
)
def test_steps_are_whole_steps_of_the_solver(internal: str, step: float, tmp_path: Path) -> None:
    """The default experiment has the step size 0.01 s."""
    build = setting("CoSimulation", fmi=3, fixedInternalStepSize=internal)
    assert read_span(unpacked(build(tmp_path)))[1] == pytest.approx(step, rel=1e-12)


def test_variables_of_output_clocks_are_read_when_they_tick(tmp_path: Path) -> None:
    subject = unpacked(build_trigger_fmu(tmp_path / "Triggers.fmu"))
    assert in_fresh_process(_levels, subject) == [0, 1, 1, 2, 2, 3, 3, 4, 4, 5]


def _run_with_fault(
    subject: Subject, fault: int, has_mode: bool, allows_early_return: bool
) -> tuple[str, str, str]:
    """The message, its clause, and the call that was noted last."""
    instance = HostedInstance(subject, events=has_mode, allows_early_return=allows_early_return)
    with pytest.raises(CallError) as caught:
        instance.initialize({"period": 0.3, "threshold": 0.35, "end": 0.72, "fault": fault})
        for k in range(8):
            instance.step(0.125 * k, 0.125)
    return str(caught.value), caught.value.clause.section if caught.value.clause else "", read_note()


@pytest.mark.parametrize(
    ("fault", "allows_early_return", "words", "section", "call"),
    [
        (1, True, "fmi3UpdateDiscreteStates at t = 0 s answered a request for more", "", "fmi3Update"),
        (2, True, "fmi3DoStep at t = 0 s answered a request for more, 1001 times", "", "fmi3DoStep"),
        (4, False, "fmi3DoStep from t = 0 s to 0.125 s returned early at t = ", "4.2.1", "fmi3DoStep"),
        (5, True, "fmi3UpdateDiscreteStates at t = 0 s answered nextEventTime = NaN", "2.3.5", "fmi3Update"),
        (6, True, "fmi3DoStep at t = 0.625 s answered ", "", "fmi3DoStep at t = 0.625 s"),
    ],
)
def test_faults_of_events_have_their_clause(
    fault: int, allows_early_return: bool, words: str, section: str, call: str, tmp_path: Path
) -> None:
    """The stepper finds them; the call in which it does is noted."""
    subject = unpacked(build_event_fmu(tmp_path / "Events.fmu"))
    message, clause, noted = in_fresh_process(_run_with_fault, subject, fault, True, allows_early_return)
    assert words in message
    assert (clause, noted[: len(call)]) == (section, call)


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
    actual = run_alone(subject, course, kind)
    assert actual.names[:2] == ["position", "speed"]
    np.testing.assert_allclose(actual.values[:, :2], _exact(course), atol=2e-7)


def test_error_comes_back_from_another_process(tmp_path: Path) -> None:
    with pytest.raises(CallError, match="fmi2ExitInitializationMode answered fmi2Error") as caught:
        run_alone(_subject(tmp_path, "INITIALIZATION_ERROR"))
    assert (caught.value.call, caught.value.status) == ("fmi2ExitInitializationMode", 3)


def _integrate(subject: Subject) -> np.ndarray:
    """Rows of time, x, h, stair and resets of the FMU for Model Exchange with events, with u = 1.2."""
    course = Experiment(0.0095 * np.arange(100.0), {"u": np.full(100, 1.2)})
    instance = HostedInstance(subject)
    instance.initialize({"limit": 1.1, **course.at(0)}, 0.0)
    run = step_instance(instance, course, names=["x", "h", "stair", "resets"])
    return np.column_stack([run.times, run.values])


@pytest.mark.parametrize("version", [2, 3])
def test_events_of_model_exchange_happen_where_they_are(version: int, tmp_path: Path) -> None:
    """Steps of the stair, the bounce of the ball, and the reset of x above its limit."""
    subject = unpacked(build_integrated_fmu(tmp_path / "Integrated.fmu", version=version))
    time, x, h, stair, resets = in_fresh_process(_integrate, subject).T
    np.testing.assert_array_equal(stair, np.floor(time / 0.1))
    bounce = np.sqrt(2.0 / 9.81)
    later = time - bounce
    flight = 0.7 * 9.81 * bounce * later - 0.5 * 9.81 * later**2
    np.testing.assert_allclose(h, np.where(later > 0.0, flight, 1.0 - 0.5 * 9.81 * time**2), atol=1e-6)
    limited = time >= np.log(2.0)  # x = 1.2 - 0.2 exp(-t) reaches 1.1
    np.testing.assert_allclose(x[~limited], 1.2 - 0.2 * np.exp(-time[~limited]), atol=1e-6)
    np.testing.assert_array_equal(resets, limited)


def _refuse(*_: Any) -> None:
    raise FMICallException("fmi2GetDerivatives", 3)


def _ask_for_an_event_now() -> tuple[bool, bool, bool, bool, bool, float]:
    return False, False, False, False, True, 0.0


@pytest.mark.parametrize(
    ("function", "replacement", "message"),
    [
        ("fmi2GetDerivatives", _refuse, "fmi2GetDerivatives answered fmi2Error"),
        ("newDiscreteStates", _ask_for_an_event_now, "more than 1000 events"),
    ],
)
def test_failed_integration_has_its_cause(
    function: str, replacement: Callable[..., Any], message: str, tmp_path: Path
) -> None:
    instance = HostedInstance(_subject(tmp_path), kind="ModelExchange")
    instance.initialize()
    setattr(instance.fmu, function, replacement)
    with pytest.raises(CallError, match=message):
        instance.step(0.0, 1.0)
    instance.free()


@pytest.mark.slow
def test_checks_run_in_processes_that_share_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, where processes cannot divide."""
    monkeypatch.delattr(os, "fork", raising=False)
    settings = Settings(only=("run.finite", "run.ranges", "calls.phases"))
    report = examine_fmu(Subject(build_good_fmu(tmp_path), tmp_path / "fmu", settings))
    assert {f.check: f.verdict for f in report.findings} == dict.fromkeys(settings.only, Verdict.PASSED)


def _run(values: list[list[float]]) -> OutputTrajectory:
    rows = np.array(values)
    return OutputTrajectory(np.arange(len(rows), dtype=float), ["y", "z"], rows)


def test_verdict_on_two_runs_depends_on_their_difference() -> None:
    """The last bit is worth a warning; more than the tolerance fails; NaN is like NaN alone."""
    expected, spoiled = _run([[0.0, 1.0], [1.0, 1.0]]), _run([[0.0, 1.0], [np.nan, 1.0]])
    for actual, other, verdict, words in (
        (expected, expected, Verdict.PASSED, "to the last bit."),
        (_run([[0.0, 1.0], [1.0 + 2e-16, 1.0]]), expected, Verdict.WARNING, "from y at t = 1 s on"),
        (_run([[0.0, 1.0], [1.001, 1.0]]), expected, Verdict.FAILED, "from y at t = 1 s on"),
        (_run([[0.0, 1.0]]), expected, Verdict.FAILED, "It ended at t = 0 s, not at t = 1 s."),
        (_run([[-0.0, 1.0], [1.0, 1.0]]), expected, Verdict.PASSED, "It gave the same 2 x 2 values."),
        (spoiled, expected, Verdict.FAILED, "from y at t = 1 s on"),
        (spoiled, spoiled, Verdict.PASSED, ""),
    ):
        outcome = compare_runs(actual, other, "It")
        assert outcome.verdict == verdict and words in outcome.sentence


def test_difference_is_relative_to_the_range_of_an_output() -> None:
    """A difference of 0.001 is much where an output moves by 0.01, and little where it moves by 100."""
    first, second = _run([[0.0, 0.0], [0.01, 100.0]]), _run([[0.001, 0.001], [0.01, 100.0]])
    np.testing.assert_allclose(first.distance(second), [0.1, 1e-5])


@pytest.mark.slow
def test_fmu_of_one_instance_per_process_gets_no_second_one(tmp_path: Path) -> None:
    """Its second instance in a process fails, which `canBeInstantiatedOnlyOncePerProcess` allows."""
    names = ("instance.independent", "instance.reset", "values.shared", "values.reset", "state.serialized")
    assert list_problems(examine(build_good_fmu(tmp_path, "ONLY_ONCE"), *names)) == {}


def _read_fresh_memory() -> list[int]:
    """Return how many fresh blocks have junk: of 16 of two sizes that are reused, and of a new one."""
    library: Any = ctypes.CDLL(None)
    library.malloc.restype = ctypes.c_void_p
    sizes, expected = [304] * 16 + [1008] * 16 + [40 * 2**20], bytes([BYTE] * 200)
    with fill_memory():
        blocks = [library.malloc(ctypes.c_size_t(size)) for size in sizes]
    filled = [ctypes.string_at(block + 32, 200) == expected for block in blocks]
    return [sum(filled[:16]), sum(filled[16:32]), sum(filled[32:])]


@pytest.mark.skipif(sys.platform != "linux", reason="Only this C library fills memory.")
def test_fresh_memory_has_junk() -> None:
    """An FMU that reads memory before it is written gives something else in a second run."""
    small, medium, large = in_fresh_process(_read_fresh_memory)
    assert small and medium  # Python frees blocks of its own meanwhile: 3 to 9 of 16 were left
    assert large == 1
