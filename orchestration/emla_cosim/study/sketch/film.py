"""The manipulator in motion, with its forces and errors."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from ...base.arrays import Indices
from ...base.errors import RunError
from ...run.result import Result
from ...views.animation import Animation, Film, Pixels
from .curves import build_curves, label_panels
from .movement import Movement, animated_signals, read_movement, recorded_signals
from .scene import draw_machine, draw_scene, draw_wanted, draw_way, machine_and_panels
from .shapes import build_shapes

PERIOD, _MOST = 0.08, 150
"""Duration of a frame in s, and largest number of frames: longer runs are shown faster."""

_ROWS = 20_000
"""Largest number of rows that are read; of longer results, only every n-th row."""


class ManipulatorAnimation(Animation):
    """The machine on the left; load forces and position errors on the right, as time passes."""

    takes = "a manipulator, machine.manipulator or machine.plant, with actual and reference strokes"

    def signals(self, names: Collection[str], roles: Mapping[str, str]) -> Sequence[str] | None:
        """Return the signals of actual and reference strokes, and of forces."""
        return animated_signals(names, roles)

    def film(self, result: Result) -> Film:
        """Return the film of a run; raise RunError if its manipulator is not one of ours."""
        found = read_movement(result, result.read(["time", *recorded_signals(result)], _ROWS))
        if found is None:
            raise RunError("there is nothing to animate: no posture of the manipulator can be drawn.")
        return MachineFilm(found)


class MachineFilm(Film):
    """A background that is drawn once, and moving parts; `parts` are those of the machine by name."""

    period = PERIOD

    def __init__(self, found: Movement) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        self._movement, self._rows = found, _rows(found)
        speed = (found.time[-1] - found.time[0]) / (self.period * len(self._rows))
        self._faster = f", {speed:.2g} x real time" if speed > 1.05 else ""
        shown = build_curves(found)
        figure, self._scene, panels = machine_and_panels(len(shown), (8.0, 5.0), 100)
        self._canvas = FigureCanvasAgg(figure)
        self._growing = [(curve, curve.draw(panel)) for panel, curve in zip(panels, shown, strict=True)]
        label_panels(panels, shown)
        for panel, curve in zip(panels, shown, strict=True):
            curve.draw(panel, alpha=0.2)
        draw_scene(self._scene, found.p)
        draw_wanted(self._scene, found)
        self._way = draw_way(self._scene, found)
        self.parts = draw_machine(self._scene, found.p, found.strokes[0], found.payload[0])
        self._clock = self._scene.text(0.0, 1.0, "", transform=self._scene.transAxes, va="bottom")
        lines = [line for _, own in self._growing for line in own]
        moving = [*self.parts.values(), self._way, self._clock, *lines]
        self._moving = sorted(moving, key=lambda artist: artist.zorder)
        for artist in self._moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(figure.bbox)

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> Pixels:
        """Draw the moving parts in this frame."""
        self._move(int(self._rows[index]))
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            artist.axes.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _move(self, row: int) -> None:
        found = self._movement
        for name, line in build_shapes(found.p, found.strokes[row], found.payload[row]).items():
            self.parts[name].set_xy(line)
        self._way.set_data(*found.path[: row + 1].T)
        self._clock.set_text(f"{found.time[row]:.1f} s{self._faster}")
        for curve, lines in self._growing:
            for line, time, values in zip(lines, curve.time.T, curve.values.T, strict=True):
                count = int(np.searchsorted(time, found.time[row], side="right"))
                line.set_data(time[:count], values[:count])


def _rows(found: Movement) -> Indices:
    """Return the rows of the frames, at equal distances in time."""
    first, last = found.time[0], found.time[-1]
    count = int(np.clip((last - first) / PERIOD, 2, _MOST))
    return np.searchsorted(found.time, np.linspace(first, last, count))
