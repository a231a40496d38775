"""A point of a simulation to which it can go back."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.arrays import Vector
from .algorithm import Algorithm


class Snapshot:
    """Copies of the states of some slaves, of the signals, and of what the algorithm remembers."""

    def __init__(self, algorithm: Algorithm, slaves: Sequence[int] | None = None) -> None:
        network = algorithm.network
        self._algorithm = algorithm
        self._members = [network.instances[i] for i in (slaves or range(len(network.instances)))]
        self._states: list[Any] = [None] * len(self._members)
        self._copies: list[Vector] = []  # each as long as the whole system: made where one is taken
        self._steps = algorithm.steps

    def take(self) -> None:
        """Remember the present."""
        algorithm = self._algorithm
        self._states = [s.save(state) for s, state in zip(self._members, self._states, strict=True)]
        if not self._copies:
            self._copies = [np.empty_like(present) for present in self._present()]
        for copy, present in zip(self._copies, self._present(), strict=True):
            copy[:] = present
        self._steps = algorithm.steps

    def restore(self) -> None:
        """Go back to what was taken."""
        self.restore_slaves()
        for copy, present in zip(self._copies, self._present(), strict=True):
            present[:] = copy
        self._algorithm.steps = self._steps

    def restore_slaves(self) -> None:
        """Take the slaves back, and leave signals and history as they are."""
        for slave, state in zip(self._members, self._states, strict=True):
            slave.restore(state)

    def _present(self) -> list[Vector]:
        return [self._algorithm.network.signals, *self._algorithm.kept.values()]

    def close(self) -> None:
        """Free the copies; never raises."""
        for slave, state in zip(self._members, self._states, strict=True):
            if state is not None:
                slave.forget(state)
        self._states = [None] * len(self._members)
