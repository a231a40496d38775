"""Slaves that depend on each other, as strong coupling steps them together."""

from dataclasses import dataclass

import numpy as np

from ...base.arrays import Indices, Vector
from .extrapolation import Exchange
from .quasi_newton import QuasiNewton
from .snapshot import Snapshot


@dataclass
class CoupledGroup:
    """Slaves in order, the signals to agree on, and what was learned about them.

    `start` is where the present step began; None where a slave of the group cannot go back. `halves`
    says whether all can do shorter steps.
    """

    members: list[int]
    coupling_variables: Indices
    newton: QuasiNewton
    start: Snapshot | None
    halves: bool


def loop_derivatives(exchange: Exchange, group: CoupledGroup) -> Vector | None:
    """How the answer of a step changes with the guess, value by value; None where a slave does not say.

    What shows at once in outputs counts; what goes through states is less, the shorter the step.
    """
    network, count = exchange.network, len(group.coupling_variables)
    if not all(network.instances[i].differentiates for i in group.members):
        return None
    found = np.zeros((count, count))
    for c, signal in enumerate(group.coupling_variables):
        change = np.zeros(len(network.signals))
        change[signal] = 1.0
        for i in group.members:
            direction = exchange.shares(i) * change[network.sources[i]]
            answer = network.instances[i].directional_derivative(direction)
            if answer is None:
                return None
            change[network.parts[i]] = answer
        found[:, c] = change[group.coupling_variables]
    return found
