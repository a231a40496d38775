"""The machine at instants along its path, and in motion, with its forces and errors."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ...run.result import Result
from ...views.plots.pictures import Drawing
from ...views.plots.style import BLUE, RED
from .movement import Movement, list_recorded_signals, read_movement
from .parts import Posture
from .scene import DARK, EDGE, Scene, machine_and_panels, round_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...views.plots.style import tidy_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D
from collections.abc import Collection

from ...base.arrays import Indices
from ...base.errors import RunError
from ...views.animation import Animation, Film, Pixels
from .movement import find_animated_signals

_PARTS = 300
"""Number of parts into which longer curves are divided; each is drawn by its lowest and highest value."""

_TRANSIENT = 0.3
"""Time in s of the initial transient, whose forces and errors would dwarf all others."""

_LEGEND_COLUMNS = 3
"""Most columns of the legend."""


@dataclass(frozen=True)
class Curves:
    """Values of the actuators over `time` in s, with a column for each; `colors` are theirs by name."""

    label: str
    time: Vector
    values: Vector
    colors: Mapping[str, str]

    def draw(self, axes: "Axes", **look: Any) -> "list[Line2D]":
        """Draw a line for each actuator, in their order; small values are drawn above large ones."""
        spans = np.ptp(self.values, axis=0)
        return [
            axes.plot(time, values, color=color, linewidth=1.1, zorder=zorder, **look)[0]
            for color, time, values, zorder in zip(
                self.colors.values(), self.time.T, self.values.T, 2.0 + 1.0 / (1.0 + spans), strict=True
            )
        ]


def build_curves(movement: Movement, colors: Mapping[str, str]) -> list[Curves]:
    """Return the curves of a movement after the initial transient; `colors` are those of the actuators."""
    is_late = movement.time >= movement.time[0] + _TRANSIENT
    part = is_late if is_late.sum() > 1 else np.full_like(is_late, True)
    curves = []
    for label, scale, values in (
        ("load force / kN", 1e-3, movement.forces),
        ("position error / µm", 1e6, movement.errors),
    ):
        if values is not None:
            curves.append(Curves(label, *_thin_rows(movement.time[part], scale * values[part]), colors))
    return curves


def label_panels(axes: "list[Axes]", curves: list[Curves]) -> None:
    """Label the panels, which are one above the other, with a legend above the first."""
    for panel, curve in zip(axes, curves, strict=True):
        panel.set_ylabel(curve.label, fontsize=9)
        tidy_axes(panel)
    if not axes:
        return
    axes[-1].set_xlabel("time / s", fontsize=9)
    names = list(curves[0].colors)
    lines = axes[0].lines[: len(names)]
    axes[0].legend(
        lines,
        names,
        ncols=_LEGEND_COLUMNS,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        fontsize=9,
        frameon=False,
    )


def _thin_rows(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Return two rows for each part, where each column is lowest and highest, and the last row."""
    if len(time) <= 2 * _PARTS:
        return np.repeat(time[:, None], values.shape[1], axis=1), values
    # so that curves reach the end of the time
    rows = [np.full((1, values.shape[1]), len(time) - 1)]
    for part in reversed(np.array_split(np.arange(len(time)), _PARTS)):
        ends = part[0] + np.stack([values[part].argmin(axis=0), values[part].argmax(axis=0)])
        rows.insert(0, np.sort(ends, axis=0))
    row_numbers = np.concatenate(rows)
    return time[row_numbers], np.take_along_axis(values, row_numbers, axis=0)


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
    scene.build_polygons(last).add_to(axes)
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
    lines = [*scene.reach, *(line for posture in postures for line in scene.build_polygons(posture).lines)]
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


PERIOD, _MAX_FRAMES = 0.08, 150
"""Duration of a frame in s, and largest number of frames: longer runs are shown faster."""

_ROWS = 20_000
"""Largest number of rows that are read; of longer results, only every n-th row."""


class MachineAnimation(Animation):
    """The machine on the left; load forces and position errors on the right, as time passes."""

    takes = "a machine, machine.manipulator or machine.plant, with actual and reference strokes"

    def signals(self, names: Collection[str], roles: Mapping[str, str]) -> Sequence[str] | None:
        """Return the signals of actual and reference strokes, and of forces."""
        return find_animated_signals(names, roles)

    def film(self, result: Result) -> Film:
        """Return the film of a run; raise RunError if its machine is unknown."""
        movement = read_movement(result, result.read(["time", *list_recorded_signals(result)], _ROWS))
        if movement is None:
            raise RunError("there is nothing to animate: no posture of the machine can be drawn.")
        return MachineFilm(movement)


class MachineFilm(Film):
    """A background that is drawn once, and a machine, a path and curves that move.

    Attributes:
        polygons: The polygons of the machine in the last frame.
    """

    period = PERIOD

    def __init__(self, movement: Movement) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        self._movement, self._scene = movement, Scene(movement.machine)
        self._rows = _choose_rows(movement)
        self._postures = self._scene.parts.postures(
            *(values[self._rows] for values in (movement.strokes, movement.payload, movement.passive))
        )
        speed = (movement.time[-1] - movement.time[0]) / (self.period * len(self._rows))
        self._speed_label = f", {speed:.2g} x real time" if speed > 1.05 else ""
        curves = build_curves(movement, self._scene.colors)
        figure, axes, panels = machine_and_panels(len(curves), (8.0, 5.0), 100)
        self._canvas = FigureCanvasAgg(figure)
        self._lines_by_curve = [
            (curve, curve.draw(panel)) for panel, curve in zip(panels, curves, strict=True)
        ]
        label_panels(panels, curves)
        for panel, curve in zip(panels, curves, strict=True):
            curve.draw(panel, alpha=0.2)
        self._scene.draw_surroundings(axes, self._postures)
        self._scene.draw_reference(axes, movement)
        self._path_line = self._scene.draw_path(axes, movement.path)
        self.polygons = self._scene.build_polygons(self._postures[0])
        self._machine = self.polygons.add_to(axes)
        self._clock = axes.text(0.0, 1.0, "", transform=axes.transAxes, va="bottom")
        lines = [line for _, curve_lines in self._lines_by_curve for line in curve_lines]
        self._moving_artists = sorted(
            [self._machine, self._path_line, self._clock, *lines], key=lambda artist: artist.zorder
        )
        for artist in self._moving_artists:
            artist.set_animated(True)
        # once, as all this does not move
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(figure.bbox)

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> Pixels:
        """Draw the moving parts in this frame."""
        movement, row = self._movement, int(self._rows[index])
        self.polygons = self._scene.build_polygons(self._postures[index])
        self.polygons.update(self._machine)
        self._path_line.set_data(*self._scene.view.flatten(movement.path[: row + 1]).T)
        self._clock.set_text(f"{movement.time[row]:.1f} s{self._speed_label}")
        for curve, lines in self._lines_by_curve:
            for line, time, values in zip(lines, curve.time.T, curve.values.T, strict=True):
                count = int(np.searchsorted(time, movement.time[row], side="right"))
                line.set_data(time[:count], values[:count])
        self._canvas.restore_region(self._background)
        for artist in self._moving_artists:
            artist.draw(self._canvas.get_renderer())
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


def _choose_rows(movement: Movement) -> Indices:
    """Return the rows of the frames, at equal distances in time."""
    first, last = movement.time[0], movement.time[-1]
    count = int(np.clip((last - first) / PERIOD, 2, _MAX_FRAMES))
    return np.searchsorted(movement.time, np.linspace(first, last, count))
