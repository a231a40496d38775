"""Parts of a machine as polygons of a picture, in their colours."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Vector
from ...base.colors import BLUE, GREEN, GREY, ORANGE, PURPLE
from .parts import Part
from .views import View

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
        """Draw them."""
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


def paint(
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
    """Return the corners of the convex line around points in a view, one row each, anticlockwise.

    SciPy has this, too, but the pictures of a run do without it (Andrew's monotone chain).
    """
    in_order = sorted(set(map(tuple, points.tolist())))

    def follow(points: Sequence[Sequence[float]]) -> list[Sequence[float]]:
        line = list[Sequence[float]]()
        for x, y in points:
            while len(line) > 1 and not _turns_left(line[-2], line[-1], (x, y)):
                line.pop()
            line.append((x, y))
        return line[:-1]

    return np.array([*follow(in_order), *follow(in_order[::-1])])


def _turns_left(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> bool:
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
