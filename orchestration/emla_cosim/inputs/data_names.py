"""What components of data are called, and where their signals are found."""

import re
from collections.abc import Iterable

NAME = "input"
"""What the component of a table is called; a second one is input_2."""

_OWN_NAME = re.compile(rf"{NAME}(?:_\d+)?")


def find_data_names(names: Iterable[str]) -> dict[str, str]:
    """The names, among these, under which data are read, by the signal in whose place they are."""
    found: dict[str, str] = {}
    for name in names:
        if name.startswith(NAME):
            component, _, signal = name.partition(".")
            if _OWN_NAME.fullmatch(component):
                found.setdefault(signal, name)
    return found
