"""Checks of units: defined, and consistent with their names."""

import math
from collections.abc import Iterator, Mapping

from emla_cosim.base.units import (
    BASE_UNITS,
    SiUnit,
    define_display_unit,
    explain_contradiction,
    find_unit,
    is_same_factor,
)

from ..check import CheckOutcome, check, quote
from ..declarations import Declarations, DeclaredUnit, DeclaredVariable, find_repeated
from ..messages import Breach, Problem, judge_problems
from ..subject import Subject

_RAD = BASE_UNITS.index("rad")

_UNIQUE_DISPLAY = quote("units.unique_display")
_NO_UNIT = quote("units.no_unit")
_CONVERTED = quote("units.consistent")
_INVERSE = quote("units.inverse")


@check("units.defined", needs=("description.schema",))
def defined(subject: Subject) -> CheckOutcome:
    """Check that every used unit is defined once, and that a variable with a display unit has a unit."""
    declared = subject.declared
    problems = [*_find_repeated_units(declared), *_find_undefined_units(declared)]
    return judge_problems(problems, f"{len(declared.units)} units are defined.")


def _find_repeated_units(declared: Declarations) -> Iterator[Problem]:
    for name in find_repeated(u.name for u in declared.units):
        yield Breach(f"The unit {name} is defined more than once.", quote("units.unique"))
    for unit in declared.units:
        for name in find_repeated(d["name"] for d in unit.display):
            yield Breach(f"The unit {unit.name} has more than one display unit {name}.", _UNIQUE_DISPLAY)


def _find_undefined_units(declared: Declarations) -> Iterator[Problem]:
    """Yield units that are used but not defined, and variables with a display unit but no unit."""
    used = [(v.name, v.own_attributes.get("unit")) for v in declared.variables]
    used += [(f"the type {t.name}", t.attributes.get("unit")) for t in declared.types]
    for who, unit in used:
        if unit is not None and unit not in declared.units_by_name:
            yield Breach(f"The unit {unit!r} of {who} is not defined.", quote("units.defined"))
    for variable in declared.variables:
        if variable.attributes.get("displayUnit") is not None and variable.unit is None:
            yield Breach(f"{variable} has a display unit, but no unit.", _NO_UNIT)
        if variable.alias_display_units and variable.unit is None:
            yield Breach(f"An alias of {variable} has a display unit, but {variable} no unit.", _NO_UNIT)


@check("units.consistent", needs=("units.defined",))
def consistent(subject: Subject) -> CheckOutcome:
    """Check that factors and offsets are possible, and match well-known names of units and display units.

    The standard leaves names of units free, so that a name that contradicts them only warns.
    """
    units = subject.declared.units
    problems = [Breach(p, _CONVERTED) for unit in units for p in _find_invalid_conversions(unit)]
    problems += [
        Breach(f"{display['name']} (display of {unit.name}) is inverse, but has an offset.", _INVERSE)
        for unit in units
        for display in unit.display
        if _is_inverse(display) and _read_number(display, "offset", 0.0) != 0.0
    ]
    doubts = [Breach(p, _CONVERTED) for u in units for p in _find_contradictions(u)]
    known_count = sum(find_unit(u.name) is not None for u in units)
    fine = f"{known_count} of {len(units)} units have well-known names; all of them match."
    return judge_problems(problems, fine, doubts)


def _is_inverse(display: Mapping[str, str]) -> bool:
    """Return whether a display unit of FMI 3.0 divides by the value."""
    return display.get("inverse") in ("true", "1")


def _find_invalid_conversions(unit: DeclaredUnit) -> Iterator[str]:
    """Yield units and display units whose factor is 0 or infinite, or whose offset is infinite."""
    names_and_attributes = [
        (unit.name, unit.base or {}),
        *((f"{d['name']} (display of {unit.name})", d) for d in unit.display),
    ]
    for name, attributes in names_and_attributes:
        factor, offset = _read_number(attributes, "factor", 1.0), _read_number(attributes, "offset", 0.0)
        if not (math.isfinite(factor) and factor and math.isfinite(offset)):
            yield f"The unit {name} has the factor {factor:g} and the offset {offset:g}."


def _find_contradictions(unit: DeclaredUnit) -> Iterator[str]:
    """Yield what contradicts the names of a unit and of its display units."""
    base = unit.base
    defined = find_unit(unit.name)
    if base is not None:
        factor, offset = _read_number(base, "factor", 1.0), _read_number(base, "offset", 0.0)
        defined = SiUnit(unit.name, _read_exponents(base), factor, offset)
        if (text := explain_contradiction(defined)) is not None:
            yield f"{text[0].upper()}{text[1:]}."
            return
    for display in unit.display:
        factor, offset = _read_number(display, "factor", 1.0), _read_number(display, "offset", 0.0)
        if defined is None or not factor or _is_inverse(display):
            continue
        text = explain_contradiction(define_display_unit(defined, display["name"], factor, offset))
        if text is not None:
            name = find_unit(display["name"])
            right = "" if name is None else f", by its name {defined.factor / name.factor:g}"
            yield f"In the display of {unit.name}, {text}. DisplayUnit has the factor {factor:g}{right}."


@check(
    "units.derivatives",
    clause=quote("shared.derivative"),
    needs=("units.consistent", "structure.derivatives"),
)
def derivatives(subject: Subject) -> CheckOutcome:
    """Check that the unit of der(x) is that of x per second, if both have units."""
    declared = subject.declared
    pairs = [(v, of) for v in declared.variables if (of := declared.variable(v.derivative)) is not None]
    if any(v.causality == "independent" and v.unit not in (None, "s") for v in declared.variables):
        pairs = []  # derivatives by something other than time
    problems, doubts = [], []
    for variable, of in pairs:
        exponents, factors = _compare_units(declared, variable, of)
        if not (exponents and factors):
            line = f"{variable} is in {variable.unit}, but is the derivative of {of}, which is in {of.unit}."
            (doubts if exponents else problems).append(line)
    fine = f"The units of {len(pairs)} derivatives agree with those of their variables."
    return judge_problems(problems, fine, doubts)


def _compare_units(
    declared: Declarations, derivative: DeclaredVariable, of: DeclaredVariable
) -> tuple[bool, bool]:
    """Return whether exponents and whether factors of their units agree; True if one is unknown."""
    bases = [u.base for v in (of, derivative) if (u := declared.unit_of(v))]
    if len(bases) < 2 or bases[0] is None or bases[1] is None:
        return True, True
    expected, actual = _read_exponents(bases[0], per_second=True), _read_exponents(bases[1])
    factor, derivative_factor = (_read_number(base, "factor", 1.0) for base in (bases[0], bases[1]))
    return expected[:_RAD] == actual[:_RAD], is_same_factor(factor, derivative_factor)


def _read_exponents(base: Mapping[str, str], per_second: bool = False) -> tuple[int, ...]:
    """Return the exponents of the base units, with `per_second` those of the unit divided by s."""
    exponents = [int(base.get(name, 0)) for name in BASE_UNITS]
    exponents[BASE_UNITS.index("s")] -= per_second
    return tuple(exponents)


def _read_number(attributes: Mapping[str, str], name: str, otherwise: float) -> float:
    return float(attributes.get(name, otherwise))
