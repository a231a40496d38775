"""A good FMU passes every check; with one fault it fails the check for it, and no other."""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from emla_cosim.verify.checks._sameness import compared
from emla_cosim.verify.host.drive import Trajectory
from emla_cosim.verify.report import Examined
from emla_cosim.verify.settings import Settings
from emla_cosim.verify.verdict import Verdict
from emla_cosim.verify.verifying import verify
from tests.support.broken.broken import Broken
from tests.support.broken.dynamic import DYNAMIC, Fault, build_good_fmu

_DYNAMIC_GROUPS = (
    "instance",
    "run",
    "calls",
    "state",
    "derivatives",
    "dependencies",
    "exchange",
    "steps",
    "model_exchange",
    "log",
)


@pytest.fixture(scope="module")
def examined(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[str, Future[Examined]]]:
    """What is found about each broken FMU that a test asks for, by its name: two at a time."""
    folder = tmp_path_factory.mktemp("broken")
    wanted = [found for item in request.session.items if (found := _broken(item)) is not None]
    with ThreadPoolExecutor(2) as pool:
        yield {broken.name: pool.submit(_examine, broken, folder) for broken in wanted}


def _broken(item: pytest.Item) -> Broken | None:
    """What a test is asked to look at; None for tests of anything else."""
    found = getattr(item, "callspec", None)
    broken = found.params.get("broken") if found is not None else None
    return broken if isinstance(broken, Broken) else None


def _examine(broken: Broken, folder: Path) -> Examined:
    settings = Settings(
        only=(*_DYNAMIC_GROUPS,), seconds=broken.settings.seconds, memory=broken.settings.memory
    )
    return verify(broken.build(folder), settings).examined[0]


@pytest.mark.parametrize("broken", DYNAMIC, ids=lambda broken: broken.name)
def test_one_fault_is_told_by_one_check(broken: Broken, examined: dict[str, Future[Examined]]) -> None:
    """What is wrong is said once; what needs it is skipped, and everything else passes."""
    found = examined[broken.name].result()
    told = {f.check: (f.verdict, f.sentence) for f in found.findings if f.verdict in _WORSE}
    assert set(told) == {broken.check}, told
    verdict, sentence = told[broken.check]
    assert verdict == broken.verdict
    assert sentence.endswith(".")
    assert "itself went wrong" not in sentence


_WORSE = (Verdict.FAILED, Verdict.WARNING)


def test_there_are_many_ways_to_be_wrong() -> None:
    """Each fault is tried, under a name of its own, and each kind of check is asked for."""
    names = [broken.name for broken in DYNAMIC]
    assert len(set(names)) == len(names) == len(set(Fault) - {Fault.ONLY_ONCE})
    assert {b.check.partition(".")[0] for b in DYNAMIC} == set(_DYNAMIC_GROUPS)


def test_a_good_fmu_passes_everything(tmp_path: Path) -> None:
    """Nothing fails, nothing is warned of, nothing is skipped: it has everything that is checked."""
    found = verify(build_good_fmu(tmp_path), Settings(only=_DYNAMIC_GROUPS)).examined[0]
    others = {f.check: f.sentence for f in found.findings if f.verdict != Verdict.PASSED}
    assert not others
    assert len(found.findings) >= 22


def test_an_fmu_that_can_be_made_once_is_made_once(tmp_path: Path) -> None:
    """Each instance gets a process; what needs two in one is skipped."""
    path = build_good_fmu(tmp_path, Fault.ONLY_ONCE)
    found = verify(path, Settings(only=_DYNAMIC_GROUPS)).examined[0]
    assert not [f.sentence for f in found.findings if f.verdict in _WORSE]
    skipped = [f.check for f in found.of(Verdict.SKIPPED)]
    assert skipped == ["instance.cycles", "instance.independent", "instance.threads"]


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
    found = verify(build_good_fmu(tmp_path, fault), Settings(only=("run.completes",))).examined[0]
    assert all(word in found["run.completes"].sentence for word in words), found["run.completes"].sentence


def _run(values: list[list[float]]) -> Trajectory:
    rows = np.array(values)
    return Trajectory(np.arange(len(rows), dtype=float), ["y", "z"], rows)


def test_runs_that_differ_by_rounding_are_no_failure() -> None:
    """The last bit is worth a warning; more than the tolerance fails; NaN is like NaN alone."""
    wanted = _run([[0.0, 1.0], [1.0, 1.0]])
    assert compared(wanted, wanted, "It").verdict == Verdict.PASSED
    rounded = compared(_run([[0.0, 1.0], [1.0 + 2e-16, 1.0]]), wanted, "It")
    assert rounded.verdict == Verdict.WARNING
    assert "from y at t = 1 s on" in rounded.sentence
    assert compared(_run([[0.0, 1.0], [1.001, 1.0]]), wanted, "It").verdict == Verdict.FAILED
    assert compared(_run([[0.0, 1.0]]), wanted, "It").verdict == Verdict.FAILED
    spoiled = _run([[0.0, 1.0], [np.nan, 1.0]])
    assert compared(spoiled, wanted, "It").verdict == Verdict.FAILED
    assert compared(spoiled, spoiled, "It").verdict == Verdict.PASSED


def test_an_output_is_measured_by_its_range() -> None:
    """A difference of 0.001 is much where an output moves by 0.01, and little where it moves by 100."""
    one, other = _run([[0.0, 0.0], [0.01, 100.0]]), _run([[0.001, 0.001], [0.01, 100.0]])
    np.testing.assert_allclose(one.distance(other), [0.1, 1e-5])
