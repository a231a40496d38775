"""Arithmetic over names in tuning plans, such as `tilt.observer.alpha_1 ** 2 / 4`."""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ...base.errors import CommandError, join_names

_OPERATIONS: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,  # `operator.pow` has complex roots of negative numbers, and never ends for 10**10**10
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": abs,
    "exp": math.exp,
    "log": math.log,
    "max": max,
    "min": min,
    "sqrt": math.sqrt,
}

_Compute = Callable[[Mapping[str, float]], Any]
"""Function that returns the value of a part of an expression, from the values of names."""


@dataclass(frozen=True)
class Expression:
    """An expression and the names in it; create it with `parse_expression`."""

    text: str
    names: frozenset[str]
    compute: _Compute

    def value(self, values: Mapping[str, float]) -> float:
        """Return the value of the expression; NaN if it is undefined, as for log(0)."""
        try:
            return float(self.compute(values))
        except (ArithmeticError, ValueError):
            return math.nan


def parse_expression(text: str, where: str) -> Expression:
    """Parse an expression of numbers, names, + - * / ** and a few functions.

    Args:
        text: The expression. Names are those of variables and figures, with dots and brackets.
        where: The place of the text, for error messages.

    Raises:
        CommandError: The text is not such an expression.
    """
    names = set[str]()
    try:
        compute = _compile(ast.parse(text.strip(), mode="eval").body, names)
    except (SyntaxError, TypeError, ValueError, RecursionError, MemoryError):
        raise CommandError(
            f"{where}: '{text}' is not an expression; use numbers, names, + - * / ** and "
            f"{join_names(_FUNCTIONS)}.",
            expression=text,
        ) from None
    return Expression(text, frozenset(names), compute)


def _compile(tree: ast.expr, names: set[str]) -> _Compute:
    """Return the function of a tree, and add its names to `names`.

    Raises:
        ValueError: The tree is not arithmetic.
        TypeError: A function has too few or too many arguments.
    """
    if isinstance(tree, ast.Constant) and type(tree.value) in (int, float):
        return lambda _: tree.value
    if (name := _read_name(tree)) is not None:
        names.add(name)
        return operator.itemgetter(name)
    match tree:
        case ast.BinOp(left, operation, right) if type(operation) in _OPERATIONS:
            operands, function = [left, right], _OPERATIONS[type(operation)]
        case ast.UnaryOp(operation, operand) if type(operation) in _OPERATIONS:
            operands, function = [operand], _OPERATIONS[type(operation)]
        case ast.Call(ast.Name(name), operands, []) if name in _FUNCTIONS:
            function = _FUNCTIONS[name]
            function(*(2.0 for _ in operands))  # raises TypeError if the number of arguments is wrong
        case _:
            raise ValueError
    parts = [_compile(operand, names) for operand in operands]
    return lambda values: function(*(part(values) for part in parts))


def _read_name(tree: ast.expr) -> str | None:
    """Return the name that a tree represents: `a`, `a.b[1].c`; None for anything else."""
    root = tree
    while isinstance(root, (ast.Attribute, ast.Subscript)):
        root = root.value
    return ast.unparse(tree).replace(" ", "") if isinstance(root, ast.Name) else None
