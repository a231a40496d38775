"""What components of data are called, and where their signals are found."""

import re
from collections.abc import Iterable

NAME = "input"
"""What the component of a table is called; a second one is input_2."""

_OWN_NAME = re.compile(rf"{NAME}(?:_\d+)?")


def data_of(signal: str, names: Iterable[str]) -> str:
    """The name, one of these, under which data are read in the place of a signal; else the signal's own."""
    ends = f".{signal}"
    named = (n for n in names if n.endswith(ends) and _OWN_NAME.fullmatch(n.removesuffix(ends)))
    return next(named, signal)
