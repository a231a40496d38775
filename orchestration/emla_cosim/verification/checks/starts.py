"""Checks of start values: present where required, and within their ranges."""

import math
from collections.abc import Iterator, Mapping

from ..check import check
from ..declarations import DeclaredVariable
from ..messages import judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, Clause

_NUMERIC = ("Real", "Integer", "Enumeration")


@check(
    "variables.start",
    "Variables have the required start values",
    Clause(
        "2.2.7", 'If initial = "exact" or "approx", or causality = "input", a start value must be provided.'
    ),
    "Add or remove the start value as `initial` requires. Its defaults are in the table of section 2.2.7.",
    needs=("description.schema",),
)
def presence(subject: Subject) -> CheckOutcome:
    """Check that variables have a start value if and only if the standard requires one."""
    variables = [v for v in subject.declared.variables if v.possible]
    problems = [p for v in variables for p in _misplaced(v)]
    return judge_problems(
        problems, f"{sum(v.start is not None for v in variables)} variables have start values."
    )


def _misplaced(variable: DeclaredVariable) -> Iterator[str]:
    needed = variable.causality in ("input", "parameter") or variable.variability == "constant"
    if variable.causality == "independent":
        if variable.start is not None:
            yield f"{variable} is independent, but has a start value."
    elif needed or variable.initial in ("exact", "approx"):
        if variable.start is None:
            yield f"{variable} has no start value."
    elif variable.start is not None:
        yield f"{variable} is calculated, but has a start value."


@check(
    "variables.range",
    "Start values are within their ranges",
    Clause("fmi2ScalarVariable.xsd", "max >= start >= min required"),
    "Correct the start value, or min and max. nominal must be positive.",
    needs=("description.types",),
)
def ranges(subject: Subject) -> CheckOutcome:
    """Check that start values are finite, within min and max, and items of their enumerations."""
    declared = subject.declared
    numeric = [v for v in declared.variables if v.type in _NUMERIC]
    items = {t.name: {int(item["value"]) for item in t.items} for t in declared.types}
    problems = [p for v in numeric for p in _wrong(v, items)]
    doubts = [p for v in numeric for p in _endless(v)]
    return judge_problems(
        problems, f"Start values of {len(numeric)} numeric variables are within their ranges.", doubts
    )


def _wrong(variable: DeclaredVariable, items: Mapping[str, set[int]]) -> Iterator[str]:
    given = variable.attributes
    values = {name: float(given[name]) for name in ("start", "min", "max", "nominal") if name in given}
    if not math.isfinite(values.get("start", 0.0)):
        yield f"The start value of {variable} is {given['start']}, which FMI does not allow."
        return
    low, high = values.get("min", -math.inf), values.get("max", math.inf)
    start = values.get("start", low)
    if low > high:
        yield f"{variable} has the min {low:g}, which is above its max {high:g}."
    elif not low <= start <= high:
        end = f"below its min {low:g}" if start < low else f"above its max {high:g}"
        yield f"The start value {start:g} of {variable} is {end}."
    elif variable.type == "Enumeration" and "start" in values and start not in items[given["declaredType"]]:
        yield f"The start value {start:g} of {variable} is not an item of {given['declaredType']}."
    if values.get("nominal", 1.0) <= 0.0:
        yield f"{variable} has the nominal {values['nominal']:g}; it must be positive."


def _endless(variable: DeclaredVariable) -> Iterator[str]:
    for name in ("min", "max", "nominal"):
        if not math.isfinite(float(variable.attributes.get(name, 0.0))):
            yield f"The {name} of {variable} is {variable.attributes[name]}; it should be a finite number."
