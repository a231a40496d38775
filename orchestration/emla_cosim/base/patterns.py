"""Names as users write them: exact, short, or patterns with `*` for any text and `?` for any character."""

from collections.abc import Collection
from fnmatch import fnmatchcase

from .errors import CommandError, suggest_names


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
