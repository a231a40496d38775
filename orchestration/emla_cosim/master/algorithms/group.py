"""Groups of coupled instances that strong coupling steps together."""

from dataclasses import dataclass

import numpy as np

from ...base.arrays import Indices, Vector
from .extrapolation import Exchange
from .overlapped_steps import OverlappedSteps
from .quasi_newton import QuasiNewton
from .snapshot import Snapshot


@dataclass
class CoupledGroup:
    """A group of instances, and the state of its iteration.

    Args:
        members: Positions of the instances, in order.
        coupling_variables: Positions of the signals to iterate on.
        newton: The quasi-Newton iteration.
        start: Snapshot from the begin of the present step; None if an instance cannot restore its state.
        halves: Whether all instances can do steps of other lengths.
        overlapped: Does a sweep with steps that overlap; None without instances in other processes.
    """

    members: list[int]
    coupling_variables: Indices
    newton: QuasiNewton
    start: Snapshot | None
    halves: bool
    overlapped: OverlappedSteps | None = None


def loop_derivatives(exchange: Exchange, group: CoupledGroup) -> Vector | None:
    """Return the derivatives of a step's answer with respect to the guess; None without FMU support.

    They contain direct feedthrough only. The part that passes through states vanishes with the step size.
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
