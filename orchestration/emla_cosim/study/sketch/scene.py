"""The manipulator on axes, with its colours, its workspace, and the ground."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hdrm_fmu import HdrmParameters

from ...views.plots.style import BLUE, GREEN, GREY, ORANGE, RED
from .movement import Movement
from .shapes import build_shapes
from .workspace import outline_workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Polygon

JOINT_COLORS = {"lift": BLUE, "tilt": ORANGE, "telescope": GREEN}

DARK, EDGE, _STEEL, _LIGHT = "#3a424d", "#8b939e", "#dde2e8", "#f3f5f8"

_MARGIN = 0.15
"""Free space around the workspace, m."""


def machine_and_panels(rows: int, size: tuple[float, float], dpi: int) -> "tuple[Figure, Axes, list[Axes]]":
    """Return a figure of this size in inches, with axes for the machine and for panels on its right."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=dpi, layout="constrained")
    grid = figure.add_gridspec(max(rows, 1), 2 if rows else 1, width_ratios=(1.0, 1.1) if rows else None)
    return figure, figure.add_subplot(grid[:, 0]), [figure.add_subplot(grid[row, 1]) for row in range(rows)]


def draw_scene(axes: "Axes", p: HdrmParameters) -> None:
    """Draw workspace and ground on axes with equal scales."""
    reached = outline_workspace(p)
    axes.fill(*reached.T, color=BLUE, alpha=0.06, linewidth=0)
    axes.plot(*reached.T, color=BLUE, alpha=0.45, linewidth=0.8)
    base = build_shapes(p, p.q_LB)["base"]
    foot, left, right = base[:, 1].min(), base[:, 0].min() - 0.15, base[:, 0].max() + 0.15
    axes.plot([left, right], [foot, foot], color=EDGE, linewidth=1.2)
    axes.fill_between(
        [left, right], foot - 0.1, foot, facecolor="none", edgecolor=EDGE, hatch="////", linewidth=0
    )
    around = np.concatenate([reached, base])
    (x_low, y_low), (x_high, y_high) = around.min(axis=0) - _MARGIN, around.max(axis=0) + _MARGIN
    axes.set(xlim=(x_low - 0.1, x_high), ylim=(y_low, y_high), aspect="equal")
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")


def draw_machine(axes: "Axes", p: HdrmParameters, q: Sequence[float], payload: float) -> dict[str, "Polygon"]:
    """Draw the machine in a posture, and return its parts by name, the rear ones first."""
    from matplotlib.patches import Polygon

    found = {}
    for name, line in build_shapes(p, q, payload).items():
        part = Polygon(line, closed=True, joinstyle="round", **_look(name))
        found[name] = axes.add_patch(part)
    return found


def draw_ghost(axes: "Axes", p: HdrmParameters, q: Sequence[float], payload: float) -> None:
    """Draw the moving parts of the machine faintly, as they were at another time."""
    for name, line in build_shapes(p, q, payload).items():
        if name.endswith(("boom", "tube", "housing", "payload")):
            axes.fill(*line.T, alpha=0.3, **_look(name))


def draw_wanted(axes: "Axes", found: Movement) -> None:
    """Draw the reference path of the tip."""
    if found.wanted_path is not None:
        axes.plot(*found.wanted_path.T, color=DARK, linewidth=1.0, linestyle=(0, (4, 3)), zorder=6)


def draw_way(axes: "Axes", found: Movement) -> "Line2D":
    """Draw the path of the tip."""
    return axes.plot(*found.path.T, color=RED, linewidth=1.8, zorder=5, solid_capstyle="round")[0]


def _look(name: str) -> Mapping[str, Any]:
    """Return the style of a part of the machine."""
    joint, _, kind = name.partition("_")
    color = JOINT_COLORS.get(joint, GREY)
    looks = {
        "housing": {"facecolor": color, "edgecolor": "none"},
        "tube": {"facecolor": _LIGHT, "edgecolor": color, "linewidth": 1.0},
        "payload": {"facecolor": "#b4bcc7", "edgecolor": DARK, "linewidth": 1.0},
        "base": {"facecolor": "#c6ccd5", "edgecolor": EDGE, "linewidth": 1.0},
        "pin": {"facecolor": "white", "edgecolor": DARK, "linewidth": 0.9},
        "steel": {"facecolor": _STEEL, "edgecolor": EDGE, "linewidth": 1.0},
    }
    if joint in ("A", "B", "O"):
        return looks["pin"]
    return looks.get(kind) or looks.get(name) or looks["steel"]
