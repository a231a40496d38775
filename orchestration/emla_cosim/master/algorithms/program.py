"""Programs: what an algorithm does in a step, as instructions and as tasks for threads."""

import math
from collections import deque
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from heapq import heapify, heappop, heappush
from numbers import Real

from ...base.errors import CommandError, join_names
from .extrapolation import Exchange

SIGNALS, PREVIOUS = "signals", "previous"
"""The vectors with the present signals, and with those one communication point earlier."""


class Call(IntEnum):
    """Call of an FMU instance: set its inputs, do its step, or get its outputs."""

    SET = 0
    STEP = 1
    GET = 2


@dataclass(frozen=True)
class Operation:
    """One call of one FMU instance.

    Attributes:
        call: what is called.
        instance: position of the instance in the network.
        every: number of steps that it does at once, at every so many steps. 0: the step multiple of the
            instance, which is 1 unless the user sets one. All operations of an instance have the same.
        store: for `Call.SET`, the vector that the inputs are read from. Values from another vector than
            the signals are held.
    """

    call: Call
    instance: int
    every: int = 0
    store: str = SIGNALS


@dataclass(frozen=True)
class Solve:
    """A step of instances that is repeated until the values that they exchange agree.

    Attributes:
        members: positions of the instances, in the order of their steps.
    """

    members: Sequence[int]


@dataclass(frozen=True)
class Combine:
    """A sum of vectors, each times a factor, for the signals of one instance.

    Vectors are as long as the signals. `signals` has the newest outputs, `previous` those one communication
    point earlier. Any other name is a vector of your own. It starts with the initial signals, and is part
    of checkpoints.

    Attributes:
        instance: position of the instance in the network.
        into: name of the vector that gets the sum.
        terms: factors by the names of vectors; added in this order.
    """

    instance: int
    into: str
    terms: Mapping[str, float]


Instruction = Operation | Solve | Combine


def check_instruction(instruction: Instruction, count: int) -> None:
    """Check what can be wrong in one instruction of a program.

    Args:
        instruction: The instruction.
        count: Number of instances.

    Raises:
        CommandError: It is not an instruction, or its instances do not exist or are named twice.
    """
    if not isinstance(instruction, Instruction):
        raise CommandError(f"{instruction!r} is not an Operation, a Solve or a Combine.")
    instances = instruction.members if isinstance(instruction, Solve) else [instruction.instance]
    if any(position not in range(count) for position in instances):
        raise CommandError(
            f"{instruction!r} uses an instance that does not exist; their numbers are 0 to {count - 1}."
        )
    if len(set(instances)) < len(instances):
        raise CommandError(f"{instruction!r} uses an instance twice.")
    if isinstance(instruction, Operation) and instruction.call not in list(Call):
        raise CommandError(f"{instruction.call!r} is not a Call.")


def list_vectors(program: Sequence[Instruction]) -> list[str]:
    """Return the names of the vectors that a program writes, besides the signals.

    Raises:
        CommandError: It reads a vector that it does not write, writes `previous`, or combines no terms or
            a factor that is not a finite number.
    """
    combinations = [x for x in program if isinstance(x, Combine)]
    written = dict.fromkeys(x.into for x in combinations)
    if PREVIOUS in written:
        raise CommandError(f"a program cannot write '{PREVIOUS}': the master does; choose another vector.")
    for combination in combinations:
        if not combination.terms:
            raise CommandError("a Combine without terms has no sum; add a term.")
        for name, factor in combination.terms.items():
            if not isinstance(factor, Real) or not math.isfinite(factor):
                raise CommandError(f"the factor of '{name}' is {factor!r}; it must be a finite number.")
    read = [name for x in combinations for name in x.terms]
    for name in [*read, *(x.store for x in program if isinstance(x, Operation))]:
        if name not in (SIGNALS, PREVIOUS) and name not in written:
            raise CommandError(
                f"the program reads the vector '{name}', which no Combine writes; there are "
                f"{join_names([SIGNALS, PREVIOUS, *written])}."
            )
    return [name for name in written if name != SIGNALS]


def move_first(program: Sequence[Instruction], instances: Collection[int]) -> list[Instruction]:
    """Return the program in which these instances, which read no signals, step before all others."""
    if not instances:
        return list(program)
    first = sorted(instances)
    if any(isinstance(x, Solve) for x in program):  # groups come first, so that threads can share the steps
        reordered: list[Instruction] = [Solve([i]) for i in first]
    else:
        reordered = [Operation(call, i) for i in first for call in (Call.STEP, Call.GET)]
    for instruction in program:
        if isinstance(instruction, Solve):
            members = [i for i in instruction.members if i not in instances]
            reordered += [Solve(members)] if members else []
        elif instruction.instance not in instances:
            reordered.append(instruction)
    return reordered


@dataclass(frozen=True)
class StepTask:
    """A part of a step that one thread does: the step of a group of instances, or one call of an instance.

    Args:
        instances: Positions of the instances that it calls.
        after: Places of the tasks that must be finished before. All are smaller than its own place, so that
            one thread can do all tasks in order, with the same results.
        steps: Whether instances do their step in it.
    """

    instances: tuple[int, ...]
    after: tuple[int, ...]
    steps: bool


def plan_tasks(
    exchange: Exchange, operations: Sequence[Operation], groups: Sequence[Sequence[int]] = ()
) -> list[StepTask]:
    """Return the tasks of a step by place: groups of instances first, then operations."""
    network, task_list = exchange.network, _TaskList(len(exchange.network.instances))
    sources = [sorted(set(exchange.owners[signals].tolist())) for signals in network.sources]
    for members in groups:
        read = {source for i in members for source in sources[i]}
        task_list.add(members, reads=read - set(members), writes=members, steps=True)
    for operation in operations:
        i, call = operation.instance, operation.call
        reads, writes = (sources[i] if call == Call.SET else ()), ((i,) if call == Call.GET else ())
        task_list.add((i,), reads, writes, steps=call == Call.STEP)
    return task_list.tasks


class _TaskList:
    """Tasks so far, and which of them last called each instance, and last wrote and read its outputs."""

    def __init__(self, instances: int) -> None:
        self.tasks: list[StepTask] = []
        self._called: list[set[int]] = [set() for _ in range(instances)]
        self._written: list[set[int]] = [set() for _ in range(instances)]
        self._read: list[list[int]] = [[] for _ in range(instances)]

    def add(self, instances: Iterable[int], reads: Iterable[int], writes: Iterable[int], steps: bool) -> None:
        """Add a task that calls these instances, reads outputs of some, and writes those of others."""
        number, dependencies = len(self.tasks), set[int]()
        for i in instances:
            dependencies |= self._called[i]
            self._called[i] = {number}
        for i in reads:
            dependencies |= self._written[i]
            self._read[i].append(number)
        for i in writes:
            dependencies |= {*self._written[i], *self._read[i]}
            self._written[i], self._read[i] = {number}, []
        self.tasks.append(StepTask(tuple(instances), tuple(sorted(dependencies - {number})), steps))


def count_waits(tasks: Sequence[StepTask]) -> tuple[list[int], list[list[int]]]:
    """Return how many tasks each one waits for, and which tasks wait for it."""
    followers = [list[int]() for _ in tasks]
    for task_number, task in enumerate(tasks):
        for before in task.after:
            followers[before].append(task_number)
    return [len(task.after) for task in tasks], followers


def find_split_steps(exchange: Exchange, operations: Sequence[Operation]) -> set[int]:
    """Return the instances whose steps can overlap: those in other processes, if there are several."""
    stepped = {o.instance for o in operations if o.call == Call.STEP}
    separate = {i for i in stepped if exchange.network.instances[i].steps_apart}
    return separate if len(separate) > 1 else set()


def overlap_steps(
    exchange: Exchange, operations: Sequence[Operation], split: Collection[int]
) -> list[tuple[Operation, bool]]:
    """Return operations with the same result in an order in which steps overlap.

    A step in another process begins as soon as its inputs are ready. It is awaited when nothing else can
    be done.

    Args:
        exchange: The values of the instances.
        operations: Operations with the present signals, in their order.
        split: Positions of the instances in other processes.

    Returns:
        Each operation, and whether it is the end of a step that another entry begins.
    """
    if not split:
        return [(operation, False) for operation in operations]
    waits, followers = count_waits(plan_tasks(exchange, operations))
    ready, running = [task_number for task_number, n in enumerate(waits) if not n], deque[int]()
    # the smallest number first, so that the order stays near that of the program
    heapify(ready)
    ordered = list[tuple[Operation, bool]]()
    while ready or running:
        is_end = not ready
        task_number = running.popleft() if is_end else heappop(ready)
        operation = operations[task_number]
        ordered.append((operation, is_end))
        if not is_end and operation.call == Call.STEP and operation.instance in split:
            running.append(task_number)
            continue
        for follower in followers[task_number]:
            waits[follower] -= 1
            if not waits[follower]:
                heappush(ready, follower)
    return ordered
