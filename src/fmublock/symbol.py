"""What a block's equations run on while an FMU is built, so that they cannot mean two things.

CasADi's own symbols answer too willingly: float(x) is NaN, and x % y or x ** 2 is not the
arithmetic of Python's floats. These wrap them, do what gives the same bits on floats, and
refuse the rest.
"""

import builtins
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

import casadi

from .functions import Symbolic


class RefusedError(Exception):
    """An operation that would give another result on symbols than on floats.

    The message goes on after the expression: "`v.x ** 2` <message>".
    """


_BRANCH = (
    "decides by a value that only a run knows; "
    "use where, logical_and, logical_or, logical_not, minimum or maximum"
)
_NUMBER = "needs a number that only a run knows; use fmublock's own functions (sin, sqrt, floor, ...)"


def _refused(message: str) -> Callable[..., NoReturn]:
    def refuse(self: "Symbol", *arguments: Any) -> NoReturn:
        raise RefusedError(message)

    return refuse


def _binary(operation: "Callable[[Symbol, Symbol], Symbol]", reflected: bool = False) -> Callable[..., Any]:
    """An operator of two numbers, whose order is turned round where Python reflects it."""

    def apply(self: "Symbol", other: Any) -> Any:
        if not isinstance(other, (Symbol, float, int)):
            return NotImplemented
        return operation(_wrapped(other), self) if reflected else operation(self, _wrapped(other))

    return apply


def _sum(a: "Symbol", b: "Symbol") -> "Symbol":
    return Symbol(a.sx + b.sx, a.whole and b.whole)


def _difference(a: "Symbol", b: "Symbol") -> "Symbol":
    return Symbol(a.sx - b.sx, a.whole and b.whole)


def _product(a: "Symbol", b: "Symbol") -> "Symbol":
    product = a.sx * b.sx
    return Symbol(product + 0.0, whole=True) if a.whole and b.whole else Symbol(product)


def _quotient(a: "Symbol", b: "Symbol") -> "Symbol":
    return Symbol(a.sx / b.sx)


def _comparison(operation: Callable[[Any, Any], casadi.SX]) -> Callable[..., Any]:
    def compare(self: "Symbol", other: Any) -> Any:
        if not isinstance(other, (Symbol, float, int)):
            return NotImplemented
        return Symbol(operation(self.sx, _wrapped(other).sx), whole=True)

    return compare


class Symbol(Symbolic):
    """A number that only a run knows.

    `whole` tells that Python would have a bool or an int here (a comparison, or a sum of them),
    which know no negative zero.
    """

    __slots__ = ("sx", "whole")
    __hash__ = None  # type: ignore[assignment]
    __array_ufunc__ = None  # NumPy's scalars leave the operation to the symbol

    def __init__(self, sx: casadi.SX, whole: bool = False) -> None:
        self.sx = sx
        self.whole = whole

    def call(self, name: str, arguments: Sequence[Any]) -> "Symbol":
        """CasADi's function of this name."""
        results = getattr(casadi, name)(*(_wrapped(x).sx for x in arguments))
        return Symbol(results, whole=name.startswith("logic_"))

    __add__, __radd__ = _binary(_sum), _binary(_sum, reflected=True)
    __sub__, __rsub__ = _binary(_difference), _binary(_difference, reflected=True)
    __mul__, __rmul__ = _binary(_product), _binary(_product, reflected=True)
    __truediv__, __rtruediv__ = _binary(_quotient), _binary(_quotient, reflected=True)

    def __neg__(self) -> "Symbol":
        return Symbol(0.0 - self.sx if self.whole else -self.sx, self.whole)

    def __pos__(self) -> "Symbol":
        return self

    def __abs__(self) -> "Symbol":
        return Symbol(abs(self.sx), self.whole)

    __lt__ = _comparison(lambda a, b: a < b)
    __le__ = _comparison(lambda a, b: a <= b)
    __gt__ = _comparison(lambda a, b: a > b)
    __ge__ = _comparison(lambda a, b: a >= b)
    __eq__ = _comparison(lambda a, b: a == b)  # type: ignore[assignment]
    __ne__ = _comparison(lambda a, b: a != b)  # type: ignore[assignment]

    __bool__ = _refused(_BRANCH)
    __float__ = __int__ = __complex__ = __index__ = _refused(_NUMBER)
    __round__ = __floor__ = __ceil__ = __trunc__ = __array__ = _refused(_NUMBER)
    __format__ = _refused("makes a text of a value that only a run knows")  # type: ignore[assignment]
    __pow__ = __rpow__ = _refused("may be rounded otherwise in C; write a product, or use sqrt, exp and log")
    __mod__ = __rmod__ = _refused("is rounded otherwise in C; use mod(x, y)")
    __floordiv__ = __rfloordiv__ = _refused("is rounded otherwise in C; use floor(x / y)")
    __divmod__ = __rdivmod__ = _refused(
        "is not rounded alike in Python and C; use floor(x / y) and mod(x, y)"
    )


def _wrapped(x: Any) -> Symbol:
    """A symbol, or a number as one. Raises RefusedError for what is neither, and for NaN."""
    if isinstance(x, Symbol):
        return x
    if not isinstance(x, (float, int)):
        raise RefusedError(f"calculates with {x!r}, which is no number")
    if math.isnan(x):
        raise RefusedError("holds the constant NaN")
    return Symbol(casadi.SX(float(x)), isinstance(x, int))


@contextmanager
def refusing_sum() -> Iterator[None]:
    """Refuse `sum` of symbols meanwhile: since Python 3.12 it adds floats more exactly than + does."""
    original = builtins.sum

    def checked(values: Any, /, start: Any = 0) -> Any:
        values = list(values)
        if any(isinstance(x, Symbolic) for x in (*values, start)):
            raise RefusedError(
                "adds otherwise in C and newer Pythons; add with + in a loop, or use dot(a, b)"
            )
        return original(values, start)

    builtins.sum = checked
    try:
        yield
    finally:
        builtins.sum = original
