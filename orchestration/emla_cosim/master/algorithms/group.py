"""Groups of coupled instances whose step is repeated until the exchanged values agree."""

from dataclasses import dataclass

import numpy as np

from ...base.arrays import Indices, Vector
from ...base.errors import RunError
from .extrapolation import Exchange
from .newton import Scale
from .program import Call, Operation

SWEEPS = 30
"""Largest number of sweeps over a loop. After these, no solution is assumed to be near."""

HALVINGS = 10
"""Number of times that a failed step is halved before the run ends."""


@dataclass
class CoupledGroup:
    """A group of instances, and the Jacobian of its loop.

    Args:
        exchange: The values of the instances.
        scale: Sizes of the signals.
        members: Positions of the instances, in order.
        coupling_variables: Positions of the signals to iterate on.
        jacobian: J of the quasi-Newton iteration, shape (n, n); see `quasi_newton.h`. Changed in place.
        is_saved: Whether all instances can restore their states.
        is_halved: Whether all instances can do steps of other lengths.
    """

    exchange: Exchange
    scale: Scale
    members: list[int]
    coupling_variables: Indices
    jacobian: Vector
    is_saved: bool
    is_halved: bool

    @property
    def operations(self) -> list[Operation]:
        """The calls of a sweep, in order."""
        return [Operation(call, i) for i in self.members for call in Call]

    def make_disagreement_error(self, time: float, step: float, gap: Vector, sweeps: int) -> RunError:
        """Return the error of a step whose values do not agree.

        Args:
            time: Start of the step, in s.
            step: Its length in s.
            gap: What is left of the differences of the coupling variables, in their units.
            sweeps: Number of sweeps.
        """
        network = self.exchange.network
        names = network.loop_name(self.members)
        gaps = self.scale.relative(gap, self.coupling_variables)
        worst = network.names[self.coupling_variables[gaps.argmax()]]
        if not np.isfinite(gaps).all():
            return RunError(
                f"in the loop {names}, {worst} is infinite or NaN on the step from t = {time:.9g} s of "
                f"{step:.3g} s."
            )
        return RunError(
            f"the loop {names} does not converge on the step from t = {time:.9g} s of {step:.3g} s in "
            f"{sweeps} sweeps: {worst} still changes by {gaps.max():.2g} of its size."
        )


def loop_derivatives(exchange: Exchange, group: CoupledGroup) -> Vector | None:
    """Return the derivatives of a step's answer with respect to the guess; None without FMU support.

    They contain direct feedthrough only. The part that passes through states vanishes with the step size.
    """
    network, count = exchange.network, len(group.coupling_variables)
    if not all(network.instances[i].differentiates for i in group.members):
        return None
    derivatives = np.zeros((count, count))
    for c, signal in enumerate(group.coupling_variables):
        change = np.zeros(len(network.signals))
        change[signal] = 1.0
        for i in group.members:
            direction = exchange.compute_shares(i) * change[network.sources[i]]
            output_change = network.instances[i].directional_derivative(direction)
            if output_change is None:
                return None
            change[network.parts[i]] = output_change
        derivatives[:, c] = change[group.coupling_variables]
    return derivatives
