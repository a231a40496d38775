"""Obstacles that a machine keeps clear of: convex bodies in the plane or in space."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import casadi
import numpy as np

from ..model import MachineModel
from ..spline import TrajectoryError
from .checks import is_number, is_position
from .surroundings import Approach, Axis, Points, all_lines, nearest, point_distances, segment_distances

_SEARCH = 60
"""Number of steps of the search along a segment; each one shortens it by a third."""

_DIRECTIONS = 240
"""Number of directions among which a separating one is sought."""

_FORM_NAMES = "centre and radius, low and high, or corners"


@dataclass(frozen=True)
class Obstacle:
    """A circle or sphere, a box along the axes, or a convex polygon in the plane.

    All bodies, actuators and links of the machine keep `clearance` away from it. Give it centre and radius,
    low and high corner, or corners.

    Raises:
        TrajectoryError: A value is not as described.
    """

    name: str = ""
    """Its name in messages."""
    centre: tuple[float, ...] | None = None
    """Centre of a circle, in space of a sphere, m."""
    radius: float | None = None
    """Its radius, m."""
    low: tuple[float, ...] | None = None
    """Corner of a box with the smallest coordinates, m."""
    high: tuple[float, ...] | None = None
    """Corner of a box with the largest coordinates, m."""
    corners: tuple[tuple[float, ...], ...] | None = None
    """Corners of a convex polygon in the plane, in order, m."""
    clearance: float = 0.2
    """Smallest distance of the machine from it, m."""

    def __post_init__(self) -> None:
        """Check the form."""
        fields = {"centre": self.centre, "radius": self.radius, "low": self.low, "high": self.high}
        field_names = {
            name for name, value in (fields | {"corners": self.corners}).items() if value is not None
        }
        if field_names not in ({"centre", "radius"}, {"low", "high"}, {"corners"}):
            has = " and ".join(sorted(field_names)) or "no form"
            raise TrajectoryError(f"{self.label} has {has}; it must have {_FORM_NAMES}.")
        for name, value in (("radius", self.radius), ("clearance", self.clearance)):
            if value is not None and (not is_number(value) or value < 0.0):
                raise TrajectoryError(f"{name} of {self.label} is {value!r}; it must be 0 m or more.")
        if self.corners is not None and not _is_convex(self.corners):
            raise TrajectoryError(
                f"the corners of {self.label} must be three or more positions of a convex polygon, in order; "
                "divide another one into convex ones."
            )
        if (
            self.low is not None
            and self.high is not None
            and not all(map(is_position, (self.low, self.high)))
        ):
            raise TrajectoryError(f"low and high of {self.label} must be positions, such as [2.0, -0.5].")
        if self.centre is not None and not is_position(self.centre):
            raise TrajectoryError(f"centre of {self.label} is {self.centre!r}; it must be a position.")

    @property
    def label(self) -> str:
        """What messages call it."""
        return f"the obstacle '{self.name}'" if self.name else "an obstacle"

    @cached_property
    def hull(self) -> np.ndarray:
        """Corners in m, one row each, whose hull, grown by `growth`, is the obstacle."""
        if self.centre is not None:
            return np.array([self.centre], dtype=float)
        if self.corners is not None:
            return np.array(self.corners, dtype=float)
        assert self.low is not None and self.high is not None
        ends = [sorted(pair) for pair in zip(self.low, self.high, strict=True)]
        if len(ends) == 2:
            (x_low, x_high), (y_low, y_high) = ends
            return np.array([[x_low, y_low], [x_high, y_low], [x_high, y_high], [x_low, y_high]])
        return np.array(list(product(*ends)))

    @property
    def growth(self) -> float:
        """Distance of its surface from the hull, m."""
        return self.radius or 0.0

    @property
    def dimensions(self) -> int:
        """Number of coordinates."""
        return self.hull.shape[1]

    def distances(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distances of the segment ab in each row from it, 0 inside, and the nearest points."""
        corners = self.hull
        if len(corners) == 1:
            distances, nearest_points = point_distances(np.broadcast_to(corners[0], a.shape), a, b)
        elif self.dimensions == 3:
            distances, nearest_points = _measure_from_box(a, b, corners.min(axis=0), corners.max(axis=0))
        else:
            distances, nearest_points = _measure_from_polygon(a, b, corners)
        return np.maximum(distances - self.growth, 0.0), nearest_points

    def approaches(
        self, machine: MachineModel, times: np.ndarray, points: Points
    ) -> list[tuple[Axis, Approach]]:
        """Return the smallest distance of each line of the machine from it."""
        return [
            (line, nearest(self.distances(points[line.start], points[line.end]), line.part, times))
            for line in all_lines(machine)
        ]

    def approach(self, machine: MachineModel, times: np.ndarray, points: Points) -> Approach:
        """Return the smallest distance of the machine from it."""
        approaches = [approach for _, approach in self.approaches(machine, times, points)]
        return min(approaches, key=lambda approach: approach.distance)

    def find_separating_directions(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Return for each row a direction of length 1 from the obstacle to the segment ab.

        Of many directions it is the one along which they are farthest apart, or overlap least.
        """
        directions = _spread_directions(self.dimensions)
        # along any direction the nearer end of a segment is its nearest point
        ends = np.minimum(a @ directions.T, b @ directions.T)
        return directions[np.argmax(ends - (self.hull @ directions.T).max(axis=0), axis=1)]


@dataclass(frozen=True)
class Separation:
    """A line of the machine that an obstacle limits, as a constraint at each collocation point.

    A direction of length 1 is unknown at each point. Along it, both ends of the line are farther than all
    corners of the obstacle. For convex bodies such a direction exists just if they are apart.
    """

    line: Axis
    obstacle: int

    def function(self, obstacle: Obstacle) -> casadi.Function:
        """Return a function of both ends and the direction to distances in m, and to its squared length."""
        n = obstacle.dimensions
        a, b, direction = (casadi.SX.sym(name, n) for name in "abd")
        distances = [
            casadi.dot(direction, end - casadi.DM(corner)) - obstacle.growth
            for end in (a, b)
            for corner in obstacle.hull
        ]
        return casadi.Function(
            "apart", [a, b, direction], [casadi.vertcat(*distances), casadi.sumsqr(direction)]
        )


def _is_convex(corners: Sequence[object]) -> bool:
    if len(corners) < 3 or not all(is_position(x) and len(x) == 2 for x in corners):  # type: ignore[arg-type]
        return False
    points = np.array(corners, dtype=float)
    edges = np.roll(points, -1, axis=0) - points
    next_edges = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * next_edges[:, 1] - edges[:, 1] * next_edges[:, 0]
    angles = np.arctan2(turns, np.sum(edges * next_edges, axis=1))
    # a star turns to one side, too, but more than once around
    is_simple = abs(abs(float(angles.sum())) - 2.0 * np.pi) < 1e-6
    return is_simple and bool(np.all(turns > 0.0) or np.all(turns < 0.0))


def _measure_from_polygon(a: np.ndarray, b: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    edges = [*pairwise(corners), (corners[-1], corners[0])]
    measured = [segment_distances(a, b, *(np.broadcast_to(x, a.shape) for x in edge)) for edge in edges]
    distances = np.array([x for x, _ in measured])
    nearest_edge, rows = np.argmin(distances, axis=0), np.arange(len(a))
    sides = [(d - c)[0] * (a - c)[:, 1] - (d - c)[1] * (a - c)[:, 0] for c, d in edges]
    is_inside = np.all(np.array(sides) > 0.0, axis=0) | np.all(np.array(sides) < 0.0, axis=0)
    nearest_points = np.array([x for _, x in measured])[nearest_edge, rows]
    return np.where(is_inside, 0.0, distances[nearest_edge, rows]), np.where(
        is_inside[:, None], a, nearest_points
    )


def _measure_from_box(
    a: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Search along the segments, as the distance of a point from a convex body is convex."""

    def distance(part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = a + part[:, None] * (b - a)
        return np.linalg.norm(points - np.clip(points, low, high), axis=1), points

    first, last = np.zeros(len(a)), np.ones(len(a))
    for _ in range(_SEARCH):
        lower, upper = first + (last - first) / 3.0, last - (last - first) / 3.0
        is_below = distance(lower)[0] <= distance(upper)[0]
        first, last = np.where(is_below, first, lower), np.where(is_below, upper, last)
    return distance(0.5 * (first + last))


def _spread_directions(dimensions: int) -> np.ndarray:
    """Return directions of length 1 that are spread evenly."""
    if dimensions == 2:
        angles = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)
        return np.column_stack([np.cos(angles), np.sin(angles)])
    z = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS  # a spiral of Fibonacci's
    angles = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_DIRECTIONS)
    radius = np.sqrt(1.0 - z * z)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), z])
