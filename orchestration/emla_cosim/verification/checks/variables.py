"""Checks of variables: names, attributes, aliases."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence

from ..check import check
from ..declarations import Declarations, DeclaredVariable, find_repeated
from ..messages import judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, Clause

_NONDIGIT = "_a-zA-Z"
_QUOTED = r"'(?:[_a-zA-Z0-9!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+'"
_PART = rf"(?:[{_NONDIGIT}][{_NONDIGIT}0-9]*|{_QUOTED})(?:\[[0-9]+(?:,[0-9]+)*\])?"
_IDENTIFIER = rf"{_PART}(?:\.{_PART})*"
_STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,[0-9]+)?\)")


@check(
    "variables.names",
    "Variables have unique names",
    Clause("2.2.9", "The names must be unique, non-empty strings."),
    "Rename them. With variableNamingConvention `flat`, every name is allowed.",
    needs=("description.schema",),
)
def names(subject: Subject) -> CheckOutcome:
    """Check that names are unique, and structured if the FMU declares it."""
    found = [v.name for v in subject.declared.variables]
    problems = [f"More than one variable has the name {name}." for name in find_repeated(found)]
    problems += [f"Variable {i} has no name." for i, name in enumerate(found, start=1) if not name]
    if subject.tree.get("variableNamingConvention") == "structured":
        problems += [
            f"{name} is not a structured name." for name in found if name and not _STRUCTURED.fullmatch(name)
        ]
    return judge_problems(problems, f"{len(found)} variables have unique names.")


@check(
    "variables.attributes",
    "Attributes of variables are compatible",
    Clause("2.2.7", "The following combinations of variability/causality settings are allowed:"),
    "The tables in section 2.2.7 list the combinations. The default of variability is `continuous`.",
    needs=("description.schema",),
)
def attributes(subject: Subject) -> CheckOutcome:
    """Check that causality, variability, initial and type of every variable are compatible."""
    declared = subject.declared
    problems = [p for v in declared.variables for p in _impossible(v)]
    independent = [v.name for v in declared.variables if v.causality == "independent"]
    if len(independent) > 1:
        problems.append(f"Both {independent[0]} and {independent[1]} are independent.")
    if "ModelExchange" not in subject.kinds:
        problems += [p for v in declared.variables for p in _exchanged(v)]
    return judge_problems(problems, f"{len(declared.variables)} variables have compatible attributes.")


def _impossible(variable: DeclaredVariable) -> Iterator[str]:
    what = f"{variable} is {variable.variability} and {_article(variable.causality)}"
    if variable.initials is None:
        yield f"{what}, which the standard does not allow."
    elif not variable.possible:
        yield f"{what}; its initial cannot be {variable.given_initial}."
    if variable.variability == "continuous" and variable.type != "Real":
        yield f"{variable} is continuous, but of type {variable.type}; only a Real can be."


def _exchanged(variable: DeclaredVariable) -> Iterator[str]:
    if "reinit" in variable.own:
        yield f"{variable} has reinit, which is for Model Exchange only."
    if variable.multiple_sets:
        yield f"{variable} has canHandleMultipleSetPerTimeInstant, which is for Model Exchange only."


def _article(causality: str) -> str:
    if causality in ("local", "independent"):
        return causality
    return f"an {causality}" if causality[0] in "aeiou" else f"a {causality}"


@check(
    "variables.aliases",
    "Variables with the same value reference are compatible",
    Clause(
        "2.2.7",
        "At most one variable of the same alias set of variables with variability ≠ constant can have a "
        "start attribute.",
    ),
    "Use different value references, or the same unit and only one start value.",
    needs=("description.schema",),
)
def aliases(subject: Subject) -> CheckOutcome:
    """Check that aliases agree in unit and constancy, and that at most one has a start value."""
    sets = _alias_sets(subject.declared)
    problems = [p for several in sets for p in _apart(several)]
    return judge_problems(problems, f"{len(sets)} value references are shared, by compatible variables.")


def _alias_sets(declared: Declarations) -> list[list[DeclaredVariable]]:
    found: dict[tuple[str, int], list[DeclaredVariable]] = defaultdict(list)
    for variable in declared.variables:
        base = "Integer" if variable.type == "Enumeration" else variable.type
        found[base, variable.reference].append(variable)
    return [several for several in found.values() if len(several) > 1]


def _apart(several: Sequence[DeclaredVariable]) -> Iterator[str]:
    both = (
        f"{several[0]} and {several[1]}"
        if len(several) == 2
        else f"{several[0]} and its {len(several) - 1} aliases"
    )
    constant = [v for v in several if v.variability == "constant"]
    started = [v.name for v in several if v.start is not None and v.variability != "constant"]
    if len(started) > 1:
        yield f"{started[0]} and {started[1]} have the same value reference, but both have a start value."
    if constant and len(constant) < len(several):
        yield f"{both} have the same value reference, but only some of them are constant."
    elif len({v.start for v in constant}) > 1:
        yield f"{both} have the same value reference, but different constant values."
    if started and any(v.causality == "independent" for v in several):
        yield f"{started[0]} has the value reference of the independent variable."
    if len({v.unit for v in several}) > 1:
        yield f"{both} have the same value reference, but different units."
