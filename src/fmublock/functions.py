"""The functions a block may use besides + - * / and comparisons.

Each works on floats and on symbols, and gives the same bits either way: the float branch repeats
what the C code generated from the symbol does, including infinities, signed zeros, and NaN where
Python's `math` would raise. Powers are written as products, because the C library's `pow(x, 2)`
and `x * x` may differ in the last bit; so are lengths, of which Python has a `hypot` of its own.
"""

import math
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

_NUMBER = (float, int)


class Symbolic:
    """What stands for a float while an FMU is built: a value that only a run knows."""

    def call(self, name: str, arguments: Sequence[Any]) -> Any:
        """CasADi's function of this name, of arguments among which this is."""
        raise NotImplementedError


def _on_symbols(name: str, *arguments: Any) -> Any:
    """CasADi's function of this name; CasADi is imported only here: FMU hosts need not have it."""
    for argument in arguments:
        if isinstance(argument, Symbolic):
            return argument.call(name, arguments)
    return getattr(import_module("casadi"), name)(*arguments)


def _defined(function: Callable[..., float], *arguments: float) -> float:
    """A function of `math`; NaN where it raises because there is no result."""
    try:
        return function(*arguments)
    except ValueError:
        return math.nan


def sin(x: Any) -> Any:
    """Sine of x in rad."""
    return _defined(math.sin, x) if isinstance(x, _NUMBER) else _on_symbols("sin", x)


def cos(x: Any) -> Any:
    """Cosine of x in rad."""
    return _defined(math.cos, x) if isinstance(x, _NUMBER) else _on_symbols("cos", x)


def tan(x: Any) -> Any:
    """Tangent of x in rad."""
    return _defined(math.tan, x) if isinstance(x, _NUMBER) else _on_symbols("tan", x)


def arcsin(x: Any) -> Any:
    """Arc sine in rad, between -pi/2 and pi/2; NaN beyond -1 and 1."""
    return _defined(math.asin, x) if isinstance(x, _NUMBER) else _on_symbols("asin", x)


def arccos(x: Any) -> Any:
    """Arc cosine in rad, between 0 and pi; NaN beyond -1 and 1."""
    return _defined(math.acos, x) if isinstance(x, _NUMBER) else _on_symbols("acos", x)


def arctan(x: Any) -> Any:
    """Arc tangent in rad, between -pi/2 and pi/2."""
    return math.atan(x) if isinstance(x, _NUMBER) else _on_symbols("atan", x)


def arctan2(y: Any, x: Any) -> Any:
    """Angle of the point (x, y) in rad, between -pi and pi."""
    if not isinstance(y, _NUMBER) or not isinstance(x, _NUMBER):
        return _on_symbols("atan2", y, x)
    return math.atan2(y, x)


def tanh(x: Any) -> Any:
    """Hyperbolic tangent."""
    return math.tanh(x) if isinstance(x, _NUMBER) else _on_symbols("tanh", x)


def exp(x: Any) -> Any:
    """Exponential; infinite where it overflows."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("exp", x)
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


def log(x: Any) -> Any:
    """Natural logarithm; -inf at zero, NaN below."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("log", x)
    return -math.inf if x == 0.0 else _defined(math.log, x)


def sqrt(x: Any) -> Any:
    """Square root; NaN below zero, so that the branch not taken of a `where` may be undefined."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("sqrt", x)
    return math.sqrt(x) if x >= 0.0 else math.nan


def floor(x: Any) -> Any:
    """Largest whole number not above x, as a float."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("floor", x)
    return math.copysign(math.floor(x), x) if math.isfinite(x) else x


def mod(x: Any, y: Any) -> Any:
    """Remainder of x / y with the sign of x (C's `fmod`), exact."""
    if not isinstance(x, _NUMBER) or not isinstance(y, _NUMBER):
        return _on_symbols("fmod", x, y)
    return _defined(math.fmod, x, y)


def minimum(x: Any, y: Any) -> Any:
    """The smaller of x and y; the other one where one is NaN; of two zeros either (C's `fmin`)."""
    if not isinstance(x, _NUMBER) or not isinstance(y, _NUMBER):
        return _on_symbols("fmin", x, y)
    return 1.0 * (x if x <= y or y != y else y)


def maximum(x: Any, y: Any) -> Any:
    """The larger of x and y; the other one where one is NaN; of two zeros either (C's `fmax`)."""
    if not isinstance(x, _NUMBER) or not isinstance(y, _NUMBER):
        return _on_symbols("fmax", x, y)
    return 1.0 * (x if x >= y or y != y else y)


def sign(x: Any) -> Any:
    """-1, 0 or 1; NaN of NaN."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("sign", x)
    return math.copysign(1.0, x) if x < 0.0 or x > 0.0 else float(x)


def where(condition: Any, x: Any, y: Any) -> Any:
    """Choose x where the condition holds, else y. Both are evaluated; the one not chosen may be NaN.

    Written as the sum that CasADi generates, so that signed zeros agree as well.
    """
    if isinstance(condition, _NUMBER):
        return (x if condition else 0.0) + (0.0 if condition else y)
    return _on_symbols("if_else", condition, x, y)


def logical_and(a: Any, b: Any) -> Any:
    """Both conditions hold."""
    if isinstance(a, _NUMBER) and isinstance(b, _NUMBER):
        return bool(a) and bool(b)
    return _on_symbols("logic_and", a, b)


def logical_or(a: Any, b: Any) -> Any:
    """At least one condition holds."""
    if isinstance(a, _NUMBER) and isinstance(b, _NUMBER):
        return bool(a) or bool(b)
    return _on_symbols("logic_or", a, b)


def logical_not(a: Any) -> Any:
    """The condition does not hold."""
    return not a if isinstance(a, _NUMBER) else _on_symbols("logic_not", a)


def clamp(x: Any, low: Any, high: Any) -> Any:
    """x, but not below low nor above high."""
    return minimum(maximum(x, low), high)


def limit_magnitude(x: Any, y: Any, limit: Any) -> tuple[Any, Any, Any]:
    """The vector (x, y) shortened to a length of at most `limit` > 0, and whether it had to be (0 or 1).

    What was shortened to the same limit before may be longer by rounding; that does not count.
    """
    length = sqrt(x * x + y * y)
    scale = minimum(limit / maximum(length, limit), 1.0)
    return scale * x, scale * y, where(length > 1.000000001 * limit, 1.0, 0.0)


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Scalar product of two vectors of the same length, added from the first element on.

    Raises ValueError for vectors of different length.
    """
    products = [x * y for x, y in zip(a, b, strict=True)]
    total = products[0]
    for product in products[1:]:
        total = total + product
    return total


def matvec(M: Sequence[Sequence[Any]], x: Sequence[Any]) -> list[Any]:
    """The matrix M, a list of rows, times the vector x. Raises ValueError where they do not fit."""
    return [dot(row, x) for row in M]
