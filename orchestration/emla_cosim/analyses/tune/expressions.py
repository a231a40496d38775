"""Arithmetic over names in tuning plans, such as `tilt.observer.alpha_1 ** 2 / 4`."""

import ast
import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...base.errors import CommandError, join_names

_OPERATIONS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,  # `operator.pow` has complex roots of negative numbers, and never ends for 10**10**10
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS = {
    "abs": abs,
    "exp": math.exp,
    "log": math.log,
    "max": max,
    "min": min,
    "sqrt": math.sqrt,
}


@dataclass(frozen=True)
class Expression:
    """An expression and the names in it; create it with `parse_expression`."""

    text: str
    names: frozenset[str]
    tree: ast.expr

    def value(self, known: Mapping[str, float]) -> float:
        """Return the value of the expression; NaN if it is undefined, as for log(0)."""
        try:
            return float(_value(self.tree, known))
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
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        names = frozenset(_names(tree))
    except (SyntaxError, TypeError, ValueError, RecursionError, MemoryError):
        raise CommandError(
            f"{where}: '{text}' is not an expression; use numbers, names, + - * / ** and "
            f"{join_names(_FUNCTIONS)}.",
            expression=text,
        ) from None
    return Expression(text, names, tree)


def _names(tree: ast.expr) -> set[str]:
    """Return the names in a tree.

    Raises:
        ValueError: The tree is not arithmetic.
        TypeError: A function has too few or too many arguments.
    """
    if isinstance(tree, ast.Constant) and type(tree.value) in (int, float):
        return set()
    if (name := _name(tree)) is not None:
        return {name}
    if isinstance(tree, ast.BinOp) and type(tree.op) in _OPERATIONS:
        return _names(tree.left) | _names(tree.right)
    if isinstance(tree, ast.UnaryOp) and type(tree.op) in _OPERATIONS:
        return _names(tree.operand)
    if isinstance(tree, ast.Call) and not tree.keywords and (function := _function(tree)) is not None:
        function(*(2.0 for _ in tree.args))  # raises TypeError if the number of arguments is wrong
        return set[str]().union(*map(_names, tree.args))
    raise ValueError


def _name(tree: ast.expr) -> str | None:
    """Return the name that a tree represents: `a`, `a.b[1].c`; None for anything else."""
    if isinstance(tree, ast.Name):
        return tree.id
    if isinstance(tree, ast.Attribute):
        before = _name(tree.value)
        return None if before is None else f"{before}.{tree.attr}"
    if isinstance(tree, ast.Subscript):
        before = _name(tree.value)
        return None if before is None else f"{before}[{ast.unparse(tree.slice).replace(' ', '')}]"
    return None


def _function(call: ast.Call) -> Any:
    return _FUNCTIONS.get(call.func.id) if isinstance(call.func, ast.Name) else None


def _value(tree: ast.expr, known: Mapping[str, float]) -> Any:
    if isinstance(tree, ast.Constant):
        return tree.value
    if (name := _name(tree)) is not None:
        return known[name]
    if isinstance(tree, ast.BinOp):
        return _OPERATIONS[type(tree.op)](_value(tree.left, known), _value(tree.right, known))
    if isinstance(tree, ast.UnaryOp):
        return _OPERATIONS[type(tree.op)](_value(tree.operand, known))
    assert isinstance(tree, ast.Call)
    return _function(tree)(*(_value(argument, known) for argument in tree.args))
