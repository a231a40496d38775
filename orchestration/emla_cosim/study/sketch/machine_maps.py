"""Pictures of a machine itself: its drawing with its workspace, holding forces, and levers."""

from collections.abc import Callable, Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ...views.plots.style import BLUE, make_figure, tidy_axes
from ..machines.force_map import ForceLimits, Map, find_maps
from .scene import DARK, Scene, actuator_colors
from .workspace import OBLIQUE, PLANE, THREE_SIDES, Workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from machine_fmu.model import MachineModel

_MAX_COLUMNS = 3

_LEVELS = 12
"""Number of levels of a map, about."""

_LIMIT, _BOTH_SIGNS = "black", "RdBu_r"
"""Colour of limits, and colours of values of both signs, with zero in the middle."""

_TITLE_LETTERS = 55
"""Letters of a line of the title for each column of panels."""


def draw_machine_pictures(
    machine: "MachineModel", workspace: Workspace, limits: Mapping[str, ForceLimits]
) -> "dict[str, Figure]":
    """Return the pictures of a machine by name.

    Args:
        machine: The machine.
        workspace: Its workspace.
        limits: Limits of the actuators' forces by name; those of others are unknown.
    """
    maps = find_maps(machine, workspace.strokes)
    levers = [m.levers for m in maps]
    return {
        "machine": _draw_machine(machine, workspace),
        "forces": _draw_forces(machine, maps, limits),
        "levers": _draw_maps(machine, maps, levers, "motion of the tip per stroke / (m/m)", "Greens"),
    }


def _draw_machine(machine: "MachineModel", workspace: Workspace) -> "Figure":
    from matplotlib.patches import Patch

    views = [PLANE] if machine.dimensions == 2 else [OBLIQUE, *THREE_SIDES]
    figure = make_figure(8.0, 6.4 if len(views) == 1 else 7.4, layout="constrained")
    side = 1 if len(views) == 1 else 2
    strokes, payload = np.array([machine.start]), np.array([machine.payload])
    for i, view in enumerate(views):
        scene, axes = Scene(machine, view, workspace), figure.add_subplot(side, side, i + 1)
        posture = scene.parts.postures(strokes, payload)[0]
        scene.draw_surroundings(axes, [posture])
        scene.build_polygons(posture).add_to(axes)
        if view.name:
            axes.set_title(view.name, fontsize=9)
        if view is PLANE:
            for body in machine.machine.bodies:
                points = view.flatten(posture[body].points)
                # a body inside another one is visible at its end
                x, y = points[-1] if posture[body].look == "inner" else points.mean(axis=0)
                box = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1.0}
                axes.text(x, y, body, fontsize=7, color=DARK, ha="center", va="center", zorder=8, bbox=box)
    colors = actuator_colors(machine.names)
    entries = [Patch(color=color) for color in colors.values()]
    reach = Patch(facecolor=BLUE, alpha=0.2)
    figure.legend(
        [*entries, reach],
        [*colors, "reach of the tip"],
        loc="outside upper center",
        ncols=4,
        fontsize=8,
        frameon=False,
    )
    if workspace.unreachable > 0.0:
        note = f"{100.0 * workspace.unreachable:.2g} % of all strokes do not close and are left out"
        figure.supxlabel(note, fontsize=8, color=DARK)
    return figure


def _draw_forces(machine: "MachineModel", maps: Sequence[Map], limits: Mapping[str, ForceLimits]) -> "Figure":
    def draw(axes: "Axes", i: int) -> None:
        force_limits, values = limits.get(machine.names[i], ForceLimits()), 1e-3 * maps[i].forces
        for force, dashes in ((force_limits.continuous, "--"), (force_limits.largest, "-")):
            if force is None:
                continue
            ends = [-1e-3 * force, 1e-3 * force]
            if maps[i].forces.ndim == 1:
                # a limit far away would flatten the curve
                if np.nanmax(np.abs(values)) > 0.5e-3 * force:
                    axes.axhline(
                        ends[int(np.nanmean(values) > 0.0)], color=_LIMIT, linewidth=1.4, linestyle=dashes
                    )
            else:
                axes.contour(
                    *maps[i].strokes, values.T, levels=ends, colors=_LIMIT, linewidths=1.8, linestyles=dashes
                )

    title = "holding force / kN; black: what the actuator holds continuously (dashed) and at the most"
    has_limits = any(x.continuous or x.largest for x in limits.values())
    values = [1e-3 * m.forces for m in maps]
    return _draw_maps(machine, maps, values, title if has_limits else "holding force / kN", _BOTH_SIGNS, draw)


def _draw_maps(
    machine: "MachineModel",
    maps: Sequence[Map],
    values: Sequence[Vector],
    title: str,
    colors: str,
    add: "Callable[[Axes, int], None]" = lambda axes, i: None,
) -> "Figure":
    """Return a figure with a panel for each actuator; `add` adds more to the panel of an actuator."""
    columns = min(len(maps), _MAX_COLUMNS)
    rows = -(-len(maps) // columns)
    figure = make_figure(1.0 + 3.6 * columns, 0.9 + 3.0 * rows, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[len(maps) :]:
        axes.set_visible(False)
    for i, (axes, map_) in enumerate(zip(grid.flat, maps, strict=False)):
        axes.set_title(machine.names[i], fontsize=10)
        axes.set_xlabel(f"stroke of {machine.names[map_.axes[0]]} / m", fontsize=8)
        start = [machine.start[k] for k in map_.axes]
        if len(map_.axes) == 1:
            axes.plot(map_.strokes[0], values[i], color=BLUE, linewidth=1.4)
            axes.axvline(start[0], color=DARK, linewidth=0.8, linestyle=":")
            tidy_axes(axes)
        else:
            axes.set_ylabel(f"stroke of {machine.names[map_.axes[1]]} / m", fontsize=8)
            _draw_contours(figure, axes, map_, values[i], colors)
            axes.plot(*start, "o", color=DARK, markersize=4)
        axes.tick_params(labelsize=8)
        add(axes, i)
    remark = "; other strokes as at the start, which the dot marks" if len(maps) > 2 else "; dot: start"
    text = title + (remark if len(maps) > 1 else "; dotted: start")
    figure.suptitle(fill(text, _TITLE_LETTERS * columns), fontsize=9)
    return figure


def _draw_contours(figure: "Figure", axes: "Axes", map_: Map, values: Vector, colors: str) -> None:
    """Draw values over two strokes as colours with lines; zero is the middle of colours for both signs."""
    from matplotlib.ticker import MaxNLocator

    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if not high - low > 1e-6 * max(abs(low), abs(high), 1e-6):  # contours need a range
        low, high = low - 0.5 * max(abs(low), 1e-3), high + 0.5 * max(abs(high), 1e-3)
    levels = MaxNLocator(_LEVELS).tick_values(low, high)
    size = max(abs(low), abs(high))
    vmin, vmax = (-size, size) if colors == _BOTH_SIGNS else (None, None)
    image = axes.contourf(
        *map_.strokes, values.T, levels=levels, cmap=colors, alpha=0.7, vmin=vmin, vmax=vmax
    )
    lines = axes.contour(*map_.strokes, values.T, levels=levels, colors=DARK, linewidths=0.4)
    axes.clabel(lines, fontsize=6, fmt="%g")
    bar = figure.colorbar(image, ax=axes)
    bar.ax.tick_params(labelsize=7)
