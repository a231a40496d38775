"""Checks of the model structure: outputs, derivatives, initial unknowns, dependencies."""

from collections.abc import Iterable, Iterator, Sequence

from ..check import check
from ..declarations import Declarations, DeclaredUnknown, DeclaredVariable, find_repeated
from ..messages import Breach, Problem, join_few_names, judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, fmi3, in_both
from ._clauses import DERIVATIVE, INDICES

_LINEAR = ("constant", "fixed", "tunable", "discrete")
"""Kinds of dependencies that only Real unknowns can have."""

_OUTPUTS = Clause(
    "2.2.8",
    "Ordered list of all outputs, in other words a list of ScalarVariable indices where every corresponding "
    'ScalarVariable must have causality = "output" (and every variable with causality="output" must be '
    "listed here).",
    in_3=fmi3(
        "2.4.8",
        "Ordered list of all outputs, in other words, a list of value references where every corresponding "
        "variable must have causality = output (and every variable with causality = output must be listed "
        "here).",
    ),
)
_DERIVATIVES = Clause(
    "2.2.8",
    "Ordered list of all state derivatives, in other words, a list of ScalarVariable indices where every "
    "corresponding ScalarVariable must be a state derivative.",
    in_3=fmi3("2.4.8", "Ordered list of value references of all derivatives of continuous states."),
)
_DEFINED_STATES = Clause(
    "2.2.7",
    "All ScalarVariables listed in this element must have attribute derivative (in order that the "
    "continuous-time states are uniquely defined).",
    in_3=fmi3("2.4.7.5", "All variables listed in these elements must have attribute derivative."),
)
_STATES = Clause(
    "2.2.7",
    '"local": Local variable that is calculated from other variables or is a continuous-time state',
    in_3=fmi3(
        "2.4.7.4", "A continuous-time state or an event indicator must have causality = local or output"
    ),
)
_INITIAL = Clause(
    "2.2.8",
    'This list consists of all variables with (1) causality = "output" and (initial="approx" or '
    '"calculated"), and (2) causality = "calculatedParameter" and (3) all continuous-time states and all '
    'state derivatives [...] with initial="approx" or "calculated"',
    in_3=fmi3("2.4.8", "Ordered list of all exposed unknowns in InitializationMode."),
)
_NO_DUPLICATES = in_both("2.2.8", "2.4.8", "The resulting list is not allowed to have duplicates")
_ORDER = Clause(
    "2.2.8",
    "The Unknowns in this list must be ordered according to their ScalarVariable index (for example, if "
    "for two variables A and B the ScalarVariable index of A is less than the index of B, then A must "
    "appear before B in InitialUnknowns).",
)
_ASCENDING = Clause(
    "2.2.8",
    "The indices are ordered according to magnitude, starting with the smallest index.",
    in_3=fmi3("2.4.8", "Otherwise the unknown depends on the knowns defined by the given value references."),
)
_KINDS = Clause(
    "2.2.8",
    'If "dependenciesKind" is present, "dependencies" must be present and must have the same number of list '
    "elements.",
    in_3=fmi3(
        "2.4.8",
        "If dependenciesKind is present, dependencies must be present and must have the same number of list "
        "elements.",
    ),
)
_REAL_KINDS = Clause(
    "2.2.8",
    "Only for Real unknowns",
    in_3=fmi3("2.4.8", "The following dependenciesKind is only allowed for floating point"),
)
_INITIAL_KINDS = Clause(
    "2.2.8",
    "and not for InitialUnknowns for Initialization Mode:",
    in_3=fmi3(
        "2.4.8",
        "The following dependenciesKind is only allowed for floating point v_unknown in EventMode and "
        "ContinuousTimeMode (ME) and at communication points (CS and SE), and not for InitialUnknown for "
        "InitializationMode:",
    ),
)
_LOCAL_CLOCKS = fmi3(
    "2.2.8.2",
    "Like all local variables, local Clocks must not be used as inputs to other FMUs and must not be listed "
    "in the ModelStructure.",
)
_CLOCKED = fmi3(
    "2.4.8",
    "All clocked states must have variability = discrete, must have the attribute clocks, and must not be of "
    "type fmi3Clock.",
)
_PREVIOUS = fmi3(
    "2.4.8",
    "Each ClockedState must have the attribute previous to represent the previous value of this "
    "ClockedState.",
)
_MISSING = Clause(
    "2.2.8",
    "A ModelExchange FMU must expose all derivatives of its continuous-time states in element Derivatives.",
    in_3=fmi3(
        "2.4.8",
        "A Model Exchange FMU must also expose all derivatives of continuous states in "
        "<ContinuousStateDerivative> and all event indicators in <EventIndicator>.",
    ),
)
_CONTINUOUS = Clause(
    "2.2.8",
    "Note that only continuous Real variables are listed here.",
    in_3=fmi3("2.4.8", "Note that only continuous floating point variables are listed here."),
)
_NONE = Clause(
    "2.2.8",
    "If present as empty list, the Unknown depends on none of the Knowns. Otherwise the Unknown depends on "
    "the Knowns defined by the given ScalarVariable indices.",
    in_3=fmi3(
        "2.4.8",
        "For a real valued unknown and a real valued known, if the known is not listed among the "
        "dependencies then the partial derivative of the unknown with respect to that known is identically "
        "zero.",
    ),
)
_INDICATORS = fmi3(
    "2.4.8",
    "Only continuous variables of type Float32 and Float64 can be referenced by EventIndicator.",
)


@check(
    "structure.outputs",
    "All outputs are listed",
    _OUTPUTS,
    "ModelStructure/Outputs needs one Unknown for each output. index counts ScalarVariables from 1.",
    needs=("description.schema",),
)
def outputs(subject: Subject) -> CheckOutcome:
    """Check that ModelStructure/Outputs lists every output once, and nothing else."""
    declared = subject.declared
    wanted = {v.index for v in declared.variables if v.causality == "output"}
    problems = [
        *_listing("Outputs", declared.outputs, declared, _OUTPUTS),
        *_compared("Outputs", wanted, declared.outputs, declared, _OUTPUTS),
    ]
    return judge_problems(problems, f"{len(wanted)} outputs are listed.")


@check(
    "structure.derivatives",
    "State derivatives refer to continuous states",
    _DEFINED_STATES,
    "Set the attribute `derivative` of the variable to the index of its state, counted from 1.",
    needs=("description.schema",),
)
def derivatives(subject: Subject) -> CheckOutcome:
    """Check that each of ModelStructure/Derivatives is the derivative of a different continuous state."""
    declared = subject.declared
    problems = [
        *_clocked_states(declared),
        *_event_indicators(declared),
        *_listing("Derivatives", declared.derivatives, declared, _DERIVATIVES),
        *_no_derivatives(declared),
        *(p for v in declared.variables for p in _misdirected(v, declared)),
    ]
    doubts = [
        Breach(f"{v} is the derivative of {of}, but {declared.list_name('Derivatives')} lacks it.", _MISSING)
        for v, of in _unlisted(declared, subject)
    ]
    return judge_problems(problems, f"{len(declared.derivatives)} state derivatives are listed.", doubts)


def _unlisted(
    declared: Declarations, subject: Subject
) -> Iterator[tuple[DeclaredVariable, DeclaredVariable]]:
    """Yield derivatives of what looks like a continuous-time state, which the list lacks, and these states.

    Outputs may be derivatives of other outputs, and a co-simulation need not list any.
    """
    if "ModelExchange" not in subject.kinds and not declared.derivatives:
        return
    listed, states = {u.index for u in declared.derivatives}, declared.states()
    for variable in declared.variables:
        of = declared.variable(int(variable.own.get("derivative", 0)))
        if of is None or variable.index in listed or of.index in states:
            continue
        is_state = of.causality in ("local", "output") and of.initial == "exact"
        if is_state and of.variability == "continuous" and variable.causality != "input":
            yield variable, of


def _no_derivatives(declared: Declarations) -> Iterator[Problem]:
    """Yield problems with the states of the listed derivatives."""
    listed_ones = _listed_variables(declared.derivatives, declared)
    for variable in listed_ones:
        if "derivative" not in variable.own:
            listed = declared.list_name("Derivatives")
            what = f"{variable} is listed in {listed}, but has no attribute `derivative`."
            yield Breach(what, _DEFINED_STATES)
        elif (state := declared.variable(int(variable.own["derivative"]))) is not None and (
            state.causality not in ("local", "output") or state.variability != "continuous"
        ):
            has = f"The state {state} is {state.variability} and {state.causality}"
            yield Breach(f"{has}; it must be continuous, and local or an output.", _STATES)
        if variable.variability != "continuous" or not variable.is_real:
            what = f"{variable} is a state derivative, but {variable.variability}, of type {variable.type}."
            yield Breach(what, _CONTINUOUS)
    states = [
        v.own["derivative"].strip()
        for v in {v.index: v for v in listed_ones}.values()
        if "derivative" in v.own
    ]
    for index in find_repeated(states):
        listed = declared.list_name("Derivatives")
        what = f"More than one of {listed} is the derivative of {declared.variable(int(index)) or index}."
        yield Breach(what, _DEFINED_STATES)


def _clocked_states(declared: Declarations) -> Iterator[Problem]:
    """Yield problems with ClockedState of FMI 3.0."""
    yield from _listing("ClockedState", declared.clocked_states, declared, _CLOCKED)
    for variable in _listed_variables(declared.clocked_states, declared):
        if variable.variability != "discrete" or variable.clocks is None or variable.type == "Clock":
            kind = f"{variable.variability}, of type {variable.type}"
            has = "no Clock" if variable.clocks is None else "a Clock"
            yield Breach(f"{variable} is listed in ClockedState, but is {kind}, and has {has}.", _CLOCKED)
        elif variable.previous is None:
            yield Breach(f"{variable} is listed in ClockedState, but has no previous value.", _PREVIOUS)


def _event_indicators(declared: Declarations) -> Iterator[Problem]:
    """Yield problems with EventIndicator of FMI 3.0."""
    yield from _listing("EventIndicator", declared.event_indicators, declared, _INDICATORS)
    for variable in _listed_variables(declared.event_indicators, declared):
        if variable.variability != "continuous" or not variable.is_real:
            kind = f"{variable.variability}, of type {variable.type}"
            yield Breach(f"{variable} is listed in EventIndicator, but is {kind}.", _INDICATORS)
        elif variable.causality not in ("local", "output"):
            what = f"{variable} is listed in EventIndicator, but has the causality {variable.causality}."
            yield Breach(what, _STATES)


def _listed_variables(unknowns: Iterable[DeclaredUnknown], declared: Declarations) -> list[DeclaredVariable]:
    return [v for u in unknowns if (v := declared.variable(u.index)) is not None]


def _misdirected(variable: DeclaredVariable, declared: Declarations) -> Iterator[Problem]:
    if "derivative" not in variable.own:
        return
    index = int(variable.own["derivative"])
    of = declared.variable(index)
    if of is None:
        what = f"{variable} is the derivative of {declared.describe_missing(index)}."
        yield Breach(what, DERIVATIVE)
    elif of.index == variable.index:
        yield Breach(f"{variable} is its own derivative.", DERIVATIVE)
    elif not of.is_real:
        yield Breach(f"{variable} is the derivative of {of}, which is of type {of.type}.", DERIVATIVE)


@check(
    "structure.initial_unknowns",
    "All initial unknowns are listed, in order",
    _INITIAL,
    "List outputs, states and derivatives that are `calculated` or `approx`, and calculated parameters.",
    needs=("structure.derivatives",),
)
def initial_unknowns(subject: Subject) -> CheckOutcome:
    """Check that InitialUnknowns lists what initialization computes, once, by ascending index."""
    declared = subject.declared
    found = [u.index for u in declared.initial_unknowns]
    doubtful = {v.index for v in declared.variables if not v.possible or v.is_clocked} | _ignored(subject)
    doubtful |= {v.index for pair in _unlisted(declared, subject) for v in pair}  # reported as derivatives
    wanted = _initially_unknown(declared) - doubtful
    problems: list[Problem] = [
        *_listing("InitialUnknowns", declared.initial_unknowns, declared, _INITIAL),
        *_compared("InitialUnknowns", wanted, declared.initial_unknowns, declared, _INITIAL, doubtful),
    ]
    if not problems and declared.version == 2 and found != sorted(found):
        k = next(k for k in range(1, len(found)) if found[k] < found[k - 1])
        what = (
            f"InitialUnknowns has {declared.variable(found[k])} after {declared.variable(found[k - 1])}, "
            "which has a greater index."
        )
        problems.append(Breach(what, _ORDER))
    return judge_problems(problems, f"{len(wanted)} initial unknowns are listed, in order.")


def _ignores_derivatives(subject: Subject) -> bool:
    """Return whether the FMU is a co-simulation for which the standard ignores the element Derivatives."""
    flag = "providesDirectionalDerivative" + ("s" if subject.version == 3 else "")
    return not subject.has_flag(flag, "CoSimulation") and "ModelExchange" not in subject.kinds


def _ignored(subject: Subject) -> set[int]:
    """Return states and derivatives of an FMU for which the standard ignores the element Derivatives."""
    declared = subject.declared
    if not _ignores_derivatives(subject):
        return set()
    found = declared.states() | {u.index for u in declared.derivatives}
    return {i for i in found if (v := declared.variable(i)) is not None and v.causality != "output"}


def _initially_unknown(declared: Declarations) -> set[int]:
    either = declared.states() | {u.index for u in declared.derivatives}
    return {
        v.index
        for v in declared.variables
        if v.causality == "calculatedParameter"
        or ((v.causality == "output" or v.index in either) and v.initial in ("approx", "calculated"))
    }


@check(
    "structure.dependencies",
    "Dependencies are on variables that are known",
    _ASCENDING,
    "`dependencies` lists indices of inputs, states and the independent variable; in InitialUnknowns also "
    "of `exact` variables. `dependenciesKind` has one word for each.",
    needs=("structure.derivatives",),
)
def dependencies(subject: Subject) -> CheckOutcome:
    """Check that dependencies exist, ascend, refer to knowns, and have a kind each or none."""
    declared = subject.declared
    states = declared.states() | {of.index for _, of in _unlisted(declared, subject)}
    known = states | _free(declared)
    if declared.version == 3:  # parameters, and states between events, which need not be listed
        known |= {
            v.index for v in declared.variables if v.causality == "parameter" or v.variability == "discrete"
        }
    exact = _free(declared) | {v.index for v in declared.variables if v.initial == "exact"}
    lists = [
        ("Outputs", declared.outputs, known),
        ("Derivatives", declared.derivatives, known),
        ("InitialUnknowns", declared.initial_unknowns, exact),
    ]
    computed = {v.index for v in declared.variables}
    if _ignores_derivatives(subject):  # dependencies leave out its states
        computed -= declared.states()
    problems: list[Problem] = []
    doubts: list[Problem] = []
    for name, unknowns, knowns in lists:
        computed_knowns = knowns & computed
        for unknown in unknowns:
            who = f"{declared.variable(unknown.index) or unknown.index} in {declared.list_name(name)}"
            problems += _ill_formed(who, unknown, declared)
            if name == "InitialUnknowns":
                problems += _later_kinds(who, unknown)
            doubts += _unknown_knowns(who, unknown, knowns, declared)
            problems += _lacks_alias(who, unknown, computed_knowns, declared)
    if not problems:
        doubts += _unlike_initial(declared, states & computed)
    count = sum(len(u.dependencies or ()) for _, unknowns, _ in lists for u in unknowns)
    return judge_problems(problems, f"{count} dependencies are on variables that are known.", doubts)


def _lacks_alias(
    who: str, unknown: DeclaredUnknown, knowns: set[int], declared: Declarations
) -> Iterator[Problem]:
    """Yield an unknown that is an alias of a known variable, but does not depend on it."""
    variable = declared.variable(unknown.index)
    if variable is None or variable.index in knowns or unknown.dependencies is None:
        return  # exporters differ in whether a known variable depends on itself
    shared = declared.share_value(variable)
    same = [v for v in shared if v.index in knowns and v.variability != "constant"]
    if same and not {v.index for v in same}.intersection(unknown.dependencies):
        yield Breach(f"{who} has the value of {same[0]}, but its dependencies lack it.", _NONE)


def _unlike_initial(declared: Declarations, states: set[int]) -> Iterator[Problem]:
    """Yield knowns on which an unknown depends only at the start, or only later, by what is declared.

    States that are unknown at the start pass on what they depend on there, or are chosen for a steady state.
    """
    initially = {u.index: u.dependencies for u in declared.initial_unknowns}
    unknown_states = [i for i in declared.states() if (v := declared.variable(i)) and v.initial != "exact"]
    if any(initially.get(i) is None for i in unknown_states):
        return
    passed_on = {k for i in unknown_states for k in initially[i] or ()}
    exact = states.difference(unknown_states)
    both = exact | _free(declared) if not unknown_states else set()
    initial_list = declared.list_name("InitialUnknowns")
    for name, unknowns in (("Outputs", declared.outputs), ("Derivatives", declared.derivatives)):
        for unknown in unknowns:
            variable, first = declared.variable(unknown.index), initially.get(unknown.index)
            if variable is None or variable.variability != "continuous":
                continue
            if first is None or unknown.dependencies is None:
                continue
            lacks = exact.intersection(first).difference(unknown.dependencies, passed_on)
            yield from _depends_in_one(variable, lacks, initial_list, declared.list_name(name), declared)
            lacks = both.intersection(unknown.dependencies).difference(first)
            yield from _depends_in_one(variable, lacks, declared.list_name(name), initial_list, declared)


def _depends_in_one(
    variable: DeclaredVariable, lacks: set[int], name: str, other: str, declared: Declarations
) -> Iterator[Problem]:
    if lacks:
        names = join_few_names(_names(sorted(lacks), declared))
        yield Breach(f"{variable} depends on {names} in {name}, but not in {other}.", _NONE)


def _free(declared: Declarations) -> set[int]:
    return {v.index for v in declared.variables if v.causality in ("input", "independent")}


def _ill_formed(who: str, unknown: DeclaredUnknown, declared: Declarations) -> Iterator[Problem]:
    indices, kinds = unknown.dependencies, unknown.kinds
    beyond = [i for i in indices or () if declared.variable(i) is None]
    if beyond:
        yield Breach(f"{who} depends on {declared.describe_missing(beyond[0])}.", INDICES)
    elif declared.version == 2 and indices is not None and list(indices) != sorted(set(indices)):
        yield Breach(f"The dependencies of {who} are not in ascending order.", _ASCENDING)
    if kinds is None:
        return
    if len(indices or ()) != len(kinds) or indices is None:
        yield Breach(f"{who} has {len(kinds)} kinds for {len(indices or ())} dependencies.", _KINDS)
    variable = declared.variable(unknown.index)
    linear = [kind for kind in kinds if kind in _LINEAR]
    if variable is not None and not variable.is_real and linear:
        what = f"{who} is of type {variable.type}, but has a dependency of the kind {linear[0]}."
        yield Breach(what, _REAL_KINDS)


def _later_kinds(who: str, unknown: DeclaredUnknown) -> Iterator[Problem]:
    """Yield kinds of dependencies that do not exist before the initialization ends."""
    later = [kind for kind in unknown.kinds or () if kind in _LINEAR and kind != "constant"]
    if later:
        yield Breach(f"{who} has a dependency of the kind {later[0]}.", _INITIAL_KINDS)


def _unknown_knowns(
    who: str, unknown: DeclaredUnknown, knowns: set[int], declared: Declarations
) -> Iterator[Problem]:
    others = [
        v for i in unknown.dependencies or () if i not in knowns and (v := declared.variable(i)) is not None
    ]
    if others:
        what = (
            f"{who} depends on {join_few_names([v.name for v in others])}, which is not known when it is "
            "computed."
        )
        yield Breach(what, INDICES)


def _listing(
    name: str, unknowns: Sequence[DeclaredUnknown], declared: Declarations, clause: Clause
) -> Iterator[Problem]:
    """Yield problems with the indices of a list: unknown or repeated ones, and local Clocks."""
    name = declared.list_name(name)
    for unknown in unknowns:
        if (variable := declared.variable(unknown.index)) is None:
            yield Breach(f"{name} lists {declared.describe_missing(unknown.index)}.", clause)
        elif variable.type == "Clock" and variable.causality == "local":
            yield Breach(f"{name} lists the local Clock {variable}.", _LOCAL_CLOCKS)
    for twice in find_repeated(str(u.index) for u in unknowns):
        what = f"{name} lists {declared.variable(int(twice)) or twice} more than once."
        yield Breach(what, _NO_DUPLICATES if clause is _INITIAL else clause)


def _compared(
    name: str,
    wanted: set[int],
    unknowns: Sequence[DeclaredUnknown],
    declared: Declarations,
    clause: Clause,
    doubtful: Iterable[int] = (),
) -> Iterator[Problem]:
    """Yield wanted indices that are missing, and listed ones that are neither wanted nor doubtful."""
    name, found = declared.list_name(name), {u.index for u in unknowns}
    if missing := sorted(wanted - found):
        yield Breach(f"{name} lacks {join_few_names(_names(missing, declared))}.", clause)
    if surplus := [i for i in sorted(found.difference(wanted, doubtful)) if declared.variable(i) is not None]:
        what = f"{name} lists {join_few_names(_names(surplus, declared))}, which does not belong there."
        yield Breach(what, clause)


def _names(indices: Iterable[int], declared: Declarations) -> list[str]:
    return [str(declared.variable(i)) for i in indices]
