"""Dependencies of the model structure, beside those that are seen."""

from collections.abc import Iterable, Iterator

import numpy as np

from ..check import check
from ..host.fresh_process import EndedError, in_fresh_process
from ..host.hosted_instance import CallError
from ..host.points import Point, in_event_mode, in_initialization
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, failed, passed, skipped

_POINTS = 3
_CHANGE = 1e-2
"""Of a known, in parts of its size."""

_SEEN = 1e-9
"""Of an unknown, in parts of its value: rounding may change by other ways of computing."""

Pairs = dict[tuple[str, str], str]
"""Unknown and known, and where the one was seen to change with the other."""


@check(
    "dependencies.observed",
    "Outputs depend on what they are said to",
    Clause("2.2.8", "If present as empty list, the Unknown depends on none of the Knowns."),
    "Add the input to the dependencies of the unknown, or leave the attribute out.",
    needs=("run.finite",),
    time_factor=3.0,
)
def observed(subject: Subject) -> CheckOutcome:
    """No output changes with an input that its dependencies exclude."""
    cosimulates = subject.kinds[0] == "CoSimulation"
    found = _look(in_initialization(subject, _POINTS)) if cosimulates else ({}, 0, 0)
    excluded, seen, declared = _together(found, _of_model(subject))
    if excluded:
        lines = tuple(
            f"{unknown} changes with {known} {where}, which its dependencies exclude."
            for (unknown, known), where in excluded.items()
        )
        return failed(lines[0], details=lines)
    if not declared:
        return skipped("It declares no dependency of an output on an input.")
    return passed(f"Nothing but the {declared} declared dependencies on inputs is seen, {seen} of them are.")


Look = tuple[Pairs, int, int]


def _together(one: Look, other: Look) -> Look:
    return {**one[0], **other[0]}, one[1] + other[1], one[2] + other[2]


def _of_model(subject: Subject) -> Look:
    """What is seen of the model; nothing where it does not run, which is for another check."""
    if "ModelExchange" not in subject.kinds:
        return {}, 0, 0
    try:
        return in_fresh_process(_look_at_model, subject)
    except (CallError, EndedError):
        return {}, 0, 0


def _look_at_model(subject: Subject) -> Look:
    return _look(in_event_mode(subject, _POINTS))


def _look(points: Iterable[Point]) -> Look:
    """Excluded pairs that are seen, and how many declared ones are, and are not."""
    excluded: Pairs = {}
    seen: set[tuple[str, str]] = set()
    declared: set[tuple[str, str]] = set()
    for point in points:
        for d in point.dependencies:
            declared.update((d.unknown, known) for known in point.knowns if d.on and known in d.on)
        for unknown, known in _changes(point):
            if next(d for d in point.dependencies if d.unknown == unknown).excludes(known):
                excluded.setdefault((unknown, known), point.where)
            seen.add((unknown, known))
    return excluded, len(seen & declared), len(declared)


def _changes(point: Point) -> Iterator[tuple[str, str]]:
    """Unknowns that change with a known."""
    for known in point.knowns:
        try:
            here = point.evaluate_shifted({known: 0.0})
            there = point.evaluate_shifted({known: _CHANGE * point.scale(known)})
        except CallError:  # beyond what the FMU takes
            continue
        changed = np.abs(there - here) > _SEEN * np.maximum(np.abs(here), np.abs(there))
        yield from ((name, known) for name, moved in zip(point.unknowns, changed, strict=True) if moved)
