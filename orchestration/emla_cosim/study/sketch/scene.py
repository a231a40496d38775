"""A machine on axes: its parts as polygons, workspace, ground, and the path of its tip."""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ...base.colors import BLUE, RED
from .movement import Movement
from .parts import MachineParts, Posture
from .workspace import View, Workspace, find_workspace, main_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from machine_fmu.model import MachineModel
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...base.colors import GREEN, GREY, ORANGE, PURPLE
from .parts import Part

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection

DARK, EDGE, _STEEL, _LIGHT = "#3a424d", "#8b939e", "#dde2e8", "#f3f5f8"

_ACTUATOR_COLORS = (BLUE, ORANGE, GREEN, PURPLE, "#2b9aa0", "#8a6a3f")
"""Without red, which is the path of the tip."""

_MOVING_LOOKS = ("standing payload", "inner", "body", "link", "rod", "housing", "payload")
"""Looks of the parts that a faint picture has."""

_CIRCLE = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)

_LIGHT_FROM = np.array([-0.35, -0.55, 0.76])
"""Direction to the light, of length 1."""


def actuator_colors(names: Sequence[str]) -> dict[str, str]:
    """Return the colours of actuators by name."""
    return {name: _ACTUATOR_COLORS[i % len(_ACTUATOR_COLORS)] for i, name in enumerate(names)}


@dataclass(frozen=True)
class Polygons:
    """Closed lines from the rear to the front, with their styles, one for each line."""

    names: list[str]
    lines: list[Vector]
    faces: list[Any]
    edges: list[Any]
    widths: list[float]

    def add_to(self, axes: "Axes", zorder: float = 3.0) -> "PolyCollection":
        """Draw them, and return the collection that `update` changes."""
        from matplotlib.collections import PolyCollection

        collection = PolyCollection([], closed=True, zorder=zorder)
        collection.set_joinstyle("round")
        self.update(collection)
        axes.add_collection(collection, autolim=False)
        return collection

    def update(self, collection: "PolyCollection") -> None:
        """Replace what is drawn by these."""
        collection.set_verts(self.lines)
        collection.set_facecolor(self.faces)
        collection.set_edgecolor(self.edges)
        collection.set_linewidth(self.widths)


def build_polygons(
    parts: Iterable[Part], view: View, colors: dict[str, str], alpha: float = 1.0, only_moving: bool = False
) -> Polygons:
    """Return the polygons of a machine's parts.

    Args:
        parts: The parts; in the plane from the rear to the front.
        view: The view.
        colors: Colours by actuator.
        alpha: Opacity.
        only_moving: Leave out the base, brackets and pins.
    """
    from matplotlib.colors import to_rgba

    painted = [part for part in parts if not only_moving or part.look in _MOVING_LOOKS]
    if view.toward is not None:
        painted = _sort_by_depth(painted, view)
    polygons = Polygons([], [], [], [], [])
    for part in painted:
        face, edge, width = _get_style(part, colors.get(part.bar, GREY))
        for line, shade in _project_lines(part, view):
            polygons.names.append(part.name)
            polygons.lines.append(line)
            color = np.array(to_rgba(face))
            color[:3] *= shade
            polygons.faces.append((*color[:3], alpha))
            polygons.edges.append((0.0, 0.0, 0.0, 0.0) if edge == "none" else to_rgba(edge, alpha))
            polygons.widths.append(width)
    return polygons


def _sort_by_depth(parts: Sequence[Part], view: View) -> list[Part]:
    """Return the parts with the nearest ones last; housing, rod and pins of an actuator stay together."""
    depths = dict[str, list[float]]()
    for part in parts:
        depths.setdefault(part.bar or part.name, []).append(float(view.nearness(part.points).mean()))
    depth = {name: sum(values) / len(values) for name, values in depths.items()}
    # the base is below everything
    return sorted(parts, key=lambda part: (part.look != "base", depth[part.bar or part.name]))


def _project_lines(part: Part, view: View) -> Iterable[tuple[Vector, float]]:
    """Yield closed lines in a view with how light they are: the faces of a solid, or a silhouette."""
    flat = view.flatten(part.points)
    if not part.faces:
        yield (flat if part.is_line else _find_outline(flat, part.radii)), 1.0
        return
    for corners in part.faces:
        face = part.points[list(corners)]
        normal = np.cross(face[1] - face[0], face[2] - face[1])
        normal /= np.linalg.norm(normal) or 1.0
        if view.nearness(normal[None, :])[0] > 1e-9:
            yield flat[list(corners)], 0.82 + 0.18 * float(normal @ _LIGHT_FROM)


def convex_line(points: Vector) -> Vector:
    """Return the corners of the convex hull of points in a view, one row each, anticlockwise.

    SciPy has this, too, but the pictures of a run do without it (Andrew's monotone chain).
    """
    in_order = sorted(set(map(tuple, points.tolist())))

    def build_half_hull(points: Sequence[Sequence[float]]) -> list[Sequence[float]]:
        """Return one side of the hull of sorted points, without its last corner."""
        line = list[Sequence[float]]()
        for x, y in points:
            while len(line) > 1 and not _is_left_turn(line[-2], line[-1], (x, y)):
                line.pop()
            line.append((x, y))
        return line[:-1]

    return np.array([*build_half_hull(in_order), *build_half_hull(in_order[::-1])])


def _is_left_turn(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) > (b[1] - a[1]) * (c[0] - a[0])


def _find_outline(points: Vector, radii: Vector) -> Vector:
    """Return the convex line around discs."""
    circle = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)])
    circles = (points[:, None, :] + radii[:, None, None] * circle).reshape(-1, 2)
    return circles if len(points) == 1 else convex_line(circles)


def _get_style(part: Part, color: str) -> tuple[str, str, float]:
    """Return colours of face and edge, and the width of the edge."""
    return {
        "housing": (color, "none", 0.0),
        "rod": (_LIGHT, color, 1.0),
        "payload": ("#b4bcc7", DARK, 1.0),
        "standing payload": ("#b4bcc7", DARK, 1.0),
        "base": ("#c6ccd5", EDGE, 1.0),
        "pin": ("white", DARK, 0.9),
    }.get(part.look, (_STEEL, EDGE, 1.0))


_MARGIN = 0.15
"""Free space around everything in units of the machine's drawing."""

_FLOOR_SQUARES = 8
"""Number of squares of the floor along its longer side, about."""


def machine_and_panels(rows: int, size: tuple[float, float], dpi: int) -> "tuple[Figure, Axes, list[Axes]]":
    """Return a figure of this size in inches, with axes for the machine and for panels on its right."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=dpi, layout="constrained")
    grid = figure.add_gridspec(max(rows, 1), 2 if rows else 1, width_ratios=(1.0, 1.1) if rows else None)
    return figure, figure.add_subplot(grid[:, 0]), [figure.add_subplot(grid[row, 1]) for row in range(rows)]


class Scene:
    """A machine with its workspace, in a view.

    Attributes:
        machine: The machine.
        view: The view.
        parts: The parts of its drawing.
        colors: Colours of the actuators by name.
    """

    def __init__(
        self, machine: "MachineModel", view: View | None = None, workspace: Workspace | None = None
    ) -> None:
        self.machine, self.view = machine, view or main_view(machine.dimensions)
        self.parts, self.colors = MachineParts(machine), actuator_colors(machine.names)
        self.workspace = workspace or find_workspace(machine)

    @cached_property
    def reach(self) -> list[Vector]:
        """Lines around the positions that the tip reaches, in the view; a line with one actuator."""
        is_line = len(self.machine.names) == 1
        return [self.workspace.line(self.view)] if is_line else self.workspace.areas(self.view)

    def build_polygons(self, posture: Posture) -> Polygons:
        """Return the polygons of a posture, the rear ones first."""
        return build_polygons(posture.values(), self.view, self.colors)

    def draw_ghost(self, axes: "Axes", posture: Posture) -> None:
        """Draw the moving parts of the machine faintly, as they were at another time."""
        build_polygons(posture.values(), self.view, self.colors, 0.3, only_moving=True).add_to(axes, 2.0)

    def limits(self, postures: list[Posture]) -> tuple[Vector, Vector]:
        """Return the lower left and the upper right corner of a picture with room for the postures."""
        points = np.concatenate(
            [*self.reach, *(line for p in postures for line in self.build_polygons(p).lines)]
        )
        points = np.concatenate([points, self._floor.corners if self._has_floor else self._ground])
        margin = _MARGIN * self.parts.unit
        return np.nanmin(points, axis=0) - margin, np.nanmax(points, axis=0) + margin

    def draw_surroundings(self, axes: "Axes", postures: list[Posture]) -> None:
        """Draw workspace and ground on axes with equal scales that have room for the postures."""
        if self._has_floor:
            self._draw_floor(axes)
        elif self.view.toward is None:
            self._draw_ground(axes)
        self._draw_reach(axes)
        low, high = self.limits(postures)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
        if self.view.labels:
            axes.set_xlabel(self.view.labels[0])
            axes.set_ylabel(self.view.labels[1])
        else:
            axes.set_axis_off()

    def draw_path(self, axes: "Axes", path: Vector) -> "Line2D":
        """Draw the path of the tip, from positions in m."""
        return axes.plot(
            *self.view.flatten(path).T, color=RED, linewidth=1.8, zorder=5, solid_capstyle="round"
        )[0]

    def draw_reference(self, axes: "Axes", movement: Movement) -> None:
        """Draw the reference path of the tip."""
        if movement.reference_path is not None:
            line = self.view.flatten(movement.reference_path)
            axes.plot(*line.T, color=DARK, linewidth=1.0, linestyle=(0, (4, 3)), zorder=6)

    def _draw_reach(self, axes: "Axes") -> None:
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path

        if len(self.machine.names) == 1:
            axes.plot(*self.reach[0].T, color=BLUE, alpha=0.6, linewidth=1.2)
            return
        if self.reach:
            area = Path.make_compound_path(*(Path(line, closed=True) for line in self.reach))
            axes.add_patch(PathPatch(area, facecolor=BLUE, alpha=0.06, linewidth=0))
        zorder = 2.0 if self.view.toward is None else 4.0  # in space it is around the machine
        for line in self.reach:
            axes.plot(*line.T, color=BLUE, alpha=0.45, linewidth=0.8, zorder=zorder)

    @property
    def _has_floor(self) -> bool:
        return self.view.toward is not None and not self.view.labels

    @cached_property
    def _ground(self) -> Vector:
        """Lower left and upper right corner of the rectangle drawn as ground under the base, shape (2, 2)."""
        unit, base = self.parts.unit, np.concatenate(build_polygons([self.parts.base], self.view, {}).lines)
        foot, margin = base[:, 1].min(), 0.15 * unit
        return np.array([[base[:, 0].min() - margin, foot - 0.1 * unit], [base[:, 0].max() + margin, foot]])

    def _draw_ground(self, axes: "Axes") -> None:
        """Draw the surface under the base in the plane."""
        x, (low, foot) = self._ground.T
        axes.plot(x, [foot, foot], color=EDGE, linewidth=1.2)
        axes.fill_between(x, low, foot, facecolor="none", edgecolor=EDGE, hatch="////", linewidth=0)

    @cached_property
    def _floor(self) -> "_Floor":
        base = self.parts.base.points
        return _Floor(self.view, base.min(axis=0), base.max(axis=0))

    def _draw_floor(self, axes: "Axes") -> None:
        """Draw the floor in space as squares, and the directions of the axes."""
        floor = self._floor
        for line in floor.lines:
            axes.plot(*line.T, color=EDGE, alpha=0.35, linewidth=0.6, zorder=1)
        for name, (start, stop, label) in zip("xyz", floor.directions, strict=True):
            arrow = {"arrowstyle": "-|>", "color": DARK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", stop, start, arrowprops=arrow, zorder=2)
            axes.text(label[0], label[1], name, ha="center", va="center", fontsize=8, color=DARK)
        axes.set_title(f"squares of {floor.size:g} m", fontsize=8, color=DARK, y=-0.04)


class _Floor:
    """The floor under a machine in space, in a view.

    Attributes:
        size: Length of its squares in m.
        lines: Their sides.
        directions: For each axis the start and end of an arrow, and the place of its name.
        corners: Points that a picture must have room for.
    """

    def __init__(self, view: View, low: Vector, high: Vector) -> None:
        self.size = round_length(float((high - low)[:2].max()) / _FLOOR_SQUARES)
        start, end = (f(x / self.size) * self.size for f, x in ((np.floor, low), (np.ceil, high)))
        self.lines = list[Vector]()
        for i, j in ((0, 1), (1, 0)):
            for value in np.arange(start[i], end[i] + 0.5 * self.size, self.size):
                line = np.full((2, 3), low[2])
                line[:, i], line[:, j] = value, (start[j], end[j])
                self.lines.append(view.flatten(line))
        corner = np.array([start[0], start[1], low[2]])
        shares = 2.0 * self.size * np.array([0.0, 1.0, 1.3])
        self.directions = [view.flatten(corner + np.outer(shares, axis)) for axis in np.eye(3)]
        self.corners = np.concatenate([*self.lines, *self.directions])


def round_length(length: float) -> float:
    """Return the least of 1, 2 and 5 times a power of ten that is about as long, or longer."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(next(power * n for n in (1, 2, 5, 10) if power * n >= 0.99 * length))
