"""Which unknowns of an FMU depend on which knowns, as its model description says."""

from collections.abc import Sequence, Set

from fmpy.model_description import Unknown


class Dependencies:
    """The dependencies of one list of unknowns, by the names of variables."""

    def __init__(self, unknowns: Sequence[Unknown]) -> None:
        self._silent = not unknowns
        self._on_all: set[str] = set()
        self._on: dict[str, set[str]] = {}
        for unknown in unknowns:
            if unknown.variable is None:
                continue
            name, knowns = str(unknown.variable.name), unknown.dependencies
            if knowns is None:
                self._on_all.add(name)
            for known in knowns or ():
                self._on.setdefault(str(known.name), set()).add(name)

    def among(self, outputs: Set[str], known: str) -> Set[str]:
        """Those of some outputs that depend on a known; what is not declared is taken to depend.

        An output without an entry has a value of its own, unless the model description says nothing at all.
        """
        if self._silent:
            return outputs
        return (outputs & self._on_all) | (outputs & self._on.get(known, set()))
