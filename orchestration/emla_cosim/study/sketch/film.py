"""The machine in motion, with its forces and errors."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ...base.arrays import Indices
from ...base.errors import RunError
from ...run.result import Result
from ...views.animation import Animation, Film, Pixels
from .curves import build_curves, label_panels
from .movement import Movement, animated_signals, list_recorded_signals, read_movement
from .scene import Scene, machine_and_panels

PERIOD, _MAX_FRAMES = 0.08, 150
"""Duration of a frame in s, and largest number of frames: longer runs are shown faster."""

_ROWS = 20_000
"""Largest number of rows that are read; of longer results, only every n-th row."""


class MachineAnimation(Animation):
    """The machine on the left; load forces and position errors on the right, as time passes."""

    takes = "a machine, machine.manipulator or machine.plant, with actual and reference strokes"

    def signals(self, names: Collection[str], roles: Mapping[str, str]) -> Sequence[str] | None:
        """Return the signals of actual and reference strokes, and of forces."""
        return animated_signals(names, roles)

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
        self.polygons = self._scene.paint(self._postures[0])
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
        self.polygons = self._scene.paint(self._postures[index])
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
