"""Slaves wired together: who reads which signal, and in which order they are best stepped."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .slave import Slave, Vector


@dataclass(frozen=True)
class Link:
    """One output that drives one input, by positions of slaves and of variables in their vectors.

    `direct` says whether an output of the target that is connected itself depends on this input
    without delay.
    """

    source: int
    output: int
    target: int
    input: int
    direct: bool


class Network:
    """Slaves, the vector of all their outputs, and for each slave the signals that it reads.

    `signals` is one vector; the slave at position i writes to the part `slaves[i].outputs` of it
    and reads `sources[i]`. `order` is a good order of stepping one after the other.
    """

    def __init__(self, slaves: Sequence[Slave], signals: Vector, links: Sequence[Link]) -> None:
        self.slaves = list(slaves)
        self.signals = signals
        starts = np.cumsum([0, *(len(s.outputs) for s in slaves)])
        connected = [np.full(len(s.inputs), -1, dtype=np.intp) for s in slaves]
        for link in links:
            connected[link.target][link.input] = starts[link.source] + link.output
        if any((c < 0).any() for c in connected):
            raise ValueError("every element of a slave's input vector needs a link")
        self.sources: list[NDArray[np.intp]] = connected
        self.order = stepping_order(len(slaves), links)

    def pass_inputs(self, i: int) -> None:
        """Give slave i the present signals that it reads."""
        slave = self.slaves[i]
        self.signals.take(self.sources[i], out=slave.inputs, mode="clip")
        slave.set_inputs()


def stepping_order(count: int, links: Sequence[Link]) -> list[int]:
    """Positions of the slaves so that each follows those it depends on, as far as that can be.

    A slave whose connected outputs depend directly on an input comes after the input's source;
    the other links decide between what is left, then the order of declaration. In a loop of
    direct links the slave that waits for the fewest comes first.
    """
    waiting = set(range(count))
    order: list[int] = []
    while waiting:
        open_links = {
            (link.source, link.target, link.direct)
            for link in links
            if link.source in waiting and link.source != link.target
        }

        def cost(i: int, open_links: set[tuple[int, int, bool]] = open_links) -> tuple[int, int, int]:
            direct = sum(1 for _, target, is_direct in open_links if target == i and is_direct)
            every = len({source for source, target, _ in open_links if target == i})
            return direct, every, i

        chosen = min(waiting, key=cost)
        waiting.remove(chosen)
        order.append(chosen)
    return order
