"""A system whose components all run as Model Exchange, as functions of its states and inputs."""

from collections.abc import Sequence

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...base.errors import CommandError, join_names
from ...master.instances.integrated_instance import IntegratedInstance
from ...master.instances.model_exchange_instance import ModelExchangeInstance
from ...run.simulation import Simulation
from ...system.names import Names

_Variable = tuple[IntegratedInstance, int, ModelVariable]
"""The instance with a variable, the position of the variable's FMU in this instance, and the variable."""


class ContinuousSystem:
    """Derivatives and outputs of a system at the present time of its simulation.

    Attributes:
        states: Full names of the continuous states.
        nominals: Their sizes.
        inputs: Full names of the chosen inputs.
        outputs: Full names of the chosen outputs.
    """

    def __init__(self, simulation: Simulation, inputs: Sequence[str], outputs: Sequence[str]) -> None:
        """Use a simulation that has started.

        Args:
            simulation: The simulation.
            inputs: Full names of inputs.
            outputs: Full names of Real variables.

        Raises:
            CommandError: A component does not run as Model Exchange, or a name does not fit.
        """
        self._system = simulation.system
        instances = simulation.stepping.algorithm.network.instances
        self._parts = [x for x in instances if isinstance(x, IntegratedInstance)]
        self._check(len(instances) > len(self._parts))
        members = [(p, k, m) for p in self._parts for k, m in enumerate(p.members)]
        self._members = {m.name: (p, k, m) for p, k, m in members}
        self._names = Names(self._system, {m.name: m.file.interface for _, _, m in members})
        self.states = [f"{m.name}.{name}" for _, _, m in members for name in _list_state_names(m)]
        self.nominals = np.concatenate([m.read_nominals() for _, _, m in members])
        self.nominals = np.where(self.nominals > 0.0, self.nominals, 1.0)  # FMUs may declare 0
        self.inputs, self.outputs = list(inputs), list(outputs)
        self._inputs = [self._find(name, is_input=True) for name in inputs]
        self._outputs = [self._find(name) for name in outputs]
        self._shifts = np.zeros(len(inputs))
        self._bounds = np.cumsum([len(p.read_states()) for p in self._parts])[:-1]
        if not self.states:
            raise CommandError("the system has no continuous states, so it has no state matrices.")

    def read_states(self) -> Vector:
        """Return the present states, shape (states,)."""
        return np.concatenate([p.read_states() for p in self._parts])

    def read_inputs(self) -> Vector:
        """Return the present values of the inputs, with their shifts."""
        return self._read(self._inputs)

    def unit(self, name: str) -> str:
        """Return the unit of a state, an input or an output; 1 if it has none."""
        signal = self._names.find(name)
        return str(signal.interface.unit(signal.fmu_name) or "1")

    def evaluate(self, states: Vector, shifts: Vector) -> tuple[Vector, Vector]:
        """Return derivatives per s, and outputs.

        Args:
            states: Values of the states.
            shifts: What is added to each input, beside its value in the simulation.

        Raises:
            RunError: An FMU fails.
        """
        for (part, member, variable), shift in zip(self._inputs, shifts - self._shifts, strict=True):
            if shift != 0.0:
                part.shift_input(member, variable, float(shift))
        self._shifts = np.array(shifts, dtype=float)
        parts = zip(self._parts, np.split(states, self._bounds), strict=True)
        rates = np.concatenate([part.derivatives(np.ascontiguousarray(x)) for part, x in parts])
        return rates, self._read(self._outputs)

    def handle_event(self) -> None:
        """Let all components find their discrete states and relations for the present states."""
        for part in self._parts:
            part.handle_event()

    def find_discrete_components(self) -> list[str]:
        """Return the components with time events or discrete Real variables, which the matrices hold."""
        return [
            name
            for name, (_, _, member) in self._members.items()
            if np.isfinite(member.next_event)
            or any(
                v.type == "Real" and v.variability == "discrete" and v.causality != "parameter"
                for v in member.file.interface.variables.values()
            )
        ]

    def _read(self, variables: Sequence[_Variable]) -> Vector:
        return np.array([float(part.members[k].value(variable)) for part, k, variable in variables])

    def _find(self, name: str, is_input: bool = False) -> _Variable:
        signal = self._names.find(name)
        variable = signal.variable
        part, position, _ = self._members[signal.component.name]
        if variable.type != "Real":
            raise CommandError(f"{name} is {variable.type}; state matrices need a Real.", name=name)
        if is_input and (variable.causality != "input" or variable.variability != "continuous"):
            raise CommandError(f"{name} is not a continuous input.", name=name)
        return part, position, variable

    def _check(self, has_unreachable: bool) -> None:
        """Raise CommandError if a component has states that cannot be reached, or is integrated apart."""
        part_of = {m.name: p for p in self._parts for m in p.members}
        unreachable = [c.name for c in self._system.components if c.name not in part_of]
        if has_unreachable or unreachable:
            raise CommandError(
                f"state matrices need all states, and those of {join_names(unreachable)} cannot be reached. "
                "Run them as Model Exchange with --kind me, if their FMUs have it, and not isolated. "
                "Components that sample have no state matrices; frequency responses work for any system.",
                components=unreachable,
            )
        for x in self._system.connections:
            if part_of[x.source] is not part_of[x.target]:
                raise CommandError(
                    f"{x.source} and {x.target} are integrated apart, so there are no state matrices of both "
                    "together. Leave out --no-together; signals between them must be continuous Reals."
                )


def _list_state_names(member: ModelExchangeInstance) -> list[str]:
    """Return the names of the states in the order of the FMU."""
    derivatives = [x.variable for x in member.file.description.derivatives if x.variable is not None]
    return [str(d.name if d.derivative is None else d.derivative.name) for d in derivatives]
