"""State matrices by differences, and steady states, of a system that runs as Model Exchange."""

from collections.abc import Collection, Sequence

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError, join_names
from ...master.instances.integrated_instance import (
    DiscardedCallError,
    IntegratedInstance,
    ModelExchangeInstance,
)
from ...run.simulation import Simulation
from ...system.names import Names
from .response import StateSpace

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
        self._check_integration(len(instances) > len(self._parts))
        members = [(p, k, m) for p in self._parts for k, m in enumerate(p.members)]
        self._members = {m.name: (p, k, m) for p, k, m in members}
        self._names = Names(self._system, {m.name: m.file.interface for _, _, m in members})
        self.states = [f"{m.name}.{name}" for _, _, m in members for name in _list_state_names(m)]
        self.nominals = np.concatenate([m.read_nominals() for _, _, m in members])
        self.nominals = np.where(self.nominals > 0.0, self.nominals, 1.0)  # FMUs may declare 0
        self.inputs, self.outputs = list(inputs), list(outputs)
        self._inputs = [self._find_variable(name, is_input=True) for name in inputs]
        self._outputs = [self._find_variable(name) for name in outputs]
        self._shifts = np.zeros(len(inputs))
        self._bounds = np.cumsum([len(p.read_states()) for p in self._parts])[:-1]
        if not self.states:
            raise CommandError("the system has no continuous states, so it has no state matrices.")

    def read_states(self) -> Vector:
        """Return the present states, shape (states,)."""
        return np.concatenate([p.read_states() for p in self._parts])

    def read_inputs(self) -> Vector:
        """Return the present values of the inputs, with their shifts."""
        return self._read_variables(self._inputs)

    def unit(self, name: str) -> str:
        """Return the unit of a state, an input or an output; 1 if it has none."""
        signal = self._names.find(name)
        return str(signal.interface.unit(signal.fmu_name) or "1")

    def evaluate(self, states: Vector, shifts: Vector) -> tuple[Vector, Vector]:
        """Return derivatives per s, and outputs. The shifts stay until the next call.

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
        return rates, self._read_variables(self._outputs)

    def handle_event(self) -> None:
        """Let all components find their discrete states and relations for the present states."""
        for part in self._parts:
            part.handle_event()

    def find_discrete_components(self) -> list[str]:
        """Return the components with time events or discrete Reals, which the matrices keep constant."""
        return [
            name
            for name, (_, _, member) in self._members.items()
            if np.isfinite(member.next_event)
            or any(
                v.type == "Real" and v.variability == "discrete" and v.causality != "parameter"
                for v in member.file.interface.variables.values()
            )
        ]

    def _read_variables(self, variables: Sequence[_Variable]) -> Vector:
        return np.array([float(part.members[k].value(variable)) for part, k, variable in variables])

    def _find_variable(self, name: str, is_input: bool = False) -> _Variable:
        """Return a variable with its instance; CommandError unless it is Real, and an input if it must be."""
        signal = self._names.find(name)
        variable = signal.variable
        part, position, _ = self._members[signal.component.name]
        if variable.type != "Real":
            raise CommandError(f"{name} is {variable.type}; state matrices need a Real.", name=name)
        if is_input and (variable.causality != "input" or variable.variability != "continuous"):
            raise CommandError(f"{name} is not a continuous input.", name=name)
        return part, position, variable

    def _check_integration(self, has_unreachable: bool) -> None:
        """Raise CommandError if states of a component cannot be reached, or components are integrated apart.

        `has_unreachable` tells whether an instance does not run as Model Exchange.
        """
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


_STEP_FRACTION = float(np.finfo(float).eps) ** (1.0 / 3.0)
"""Step of central differences, relative to the size of a variable: rounding and curvature are then equal."""

_ROUNDING = 1e-9
"""Part of the largest effect in a row that counts as rounding."""

_KINK = 0.02
"""Curvature within a step, relative to the slope, above which a function is not smooth."""

_STEADY_TOLERANCE, _MAX_ITERATIONS, _MAX_EVENTS = 1e-9, 50, 10


def compute_matrices(
    system: ContinuousSystem, states: Vector, shifts: Vector
) -> tuple[StateSpace, list[str]]:
    """Return the state matrices at an operating point, and remarks.

    Args:
        system: The system.
        states: States at the operating point.
        shifts: Shifts of the inputs there.

    Raises:
        RunError: An FMU fails.
    """
    rates, outputs = system.evaluate(states, shifts)
    at_inputs, sizes = system.read_inputs(), _read_sizes(system, states)
    slopes, kinks = _differentiate(system, states, shifts, sizes, np.concatenate([rates, outputs]))
    system.evaluate(states, shifts)
    n = len(states)
    names = [*system.states, *system.inputs, *system.outputs]
    state_space = StateSpace(
        states=tuple(system.states),
        inputs=tuple(system.inputs),
        outputs=tuple(system.outputs),
        units={name: system.unit(name) for name in names},
        A=slopes[:n, :n],
        B=slopes[:n, n:],
        C=slopes[n:, :n],
        D=slopes[n:, n:],
        at_states=states,
        at_inputs=at_inputs,
        at_outputs=outputs,
    )
    rows = [*(f"the derivative of {name}" for name in system.states), *system.outputs]
    columns = [*system.states, *system.inputs]
    remarks = [
        f"{rows[i]} is not smooth in {columns[j]} at the operating point: a limit, friction or backlash may "
        "begin there."
        for i, j in kinks
    ]
    if discrete := system.find_discrete_components():
        remarks.append(
            f"{join_names(discrete)} {'has' if len(discrete) == 1 else 'have'} time events or discrete "
            "variables, which the matrices hold constant."
        )
    return state_space, remarks


def find_steady_state(system: ContinuousSystem, free: Collection[str]) -> tuple[Vector, Vector]:
    """Return the nearest states, and shifts of the inputs, at which no state changes.

    Newton's method begins at the present states. Where more than one steady state fits, each step is the
    smallest one, relative to the sizes of the variables.

    Args:
        system: The system.
        free: Inputs whose values may change; those of the others stay.

    Raises:
        RunError: There is no steady state, or none was found; or an FMU fails.
    """
    shifts = np.zeros(len(system.inputs))
    for _ in range(_MAX_EVENTS):
        states, shifts = _solve_steady_state(system, shifts, free)
        system.evaluate(states, shifts)
        system.handle_event()
        handled = system.read_states()
        rates, _ = system.evaluate(handled, shifts)
        if np.array_equal(handled, states) and not _list_moving_states(system, states, shifts, rates, free):
            return states, shifts
    raise RunError("there is no steady state: each one found is left by an event.", reason="no steady state")


def _solve_steady_state(
    system: ContinuousSystem, shifts: Vector, free: Collection[str]
) -> tuple[Vector, Vector]:
    """Return steady states and shifts, found from the present states; RunError if none is found."""
    states = system.read_states()
    rates, _ = system.evaluate(states, shifts)
    movable = np.array([name in free for name in system.inputs], dtype=bool)
    for _ in range(_MAX_ITERATIONS):
        slopes, sizes = _scale_slopes(system, states, shifts, rates, free)
        rows = np.abs(slopes).max(axis=1)
        if not (np.abs(rates) > _STEADY_TOLERANCE * rows).any():
            return states, shifts
        rows = np.where(rows > 0.0, rows, 1.0)
        # the smallest step where several steady states fit
        move = -np.linalg.lstsq(slopes / rows[:, None], rates / rows, rcond=1e-10)[0] * sizes
        before = np.linalg.norm(rates / rows)
        # a shorter step where the full one makes the rates larger
        for part in (1.0, 0.5, 0.25, 0.1, 0.01, 1e-3):
            x, u = states + part * move[: len(states)], shifts.copy()
            u[movable] += part * move[len(states) :]
            try:
                new_rates, _ = system.evaluate(x, u)
            except DiscardedCallError:  # the step leads to where the FMU is not defined
                continue
            if np.linalg.norm(new_rates / rows) < before:
                break
        else:
            break
        states, shifts, rates = x, u, new_rates
    moving = _list_moving_states(system, states, shifts, rates, free)
    changes = [f"{n} ({rates[system.states.index(n)]:.3g} {system.unit(n)}/s)" for n in moving[:3]]
    raise RunError(
        f"no steady state was found near the operating point: {join_names(changes)} still "
        f"{'changes' if len(moving) == 1 else 'change'}. Choose {'other ' if free else ''}free inputs, "
        "another time or other values.",
        reason="no steady state",
        states=moving,
    )


def _scale_slopes(
    system: ContinuousSystem, states: Vector, shifts: Vector, rates: Vector, free: Collection[str]
) -> tuple[np.ndarray, Vector]:
    """Return the slopes of the derivatives per size of states and free inputs, and these sizes."""
    system.evaluate(states, shifts)
    sizes = _read_sizes(system, states)
    slopes, _ = _differentiate(system, states, shifts, sizes, rates)
    movable = [*(True for _ in states), *(name in free for name in system.inputs)]
    return slopes[:, movable] * sizes[movable], sizes[movable]


def _list_moving_states(
    system: ContinuousSystem, states: Vector, shifts: Vector, rates: Vector, free: Collection[str]
) -> list[str]:
    """Return the names of the states whose derivatives are not 0 within the tolerance."""
    slopes, _ = _scale_slopes(system, states, shifts, rates, free)
    moving = np.abs(rates) > _STEADY_TOLERANCE * np.abs(slopes).max(axis=1)
    return [name for name, moves in zip(system.states, moving, strict=True) if moves]


def _read_sizes(system: ContinuousSystem, states: Vector) -> Vector:
    """Return the sizes of states and inputs, to which steps of differences are relative."""
    inputs = system.read_inputs()
    input_sizes = np.where(inputs != 0.0, np.abs(inputs), 1.0)
    return np.concatenate([np.maximum(np.abs(states), system.nominals), input_sizes])


def _differentiate(
    system: ContinuousSystem, states: Vector, shifts: Vector, sizes: Vector, middle: Vector
) -> tuple[np.ndarray, Sequence[tuple[int, int]]]:
    """Return the slopes of the values in `middle`, and the positions at which they are not smooth."""
    steps = _STEP_FRACTION * sizes
    n, m = len(states), len(steps)
    differences, curvatures = np.zeros((len(middle), m)), np.zeros((len(middle), m))
    for j in range(m):
        sides = []
        for sign in (1.0, -1.0):
            change = np.zeros(m)
            change[j] = sign * steps[j]
            rates, outputs = system.evaluate(states + change[:n], shifts + change[n:])
            sides.append(np.concatenate([rates, outputs])[: len(middle)])
        differences[:, j] = sides[0] - sides[1]
        curvatures[:, j] = sides[0] + sides[1] - 2.0 * middle
    rows = np.abs(differences).max(axis=1, keepdims=True)
    # an exact zero tells that there is no path; rounding must not
    differences[np.abs(differences) <= _ROUNDING * rows] = 0.0
    is_rough = (np.abs(curvatures) > _KINK * np.abs(differences)) & (np.abs(curvatures) > 1e-5 * rows)
    return differences / (2.0 * steps), [(int(i), int(j)) for i, j in np.argwhere(is_rough)]
