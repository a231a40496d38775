"""FMUs that leave an exception of Python set in the interpreter of this process."""

import sys
from pathlib import Path
from typing import Any

import fmpy
import pytest

from emla_cosim.base.errors import RunError
from emla_cosim.fmu.python_exceptions import REMEDY
from emla_cosim.run.result import Result
from emla_cosim.study.loading import load
from emla_cosim.system.model import Component, System
from fmu_verify.check import LEAVES_EXCEPTION, Verdict
from tests.support.broken.examining import examine
from tests.support.faulty_systems import faulty, wired
from tests.support.hand_written_fmus import FMI_3, build_faulty_fmu
from tests.support.python_errors import LEFT, build_python_errors_fmu

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the FMU finds Python with dlsym")

STEP = 0.0625


@pytest.fixture(scope="module", params=[2, 3])
def version(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(scope="module")
def fmu(version: int, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_python_errors_fmu(tmp_path_factory.mktemp("errors") / "Errors.fmu", version)


def _failure(source: Path | System, **options: Any) -> RunError:
    with load(source, **options).prepare() as simulation, pytest.raises(RunError) as caught:
        simulation.run()
    return caught.value


def _run_fmu(
    fmu: Path, function: str, at: float = 0.5, status: int = 0, message: str = "", **options: Any
) -> RunError:
    values = {"function": function, "at": at, "status": status, "message": message}
    return _failure(fmu, set={f"Errors.{name}": value for name, value in values.items()}, **options)


def _times(error: RunError) -> list[float]:
    """The times of the rows that an ended run has."""
    result = error.fields["result"]
    assert isinstance(result, Result)
    assert result["Errors.y"] == pytest.approx(result.time)
    return result.time.tolist()


def test_call_time_and_exception_are_reported_if_the_fmu_is_isolated(fmu: Path) -> None:
    error = _run_fmu(fmu, "DoStep", isolate=True)
    assert f"Errors left a Python exception in doStep at t = 0.5 s: {LEFT}. {REMEDY}" in str(error)
    assert error.exit_code == 1
    assert _times(error) == [k * STEP for k in range(9)]


@pytest.mark.parametrize("algorithm", ["jacobi", "strong"])
def test_the_loop_reports_the_fmu_and_a_range_of_time(fmu: Path, algorithm: str) -> None:
    error = _run_fmu(fmu, "DoStep", algorithm=algorithm)
    _, _, begin, end = (part.split(" s")[0] for part in str(error).split("t = "))
    assert _times(error)[-1] == float(begin) <= 0.5 < float(end)
    assert f"Errors left a Python exception in a call between t = {begin} s and t = {end} s" in str(error)
    assert f": {LEFT}. To find the call, run with `--isolate`. {REMEDY}" in str(error)


def test_error_control_reports_the_exception(fmu: Path) -> None:
    error = _run_fmu(fmu, "DoStep", error_tolerance=1e-3)
    assert "Errors left a Python exception in a call between t = " in str(error)
    assert f": {LEFT}. " in str(error)


def test_failed_call_is_reported_with_its_status(version: int, fmu: Path) -> None:
    error = _run_fmu(fmu, "DoStep", status=3)
    expected = (
        f"Errors answered doStep at t = 0.5 s with fmi{version}Error. A Python exception was left: {LEFT}."
    )
    assert f"{expected} {REMEDY}" in str(error)


def test_message_of_the_fmu_about_an_earlier_exception_gets_a_hint(fmu: Path) -> None:
    message = "SystemError('f returned a result with an exception set')"
    error = _run_fmu(fmu, "DoStep", status=3, message=message)
    assert message in str(error)
    assert str(error).endswith(
        "An earlier call left an exception of Python; to find it, run with `--isolate`."
    )
    assert "An earlier call" not in str(_run_fmu(fmu, "DoStep", status=3, message="Other"))


@pytest.mark.parametrize("function", ["EnterInitializationMode", "ExitInitializationMode", "Get"])
def test_exception_before_the_first_step_is_reported(version: int, fmu: Path, function: str) -> None:
    if function == "Get":
        function += "Real" if version == 2 else "Float64"
    error = _run_fmu(fmu, function, at=0.0)
    call = function[0].lower() + function[1:]
    assert f"Errors left a Python exception in {call} at t = 0 s: {LEFT}. {REMEDY}" in str(error)


@pytest.mark.parametrize(("when", "call"), [("LOADS", "loading its library"), ("CREATES", "instantiate")])
def test_exception_at_the_start_of_an_fmu_is_reported(
    version: int, when: str, call: str, tmp_path: Path
) -> None:
    fmu = build_python_errors_fmu(tmp_path / "Errors.fmu", version, when=when)
    scenario = load(fmu)
    with pytest.raises(RunError, match=f"Errors left a Python exception in {call}.*: {LEFT}") as caught:
        scenario.prepare()
    assert caught.value.exit_code == 1


def test_model_exchange_reports_call_and_time(version: int, tmp_path: Path) -> None:
    fmu = build_python_errors_fmu(tmp_path / "Errors.fmu", version, exchange=True)
    function = "GetDerivatives" if version == 2 else "GetContinuousStateDerivatives"
    error = _run_fmu(fmu, function)
    call = function[0].lower() + function[1:]
    assert f"Errors left a Python exception in {call} at t = 0.5 s: {LEFT}. {REMEDY}" in str(error)
    assert _times(error)[-1] == 0.5 - STEP


@pytest.mark.parametrize("threads", [1, 2])
def test_only_fmus_that_use_python_are_named(fmu: Path, tmp_path: Path, threads: int) -> None:
    harmless = build_faulty_fmu(tmp_path, name="Harmless")
    values: dict[str, Any] = {"function": "DoStep", "at": 0.5}
    system = wired(
        [
            faulty("j.first", harmless),
            Component("j.good", "Errors", {}, fmu),
            Component("j.bad", "Errors", values, fmu),
        ]
    )
    error = _failure(system, threads=threads, step_size=1e-4, stop_time=1.0)
    assert "j.good or j.bad left a Python exception in a call between t = " in str(error)
    assert f": {LEFT}. To find the call, run with `--isolate`." in str(error)


def test_run_after_an_exception_works(fmu: Path) -> None:
    with load(fmu, set={"Errors.function": "DoStep"}).prepare() as simulation:
        for _ in range(2):
            with pytest.raises(RunError, match=LEFT):
                simulation.run()
        result = simulation.run(set={"Errors.function": ""})
    assert result["Errors.y"] == pytest.approx(result.time)


@pytest.mark.parametrize(
    ("function", "check", "call"),
    [
        ("DoStep", "run.completes", "fmi{0}DoStep at t = 0.5 s"),
        ("ExitInitializationMode", "run.completes", "fmi{0}ExitInitializationMode"),
        ("CREATES", "instance.created", "fmi{0}Instantiate{1}"),
        ("LOADS", "binaries.loads", "loading {2}/Errors{3}"),
    ],
)
def test_verify_reports_the_exception_as_a_finding(
    version: int, function: str, check: str, call: str, tmp_path: Path
) -> None:
    when = function if function in ("LOADS", "CREATES") else ""
    fmu = build_python_errors_fmu(tmp_path / "Errors.fmu", version, when=when, function=function, at=0.5)
    if function == "ExitInitializationMode":
        fmu = build_python_errors_fmu(fmu, version, function=function)
    examined = examine(fmu, check, apart=[check])
    (finding,) = (f for f in examined.findings if f.verdict == Verdict.FAILED)
    assert finding.check == check
    platform = fmpy.platform if version == 2 else FMI_3
    begin = call.format(
        version, "CoSimulation" if version == 3 else "", platform, fmpy.sharedLibraryExtension
    )
    assert finding.sentence.startswith(begin)
    assert finding.sentence.endswith(f" left an exception of Python: {LEFT}.")
    assert finding.clause == LEAVES_EXCEPTION
    assert finding.hint == REMEDY
