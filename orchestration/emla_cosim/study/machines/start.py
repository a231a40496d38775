"""The state of a machine at the start of a run: its pose, what swings freely, and masses at the screws."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from machine_fmu import Dynamics, Machine, MachineError, assemble, find_closure, reach_pose
from machine_fmu.exact import plain

from ...base.errors import CommandError

_ITERATIONS = 30
_FARTHEST = 2.0
"""Largest distance in rad or m of a passive coordinate at rest from the assembly pose."""


@dataclass(frozen=True)
class Start:
    """A machine at rest.

    Attributes:
        values: Start values of its blocks by FMI name.
        masses: Mass in kg that each screw moves while the others are held.
    """

    values: Mapping[str, float]
    masses: Sequence[float]


def find_start(machine: Machine, strokes: Sequence[float], label: str) -> Start:
    """Return the state at strokes in m. Passive coordinates rest where they hang.

    Raises:
        CommandError: The machine cannot take this pose.
    """
    closure, mechanism = find_closure(machine), assemble(machine)
    lengths = dict(closure.lengths)
    for bar, stroke in zip(mechanism.actuators, strokes, strict=True):
        lengths[bar.name] = float(plain(bar.length)) + stroke
    try:
        pose = reach_pose(mechanism, closure, lengths)
    except MachineError as error:
        text = ", ".join(f"{x:.6g}" for x in strokes)
        raise CommandError(f"{label} cannot start at the strokes {text} m: {error}.") from error
    guess = {i: pose[i] for i in closure.iterated}

    def dynamics(passive: Sequence[float]) -> Dynamics:
        return Dynamics(mechanism, closure, strokes, passive, guess or None, _ITERATIONS)

    passive = _hang(dynamics, [pose[i] for i in mechanism.passive], len(strokes))
    at_rest = dynamics(passive)
    numbers = at_rest.pose.numbers
    values = {f"start.pose[{n}]": float(plain(numbers[i])) for n, i in enumerate(closure.iterated, 1)}
    values |= {f"start.passive.q[{n}]": x for n, x in enumerate(passive, 1)}
    M = at_rest.mass_matrix()
    return Start(values, [float(plain(M[i][i])) for i in range(len(strokes))])


def _hang(dynamics: Callable[[Sequence[float]], Dynamics], start: list[float], count: int) -> list[float]:
    """Return passive coordinates without forces, near the first ones; these if there are none."""
    if not start:
        return start
    from scipy.optimize import root

    def forces(passive: Sequence[float]) -> list[float]:
        state = dynamics(list(map(float, passive)))
        return [float(x) for x in state.bias([0.0] * state.variables)[count:]]

    found = root(forces, start, tol=1e-10)
    is_near = all(abs(a - b) < _FARTHEST for a, b in zip(found.x, start, strict=True))
    return [float(x) for x in found.x] if found.success and is_near else start
