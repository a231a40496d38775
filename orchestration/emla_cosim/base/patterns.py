"""Patterns of names: `*` is any text, `?` is any character, brackets are those of FMI arrays too."""

from fnmatch import fnmatchcase


def matches_pattern(name: str, pattern: str) -> bool:
    """Return whether a pattern matches: `a[*]` matches a[1], and `a[12]` matches a1 and a2 as well."""
    return name == pattern or fnmatchcase(name, pattern) or fnmatchcase(name, pattern.replace("[", "[[]"))


def is_pattern(text: str) -> bool:
    """Return whether a text can match several names."""
    return any(letter in text for letter in "*?[")


def has_wildcard(text: str) -> bool:
    """Return whether a name has wildcards other than brackets, which may be those of an array."""
    return "*" in text or "?" in text
