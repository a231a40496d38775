"""Motion and forces of a mechanism: inverse and forward dynamics, mass matrix, and energy.

The variables are strokes of actuators, in their order, and then passive coordinates. Forces are those of the
actuators in N, positive against extension of a load, that is f in M(x) a + bias(x, v) = f. The rods'
inertia along the screws is not in M: it is part of the actuators' own equations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from .bars import BarInertia
from .closure import ITERATIONS, Closure, solve_pose
from .equations import Equations, Numbers
from .exact import ONE, ZERO, plain
from .linear import Factors, solve_symmetric
from .mass import coordinate_masses
from .mechanism import Inertia, Mechanism
from .pose import Motion, Pose, carry, swing
from .rows import row_direction
from .vectors import NONE, Vector, add, cross, dot, is_none, scale, subtract, turn, turn_back


@dataclass
class Dynamics:
    """A mechanism in a pose.

    Args:
        mechanism: The mechanism.
        closure: How lengths determine the pose.
        strokes: Strokes of the actuators, m.
        passive: Passive coordinates, in m or rad.
        guess: Where Newton's method begins, by coordinate.
        iterations: Number of its iterations.
        load: Force of a process on the payload in N, in directions of the ground.
    """

    mechanism: Mechanism
    closure: Closure
    strokes: Sequence[Any]
    passive: Sequence[Any] = ()
    guess: Mapping[int, Any] | None = None
    iterations: int = ITERATIONS
    load: Vector = NONE
    pose: Pose = field(init=False)

    def __post_init__(self) -> None:
        """Solve for the pose."""
        mechanism, self.strokes, self.passive = self.mechanism, _native(self.strokes), _native(self.passive)
        self.lengths = {b.name: b.length for b in mechanism.bars if not b.is_actuator}
        for name, length in self.lengths.items():
            if length is None:
                self.lengths[name] = self.closure.lengths[name]
        for bar, stroke in zip(mechanism.actuators, self.strokes, strict=True):
            self.lengths[bar.name] = bar.length + stroke
        passive = dict(zip(mechanism.passive, self.passive, strict=True)) if self.passive else None
        self.pose = solve_pose(mechanism, self.closure, self.lengths, passive, self.guess, self.iterations)

    @property
    def variables(self) -> int:
        """Number of strokes and passive coordinates."""
        return len(self.strokes) + len(self.mechanism.passive)

    def inverse(self, v: Sequence[Any], a: Sequence[Any]) -> list[Any]:
        """Return the forces for speeds and accelerations of the variables, with weight."""
        return [plain(x) for x in self._forces(v, a, self.mechanism.gravity)]

    def bias(self, v: Sequence[Any]) -> list[Any]:
        """Return the forces for weight and speed, without acceleration."""
        return self.inverse(v, [ZERO] * self.variables)

    def mass_matrix(self) -> list[list[Any]]:
        """Return M as a list of rows."""
        n, strokes = self.variables, self.mechanism.actuators
        M = coordinate_masses(self.pose, self._bars)
        columns = [self._equations.speeds([ONE if i == k else ZERO for i in range(n)]) for k in range(n)]
        rows: list[list[Any]] = [[ZERO] * n for _ in range(n)]
        for j, column in enumerate(columns):
            momenta = {
                i: dot([M[max(i, k)][min(i, k)] for k in column], list(column.values()))
                for i in range(len(M))
            }
            for i in range(j, n):
                mass = dot(list(columns[i].values()), [momenta[k] for k in columns[i]])
                if i == j < len(strokes) and strokes[i].slide is not None:
                    mass = mass - strokes[i].rod_m
                rows[i][j] = rows[j][i] = plain(mass)
        return rows

    def forward(self, v: Sequence[Any], force: Sequence[Any], reflected: Sequence[Any] = ()) -> list[Any]:
        """Return the accelerations under forces; `reflected` is a further inertia of each variable."""
        M, h = self.mass_matrix(), self.bias(v)
        for i, inertia in enumerate(reflected):
            M[i][i] = M[i][i] + inertia
        return solve_symmetric(M, [f - b for f, b in zip(_native(force), h, strict=True)])

    def energy(self, v: Sequence[Any], reflected: Sequence[Any] = ()) -> Any:
        """Return the kinetic and potential energy in J; the latter is 0 with all masses at height 0."""
        M = self.mass_matrix()
        for i, inertia in enumerate(reflected):
            M[i][i] = M[i][i] + inertia
        kinetic = 0.5 * dot(v, [dot(row, v) for row in M])
        return plain(kinetic - dot(self.mechanism.gravity, self._moment()))

    def speeds(self, v: Sequence[Any]) -> dict[int, Any]:
        """Return the speeds of the coordinates by number."""
        return self._equations.speeds(v)

    @property
    def newton_factors(self) -> list[Factors]:
        """The slopes of each step of Newton's method as factors."""
        return self._equations.newton_factors

    @property
    def residuals(self) -> list[Any]:
        """How far the equations of Newton's method are from being solved, m."""
        closure, bars = self.closure, self.mechanism.bars
        steps = (step for step in closure.steps if step.unknowns[0] not in closure.sides)
        rows = [closure.rows[e] for step in steps for e in step.equations]
        return [
            plain(
                row_direction(self.pose, row)[0]
                - (self.lengths[bars[row.bar].name] if row.bar >= 0 else ZERO)
            )
            for row in rows
        ]

    @cached_property
    def _equations(self) -> Equations:
        return Equations(self.pose, self.closure, self.lengths)

    @cached_property
    def _bars(self) -> list[BarInertia]:
        """The bars with an inertia of their own."""
        pairs = zip(self.mechanism.bars, self._equations.all, strict=False)
        return [BarInertia(bar, equation) for bar, equation in pairs if bar.has_mass]

    def _forces(self, v: Sequence[Any], a: Sequence[Any], gravity: Vector) -> list[Any]:
        """Return the forces of the variables for a motion, with an acceleration of free fall."""
        v, a = _native(v), _native(a)
        frames = self.mechanism.frames
        rates = self._equations.speeds(v)
        growths = self._equations.accelerations(a, rates)
        motions = self._motions(rates, growths, gravity)
        count = len(frames)
        forces, moments = [NONE] * count, [NONE] * count
        for i in range(1, count):
            forces[i], moments[i] = _wrench(self.pose, i, frames[i].inertia, motions[i])
        axial = dict[str, Any]()
        names = (bar.name for bar in self.mechanism.actuators)
        strokes = dict(zip(names, zip(v, a, strict=True), strict=False))
        for inertia in self._bars:
            bar = inertia.bar
            *at_ends, axial[bar.name] = inertia.forces(
                motions[bar.start.frame],
                motions[self.mechanism.carrier(bar.start.frame, bar.end.frame)],
                strokes.get(bar.name, (ZERO, ZERO)),
                rates,
                growths,
            )
            for end, force in zip((bar.start, bar.end), at_ends, strict=True):
                forces[end.frame] = add(forces[end.frame], force)
                moments[end.frame] = add(moments[end.frame], cross(self.pose.reach(end), force))
        if (end := self.mechanism.payload) is not None and not is_none(self.load):
            forces[end.frame] = subtract(forces[end.frame], self.load)
            moments[end.frame] = subtract(moments[end.frame], cross(self.pose.reach(end), self.load))
        along, rest = self._equations.forces(self._torques(forces, moments))
        found = []
        for bar, a_i in zip(self.mechanism.actuators, a, strict=False):
            force = along[bar.name] + axial.get(bar.name, ZERO)
            found.append(force - bar.rod_m * a_i if bar.slide is not None else force)
        return [*found, *(rest[i] for i in self.mechanism.passive)]

    def _torques(self, forces: list[Vector], moments: list[Vector]) -> dict[int, Any]:
        """Return the torques or forces of the coordinates for wrenches of the frames, the last ones first."""
        torques = dict[int, Any]()
        for i in range(len(forces) - 1, 0, -1):
            frame = self.mechanism.frames[i]
            if frame.coordinate is not None:
                along = forces[i] if frame.slides else moments[i]
                torques[frame.coordinate] = dot(self.pose.axis(i), along)
            moment = add(moments[i], cross(self.pose.arm(i), forces[i]))
            forces[frame.parent] = add(forces[frame.parent], forces[i])
            moments[frame.parent] = add(moments[frame.parent], moment)
        return torques

    def _motions(self, rates: Numbers, growths: Numbers, gravity: Vector) -> list[Motion]:
        """Return the motions of all frames; weight is an upward acceleration of the ground."""
        up = NONE if is_none(gravity) else scale(-ONE, gravity)
        motions = [Motion(NONE, up, NONE, NONE)]
        for i, frame in enumerate(self.mechanism.frames[1:], 1):
            motions.append(carry(self.pose, motions[frame.parent], i, dict(rates), dict(growths)))
        return motions

    def _moment(self) -> Vector:
        """Return the sum of mass times position, kg m."""
        total = NONE
        origin = {0: NONE}
        for i, frame in enumerate(self.mechanism.frames[1:], 1):
            origin[i] = add(origin[frame.parent], self.pose.arm(i))
            total = add(total, scale(frame.inertia.m, origin[i]))
            total = add(total, turn(self.pose.rotation(i), frame.inertia.S))
        for inertia in self._bars:
            start = inertia.bar.start
            total = add(total, scale(inertia.m, add(origin[start.frame], self.pose.reach(start))))
            total = add(total, scale(inertia.S, inertia.equation.u))
        return total


def _native(values: Sequence[Any]) -> list[Any]:
    """Return scalars of NumPy as floats; their comparisons would not be Python's."""
    return [x.item() if getattr(x, "ndim", None) == 0 else x for x in values]


def _wrench(pose: Pose, number: int, inertia: Inertia, motion: Motion) -> tuple[Vector, Vector]:
    """Return the force, and the moment about the origin, that the motion of a frame's mass requires."""
    R = pose.rotation(number)
    S = turn(R, inertia.S)
    force = add(scale(inertia.m, motion.a), swing(motion.omega, motion.alpha, S))
    spin, growth = turn_back(R, motion.omega), turn_back(R, motion.alpha)
    own = turn(inertia.J, growth)
    if not is_none(spin):
        own = add(own, cross(spin, turn(inertia.J, spin)))
    return force, add(cross(S, motion.a), turn(R, own))
