"""The equations of a machine on symbols of CasADi, of strokes and of coordinates that no formula gives."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi

from .assembly import assemble, locate_points
from .closure import closure_errors, find_closure
from .description import Machine, MachineError
from .dynamics import Dynamics
from .exact import plain
from .hanging import ANYWHERE, follow, stiffness
from .mechanism import End
from .naming import name_numbers


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
        named = name_numbers(machine)
        parameters = dict(named.parameters)
        for name, value in (values or {}).items():
            if name not in parameters:
                raise MachineError(f"the machine has no number '{name}'; existing: {', '.join(parameters)}")
            parameters[name] = replace(parameters[name], value=float(value))
        self.machine = replace(named, parameters=parameters)
        # blocks keep the sides of their description, whatever their parameters
        self.closure = replace(find_closure(self.machine), sides=find_closure(named).sides)
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

    def at(self, q: casadi.SX, x: casadi.SX, payload: Any = None) -> Dynamics:
        """Return the dynamics at symbols of strokes and of `unknowns`.

        They are those of the pose only where `errors` are zero. `payload` is in kg; that of the description
        without.
        """
        mechanism = self.mechanism if payload is None else assemble(self.machine, None, payload)
        values = dict(zip(self.unknowns, casadi.vertsplit(x), strict=True))
        guess = {i: values[i] for i in self.closure.iterated} or None
        held = [values[i] for i in mechanism.passive]
        return Dynamics(mechanism, self.closure, casadi.vertsplit(q), held, guess, 0)

    def inverse(
        self, q: casadi.SX, x: casadi.SX, v: casadi.SX, a: casadi.SX, payload: Any = None
    ) -> casadi.SX:
        """Return the forces of the actuators in N for speeds and accelerations of the strokes; see `at`."""
        n, rows, slopes = len(self.names), *self.rows(q, x, v, a, payload)
        # what passive coordinates take to hang acts on the strokes, which move them: no energy is lost
        return rows[:n] + slopes.T @ rows[n:] if self.mechanism.passive else rows

    def energy_of(self, q: casadi.SX, x: casadi.SX, v: casadi.SX, payload: Any = None) -> casadi.SX:
        """Return the energy in J for speeds of the strokes; see `at`."""
        dynamics = self.at(q, x, payload)
        speeds, *_ = self._motion(dynamics, q, x, v, 0.0 * v)
        return dynamics.energy(casadi.vertsplit(speeds))

    def rows(
        self, q: casadi.SX, x: casadi.SX, v: casadi.SX, a: casadi.SX, payload: Any = None
    ) -> tuple[casadi.SX, casadi.SX]:
        """Return the forces of strokes and passive coordinates, and the slopes of the latter by strokes."""
        dynamics = self.at(q, x, payload)
        speeds, growths, slopes = self._motion(dynamics, q, x, v, a)
        rows = dynamics.inverse(casadi.vertsplit(speeds), casadi.vertsplit(growths))
        return casadi.vertcat(*rows), slopes

    def errors(self, dynamics: Dynamics) -> casadi.SX:
        """Return how far `unknowns` are from their values: from lengths in m, and then from rest in rad or m.

        Coordinates that rest anywhere are as assembled.
        """
        closing = closure_errors(dynamics.pose, self.closure, dynamics.lengths)
        if not self.mechanism.passive:
            return casadi.vertcat(*closing)
        assembled = [self.closure.assembly[i] for i in self.mechanism.passive]
        off = casadi.vertcat(*dynamics.passive) - casadi.DM(assembled)
        return casadi.vertcat(*closing, self._torques(dynamics) / self._weight + ANYWHERE * off)

    def balance(self, q: casadi.SX, x: casadi.SX, payload: Any = None) -> tuple[casadi.SX, casadi.SX]:
        """Return torques or forces of passive coordinates at rest, and their derivatives; see `at`."""
        dynamics, count = self.at(q, x, payload), len(self.closure.iterated)
        torques = self._torques(dynamics)
        closing = casadi.vertcat(*closure_errors(dynamics.pose, self.closure, dynamics.lengths))
        return torques, stiffness(torques, closing, x[:count], x[count:])

    def locate(self, dynamics: Dynamics, ends: Sequence[End]) -> casadi.SX:
        """Return the coordinates in m of points, such as those of `ends`, one after the other."""
        points = (dynamics.pose.point(end)[: self.dimensions] for end in ends)
        return casadi.vertcat(*(plain(x) for point in points for x in point))

    def _torques(self, dynamics: Dynamics) -> casadi.SX:
        """Return the torques or forces of passive coordinates at rest."""
        rest = [0.0] * dynamics.variables
        return casadi.vertcat(*dynamics.inverse(rest, rest)[len(self.names) :])

    @cached_property
    def _weight(self) -> float:
        """Weight of all bodies in N, which has the size of the torques."""
        masses = sum(float(plain(frame.inertia.m)) for frame in self.mechanism.frames)
        return 1.0 + masses * math.hypot(*(float(plain(x)) for x in self.mechanism.gravity))

    def _motion(
        self, dynamics: Dynamics, q: casadi.SX, x: casadi.SX, v: casadi.SX, a: casadi.SX
    ) -> tuple[casadi.SX, casadi.SX, casadi.SX]:
        """Return speeds and accelerations of all variables, and slopes of passive coordinates by strokes."""
        count = len(self.mechanism.passive)
        if not count:
            return v, a, casadi.SX(0, len(self.names))
        slopes, *rates = follow(self.errors(dynamics), q, x, v, a)
        speeds, growths = (rate[-count:] for rate in rates)
        return casadi.vertcat(v, speeds), casadi.vertcat(a, growths), slopes[-count:, :]
