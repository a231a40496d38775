"""What the checks say of an FMU that runs wrong, and what is the same run."""

from pathlib import Path

import numpy as np
import pytest

from emla_cosim.verification.checks._sameness import compare_runs
from emla_cosim.verification.host.instance_runs import OutputTrajectory
from emla_cosim.verification.runner import verify
from emla_cosim.verification.verdict import Verdict
from tests.support.broken.dynamic import Fault, build_good_fmu


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Fault.SEGFAULT, ["fmi2DoStep at t = 0.5 s", "SIGSEGV"]),
        (Fault.EXIT, ["fmi2DoStep at t = 0.5 s", "exit code 0"]),
        (Fault.TERMINATE_CRASH, ["fmi2Terminate", "SIGSEGV"]),
        (Fault.PENDING, ["fmi2DoStep at t = 0.5 s", "fmi2Pending"]),
        (Fault.ASKS_TO_END, ["50 of 100 steps"]),
    ],
)
def test_a_sentence_says_where_it_went_wrong(tmp_path: Path, fault: Fault, words: list[str]) -> None:
    """The call, the time, and how it ended."""
    found = verify(build_good_fmu(tmp_path, fault), only="run.completes").examined[0]
    assert all(word in found["run.completes"].sentence for word in words), found["run.completes"].sentence


def _run(values: list[list[float]]) -> OutputTrajectory:
    rows = np.array(values)
    return OutputTrajectory(np.arange(len(rows), dtype=float), ["y", "z"], rows)


def test_runs_that_differ_by_rounding_are_no_failure() -> None:
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


def test_an_output_is_measured_by_its_range() -> None:
    """A difference of 0.001 is much where an output moves by 0.01, and little where it moves by 100."""
    one, other = _run([[0.0, 0.0], [0.01, 100.0]]), _run([[0.001, 0.001], [0.01, 100.0]])
    np.testing.assert_allclose(one.distance(other), [0.1, 1e-5])


def test_an_fmu_of_one_instance_gets_no_second_one(tmp_path: Path) -> None:
    """Its second instance in a process fails, which `canBeInstantiatedOnlyOncePerProcess` allows."""
    found = verify(
        build_good_fmu(tmp_path, Fault.ONLY_ONCE), only=["instance", "process", "values", "state"]
    ).examined[0]
    wrong = [f for f in found.findings if f.verdict in (Verdict.FAILED, Verdict.WARNING)]
    assert {f.check: f.sentence for f in wrong} == {}
