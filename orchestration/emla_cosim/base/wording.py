"""Counts in words, and numbers in digits."""

from decimal import Decimal


def format_count(count: int, one: str, many: str = "", form: str = "") -> str:
    """A count and what is counted: "1 step", "2 steps"; `many` where more than an s makes the difference.

    Both may go on: `format_count(n, "step is late", "steps are late")`. `form` is that of the number.
    """
    return f"{count:{form}} {one if count == 1 else many or f'{one}s'}"


def format_number(value: float, digits: int = 6) -> str:
    """A number in so many digits; a whole one, which may be an identity such as a seed, in all of its own."""
    if abs(value) < _LARGE and value == int(value):
        return f"{value:.0f}"
    try:
        return f"{value:.{digits}g}"
    except OverflowError:  # a whole number that is too large for a float
        return f"{Decimal(value):.{digits}g}"


_LARGE = 1e15
"""Below it every whole number is a number of its own in floating point."""
