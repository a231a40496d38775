"""The mass matrix of a mechanism, from composite bodies.

All that a frame carries is one rigid body while the frame's own coordinate moves (Featherstone, Rigid Body
Dynamics Algorithms, 2008, section 6.2). A bar between two points belongs to the last common carrier of its
ends, and has a momentum of its own for the coordinates between the carrier and the ends.
"""

from collections.abc import Sequence
from typing import Any

from .bars import BarInertia
from .exact import ONE, ZERO
from .inertia import Inertia, slender
from .pose import Pose
from .vectors import NONE, Matrix, Vector, add, cross, dot, scale

Rows = list[list[Any]]
"""Rows of a matrix."""


def coordinate_masses(pose: Pose, bars: Sequence[BarInertia]) -> Rows:
    """Return the mass matrix of the coordinates, of which the lower triangle is filled.

    Args:
        pose: The pose.
        bars: The bars with an inertia of their own.
    """
    return _Masses(pose, bars).rows()


class _Masses:
    """The mass matrix in the making."""

    def __init__(self, pose: Pose, bars: Sequence[BarInertia]) -> None:
        self._pose, self._mechanism = pose, pose.mechanism
        self._shares = [_Share(pose, bar) for bar in bars]
        self._composites = self._compose()

    def rows(self) -> Rows:
        """Return the rows of the matrix."""
        mechanism = self._mechanism
        n = mechanism.coordinates
        M: Rows = [[ZERO] * n for _ in range(n)]
        for i, frame in enumerate(mechanism.frames):
            if frame.coordinate is None:
                continue
            composite, axis = self._composites[i], self._pose.axis(i)
            if frame.slides:
                force, moment = scale(composite.m, axis), cross(composite.S, axis)
            else:
                force, moment = cross(axis, composite.S), _times(composite.J, axis)
            at = i
            while at > 0:
                of = mechanism.frames[at]
                if of.coordinate is not None:
                    along = force if of.slides else moment
                    _add(M, frame.coordinate, of.coordinate, dot(self._pose.axis(at), along))
                moment = add(moment, cross(self._pose.arm(at), force))
                at = of.parent
                for share in self._shares:
                    if share.carrier == at and frame.coordinate in share.momenta:
                        more, about = share.momentum_at_carrier(frame.coordinate)
                        force, moment = add(force, more), add(moment, about)
        for share in self._shares:
            for i in share.momenta:
                for j in share.momenta:
                    if j <= i:
                        _add(M, i, j, share.mass(i, j))
        return M

    def _compose(self) -> list[Inertia]:
        """Return what each frame carries, about its origin, in the ground's directions."""
        found = [f.inertia.turned(self._pose.rotation(i)) for i, f in enumerate(self._mechanism.frames)]
        for share in self._shares:
            if share.carrier > 0:
                found[share.carrier] = found[share.carrier] + share.inertia()
        for i in range(len(found) - 1, 0, -1):
            parent = self._mechanism.frames[i].parent
            if parent > 0:
                found[parent] = found[parent] + found[i].shifted(self._pose.arm(i))
        return found


class _Share:
    """A bar's part: as a body of the carrier, and its momenta by coordinate below the carrier."""

    def __init__(self, pose: Pose, bar: BarInertia) -> None:
        self._bar, self._pose = bar, pose
        ends = bar.bar.start, bar.bar.end
        self.carrier = pose.mechanism.carrier(ends[0].frame, ends[1].frame)
        equation, u = bar.equation, bar.equation.u
        self._speeds = equation.start_speeds
        self.momenta = dict[int, tuple[Vector, Vector]]()
        self._turns = {i: scale(ONE / equation.distance, x) for i, x in equation.turns.items()}
        for i, omega in self._turns.items():
            v = self._speeds.get(i, NONE)
            momentum = add(scale(bar.m, v), cross(scale(bar.S, omega), u))
            momentum = add(momentum, scale(bar.rod_m * equation.slopes.get(i, ZERO), u))
            self.momenta[i] = momentum, add(scale(bar.S, cross(u, v)), scale(bar.J, omega))

    def inertia(self) -> Inertia:
        """Return the bar as a body of the carrier, about the carrier's origin."""
        bar, u = self._bar, self._bar.equation.u
        own = Inertia(bar.m, scale(bar.S, u), slender(bar.J, u, self._pose.mechanism.is_plane))
        return own.shifted(self._start)

    def momentum_at_carrier(self, coordinate: int) -> tuple[Vector, Vector]:
        """Return momentum per speed of a coordinate, and its moment about the carrier's origin."""
        momentum, moment = self.momenta[coordinate]
        return momentum, add(moment, cross(self._start, momentum))

    def mass(self, i: int, j: int) -> Any:
        """Return the mass of two coordinates below the carrier, without the rod's inertia along itself."""
        bar, equation = self._bar, self._bar.equation
        momentum, moment = self.momenta[i]
        mass = dot(self._turns[j], moment)
        if j in self._speeds:
            mass = mass + dot(self._speeds[j], momentum)
        if i in self._speeds:
            mass = mass + bar.rod_m * equation.slopes.get(j, ZERO) * dot(equation.u, self._speeds[i])
        return mass

    @property
    def _start(self) -> Vector:
        """The bar's start from the carrier's origin."""
        start, arm = self._bar.bar.start, self._pose.reach(self._bar.bar.start)
        frame = start.frame
        while frame != self.carrier:
            arm = add(self._pose.arm(frame), arm)
            frame = self._pose.mechanism.frames[frame].parent
        return arm


def _times(J: Matrix, axis: Vector) -> Vector:
    return dot(J[0], axis), dot(J[1], axis), dot(J[2], axis)


def _add(M: Rows, i: int, j: int, mass: Any) -> None:
    i, j = max(i, j), min(i, j)
    M[i][j] = M[i][j] + mass
