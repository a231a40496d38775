"""State matrices by differences, and steady states by Newton's method."""

from collections.abc import Collection, Sequence

import numpy as np

from ...base.arrays import Vector
from ...base.errors import RunError, join_names
from ...master.instances.model_exchange_instance import DiscardedCallError
from .continuous_system import ContinuousSystem
from .state_space import StateSpace

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
        states, shifts = _solve(system, shifts, free)
        system.evaluate(states, shifts)
        system.handle_event()
        handled = system.read_states()
        rates, _ = system.evaluate(handled, shifts)
        if np.array_equal(handled, states) and not _find_moving(system, states, shifts, rates, free):
            return states, shifts
    raise RunError("there is no steady state: each one found is left by an event.", reason="no steady state")


def _solve(system: ContinuousSystem, shifts: Vector, free: Collection[str]) -> tuple[Vector, Vector]:
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
    moving = _find_moving(system, states, shifts, rates, free)
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


def _find_moving(
    system: ContinuousSystem, states: Vector, shifts: Vector, rates: Vector, free: Collection[str]
) -> list[str]:
    slopes, _ = _scale_slopes(system, states, shifts, rates, free)
    moving = np.abs(rates) > _STEADY_TOLERANCE * np.abs(slopes).max(axis=1)
    return [name for name, moves in zip(system.states, moving, strict=True) if moves]


def _read_sizes(system: ContinuousSystem, states: Vector) -> Vector:
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
