"""Puts faults into a copy of the project, one at a time, and counts those that the tests notice."""

import argparse
import os
import shutil
import sys
import tempfile
from pathlib import Path

from cosmic_ray.commands import execute
from cosmic_ray.testing import run_tests
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome

from .report import is_equivalent, report
from .target import TARGETS, Target, configuration

ROOT = Path(__file__).parents[2]
SESSIONS = ROOT / "build" / "mutation"
"""What was tried so far, a database for each target."""

NOT_COPIED = (".git", ".venv", "build", "results")
"""At the top of the project: what no test reads, and may be large."""


def main() -> None:
    """Try what is left of a target's sample, and report."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--sample", type=int, help="mutants to draw at first; 0 takes all")
    parser.add_argument("--seed", type=int, default=1, help="of the drawing")
    parser.add_argument("--again", action="store_true", help="try survivors again, with tests added since")
    parser.add_argument("--new", action="store_true", help="forget what was tried")
    chosen = parser.parse_args()
    target = TARGETS[chosen.target]
    session = SESSIONS / f"{target.name}.sqlite"
    SESSIONS.mkdir(parents=True, exist_ok=True)
    if chosen.new:
        session.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        _enter_a_copy(Path(folder) / "project")
        with use_db(str(session), WorkDB.Mode.create) as work:
            if not work.num_work_items:
                target.draw(work, chosen.sample, chosen.seed)
            if chosen.again:
                _forget_survivors(work)
            if work.pending_work_items:
                _check_without_faults(target)
                execute(work, configuration(target))
            print(report(target.name, work))
        os.chdir(ROOT)


def _enter_a_copy(copy: Path) -> None:
    """Mutants never stand in the project itself: the library changes files in place."""
    shutil.copytree(ROOT, copy, ignore=lambda folder, _: NOT_COPIED if Path(folder) == ROOT else ())
    os.chdir(copy)
    os.environ["PYTHONPATH"] = os.pathsep.join(str(copy / name) for name in ("src", "orchestration"))
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])


def _forget_survivors(work: WorkDB) -> None:
    kept = [
        (job, result)
        for job, result in work.results
        if result.test_outcome != TestOutcome.SURVIVED or is_equivalent(result)
    ]
    items = work.work_items
    work.clear()
    work.add_work_items(items)
    for job, result in kept:
        work.set_result(job, result)


def _check_without_faults(target: Target) -> None:
    outcome, output = run_tests(target.command, target.timeout)
    if outcome != TestOutcome.SURVIVED:
        sys.exit(f"The tests of {target.name} fail without any fault:\n{output}")


main()
