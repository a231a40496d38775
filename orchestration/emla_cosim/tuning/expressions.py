"""Arithmetic over names, such as `tilt.observer.alpha_1 ** 2 / 4`, as plans of tunings write it."""

import ast
import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..base.errors import CommandError, join_names

_OPERATIONS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,  # that of operator is complex for roots of less than 0, and has no end for 10**10**10
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
    """An expression and the names in it; make it with `expression`."""

    text: str
    names: frozenset[str]
    tree: ast.expr

    def value(self, known: Mapping[str, float]) -> float:
        """Its value, in whatever unit comes of it; NaN where there is none, as of log(0)."""
        try:
            return float(_value(self.tree, known))
        except (ArithmeticError, ValueError):
            return math.nan


def parse_expression(text: str, where: str) -> Expression:
    """Read one: numbers, names, + - * / **, and a few functions.

    Names are those of variables and figures, with dots and brackets. Raises CommandError, with `where`
    for the place of the text, for anything else.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        names = frozenset(_names(tree))
    except (SyntaxError, TypeError, ValueError, RecursionError, MemoryError):
        raise CommandError(
            f"{where}: '{text}' is no expression; write one of numbers, names, + - * / ** and "
            f"{join_names(_FUNCTIONS)}.",
            expression=text,
        ) from None
    return Expression(text, names, tree)


def _names(tree: ast.expr) -> set[str]:
    """The names in a tree; ValueError for what is no arithmetic, TypeError for too few or many arguments."""
    if isinstance(tree, ast.Constant) and type(tree.value) in (int, float):
        return set()
    if (name := _name(tree)) is not None:
        return {name}
    if isinstance(tree, ast.BinOp) and type(tree.op) in _OPERATIONS:
        return _names(tree.left) | _names(tree.right)
    if isinstance(tree, ast.UnaryOp) and type(tree.op) in _OPERATIONS:
        return _names(tree.operand)
    if isinstance(tree, ast.Call) and not tree.keywords and (function := _function(tree)) is not None:
        function(*(2.0 for _ in tree.args))  # TypeError where it takes more of them, or less
        return set[str]().union(*map(_names, tree.args))
    raise ValueError


def _name(tree: ast.expr) -> str | None:
    """The name that a tree is: `a`, `a.b[1].c`; None for anything else."""
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
