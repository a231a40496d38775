"""The equations of a machine, of strokes and of coordinates that no formula gives.

Numbers are symbols of CasADi, or arrays with a value for each pose. Passive coordinates need symbols, because
how they follow the strokes contains derivatives.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from .assembly import assemble, locate_points
from .closure import closure_errors, find_closure
from .description import Machine, MachineError
from .dynamics import Dynamics
from .exact import plain
from .hanging import ANYWHERE, follow, stiffness
from .mechanism import End
from .naming import name_numbers
from .vectors import dot

if TYPE_CHECKING:
    import casadi


class Mechanics:
    """A machine with values of its numbers, and its equations.

    Args:
        machine: The description.
        values: Numbers by name, as the variables of its blocks have them, which replace those of the
            description.

    Raises:
        MachineError: A name does not exist, or lengths do not determine the pose.
    """

    def __init__(self, machine: Machine, values: Mapping[str, float] | None = None) -> None:
        numbered = name_numbers(machine)
        parameters = dict(numbered.parameters)
        for name, value in (values or {}).items():
            if name not in parameters:
                raise MachineError(f"the machine has no number '{name}'; existing: {', '.join(parameters)}")
            parameters[name] = replace(parameters[name], value=float(value))
        self.machine = replace(numbered, parameters=parameters)
        # blocks keep the sides of their description, whatever their parameters
        self.closure = replace(find_closure(self.machine), sides=find_closure(numbered).sides)
        self.mechanism = assemble(self.machine)

    @property
    def names(self) -> tuple[str, ...]:
        """The actuators in their order."""
        return tuple(self.machine.actuators)

    @property
    def dimensions(self) -> int:
        """Number of coordinates of a point: 2 in the plane, 3 in space."""
        return self.machine.dimensions

    @property
    def unknowns(self) -> tuple[int, ...]:
        """The coordinates that no formula gives: those that Newton's method finds, and then passive ones."""
        return (*self.closure.iterated, *self.mechanism.passive)

    @cached_property
    def ends(self) -> dict[str, End]:
        """All points of bodies and of the ground, by BODY or BODY.POINT."""
        return locate_points(self.machine)

    def at(self, q: Sequence[Any], x: Sequence[Any], payload: Any = None) -> Dynamics:
        """Return the dynamics at numbers of strokes and of `unknowns`.

        They are those of the pose only where `errors` are zero. `payload` is in kg; that of the description
        without.
        """
        mechanism = self.mechanism if payload is None else assemble(self.machine, None, payload)
        values = dict(zip(self.unknowns, x, strict=True))
        guess = {i: values[i] for i in self.closure.iterated} or None
        passive = [values[i] for i in mechanism.passive]
        return Dynamics(mechanism, self.closure, q, passive, guess, 0)

    def inverse(
        self, q: Sequence[Any], x: Sequence[Any], v: Sequence[Any], a: Sequence[Any], payload: Any = None
    ) -> list[Any]:
        """Return the forces of the actuators in N for speeds and accelerations of the strokes; see `at`."""
        n, (rows, slopes) = len(self.names), self.rows(q, x, v, a, payload)
        # what passive coordinates take to hang acts on the strokes, which move them: no energy is lost
        return [
            force + dot(rows[n:], [slopes_of_row[i] for slopes_of_row in slopes])
            for i, force in enumerate(rows[:n])
        ]

    def energy_of(self, q: Sequence[Any], x: Sequence[Any], v: Sequence[Any], payload: Any = None) -> Any:
        """Return the energy in J for speeds of the strokes; see `at`."""
        dynamics = self.at(q, x, payload)
        speeds, *_ = self._compute_motion(dynamics, q, x, v, [0.0] * len(v))
        return dynamics.energy(speeds)

    def rows(
        self, q: Sequence[Any], x: Sequence[Any], v: Sequence[Any], a: Sequence[Any], payload: Any = None
    ) -> tuple[list[Any], list[list[Any]]]:
        """Return the forces of strokes and passive coordinates, and the slopes of the latter by strokes."""
        dynamics = self.at(q, x, payload)
        speeds, growths, slopes = self._compute_motion(dynamics, q, x, v, a)
        return dynamics.inverse(speeds, growths), slopes

    def errors(self, dynamics: Dynamics) -> list[Any]:
        """Return how far `unknowns` are from their values: from lengths in m, and then from rest in rad or m.

        Coordinates that rest anywhere are as assembled.
        """
        closing = closure_errors(dynamics.pose, self.closure, dynamics.lengths)
        passive = zip(self.mechanism.passive, dynamics.passive, self._compute_torques(dynamics), strict=True)
        assembly = self.closure.assembly
        return [*closing, *(f / self._weight + ANYWHERE * (x - assembly[i]) for i, x, f in passive)]

    def balance(
        self, q: Sequence["casadi.SX"], x: Sequence["casadi.SX"], payload: Any = None
    ) -> list["casadi.SX"]:
        """Return torques or forces of passive coordinates at rest, and then their derivatives, by column."""
        import casadi

        dynamics, count = self.at(q, x, payload), len(self.closure.iterated)
        torques = self._compute_torques(dynamics)
        closing = closure_errors(dynamics.pose, self.closure, dynamics.lengths)
        columns = (casadi.vertcat(*numbers) for numbers in (torques, closing, x[:count], x[count:]))
        return [*torques, *casadi.vertsplit(casadi.vec(stiffness(*columns)))]

    def locate(self, dynamics: Dynamics, ends: Sequence[End]) -> list[Any]:
        """Return the coordinates in m of points, such as those of `ends`, one after the other."""
        points = (dynamics.pose.point(end)[: self.dimensions] for end in ends)
        return [plain(x) for point in points for x in point]

    def _compute_torques(self, dynamics: Dynamics) -> list[Any]:
        """Return the torques or forces of passive coordinates at rest."""
        if not self.mechanism.passive:
            return []
        rest = [0.0] * dynamics.variables
        return dynamics.inverse(rest, rest)[len(self.names) :]

    @cached_property
    def _weight(self) -> float:
        """Weight of all bodies in N, which has the size of the torques."""
        masses = sum(float(plain(frame.inertia.m)) for frame in self.mechanism.frames)
        return 1.0 + masses * math.hypot(*(float(plain(x)) for x in self.mechanism.gravity))

    def _compute_motion(
        self, dynamics: Dynamics, q: Sequence[Any], x: Sequence[Any], v: Sequence[Any], a: Sequence[Any]
    ) -> tuple[list[Any], list[Any], list[list[Any]]]:
        """Return speeds and accelerations of all variables, and slopes of passive coordinates by strokes."""
        count = len(self.mechanism.passive)
        if not count:
            return [*v], [*a], []
        import casadi

        columns = (casadi.vertcat(*numbers) for numbers in (self.errors(dynamics), q, x, v, a))
        slopes, *rates = follow(*columns)
        speeds, growths = (casadi.vertsplit(rate[-count:]) for rate in rates)
        by_stroke = [casadi.horzsplit(row) for row in casadi.vertsplit(slopes[-count:, :])]
        return [*v, *speeds], [*a, *growths], by_stroke
