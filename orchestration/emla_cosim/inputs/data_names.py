"""Names of components that provide data, and of their signals."""

import re
from collections.abc import Iterable

NAME = "input"
"""The name of a table's component; a second one is input_2."""

_OWN_NAME = re.compile(rf"{NAME}(?:_\d+)?")


def find_data_names(names: Iterable[str]) -> dict[str, str]:
    """Return the names of data signals by the signal that they replace.

    Args:
        names: The names to search.
    """
    signals: dict[str, str] = {}
    for name in names:
        if name.startswith(NAME):
            component, _, signal = name.partition(".")
            if _OWN_NAME.fullmatch(component):
                signals.setdefault(signal, name)
    return signals
