"""What became of the mutants."""

import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

from cosmic_ray.work_db import WorkDB
from cosmic_ray.work_item import TestOutcome, WorkResult

KNOWN = Path(__file__).parent / "equivalent.toml"
"""Mutants that no test can notice, each with the reason."""

Change = tuple[str, str, str]
"""The module, the line as it was, and the line as it became."""


def report(target: str, work: WorkDB) -> str:
    """Counts, the score, and the survivors that are not known to be equivalent, as text."""
    results = [result for _, result in work.results]
    survivors = [r for r in results if r.test_outcome == TestOutcome.SURVIVED]
    missed = [r for r in survivors if not is_equivalent(r)]
    count = Counter(r.test_outcome for r in results)
    killed = len(results) - len(survivors)
    lines = [
        f"{target}: {len(results)} of {work.num_work_items} mutants tried, {killed} killed, "
        f"{len(survivors)} survived, of which {len(survivors) - len(missed)} are equivalent",
        f"score: {100.0 * killed / max(killed + len(missed), 1):.1f} % of what is not equivalent",
    ]
    if count[TestOutcome.INCOMPETENT]:
        lines.append(f"{count[TestOutcome.INCOMPETENT]} could not be tried and count as killed")
    for module, line, mutant in sorted(map(_change, missed)):
        lines += [f"{module}", f"  - {line}", f"  + {mutant}"]
    return "\n".join(lines)


def is_equivalent(result: WorkResult) -> bool:
    """Whether a mutant is known to change nothing."""
    return _change(result) in _equivalent()


@cache
def _equivalent() -> set[Change]:
    known = tomllib.loads(KNOWN.read_text(encoding="utf-8"))["mutants"]
    return {(mutant["module"], mutant["line"], mutant["becomes"]) for mutant in known}


def _change(result: WorkResult) -> Change:
    """What a mutant changed; of several lines those that differ, joined."""
    lines = (result.diff or "").splitlines()
    module = next(line.removeprefix("--- a/") for line in lines if line.startswith("--- a/"))
    was, became = (
        [x[1:].strip() for x in lines if x.startswith(sign) and not x.startswith(sign * 3)] for sign in "-+"
    )
    return module, " ".join(was), " ".join(became)
