"""Strong coupling: repeat a step until the exchanged values are consistent."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import RunError
from ...base.option import STEPPED, option
from ..instances.fmu_instance import DiscardedStepError
from ..network import Link, Network
from .algorithm import Span, require
from .group import CoupledGroup, loop_derivatives
from .in_order import InOrder
from .operation_table import OperationTableAlgorithm
from .quasi_newton import NoAgreementError, QuasiNewton
from .scale import Scale
from .snapshot import Snapshot
from .tasks import Call, Operation, StepTask, perform_again, plan_tasks

SWEEPS = 30
"""Largest number of sweeps over a loop. After these, no solution is assumed to be near."""

HALVINGS = 10
"""Number of times that a failed step is halved before the run ends."""


@dataclass(eq=False)
class Strong(InOrder, OperationTableAlgorithm):
    """Algorithm in which each FMU steps with the values of its sources at the end of the step.

    FMUs outside of loops step once, in the order of the connections. The FMUs of a loop repeat their step,
    with quasi-Newton acceleration, until no exchanged value changes by more than `coupling_tolerance` of its
    size. A step that an FMU discards, or that finds no agreement, is done in halves.

    A component in `step_multiples`, also with 1, is sampled as a digital controller is: it steps after all
    loops have agreed, with the values at the end of the step. During the step, the others see its earlier
    outputs, so that no loop goes through it.

    Args:
        extrapolation: as for `Algorithm`.
        step_multiples: number of communication steps that a component does at once, by name.
        order: names of all components in the order of their steps. Default: derived from the connections.
        coupling_tolerance: difference at which values count as agreed, relative to the size of each signal.

    Attributes:
        sweeps: number of times that a loop was stepped.
        done: numbers of the groups that have already done the current step.

    Examples:
        >>> import emla_cosim as ec
        >>> simulation = ec.load("lift", stop_time=0.01).prepare()
        >>> simulation.run(algorithm=ec.Strong(coupling_tolerance=1e-6)).steps
        100
    """

    coupling_tolerance: float = option(
        1e-8,
        help="Convergence of algebraic loops: the largest difference of a value, as a fraction of its "
        "signal's size.",
        above=0.0,
        below=1.0,
        identity="coupling tolerance",
        commands=STEPPED,
    )

    sweeps: int = field(init=False, repr=False)
    """Sweeps over loops so far."""
    done: set[int] = field(init=False, repr=False)
    """Numbers of the groups that have finished the present step."""

    def setup(self, network: Network) -> None:
        """Prepare for a run.

        Raises:
            CommandError: an FMU of a loop cannot restore its state, or step multiples do not fit.
        """
        super().setup(network)
        self.sweeps, self.done = 0, set()
        self.scale = Scale(network)
        self._sampled = self._sampled_instances()
        if self._sampled:
            network.hold_back(self._sampled, bool(self.order))
        self.exchange.sample(self._sampled)
        self.use([Operation(call, i) for i in network.order if i in self._sampled for call in Call])
        groups = network.groups(lambda link: link.source not in self._sampled)
        self.groups = [self._group(group) for group in groups if group[0] not in self._sampled]

    def _sampled_instances(self) -> set[int]:
        """Return the positions of instances with a step multiple, and of the followers of their outputs."""
        network = self.network
        sampled = {i for i, instance in enumerate(network.instances) if instance.name in self.step_multiples}
        for _ in network.followers:  # one may follow another
            links = [link for link in network.links if link.target in network.followers]
            sampled |= {link.target for link in links if link.source in sampled}
        return sampled

    def _group(self, members: list[int]) -> CoupledGroup:
        instances = [self.network.instances[i] for i in members]
        cut = self.network.find_coupling_variables(members)
        if len(cut):
            require(instances, "rolls_back", "canGetAndSetFMUstate", "the strong coupling of a loop")
        start = Snapshot(self, members) if all(s.rolls_back for s in instances) else None
        halves = all(s.varies_step for s in instances)
        overlapped = self._overlapped([Operation(c, i) for i in members for c in Call], perform_again)
        return CoupledGroup(members, cut, QuasiNewton(len(cut)), start, halves, overlapped)

    def initialize(self, start_time: float, stop_time: float | None) -> None:
        """Initialize all FMU instances, and get the derivatives of loops where FMUs have them."""
        super().initialize(start_time, stop_time)
        for group in self.groups:
            if len(group.coupling_variables):
                group.newton.forget(loop_derivatives(self.exchange, group))

    def tasks(self) -> list[StepTask]:
        """Return the tasks of a step: each group as a whole, then the sampled components."""
        return plan_tasks(self.exchange, self.operations, [group.members for group in self.groups])

    def late(self) -> list[Link]:
        """Return the links from sampled components to others, and against the order of the sampled."""
        return [link for link in self.network.find_feedback_links() if link.source in self._sampled]

    @property
    def loops(self) -> list[list[int]]:
        """Loops in the network, each as positions of its FMU instances."""
        return [group.members for group in self.groups if len(group.coupling_variables)]

    def report(self) -> dict[str, Any]:
        """Return how the steps are made, with the loops and how often they were stepped."""
        names = [[self.network.instances[i].name for i in loop] for loop in self.loops]
        return {**super().report(), "sweeps_over_loops": self.sweeps, "loops": names}

    @property
    def kept(self) -> dict[str, Vector]:
        """Arrays by name that a repeated step restores, with the sizes of the signals."""
        return super().kept | {"strong/largest": self.scale.largest}

    def memory(self) -> dict[str, Vector]:
        """Return what the algorithm keeps besides the signals, with the derivatives of the loops."""
        learned = {f"jacobian/{i}": group.newton.jacobian for i, group in enumerate(self.groups)}
        sweeps = np.array([float(self.sweeps)])
        return super().memory() | learned | {"sweeps": sweeps}

    def remember(self, memory: Mapping[str, Vector]) -> None:
        """Continue from what `memory` returned for the same network."""
        super().remember(memory)
        for i, group in enumerate(self.groups):
            group.newton.jacobian[:] = memory[f"jacobian/{i}"]
        self.sweeps = int(memory["sweeps"][0])

    def close(self) -> None:
        """Free the saved states."""
        for group in self.groups:
            if group.start is not None:
                group.start.close()

    def _step(self, time: float, step: float, span: Span) -> None:
        if not self.done:
            self.scale.see()
        rest, self.done = [g for i, g in enumerate(self.groups) if i not in self.done], set()
        for group in rest:
            self._advance(group, time, step, HALVINGS)
        self.operate(time, step, span)

    def _advance(self, group: CoupledGroup, time: float, step: float, halvings: int) -> None:
        """Bring a group to the end of the step, in halves if one step fails."""
        if group.start is not None:
            group.start.take()
        try:
            self._solve(group, time, step)
        except (DiscardedStepError, NoAgreementError) as failure:
            if group.start is None or not group.halves or not halvings:
                raise self._no_agreement_error(group, time, step, failure) from failure
            group.start.restore()
            middle, end = time + 0.5 * step, time + step
            self._advance(group, time, middle - time, halvings - 1)
            self._advance(group, middle, end - middle, halvings - 1)

    def _solve(self, group: CoupledGroup, time: float, step: float) -> None:
        guess = self.exchange.predict(group.coupling_variables, time + step)
        for i in group.members:
            self.exchange.shift(i, time + step)
        if group.start is None or not len(group.coupling_variables):
            self._sweep(group, time, step)
            return
        start, fresh = group.start, True

        def answer(guess: Vector) -> Vector:
            nonlocal fresh
            if not fresh:
                start.restore_instances()
            fresh = False
            self.network.signals[group.coupling_variables] = guess
            self._sweep(group, time, step)
            self.sweeps += 1
            return self.network.signals[group.coupling_variables]

        def agreed(difference: Vector) -> bool:
            return bool(
                (self.scale.relative(difference, group.coupling_variables) <= self.coupling_tolerance).all()
            )

        group.newton.solve(guess, answer, agreed, SWEEPS, self.scale.sizes(group.coupling_variables))

    def _sweep(self, group: CoupledGroup, time: float, step: float) -> None:
        if group.overlapped is not None:
            group.overlapped.operate(time, step, lambda _: (time, step), self.steps + 1)
            return
        for i in group.members:
            self.exchange.pass_inputs(i, time, step)
            self.network.instances[i].do_step(time, step)
            self.network.instances[i].get_outputs()

    def _no_agreement_error(
        self, group: CoupledGroup, time: float, step: float, failure: Exception
    ) -> Exception:
        if not isinstance(failure, NoAgreementError):
            return failure
        names = self.network.loop_name(group.members)
        gaps = self.scale.relative(failure.gap, group.coupling_variables)
        worst = self.network.names[group.coupling_variables[gaps.argmax()]]
        if not np.isfinite(gaps).all():
            return RunError(
                f"in the loop {names}, {worst} is infinite or NaN on the step from t = {time:.9g} s of "
                f"{step:.3g} s."
            )
        return RunError(
            f"the loop {names} does not converge on the step from t = {time:.9g} s of {step:.3g} s in "
            f"{failure.sweeps} sweeps: {worst} still changes by {gaps.max():.2g} of its size."
        )
