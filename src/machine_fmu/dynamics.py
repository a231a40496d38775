"""Motion and forces of a mechanism: inverse and forward dynamics, mass matrix, and energy.

The variables are strokes of actuators, in their order, and then passive coordinates. Forces are those of the
actuators in N, positive against extension of a load, that is f in M(x) a + bias(x, v) = f. The rods'
inertia along the screws is not in M: it is part of the actuators' own equations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from .closure import ITERATIONS, Closure, row_direction, row_ends, row_slopes, solve_pose
from .exact import ONE, ZERO, is_zero, plain
from .linear import Factors, solve_symmetric
from .mechanism import Bar, Inertia, Mechanism
from .pose import Motion, Pose, Relative, carry, swing
from .vectors import NONE, Vector, add, cross, dot, is_none, scale, subtract, turn, turn_back

Numbers = Mapping[int, Any]
"""Speeds or accelerations by coordinate; missing ones are the exact zero."""


@dataclass
class _Equation:
    """An equation in a pose: its direction, distance, slopes, and motion of its ends."""

    u: Vector
    distance: Any
    slopes: Mapping[int, Any]
    bar: Bar | None


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
    """

    mechanism: Mechanism
    closure: Closure
    strokes: Sequence[Any]
    passive: Sequence[Any] = ()
    guess: Mapping[int, Any] | None = None
    iterations: int = ITERATIONS
    pose: Pose = field(init=False)

    def __post_init__(self) -> None:
        """Solve for the pose."""
        mechanism = self.mechanism
        self.lengths = {b.name: b.length for b in mechanism.bars if not b.is_actuator}
        for name, length in self.lengths.items():
            if length is None:
                self.lengths[name] = self.closure.lengths[name]
        for bar, stroke in zip(mechanism.actuators, self.strokes, strict=True):
            self.lengths[bar.name] = bar.length + stroke
        passive = dict(zip(mechanism.passive, self.passive, strict=True)) if self.passive else None
        self.pose = solve_pose(
            mechanism, self.closure, self.lengths, passive, self.guess, self.iterations
        )

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
        """Return M as a list of rows; its columns are the forces for unit accelerations at rest."""
        n = self.variables
        zeros = [ZERO] * n
        columns = [self._forces(zeros, [ONE if i == k else ZERO for i in range(n)], NONE) for k in range(n)]
        return [[plain(columns[min(i, j)][max(i, j)]) for j in range(n)] for i in range(n)]

    def forward(self, v: Sequence[Any], force: Sequence[Any], reflected: Sequence[Any] = ()) -> list[Any]:
        """Return the accelerations under forces; `reflected` is a further inertia of each variable."""
        M, h = self.mass_matrix(), self.bias(v)
        for i, inertia in enumerate(reflected):
            M[i][i] = M[i][i] + inertia
        return solve_symmetric(M, [f - b for f, b in zip(force, h, strict=True)])

    def energy(self, v: Sequence[Any], reflected: Sequence[Any] = ()) -> Any:
        """Return the kinetic and potential energy in J; the latter is 0 with all masses at height 0."""
        M = self.mass_matrix()
        for i, inertia in enumerate(reflected):
            M[i][i] = M[i][i] + inertia
        kinetic = 0.5 * dot(v, [dot(row, v) for row in M])
        return plain(kinetic - dot(self.mechanism.gravity, self._moment()))

    def speeds(self, v: Sequence[Any]) -> dict[int, Any]:
        """Return the speeds of the coordinates by number."""
        return self._resolve(v, {}, speeds=True)

    # ---- coordinates -------------------------------------------------------------------

    @cached_property
    def _equations(self) -> list[_Equation]:
        found = []
        for row in self.closure.rows:
            bar = self.mechanism.bars[row.bar] if row.bar >= 0 else None
            distance, u = row_direction(self.pose, row, None if bar is None else self.lengths[bar.name])
            found.append(_Equation(u, distance, row_slopes(self.pose, row, u), bar))
        return found

    @cached_property
    def _factors(self) -> list[Factors | None]:
        """The slopes of each step with several coordinates, as factors."""
        found = list[Factors | None]()
        for step in self.closure.steps:
            if len(step.unknowns) == 1:
                found.append(None)
                continue
            rows = ([self._equations[e].slopes.get(i, ZERO) for i in step.unknowns] for e in step.equations)
            found.append(Factors([list(row) for row in rows]))
        return found

    def _resolve(self, given: Sequence[Any], rates: Numbers, speeds: bool = False) -> dict[int, Any]:
        """Return speeds or accelerations of the coordinates for those of the variables."""
        count = len(self.strokes)
        found = dict(zip(self.mechanism.passive, given[count:], strict=True))
        wanted = {bar.name: x for bar, x in zip(self.mechanism.actuators, given[:count], strict=True)}
        for step, factors in zip(self.closure.steps, self._factors, strict=True):
            right = []
            for e in step.equations:
                equation = self._equations[e]
                rest = ZERO if equation.bar is None else wanted.get(equation.bar.name, ZERO)
                if not speeds:
                    rest = rest - self._drift(e, rates)
                for i, slope in equation.slopes.items():
                    if i not in step.unknowns:
                        rest = rest - slope * found.get(i, ZERO)
                right.append(rest)
            if factors is None:
                slope = self._equations[step.equations[0]].slopes[step.unknowns[0]]
                found[step.unknowns[0]] = right[0] / slope
            else:
                found.update(zip(step.unknowns, factors.solve(right), strict=True))
        return found

    def _drift(self, e: int, rates: Numbers) -> Any:
        """Return the second derivative of an equation's distance without accelerations of coordinates."""
        equation = self._equations[e]
        if equation.bar is not None and equation.bar.slide is not None:
            return ZERO
        if all(is_zero(rates.get(i, ZERO)) for i in equation.slopes):
            return ZERO
        ends = row_ends(self.mechanism, self.closure.rows[e])
        relative = Relative(self.pose, *ends, rates, {})
        along = dot(equation.u, relative.acceleration())
        if equation.bar is None:
            return along
        speed = relative.speed()
        across = subtract(speed, scale(dot(equation.u, speed), equation.u))
        return along + dot(across, across) / equation.distance

    # ---- forces ------------------------------------------------------------------------

    def _forces(self, v: Sequence[Any], a: Sequence[Any], gravity: Vector) -> list[Any]:
        rates = self._resolve(v, {}, speeds=True)
        growths = self._resolve(a, rates)
        motions = self._motions(rates, growths, gravity)
        count = len(self.mechanism.frames)
        forces, moments = [NONE] * count, [NONE] * count
        for i in range(1, count):
            forces[i], moments[i] = _wrench(self.pose, i, self.mechanism.frames[i].inertia, motions[i])
        for bar, equation in zip(self.mechanism.bars, self._equations, strict=False):
            if not bar.has_mass:
                continue
            at_start, at_end = self._bar_forces(bar, equation, motions)
            for end, force in ((bar.start, at_start), (bar.end, at_end)):
                forces[end.frame] = add(forces[end.frame], force)
                moments[end.frame] = add(moments[end.frame], cross(self.pose.reach(end), force))
        torques = dict[int, Any]()
        for i in range(count - 1, 0, -1):
            frame = self.mechanism.frames[i]
            if frame.coordinate is not None:
                torques[frame.coordinate] = dot(
                    self.pose.axis(i), forces[i] if frame.slides else moments[i]
                )
            moment = add(moments[i], cross(self.pose.arm(i), forces[i]))
            forces[frame.parent] = add(forces[frame.parent], forces[i])
            moments[frame.parent] = add(moments[frame.parent], moment)
        return self._actuator_forces(torques, a)

    def _motions(self, rates: Numbers, growths: Numbers, gravity: Vector) -> list[Motion]:
        """Return the motions of all frames; weight is an upward acceleration of the ground."""
        up = NONE if is_none(gravity) else scale(-ONE, gravity)
        motions = [Motion(NONE, up, NONE, NONE)]
        for i, frame in enumerate(self.mechanism.frames[1:], 1):
            motions.append(carry(self.pose, motions[frame.parent], i, dict(rates), dict(growths)))
        return motions

    def _bar_forces(self, bar: Bar, equation: _Equation, motions: Sequence[Motion]) -> tuple[Vector, Vector]:
        """Return the forces at both ends of a bar that its inertia requires, without a force along it."""
        u, L = equation.u, equation.distance
        start, end = motions[bar.start.frame], motions[bar.end.frame]
        reach = self.pose.reach(bar.start), self.pose.reach(bar.end)
        v = subtract(end.speed_at(reach[1]), start.speed_at(reach[0]))
        a_start, a_end = start.acceleration_at(reach[0]), end.acceleration_at(reach[1])
        omega = scale(ONE / L, cross(u, v))
        a = subtract(a_end, a_start)
        coriolis = scale(dot(u, v), cross(omega, u))
        alpha = scale(ONE / L, cross(u, subtract(a, add(coriolis, coriolis))))
        turning = swing(omega, alpha, u)  # acceleration per distance along the bar
        housing = scale(bar.m, add(a_start, scale(bar.c, turning)))
        rod = scale(bar.rod_m, subtract(a_end, scale(bar.rod_c, turning)))
        moment = scale(bar.J + bar.rod_J, alpha)
        lever = subtract(scale(bar.c, housing), scale(bar.rod_c, rod))
        lever = add(subtract(lever, scale(dot(u, lever), u)), cross(moment, u))
        shift = scale(ONE / L, lever)
        return subtract(housing, shift), add(rod, shift)

    def _actuator_forces(self, torques: dict[int, Any], a: Sequence[Any]) -> list[Any]:
        """Return forces of the variables from those of the coordinates, the last step first."""
        along = dict[str, Any]()
        for step, factors in reversed(list(zip(self.closure.steps, self._factors, strict=True))):
            right = [torques[i] for i in step.unknowns]
            equations = [self._equations[e] for e in step.equations]
            if factors is None:
                found = [right[0] / equations[0].slopes[step.unknowns[0]]]
            else:
                found = factors.solve_transposed(right)
            for equation, force in zip(equations, found, strict=True):
                for i, slope in equation.slopes.items():
                    if i not in step.unknowns:
                        torques[i] = torques[i] - slope * force
                if equation.bar is not None:
                    along[equation.bar.name] = force
        strokes = [
            along[bar.name] - bar.rod_m * a_i
            for bar, a_i in zip(self.mechanism.actuators, a, strict=False)
        ]
        return [*strokes, *(torques[i] for i in self.mechanism.passive)]

    def _moment(self) -> Vector:
        """Return the sum of mass times position, kg m."""
        total = NONE
        origin = {0: NONE}
        for i, frame in enumerate(self.mechanism.frames[1:], 1):
            origin[i] = add(origin[frame.parent], self.pose.arm(i))
            total = add(total, scale(frame.inertia.m, origin[i]))
            total = add(total, turn(self.pose.rotation(i), frame.inertia.S))
        for bar, equation in zip(self.mechanism.bars, self._equations, strict=False):
            if bar.has_mass:
                start, end = (add(origin[e.frame], self.pose.reach(e)) for e in (bar.start, bar.end))
                total = add(total, scale(bar.m, add(start, scale(bar.c, equation.u))))
                total = add(total, scale(bar.rod_m, subtract(end, scale(bar.rod_c, equation.u))))
        return total


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



