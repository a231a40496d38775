"""Save the present state of a simulation, and restore it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.arrays import Vector
from .algorithm import Algorithm


class Snapshot:
    """Copies of the states of some instances, of the signals, and of the algorithm's state."""

    def __init__(self, algorithm: Algorithm, instances: Sequence[int] | None = None) -> None:
        network = algorithm.network
        self._algorithm = algorithm
        self._members = [network.instances[i] for i in (instances or range(len(network.instances)))]
        self._states: list[Any] = [None] * len(self._members)
        self._copies: list[Vector] = []  # as large as the whole system: allocated by the first `take`
        self._steps = algorithm.steps

    def take(self) -> None:
        """Save the present state."""
        algorithm = self._algorithm
        self._states = [s.save(state) for s, state in zip(self._members, self._states, strict=True)]
        if not self._copies:
            self._copies = [np.empty_like(present) for present in self._present()]
        for copy, present in zip(self._copies, self._present(), strict=True):
            copy[:] = present
        self._steps = algorithm.steps

    def restore(self) -> None:
        """Restore the saved state."""
        self.restore_instances()
        for copy, present in zip(self._copies, self._present(), strict=True):
            present[:] = copy
        self._algorithm.steps = self._steps

    def restore_instances(self) -> None:
        """Restore the instances only, without signals and history."""
        for instance, state in zip(self._members, self._states, strict=True):
            instance.restore(state)

    def _present(self) -> list[Vector]:
        return [self._algorithm.network.signals, *self._algorithm.kept.values()]

    def close(self) -> None:
        """Free the copies; never raises."""
        for instance, state in zip(self._members, self._states, strict=True):
            if state is not None:
                instance.forget(state)
        self._states = [None] * len(self._members)
