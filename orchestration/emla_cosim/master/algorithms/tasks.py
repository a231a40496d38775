"""What a step consists of, and what has to come before what, whoever does it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

from .extrapolation import Exchange


class Call(IntEnum):
    """Call of an FMU instance: set its inputs, do its step, or get its outputs."""

    SET = 0
    STEP = 1
    GET = 2


_SET, _STEP = int(Call.SET), int(Call.STEP)  # comparing numbers is cheaper in the loop


@dataclass(frozen=True)
class Operation:
    """One call of one FMU instance.

    Attributes:
        call: what is called.
        slave: position of the instance in the network.
    """

    call: Call
    slave: int


def perform(exchange: Exchange, call: int, i: int, begin: float, length: float, end: float) -> None:
    """Make a call of slave i: its step is from `begin` of this length, its outputs are of `end`, all in s."""
    if call == _SET:
        exchange.pass_inputs(i, begin, length)
    elif call == _STEP:
        exchange.network.instances[i].do_step(begin, length)
    else:
        exchange.shift(i, end)
        exchange.network.instances[i].get_outputs()


@dataclass(frozen=True)
class StepTask:
    """A part of a step that one thread does: the step of a group of slaves, or one call of a slave.

    `slaves` are the positions of those that it calls. `after` are the places of tasks that have to be through
    before: all of them come earlier where one thread does everything, which gives the same results.
    `steps` says whether slaves do their step in it.
    """

    slaves: tuple[int, ...]
    after: tuple[int, ...]
    steps: bool


def plan_tasks(
    exchange: Exchange, operations: Sequence[Operation], groups: Sequence[Sequence[int]] = ()
) -> list[StepTask]:
    """The tasks of a step by place: groups of slaves come first, if there are any, then operations.

    Operations come after all groups: where one of these is done anew, none of them has been done.
    """
    network, found = exchange.network, _TaskList(len(exchange.network.instances))
    sources = [sorted(set(exchange.owners[signals].tolist())) for signals in network.sources]
    for members in groups:
        read = {source for i in members for source in sources[i]}
        found.add(members, reads=read - set(members), writes=members, steps=True)
    every = range(len(groups))
    for operation in operations:
        i, call = operation.slave, operation.call
        reads, writes = (sources[i] if call == Call.SET else ()), ((i,) if call == Call.GET else ())
        found.add((i,), reads, writes, steps=call == Call.STEP, after=every if call == Call.SET else ())
    return found.tasks


class _TaskList:
    """Tasks so far, and who used what last: slaves themselves, and their outputs."""

    def __init__(self, slaves: int) -> None:
        self.tasks: list[StepTask] = []
        self._called: list[set[int]] = [set() for _ in range(slaves)]
        self._written: list[set[int]] = [set() for _ in range(slaves)]
        self._read: list[list[int]] = [[] for _ in range(slaves)]

    def add(
        self,
        slaves: Iterable[int],
        reads: Iterable[int],
        writes: Iterable[int],
        steps: bool,
        after: Iterable[int] = (),
    ) -> None:
        """A task that calls these slaves, reads outputs of some, and writes those of others."""
        place, before = len(self.tasks), set(after)
        for i in slaves:
            before |= self._called[i]
            self._called[i] = {place}
        for i in reads:
            before |= self._written[i]
            self._read[i].append(place)
        for i in writes:
            before |= {*self._written[i], *self._read[i]}
            self._written[i], self._read[i] = {place}, []
        self.tasks.append(StepTask(tuple(slaves), tuple(sorted(before - {place})), steps))
