"""Tracking errors of joints while they are evaluated, and their settling within the position window."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..base.arrays import Mask, Vector, count_true_per_row, read_stored_array
from ..recorders.metrics import Metrics
from .criteria import EVALUATED_AFTER, Criteria

AT_REST = 1e-6
"""A reference slower than this, in m/s, is at rest."""

POSITION, SPEED, TORQUE, OBSERVER, FOLLOWING, STANDSTILL = range(6)
"""Rows of `largest`."""


class Tracking:
    """Largest values and means of all joints since each is evaluated, and how often each left its window.

    Values accumulate until `restart`. All arrays have a column for each joint.
    """

    def __init__(self, windows: Vector) -> None:
        """Take the position windows in m, shape (joints,)."""
        self._windows = windows
        joints = len(windows)
        self.largest = np.full((6, joints), np.nan)
        """Largest absolute values since then, in the order of `POSITION` and the others."""
        self._squares, self._durations = np.zeros((2, joints)), np.zeros((2, joints))
        self.excursions = np.zeros((2, joints))
        """How often the position error left its window, and at which time in s it was largest."""
        self._was_outside = np.zeros(joints)
        self._farthest = np.zeros(joints)
        self.counts = np.zeros((2, joints))
        """Number of rows, and of rows at a limit."""

    def restart(self, joint: int) -> None:
        """Discard the figures of a joint."""
        self.largest[:, joint] = np.nan
        for figure in (self._squares, self._durations, self.excursions, self.counts):
            figure[:, joint] = 0.0
        self._was_outside[joint] = self._farthest[joint] = 0.0

    def rms(self, joint: int) -> tuple[float, float]:
        """Return the root mean square of the position error in m over time: moving, and at rest."""
        with np.errstate(invalid="ignore", divide="ignore"):
            moving, resting = np.sqrt(self._squares[:, joint] / self._durations[:, joint])
        return float(moving), float(resting)

    def write(
        self,
        joints: slice,
        time: Vector,
        steps: Vector,
        values: Sequence[Vector],
        is_moving: Mask,
        is_limited: Mask,
    ) -> None:
        """Take the next rows of joints that are evaluated.

        Args:
            joints: Which joints.
            time: Times in s, shape (rows,).
            steps: Time in s since the previous row, shape (rows,).
            values: Absolute position error in m, speed error in m/s, torque in N m and position error of the
                observer in m, each of shape (joints, rows). Values of -inf do not count.
            is_moving: Whether the reference moves, shape (joints, rows).
            is_limited: Whether the controller or the inverter is at a limit, shape (joints, rows).
        """
        error = values[0]
        highest = np.array([value.max(axis=1) for value in values])
        # no row of this block counts
        maxima = np.where(highest == -np.inf, np.nan, highest)
        self.largest[:4, joints] = np.fmax(self.largest[:4, joints], maxima)
        squares = error * error
        for number, selected in enumerate((is_moving, ~is_moving)):
            row = FOLLOWING + number
            if selected.all():  # so in most blocks of rows
                highest_error, terms, durations = highest[0], squares * steps, steps[np.newaxis]
            elif selected.any():
                highest_error = np.where(selected, error, -np.inf).max(axis=1)
                highest_error[highest_error == -np.inf] = np.nan
                terms, durations = np.where(selected, squares, 0.0) * steps, selected * steps
            else:
                continue
            self._squares[number, joints] = _sum_in_order(self._squares[number, joints], terms)
            self._durations[number, joints] = _sum_in_order(self._durations[number, joints], durations)
            self.largest[row, joints] = np.fmax(self.largest[row, joints], highest_error)
        self.counts[0, joints] += len(time)
        self.counts[1, joints] += count_true_per_row(is_limited)
        windows = self._windows[joints]
        # rare once a joint has settled, so that it pays to ask first
        if (highest[0] > windows).any():
            self._count_excursions(joints, time, error, error > windows[:, np.newaxis])
        self._was_outside[joints] = error[:, -1] > windows

    def _count_excursions(self, joints: slice, time: Vector, error: Vector, outside: Mask) -> None:
        """Count how often joints left their windows, and when each was farthest away."""
        was_outside = np.column_stack([self._was_outside[joints] > 0.0, outside[:, :-1]])
        self.excursions[0, joints] += count_true_per_row(outside & ~was_outside)
        largest, time_of_largest = error.max(axis=1), time[error.argmax(axis=1)]
        is_farther = outside.any(axis=1) & (largest > self._farthest[joints])
        self.excursions[1, joints] = np.where(is_farther, time_of_largest, self.excursions[1, joints])
        self._farthest[joints] = np.where(is_farther, largest, self._farthest[joints])

    def state_dict(self) -> dict[str, Any]:
        """Return the state as plain data."""
        return {name: getattr(self, name).tolist() for name in _STATE}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a stored state; raise ValueError or KeyError if it belongs to another run."""
        for name in _STATE:
            values = getattr(self, name)
            values[...] = read_stored_array(state[name], values.shape)


def _sum_in_order(start: Vector, terms: Vector) -> Vector:
    """Return `start` plus the sum of each row of `terms`, added one by one.

    Other sums depend in the last bit on where blocks of rows end, and so on where a run was interrupted.
    """
    summands = np.empty((len(start), 1 + terms.shape[1]))
    summands[:, 0], summands[:, 1:] = start, terms
    return np.add.accumulate(summands, axis=1)[:, -1]


_STATE = ("largest", "_squares", "_durations", "excursions", "_was_outside", "_farthest", "counts")


_ROUNDING = 1e-9
"""Relative tolerance of errors, and tolerance of times in s, in comparisons."""


class VerdictMetrics(Metrics):
    """Base of metrics with a verdict for each joint."""

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self._start = self._last = np.nan
        self._first, self._final = np.full((2, len(joints)), np.nan)
        """First and last position error in m."""
        self._not_finite = np.full(len(joints), np.nan)
        """When the position error was first not finite, in s."""
        self._end_problem: str | None = None

    @property
    def joints(self) -> list[str]:
        """The joints that have these metrics."""
        return list(self._joints)

    @property
    def _is_short(self) -> bool:
        """Whether the run is too short for a verdict."""
        return not self._last - self._start > EVALUATED_AFTER + _ROUNDING

    def ended_early(self, problem: str) -> None:
        """Give no joint a good verdict, because the run ended before its stop time."""
        self._end_problem = problem

    def _record_not_finite(self, time: Vector, errors: Vector) -> None:
        """Record when position errors, of shape (joints, rows), are first not finite."""
        if np.isfinite(errors).all():  # as in nearly all blocks
            return
        for joint in np.flatnonzero(np.isnan(self._not_finite) & ~np.isfinite(errors).all(axis=1)):
            self._not_finite[joint] = float(time[(~np.isfinite(errors[joint])).argmax()])


class Settling:
    """Follows the position errors of all joints until each has settled.

    A joint settles when its position error has entered the position window and has stayed within it for the
    window time, like the target reached bit of CiA 402 (IEC 61800-7-201, objects 6067h and 6068h). Its
    settling time is when it entered; it is known once the window time is over.
    """

    def __init__(self, criteria: Sequence[Criteria]) -> None:
        self._windows = [(1.0 + _ROUNDING) * joint_criteria.position_window for joint_criteria in criteria]
        self._times = [joint_criteria.window_time for joint_criteria in criteria]
        self._entered = [np.nan] * len(criteria)
        self._settled = [False] * len(criteria)

    def is_settled(self, joint: int) -> bool:
        """Return whether a joint has settled."""
        return self._settled[joint]

    def entered(self, joint: int) -> float:
        """Return the time in s at which a joint entered its window for the current stay; NaN outside."""
        return self._entered[joint]

    def settled_at(self, joint: int) -> float:
        """Return the time in s from which a joint counts as settled; NaN if it has not settled."""
        return self._entered[joint] + self._times[joint] if self._settled[joint] else np.nan

    def write(self, time: Vector, errors: Vector) -> None:
        """Take the next rows: times in s, and the absolute position error in m of each joint in a row."""
        for joint, settled in enumerate(self._settled):
            if not settled:
                self._update(joint, time, errors[joint])

    def _update(self, joint: int, time: Vector, error: Vector) -> None:
        """Record when a joint entered its window for the current stay, and whether it has settled."""
        inside = error <= self._windows[joint]
        outside = np.where(inside, -1, np.arange(len(time)))
        # for each row, the last row outside of the window, -1 if there is none in this block
        last_outside = np.maximum.accumulate(outside)
        entries = np.append(time, np.nan)[last_outside + 1]
        entered = self._entered[joint]
        entries[last_outside < 0] = time[0] if np.isnan(entered) else entered
        has_settled = inside & (time - entries >= self._times[joint] - _ROUNDING)
        if has_settled.any():
            self._settled[joint] = True
            self._entered[joint] = float(entries[has_settled.argmax()])
        else:
            self._entered[joint] = float(entries[-1]) if inside[-1] else np.nan

    def state_dict(self) -> dict[str, Any]:
        """Return the state as plain data."""
        return {"entered": self._entered, "settled": self._settled}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a stored state; raise ValueError or KeyError if it belongs to another run."""
        self._entered = read_stored_array(state["entered"], (len(self._times),)).tolist()
        self._settled = [bool(x) for x in read_stored_array(state["settled"], (len(self._times),))]
