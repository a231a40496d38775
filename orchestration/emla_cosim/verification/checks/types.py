"""Checks of SimpleTypes and the variables declared with them."""

from collections.abc import Iterator

from ..check import check
from ..declarations import Declarations, DeclaredType, find_repeated
from ..messages import judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, Clause


@check(
    "description.types",
    "Types are defined and used correctly",
    Clause("2.2.7", "If present, name of type defined with TypeDefinitions / SimpleType."),
    "Define every type once, with a name that no variable has, and with the type of its variables.",
    needs=("description.schema",),
)
def types(subject: Subject) -> CheckOutcome:
    """Check that every declared type is defined once and matches the type of its variables."""
    declared = subject.declared
    problems = [*_names(declared), *_uses(declared), *(p for t in declared.types for p in _items(t))]
    return judge_problems(problems, f"{len(declared.types)} types are defined and used correctly.")


def _names(declared: Declarations) -> Iterator[str]:
    variables = {v.name for v in declared.variables}
    for name in find_repeated(t.name for t in declared.types):
        yield f"More than one SimpleType has the name {name}."
    for one in declared.types:
        if one.name in variables:
            yield f"The SimpleType {one.name} has the name of a variable."


def _uses(declared: Declarations) -> Iterator[str]:
    by_name = {t.name: t for t in declared.types}
    for variable in declared.variables:
        name = variable.own.get("declaredType")
        if name is None:
            continue
        if name not in by_name:
            yield f"{variable} is declared as {name}, which is not a SimpleType."
        elif by_name[name].type != variable.type:
            other = by_name[name].type
            yield f"{variable} is of type {variable.type}, but declared as {name}, which is {other}."


def _items(one: DeclaredType) -> Iterator[str]:
    for attribute in ("name", "value"):
        for twice in find_repeated(item[attribute] for item in one.items):
            yield f"More than one item of the enumeration {one.name} has the {attribute} {twice}."
