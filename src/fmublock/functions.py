"""The functions a block may use besides + - * / and comparisons.

Each works on floats and on symbols, and gives the same bits for both. The float branch repeats
what the C code generated from the symbol does: with infinities, signed zeros, and NaN where
Python's `math` would raise. Write powers as products, because the C library's `pow(x, 2)` and
`x * x` may differ in the last bit. Do the same for lengths instead of calling `hypot`.
"""

import math
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

_NUMBER = (float, int)


class Symbolic:
    """Represents a float while an FMU is built; its value is known only in a run."""

    def call(self, name: str, arguments: Sequence[Any]) -> Any:
        """Call CasADi's function of this name; this symbol is one of the arguments."""
        raise NotImplementedError


def _on_symbols(name: str, *arguments: Any) -> Any:
    """Call CasADi's function of this name. CasADi is imported only here: FMU hosts need not have it."""
    for argument in arguments:
        if isinstance(argument, Symbolic):
            return argument.call(name, arguments)
    return getattr(import_module("casadi"), name)(*arguments)


def _defined(function: Callable[..., float], *arguments: float) -> float:
    """Call a function of `math`; return NaN if it raises ValueError."""
    try:
        return function(*arguments)
    except ValueError:
        return math.nan


def sin(x: Any) -> Any:
    """Return the sine of x in rad."""
    return _defined(math.sin, x) if isinstance(x, _NUMBER) else _on_symbols("sin", x)


def cos(x: Any) -> Any:
    """Return the cosine of x in rad."""
    return _defined(math.cos, x) if isinstance(x, _NUMBER) else _on_symbols("cos", x)


def tan(x: Any) -> Any:
    """Return the tangent of x in rad."""
    return _defined(math.tan, x) if isinstance(x, _NUMBER) else _on_symbols("tan", x)


def arcsin(x: Any) -> Any:
    """Return the arc sine in rad, between -pi/2 and pi/2; NaN beyond -1 and 1."""
    return _defined(math.asin, x) if isinstance(x, _NUMBER) else _on_symbols("asin", x)


def arccos(x: Any) -> Any:
    """Return the arc cosine in rad, between 0 and pi; NaN beyond -1 and 1."""
    return _defined(math.acos, x) if isinstance(x, _NUMBER) else _on_symbols("acos", x)


def arctan(x: Any) -> Any:
    """Return the arc tangent in rad, between -pi/2 and pi/2."""
    return math.atan(x) if isinstance(x, _NUMBER) else _on_symbols("atan", x)


def arctan2(y: Any, x: Any) -> Any:
    """Return the angle of the point (x, y) in rad, between -pi and pi."""
    if not isinstance(y, _NUMBER) or not isinstance(x, _NUMBER):
        return _on_symbols("atan2", y, x)
    return math.atan2(y, x)


def tanh(x: Any) -> Any:
    """Return the hyperbolic tangent."""
    return math.tanh(x) if isinstance(x, _NUMBER) else _on_symbols("tanh", x)


def exp(x: Any) -> Any:
    """Return the exponential; infinity on overflow."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("exp", x)
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


def log(x: Any) -> Any:
    """Return the natural logarithm; -inf at zero, NaN below."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("log", x)
    return -math.inf if x == 0.0 else _defined(math.log, x)


def sqrt(x: Any) -> Any:
    """Return the square root; NaN below zero, so that `where` can choose another branch."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("sqrt", x)
    return math.sqrt(x) if x >= 0.0 else math.nan


def floor(x: Any) -> Any:
    """Return the largest whole number not above x, as a float."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("floor", x)
    return math.copysign(math.floor(x), x) if math.isfinite(x) else x


def mod(x: Any, y: Any) -> Any:
    """Return the exact remainder of x / y with the sign of x (C's `fmod`)."""
    if not isinstance(x, _NUMBER) or not isinstance(y, _NUMBER):
        return _on_symbols("fmod", x, y)
    return _defined(math.fmod, x, y)


def minimum(x: Any, y: Any) -> Any:
    """Return the smaller of x and y, or the other one if one is NaN; of two zeros either (C's `fmin`)."""
    if not isinstance(x, _NUMBER) or not isinstance(y, _NUMBER):
        return _on_symbols("fmin", x, y)
    return 1.0 * (x if x <= y or y != y else y)


def maximum(x: Any, y: Any) -> Any:
    """Return the larger of x and y, or the other one if one is NaN; of two zeros either (C's `fmax`)."""
    if not isinstance(x, _NUMBER) or not isinstance(y, _NUMBER):
        return _on_symbols("fmax", x, y)
    return 1.0 * (x if x >= y or y != y else y)


def sign(x: Any) -> Any:
    """Return -1, 0 or 1; NaN for NaN."""
    if not isinstance(x, _NUMBER):
        return _on_symbols("sign", x)
    return math.copysign(1.0, x) if x < 0.0 or x > 0.0 else float(x)


def where(condition: Any, x: Any, y: Any) -> Any:
    """Return x if the condition holds, otherwise y. Both are evaluated; the other one can be NaN.

    Written as the sum that CasADi generates, so that signed zeros agree as well.

    Args:
        condition: comparison, number or symbol.
        x: value if it holds.
        y: value if it does not hold.

    Examples:
        >>> from fmublock import where
        >>> where(1.0 < 2.0, 3.0, 4.0)
        3.0
    """
    if isinstance(condition, _NUMBER):
        return (x if condition else 0.0) + (0.0 if condition else y)
    return _on_symbols("if_else", condition, x, y)


def logical_and(a: Any, b: Any) -> Any:
    """Return whether both conditions hold."""
    if isinstance(a, _NUMBER) and isinstance(b, _NUMBER):
        return bool(a) and bool(b)
    return _on_symbols("logic_and", a, b)


def logical_or(a: Any, b: Any) -> Any:
    """Return whether at least one condition holds."""
    if isinstance(a, _NUMBER) and isinstance(b, _NUMBER):
        return bool(a) or bool(b)
    return _on_symbols("logic_or", a, b)


def logical_not(a: Any) -> Any:
    """Return whether the condition does not hold."""
    return not a if isinstance(a, _NUMBER) else _on_symbols("logic_not", a)


def clamp(x: Any, low: Any, high: Any) -> Any:
    """Return x, limited to the range from low to high.

    Examples:
        >>> from fmublock import clamp
        >>> clamp(5.0, -1.0, 1.0)
        1.0
    """
    return minimum(maximum(x, low), high)


def limit_magnitude(x: Any, y: Any, limit: Any) -> tuple[Any, Any, Any]:
    """Shorten the vector (x, y) to a length of at most `limit`.

    A vector that is longer by rounding only does not count as shortened.

    Args:
        x: first component.
        y: second component, in the unit of x.
        limit: largest length, greater than 0, in the unit of x.

    Returns:
        Both components, and 1 if the vector was shortened, otherwise 0.

    Examples:
        >>> from fmublock import limit_magnitude
        >>> limit_magnitude(3.0, 4.0, 10.0)
        (3.0, 4.0, 0.0)
    """
    length = sqrt(x * x + y * y)
    scale = minimum(limit / maximum(length, limit), 1.0)
    return scale * x, scale * y, where(length > 1.000000001 * limit, 1.0, 0.0)


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Return the scalar product of two vectors, summed from the first element on.

    Args:
        a: list of n values.
        b: list of n values.

    Raises:
        ValueError: the vectors have different lengths.

    Examples:
        >>> from fmublock import dot
        >>> dot([1.0, 2.0], [3.0, 4.0])
        11.0
    """
    products = [x * y for x, y in zip(a, b, strict=True)]
    total = products[0]
    for product in products[1:]:
        total = total + product
    return total


def matvec(M: Sequence[Sequence[Any]], x: Sequence[Any]) -> list[Any]:
    """Return the product of a matrix and a vector.

    Args:
        M: list of m rows of n values.
        x: list of n values.

    Returns:
        List of m values.

    Raises:
        ValueError: a row and the vector have different lengths.

    Examples:
        >>> from fmublock import matvec
        >>> matvec([[1.0, 0.0], [0.0, 2.0]], [3.0, 4.0])
        [3.0, 8.0]
    """
    return [dot(row, x) for row in M]
