"""Checks of SimpleTypes and the variables declared with them."""

from collections.abc import Iterator

from ..check import check
from ..declarations import Declarations, DeclaredType, find_repeated
from ..messages import Breach, Problem, judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, Clause

_UNIQUE = Clause(
    "2.2.3",
    "Attribute “name” must be unique with respect to all other elements of the TypeDefinitions list.",
)
_NO_VARIABLE = Clause(
    "2.2.3", "“name” of a “SimpleType” must be different to all “name” attributes of ScalarVariables"
)
_DEFINED = Clause("2.2.7", "If present, name of type defined with TypeDefinitions / SimpleType.")
_ITEMS = Clause(
    "2.2.3",
    "The values can be any integer number but must be unique within the same enumeration (in order that the "
    "mapping between “name” and “value” is bijective).",
)


@check(
    "description.types",
    "Types are defined and used correctly",
    _DEFINED,
    "Define every type once, with a name that no variable has, and with the type of its variables.",
    needs=("description.schema",),
)
def types(subject: Subject) -> CheckOutcome:
    """Check that every declared type is defined once and matches the type of its variables."""
    declared = subject.declared
    problems = [*_names(declared), *_uses(declared), *(p for t in declared.types for p in _items(t))]
    return judge_problems(problems, f"{len(declared.types)} types are defined and used correctly.")


def _names(declared: Declarations) -> Iterator[Problem]:
    variables = {v.name for v in declared.variables}
    for name in find_repeated(t.name for t in declared.types):
        yield Breach(f"More than one SimpleType has the name {name}.", _UNIQUE)
    for one in declared.types:
        if one.name in variables:
            yield Breach(f"The SimpleType {one.name} has the name of a variable.", _NO_VARIABLE)


def _uses(declared: Declarations) -> Iterator[Problem]:
    by_name = {t.name: t for t in declared.types}
    for variable in declared.variables:
        name = variable.own.get("declaredType")
        if name is None:
            continue
        if name not in by_name:
            yield Breach(f"{variable} is declared as {name}, which is not a SimpleType.", _DEFINED)
        elif by_name[name].type != variable.type:
            other = by_name[name].type
            what = f"{variable} is of type {variable.type}, but declared as {name}, which is {other}."
            yield Breach(what, _DEFINED)


def _items(one: DeclaredType) -> Iterator[Problem]:
    for attribute in ("name", "value"):
        for twice in find_repeated(item[attribute] for item in one.items):
            what = f"More than one item of the enumeration {one.name} has the {attribute} {twice}."
            yield Breach(what, _ITEMS)
