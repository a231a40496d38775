"""Identifiers that every tool accepts as names in an SSP, and the names that they represent.

OMSimulator accepts ASCII letters, digits and underscores. The `id` next to an identifier has the name.
"""

import re
from collections.abc import Iterable

from ...base.wording import find_free_name

_LETTERS = "A-Z_a-z\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u3001-\ud7ff"
"""Characters that an XML id can begin with, for a set of a regular expression."""

_NOT_IN_ID = rf"[^{_LETTERS}0-9.-]|^[^{_LETTERS}]|_(?=x)"  # compiling it is slow, and few names need it
_ESCAPED = re.compile("_x([0-9A-F]+)_")


def make_identifier(name: str) -> str:
    """Return a name with underscores in place of characters that not every tool accepts."""
    plain = re.sub("[^A-Za-z0-9_]", "_", name)
    return plain if re.match("[A-Za-z]", plain) else f"c_{plain}"


def make_identifiers(names: Iterable[str]) -> dict[str, str]:
    """Return a different identifier for each name. Names that are identifiers keep theirs."""
    names = list(names)
    used = {name for name in names if make_identifier(name) == name}
    identifiers = {}
    for name in names:
        identifier = make_identifier(name)
        if identifier != name:
            identifier = find_free_name(identifier, used)
            used.add(identifier)
        identifiers[name] = identifier
    return identifiers


def format_id(identifier: str, name: str) -> str | None:
    """Return the id that says which name an identifier represents; None if they are the same.

    Characters that an XML id cannot have are written as their number, such as _x0020_ for a space.
    """
    if identifier == name:
        return None
    return re.sub(_NOT_IN_ID, lambda match: f"_x{ord(match[0]):04X}_", name)


def parse_id(identifier: str, id_: str | None) -> str:
    """Return the name that an identifier represents: the identifier itself unless the id says another."""
    if id_ is None:
        return identifier
    name = _ESCAPED.sub(_unescape, id_)
    # an id of another tool can be anything; ours becomes the identifier, perhaps with a number
    prefix = re.escape(make_identifier(name))
    return name if re.fullmatch(rf"{prefix}(_\d+)?", identifier) else identifier


def _unescape(match: re.Match[str]) -> str:
    number = int(match[1], 16)
    return chr(number) if number <= 0x10FFFF else match[0]
