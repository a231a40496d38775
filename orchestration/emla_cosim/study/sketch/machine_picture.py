"""The machine at instants along its path, with its workspace and the path of its tip."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ...run.result import Result
from ...views.plots.pictures import Drawing
from ...views.plots.style import BLUE, RED
from .curves import build_curves, label_panels
from .movement import Movement, list_recorded_signals, read_movement
from .painting import DARK, EDGE
from .parts import Posture
from .scene import Scene, machine_and_panels, round_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INSTANTS = 5
"""Number of postures that are drawn, including the first and the last."""

_INSET = (0.46, 0.33)
"""Width and height of the enlarged path as parts of the machine's axes."""

_CORNERS = ((0.04, 0.62), (0.52, 0.62), (0.04, 0.06), (0.52, 0.06))
"""Where it can be, left and bottom; the first corner that is empty is taken."""

_MIN_SIZE = 1e-2
"""Size in m below which a path is not enlarged."""


class MachinePicture(Drawing):
    """The machine in its workspace on the left; the tip's path, forces and errors on the right."""

    def signals(self, result: Result) -> Iterable[str]:
        """Return the signals of actual and reference strokes, forces, and payload."""
        return list_recorded_signals(result)

    def drawn(self, result: Result, data: Mapping[str, Vector]) -> "Figure | None":
        """Draw a run with a machine; None if its strokes were not recorded."""
        movement = read_movement(result, data)
        return None if movement is None else _draw_picture(movement)


def _draw_picture(movement: Movement) -> "Figure":
    scene, rows = Scene(movement.machine), select_instants(movement)
    postures = scene.parts.postures(movement.strokes[rows], movement.payload[rows], movement.passive[rows])
    curves, corner = build_curves(movement, scene.colors), _find_corner(scene, postures)
    figure, machine, panels = machine_and_panels(len(curves) + (corner is None), (9.8, 6.0), 120)
    _draw_postures(machine, movement, scene, postures)
    path = panels.pop() if corner is None else machine.inset_axes((*corner, *_INSET), zorder=6)
    _draw_path(path, movement, scene)
    for panel, curve in zip(panels, curves, strict=True):
        curve.draw(panel)
    label_panels(panels, curves)
    figure.align_ylabels(panels)
    return figure


def select_instants(movement: Movement) -> list[int]:
    """Return the rows at which the machine is drawn, at equal distances along the path of its tip."""
    distances = np.concatenate([[0.0], np.linalg.norm(np.diff(movement.path, axis=0), axis=1).cumsum()])
    return [int(row) for row in np.searchsorted(distances, np.linspace(0.0, distances[-1], INSTANTS))]


def _draw_postures(axes: "Axes", movement: Movement, scene: Scene, postures: list[Posture]) -> None:
    scene.draw_surroundings(axes, postures)
    *earlier, last = postures
    for posture in earlier:
        scene.draw_ghost(axes, posture)
    scene.paint(last).add_to(axes)
    scene.draw_path(axes, movement.path)
    axes.text(0.98, 0.02, "reach of the tip", color=BLUE, fontsize=9, transform=axes.transAxes, ha="right")
    if movement.payload[-1] > 0.0:
        x, y = scene.view.flatten(movement.path[-1])
        right = scene.view.flatten(last["payload"].points)[:, 0].max() + 0.03 * scene.parts.unit
        text = axes.text(
            max(x, right), y, f"{movement.payload[-1]:.4g} kg", color=DARK, fontsize=9, va="center"
        )
        text.set_bbox({"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.5})


def _find_corner(scene: Scene, postures: list[Posture]) -> tuple[float, float] | None:
    """Return the corner of the machine's axes that has room for the enlarged path; None without any."""
    from matplotlib.path import Path
    from matplotlib.transforms import Bbox

    # intersections are tested in the coordinates of the axes
    low, high = scene.limits(postures)
    lines = [*scene.reach, *(line for posture in postures for line in scene.paint(posture).lines)]
    paths = [Path((line - low) / (high - low)) for line in lines]
    for corner in _CORNERS:
        box = Bbox.from_bounds(*corner, *_INSET)
        if not any(path.intersects_bbox(box, filled=True) for path in paths):
            return corner
    return None


def _draw_path(axes: "Axes", movement: Movement, scene: Scene) -> None:
    """Draw the enlarged path of the tip, with times."""
    from matplotlib.ticker import MultipleLocator

    scene.draw_path(axes, movement.path)
    scene.draw_reference(axes, movement)
    rows, path = select_instants(movement), scene.view.flatten(movement.path)
    axes.plot(*path[rows].T, "o", color=RED, markersize=4, zorder=7)
    low, high = path.min(axis=0), path.max(axis=0)
    is_wide = high[0] - low[0] > high[1] - low[1]
    # labels of near points would cover each other
    for row in _select_separate(path, rows, 0.3 if is_wide else 0.12):
        offset = (0.0, 6.0) if is_wide else (6.0, 4.0 if row == rows[-1] else -3.0)
        side = "center" if is_wide else "left"
        axes.annotate(
            f"{movement.time[row]:.3g} s", path[row], offset, textcoords="offset points", fontsize=8, ha=side
        )
    size, (x, y) = max((high - low).max(), _MIN_SIZE), 0.5 * (low + high)
    square = round_length(size / 5.0)
    axes.set_title(f"path of the tip, squares of {square:g} m", fontsize=9, loc="left")
    axes.set_aspect("equal", adjustable="datalim")
    axes.update_datalim([(x - 0.5 * size, y - 0.5 * size), (x + 0.5 * size, y + 0.5 * size)])
    axes.margins(0.15)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(square))
    axes.tick_params(labelbottom=False, labelleft=False, length=0)
    axes.grid(alpha=0.4)
    axes.patch.set_alpha(0.8)
    for spine in axes.spines.values():
        spine.set_color(EDGE)


def _select_separate(path: Vector, rows: Sequence[int], share: float) -> list[int]:
    """Return the rows, the last one first, that are apart by this share of the path's size, for labels."""
    min_distance = share * np.ptp(path, axis=0).max()
    separate = list[int]()
    for row in reversed(rows):
        if all(np.hypot(*(path[row] - path[labelled])) > min_distance for labelled in separate):
            separate.append(row)
    return separate
