"""Programs: what an algorithm does in a step, as instructions that the stepper works through."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

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
