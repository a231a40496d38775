"""The exact numbers 0, 1 and -1, with which calculations disappear.

Mechanics in space is mostly zeros for a machine in the plane. `ZERO * x` is `ZERO` and `ZERO + x` is `x`
for a float, an array and a symbol alike. So one text of the equations gives short code for symbols, and the
same bits for floats. A float 0.0 has no such effect: it may be a value that happens to be zero.
"""

from typing import Any


class Exact:
    """One of the numbers 0, 1 and -1, known before any value is."""

    __slots__ = ("value",)
    __array_ufunc__ = None  # NumPy leaves `array + exact` to the methods here

    def __init__(self, value: int) -> None:
        self.value = value

    def __repr__(self) -> str:
        return f"Exact({self.value})"

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Exact):
            return _exact(self.value + other.value)
        return other if self.value == 0 else self.value + other

    def __radd__(self, other: Any) -> Any:
        return other if self.value == 0 else other + float(self.value)

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Exact):
            return _exact(self.value - other.value)
        return -other if self.value == 0 else float(self.value) - other

    def __rsub__(self, other: Any) -> Any:
        return other if self.value == 0 else other - float(self.value)

    def __mul__(self, other: Any) -> Any:
        if self.value == 0:
            return ZERO
        return other if self.value == 1 else -other

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, Exact):
            return _exact(self.value * other.value)
        return ZERO if self.value == 0 else float(self.value) / other

    def __rtruediv__(self, other: Any) -> Any:
        if self.value == 0:
            raise ZeroDivisionError("division by an exact zero: the mechanism is singular in every pose")
        return other if self.value == 1 else -other

    def __neg__(self) -> "Exact":
        return _exact(-self.value)


def _exact(value: int) -> Any:
    return (ZERO, ONE, float(value), float(value), MINUS_ONE)[value]


ZERO, ONE, MINUS_ONE = Exact(0), Exact(1), Exact(-1)


def is_zero(x: Any) -> bool:
    """Return whether x is the exact zero."""
    return isinstance(x, Exact) and x.value == 0


def exact(x: Any) -> Any:
    """Return the exact number for a float that is 0, 1 or -1; anything else unchanged."""
    if isinstance(x, (float, int)) and x in (-1.0, 0.0, 1.0):
        return _exact(int(x))
    return x


def plain(x: Any) -> Any:
    """Return a float for an exact number; anything else unchanged."""
    return float(x.value) if isinstance(x, Exact) else x
