"""Groups of coupled instances whose step is repeated until the exchanged values agree."""

from dataclasses import dataclass

import numpy as np

from ...base.arrays import Indices, Vector
from ...base.errors import RunError
from ..instances.fmu_instance import DiscardedStepError
from .extrapolation import Exchange
from .overlapped_steps import OverlappedSteps
from .program import Call, Operation
from .quasi_newton import NoAgreementError, QuasiNewton
from .scale import Scale
from .snapshot import Snapshot

SWEEPS = 30
"""Largest number of sweeps over a loop. After these, no solution is assumed to be near."""

HALVINGS = 10
"""Number of times that a failed step is halved before the run ends."""


@dataclass
class CoupledGroup:
    """A group of instances, and the state of its iteration.

    Args:
        exchange: The values of the instances.
        scale: Sizes of the signals.
        tolerance: Difference at which values count as agreed, relative to the size of each signal.
        members: Positions of the instances, in order.
        coupling_variables: Positions of the signals to iterate on.
        newton: The quasi-Newton iteration.
        start: Snapshot from the begin of the present step; None if an instance cannot restore its state.
        halves: Whether all instances can do steps of other lengths.
        overlapped: Does a sweep with steps that overlap; None without instances in other processes.
    """

    exchange: Exchange
    scale: Scale
    tolerance: float
    members: list[int]
    coupling_variables: Indices
    newton: QuasiNewton
    start: Snapshot | None
    halves: bool
    overlapped: OverlappedSteps | None = None
    sweeps: int = 0
    """Sweeps so far."""

    @property
    def jacobian(self) -> Vector:
        """J of the quasi-Newton iteration, shape (n, n); changed in place."""
        return self.newton.jacobian

    @property
    def operations(self) -> list[Operation]:
        """The calls of a sweep, in order."""
        return [Operation(call, i) for i in self.members for call in Call]

    def advance(self, time: float, step: float, reached: int, halvings: int = HALVINGS) -> None:
        """Bring the group to the end of a step, in halves if one step fails.

        Args:
            time: Start of the step, in s.
            step: Its length in s.
            reached: Number of communication steps after it.
            halvings: How often it may be halved.

        Raises:
            RunError: The step failed, or the values do not agree.
        """
        if self.start is not None:
            self.start.take()
        try:
            self._solve(time, step, reached)
        except (DiscardedStepError, NoAgreementError) as failure:
            if self.start is None or not self.halves or not halvings:
                raise self.failure_error(time, step, failure) from failure
            self.start.restore()
            middle, end = time + 0.5 * step, time + step
            self.advance(time, middle - time, reached, halvings - 1)
            self.advance(middle, end - middle, reached, halvings - 1)

    def _solve(self, time: float, step: float, reached: int) -> None:
        exchange, network = self.exchange, self.exchange.network
        guess = exchange.predict(self.coupling_variables, time + step)
        for i in self.members:
            exchange.shift(i, time + step)
        if self.start is None or not len(self.coupling_variables):
            self._sweep(time, step, reached)
            return
        start, fresh = self.start, True

        def answer(guess: Vector) -> Vector:
            nonlocal fresh
            if not fresh:
                start.restore_instances()
            fresh = False
            network.signals[self.coupling_variables] = guess
            self._sweep(time, step, reached)
            self.sweeps += 1
            return network.signals[self.coupling_variables]

        def agreed(difference: Vector) -> bool:
            return bool((self.scale.relative(difference, self.coupling_variables) <= self.tolerance).all())

        self.newton.solve(guess, answer, agreed, SWEEPS, self.scale.sizes(self.coupling_variables))

    def _sweep(self, time: float, step: float, reached: int) -> None:
        if self.overlapped is not None:
            self.overlapped.operate(time, step, lambda _: (time, step), reached)
            return
        instances = self.exchange.network.instances
        for i in self.members:
            self.exchange.pass_inputs(i, time, step)
            instances[i].do_step(time, step)
            instances[i].get_outputs()

    def failure_error(self, time: float, step: float, failure: Exception) -> Exception:
        """Return the error of a step that failed: for a NoAgreementError, one that explains it."""
        if not isinstance(failure, NoAgreementError):
            return failure
        return self.disagreement_error(time, step, failure.gap, failure.sweeps)

    def disagreement_error(self, time: float, step: float, gap: Vector, sweeps: int) -> RunError:
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
