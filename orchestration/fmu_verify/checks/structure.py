"""Checks of the model structure: outputs, derivatives, initial unknowns, dependencies."""

from collections.abc import Iterable, Iterator
from itertools import pairwise

from ..check import CheckOutcome, Clause, check, quote
from ..declarations import Declarations, DeclaredUnknown, DeclaredVariable, UnknownList, find_repeated
from ..messages import Breach, Problem, join_few_names, judge_problems
from ..subject import Subject

_DERIVATIVE = quote("shared.derivative")

_OF_STATES = ("local", "output")
"""Causalities of continuous-time states and event indicators."""

_OUTPUTS = quote("structure.outputs")
_DEFINED_STATES = quote("structure.defined_states")
_STATES = quote("structure.states")
_INITIAL = quote("structure.initial_unknowns")
_CLOCKED = quote("structure.clocked")
_PREVIOUS = quote("structure.previous")
_INDICATORS = quote("structure.indicators")


@check("structure.outputs", needs=("description.schema",))
def outputs(subject: Subject) -> CheckOutcome:
    """Check that ModelStructure/Outputs lists every output once, and nothing else."""
    declared = subject.declared
    expected = {v.index for v in declared.variables if v.causality == "output"}
    problems = [
        *_find_invalid_indices(declared.outputs, declared, _OUTPUTS),
        *_compare_indices(declared.outputs, expected, declared, _OUTPUTS),
    ]
    return judge_problems(problems, f"{len(expected)} outputs are listed.")


@check("structure.derivatives", clause=_DEFINED_STATES, needs=("description.schema",))
def derivatives(subject: Subject) -> CheckOutcome:
    """Check that each of ModelStructure/Derivatives is the derivative of a different continuous state."""
    declared = subject.declared
    listed = declared.derivatives
    problems = [
        *_judge_clocked_states(declared),
        *_judge_event_indicators(declared),
        *_find_invalid_indices(listed, declared, quote("structure.derivatives")),
        *_judge_derivatives(declared),
        *_find_misdirected_derivatives(declared),
    ]
    doubts = [
        Breach(f"{v} is the derivative of {of}, but {listed} lacks it.", quote("structure.missing"))
        for v, of in find_unlisted_derivatives(declared, subject)
    ]
    return judge_problems(problems, f"{len(listed.unknowns)} state derivatives are listed.", doubts)


def find_unlisted_derivatives(
    declared: Declarations, subject: Subject
) -> Iterator[tuple[DeclaredVariable, DeclaredVariable]]:
    """Yield derivatives of what looks like a continuous-time state, which the list lacks, and these states.

    Outputs may be derivatives of other outputs, and a co-simulation need not list any.
    """
    listed, states = set(declared.derivatives.indices), declared.states()
    if "ModelExchange" not in subject.kinds and not listed:
        return
    for variable in declared.variables:
        state = declared.variable(variable.derivative)
        if state is None or variable.index in listed or state.index in states:
            continue
        is_continuous = state.variability == "continuous" and state.causality in _OF_STATES
        if is_continuous and state.initial == "exact" and variable.causality != "input":
            yield variable, state


def _judge_derivatives(declared: Declarations) -> Iterator[Problem]:
    """Yield problems with the listed derivatives and their states."""
    listed = declared.derivatives
    for variable in listed.variables:
        state = declared.variable(variable.derivative)
        if variable.derivative is None:
            message = f"{variable} is listed in {listed}, but has no attribute `derivative`."
            yield Breach(message, _DEFINED_STATES)
        elif state and (state.causality not in _OF_STATES or state.variability != "continuous"):
            message_start = f"The state {state} is {state.variability} and {state.causality}"
            yield Breach(f"{message_start}; it must be continuous, and local or an output.", _STATES)
        if variable.variability != "continuous" or not variable.is_real:
            message = (
                f"{variable} is a state derivative, but {variable.variability}, of type {variable.type}."
            )
            yield Breach(message, quote("structure.continuous"))
    states_by_derivative = {v.index: v.derivative for v in listed.variables if v.derivative is not None}
    for index in find_repeated(states_by_derivative.values()):
        message = f"More than one of {listed} is the derivative of {declared.variable(index) or index}."
        yield Breach(message, _DEFINED_STATES)


def _judge_clocked_states(declared: Declarations) -> Iterator[Problem]:
    """Yield problems with ClockedState of FMI 3.0."""
    yield from _find_invalid_indices(declared.clocked_states, declared, _CLOCKED)
    for variable in declared.clocked_states.variables:
        if variable.variability != "discrete" or variable.clocks is None or variable.type == "Clock":
            kind = f"{variable.variability}, of type {variable.type}"
            has = "no Clock" if variable.clocks is None else "a Clock"
            yield Breach(f"{variable} is listed in ClockedState, but is {kind}, and has {has}.", _CLOCKED)
        elif variable.previous is None:
            yield Breach(f"{variable} is listed in ClockedState, but has no previous value.", _PREVIOUS)


def _judge_event_indicators(declared: Declarations) -> Iterator[Problem]:
    """Yield problems with EventIndicator of FMI 3.0."""
    yield from _find_invalid_indices(declared.event_indicators, declared, _INDICATORS)
    for variable in declared.event_indicators.variables:
        if variable.variability != "continuous" or not variable.is_real:
            kind = f"{variable.variability}, of type {variable.type}"
            yield Breach(f"{variable} is listed in EventIndicator, but is {kind}.", _INDICATORS)
        elif variable.causality not in _OF_STATES:
            message = f"{variable} is listed in EventIndicator, but has the causality {variable.causality}."
            yield Breach(message, _STATES)


def _find_misdirected_derivatives(declared: Declarations) -> Iterator[Problem]:
    """Yield derivatives of what is not another Real variable."""
    for variable in declared.variables:
        index = variable.derivative
        if index is None:
            continue
        if (state := declared.variable(index)) is None:
            message = f"{variable} is the derivative of {declared.describe_missing(index)}."
            yield Breach(message, _DERIVATIVE)
        elif state is variable:
            yield Breach(f"{variable} is its own derivative.", _DERIVATIVE)
        elif not state.is_real:
            message = f"{variable} is the derivative of {state}, which is of type {state.type}."
            yield Breach(message, _DERIVATIVE)


@check("structure.initial_unknowns", needs=("structure.derivatives",))
def initial_unknowns(subject: Subject) -> CheckOutcome:
    """Check that InitialUnknowns lists what initialization computes, once, by ascending index."""
    declared = subject.declared
    listed = declared.initial_unknowns
    doubtful = {
        v.index for v in declared.variables if not v.is_possible or v.is_clocked
    } | list_ignored_states(subject)
    # reported as derivatives
    doubtful |= {v.index for pair in find_unlisted_derivatives(declared, subject) for v in pair}
    expected = list_initially_unknown(declared) - doubtful
    problems: list[Problem] = [
        *_find_invalid_indices(listed, declared, _INITIAL),
        *_compare_indices(listed, expected, declared, _INITIAL, doubtful),
    ]
    # the order is judged only of a list that has what it should have
    swapped = [(a, b) for a, b in pairwise(listed.unknowns) if a.index > b.index]
    if not problems and declared.version == 2 and swapped:
        before, after = swapped[0]
        message = f"InitialUnknowns has {after} after {before}, which has a greater index."
        problems.append(Breach(message, quote("structure.order")))
    return judge_problems(problems, f"{len(expected)} initial unknowns are listed, in order.")


def ignores_derivatives(subject: Subject) -> bool:
    """Return whether the FMU is a co-simulation for which the standard ignores the element Derivatives."""
    flag = "providesDirectionalDerivative" + ("s" if subject.version == 3 else "")
    return not subject.has_flag(flag, "CoSimulation") and "ModelExchange" not in subject.kinds


def list_ignored_states(subject: Subject) -> set[int]:
    """Return the indices of states and derivatives that are not outputs, if the standard ignores them."""
    declared = subject.declared
    if not ignores_derivatives(subject):
        return set()
    indices = declared.states().union(declared.derivatives.indices)
    return {i for i in indices if (v := declared.variable(i)) is not None and v.causality != "output"}


def list_initially_unknown(declared: Declarations) -> set[int]:
    """Return the indices of variables that initialization computes."""
    states_and_derivatives = declared.states().union(declared.derivatives.indices)
    return {
        v.index
        for v in declared.variables
        if v.causality == "calculatedParameter"
        or (
            (v.causality == "output" or v.index in states_and_derivatives)
            and v.initial in ("approx", "calculated")
        )
    }


def _find_invalid_indices(listed: UnknownList, declared: Declarations, clause: Clause) -> Iterator[Problem]:
    """Yield problems with the indices of a list: unknown or repeated ones, and local Clocks."""
    for unknown in listed.unknowns:
        if (variable := unknown.variable) is None:
            yield Breach(f"{listed} lists {declared.describe_missing(unknown.index)}.", clause)
        elif variable.type == "Clock" and variable.causality == "local":
            yield Breach(f"{listed} lists the local Clock {variable}.", quote("structure.local_clocks"))
    for index in find_repeated(listed.indices):
        message = f"{listed} lists {declared.variable(index) or index} more than once."
        yield Breach(message, quote("structure.no_duplicates") if clause is _INITIAL else clause)


def _compare_indices(
    listed: UnknownList,
    expected: set[int],
    declared: Declarations,
    clause: Clause,
    doubtful: Iterable[int] = (),
) -> Iterator[Problem]:
    """Yield expected indices that are missing, and listed ones that are neither expected nor doubtful."""
    if missing := expected.difference(listed.indices):
        yield Breach(f"{listed} lacks {declared.join_names(missing)}.", clause)
    if surplus := {v.index for v in listed.variables}.difference(expected, doubtful):
        yield Breach(f"{listed} lists {declared.join_names(surplus)}, which does not belong there.", clause)


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
    states = declared.states() | {of.index for _, of in find_unlisted_derivatives(declared, subject)}
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
            problems += _find_ill_formed_dependencies(
                label, unknown, declared, listed is declared.initial_unknowns
            )
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
    shared = declared.find_aliases(variable)
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
                    message = f"{unknown} depends on {declared.join_names(missing)} in {name}"
                    yield Breach(f"{message}, but not in {other_list}.", _INDEPENDENT)


def _find_ill_formed_dependencies(
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
