"""What became of the mutants."""

import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

EQUIVALENT = Path(__file__).parent / "equivalent.toml"
"""Mutants that no test can notice, each with the reason."""


def report(results: Sequence[dict[str, Any]]) -> str:
    """Return counts, and the survivors that are not known to be equivalent, as text."""
    survivors = [r for r in results if r["outcome"] == "survived"]
    missed = [r for r in survivors if not is_equivalent(r)]
    by_default = sum(r["tier"] == "default" for r in results)
    lines = [
        f"{len(results)} mutants: {by_default} noticed by default tests, "
        f"{len(results) - len(survivors) - by_default} by slow ones only, {len(survivors)} survived, "
        f"of which {len(survivors) - len(missed)} are equivalent"
    ]
    for result in sorted(missed, key=lambda r: r["key"]):
        counts = f"executed by {result['default']} default tests"
        lines += [f"{result['module']}:{result['line']} ({counts})", result["difference"]]
    return "\n".join(lines)


def is_equivalent(result: dict[str, Any]) -> bool:
    """Return whether a mutant is known to change nothing."""
    before, after = (
        " ".join(x[1:].strip() for x in result["difference"].splitlines() if x[0] == sign) for sign in "-+"
    )
    return (result["module"], before, after) in _equivalent()


@cache
def _equivalent() -> set[tuple[str, str, str]]:
    mutants = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8"))["mutants"]
    return {(mutant["module"], mutant["line"], mutant["becomes"]) for mutant in mutants}
