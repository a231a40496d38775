"""How far joints are from their references once they are evaluated: maxima, means, excursions."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Mask, Vector

AT_REST = 1e-6
"""A reference that is slower than this, in m/s, is at rest."""

POSITION, SPEED, TORQUE, OBSERVER, FOLLOWING, STANDSTILL = range(6)
"""Rows of `largest`."""


class Tracking:
    """Largest values and means of all joints since each is evaluated, and how often each left its window.

    Nothing that was counted is forgotten, but for `restart`. All arrays have a column for each joint.
    """

    def __init__(self, windows: Vector) -> None:
        """Take the position windows in m, shape (joints,)."""
        self._windows = windows
        joints = len(windows)
        self.largest = np.full((6, joints), np.nan)
        """Largest absolute values since then, in the order of `POSITION` and the others."""
        self._squares, self._durations = np.zeros((2, joints)), np.zeros((2, joints))
        self.excursions = np.zeros((2, joints))
        """How often the position error left its window, and when in s it was largest."""
        self._was_outside = np.zeros(joints)
        self._farthest = np.zeros(joints)
        self.counts = np.zeros((2, joints))
        """Rows, and rows at a limit."""

    def restart(self, joint: int) -> None:
        """Forget what was counted of a joint."""
        self.largest[:, joint] = np.nan
        for counted in (self._squares, self._durations, self.excursions, self.counts):
            counted[:, joint] = 0.0
        self._was_outside[joint] = self._farthest[joint] = 0.0

    def rms(self, joint: int) -> tuple[float, float]:
        """Return the root mean square of the position error in m over time: moving, and at rest."""
        with np.errstate(invalid="ignore", divide="ignore"):
            moving, resting = np.sqrt(self._squares[:, joint] / self._durations[:, joint])
        return float(moving), float(resting)

    def write(
        self, joint: int, time: Vector, steps: Vector, values: Vector, moving: Mask, limited: Mask
    ) -> None:
        """Take the next rows of a joint that is evaluated.

        Args:
            joint: Its number.
            time: Times in s, shape (rows,), as the last three.
            steps: Time in s since the row before.
            values: Absolute position error in m, speed error in m/s, torque in N m and observer's position
                error in m, shape (4, rows).
            moving: Whether the reference moves.
            limited: Whether the controller or the inverter is at a limit.
        """
        error = values[0]
        self.largest[:4, joint] = np.fmax(self.largest[:4, joint], values.max(axis=1))
        squares = error * error * steps
        for place, chosen in enumerate((moving, ~moving)):
            if chosen.any():
                row = FOLLOWING + place
                self.largest[row, joint] = np.fmax(self.largest[row, joint], error[chosen].max())
                self._squares[place, joint] += squares[chosen].sum()
                self._durations[place, joint] += steps[chosen].sum()
        self.counts[:, joint] += [len(time), np.count_nonzero(limited)]
        outside = error > self._windows[joint]
        if outside.any():
            entered = outside & ~np.concatenate([[self._was_outside[joint] > 0.0], outside[:-1]])
            self.excursions[0, joint] += np.count_nonzero(entered)
            if (most := float(error.max())) > self._farthest[joint]:
                self._farthest[joint] = most
                self.excursions[1, joint] = time[error.argmax()]
        self._was_outside[joint] = float(outside[-1])

    def memory(self) -> dict[str, Any]:
        """Return all that changes, as plain data."""
        return {name: getattr(self, name).tolist() for name in _STATE}

    def remember(self, memory: Mapping[str, Any]) -> None:
        """Go on from what `memory` gave; ValueError or KeyError where it is of another run."""
        for name in _STATE:
            getattr(self, name)[...] = np.array(memory[name], dtype=float)


_STATE = ("largest", "_squares", "_durations", "excursions", "_was_outside", "_farthest", "counts")
