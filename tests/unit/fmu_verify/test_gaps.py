"""What checks leave out is reported under *Not examined*, and no call follows a fatal error."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

import fmublock
from emla_cosim.fmu.instance import FATAL
from fmu_verify import check_runner
from fmu_verify.check import RETURNS, CheckOutcome, Clause, Verdict, check
from fmu_verify.checks import behavior, calls, logs, typed_values, values
from fmu_verify.host.hosted_instance import CallError, HostedInstance
from fmu_verify.subject import Subject
from fmu_verify.subprocess_run import in_fresh_process
from fmublock import Block, State
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.examining import unpacked
from tests.support.broken.wide import build_wide_fmu

Monkey = pytest.MonkeyPatch


@pytest.mark.parametrize(
    ("name", "value", "gap"),
    [
        ("_TIME_FRACTION", 0.4, ""),
        ("_TIME_FRACTION", 0.0, "Values were read for 0 of 50 steps: more take longer than 0 s."),
        ("MOST", 2, "Only 2 of 6 variables of type {} were read."),
    ],
    ids=["all", "slow run", "many variables"],
)
@pytest.mark.parametrize("kind", ["String", "Boolean"])
def test_values_that_are_not_read(
    kind: str, name: str, value: float, gap: str, tmp_path: Path, monkeypatch: Monkey
) -> None:
    monkeypatch.setattr(typed_values, name, value)
    check_ = typed_values.strings if kind == "String" else typed_values.booleans
    outcome = check_.examine(unpacked(build_wide_fmu(tmp_path)))
    assert outcome.verdict == Verdict.PASSED
    assert outcome.gaps == ((gap.format(kind),) if gap else ())


def test_values_that_the_fmu_rejects_are_left_out(tmp_path: Path, monkeypatch: Monkey) -> None:
    """Here all but the first two."""

    def accept_two(do: Any, subject: Subject, changes: Mapping[str, Any]) -> list[Any]:
        return [in_fresh_process(do, subject, dict(list(changes.items())[:2]))]

    monkeypatch.setattr(values, "run_where_accepted", accept_two)
    monkeypatch.setattr(values, "run_where_accepted", accept_two)
    subject = unpacked(build_wide_fmu(tmp_path))
    for check_ in (values.kept, values.reset, values.shared):
        outcome = check_.examine(subject)
        assert outcome.verdict == Verdict.PASSED
        assert outcome.gaps == ("Only 2 of 15 parameters and inputs were judged with other values.",)


def test_inputs_and_categories_beyond_the_most_are_left_out(tmp_path: Path, monkeypatch: Monkey) -> None:
    monkeypatch.setattr(behavior, "_MOST_INPUTS", 1)
    monkeypatch.setattr(logs, "_MOST_CATEGORIES", 1)
    subject = unpacked(build_good_fmu(tmp_path))
    assert behavior.inputs.examine(subject).gaps == ("Only 1 of 2 inputs were moved alone.",)
    assert behavior.integrate.examine(subject).gaps == ("Only 1 of 2 inputs were moved.",)
    assert logs.categories.examine(subject).gaps == ("Only 1 of 3 categories were enabled alone.",)


class _Fatal(HostedInstance):
    """Answers NaN with fmi2Fatal. No function may be called then."""

    def set(self, values: Mapping[str, Any]) -> None:
        if any(math.isnan(value) for value in values.values()):
            raise CallError("fmi2SetReal", FATAL)
        super().set(values)

    def free(self) -> None:
        raise AssertionError("fmi2FreeInstance was called after fmi2Fatal")


def test_nothing_is_called_after_a_fatal_error(tmp_path: Path, monkeypatch: Monkey) -> None:
    monkeypatch.setattr(calls, "HostedInstance", _Fatal)
    outcome = calls.nonfinite.examine(unpacked(build_good_fmu(tmp_path)))
    assert outcome.verdict == Verdict.PASSED
    assert outcome.gaps == ("Only 0 of 3 inputs and parameters were set to NaN.",)


@pytest.mark.parametrize(("status", "clause"), [(-1, RETURNS), (1151195056, RETURNS), (3, None)])
def test_invalid_status_violates_the_section_on_statuses(
    monkeypatch: Monkey, status: int, clause: Clause | None
) -> None:
    """Another clause that the check names has nothing to do with it."""

    @check("x.y", "X", Clause("2.1.5", "x"), "")
    def answers(_: Any) -> CheckOutcome:
        raise CallError("fmi2SetDebugLogging", status)

    monkeypatch.setattr(check_runner, "use_scratch", lambda _: None)
    outcome = check_runner.do_check(None, answers)
    assert (outcome.verdict, outcome.clause) == (Verdict.FAILED, clause)


def _numbers(changes: Mapping[str, Any]) -> list[float]:
    return [float(changes.get(name, 0.0)) for name in ("u", "w")]


@pytest.mark.parametrize(
    ("output", "verdict"),
    [
        (lambda u, w: u - w, Verdict.PASSED),
        (lambda u, w: u != 0.0 and w == 0.0, Verdict.PASSED),
        (lambda u, w: 3.0, Verdict.WARNING),
    ],
    ids=["difference", "one alone", "none"],
)
def test_inputs_that_cancel_out_have_an_effect(
    tmp_path: Path, monkeypatch: Monkey, output: Callable[[float, float], float], verdict: Verdict
) -> None:
    """If all are moved at once, nothing need change."""
    monkeypatch.setattr(behavior, "_record_run", lambda _, changes, *__: [[str(output(*_numbers(changes)))]])
    assert behavior.inputs.examine(unpacked(build_good_fmu(tmp_path))).verdict == verdict


def test_slope_below_rounding_is_not_a_fault(tmp_path: Path) -> None:
    """A state that rests but for a derivative of 1e-19 keeps its value, as it must."""

    class Hanging(Block):
        angle = State(-1.2, unit="rad")

        def derivatives(self, v: Any) -> dict[str, Any]:
            return {"angle": 1e-19 * v.angle}

    path = tmp_path / "Hanging.fmu"
    fmublock.build(Hanging, path)
    assert behavior.integrate.examine(unpacked(path)).verdict == Verdict.PASSED
