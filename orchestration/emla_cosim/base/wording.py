"""Formatting of counts, numbers and names."""

from collections.abc import Container, Sequence
from decimal import Decimal


def format_count(count: int, singular: str, plural: str = "") -> str:
    """Return a count with its noun: "1 step", "2 steps".

    Args:
        count: The count.
        singular: The singular, possibly with more words: "step is late".
        plural: The plural; default: the singular and an s.
    """
    return f"{count} {singular if count == 1 else plural or f'{singular}s'}"


def format_number(value: float, digits: int = 6) -> str:
    """Return a number with `digits` digits, but a whole number with all of them: it may be a seed."""
    if abs(value) < _LARGE and value == int(value):
        return f"{value:.0f}"
    try:
        return f"{value:.{digits}g}"
    except OverflowError:  # a whole number that is too large for a float
        return f"{Decimal(value):.{digits}g}"


def format_rounded(value: float, digits: int = 3) -> str:
    """Return a number with `digits` digits, but with all digits before the point.

    Numbers have no separators of thousands, which a reader may take for decimal commas.
    """
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text and abs(value) < _LONG else text


def list_few(names: Sequence[str]) -> str:
    """Return the first names, each once, and how many more there are: "a, b and 3 more"."""
    more = f" and {len(names) - _FEW} more" if len(names) > _FEW else ""
    return ", ".join(dict.fromkeys(names[:_FEW])) + more


def shorten_line(text: str, most: int) -> str:
    """Return a text in one line, with at most so many letters of its beginning."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[:most]}..."


def find_free_name(name: str, used: Container[str]) -> str:
    """Return a name, with a number at its end if it is in use: "plant", "plant_2", "plant_3"."""
    free, number = name, 2
    while free in used:
        free, number = f"{name}_{number}", number + 1
    return free


_FEW = 8
"""Most names to list in a message."""

_LONG = 1e12
"""Rounded numbers from here on have an exponent."""

_LARGE = 1e15
"""Below it, floats represent every whole number exactly."""
