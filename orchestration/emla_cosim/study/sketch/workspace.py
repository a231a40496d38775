"""Views of a machine, and the reachable positions of its tip as areas in them."""

import math
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector

if TYPE_CHECKING:
    from machine_fmu.model import MachineModel
from collections.abc import Sequence


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


def _make_oblique_view(azimuth: float, elevation: float) -> View:
    """Return the view from a direction, by angles in degrees."""
    sin_a, cos_a, sin_e, cos_e = (
        f(math.radians(x)) for x in (azimuth, elevation) for f in (math.sin, math.cos)
    )
    up = (-sin_e * cos_a, -sin_e * sin_a, cos_e)
    return View("", ((-sin_a, cos_a, 0.0), up), (cos_e * cos_a, cos_e * sin_a, sin_e))


PLANE = View("", ((1.0, 0.0), (0.0, 1.0)), None, ("x / m", "y / m"))
OBLIQUE = _make_oblique_view(-62.0, 20.0)
THREE_SIDES = (
    View("front", ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), (0.0, -1.0, 0.0), ("x / m", "z / m")),
    View("side", ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), (1.0, 0.0, 0.0), ("y / m", "z / m")),
    View("top", ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), (0.0, 0.0, 1.0), ("x / m", "y / m")),
)


def main_view(dimensions: int) -> View:
    """Return the view of pictures and animations."""
    return PLANE if dimensions == 2 else OBLIQUE


_COUNTS = {1: 401, 2: 121, 3: 33, 4: 12, 5: 7}
"""Strokes of each actuator by number of actuators; with more of them, as few as `_MIN_COUNT`."""
_MIN_COUNT = 4

_PIXELS, _OVERSAMPLING = 700, 4
"""Size of the picture from which outlines are read, in pixels, and how much finer it is drawn."""


@dataclass(frozen=True)
class Workspace:
    """Positions of the tip over the box of strokes.

    Attributes:
        strokes: Strokes in m on a grid: an axis for each actuator, and one for the strokes.
        tips: Positions in m on this grid, NaN where the machine does not close.
    """

    strokes: Vector
    tips: Vector

    @property
    def unreachable(self) -> float:
        """The share of the poses that do not close."""
        return float(np.isnan(self.tips[..., 0]).mean())

    def areas(self, view: View) -> list[Vector]:
        """Return the closed outlines of the area in a view; those of holes go the other way round.

        All faces of the grid's cells are drawn, and the outline of the picture is read.
        """
        from contourpy import contour_generator
        from PIL import Image, ImageDraw

        flat = view.flatten(self.tips.reshape(-1, self.tips.shape[-1])).reshape(*self.tips.shape[:-1], 2)
        low, high = (f(flat.reshape(-1, 2), axis=0) for f in (np.nanmin, np.nanmax))
        size = float((high - low).max()) / _PIXELS
        if size == 0.0 or not np.isfinite(size):
            return []
        corner = low - 2.0 * size
        width, height = (math.ceil(x / size) + 4 for x in high - low)
        image = Image.new("L", (_OVERSAMPLING * width, _OVERSAMPLING * height))
        pen = ImageDraw.Draw(image)
        for line in _list_faces((flat - corner) * (_OVERSAMPLING / size)):
            pen.polygon(line, fill=255, outline=255)
        # grey pixels at the edge give outlines between pixels
        values = np.asarray(image.reduce(_OVERSAMPLING), dtype=float)
        lines = contour_generator(z=values).lines(127.0)
        return [corner + size * (np.asarray(line) + 0.5) for line in lines if len(line) > 8]

    def line(self, view: View) -> Vector:
        """Return where the tip of a machine with one actuator goes, in a view."""
        return view.flatten(self.tips)


def find_workspace(machine: "MachineModel") -> Workspace:
    """Return the workspace of a machine."""
    axes = [
        np.linspace(low, high, _COUNTS.get(len(machine.names), _MIN_COUNT))
        for low, high in zip(machine.q_LB, machine.q_UB, strict=True)
    ]
    strokes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    rows = strokes.reshape(-1, len(axes))
    tips = machine.tip(rows)
    return Workspace(strokes, tips.reshape(*strokes.shape[:-1], -1))


def _list_faces(points: Vector) -> list[list[float]]:
    """Return the corners of all faces of the cells of a grid of points, as x, y, x, y and so on."""
    faces = list[list[float]]()
    for pair in combinations(range(points.ndim - 1), 2):
        grid = np.moveaxis(points, pair, (-3, -2))
        sides = (
            (np.s_[:-1], np.s_[:-1]),
            (np.s_[1:], np.s_[:-1]),
            (np.s_[1:], np.s_[1:]),
            (np.s_[:-1], np.s_[1:]),
        )
        corners = np.concatenate([grid[..., i, j, :] for i, j in sides], axis=-1).reshape(-1, 8)
        faces += corners[np.isfinite(corners).all(axis=1)].tolist()
    return faces
