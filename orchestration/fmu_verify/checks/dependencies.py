"""Compare the declared dependencies of the model structure with observed ones."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from ..check import CheckOutcome, check, failed, passed, skipped
from ..host.arrays import ElementDependency
from ..host.experiment import read_span
from ..host.hosted_instance import CallError, HostedInstance
from ..host.other_values import are_same, choose_other, list_settable, read_start
from ..host.points import (
    ALL_TYPES,
    Dependency,
    Point,
    choose,
    list_initial_dependencies,
    list_run_dependencies,
    list_unexamined_pairs,
    yield_points_in_event_mode,
    yield_points_in_initialization,
)
from ..messages import judge_problems, list_left_out
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process

_POINTS = 3
_CHANGE = 1e-2
"""Change of a known, relative to its scale."""

# smallest relative change of an unknown that counts; less may be rounding
_MIN_EFFECT = 1e-9

Pairs = dict[tuple[str, str], str]
"""Unknown and known, with the place where the unknown changed with the known."""


@check("dependencies.observed", needs=("run.finite",), time_factor=3.0)
def observed(subject: Subject) -> CheckOutcome:
    """Check that no output changes with an input or parameter that its dependencies exclude."""
    cosimulates = subject.kinds[0] == "CoSimulation"
    of_all_types = _observe_all_types(subject)  # first: threads of the library end in a fork
    of_co_simulation = (
        _observe_pairs(yield_points_in_initialization(subject, _POINTS)) if cosimulates else ({}, 0, 0)
    )
    of_model = _observe_model(subject)
    observed_count = of_co_simulation[1] + of_model[1]
    declared_count = of_co_simulation[2] + of_model[2]
    excluded = {**of_all_types, **of_co_simulation[0], **of_model[0]}
    if excluded:
        lines = tuple(
            f"{unknown} changes with {known} {where}, which its dependencies exclude."
            for (unknown, known), where in excluded.items()
        )
        return failed(lines[0], details=lines)
    if not declared_count:
        return skipped("It declares no dependency of an output on an input.")
    observed = f"{observed_count} of {declared_count} declared ones were observed"
    message = f"No dependency on inputs is undeclared; {observed}."
    return passed(message, gaps=list_unexamined_pairs(subject))


Observation = tuple[Pairs, int, int]
"""Excluded pairs that were observed, the number of declared pairs that were, and of all declared ones."""


def _observe_model(subject: Subject) -> Observation:
    """Observe the model. Return nothing if it does not run, which another check reports."""
    if "ModelExchange" not in subject.run_kinds:
        return {}, 0, 0
    try:
        return in_fresh_process(_observe_in_event_mode, subject)
    except (CallError, EndedError):
        return {}, 0, 0


def _observe_in_event_mode(subject: Subject) -> Observation:
    return _observe_pairs(yield_points_in_event_mode(subject, _POINTS))


def _observe_pairs(points: Iterable[Point]) -> Observation:
    """Return observed excluded pairs, the number of observed declared pairs, and of declared pairs."""
    excluded: Pairs = {}
    changed: set[tuple[str, str]] = set()
    declared: set[tuple[str, str]] = set()
    for point in points:
        dependencies = {d.unknown: d for d in point.dependencies}
        for d in point.dependencies:
            declared.update((d.unknown, known) for known in point.knowns if d.on and known in d.on)
        for unknown, known in _find_changes(point):
            if dependencies[unknown].excludes(known):
                excluded.setdefault((unknown, known), point.where)
            changed.add((unknown, known))
    return excluded, len(changed & declared), len(declared)


def _find_changes(point: Point) -> Iterator[tuple[str, str]]:
    """Yield pairs of an unknown and a known that it changes with."""
    for known in point.knowns:
        try:
            before = point.evaluate_shifted({known: 0.0})
            after = point.evaluate_shifted({known: _CHANGE * point.scale(known)})
        except CallError:  # outside of the values that the FMU accepts
            continue
        has_changed = np.abs(after - before) > _MIN_EFFECT * np.maximum(np.abs(before), np.abs(after))
        yield from ((name, known) for name in itertools.compress(point.unknowns, has_changed))


def _observe_all_types(subject: Subject) -> Pairs:
    """Return undeclared dependencies of variables of all types, in the modes that the FMU reaches."""
    pairs: Pairs = {}
    for kind, observe in (
        ("CoSimulation", _observe_in_initialization),
        ("CoSimulation", _observe_after_step),
        ("ModelExchange", _observe_at_first_event),
    ):
        if kind in subject.run_kinds:
            with suppress(CallError, EndedError):
                pairs.update(in_fresh_process(observe, subject))
    return pairs


def _observe_in_initialization(subject: Subject) -> Pairs:
    """Return undeclared dependencies of outputs on inputs and parameters in initialization mode."""
    instance = HostedInstance(subject)
    instance.begin_initialization(read_span(subject)[0])
    knowns = list_settable(subject, "input", "parameter")
    declared = list_initial_dependencies(subject, ALL_TYPES)
    return _find_excluded_changes(instance, declared, knowns, "in initialization mode")


def _observe_after_step(subject: Subject) -> Pairs:
    """Return undeclared dependencies of outputs on inputs after the first step."""
    start, step, _ = read_span(subject)
    instance = HostedInstance(subject, kind="CoSimulation")
    instance.initialize(None, start)
    instance.step(start, step)
    names = {v.name for v in subject.description.modelVariables if v.causality == "output"}
    declared = [d for d in list_run_dependencies(subject, ALL_TYPES) if d.unknown in names]
    return _find_excluded_changes(instance, declared, list_settable(subject, "input"), "after a step")


def _observe_at_first_event(subject: Subject) -> Pairs:
    """Return undeclared dependencies of outputs and derivatives on inputs of the model."""
    instance = HostedInstance(subject, kind="ModelExchange")
    instance.initialize(None, read_span(subject)[0])
    declared, knowns = list_run_dependencies(subject, ALL_TYPES), list_settable(subject, "input")
    return _find_excluded_changes(instance, declared, knowns, "of the model after initialization")


def _find_excluded_changes(
    instance: HostedInstance, declared: Sequence[Dependency], knowns: Sequence[ModelVariable], where: str
) -> Pairs:
    """Return excluded pairs: another value of the known changes the unknown, and the old one restores it."""
    by_name = {v.name: v for v in knowns if choose_other(v) is not None}
    declared, names = choose([d for d in declared if d.on is not None], list(by_name))
    knowns = [by_name[name] for name in names]
    excluded = [v for v in knowns if any(d.excludes(v.name) for d in declared)]
    names = [d.unknown for d in declared]
    pairs: Pairs = {}
    start = {v.name: read_start(v) for v in knowns}
    moved_values = {**start, **{v.name: choose_other(v) for v in knowns if v.causality == "input"}}
    with suppress(CallError):  # outside of the values that the FMU accepts
        for base in (start, moved_values) if excluded else ():
            instance.set({name: base[name] for name in base if base[name] != start[name]})
            before = instance.get(names)
            for known in excluded:
                old, first = base[known.name], start[known.name]
                instance.set({known.name: choose_other(known) if old == first else first})
                after = instance.get(names)
                instance.set({known.name: old})
                restored = instance.get(names)
                for d, *values in zip(declared, before, after, restored, strict=True):
                    if d.excludes(known.name) and _is_dependent(*values):
                        pairs.setdefault((d.unknown, known.name), where)
    return pairs


def _is_dependent(old: Any, changed: Any, restored: Any) -> bool:
    """Return whether a value changed with a known and came back with it: time alone may change others."""
    return are_same(old, restored) and not are_same(old, changed)


_MOST_UNKNOWNS = 20
_MOST_KNOWNS = 100


@check("dependencies.elements", needs=("run.finite",), time_factor=2.0, only_for=3)
def elements(subject: Subject) -> CheckOutcome:
    """Check that the dependencies that the FMU returns in initialization mode are valid and complete."""
    if not subject.has_flag("providesPerElementDependencies"):
        return skipped("providesPerElementDependencies is not set.")
    instance = HostedInstance(subject)
    instance.begin_initialization(read_span(subject)[0])
    names = [d.unknown for d in list_initial_dependencies(subject)]
    names = list({subject.variables[n].valueReference: n for n in reversed(names)}.values())[::-1]
    references = [instance.reference(n) for n in names[:_MOST_UNKNOWNS]]
    entries_by_output = {reference: instance.dependencies(reference) for reference in references}
    problems = [p for item in entries_by_output.items() for p in _find_invalid_entries(subject, *item)]
    problems = problems or [*_find_undeclared_elements(instance, entries_by_output)]
    count = sum(len(entries) for entries in entries_by_output.values())
    fine = f"{count} dependencies of the elements of {len(entries_by_output)} outputs are valid."
    gaps = list_left_out(len(entries_by_output), len(names), "outputs were examined.")
    return judge_problems(problems, fine, gaps=gaps)


def _find_invalid_entries(
    subject: Subject, reference: int, entries: Sequence[ElementDependency]
) -> Iterator[str]:
    """Yield entries with elements or variables that do not exist."""
    sizes = {int(v.valueReference): getattr(v, "size", 1) for v in subject.variables.values()}
    references = {v.reference for v in subject.declared.variables}
    names = {v.reference: v.name for v in subject.declared.variables}
    for entry in entries:
        if entry.independent not in references:
            yield f"{names[reference]} depends on value reference {entry.independent}, which no variable has."
        elif entry.element > sizes[reference]:
            yield f"{names[reference]} has no element {entry.element}, for which a dependency is returned."
        elif entry.element_of_independent > sizes.get(entry.independent, entry.element_of_independent):
            message = f"{names[entry.independent]} has no element {entry.element_of_independent}"
            yield f"{message}, a dependency of {names[reference]}."


def _find_undeclared_elements(
    instance: HostedInstance, entries_by_output: dict[int, list[ElementDependency]]
) -> Iterator[str]:
    """Yield messages on outputs that change with an input, although they are not declared to depend on it."""
    subject = instance.subject
    reals = [v for v in subject.description.modelVariables if v.type == "Real"]
    unknowns = [v for v in reals if int(v.valueReference) in entries_by_output]
    knowns = [v for v in list_settable(subject, "input") if v.type == "Real" and choose_other(v) is not None]
    names = [v.name for v in unknowns]
    for known in knowns[:_MOST_KNOWNS]:
        before = instance.get(names)
        with suppress(CallError):  # outside of the values that the FMU accepts
            instance.set({known.name: choose_other(known)})
            after = instance.get(names)
            instance.set({known.name: read_start(known)})
            for unknown, *values in zip(unknowns, before, after, instance.get(names), strict=True):
                entries = entries_by_output[int(unknown.valueReference)]
                if _is_dependent(*values) and not any(e.has(unknown, known) for e in entries):
                    yield f"{unknown.name} changes with {known.name}, which is not a dependency of it."
