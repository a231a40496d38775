"""Every stepper gives the bits of Python steps, with every system and every algorithm, and fails alike."""

import itertools
import random
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.backends.steppers import ALGORITHMS, STEPPERS, Bench, Task, can_step
from tests.backends.systems import FAILING, SYSTEMS
from tests.support.tiers import mostly_slow

Case = tuple[str, str, str]
SPECIAL = {name for name, stepper in STEPPERS.items() if stepper.by_default is not None}
"""Steppers that compile each case, or start processes for it; few cases of them will do."""


def cover_pairs(cases: Sequence[Case], already_met: Iterable[tuple[str, str]] = ()) -> list[Case]:
    """Return cases in which each two of a stepper, a system and an algorithm meet, if they ever do."""
    met, selected = set(already_met), list[Case]()
    for least in (3, 2, 1):  # cases with the most new pairs first
        for case in cases:
            new = set(itertools.combinations(case, 2)) - met
            if len(new) >= least:
                met |= new
                selected.append(case)
    return selected


def select(systems: Collection[str]) -> list:
    """Return the cases: by default each stepper with each system and each algorithm, of special ones few.

    The slow tier also has each system with each algorithm, and special steppers with each algorithm.
    """
    cases = [case for case in itertools.product(STEPPERS, systems, ALGORITHMS) if can_step(*case)]
    random.Random(1).shuffle(cases)
    pairs = [*itertools.product(systems, ALGORITHMS)]
    quick = [case for case in cases if case[0] not in SPECIAL and "slow" not in Task(*case[1:]).entry.has]
    special = {(name, *pair) for name in SPECIAL for pair in STEPPERS[name].by_default or ()}
    assert all(can_step(*case) for case in special)
    by_default = [*cover_pairs(quick, pairs), *(case for case in cases if case in special)]
    rest = [case for case in cases[::-1] if case not in set(by_default)]
    slow = cover_pairs([case for case in rest if case[0] not in SPECIAL])
    covered = [*itertools.product(SPECIAL, systems), *pairs]
    slow += cover_pairs([case for case in rest if case[0] in SPECIAL], covered)
    return mostly_slow([*by_default, *slow], by_default)


@pytest.fixture(scope="module")
def bench(python_fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    opened = Bench(tmp_path_factory.mktemp("matrix"), python_fmu_folder)
    with opened.stack:
        yield opened


def check(bench: Bench, stepper: str, task: Task) -> None:
    """Compare the rows bit for bit, and the report."""
    expected, outcome = bench.reference(task), STEPPERS[stepper].run(bench, task)
    names = [name for name in outcome.columns if name in expected.columns]
    assert (names == list(outcome.columns) and len(names) > 1) or not outcome.is_whole
    for name in names:
        column = np.asarray(expected.columns[name])[outcome.rows]
        same = np.asarray(outcome.columns[name], dtype=column.dtype)
        assert same.shape == column.shape and same.tobytes() == column.tobytes(), name
    for key, value in outcome.report.items():
        np.testing.assert_equal(value, expected.report[key], err_msg=key)


@pytest.mark.parametrize(("stepper", "system", "algorithm"), select(SYSTEMS))
def test_every_stepper_has_the_bits_of_python(
    stepper: str, system: str, algorithm: str, bench: Bench
) -> None:
    task = Task(system, algorithm)
    reference = bench.reference(task)
    assert reference.report["problem"] is None
    assert any(np.ptp(x) > 0.0 for n, x in reference.columns.items() if n != "time" and x.dtype == "f8")
    assert len(reference.columns["time"]) > 5
    check(bench, stepper, task)


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
@pytest.mark.parametrize(("stepper", "system", "algorithm"), select(FAILING))
def test_every_stepper_fails_as_python_does(stepper: str, system: str, algorithm: str, bench: Bench) -> None:
    """With the same error message, after the same rows."""
    task = Task(system, algorithm)
    problem = bench.reference(task).report["problem"]
    assert problem is not None and task.entry.fails.lower() in problem.lower()
    check(bench, stepper, task)
