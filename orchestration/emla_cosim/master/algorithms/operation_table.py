"""Algorithms that work through a program, with instances that step more rarely."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, ClassVar

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, join_names
from ...base.option import STEPPED, option
from ..network import Network
from .algorithm import Algorithm, Span, require
from .group import CoupledGroup, loop_derivatives
from .overlap import find_split_steps
from .overlapped_steps import OverlappedSteps
from .program import PREVIOUS, SIGNALS, Call, Combine, Instruction, Operation, Solve
from .quasi_newton import QuasiNewton
from .scale import Scale
from .snapshot import Snapshot
from .tasks import Perform, StepTask, perform, perform_again, plan_tasks

MOST = 2**31
"""The largest step multiple."""

_STORES = (SIGNALS, PREVIOUS)


@dataclass(eq=False)
class OperationTableAlgorithm(Algorithm):
    """Work through a program in each step; subclasses write it. Checkpoints have all that it stores.

    An instance with the step multiple m waits until the others reach every m-th communication point. Then
    it does m steps at once, in its place of the program, with the inputs of that moment. It samples at these
    points: the same connections are late as with short steps, and only by a short step.
    """

    step_multiples: Mapping[str, int] = option(
        {},
        help="Let a component run N times slower: it takes its inputs every N-th step (repeatable).",
        flag="--step-multiple",
        metavar="COMPONENT=N",
        identity="step multiples",
        commands=STEPPED,
    )

    coupling_tolerance: ClassVar[float] = 1e-8
    """Difference at which values in a `Solve` count as agreed, relative to the size of each signal."""

    program: list[Instruction] = field(init=False, repr=False)
    operations: list[Operation] = field(init=False, repr=False)
    """The calls of the program outside of groups."""
    groups: list[CoupledGroup] = field(init=False, repr=False)
    """The groups of `Solve`, in order."""
    done: set[int] = field(init=False, repr=False)
    """Numbers of the groups that have finished the present step."""
    sweeps_elsewhere: int = field(init=False, repr=False)
    """Sweeps over loops that compiled code did, or a run before its checkpoint."""
    stores: dict[str, Vector] = field(init=False, repr=False)
    """Vectors of the program by name, without the signals and the previous ones."""

    def setup(self, network: Network) -> None:
        """Prepare for a run; CommandError if a step multiple is invalid."""
        super().setup(network)
        names = [s.name for s in network.instances]
        for name, multiple in self.step_multiples.items():
            group = next((i for i in network.instances if name in i.components), None)
            if group is not None and len(group.components) > 1:
                raise CommandError(
                    f"{name} cannot have a step multiple: it is integrated together with other components. "
                    "Add --no-together."
                )
            if name not in names:
                raise CommandError(f"there is no component '{name}' for a step multiple.")
            if not 1 <= multiple <= MOST:
                least = multiple < 1
                right = "at least 1" if least else f"at most {MOST}"
                raise CommandError(f"the step multiple {multiple} of {name} must be {right}.")
        self.multiples = np.array([self.step_multiples.get(n, 1) for n in names], dtype=np.int64)
        self.scale, self.done, self.sweeps_elsewhere = Scale(network), set(), 0

    def use(self, program: Sequence[Instruction]) -> None:
        """Use this program; call it in `setup`.

        Raises:
            CommandError: The program is not valid, or an FMU of a group cannot restore its state.
        """
        self.program = list(program)
        for each in self.program:
            self._check(each)
        self.operations = [x for x in program if isinstance(x, Operation)]
        for each in self.operations:
            self._sample(each)
        self.stores = self._make_stores([x for x in program if isinstance(x, Combine)])
        self.groups = [self._group(list(x.members)) for x in program if isinstance(x, Solve)]
        self._apart = self._overlapped(self.operations) if self.is_plain else None
        # calls at the end of a plain program need not be told apart, which takes as long as a call
        self._dispatched = self.program[: len(self.groups)] if self.is_plain else self.program
        self._calls = [(int(o.call), o.instance, int(self.multiples[o.instance])) for o in self.operations]

    def _check(self, instruction: Instruction) -> None:
        """Raise CommandError for what is no instruction, and for instances that do not exist."""
        if not isinstance(instruction, Instruction):
            raise CommandError(f"{instruction!r} is not an Operation, a Solve or a Combine.")
        count = len(self.network.instances)
        positions = instruction.members if isinstance(instruction, Solve) else [instruction.instance]
        if any(position not in range(count) for position in positions):
            raise CommandError(f"{instruction!r} is not for instances from 0 to {count - 1}.")
        if len(set(positions)) < len(positions):
            raise CommandError(f"{instruction!r} has an instance twice.")
        if isinstance(instruction, Operation) and instruction.call not in list(Call):
            raise CommandError(f"{instruction.call!r} is not a Call.")

    def _make_stores(self, combinations: Sequence[Combine]) -> dict[str, Vector]:
        """Return the vectors that the program writes, by name."""
        written = dict.fromkeys(x.into for x in combinations)
        if PREVIOUS in written:
            raise CommandError(
                f"a program cannot write '{PREVIOUS}': the master does; choose another vector."
            )
        for each in combinations:
            if not each.terms:
                raise CommandError("a Combine without terms has no sum; add a term.")
            for name, factor in each.terms.items():
                if not isinstance(factor, Real) or not math.isfinite(factor):
                    raise CommandError(f"the factor of '{name}' is {factor!r}; it must be a finite number.")
        read = [name for x in combinations for name in x.terms] + [x.store for x in self.operations]
        for name in read:
            if name not in _STORES and name not in written:
                raise CommandError(
                    f"the program reads the vector '{name}', which no Combine writes; there are "
                    f"{join_names([*_STORES, *written])}."
                )
        return {name: np.zeros(len(self.network.signals)) for name in written if name != SIGNALS}

    def _sample(self, operation: Operation) -> None:
        """Take the step multiple of an operation as that of its instance."""
        i, every = operation.instance, operation.every
        if not every:
            return
        name = self.network.instances[i].name
        others = {x.every for x in self.operations if x.instance == i}
        if not 1 <= every <= MOST or len(others) > 1:
            raise CommandError(
                f"the operations of {name} are done every {', '.join(map(str, sorted(others)))} steps; "
                f"all need the same number, from 1 to {MOST}."
            )
        if name in self.step_multiples and self.step_multiples[name] != every:
            raise CommandError(
                f"the algorithm does {every} steps of {name} at once; remove its step multiple."
            )
        self.multiples[i] = every

    @property
    def split_steps(self) -> set[int]:
        """Instances whose steps begin and end in two calls, so that others step meanwhile."""
        found = find_split_steps(self.exchange, self.operations) if self.is_plain else set[int]()
        return found.union(*(find_split_steps(self.exchange, group.operations) for group in self.groups))

    @property
    def has_own_step(self) -> bool:
        """Whether a subclass does steps in Python instead of writing a program."""
        return type(self)._step is not OperationTableAlgorithm._step

    @property
    def is_plain(self) -> bool:
        """Whether the program solves groups first, and then calls instances with the present signals."""
        count = len(self.groups)
        return len(self.operations) + count == len(self.program) and not (
            any(isinstance(x, Solve) for x in self.program[count:])
            or any(x.store != SIGNALS for x in self.operations)
        )

    def _group(self, members: list[int]) -> CoupledGroup:
        instances = [self.network.instances[i] for i in members]
        if not members or any(self.multiples[i] > 1 for i in members):
            raise CommandError("a group needs members without step multiples.")
        cut = self.network.find_coupling_variables(members)
        if len(cut):
            require(instances, "rolls_back", "canGetAndSetFMUstate", "the strong coupling of a loop")
        start = Snapshot(self, members) if all(s.rolls_back for s in instances) else None
        return CoupledGroup(
            exchange=self.exchange,
            scale=self.scale,
            tolerance=self.coupling_tolerance,
            members=members,
            coupling_variables=cut,
            newton=QuasiNewton(len(cut)),
            start=start,
            halves=all(s.varies_step for s in instances),
            overlapped=self._overlapped([Operation(c, i) for i in members for c in Call], perform_again),
        )

    def _overlapped(
        self, operations: Sequence[Operation], perform: Perform = perform
    ) -> OverlappedSteps | None:
        """Return what overlaps the steps of a table; None if it has less than two that can overlap."""
        apart = sum(self.network.instances[o.instance].steps_apart for o in operations if o.call == Call.STEP)
        return OverlappedSteps(self.exchange, operations, self.multiples, perform) if apart > 1 else None

    def initialize(self, start_time: float, stop_time: float | None) -> None:
        """Initialize all FMU instances, and get the derivatives of loops where FMUs have them."""
        super().initialize(start_time, stop_time)
        for store in self.stores.values():
            store[:] = self.network.signals
        for group in self.groups:
            if len(group.coupling_variables):
                group.newton.forget(loop_derivatives(self.exchange, group))

    def tasks(self) -> list[StepTask]:
        """Return the tasks of a step of a plain program: each group as a whole, then the operations."""
        return plan_tasks(self.exchange, self.operations, [group.members for group in self.groups])

    @property
    def sweeps(self) -> int:
        """Sweeps over loops so far."""
        return self.sweeps_elsewhere + sum(group.sweeps for group in self.groups)

    @property
    def loops(self) -> list[list[int]]:
        """Loops that are solved, each as positions of its FMU instances."""
        return [group.members for group in self.groups if len(group.coupling_variables)]

    def report(self) -> dict[str, Any]:
        """Return how the steps are made, with the loops and how often they were stepped."""
        if not self.groups:
            return super().report()
        names = [[self.network.instances[i].name for i in loop] for loop in self.loops]
        return {**super().report(), "sweeps_over_loops": self.sweeps, "loops": names}

    @property
    def kept(self) -> dict[str, Vector]:
        """Arrays by name that a repeated step restores, with the sizes of the signals."""
        sizes = {"strong/largest": self.scale.largest} if self.groups else {}
        return super().kept | sizes | {f"store/{name}": store for name, store in self.stores.items()}

    def memory(self) -> dict[str, Vector]:
        """Return what the algorithm keeps besides the signals, with the derivatives of the loops."""
        learned = {f"jacobian/{i}": group.newton.jacobian for i, group in enumerate(self.groups)}
        sweeps = {"sweeps": np.array([float(self.sweeps)])} if self.groups else {}
        return super().memory() | learned | sweeps

    def remember(self, memory: Mapping[str, Vector]) -> None:
        """Continue from what `memory` returned for the same network."""
        super().remember(memory)
        for i, group in enumerate(self.groups):
            group.newton.jacobian[:] = memory[f"jacobian/{i}"]
            group.sweeps = 0
        self.sweeps_elsewhere = int(memory["sweeps"][0]) if self.groups else 0

    def close(self) -> None:
        """Free the saved states."""
        for group in getattr(self, "groups", ()):
            if group.start is not None:
                group.start.close()

    def _step(self, time: float, step: float, span: Span) -> None:
        if self.groups and not self.done:
            self.scale.see()
        done, self.done = self.done, set()
        reached, groups, calls = self.steps + 1, enumerate(self.groups), iter(self._calls)
        for each in self._dispatched:
            if isinstance(each, Operation):
                call, i, multiple = next(calls)
                if reached % multiple:
                    continue
                if each.store == SIGNALS:
                    begin, length = (time, step) if multiple == 1 else span(multiple)
                    perform(self.exchange, call, i, begin, length, time + step)
                else:
                    self.network.pass_inputs(i, self._vector(each.store))
            elif isinstance(each, Combine):
                self._combine(each)
            else:
                number, group = next(groups)
                if number not in done:
                    group.advance(time, step, reached)
        if self._apart is not None:
            self._apart.operate(time, step, span, reached)
            return
        for call, i, multiple in calls:
            if reached % multiple == 0:
                begin, length = (time, step) if multiple == 1 else span(multiple)
                perform(self.exchange, call, i, begin, length, time + step)

    def _vector(self, name: str) -> Vector:
        if name == SIGNALS:
            return self.network.signals
        return self.exchange.history.previous if name == PREVIOUS else self.stores[name]

    def _combine(self, combination: Combine) -> None:
        part = self.network.parts[combination.instance]
        terms = [factor * self._vector(name)[part] for name, factor in combination.terms.items()]
        self._vector(combination.into)[part] = sum(terms[1:], terms[0])
