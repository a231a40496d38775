"""Save the present state of a simulation, and restore it."""

from typing import Any

from .algorithm import Algorithm


class Snapshot:
    """Copies of the states of all instances, and of what else a step changes.

    Args:
        algorithm: The algorithm, after `setup`.
        learned: Whether also what is learned of loops is restored, so that a repeated step has the same bits.
    """

    def __init__(self, algorithm: Algorithm, learned: bool = False) -> None:
        self._algorithm, self._members = algorithm, algorithm.network.instances
        self._states: list[Any] = [None] * len(self._members)
        self._values = algorithm.block if learned else algorithm.restored
        self._copy, self._steps = self._values.copy(), algorithm.steps

    def take(self) -> None:
        """Save the present state."""
        self._states = [s.save(state) for s, state in zip(self._members, self._states, strict=True)]
        self._copy[:], self._steps = self._values, self._algorithm.steps

    def restore(self) -> None:
        """Restore the saved state."""
        for instance, state in zip(self._members, self._states, strict=True):
            instance.restore(state)
        self._values[:], self._algorithm.steps = self._copy, self._steps

    def close(self) -> None:
        """Free the copies; never raises."""
        for instance, state in zip(self._members, self._states, strict=True):
            if state is not None:
                instance.forget(state)
        self._states = [None] * len(self._members)
