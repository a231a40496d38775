"""The equations of a closure in a pose: speeds, accelerations and forces of coordinates and variables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from .closure import Closure
from .exact import MINUS_ONE, ONE, ZERO, is_zero
from .linear import Factors
from .mechanism import Bar
from .pose import Lever, Pose, Relative
from .rows import Row, row_direction, row_ends, row_levers, row_slopes
from .vectors import NONE, Vector, add, cross, dot, scale

Numbers = Mapping[int, Any]
"""Speeds or accelerations by coordinate; missing ones are the exact zero."""


@dataclass
class Equation:
    """An equation in a pose.

    Args:
        pose: The pose.
        row: Which equation it is.
        length: Length of its bar in m; None for a loop.
    """

    pose: Pose
    row: Row
    length: Any

    def __post_init__(self) -> None:
        """Compute direction and slopes."""
        self.distance, self.u = row_direction(self.pose, self.row, self.length)
        self.slopes = row_slopes(self.pose, self.row, self.u)
        if self._lever is not None:
            self.slopes[self._lever.coordinate] = self._lever.slope

    @property
    def bar(self) -> Bar | None:
        """Its bar; None for a loop."""
        return self.pose.mechanism.bars[self.row.bar] if self.row.bar >= 0 else None

    @property
    def _lever(self) -> Lever | None:
        return None if self.bar is None else self.pose.levers.get(self.bar.name)

    @cached_property
    def turns(self) -> dict[int, Vector]:
        """The angular velocity of the bar per speed of each coordinate, times its length."""
        levers = row_levers(self.pose, self.row)
        if self.pose.mechanism.is_plane:
            turning = {i: arm for i, (_, arm) in levers.items() if arm is not NONE}
            found = {i: cross(self.u, lever) for i, (lever, _) in levers.items() if i not in turning}
            found |= {i: (ZERO, ZERO, dot(self.u, arm)) for i, arm in turning.items()}
            if self._lever is not None:
                found[self._lever.coordinate] = ZERO, ZERO, self._lever.along
            return found
        return {i: cross(self.u, lever) for i, (lever, _) in levers.items()}

    @cached_property
    def start_speeds(self) -> dict[int, Vector]:
        """The velocity of the start relative to the carrier of both ends per speed of each coordinate."""
        start, end = row_ends(self.pose.mechanism, self.row)
        path, _ = self.pose.mechanism.paths(start.frame, end.frame)
        own = {self.pose.mechanism.frames[frame].coordinate for frame in path}
        levers = row_levers(self.pose, self.row)
        return {i: scale(MINUS_ONE, lever) for i, (lever, _) in levers.items() if i in own}

    def turning(self, rates: Numbers) -> Vector:
        """Return the angular velocity of the bar relative to the last common carrier of its ends, rad/s."""
        total = NONE
        for i, turn in self.turns.items():
            total = add(total, scale(rates.get(i, ZERO), turn))
        return scale(ONE / self.distance, total)

    def drift(self, rates: Numbers) -> Any:
        """Return the second derivative of the distance without accelerations of coordinates, m/s2."""
        bar = self.bar
        if bar is not None and bar.slide is not None:
            return ZERO
        if all(is_zero(rates.get(i, ZERO)) for i in self.slopes):
            return ZERO
        along, _ = self.acceleration(rates)
        if bar is None:
            return along
        omega = self.turning(rates)
        return along + self.distance * dot(omega, omega)

    def acceleration(self, rates: Numbers) -> tuple[Any, Vector]:
        """Return how the ends accelerate from each other without accelerations of coordinates, m/s2.

        The first is the part along the direction u, the second the vector product of u and the acceleration.
        """
        if self._lever is not None and len(self.slopes) == 1 and self.pose.mechanism.is_plane:
            rate = rates.get(self._lever.coordinate, ZERO)
            squared = rate * rate
            return -(squared * self._lever.along), (ZERO, ZERO, squared * self._lever.slope)
        ends = row_ends(self.pose.mechanism, self.row)
        a = Relative(self.pose, *ends, dict(rates), {}).acceleration()
        return dot(self.u, a), cross(self.u, a)


class Equations:
    """All equations of a closure in a pose.

    Args:
        pose: The pose.
        closure: The closure.
        lengths: Lengths of the bars in m by name.
    """

    def __init__(self, pose: Pose, closure: Closure, lengths: Mapping[str, Any]) -> None:
        self._mechanism, self._closure = pose.mechanism, closure
        bars = pose.mechanism.bars
        self.all = [
            Equation(pose, row, lengths[bars[row.bar].name] if row.bar >= 0 else None) for row in closure.rows
        ]

    def speeds(self, v: Sequence[Any]) -> dict[int, Any]:
        """Return the speeds of the coordinates for those of the variables."""
        return self._resolve(v, [ZERO] * len(self.all))

    def accelerations(self, a: Sequence[Any], rates: Numbers) -> dict[int, Any]:
        """Return the accelerations of the coordinates for those of the variables."""
        return self._resolve(a, [equation.drift(rates) for equation in self.all])

    def forces(self, torques: Numbers) -> tuple[dict[str, Any], dict[int, Any]]:
        """Return the forces along the bars in N by name, and the rest of passive coordinates, for torques."""
        rest, along = dict(torques), dict[str, Any]()
        for step, factors in reversed(list(zip(self._closure.steps, self._factors, strict=True))):
            equations = [self.all[e] for e in step.equations]
            forces = factors.solve_transposed([rest[i] for i in step.unknowns])
            for equation, force in zip(equations, forces, strict=True):
                for i, slope in equation.slopes.items():
                    if i not in step.unknowns:
                        rest[i] = rest[i] - slope * force
                if equation.bar is not None:
                    along[equation.bar.name] = force
        return along, rest

    @property
    def newton_factors(self) -> list[Factors]:
        """The slopes of each step of Newton's method as factors."""
        pairs = zip(self._closure.steps, self._factors, strict=True)
        return [factors for step, factors in pairs if step.unknowns[0] not in self._closure.sides]

    @cached_property
    def _factors(self) -> list[Factors]:
        """The slopes of each step as factors."""
        return [
            Factors([[self.all[e].slopes.get(i, ZERO) for i in step.unknowns] for e in step.equations])
            for step in self._closure.steps
        ]

    def _resolve(self, given: Sequence[Any], drifts: Sequence[Any]) -> dict[int, Any]:
        """Return speeds or accelerations of the coordinates for those of the variables."""
        actuators = self._mechanism.actuators
        found = dict(zip(self._mechanism.passive, given[len(actuators) :], strict=True))
        wanted = {bar.name: x for bar, x in zip(actuators, given, strict=False)}
        for step, factors in zip(self._closure.steps, self._factors, strict=True):
            right = []
            for e in step.equations:
                equation = self.all[e]
                rest = ZERO if equation.bar is None else wanted.get(equation.bar.name, ZERO)
                rest = rest - drifts[e]
                for i, slope in equation.slopes.items():
                    if i not in step.unknowns:
                        rest = rest - slope * found.get(i, ZERO)
                right.append(rest)
            found.update(zip(step.unknowns, factors.solve(right), strict=True))
        return found
