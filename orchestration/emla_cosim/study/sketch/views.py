"""Views of a machine: the plane itself, and projections of space."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Vector


@dataclass(frozen=True)
class View:
    """A parallel projection.

    Attributes:
        name: What it is called.
        axes: Directions to the right and up in the picture, one row each, of length 1.
        toward: Direction to the viewer; None in the plane.
        labels: Labels of the axes; empty if they are not axes of the machine.
    """

    name: str
    axes: tuple[Sequence[float], Sequence[float]]
    toward: Sequence[float] | None
    labels: tuple[str, str] | tuple[()] = ()

    def flatten(self, points: Vector) -> Vector:
        """Return where points in m appear, one row each."""
        return points @ np.array(self.axes).T

    def nearness(self, points: Vector) -> Vector:
        """Return how near points are to the viewer, in m; 0 in the plane."""
        return np.zeros(len(points)) if self.toward is None else points @ np.array(self.toward)


def _oblique(azimuth: float, elevation: float) -> View:
    sin_a, cos_a, sin_e, cos_e = (
        f(math.radians(x)) for x in (azimuth, elevation) for f in (math.sin, math.cos)
    )
    up = (-sin_e * cos_a, -sin_e * sin_a, cos_e)
    return View("", ((-sin_a, cos_a, 0.0), up), (cos_e * cos_a, cos_e * sin_a, sin_e))


PLANE = View("", ((1.0, 0.0), (0.0, 1.0)), None, ("x / m", "y / m"))
OBLIQUE = _oblique(-62.0, 20.0)
THREE_SIDES = (
    View("front", ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), (0.0, -1.0, 0.0), ("x / m", "z / m")),
    View("side", ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (1.0, 0.0, 0.0), ("y / m", "z / m")),
    View("top", ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), (0.0, 0.0, 1.0), ("x / m", "y / m")),
)


def main_view(dimensions: int) -> View:
    """Return the view of pictures and animations."""
    return PLANE if dimensions == 2 else OBLIQUE
