"""Dependencies of an FMU's unknowns on its knowns, from the model description."""

from collections.abc import Sequence, Set

from fmpy.model_description import Unknown


class Dependencies:
    """The dependencies of one list of unknowns, by names of variables."""

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
        """Return the outputs that depend on a known.

        Without a list of unknowns, all outputs depend on it. In a list, an output without an entry depends on
        nothing, and an output without declared dependencies depends on everything.

        Args:
            outputs: The names of the outputs to select from.
            known: The name of the known.
        """
        if self._silent:
            return outputs
        return (outputs & self._on_all) | (outputs & self._on.get(known, set()))
