"""The base class of all co-simulation algorithms."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, join_names
from ...base.option import STEPPED, option, options_of
from ...fmu.tables import SPANS
from ..instances.fmu_instance import FmuInstance
from ..network import Link, Network
from .extrapolation import EXTRAPOLATIONS, Exchange
from .group import CoupledGroup, loop_derivatives
from .initialization import initialize
from .newton import Scale, estimate_jacobian
from .program import (
    SIGNALS,
    Combine,
    Instruction,
    Operation,
    Solve,
    StepTask,
    check_instruction,
    find_split_steps,
    list_vectors,
    move_first,
    plan_tasks,
)

MOST = 2**31
"""The largest step multiple."""


@dataclass(eq=False)
class Algorithm(ABC):
    """Base class of co-simulation algorithms. Each is a program that is worked through in each step.

    A subclass passes its program to `use` in `setup`. An instance with the step multiple m waits until the
    others reach every m-th communication point. Then it does m steps at once, in its place of the program,
    with the inputs of that moment. It samples at these points: the same connections are late as with short
    steps, and only by a short step.

    Fields made with `option` are options of the algorithm. The master calls `setup` and `initialize` once for
    each run. Both may raise RunError; the algorithm is then not used any more.

    Args:
        extrapolation: values of inputs during a step: none (held), or extrapolated by the master or the FMU.

    Attributes:
        network: FMU instances and signals, since `setup`.
        exchange: how inputs get their values, since `setup`.
        steps: number of steps since `setup`.
    """

    extrapolation: str = option(
        "none",
        help="Inputs during a step: held (none), extrapolated by the master, or extrapolated by the FMU.",
        choices=lambda: EXTRAPOLATIONS,
        identity="extrapolation",
        commands=STEPPED,
    )

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
    known_sources: frozenset[int] = field(init=False, repr=False)
    """Instances whose signals are known in advance; they step first."""
    operations: list[Operation] = field(init=False, repr=False)
    """The calls of the program outside of groups."""
    groups: list[CoupledGroup] = field(init=False, repr=False)
    """The groups of `Solve`, in order."""
    sweeps: int = field(init=False, repr=False)
    """Sweeps over loops so far."""
    stores: dict[str, Vector] = field(init=False, repr=False)
    """Vectors of the program by name, without the signals and the previous ones."""
    block: Vector = field(init=False, repr=False)
    """All that steps change, in one piece of memory; checkpoints have it."""
    restored: Vector = field(init=False, repr=False)
    """The part of it that a repeated step restores: all but the Jacobians of loops, which stay learned."""

    network: Network = field(init=False, repr=False)
    exchange: Exchange = field(init=False, repr=False)
    steps: int = field(init=False, repr=False)
    """Steps done since `setup`."""

    def setup(self, network: Network) -> None:
        """Prepare for a run.

        Args:
            network: FMU instances that have not been initialized yet.

        Raises:
            CommandError: an FMU lacks an ability that the algorithm needs, or a step multiple is invalid.
        """
        for declared_option in options_of(type(self)):
            declared_option.check(getattr(self, declared_option.name))
        self.network = network
        self.exchange = Exchange(network, self.extrapolation)
        self.steps = 0
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
                right = "at least 1" if multiple < 1 else f"at most {MOST}"
                raise CommandError(f"the step multiple {multiple} of {name} must be {right}.")
        self.multiples = np.array([self.step_multiples.get(n, 1) for n in names], dtype=np.int64)
        self.scale, self.sweeps = Scale(network), 0

    def use(self, program: Sequence[Instruction]) -> None:
        """Use this program; call it in `setup`.

        Raises:
            CommandError: The program is not valid, or an FMU of a group cannot restore its state.
        """
        for instruction in program:
            check_instruction(instruction, len(self.network.instances))
        operations = [x for x in program if isinstance(x, Operation)]
        for instruction in operations:
            self._apply_step_multiple(instruction, operations)
        names, count = list_vectors(program), len(self.network.signals)
        combined = {x.instance for x in program if isinstance(x, Combine)}
        self.known_sources = frozenset(
            i
            for i in self.network.tables - combined
            if self.multiples[i] == 1 and self.network.instances[i].name not in self.step_multiples
        )
        # known signals must be there when others read them
        self.program = move_first(program, self.known_sources)
        self.operations = [x for x in self.program if isinstance(x, Operation)]
        self.stores = {name: np.zeros(count) for name in names}
        if self.known_sources:
            self.stores |= {f"{span} of step": np.zeros(count) for span in SPANS}
            self.exchange.use_known_sources(self.known_sources, np.flatnonzero(self.multiples > 1).tolist())
        self.groups = [self.make_group(list(x.members)) for x in self.program if isinstance(x, Solve)]
        self._gather_changing_values()

    def _gather_changing_values(self) -> None:
        """Move all that steps change into one block."""
        history = vars(self.exchange.history)
        parts = [self.network.signals, *history.values(), self.scale.largest, *self.stores.values()]
        count, offset = sum(part.size for part in parts), 0
        # in one block, a snapshot is one copy, also in C
        self.block = np.zeros(count + sum(group.jacobian.size for group in self.groups))
        self.restored = self.block[:count]

        def move(values: Vector) -> Vector:
            nonlocal offset
            target = self.block[offset : offset + values.size].reshape(values.shape)
            target[:], offset = values, offset + values.size
            return target

        self.network.use_signals(move(self.network.signals))
        for name, values in history.items():
            history[name] = move(values)
        self.scale.largest = move(self.scale.largest)
        self.stores = {name: move(store) for name, store in self.stores.items()}
        for group in self.groups:
            group.jacobian = move(group.jacobian)

    def _apply_step_multiple(self, operation: Operation, operations: Sequence[Operation]) -> None:
        """Use the step multiple of an operation for its instance; CommandError if another contradicts it."""
        i, multiple = operation.instance, operation.every
        if not multiple:
            return
        name = self.network.instances[i].name
        multiples = {x.every for x in operations if x.instance == i}
        if not 1 <= multiple <= MOST or len(multiples) > 1:
            raise CommandError(
                f"the operations of {name} are done every {', '.join(map(str, sorted(multiples)))} steps; "
                f"all need the same number, from 1 to {MOST}."
            )
        if name in self.step_multiples and self.step_multiples[name] != multiple:
            raise CommandError(
                f"the algorithm does {multiple} steps of {name} at once; remove its step multiple."
            )
        self.multiples[i] = multiple

    @property
    def split_steps(self) -> set[int]:
        """Instances whose steps begin and end in two calls, so that others step meanwhile."""
        instances = find_split_steps(self.exchange, self.operations) if self.is_plain else set[int]()
        return instances.union(*(find_split_steps(self.exchange, group.operations) for group in self.groups))

    @property
    def is_plain(self) -> bool:
        """Whether the program solves groups first, and then calls instances with the present signals."""
        count = len(self.groups)
        return len(self.operations) + count == len(self.program) and not (
            any(isinstance(x, Solve) for x in self.program[count:])
            or any(x.store != SIGNALS for x in self.operations)
        )

    def make_group(self, members: list[int]) -> CoupledGroup:
        """Return a group; CommandError if its members cannot be solved together."""
        instances = [self.network.instances[i] for i in members]
        if not members or any(self.multiples[i] > 1 for i in members):
            raise CommandError("a group needs members, and all of them without step multiples.")
        coupling_variables = self.network.find_coupling_variables(members)
        if len(coupling_variables):
            # the step of a loop is repeated until the values agree, from the same states
            require(instances, "rolls_back", "canGetAndSetFMUstate", "the strong coupling of a loop")
        return CoupledGroup(
            exchange=self.exchange,
            scale=self.scale,
            members=members,
            coupling_variables=coupling_variables,
            jacobian=estimate_jacobian(len(coupling_variables)),
            is_saved=all(s.rolls_back for s in instances),
            is_halved=all(s.varies_step for s in instances),
        )

    def tasks(self) -> list[StepTask]:
        """Return the tasks of a step of a plain program: each group as a whole, then the operations."""
        return plan_tasks(self.exchange, self.operations, [group.members for group in self.groups])

    @property
    def loops(self) -> list[list[int]]:
        """Loops that are solved, each as positions of its FMU instances."""
        return [group.members for group in self.groups if len(group.coupling_variables)]

    def initialize(self, start_time: float, stop_time: float | None) -> None:
        """Initialize all FMU instances; the signals then have their initial values.

        Args:
            start_time: in s.
            stop_time: in s; None for a run without a fixed end.
        """
        initialize(self.network, start_time, stop_time)
        self.exchange.detect_following_instances()
        self.exchange.begin(start_time)
        for store in self.stores.values():
            store[:] = self.network.signals
        for group in self.groups:
            if count := len(group.coupling_variables):
                # directional derivatives of all members spare the first sweeps, which learn J from
                # differences
                group.jacobian[:] = estimate_jacobian(count, loop_derivatives(self.exchange, group))

    @abstractmethod
    def late(self) -> list[Link]:
        """Return the links whose target gets values of its source one step late, or extrapolated."""

    def late_links(self) -> list[Link]:
        """Return the links of `late` without those whose signals are known in advance."""
        return [link for link in self.late() if link.source not in self.known_sources]

    def remarks(self) -> list[str]:
        """Return notes on the exchange of values that a reader of the results needs."""
        lagging = [
            self.network.instances[i].name
            for i in sorted(self.exchange.find_readers_of_means())
            if not self.exchange.follows[i]
        ]
        if not lagging:
            return []
        return [
            f"outputs of {join_names(lagging)} that depend directly on data of --input are half a step late: "
            "the FMU does not interpolate inputs, and a trial at the start did not show that its outputs "
            "follow them after a step. Shorten the step, or use an FMU with canInterpolateInputs."
        ]

    def warning(self) -> str | None:
        """Return why the algorithm may have caused a failure; None if it did not."""
        return None

    def report(self) -> dict[str, Any]:
        """Return how the steps are made, with the loops and how often they were stepped, for run.json."""
        instances = self.network.instances
        merged_components = [list(s.components) for s in instances if len(s.components) > 1]
        report: dict[str, Any] = {"late_connections": [link.name for link in self.late_links()]}
        known_inputs = self.exchange.describe_known_inputs()
        report |= {"known_inputs": known_inputs} if known_inputs else {}
        report |= {"integrated_together": merged_components} if merged_components else {}
        if not self.groups:
            return report
        loops = [[instances[i].name for i in loop] for loop in self.loops]
        return report | {"sweeps_over_loops": self.sweeps, "loops": loops}

    def state_dict(self) -> dict[str, Vector]:
        """Return what steps have changed, as arrays by name."""
        return {"block": self.block, "counts": np.array([self.steps, self.sweeps], dtype=float)}

    def load_state_dict(self, state: Mapping[str, Vector]) -> None:
        """Continue from what `state_dict` returned in an algorithm of the same class and network."""
        self.block[:] = state["block"]
        self.steps, self.sweeps = (int(count) for count in state["counts"])

    def close(self) -> None:  # noqa: B027 - most have nothing to free
        """Free what the algorithm holds of the FMU instances; never raises."""

    @property
    def accuracy(self) -> int:
        """Order of accuracy in the step size, for states in smooth motion."""
        return self.exchange.accuracy


def require(instances: Sequence[FmuInstance], ability: str, flag: str, purpose: str) -> None:
    """Raise CommandError if an instance lacks a capability.

    Args:
        instances: The instances to check.
        ability: Attribute of `FmuInstance` that says whether it has the capability.
        flag: Name of the capability in FMI.
        purpose: What needs the capability, for the error message.
    """
    lacking = [instance.name for instance in instances if not getattr(instance, ability)]
    if lacking:
        raise CommandError(f"{purpose} needs FMUs with {flag}; {', '.join(lacking)} cannot do it.")


def _split_names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


@dataclass(eq=False)
class InOrder(Algorithm):
    """Step instances in the user's order, or in one that the network derives from the connections."""

    order: Sequence[str] = option(
        [],
        help="Order in which components step, with commas between. Default: derived from the connections.",
        parse=_split_names,
        identity="order",
        commands=STEPPED,
    )

    def setup(self, network: Network) -> None:
        """Prepare for a run; CommandError if the order does not name every instance once."""
        if self.order:
            network.reorder(self.order)
        super().setup(network)

    def report(self) -> dict[str, Any]:
        """Add the order to the report."""
        return {**super().report(), "order": [self.network.instances[i].name for i in self.network.order]}
