"""Compare the declared dependencies of the model structure with observed ones."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress

import numpy as np
from fmpy.model_description import ModelVariable

from ..check import check
from ..host.arrays import ElementDependency
from ..host.experiment import span
from ..host.fresh_process import EndedError, in_fresh_process
from ..host.hosted_instance import CallError, HostedInstance
from ..host.other_values import other_of, same, settable, start_of
from ..host.points import (
    ALL_TYPES,
    Dependency,
    Point,
    at_events,
    at_initialization,
    choose,
    in_event_mode,
    in_initialization,
    list_unexamined_pairs,
)
from ..messages import judge_problems, list_left_out
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, failed, fmi3, passed, skipped

_POINTS = 3
_CHANGE = 1e-2
"""Change of a known, relative to its scale."""

_SEEN = 1e-9
"""Smallest relative change of an unknown that counts; less may be rounding."""

Pairs = dict[tuple[str, str], str]
"""Unknown and known, with the place where the unknown changed with the known."""


@check(
    "dependencies.observed",
    "Outputs change only with declared dependencies",
    Clause(
        "2.2.8",
        "If present as empty list, the Unknown depends on none of the Knowns.",
        in_3=fmi3(
            "2.4.8", "If dependencies is present as empty list, the unknown depends on none of the knowns."
        ),
    ),
    "Add the input to the dependencies of the unknown, or leave the attribute out.",
    needs=("run.finite",),
    time_factor=3.0,
)
def observed(subject: Subject) -> CheckOutcome:
    """Check that no output changes with an input or parameter that its dependencies exclude."""
    cosimulates = subject.kinds[0] == "CoSimulation"
    of_all_types = _excluded_of_all_types(subject)  # first: threads of the library end in a fork
    found = _look(in_initialization(subject, _POINTS)) if cosimulates else ({}, 0, 0)
    of_model = _of_model(subject)
    seen, declared = (one + other for one, other in zip(found[1:], of_model[1:], strict=True))
    excluded = {**of_all_types, **found[0], **of_model[0]}
    if excluded:
        lines = tuple(
            f"{unknown} changes with {known} {where}, which its dependencies exclude."
            for (unknown, known), where in excluded.items()
        )
        return failed(lines[0], details=lines)
    if not declared:
        return skipped("It declares no dependency of an output on an input.")
    said = f"No dependency on inputs is undeclared; {seen} of {declared} declared ones were observed."
    return passed(said, gaps=list_unexamined_pairs(subject))


Look = tuple[Pairs, int, int]


def _of_model(subject: Subject) -> Look:
    """Observe the model. Return nothing if it does not run, which another check reports."""
    if "ModelExchange" not in subject.run_kinds:
        return {}, 0, 0
    try:
        return in_fresh_process(_look_at_model, subject)
    except (CallError, EndedError):
        return {}, 0, 0


def _look_at_model(subject: Subject) -> Look:
    return _look(in_event_mode(subject, _POINTS))


def _look(points: Iterable[Point]) -> Look:
    """Return observed excluded pairs, the number of observed declared pairs, and of declared pairs."""
    excluded: Pairs = {}
    seen: set[tuple[str, str]] = set()
    declared: set[tuple[str, str]] = set()
    for point in points:
        dependencies = {d.unknown: d for d in point.dependencies}
        for d in point.dependencies:
            declared.update((d.unknown, known) for known in point.knowns if d.on and known in d.on)
        for unknown, known in _changes(point):
            if dependencies[unknown].excludes(known):
                excluded.setdefault((unknown, known), point.where)
            seen.add((unknown, known))
    return excluded, len(seen & declared), len(declared)


def _changes(point: Point) -> Iterator[tuple[str, str]]:
    """Yield pairs of an unknown and a known that it changes with."""
    for known in point.knowns:
        try:
            here = point.evaluate_shifted({known: 0.0})
            there = point.evaluate_shifted({known: _CHANGE * point.scale(known)})
        except CallError:  # outside of the values that the FMU accepts
            continue
        changed = np.abs(there - here) > _SEEN * np.maximum(np.abs(here), np.abs(there))
        yield from ((name, known) for name, moved in zip(point.unknowns, changed, strict=True) if moved)


def _excluded_of_all_types(subject: Subject) -> Pairs:
    """Observe variables of all types. Return nothing for modes that the FMU does not reach."""
    found: Pairs = {}
    for kind, do in (
        ("CoSimulation", _in_initialization),
        ("CoSimulation", _at_communication),
        ("ModelExchange", _at_first_event),
    ):
        if kind in subject.run_kinds:
            with suppress(CallError, EndedError):
                found.update(in_fresh_process(do, subject))
    return found


def _in_initialization(subject: Subject) -> Pairs:
    """Return undeclared dependencies of outputs on inputs and parameters in initialization mode."""
    instance = HostedInstance(subject)
    instance.begin_initialization(span(subject)[0])
    knowns = settable(subject, "input", "parameter")
    return _jumps(instance, at_initialization(subject, ALL_TYPES), knowns, "in initialization mode")


def _at_communication(subject: Subject) -> Pairs:
    """Return undeclared dependencies of outputs on inputs after the first step."""
    start, step, _ = span(subject)
    instance = HostedInstance(subject, kind="CoSimulation")
    instance.initialize(None, start)
    instance.step(start, step)
    names = {v.name for v in subject.description.modelVariables if v.causality == "output"}
    declared = [d for d in at_events(subject, ALL_TYPES) if d.unknown in names]
    return _jumps(instance, declared, settable(subject, "input"), "after a step")


def _at_first_event(subject: Subject) -> Pairs:
    """Return undeclared dependencies of outputs and derivatives on inputs of the model."""
    instance = HostedInstance(subject, kind="ModelExchange")
    instance.initialize(None, span(subject)[0])
    declared = at_events(subject, ALL_TYPES)
    return _jumps(instance, declared, settable(subject, "input"), "of the model after initialization")


def _jumps(
    instance: HostedInstance, declared: Sequence[Dependency], knowns: Sequence[ModelVariable], where: str
) -> Pairs:
    """Return excluded pairs: another value of the known changes the unknown, and the old one restores it."""
    by_name = {v.name: v for v in knowns if other_of(v) is not None}
    declared, names = choose([d for d in declared if d.on is not None], list(by_name))
    knowns = [by_name[name] for name in names]
    excluded = [v for v in knowns if any(d.excludes(v.name) for d in declared)]
    names = [d.unknown for d in declared]
    found: Pairs = {}
    start = {v.name: start_of(v) for v in knowns}
    moved = {**start, **{v.name: other_of(v) for v in knowns if v.causality == "input"}}
    with suppress(CallError):  # outside of the values that the FMU accepts
        for base in (start, moved) if excluded else ():
            instance.set({name: base[name] for name in base if base[name] != start[name]})
            before = instance.get(names)
            for known in excluded:
                old = base[known.name]
                instance.set({known.name: other_of(known) if old == start[known.name] else start[known.name]})
                there = instance.get(names)
                instance.set({known.name: old})
                back = instance.get(names)
                for d, one, two, three in zip(declared, before, there, back, strict=True):
                    if d.excludes(known.name) and same(one, three) and not same(one, two):
                        found.setdefault((d.unknown, known.name), where)
    return found


_ELEMENTS = fmi3("2.2.9", "This function returns the dependency information for a single variable.")
_MOST_UNKNOWNS = 20
_MOST_KNOWNS = 100


@check(
    "dependencies.elements",
    "Elements of arrays change only with dependencies of elements",
    _ELEMENTS,
    "Return all dependencies of all elements, or set providesPerElementDependencies to false.",
    needs=("run.finite",),
    time_factor=2.0,
    only_for=3,
)
def elements(subject: Subject) -> CheckOutcome:
    """Check that the dependencies that the FMU returns in initialization mode are valid and complete."""
    if not subject.has_flag("providesPerElementDependencies"):
        return skipped("providesPerElementDependencies is not set.")
    instance = HostedInstance(subject)
    instance.begin_initialization(span(subject)[0])
    every = [d.unknown for d in at_initialization(subject)]
    every = list({subject.variables[n].valueReference: n for n in reversed(every)}.values())[::-1]
    found = {
        instance.reference(n): instance.dependencies(instance.reference(n)) for n in every[:_MOST_UNKNOWNS]
    }
    problems = [
        p for reference, entries in found.items() for p in _invalid_entries(subject, reference, entries)
    ]
    if not problems:
        problems = list(_unlisted(instance, found))
    count = sum(len(entries) for entries in found.values())
    fine = f"{count} dependencies of the elements of {len(found)} outputs are valid."
    return judge_problems(
        problems, fine, gaps=list_left_out(len(found), len(every), "outputs were examined.")
    )


def _invalid_entries(subject: Subject, reference: int, entries: Sequence[ElementDependency]) -> Iterator[str]:
    """Yield entries with elements or variables that do not exist."""
    sizes = {int(v.valueReference): getattr(v, "size", 1) for v in subject.variables.values()}
    known = {v.reference for v in subject.declared.variables}
    names = {v.reference: v.name for v in subject.declared.variables}
    for one in entries:
        if one.independent not in known:
            yield f"{names[reference]} depends on value reference {one.independent}, which no variable has."
        elif one.element > sizes[reference]:
            yield f"{names[reference]} has no element {one.element}, for which a dependency is returned."
        elif one.element_of_independent > sizes.get(one.independent, one.element_of_independent):
            what = f"{names[one.independent]} has no element {one.element_of_independent}"
            yield f"{what}, a dependency of {names[reference]}."


def _unlisted(instance: HostedInstance, found: dict[int, list[ElementDependency]]) -> Iterator[str]:
    """Yield elements of outputs that change with an element of an input which is no dependency of theirs."""
    subject = instance.subject
    unknowns = [
        v for v in subject.description.modelVariables if int(v.valueReference) in found and v.type == "Real"
    ]
    knowns = [v for v in settable(subject, "input") if v.type == "Real" and other_of(v) is not None]
    names = [v.name for v in unknowns]
    for known in knowns[:_MOST_KNOWNS]:
        before = instance.get(names)
        with suppress(CallError):  # outside of the values that the FMU accepts
            instance.set({known.name: other_of(known)})
            after = instance.get(names)
            instance.set({known.name: start_of(known)})
            for unknown, one, two, three in zip(unknowns, before, after, instance.get(names), strict=True):
                entries = found[int(unknown.valueReference)]
                if (
                    same(one, three)
                    and not same(one, two)
                    and not any(e.has(unknown, known) for e in entries)
                ):
                    yield f"{unknown.name} changes with {known.name}, which is no dependency of it."
