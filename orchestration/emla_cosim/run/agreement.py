"""A result held against a run that was kept: which signals stay in the tubes around it."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..recorders.tubes.signal_check import compare_signal, describe_departure, select_outside
from ..recorders.tubes.signal_comparison import Comparison
from ..recorders.tubes.tolerance import Tolerance, find_tolerance

if TYPE_CHECKING:  # which loads polars
    from ..recorders.stored import StoredRun

_NAMED = 3
"""Signals that a sentence tells of; run.json has all."""


def find_common_signals(names: Sequence[str], stored: "StoredRun") -> list[str]:
    """The signals that both have; CommandError where there is none."""
    known = set(stored.names)
    found = [name for name in names if name in known]
    if not found:
        raise CommandError(
            f"the run to compare with, '{stored.path}', has none of the signals that are recorded; "
            f"it has {stored.names[0]} and {len(stored.names) - 1} more."
        )
    return found


def compare_with_stored(
    kept: Sequence[str],
    read: Callable[[Sequence[str]], Mapping[str, Vector]],
    units: Mapping[str, Any],
    stored: "StoredRun",
    tolerance: Mapping[str, Tolerance],
) -> tuple[Comparison, ...]:
    """Every signal that both have, over the time that both have, in the order of `kept`.

    `kept` are the signals of a result, `units` theirs by name; `read` returns columns by their names.
    """
    names = find_common_signals(kept, stored)
    found, reference = read(["time", *names]), stored.read(["time", *names])
    for table, where in ((found, "the result"), (reference, f"the run to compare with, '{stored.path}',")):
        if not len(table["time"]):
            raise CommandError(f"{where} has no rows.")
    return tuple(
        compare_signal(
            name,
            str(units.get(name) or ""),
            found["time"],
            found[name],
            reference["time"],
            reference[name],
            find_tolerance(name, tolerance),
        )
        for name in names
    )


def describe_disagreement(comparisons: Sequence[Comparison], stored: "StoredRun") -> str | None:
    """The sentence that says which signals left their tubes, the first one first; None where none did."""
    left = select_outside(comparisons)
    if not left:
        return None
    told = "; ".join(describe_departure(c) for c in left[:_NAMED])
    more = f"; and {len(left) - _NAMED} more" if len(left) > _NAMED else ""
    return f"{len(left)} of {len(comparisons)} signals do not agree with '{stored.path}': {told}{more}."


def agreement_record(comparisons: Sequence[Comparison], stored: "StoredRun") -> dict[str, Any]:
    """What run.json says of it: how many signals agree, and those that do not, the first one first."""
    return {
        "run": str(stored.path),
        "signals": len(comparisons),
        "left": [
            {
                "signal": c.signal,
                "left_at_s": c.left_at,
                "worst": c.worst,
                "worst_at_s": c.worst_at,
                "tube": c.tube.value,
                "tube_s": c.tube.time,
            }
            for c in select_outside(comparisons)
        ],
    }
