"""Settling of joints: within their position window for their window time. Metrics that need it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..base.arrays import Vector, read_stored_array
from ..recorders.metrics import Metrics
from .criteria import EVALUATED_AFTER, Criteria

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

    def _find_not_finite(self, time: Vector, errors: Vector) -> None:
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
