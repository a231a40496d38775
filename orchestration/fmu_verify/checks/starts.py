"""Checks of start values: present where required, and within their ranges."""

import math
from collections.abc import Iterator, Mapping

from ..check import CheckOutcome, check, quote
from ..declarations import NUMERIC, DeclaredVariable
from ..messages import Breach, Problem, judge_problems
from ..subject import Subject

_REQUIRED = quote("variables.start")
_ALWAYS_REQUIRED = quote("starts.always_required")
_FORBIDDEN = quote("starts.forbidden")
_ORDERED = quote("variables.range")
_FINITE = quote("starts.finite")
_NOMINAL = quote("starts.nominal")


@check("variables.start", needs=("description.schema",))
def presence(subject: Subject) -> CheckOutcome:
    """Check that variables have a start value if and only if the standard requires one."""
    variables = [v for v in subject.declared.variables if v.possible and v.type != "Clock"]
    problems = [p for v in variables for p in _find_misplaced(v)]
    fine = f"{sum(v.start is not None for v in variables)} variables have start values."
    return judge_problems(problems, fine)


def _find_misplaced(variable: DeclaredVariable) -> Iterator[Problem]:
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
    """Check that start values are finite, within min and max, and items of their enumerations."""
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
