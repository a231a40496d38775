"""Checks of SimpleTypes and the variables declared with them."""

from collections.abc import Iterator

from ..check import check
from ..declarations import Declarations, find_repeated
from ..messages import Breach, Problem, judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, quote

_DEFINED = quote("description.types")


@check("description.types", needs=("description.schema",))
def types(subject: Subject) -> CheckOutcome:
    """Check that every declared type is defined once and matches the type of its variables."""
    declared = subject.declared
    problems = [*_judge_names(declared), *_judge_uses(declared)]
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


def _judge_names(declared: Declarations) -> Iterator[Problem]:
    variables = {v.name for v in declared.variables}
    for name in find_repeated(t.name for t in declared.types):
        yield Breach(f"More than one {_name_kind(declared)} has the name {name}.", quote("types.unique"))
    for type_ in declared.types:
        if type_.name in variables:
            yield Breach(
                f"The {_name_kind(declared)} {type_.name} has the name of a variable.",
                quote("types.no_variable"),
            )


def _name_kind(declared: Declarations) -> str:
    return "type definition" if declared.version == 3 else "SimpleType"


def _judge_uses(declared: Declarations) -> Iterator[Problem]:
    by_name = {t.name: t for t in declared.types}
    for variable in declared.variables:
        name = variable.own_attributes.get("declaredType")
        if name is None:
            continue
        if name not in by_name:
            message = f"{variable} is declared as {name}, which is not a {_name_kind(declared)}."
            yield Breach(message, _DEFINED)
        elif by_name[name].type != variable.type:
            expected = by_name[name].type
            message = f"{variable} is of type {variable.type}, but declared as {name}, which is {expected}."
            yield Breach(message, _DEFINED)
