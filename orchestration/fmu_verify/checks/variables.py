"""Checks of variables: names, attributes, aliases, types and start values."""

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from ..check import CheckOutcome, check, quote
from ..declarations import NUMERIC, Declarations, DeclaredVariable, find_repeated
from ..messages import Breach, Problem, judge_problems
from ..subject import Subject

_NONDIGIT = "_a-zA-Z"
_QUOTED = r"'(?:[_a-zA-Z0-9!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+'"
_PART = rf"(?:[{_NONDIGIT}][{_NONDIGIT}0-9]*|{_QUOTED})(?:\[[0-9]+(?:,[0-9]+)*\])?"
_IDENTIFIER = rf"{_PART}(?:\.{_PART})*"
_STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,[0-9]+)?\)")

_ONE_INDEPENDENT = quote("variables.one_independent")
_INDEPENDENT = quote("variables.independent")
_INITIAL = quote("variables.initial")
_REFERENCES = quote("variables.references")
_INTERMEDIATE = quote("variables.intermediate")
_REINIT = quote("variables.reinit")
_MODEL_EXCHANGE = quote("variables.model_exchange")
_ONE_START = quote("variables.aliases")
_SETTABLE = quote("variables.settable")
_ORDER = ("constant", "fixed", "tunable", "discrete", "continuous")
_SAME_UNIT = quote("variables.same_unit")


@check("variables.names", needs=("description.schema",))
def names(subject: Subject) -> CheckOutcome:
    """Check that names are unique, and structured if the FMU declares it."""
    all_names = [name for v in subject.declared.variables for name in (v.name, *v.aliases)]
    problems: list[Problem] = [
        f"More than one variable has the name {name}." for name in find_repeated(all_names)
    ]
    problems += [f"Variable {i} has no name." for i, name in enumerate(all_names, start=1) if not name]
    if subject.tree.get("variableNamingConvention") == "structured":
        problems += [
            Breach(f"{name} is not a structured name.", quote("variables.grammar"))
            for name in all_names
            if name and not _STRUCTURED.fullmatch(name)
        ]
    return judge_problems(problems, f"{len(all_names)} variables have unique names.")


@check("variables.attributes", needs=("description.schema",))
def attributes(subject: Subject) -> CheckOutcome:
    """Check that causality, variability, initial and type of every variable are compatible."""
    declared = subject.declared
    problems: list[Problem] = [p for v in declared.variables for p in _find_impossible_attributes(v)]
    independent = [v.name for v in declared.variables if v.causality == "independent"]
    if len(independent) > 1:
        message = f"Both {independent[0]} and {independent[1]} are independent."
        problems.append(Breach(message, _ONE_INDEPENDENT))
    if "ModelExchange" in subject.kinds:
        problems += _find_reinitialized(declared)
    if declared.version == 3 or "ModelExchange" in subject.kinds:
        problems += _find_set_once(declared)
    if declared.version == 3:
        problems += _judge_version_3(declared, independent)
    elif "ModelExchange" not in subject.kinds:
        problems += [p for v in declared.variables for p in _find_model_exchange_attributes(v)]
    return judge_problems(problems, f"{len(declared.variables)} variables have compatible attributes.")


def _find_impossible_attributes(variable: DeclaredVariable) -> Iterator[Problem]:
    """Yield what is wrong with the causality, variability, initial and type of a variable together."""
    message = f"{variable} is {variable.variability} and {_add_article(variable.causality)}"
    if variable.initials is None:
        yield f"{message}, which the standard does not allow."
    elif not variable.is_possible:
        yield Breach(f"{message}; its initial cannot be {variable.declared_initial}.", _INITIAL)
    if variable.variability == "continuous" and not variable.is_real:
        only = "Float32 and Float64" if variable.version == 3 else "a Real"
        message = f"{variable} is continuous, but of type {variable.type}; only {only} can be."
        yield Breach(message, quote("variables.continuous"))


def _judge_version_3(declared: Declarations, independent: Sequence[str]) -> Iterator[Problem]:
    """Yield problems with attributes that only FMI 3.0 has or restricts."""
    if not independent:
        yield Breach("No variable is independent.", _ONE_INDEPENDENT)
    for variable in declared.variables:
        if variable.causality == "independent" and not variable.is_real:
            yield Breach(f"{variable} is independent, but of type {variable.type}.", _INDEPENDENT)
        if (
            variable.own_attributes.get("intermediateUpdate") in ("true", "1")
            and variable.variability != "continuous"
        ):
            yield Breach(f"{variable} has intermediateUpdate, but is {variable.variability}.", _INTERMEDIATE)


def _find_set_once(declared: Declarations) -> Iterator[Problem]:
    """Yield variables that can be set only once at a time, but are not inputs."""
    for variable in declared.variables:
        if variable.multiple_sets in ("false", "0") and variable.causality != "input":
            message = f"{variable} has canHandleMultipleSetPerTimeInstant = false, but is"
            yield Breach(f"{message} {_add_article(variable.causality)}.", quote("variables.multiple_sets"))


def _find_reinitialized(declared: Declarations) -> Iterator[Problem]:
    """Yield variables with the attribute reinit that are neither states nor aliases of states."""
    states = {v.value_key for i in declared.states() if (v := declared.variable(i)) is not None}
    for variable in declared.variables:
        if "reinit" in variable.own_attributes and variable.value_key not in states:
            yield Breach(f"{variable} has reinit, but is not a continuous-time state.", _REINIT)


def _find_model_exchange_attributes(variable: DeclaredVariable) -> Iterator[Problem]:
    """Yield attributes that only variables for Model Exchange have."""
    has = {
        "reinit": "reinit" in variable.own_attributes,
        "canHandleMultipleSetPerTimeInstant": variable.multiple_sets != "",
    }
    for attribute in (name for name, present in has.items() if present):
        yield Breach(f"{variable} has {attribute}, which is for Model Exchange only.", _MODEL_EXCHANGE)


def _add_article(causality: str) -> str:
    if causality in ("local", "independent"):
        return causality
    return f"an {causality}" if causality[0] in "aeiou" else f"a {causality}"


@check("variables.aliases", needs=("description.schema",))
def aliases(subject: Subject) -> CheckOutcome:
    """Check that aliases agree in unit and variability, and that at most one has a start value."""
    if subject.version == 3:
        return _judge_value_references(subject.declared)
    sets = subject.declared.alias_sets
    problems = [p for alias_set in sets for p in _judge_aliases(alias_set)]
    doubts = [p for alias_set in sets for p in _find_lower_variability(alias_set)]
    fine = f"{len(sets)} value references are shared, by compatible variables."
    return judge_problems(problems, fine, doubts)


def _judge_value_references(declared: Declarations) -> CheckOutcome:
    """Judge value references of FMI 3.0, in which aliases are elements of their variable."""
    names_by_reference: dict[int, list[str]] = defaultdict(list)
    for variable in declared.variables:
        names_by_reference[variable.reference].append(variable.name)
    problems = [
        Breach(f"{names[0]} and {names[1]} have the same value reference {reference}.", _REFERENCES)
        for reference, names in names_by_reference.items()
        if len(names) > 1
    ]
    return judge_problems(problems, f"{len(declared.variables)} variables have different value references.")


def _find_lower_variability(alias_set: Sequence[DeclaredVariable]) -> Iterator[Problem]:
    """Yield outputs that claim to change less often than an alias, which has the same value."""
    if any(v.causality in ("input", "parameter", "independent") for v in alias_set):
        return
    # an alias has the value of all others, and changes as often
    highest = max(alias_set, key=lambda v: _ORDER.index(v.variability))
    for lower in alias_set:
        if lower.causality == "output" and "constant" != lower.variability != highest.variability:
            message = f"{lower} is {lower.variability}, but {highest} with the same value reference is"
            yield Breach(f"{message} {highest.variability}.", quote("variables.highest"))


def _judge_aliases(alias_set: Sequence[DeclaredVariable]) -> Iterator[Problem]:
    """Yield what is wrong with variables that have the same value reference."""
    label = (
        f"{alias_set[0]} and {alias_set[1]}"
        if len(alias_set) == 2
        else f"{alias_set[0]} and its {len(alias_set) - 1} aliases"
    )
    constant = [v for v in alias_set if v.variability == "constant"]
    started = [v.name for v in alias_set if v.start is not None and v.variability != "constant"]
    if len(started) > 1:
        names = f"{started[0]} and {started[1]}"
        yield Breach(f"{names} have the same value reference, but both have a start value.", _ONE_START)
    if constant and len(constant) < len(alias_set):
        yield Breach(
            f"{label} have the same value reference, but only some of them are constant.",
            quote("variables.constant"),
        )
    elif len({v.start for v in constant}) > 1:
        yield Breach(
            f"{label} have the same value reference, but different constant values.",
            quote("variables.same_constant"),
        )
    if started and any(v.causality == "independent" for v in alias_set):
        yield Breach(f"{started[0]} has the value reference of the independent variable.", _SETTABLE)
    if len({v.unit for v in alias_set}) > 1:
        yield Breach(f"{label} have the same value reference, but different units.", _SAME_UNIT)


_DEFINED = quote("description.types")


@check("description.types", needs=("description.schema",))
def types(subject: Subject) -> CheckOutcome:
    """Check that every declared type is defined once and matches the type of its variables."""
    declared = subject.declared
    problems = [*_judge_type_names(declared), *_judge_type_uses(declared)]
    problems += [
        Breach(
            f"More than one item of the enumeration {type_.name} has the {attribute} {repeated}.",
            quote("types.items"),
        )
        for type_ in declared.types
        for attribute in ("name", "value")
        for repeated in find_repeated(item[attribute] for item in type_.items)
    ]
    return judge_problems(problems, f"{len(declared.types)} types are defined and used correctly.")


def _judge_type_names(declared: Declarations) -> Iterator[Problem]:
    """Yield type definitions with the same name, or with that of a variable."""
    variables = {v.name for v in declared.variables}
    for name in find_repeated(t.name for t in declared.types):
        yield Breach(
            f"More than one {_name_type_element(declared)} has the name {name}.", quote("types.unique")
        )
    for type_ in declared.types:
        if type_.name in variables:
            yield Breach(
                f"The {_name_type_element(declared)} {type_.name} has the name of a variable.",
                quote("types.no_variable"),
            )


def _name_type_element(declared: Declarations) -> str:
    return "type definition" if declared.version == 3 else "SimpleType"


def _judge_type_uses(declared: Declarations) -> Iterator[Problem]:
    """Yield variables whose declared type does not exist, or is of another type."""
    by_name = {t.name: t for t in declared.types}
    for variable in declared.variables:
        name = variable.own_attributes.get("declaredType")
        if name is None:
            continue
        if name not in by_name:
            message = f"{variable} is declared as {name}, which is not a {_name_type_element(declared)}."
            yield Breach(message, _DEFINED)
        elif by_name[name].type != variable.type:
            expected = by_name[name].type
            message = f"{variable} is of type {variable.type}, but declared as {name}, which is {expected}."
            yield Breach(message, _DEFINED)


_REQUIRED = quote("variables.start")
_ALWAYS_REQUIRED = quote("starts.always_required")
_FORBIDDEN = quote("starts.forbidden")
_ORDERED = quote("variables.range")
_FINITE = quote("starts.finite")
_NOMINAL = quote("starts.nominal")


@check("variables.start", needs=("description.schema",))
def presence(subject: Subject) -> CheckOutcome:
    """Check that variables have a start value if and only if the standard requires one."""
    variables = [v for v in subject.declared.variables if v.is_possible and v.type != "Clock"]
    problems = [p for v in variables for p in _find_misplaced_starts(v)]
    fine = f"{sum(v.start is not None for v in variables)} variables have start values."
    return judge_problems(problems, fine)


def _find_misplaced_starts(variable: DeclaredVariable) -> Iterator[Problem]:
    """Yield a missing start value, or one that is not allowed."""
    causalities = ("input", "parameter", "structuralParameter")
    is_required = variable.causality in causalities or variable.variability == "constant"
    if variable.causality == "independent":
        if variable.start is not None:
            yield Breach(f"{variable} is independent, but has a start value.", _FORBIDDEN)
    elif is_required or variable.initial in ("exact", "approx"):
        if variable.start is None:
            yield Breach(f"{variable} has no start value.", _ALWAYS_REQUIRED if is_required else _REQUIRED)
    elif variable.start is not None:
        yield Breach(f"{variable} is calculated, but has a start value.", _FORBIDDEN)


@check("variables.range", needs=("description.types",))
def ranges(subject: Subject) -> CheckOutcome:
    """Check that start values are finite, in range, and items of enumerations; nominals must be positive."""
    declared = subject.declared
    numeric = [v for v in declared.variables if v.type in NUMERIC]
    items = {t.name: {int(item["value"]) for item in t.items} for t in declared.types}
    problems = [p for v in numeric for p in _find_wrong_starts(v, items)]
    doubts = [
        f"The {name} of {v} is {v.attributes[name]}; it should be a finite number."
        for v in numeric
        for name in ("min", "max", "nominal")
        if not math.isfinite(float(v.attributes.get(name, 0.0)))
    ]
    if subject.version == 3:  # which does not say that they must be
        doubts += [str(getattr(p, "message", p)) for p in problems if _is_left_open(p)]
        problems = [p for p in problems if not _is_left_open(p)]
    fine = f"Start values of {len(numeric)} numeric variables are within their ranges."
    return judge_problems(problems, fine, doubts)


def _is_left_open(problem: Problem) -> bool:
    """Return whether FMI 3.0 has no sentence on it: values that are not finite, and nominal values."""
    return isinstance(problem, Breach) and problem.clause in (_FINITE, _NOMINAL)


def _find_wrong_starts(variable: DeclaredVariable, items: Mapping[str, set[int]]) -> Iterator[Problem]:
    """Yield what is wrong with each different start value."""
    # in FMI 3.0, an array has several
    starts = (variable.start or "").split() if variable.version == 3 else [variable.start]
    for start in dict.fromkeys(starts) or [None]:
        attributes = {name: text for name, text in variable.attributes.items() if name != "start"}
        attributes |= {} if start is None else {"start": start}
        yield from _judge_start(variable, attributes, items)


def _judge_start(
    variable: DeclaredVariable, attributes: Mapping[str, str], items: Mapping[str, set[int]]
) -> Iterator[Problem]:
    """Yield what is wrong with one start value, and with min, max and nominal."""
    names = ("start", "min", "max", "nominal")
    values = {name: float(attributes[name]) for name in names if name in attributes}
    if not math.isfinite(values.get("start", 0.0)):
        yield Breach(f"The start value of {variable} is {attributes['start']}, not a finite number.", _FINITE)
        return
    low, high = values.get("min", -math.inf), values.get("max", math.inf)
    start = values.get("start", low)
    if low > high:
        yield Breach(f"{variable} has the min {low:g}, which is above its max {high:g}.", _ORDERED)
    elif not low <= start <= high:
        violation = f"below its min {low:g}" if start < low else f"above its max {high:g}"
        yield Breach(f"The start value {start:g} of {variable} is {violation}.", _ORDERED)
    elif (
        variable.type == "Enumeration"
        and "start" in values
        and start not in items[attributes["declaredType"]]
    ):
        message = f"The start value {start:g} of {variable} is not an item of {attributes['declaredType']}."
        yield Breach(message, quote("starts.item"))
    if values.get("nominal", 1.0) <= 0.0:
        yield Breach(f"{variable} has the nominal {values['nominal']:g}; it must be positive.", _NOMINAL)
