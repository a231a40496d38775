"""Detect oscillations: torque that shakes a joint instead of moving its load.

In a limit cycle, and in chatter on noise, the torque accelerates the joint back and forth. So the torque is
in
phase with the acceleration of the speed error. A rejected disturbance, however large, needs as much torque
but accelerates nothing. An external disturbance, such as a random force, accelerates the joint without the
torque. So both are evaluated in windows of 0.1 s: the part of the torque in phase with the acceleration,
and the torque that this acceleration of the inertia requires.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Mask, Vector, count_true_per_row, read_stored_array

WINDOW = 0.1
"""Length in s of the windows; the slowest oscillation that can be found has 10 Hz."""

SUSTAINED = 3
"""Successive windows that make an oscillation sustained; a reversal or an impact fills one or two."""

_FEWEST = 20
"""Least rows in a window."""

_IN_PHASE = 0.9
"""Least correlation of torque and acceleration for a joint of unknown inertia."""

_STREAK = ("windows", "begin", "crossings", "torque^2", "ripple^2", "torque swing", "position swing")
_STATE = (
    "start",
    "window",
    "last",
    "largest",
    "judged",
    "streaks",
    "worst",
    "sums",
    "highest",
    "lowest",
)
_SUMS = ("rows", "x", "a", "tau", "x x", "x a", "x tau", "a a", "a tau", "tau tau", "crossings")


@dataclass(frozen=True)
class Oscillation:
    """A sustained oscillation of a joint.

    Attributes:
        time_s: When it began.
        until_s: The end of its last window so far.
        frequency_Hz: From the sign changes of the acceleration.
        torque_ripple: `torque_rms_N_m` as a fraction of the torque limit.
        torque_rms_N_m: Rms of the torque in phase with the acceleration.
        torque_swing_N_m: Torque from peak to peak.
        position_swing_m: Position error from peak to peak.
    """

    time_s: float
    until_s: float
    frequency_Hz: float
    torque_ripple: float
    torque_rms_N_m: float
    torque_swing_N_m: float
    position_swing_m: float

    def sentence(self, joint: str) -> str:
        """Return a message that describes the oscillation."""
        return (
            f"{joint} oscillates from t = {self.time_s:.6g} s on, at about {self.frequency_Hz:.3g} Hz: its "
            f"torque swings by {self.torque_swing_N_m:.4g} N m, its position by "
            f"{1e6 * self.position_swing_m:.4g} µm."
        )


class OscillationWatch:
    """Evaluates the windows of all joints, each from when it is evaluated on.

    Args:
        inertias: Torque per acceleration of the screw in N m / (m/s^2), NaN if unknown.
        limits: Torque limits in N m; NaN if unknown, then the largest torque so far is used.
        ripples: Fractions of the limits from which on a window is loud.
    """

    def __init__(self, inertias: Sequence[float], limits: Sequence[float], ripples: Sequence[float]) -> None:
        joints = len(inertias)
        self._inertias, self._limits, self._ripples = map(np.array, (inertias, limits, ripples))
        one, x, a, tau = (
            np.zeros(joints, int),
            np.ones(joints, int),
            *np.arange(2, 2 + 2 * joints).reshape(2, -1),
        )
        pairs = itertools.combinations_with_replacement((one, x, a, tau), 2)
        self._places = tuple(np.array(side) for side in zip(*pairs, strict=True))
        """Positions of the first ten sums in the products of 1, x, and a and tau of all joints."""
        self._start = np.nan
        self._window = 0
        self._last = np.full((2, joints), np.nan)
        """Speed error in m/s and acceleration in m/s^2 of the last row."""
        self._largest = np.zeros(joints)
        self._judged = np.zeros(joints)
        """Number of evaluated windows."""
        self._streaks, self._worst = np.zeros((2, len(_STREAK), joints))
        """The current loud windows in a row, and the loudest sustained ones."""
        self._clear()

    def _clear(self) -> None:
        joints = len(self._inertias)
        self._sums = np.zeros((len(_SUMS), joints))
        self._highest, self._lowest = np.full((2, joints), -np.inf), np.full((2, joints), np.inf)

    def oscillation(self, joint: int) -> Oscillation | None:
        """Return the loudest sustained oscillation of a joint so far; None if it was quiet.

        In a run with too few windows, all of them must be loud.
        """
        found = self._worst[:, joint]
        if not found[0] and 0 < self._judged[joint] == self._streaks[0, joint]:
            found = self._streaks[:, joint]
        count, begin, crossings, squares, ripple_squares, torque, position = (float(x) for x in found)
        if not count:
            return None
        return Oscillation(
            time_s=begin,
            until_s=begin + count * WINDOW,
            frequency_Hz=crossings / (2.0 * count * WINDOW),
            torque_ripple=math.sqrt(ripple_squares / count),
            torque_rms_N_m=math.sqrt(squares / count),
            torque_swing_N_m=torque,
            position_swing_m=position,
        )

    def write(
        self, time: Vector, steps: Vector, torque: Vector, speed_error: Vector, error: Vector, since: Vector
    ) -> None:
        """Take the next rows.

        Args:
            time: Times in s, shape (rows,).
            steps: Time in s since the previous row, shape (rows,).
            torque: Motor torque in N m, shape (joints, rows).
            speed_error: v_L - v_d in m/s, shape (joints, rows).
            error: x_L - x_d in m, shape (joints, rows).
            since: Time in s from which on each joint is evaluated; infinite while it is unknown.
        """
        first = 0
        if math.isnan(self._start):
            self._start, first = float(time[0]), 1  # the first row of a run has no acceleration
        joints, rows = torque.shape
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            factors = np.empty((2 + 3 * joints, rows))
            factors[0], factors[1] = 1.0, time
            acceleration = factors[2 : 2 + joints]
            factors[2 + joints : 2 + 2 * joints], factors[2 + 2 * joints :] = torque, error
            acceleration[:, 0] = speed_error[:, 0] - self._last[0]
            np.subtract(speed_error[:, 1:], speed_error[:, :-1], out=acceleration[:, 1:])
            acceleration /= steps
            positive = np.empty((joints, rows + 1), dtype=bool)
            positive[:, 0] = self._last[1] > 0.0
            np.greater(acceleration, 0.0, out=positive[:, 1:])
            crossings = positive[:, 1:] != positive[:, :-1]
            while first < rows:
                # window k excludes its first instant and includes its last one
                end = int(np.searchsorted(time, self._begin + WINDOW * (1.0 + 1e-6), side="right"))
                if end > first:
                    part = slice(first, end)
                    factors[1, part] -= self._begin
                    self._add(factors[:, part], crossings[:, part])
                    first = end
                if end < rows:
                    self._judge(since)
                    self._window = max(
                        self._window + 1,
                        math.ceil((float(time[end]) - self._start) / WINDOW - 1e-6) - 1,
                    )
        self._last = np.stack([speed_error[:, -1], acceleration[:, -1]])

    @property
    def _begin(self) -> float:
        """Return the start of the current window in s."""
        return self._start + WINDOW * self._window

    def _add(self, factors: Vector, crossings: Mask) -> None:
        """Add rows to the current window: 1, time since its start, then by joint a, tau and error."""
        joints = len(self._inertias)
        multiplied = factors[: 2 + 2 * joints]
        self._sums[:10] += (multiplied @ multiplied.T)[self._places]
        self._sums[10] += count_true_per_row(crossings)
        swinging = factors[2 + joints :]
        self._highest = np.maximum(self._highest, swinging.max(axis=1).reshape(2, joints))
        self._lowest = np.minimum(self._lowest, swinging.min(axis=1).reshape(2, joints))

    def _judge(self, since: Vector) -> None:
        """Evaluate the current window, which is complete, and begin the next one."""
        self._largest = np.fmax(self._largest, np.maximum(self._highest[0], -self._lowest[0]))
        limits = np.where(np.isnan(self._limits), self._largest, self._limits)
        judged = (self._sums[0] >= _FEWEST) & (self._begin >= since - 1e-9)
        self._judged += judged
        swings = self._highest - self._lowest
        may_be_loud = judged & (limits > 0.0) & (swings[0] > self._ripples * limits)  # no rms is larger
        for joint in np.flatnonzero(may_be_loud).tolist():
            shaking = self._shaking(joint)
            ripple = shaking / float(limits[joint])
            if ripple > self._ripples[joint]:
                self._follow(joint, shaking, ripple, swings[:, joint])
            else:
                may_be_loud[joint] = False
        self._streaks[:, ~may_be_loud] = 0.0
        self._clear()

    def _shaking(self, joint: int) -> float:
        """Return the rms in N m of the torque that shakes a joint in the current window."""
        n, x, a, tau, xx, xa, x_tau, aa, a_tau, tau_tau, _ = self._sums[:, joint].tolist()
        # remove linear trends: changes slower than the window are not oscillations
        spread = max(xx / n - x * x / (n * n), 1e-30)
        with_a, with_tau = xa / n - x * a / (n * n), x_tau / n - x * tau / (n * n)
        rms_a = math.sqrt(max(aa / n - a * a / (n * n) - with_a * with_a / spread, 0.0))
        rms_tau = math.sqrt(max(tau_tau / n - tau * tau / (n * n) - with_tau * with_tau / spread, 0.0))
        covariance = a_tau / n - a * tau / (n * n) - with_a * with_tau / spread
        in_phase = covariance / rms_a if rms_a > 0.0 else 0.0
        inertia = float(self._inertias[joint])
        if math.isnan(inertia):
            return in_phase if in_phase >= _IN_PHASE * rms_tau else 0.0
        return min(in_phase, inertia * rms_a)

    def _follow(self, joint: int, shaking: float, ripple: float, swings: Vector) -> None:
        """Add the current window, which is loud, to the joint's streak."""
        streak, worst = self._streaks[:, joint], self._worst[:, joint]
        if not streak[0]:
            streak[1] = self._begin
        streak += (1.0, 0.0, self._sums[10, joint], shaking * shaking, ripple * ripple, 0.0, 0.0)
        streak[5:] = np.maximum(streak[5:], swings)
        goes_on = streak[1] == worst[1]
        if streak[0] >= SUSTAINED and (goes_on or streak[4] / streak[0] > worst[4] / max(worst[0], 1.0)):
            worst[:] = streak

    def memory(self) -> dict[str, Any]:
        """Return the state as plain data."""
        return {name: np.asarray(getattr(self, f"_{name}")).tolist() for name in _STATE}

    def remember(self, memory: Mapping[str, Any]) -> None:
        """Continue from `memory`; raise ValueError or KeyError if it belongs to another run."""
        for name in _STATE:
            before = getattr(self, f"_{name}")
            value = read_stored_array(memory[name], np.shape(before))
            setattr(self, f"_{name}", value if np.ndim(before) else type(before)(value))
