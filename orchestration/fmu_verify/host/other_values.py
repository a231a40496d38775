"""Values of variables of all types: their start values, and other valid ones."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from fmpy.model_description import ModelVariable

from emla_cosim.fmu.elements import number_range
from emla_cosim.fmu.instance import kind_of

from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process
from .experiment import parse_number, read_limits
from .hosted_instance import CallError

MOST = 300
"""Most variables that a check changes or reads."""

# part of the time limit that an FMU may take with other values: they need not make sense to the model
_PATIENCE = 0.25

# relative difference of Reals that counts: tools round start values that they write
_CLOSE = 1e-5

Values = dict[str, Any]


def read_start(variable: ModelVariable) -> Any:
    """Return the start value in the type of the variable; None if there is none that can be read."""
    text = variable.start
    if text is None:
        return None
    try:
        if variable.type == "Real":
            return float(text)
        if variable.type in ("Integer", "Enumeration"):
            return int(text)
    except ValueError:
        return None
    return str(text).strip().lower() in ("true", "1") if variable.type == "Boolean" else str(text)


def choose_other(variable: ModelVariable) -> Any:
    """Return a valid value that is not the start value; None if there is none."""
    start = read_start(variable)
    if start is None:
        return None
    if variable.type == "Boolean":
        return not start
    if variable.type == "String":
        # any text but that of the start value
        return f"{start}2"
    if variable.type == "Enumeration":
        return next((value for value in list_items(variable) if value != start), None)
    low, high = read_limits(variable)
    if variable.type == "Integer":
        least, most = number_range(variable)
        values = (v for v in (start + 1, start - 1) if low <= v <= high and least <= v <= most)
        return next(values, None)
    width = high - low if math.isfinite(high - low) else abs(parse_number(variable.nominal, start or 1.0))
    step = 0.1 * width
    return next((v for v in (start + step, start - step) if low <= v <= high and v != start), None)


def list_items(variable: ModelVariable) -> list[int]:
    """Return the values of the items of an Enumeration."""
    declared = variable.declaredType
    return [int(item.value or 0) for item in declared.items or ()] if declared is not None else []


def list_settable(
    subject: Subject, *causalities: str, tunable: bool = False, most: int | None = MOST
) -> list[ModelVariable]:
    """Return variables of these causalities that can be set and have a start value, without aliases.

    With `tunable`, parameters must be tunable. `most` limits the number; None: no limit.
    """
    variables_by_reference: dict[tuple[str, int | str], ModelVariable] = {}
    for variable in subject.description.modelVariables:
        right = variable.causality in causalities and variable.variability != "constant"
        if tunable and variable.causality == "parameter":
            right = right and variable.variability == "tunable"
        if right and variable.start is not None:
            # elements of an array of FMI 3.0 have the same value reference
            alias = variable.name if subject.version == 3 else int(variable.valueReference)
            variables_by_reference.setdefault((kind_of(variable), alias), variable)
    return list(variables_by_reference.values())[:most]


def list_other_values(variables: Iterable[ModelVariable]) -> Values:
    """Return another valid value for each variable that has one, by name."""
    return {v.name: value for v in variables if (value := choose_other(v)) is not None}


def are_same(actual: Any, expected: Any) -> bool:
    """Return whether two values of a variable are equal, Reals within rounding, Strings but for spaces."""
    actual, expected = (v.decode(errors="replace") if isinstance(v, bytes) else v for v in (actual, expected))
    if isinstance(actual, str) and isinstance(expected, str):
        return " ".join(actual.split()) == " ".join(expected.split())
    if isinstance(actual, float) or isinstance(expected, float):
        return actual == expected or math.isclose(
            float(actual), float(expected), rel_tol=_CLOSE, abs_tol=1e-300
        )
    return actual == expected


def list_differences(
    actual: Mapping[str, Any], expected: Mapping[str, Any], names: Iterable[str]
) -> list[str]:
    """Return the names of variables whose values differ."""
    return [name for name in names if not are_same(actual[name], expected[name])]


def format_value(value: Any) -> str:
    """Return a value for a message."""
    if isinstance(value, bytes):
        return repr(value[:60].decode(errors="replace"))
    return f"{value:.9g}" if isinstance(value, float) else repr(value)


def run_where_accepted(do: Callable[[Subject, Values], Any], subject: Subject, changes: Values) -> list[Any]:
    """Call `do` in a new process with all changes, or with those of each type if the FMU refuses them.

    Returns:
        The results of the calls that the FMU did not refuse. An FMU may refuse valid values, for example a
        name of a file that does not exist.
    """
    patience = _PATIENCE * subject.settings.seconds
    by_type: dict[str, Values] = {}
    for name, value in changes.items():
        by_type.setdefault(str(subject.variables[name].type), {})[name] = value
    for parts in ([changes], list(by_type.values())):
        results = []
        for part in parts:
            try:
                results.append(in_fresh_process(do, subject, part, timeout=patience))
            except (CallError, EndedError):
                continue
        if results:
            return results
    return []
