"""What a step consists of, and what has to come before what, whoever does it."""

from collections.abc import Iterable
from dataclasses import dataclass

from ..algorithms.sampling import Call, Sampling
from ..algorithms.strong import Strong


@dataclass(frozen=True)
class Task:
    """A part of a step that one thread does: the step of a group of slaves, or one call of a slave.

    `slaves` are the positions of those that it calls. `after` are the places of tasks that have to be through
    before: all of them come earlier where one thread does everything, which gives the same results.
    `steps` says whether slaves do their step in it.
    """

    slaves: tuple[int, ...]
    after: tuple[int, ...]
    steps: bool


def tasks(algorithm: Sampling) -> list[Task]:
    """The tasks of a step by place: groups come first, if the algorithm has any, then operations.

    Operations come after all groups: where one of these is done anew, none of them has been done.
    """
    network, found = algorithm.network, _Found(len(algorithm.network.slaves))
    owners = algorithm.exchange.owners
    sources = [sorted(set(owners[signals].tolist())) for signals in network.sources]
    groups = algorithm.groups if isinstance(algorithm, Strong) else []
    for group in groups:
        read = {source for i in group.members for source in sources[i]}
        found.add(group.members, reads=read - set(group.members), writes=group.members, steps=True)
    every = range(len(groups))
    for operation in algorithm.operations:
        i, call = operation.slave, operation.call
        reads, writes = (sources[i] if call == Call.SET else ()), ((i,) if call == Call.GET else ())
        found.add((i,), reads, writes, steps=call == Call.STEP, after=every if call == Call.SET else ())
    return found.tasks


class _Found:
    """Tasks so far, and who used what last: slaves themselves, and their outputs."""

    def __init__(self, slaves: int) -> None:
        self.tasks: list[Task] = []
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
        self.tasks.append(Task(tuple(slaves), tuple(sorted(before - {place})), steps))
