"""The functions a block may use besides + - * / and comparisons.

Each works on floats and on CasADi symbols, and gives the same bits either way: the float
branch repeats what the C code generated from the symbol does, including infinities and NaN
where Python's `math` would raise. Powers are written as products, because the C library's
`pow(x, 2)` and `x * x` may differ in the last bit.
"""

import math
from importlib import import_module
from typing import Any

_NUMBER = (float, int)


def _symbolic() -> Any:
    """CasADi, imported only when a symbol turns up: FMU hosts need not have it."""
    return import_module("casadi")


def sin(x: Any) -> Any:
    """Sine of x in rad."""
    return math.sin(x) if isinstance(x, _NUMBER) else _symbolic().sin(x)


def cos(x: Any) -> Any:
    """Cosine of x in rad."""
    return math.cos(x) if isinstance(x, _NUMBER) else _symbolic().cos(x)


def arctan(x: Any) -> Any:
    """Arc tangent in rad, between -pi/2 and pi/2."""
    return math.atan(x) if isinstance(x, _NUMBER) else _symbolic().atan(x)


def exp(x: Any) -> Any:
    """Exponential; infinite where it overflows."""
    if not isinstance(x, _NUMBER):
        return _symbolic().exp(x)
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


def log(x: Any) -> Any:
    """Natural logarithm; -inf at zero, NaN below."""
    if not isinstance(x, _NUMBER):
        return _symbolic().log(x)
    if x > 0.0:
        return math.log(x)
    return -math.inf if x == 0.0 else math.nan


def sqrt(x: Any) -> Any:
    """Square root; NaN below zero, so that the branch not taken of a `where` may be undefined."""
    if not isinstance(x, _NUMBER):
        return _symbolic().sqrt(x)
    return math.sqrt(x) if x >= 0.0 else math.nan


def floor(x: Any) -> Any:
    """Largest whole number not above x, as a float."""
    if not isinstance(x, _NUMBER):
        return _symbolic().floor(x)
    return float(math.floor(x)) if math.isfinite(x) else x


def mod(x: Any, y: Any) -> Any:
    """Remainder of x / y with the sign of x (C's `fmod`), exact."""
    if not isinstance(x, _NUMBER) or not isinstance(y, _NUMBER):
        return _symbolic().fmod(x, y)
    return math.fmod(x, y) if y != 0.0 and math.isfinite(x) else math.nan


def minimum(x: Any, y: Any) -> Any:
    """The smaller of x and y; the other one where one is NaN (C's `fmin`)."""
    if not isinstance(x, _NUMBER) or not isinstance(y, _NUMBER):
        return _symbolic().fmin(x, y)
    return x if x < y or math.isnan(y) else y


def maximum(x: Any, y: Any) -> Any:
    """The larger of x and y; the other one where one is NaN (C's `fmax`)."""
    if not isinstance(x, _NUMBER) or not isinstance(y, _NUMBER):
        return _symbolic().fmax(x, y)
    return x if x > y or math.isnan(y) else y


def sign(x: Any) -> Any:
    """-1, 0 or 1; NaN of NaN."""
    if not isinstance(x, _NUMBER):
        return _symbolic().sign(x)
    return float((x > 0) - (x < 0)) if x == x else x


def where(condition: Any, x: Any, y: Any) -> Any:
    """Choose x where the condition holds, else y. Both are evaluated; the one not chosen may be NaN.

    Written as the sum that CasADi generates, so that signed zeros agree as well.
    """
    if isinstance(condition, (bool, *_NUMBER)):
        return (x if condition else 0.0) + (0.0 if condition else y)
    return _symbolic().if_else(condition, x, y)


def logical_and(a: Any, b: Any) -> Any:
    """Both conditions hold."""
    if isinstance(a, _NUMBER) and isinstance(b, _NUMBER):
        return bool(a) and bool(b)
    return _symbolic().logic_and(a, b)


def logical_or(a: Any, b: Any) -> Any:
    """At least one condition holds."""
    if isinstance(a, _NUMBER) and isinstance(b, _NUMBER):
        return bool(a) or bool(b)
    return _symbolic().logic_or(a, b)


def logical_not(a: Any) -> Any:
    """The condition does not hold."""
    return not a if isinstance(a, _NUMBER) else _symbolic().logic_not(a)


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
