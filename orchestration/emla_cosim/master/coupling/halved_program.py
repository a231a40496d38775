"""Order the operations of a step so that continuous instances do two halves, and others one step."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...stepper.layout import Call
from ..algorithms.algorithm import Algorithm


class Part(IntEnum):
    """The part of a step that an operation does, as in halves.h."""

    WHOLE = 0
    FIRST_HALF = 1
    SECOND_HALF = 2


@dataclass(frozen=True)
class HalvedProgram:
    """The OPERATION records of a step, and the part of the step for each."""

    operations: NDArray[Any]
    parts: NDArray[np.int32]


@dataclass(frozen=True)
class _Row:
    """An operation: which instances it calls, whose signals it reads, and whose it writes."""

    position: int
    instances: frozenset[int]
    reads: frozenset[int]
    writes: frozenset[int]
    samples: bool

    def conflicts(self, other: "_Row") -> bool:
        """Return whether the order of two operations matters."""
        return bool(
            self.instances & other.instances
            or self.writes & (other.reads | other.writes)
            or self.reads & other.writes
        )


def halve(algorithm: Algorithm, operations: NDArray[Any], sampling: Collection[int]) -> HalvedProgram | None:
    """Return a program in which all instances but those that sample do each step in two halves.

    Operations of instances that sample stay where they are relative to all that depends on them. Between
    them, continuous instances do all their first halves, and then all their second halves.

    Args:
        algorithm: The algorithm, after `setup`.
        operations: Its OPERATION records.
        sampling: Positions of the instances that sample.

    Returns:
        The program; None if a loop is solved with both kinds of instances in it, if operations of an instance
        cannot stay together, or if the program combines vectors while instances sample.
    """
    rows = list[_Row]()
    for position, operation in enumerate(operations):
        row = _read(algorithm, position, operation, sampling)
        if row is None:
            return None
        rows.append(row)
    ordered = _order(rows)
    if ordered is None:
        return None
    positions = [row.position for row, _ in ordered]
    return HalvedProgram(operations[positions], np.array([part for _, part in ordered], dtype=np.int32))


def _read(algorithm: Algorithm, position: int, operation: Any, sampling: Collection[int]) -> _Row | None:
    """Return what an operation calls, reads and writes; None if it cannot be halved."""
    exchange, target = algorithm.exchange, int(operation["target"])
    sources, none = algorithm.network.sources, frozenset[int]()
    if operation["call"] == Call.COMBINE:  # without samplers, any order of the whole program is kept
        return None if sampling else _Row(position, none, none, none, False)
    members = algorithm.groups[target].members if operation["call"] == Call.SOLVE else [target]
    if operation["call"] == Call.STEP and target == len(sources):  # passes texts on
        return _Row(position, frozenset(members), none, none, True)
    kinds = {i in sampling for i in members}
    if len(kinds) > 1:
        return None
    instances = frozenset(members)
    is_solved = operation["call"] == Call.SOLVE
    read = frozenset(exchange.owners[np.concatenate([sources[i] for i in members])].tolist())
    reads = read if is_solved or operation["call"] == Call.SET else none
    writes = instances if is_solved or operation["call"] == Call.GET else none
    return _Row(position, instances, reads, writes, kinds.pop())


def _order(rows: Sequence[_Row]) -> list[tuple[_Row, Part]] | None:
    """Return the operations in order, each with its part of the step; None if that is not possible."""
    ordered = list[tuple[_Row, Part]]()
    before, block, after = list[_Row](), list[_Row](), list[_Row]()

    def close() -> None:
        ordered.extend((row, Part.WHOLE) for row in before)
        ordered.extend((row, part) for part in (Part.FIRST_HALF, Part.SECOND_HALF) for row in block)
        ordered.extend((row, Part.WHOLE) for row in after)
        for each in (before, block, after):
            each.clear()

    for n, row in enumerate(rows):
        if row.samples:
            is_free = not any(row.conflicts(x) for x in (*block, *after))
            (before if is_free else after).append(row)
            continue
        later = [x for x in rows[n:] if x.instances & row.instances]
        if any(x.conflicts(y) for x in later for y in after):
            if any(x.instances & row.instances for x in block):
                return None
            close()
        block.append(row)
    close()
    return ordered
