"""Order the operations of a step so that continuous instances do two halves, and others one step.

Where instances sample, a step is first done as a whole, which gives what they compute. The continuous
instances then go back, and do two halves. In these, each reads the values of samplers that it read in the
whole step: from its start or its end, as the order of the program says. So sampling times and delays stay.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...stepper.layout import GROUP, OPERATION, Call
from ..algorithms.algorithm import Algorithm
from ..algorithms.group import CoupledGroup


class Part(IntEnum):
    """What an operation does in a step, as in halves.c."""

    FULL_STEP = 0
    FIRST_HALF = 1
    SECOND_HALF = 2
    SAVE = 3
    RESTORE = 4
    SWAP = 5


@dataclass
class HalvedProgram:
    """A step in halves.

    Attributes:
        operations: The OPERATION records.
        parts: What each of them does.
        continuous: Positions of the instances that do halves.
        groups: Groups that the program solves besides those of the algorithm.
        group_records: Their GROUP records.
    """

    operations: NDArray[Any]
    parts: NDArray[np.int32]
    continuous: NDArray[np.int32]
    groups: list[CoupledGroup] = field(default_factory=list)
    group_records: NDArray[Any] = field(default_factory=lambda: np.empty(0, GROUP))


def halve(algorithm: Algorithm, operations: NDArray[Any], sampling: Collection[int]) -> HalvedProgram | None:
    """Return a program in which all instances but those that sample do each step in two halves.

    Args:
        algorithm: The algorithm, after `setup`.
        operations: Its OPERATION records.
        sampling: Positions of the instances that sample.

    Returns:
        The program; None if the algorithm combines vectors while instances sample.
    """
    positions = range(len(algorithm.network.instances))
    continuous = np.array([i for i in positions if i not in sampling], dtype=np.int32)
    if not sampling:
        parts = np.repeat([Part.FIRST_HALF, Part.SECOND_HALF], len(operations))
        return HalvedProgram(np.tile(operations, 2), parts.astype(np.int32), continuous)
    if (operations["call"] == Call.COMBINE).any():
        return None
    halving = _Halving(algorithm, operations, frozenset(sampling))
    rows = list(halving.list_rows())
    ordered, parts = np.array([row for row, _ in rows], OPERATION), [part for _, part in rows]
    return HalvedProgram(ordered, np.array(parts, dtype=np.int32), continuous, halving.groups)


class _Halving:
    """The program of an algorithm in halves, with instances that sample."""

    def __init__(self, algorithm: Algorithm, operations: NDArray[Any], sampling: frozenset[int]) -> None:
        self._algorithm, self._operations, self._sampling = algorithm, operations, sampling
        writing = [(n, x) for n, x in enumerate(operations) if x["call"] in (Call.SOLVE, Call.GET)]
        self._written = {i: n for n, x in writing for i in self._find_members(x) if i in sampling}
        self._with_old_signals = set[int]()  # samplers whose signals are those from the start of the step
        self.groups = list[CoupledGroup]()

    def list_rows(self) -> Iterator[tuple[Any, Part]]:
        """Yield the operations with their parts."""
        nothing = np.zeros((), OPERATION)
        yield nothing, Part.SAVE
        yield from ((x, Part.FULL_STEP) for x in self._operations)
        yield nothing, Part.RESTORE
        reduced = [self._exclude_samplers(operation) for operation in self._operations]
        halves = [(n, operation) for n, operation in enumerate(reduced) if operation is not None]
        for part in (Part.FIRST_HALF, Part.SECOND_HALF):
            for n, operation in halves:
                yield from self._swap_signals(self._find_samplers_to_swap(n, operation))
                yield operation, part
        yield from self._swap_signals(set())

    def _swap_signals(self, old: set[int]) -> Iterator[tuple[Any, Part]]:
        """Yield what makes the signals of these samplers, and no others, those from the start of the step."""
        for i in sorted(old ^ self._with_old_signals):
            swapped = np.zeros((), OPERATION)
            swapped["target"] = i
            yield swapped, Part.SWAP
        self._with_old_signals = old

    def _exclude_samplers(self, operation: Any) -> Any:
        """Return an operation without instances that sample, for which a group may be added to `groups`.

        Returns:
            The operation; None if all its instances sample.
        """
        members = self._find_members(operation)
        remaining = [i for i in members if i not in self._sampling]
        if len(remaining) == len(members) or not remaining:
            return operation if remaining else None
        solved = operation.copy()
        solved["target"] = len(self._algorithm.groups) + len(self.groups)
        self.groups.append(self._algorithm.make_group(remaining))
        return solved

    def _find_members(self, operation: Any) -> list[int]:
        """Return the instances that an operation calls; none for what passes texts on."""
        target = int(operation["target"])
        if operation["call"] == Call.SOLVE:
            return self._algorithm.groups[target].members
        return [target] if target < len(self._algorithm.network.instances) else []

    def _find_samplers_to_swap(self, n: int, operation: Any) -> set[int]:
        """Return the samplers of which operation n reads signals from the start of the step.

        If it reads nothing, these are the ones that have such signals already, so that nothing is swapped.
        """
        if operation["call"] not in (Call.SET, Call.SOLVE):
            return self._with_old_signals
        return {i for i, written in self._written.items() if written > n}
