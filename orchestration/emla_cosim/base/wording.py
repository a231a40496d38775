"""Names as users write them, with patterns, and formatting of counts, numbers and names."""

from collections.abc import Collection, Container, Sequence
from decimal import Decimal
from fnmatch import fnmatchcase

from .errors import CommandError, suggest_names


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
    """Return a text with the first names, each once, and how many more there are: "a, b and 3 more"."""
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


def matches_pattern(name: str, pattern: str) -> bool:
    """Return whether a pattern matches: `a[*]` matches a[1], and `a[12]` matches a1 and a2 as well."""
    return name == pattern or fnmatchcase(name, pattern) or fnmatchcase(name, pattern.replace("[", "[[]"))


def is_pattern(text: str) -> bool:
    """Return whether a text can match several names."""
    return any(letter in text for letter in "*?[")


def has_wildcard(text: str) -> bool:
    """Return whether a name has wildcards other than brackets, which may be those of an array."""
    return "*" in text or "?" in text


def find_name(text: str, names: Collection[str], main: str = "") -> str | None:
    """Return the name that a text without wildcards means; None if there is none.

    Args:
        text: A name.
        names: All names.
        main: The component whose variables need no component's name; empty without one.
    """
    return next((name for name in (text, f"{main}.{text}") if name in names), None)


def find_names(text: str, names: Collection[str], main: str = "") -> list[str]:
    """Return the names that a text means, in their order; none if nothing matches.

    Args:
        text: A name or a pattern.
        names: All names.
        main: As in `find_name`.
    """
    matching = [name for name in names if matches_pattern(name, text)]
    return matching or (find_names(f"{main}.{text}", names) if main else [])


def select_names(
    texts: Collection[str], names: Collection[str], kind: str, main: str = "", hint: str = ""
) -> list[str]:
    """Return the names that any of the texts means, in the order of the texts, each once.

    Args:
        texts: Names or patterns.
        names: All names.
        kind: What error messages call a name, such as `signal`.
        main: As in `find_name`.
        hint: What the message says if no name is similar. Default: a list of the names.

    Raises:
        CommandError: Nothing matches a text.
    """
    selected: dict[str, None] = {}
    for text in texts:
        matching = find_names(text, names, main)
        if not matching:
            suggestion = _suggest_full_names(text, names, main, hint)
            raise CommandError(f"no {kind} matches '{text}'; {suggestion}", name=text)
        selected |= dict.fromkeys(matching)
    return list(selected)


def require_name(text: str, names: Collection[str], main: str, kind: str, use: str) -> str:
    """Return the name that a text without wildcards means, see `find_name`.

    Raises:
        CommandError: There is none. The message says that there is no such `kind` to `use`.
    """
    if (name := find_name(text, names, main)) is None:
        suggestion = _suggest_full_names(text, names, main)
        raise CommandError(f"there is no {kind} '{text}' to {use}; {suggestion}", name=text)
    return name


def _suggest_full_names(text: str, names: Collection[str], main: str, hint: str = "") -> str:
    is_short = main and not text.startswith(f"{main}.")
    return suggest_names(f"{main}.{text}" if is_short else text, names, hint)
