"""The symbols on which a block's equations run while an FMU is built.

CasADi's own symbols allow too much: float(x) is NaN, and x % y or x ** 2 differs from the
arithmetic of Python's floats. These symbols wrap them, allow the operations that give the same bits
as on floats, and refuse the others.
"""

import builtins
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

import casadi

from .functions import Symbolic


class RefusedError(Exception):
    """An operation would give another result on symbols than on floats.

    The message continues after the expression: "`v.x ** 2` <message>".
    """


_BRANCH = (
    "branches on a value that is known only in a run; "
    "use where, logical_and, logical_or, logical_not, minimum or maximum"
)
_NUMBER = "needs a number that is known only in a run; use fmublock's own functions (sin, sqrt, dot, ...)"


def _refuse_operation(message: str) -> Callable[..., NoReturn]:
    def refuse(self: "Symbol", *arguments: Any) -> NoReturn:
        raise RefusedError(message)

    return refuse


def _make_operator(
    operation: "Callable[[Symbol, Symbol], Symbol]", reflected: bool = False
) -> Callable[..., Any]:
    """Make an operator method for two numbers; `reflected` exchanges them."""

    def apply(self: "Symbol", other: Any) -> Any:
        if not isinstance(other, (Symbol, float, int)):
            return NotImplemented
        return operation(_wrap(other), self) if reflected else operation(self, _wrap(other))

    return apply


def _add(a: "Symbol", b: "Symbol") -> "Symbol":
    return Symbol(a.sx + b.sx, a.is_integer and b.is_integer)


def _subtract(a: "Symbol", b: "Symbol") -> "Symbol":
    return Symbol(a.sx - b.sx, a.is_integer and b.is_integer)


def _multiply(a: "Symbol", b: "Symbol") -> "Symbol":
    product = a.sx * b.sx
    return Symbol(product + 0.0, is_integer=True) if a.is_integer and b.is_integer else Symbol(product)


def _divide(a: "Symbol", b: "Symbol") -> "Symbol":
    return Symbol(a.sx / b.sx)


def _make_comparison(operation: Callable[[Any, Any], casadi.SX]) -> Callable[..., Any]:
    def compare(self: "Symbol", other: Any) -> Any:
        if not isinstance(other, (Symbol, float, int)):
            return NotImplemented
        return Symbol(operation(self.sx, _wrap(other).sx), is_integer=True)

    return compare


class Symbol(Symbolic):
    """A number that is known only in a run.

    `is_integer` means that Python would have a bool or an int here (a comparison, or a sum of them), which
    have no negative zero.
    """

    __slots__ = ("is_integer", "sx")
    __hash__ = None  # type: ignore[assignment]
    __array_ufunc__ = None  # lets the symbol do operations with NumPy's scalars

    def __init__(self, sx: casadi.SX, is_integer: bool = False) -> None:
        self.sx = sx
        self.is_integer = is_integer

    def call(self, name: str, arguments: Sequence[Any]) -> "Symbol":
        """Call CasADi's function of this name."""
        results = getattr(casadi, name)(*(_wrap(x).sx for x in arguments))
        return Symbol(results, is_integer=name.startswith("logic_"))

    __add__, __radd__ = _make_operator(_add), _make_operator(_add, reflected=True)
    __sub__, __rsub__ = _make_operator(_subtract), _make_operator(_subtract, reflected=True)
    __mul__, __rmul__ = _make_operator(_multiply), _make_operator(_multiply, reflected=True)
    __truediv__, __rtruediv__ = _make_operator(_divide), _make_operator(_divide, reflected=True)

    def __neg__(self) -> "Symbol":
        return Symbol(0.0 - self.sx if self.is_integer else -self.sx, self.is_integer)

    def __pos__(self) -> "Symbol":
        return self

    def __abs__(self) -> "Symbol":
        return Symbol(abs(self.sx), self.is_integer)

    __lt__ = _make_comparison(lambda a, b: a < b)
    __le__ = _make_comparison(lambda a, b: a <= b)
    __gt__ = _make_comparison(lambda a, b: a > b)
    __ge__ = _make_comparison(lambda a, b: a >= b)
    __eq__ = _make_comparison(lambda a, b: a == b)  # type: ignore[assignment]
    __ne__ = _make_comparison(lambda a, b: a != b)  # type: ignore[assignment]

    __bool__ = _refuse_operation(_BRANCH)
    __float__ = __int__ = __complex__ = __index__ = _refuse_operation(_NUMBER)
    __round__ = __floor__ = __ceil__ = __trunc__ = __array__ = _refuse_operation(_NUMBER)
    __format__ = _refuse_operation("formats a value that is known only in a run")  # type: ignore[assignment]
    __pow__ = __rpow__ = _refuse_operation(
        "may round differently in C; write a product, or use sqrt, exp and log"
    )
    __mod__ = __rmod__ = _refuse_operation("rounds differently in C; use mod(x, y)")
    __floordiv__ = __rfloordiv__ = _refuse_operation("rounds differently in C; use floor(x / y)")
    __divmod__ = __rdivmod__ = _refuse_operation("rounds differently in C; use floor(x / y) and mod(x, y)")


def _wrap(x: Any) -> Symbol:
    """Return a symbol, or convert a number to one. Raises RefusedError for other types and NaN."""
    if isinstance(x, Symbol):
        return x
    if not isinstance(x, (float, int)):
        raise RefusedError(f"calculates with {x!r}, which is not a number")
    if math.isnan(x):
        raise RefusedError("holds the constant NaN")
    return Symbol(casadi.SX(float(x)), isinstance(x, int))


@contextmanager
def refuse_sum() -> Iterator[None]:
    """Refuse `sum` of symbols in this context: since Python 3.12 it is more exact on floats than +."""
    original = builtins.sum

    def checked(values: Any, /, start: Any = 0) -> Any:
        values = list(values)
        if any(isinstance(x, Symbolic) for x in (*values, start)):
            raise RefusedError(
                "rounds differently in C and in newer Pythons; add with + in a loop, or use dot(a, b)"
            )
        return original(values, start)

    builtins.sum = checked
    try:
        yield
    finally:
        builtins.sum = original
