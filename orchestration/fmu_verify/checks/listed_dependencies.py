"""Check the dependencies that the model structure declares."""

from collections.abc import Iterator

from ..check import CheckOutcome, check, quote
from ..declarations import Declarations, DeclaredUnknown
from ..messages import Breach, Problem, join_few_names, judge_problems
from ..subject import Subject
from .structure import find_unlisted, ignores_derivatives

_INDICES = quote("shared.indices")

LINEAR_KINDS = ("constant", "fixed", "tunable", "discrete")
"""Kinds of dependencies that only Real unknowns can have."""

_ASCENDING = quote("structure.dependencies")
_KINDS = quote("listed_dependencies.kinds")
_INITIAL_KINDS = quote("listed_dependencies.initial_kinds")
_INDEPENDENT = quote("listed_dependencies.independent")


@check("structure.dependencies", needs=("structure.derivatives",))
def dependencies(subject: Subject) -> CheckOutcome:
    """Check that dependencies exist, ascend, refer to knowns, and have a kind each or none."""
    declared = subject.declared
    states = declared.states() | {of.index for _, of in find_unlisted(declared, subject)}
    free = {v.index for v in declared.variables if v.causality in ("input", "independent")}
    knowns_later = states | free
    knowns_at_start = free | {v.index for v in declared.variables if v.initial == "exact"}
    if declared.version == 3:  # parameters, and states between events, which need not be listed
        knowns_later |= {
            v.index for v in declared.variables if v.causality == "parameter" or v.variability == "discrete"
        }
    # dependencies leave out the states of a co-simulation whose element Derivatives is ignored
    left_out = declared.states() if ignores_derivatives(subject) else set()
    problems, doubts, count = list[Problem](), list[Problem](), 0
    for listed, knowns in (
        (declared.outputs, knowns_later),
        (declared.derivatives, knowns_later),
        (declared.initial_unknowns, knowns_at_start),
    ):
        remaining = knowns - left_out  # once: there may be 100,000 of both
        for unknown in listed.unknowns:
            label, count = f"{unknown} in {listed}", count + len(unknown.dependencies or ())
            problems += _find_ill_formed(label, unknown, declared, listed is declared.initial_unknowns)
            problems += _find_missing_alias(label, unknown, remaining, declared)
            not_known = [
                v for i in unknown.dependencies or () if i not in knowns and (v := declared.variable(i))
            ]
            if not_known:
                names = join_few_names([v.name for v in not_known])
                message = f"{label} depends on {names}, which is not known when it is computed."
                doubts.append(Breach(message, _INDICES))
    if not problems:
        doubts += _compare_with_initial(declared, states - left_out, free)
    return judge_problems(problems, f"{count} dependencies are on variables that are known.", doubts)


def _find_missing_alias(
    label: str, unknown: DeclaredUnknown, knowns: set[int], declared: Declarations
) -> Iterator[Problem]:
    """Yield an unknown that is an alias of a known variable, but does not depend on it."""
    variable = unknown.variable
    if variable is None or variable.index in knowns or unknown.dependencies is None:
        return  # exporters differ in whether a known variable depends on itself
    shared = declared.share_value(variable)
    known_aliases = [v for v in shared if v.index in knowns and v.variability != "constant"]
    if known_aliases and not {v.index for v in known_aliases}.intersection(unknown.dependencies):
        message = f"{label} has the value of {known_aliases[0]}, but its dependencies lack it."
        yield Breach(message, _INDEPENDENT)


def _compare_with_initial(declared: Declarations, states: set[int], free: set[int]) -> Iterator[Problem]:
    """Yield knowns on which an unknown depends only at the start, or only later, by what is declared.

    States that are unknown at the start pass on what they depend on there, or are chosen for a steady state.
    """
    initial = declared.initial_unknowns
    at_start = {u.index: u.dependencies for u in initial.unknowns}
    unknown_states = [i for i in declared.states() if (v := declared.variable(i)) and v.initial != "exact"]
    if any(at_start.get(i) is None for i in unknown_states):
        return
    passed_on = {k for i in unknown_states for k in at_start[i] or ()}
    exact = states.difference(unknown_states)
    knowns_at_start = set[int]() if unknown_states else exact | free
    for listed in (declared.outputs, declared.derivatives):
        for unknown in listed.unknowns:
            first, later = at_start.get(unknown.index), unknown.dependencies
            is_continuous = unknown.variable is not None and unknown.variable.variability == "continuous"
            if not is_continuous or first is None or later is None:
                continue
            for missing, name, other_list in (
                (exact.intersection(first).difference(later, passed_on), initial, listed),
                (knowns_at_start.intersection(later).difference(first), listed, initial),
            ):
                if missing:
                    message = f"{unknown} depends on {declared.names(missing)} in {name}"
                    yield Breach(f"{message}, but not in {other_list}.", _INDEPENDENT)


def _find_ill_formed(
    label: str, unknown: DeclaredUnknown, declared: Declarations, is_initial: bool
) -> Iterator[Problem]:
    """Yield problems with indices and kinds of dependencies."""
    indices, kinds = unknown.dependencies, unknown.kinds
    beyond = [i for i in indices or () if declared.variable(i) is None]
    if beyond:
        yield Breach(f"{label} depends on {declared.describe_missing(beyond[0])}.", _INDICES)
    elif declared.version == 2 and indices is not None and list(indices) != sorted(set(indices)):
        yield Breach(f"The dependencies of {label} are not in ascending order.", _ASCENDING)
    if kinds is None:
        return
    if indices is None or len(indices) != len(kinds):
        yield Breach(f"{label} has {len(kinds)} kinds for {len(indices or ())} dependencies.", _KINDS)
    variable, linear = unknown.variable, [kind for kind in kinds if kind in LINEAR_KINDS]
    if variable is not None and not variable.is_real and linear:
        message = f"{label} is of type {variable.type}, but has a dependency of the kind {linear[0]}."
        yield Breach(message, quote("listed_dependencies.real_kinds"))
    later = [kind for kind in linear if kind != "constant"]  # do not exist before initialization ends
    if is_initial and later:
        yield Breach(f"{label} has a dependency of the kind {later[0]}.", _INITIAL_KINDS)
