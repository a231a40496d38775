"""Programs: what an algorithm does in a step, as instructions that the stepper works through."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from numbers import Real

from ...base.errors import CommandError, join_names

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
        CommandError: It is none, or is for instances that do not exist.
    """
    if not isinstance(instruction, Instruction):
        raise CommandError(f"{instruction!r} is not an Operation, a Solve or a Combine.")
    instances = instruction.members if isinstance(instruction, Solve) else [instruction.instance]
    if any(position not in range(count) for position in instances):
        raise CommandError(f"{instruction!r} is not for instances from 0 to {count - 1}.")
    if len(set(instances)) < len(instances):
        raise CommandError(f"{instruction!r} has an instance twice.")
    if isinstance(instruction, Operation) and instruction.call not in list(Call):
        raise CommandError(f"{instruction.call!r} is not a Call.")


def list_vectors(program: Sequence[Instruction]) -> list[str]:
    """Return the names of the vectors that a program writes, besides the signals.

    Raises:
        CommandError: It reads a vector that it does not write, or has a wrong factor.
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
