"""Names by patterns: * stands for anything, ? for any letter, and brackets are those of FMI's names too."""

from fnmatch import fnmatchcase


def matches_pattern(name: str, pattern: str) -> bool:
    """Whether a pattern means a name: a[*] means a[1] and a[2], as much as a[12] means a1 and a2."""
    return name == pattern or fnmatchcase(name, pattern) or fnmatchcase(name, pattern.replace("[", "[[]"))


def is_pattern(text: str) -> bool:
    """Whether a text may mean several names."""
    return any(letter in text for letter in "*?[")


def has_wildcard(text: str) -> bool:
    """Whether a name means several even where brackets are those of arrays."""
    return "*" in text or "?" in text
