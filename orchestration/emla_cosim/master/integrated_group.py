"""Several FMUs that run as Model Exchange, connected with each other, with one integrator."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from fmpy.model_description import ModelVariable

from ..base.arrays import Indices, Vector
from ..base.errors import join_names
from ..fmu.elements import position_in_array
from ..fmu.integrator import MAX_ITERATIONS
from .algorithms.initialization import solve_initial_values
from .algorithms.newton import Newton, NoSolutionError, Scale
from .instances.fmu_instance import FmuInstance
from .instances.integrated_instance import IntegratedInstance, ModelExchangeInstance
from .network import Link, Network

_TOLERANCE = 1e-9
"""In an event, continuous inputs are unchanged if they differ by less, relative to their sizes."""


class _Environment(FmuInstance):
    """What drives the inputs of a group, as an instance in its network: its outputs are these inputs."""

    name = ""

    def __init__(self, nominals: Vector, continuous: np.ndarray) -> None:
        self.inputs, self.outputs, self.nominals = np.empty(0), np.zeros(len(nominals)), nominals
        self.continuous_inputs, self.continuous_outputs = np.empty(0, dtype=bool), continuous

    def enter_initialization(self, start_time: float, stop_time: float | None) -> None:
        """Do nothing."""

    exit_initialization = set_inputs = get_outputs = close = lambda self: None

    def do_step(self, time: float, step: float) -> None:
        """Do nothing."""


class _Transfer:
    """Reads signals from an FMU, or passes them to its inputs, during integration.

    Args:
        member: The instance.
        variables: Its variables, all inputs or all outputs.
        writes: Whether they are inputs.
        signals: Positions of the signals.
        factors: Factors of its inputs.
        offsets: Offsets of its inputs.
    """

    def __init__(
        self,
        member: ModelExchangeInstance,
        variables: Sequence[ModelVariable],
        writes: bool,
        signals: Sequence[int],
        factors: Sequence[float] = (),
        offsets: Sequence[float] = (),
    ) -> None:
        self._member, self._variables = member, variables
        self._values = np.zeros(len(variables))
        self._call = (member.make_writer if writes else member.make_reader)(variables, self._values)
        self._signals: Indices = np.array(signals, dtype=np.intp)
        self._factors, self._offsets = np.array(factors), np.array(offsets)

    def read(self, signals: Vector) -> None:
        """Read outputs of the FMU into the signals."""
        self._call()
        signals[self._signals] = self._values

    def shift(self, member: ModelExchangeInstance, variable: ModelVariable, by: float) -> bool:
        """Add a constant to one of its inputs; return whether it has this input."""
        if member is not self._member:
            return False
        location = _locate(variable)
        matches = np.array([_locate(v) == location for v in self._variables], dtype=bool)
        self._offsets[matches] += by
        return bool(matches.any())

    def write(self, signals: Vector) -> None:
        """Pass signals to inputs of the FMU."""
        # NumPy buffers `out` in its default mode; the positions are valid
        signals.take(self._signals, out=self._values, mode="clip")
        self._values *= self._factors
        self._values += self._offsets
        self._call()


def _locate(variable: ModelVariable) -> tuple[int, int]:
    """Return the value reference of a variable, and its position in its array."""
    return int(variable.valueReference), position_in_array(variable)


@dataclass
class _Stage:
    """Signals that depend on those of earlier stages only, or on each other in a loop without delay.

    Attributes:
        reads: Read the signals from the FMUs.
        writes: Pass them to the inputs that they drive.
        loop: Positions of the signals if they depend on each other, otherwise empty.
    """

    reads: list[_Transfer]
    writes: list[_Transfer]
    loop: Indices


class IntegratedGroup(IntegratedInstance):
    """Connected FMUs that run as Model Exchange, with one integrator.

    Its inputs are those that other components drive, its outputs all those of its members. Connections inside
    have their values at each evaluation of the derivatives; loops without delay are solved there. All members
    take part in each event.
    """

    def __init__(self, members: Sequence[ModelExchangeInstance], inside: Sequence[Link]) -> None:
        """Connect instances that have not been initialized yet.

        Args:
            members: The instances.
            inside: Links between them, with their positions among the members.
        """
        super().__init__("+".join(m.name for m in members), members)
        driven = {(x.target, x.input) for x in inside}
        self.free = [
            (i, k) for i, m in enumerate(members) for k in range(len(m.inputs)) if (i, k) not in driven
        ]
        """The member and the position in its inputs, by input of the group."""
        self.inputs = np.array([members[i].inputs[k] for i, k in self.free])
        self.continuous_inputs = np.array([members[i].continuous_inputs[k] for i, k in self.free], dtype=bool)
        self.outputs = np.zeros(sum(len(m.outputs) for m in members))
        self.nominals = np.concatenate([m.nominals for m in members])
        self.continuous_outputs = np.concatenate([m.continuous_outputs for m in members])
        self.differentiates = False
        environment = _Environment(np.ones(len(self.free)), self.continuous_inputs)
        outside = [Link(0, n, i + 1, k, direct=True) for n, (i, k) in enumerate(self.free)]
        links = [replace(x, source=x.source + 1, target=x.target + 1) for x in inside]
        names = [f"{members[i].name}.{members[i].read[k].name}" for i, k in self.free]
        names += [f"{m.name}.{v.name}" for m in members for v in m.written]
        self._network = Network([environment, *members], [*outside, *links], names)
        self._scale = Scale(self._network)
        self._external = self._make_writes([x for x in outside if self._is_continuous(x)])
        self._is_continuous_input = np.concatenate([m.continuous_inputs for m in members])
        self._continuous_links = [x for x in links if self._is_continuous(x)]
        self._stages = self._plan_stages()
        self._begin(float("nan"))

    def bind(self, inputs: Vector, outputs: Vector) -> None:
        """Use this memory for inputs and outputs."""
        FmuInstance.bind(self, inputs, outputs)

    def find_direct_outputs(self, member: int, member_outputs: Collection[int]) -> set[int]:
        """Return the positions of the outputs of the group that depend on an input without delay.

        Args:
            member: Position of the member with the input.
            member_outputs: Positions of the outputs of this member that depend on the input without delay.
        """
        first = self._network.parts[0].stop
        reached = {int(self._network.parts[member + 1].start) + k for k in member_outputs}
        waiting = list(reached)
        while waiting:
            for following in self._dependents.get(waiting.pop(), ()):
                if following not in reached:
                    reached.add(following)
                    waiting.append(following)
        return {signal - first for signal in reached}

    def position(self, member: int, output: int) -> int:
        """Return the position of an output of a member among the outputs of the group."""
        return int(self._network.parts[member + 1].start - self._network.parts[0].stop) + output

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        super().enter_initialization(start_time, stop_time)
        self._network.signals[:] = 0.0
        self.inputs[:] = [self.members[i].inputs[k] for i, k in self.free]
        for i in range(len(self._network.instances)):
            self._network.assume_inputs(i)

    def exit_initialization(self) -> None:
        """Leave initialization mode, and handle its events."""
        self._network.signals[: len(self.inputs)] = self.inputs
        for i in range(len(self._network.instances)):
            self._network.pass_inputs(i)
        super().exit_initialization()

    def get_outputs(self) -> None:
        """Read the outputs into `outputs`."""
        if not self._is_integrating:
            solve_initial_values(self._network, self._scale)
        for member in self.members:
            member.get_outputs()
        self.outputs[:] = self._network.signals[len(self.inputs) :]

    def directional_derivative(self, direction: Vector) -> Vector | None:
        """Return None: the derivative through several FMUs is not known."""

    def shift_input(self, member: int, variable: ModelVariable, by: float) -> None:
        """Add a constant to a continuous input; see `IntegratedInstance`."""
        inside = [x for stage in self._stages for x in stage.writes]
        if not any(x.shift(self.members[member], variable, by) for x in inside):
            super().shift_input(member, variable, by)

    def _set_all_inputs(self) -> None:
        self._network.signals[: len(self.inputs)] = self.inputs
        if not self._is_integrating:
            return  # `get_outputs` passes them in the order in which initial values depend on each other
        for i in range(len(self._network.instances)):
            self._network.pass_inputs(i)

    def _set_continuous_inputs(self) -> None:
        self._network.signals[: len(self.inputs)] = self.inputs
        for transfer in self._external:
            transfer.write(self._network.signals)
        self._connect()

    def _set_moving_inputs(self, values: Vector) -> None:
        self._network.signals[: len(self.inputs)][self.continuous_inputs] = values
        for transfer in self._external:
            transfer.write(self._network.signals)

    def _list_arrays(self) -> list[Vector]:
        return [self._passed_inputs, self._network.signals, self._network.inputs]

    def _connect(self) -> None:
        signals = self._network.signals
        for stage in self._stages:
            if len(stage.loop):
                self._solve(stage)
            else:
                for transfer in stage.reads:
                    transfer.read(signals)
                for transfer in stage.writes:
                    transfer.write(signals)

    def _solve(self, stage: _Stage) -> None:
        """Solve a loop without delay: set its signals, and pass them to the inputs that they drive."""
        signals, loop = self._network.signals, stage.loop

        def pass_through_loop(guess: Vector) -> Vector:
            """Return the loop's signals after one pass; the solution is a fixed point."""
            signals[loop] = guess
            for transfer in stage.writes:
                transfer.write(signals)
            for transfer in stage.reads:
                transfer.read(signals)
            return signals[loop]

        def list_sizes(values: Vector) -> Vector:
            return np.abs(values) + self._scale.floor[loop]

        try:  # from the answer to the last values, so that what only seems to be a loop takes two calls
            signals[loop] = Newton(pass_through_loop, list_sizes).solve(pass_through_loop(signals[loop]))
        except NoSolutionError as error:
            names = join_names([self._network.names[i] for i in loop])
            raise self._make_integration_error(
                f"{names} depend on each other without delay, and no solution was found"
            ) from error

    def _exchange_values(self) -> Collection[ModelExchangeInstance]:
        network, inputs_before = self._network, self._network.inputs.copy()
        for _ in range(MAX_ITERATIONS):
            self._connect()
            for member in self.members:
                member.get_outputs()
            discrete_inputs = network.inputs[~self._is_continuous_input]
            for i in range(1, len(network.instances)):
                network.pass_inputs(i)
            if np.array_equal(discrete_inputs, network.inputs[~self._is_continuous_input]):
                break
        else:
            raise self._make_integration_error(
                f"the discrete values between its components do not settle in {MAX_ITERATIONS} iterations"
            )
        # rounding errors in the solution of a loop must not repeat the event
        margin = np.where(self._is_continuous_input, _TOLERANCE * (np.abs(network.inputs) + _TOLERANCE), 0.0)
        changed = np.abs(network.inputs - inputs_before) > margin
        return [
            m for m, part in zip(self.members, network.input_parts[1:], strict=True) if changed[part].any()
        ]

    def _is_continuous(self, link: Link) -> bool:
        """Whether a link of the group's network passes continuous values."""
        source, target = (self._network.instances[i] for i in (link.source, link.target))
        return bool(source.continuous_outputs[link.output] and target.continuous_inputs[link.input])

    @cached_property
    def _dependents(self) -> dict[int, list[int]]:
        """Signals that depend on a signal without delay, by signal."""
        dependents: dict[int, list[int]] = {}
        for x in self._continuous_links:
            first = int(self._network.parts[x.target].start)
            dependents.setdefault(self._network.signal(x), []).extend(first + k for k in x.through)
        return dependents

    def _plan_stages(self) -> list[_Stage]:
        """Return the stages in which continuous signals pass between the members."""
        import networkx  # slow to import, and rarely needed

        read = {self._network.signal(x) for x in self._continuous_links}
        graph = networkx.DiGraph((s, t) for s in read for t in self._dependents[s] if t in read)
        graph.add_nodes_from(read)
        condensed = networkx.condensation(graph)
        stages = []
        for generation in networkx.topological_generations(condensed):
            independent: list[int] = []
            for c in generation:
                members = sorted(condensed.nodes[c]["members"])
                if len(members) > 1 or graph.has_edge(members[0], members[0]):
                    stages.append(self._make_stage(members, is_loop=True))
                else:
                    independent += members
            if independent:
                stages.append(self._make_stage(sorted(independent), is_loop=False))
        return stages

    def _make_stage(self, signals: Sequence[int], is_loop: bool) -> _Stage:
        """Return the stage that reads these signals, and passes them to the inputs that they drive."""
        reads, network = [], self._network
        for member, part in zip(self.members, network.parts[1:], strict=True):
            member_signals = [s for s in signals if part.start <= s < part.stop]
            if member_signals:
                variables = [member.written[s - part.start] for s in member_signals]
                reads.append(_Transfer(member, variables, False, member_signals))
        writes = self._make_writes([x for x in self._continuous_links if network.signal(x) in signals])
        return _Stage(reads, writes, np.array(signals if is_loop else [], dtype=np.intp))

    def _make_writes(self, links: Sequence[Link]) -> list[_Transfer]:
        """Return what passes the signals of links to their inputs, one transfer per member."""
        transfers = []
        for i, member in enumerate(self.members, 1):
            member_links = [x for x in links if x.target == i]
            if member_links:
                variables = [member.read[x.input] for x in member_links]
                signals = [self._network.signal(x) for x in member_links]
                factors, offsets = [x.factor for x in member_links], [x.offset or -0.0 for x in member_links]
                transfers.append(_Transfer(member, variables, True, signals, factors, offsets))
        return transfers
