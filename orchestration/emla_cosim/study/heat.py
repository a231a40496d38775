"""The winding temperature of a joint if the cycle of a run repeats permanently.

The winding is one thermal body, as in `emla_fmu.thermal`: its temperature rise approaches the copper loss
with a time constant. In a repeated cycle, the rise is that of the run plus an excess that decays with this
time constant. The excess follows from the condition that each cycle ends as it begins. A temperature
contains the losses of its run, so some hundred samples of it are enough.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Indices, Vector, read_stored_array
from .roles import RoleNames, find_values, find_variable

MIN_DURATION = 1.0
"""Least evaluated time in s; a shorter part of a motion says nothing about a cycle."""

# a temperature contains the losses of its run, so the rows between two samples are not lost
_MAX_SAMPLES = 1024
"""Most samples of a temperature."""

_SHORTEST_INTERVAL = 1e-3
"""First interval of the samples in s."""

_ROUNDING = 1e-9
"""Tolerance in s for equal times."""

_TOLERANCE = 1e-3
"""Tolerance for the permitted temperature rise as a part of it; samples miss the highest rise by less."""

_ZERO_RISE = 1e-300
"""A temperature rise in K that is as good as none, but has a logarithm."""


@dataclass(frozen=True)
class Heat:
    """What the winding of a joint reaches if a part of a run repeats, from the losses of the run.

    Attributes:
        from_s: Start of this part.
        until_s: Its end: that of the run, or the trip of the joint.
        copper_load: Mean copper loss relative to that of the rated current.
        mean_rise_K: Mean temperature rise of the cycle once it is warm.
        steady_rise_K: Highest temperature rise of this cycle.
        permitted_rise_K: Permitted temperature rise.
        trips_at_s: Time at which the joint trips if the cycle repeats after its end; NaN if it does not.
    """

    from_s: float
    until_s: float
    copper_load: float
    mean_rise_K: float
    steady_rise_K: float
    permitted_rise_K: float
    trips_at_s: float

    @property
    def is_excessive(self) -> bool:
        """Whether the winding gets hotter than it may; not at exactly the rated losses, with rounding."""
        return self.steady_rise_K > self.permitted_rise_K * (1.0 + _TOLERANCE)

    def sentence(self, joint: str) -> str:
        """Return a message that says how hot the winding gets."""
        length, trips = self.until_s - self.from_s, ""
        if not math.isnan(self.trips_at_s):
            trips = f", and the drive trips at t = {self.trips_at_s:.4g} s"
        return (
            f"{joint}: repeated, the {length:.3g} s from t = {self.from_s:.4g} s on heat the winding to "
            f"{self.steady_rise_K:.4g} K above ambient, with {self.copper_load:.3g} times its rated losses; "
            f"{self.permitted_rise_K:.6g} K are permitted{trips}."
        )


@dataclass(frozen=True)
class Winding:
    """Thermal data of a winding, and of its use.

    Args:
        permitted_rise: Steady temperature rise in K at the rated current, which is permitted.
        tau: Thermal time constant in s.
        trip_fraction: Fraction beyond the permitted rise at which the joint trips.
        period: Period of the motion in s; 0 if it does not repeat within a run.
    """

    permitted_rise: float
    tau: float
    trip_fraction: float
    period: float = 0.0

    def repeat(self, time: Vector, rise: Vector) -> Heat:
        """Return what repeating a part of a run leads to: its last whole periods, else all of it.

        Args:
            time: Times in s, shape (samples,).
            rise: Temperature rise in K, shape (samples,).
        """
        if 0.0 < self.period <= time[-1] - time[0] + _ROUNDING:
            start = time[-1] - self.period * math.floor((time[-1] - time[0] + _ROUNDING) / self.period)
            is_in_cycle = time > start
            time, rise = (np.append(np.interp(start, time, x), x[is_in_cycle]) for x in (time, rise))
        length, gain = float(time[-1] - time[0]), float(rise[-1] - rise[0])
        phase = time - time[0]
        # the excess at the start of the cycle that decays within it by just what the cycle adds
        steady = rise + gain / -math.expm1(-length / self.tau) * np.exp(-phase / self.tau)
        mean = (float(np.trapezoid(rise, time)) + gain * self.tau) / length
        beyond = steady - self.permitted_rise * (1.0 + self.trip_fraction)
        trips_after = math.nan
        if (beyond > 0.0).any():
            # what the present rise lacks decays, and at some phase of a cycle gets as small as what is beyond
            lacking = max(float(steady[0] - rise[-1]), _ZERO_RISE)
            phase, beyond = phase[beyond > 0.0], beyond[beyond > 0.0]
            cycles = np.ceil((self.tau * np.log(lacking / beyond) - phase) / length)
            trips_after = float((phase + length * np.maximum(cycles, 0.0)).min())
        return Heat(
            from_s=float(time[0]),
            until_s=float(time[-1]),
            copper_load=mean / self.permitted_rise,
            mean_rise_K=mean,
            steady_rise_K=float(steady.max()),
            permitted_rise_K=self.permitted_rise,
            trips_at_s=float(time[-1]) + trips_after,
        )


def find_winding(
    joint: str, parameters: RoleNames[float], roles: Mapping[str, str], trip_fraction: float
) -> Winding | None:
    """Return the thermal data of a joint's winding; None if its heating cannot be computed.

    Args:
        joint: The joint.
        parameters: Values of all parameters by full name.
        roles: Names by JOINT.ROLE, which override the default ones.
        trip_fraction: Fraction beyond the permitted rise at which the joint trips.

    Returns:
        None if the plant has no thermal data, does not heat (i_N = 0), or makes its torque without currents.
    """
    i_N, permitted_rise, tau, is_ideal, period = find_values(
        joint, parameters, roles, "i_N", "permitted_rise", "tau_th", "ideal_torque", "period"
    )
    if i_N == 0.0 or not (permitted_rise > 0.0 and tau > 0.0) or is_ideal > 0.0:
        return None
    return Winding(permitted_rise, tau, trip_fraction, 0.0 if math.isnan(period) else period)


class _Samples:
    """At most `_MAX_SAMPLES` samples of a temperature: the first of each equal interval, and the last.

    Which rows these are depends on their times alone, not on the blocks in which they come.
    """

    def __init__(self) -> None:
        self._times, self._rises = list[float](), list[float]()
        self._last = (math.nan, math.nan)
        """Time in s and temperature rise in K of the last row."""
        self._interval = _SHORTEST_INTERVAL

    def add(self, time: Vector, rise: Vector) -> None:
        """Take the next rows: times in s, and temperature rises in K."""
        start = self._times[0] if self._times else float(time[0])
        previous = self._times[-1:] or [start - self._interval]
        selected = self._find_interval_starts(np.append(previous, time), start)
        self._times += time[selected].tolist()
        self._rises += rise[selected].tolist()
        self._last = float(time[-1]), float(rise[-1])
        while len(self._times) > _MAX_SAMPLES:
            # doubled, so that which rows are kept does not depend on the blocks in which rows come
            self._interval *= 2.0
            times = np.array(self._times)
            indices = [0, *(1 + self._find_interval_starts(times, start))]
            self._times, self._rises = times[indices].tolist(), np.array(self._rises)[indices].tolist()

    def _find_interval_starts(self, time: Vector, start: float) -> Indices:
        """Return the positions in `time[1:]` of times that are in another interval than the time before."""
        interval = np.floor((time - start + _ROUNDING) / self._interval)
        return np.flatnonzero(interval[1:] > interval[:-1])

    def curve(self) -> tuple[Vector, Vector]:
        """Return times in s and temperature rises in K of the samples and of the last row."""
        time, rise = np.array([*zip(self._times, self._rises, strict=True), self._last]).T
        return (time, rise) if len(time) < 2 or time[-1] > time[-2] else (time[:-1], rise[:-1])

    def state_dict(self) -> dict[str, Any]:
        """Return the state as plain data."""
        state = {"times": self._times, "rises": self._rises, "last": self._last}
        return {"interval": self._interval, **{name: list(values) for name, values in state.items()}}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a stored state; raise KeyError or ValueError if it belongs to another run."""
        self._interval = float(state["interval"])
        self._times = read_stored_array(state["times"], (len(state["times"]),)).tolist()
        self._rises = read_stored_array(state["rises"], (len(self._times),)).tolist()
        time, rise = read_stored_array(state["last"], (2,)).tolist()
        self._last = time, rise


class HeatWatch:
    """Samples the winding temperatures of joints from when they are evaluated until they trip.

    Attributes:
        columns: Columns of the temperatures in the rows, in the order of the joints.
    """

    def __init__(
        self,
        trip_fractions: Mapping[str, float],
        columns: RoleNames[int],
        parameters: RoleNames[float],
        roles: Mapping[str, str],
    ) -> None:
        """Find the joints whose windings heat.

        Args:
            trip_fractions: Fraction beyond the permitted temperature rise that is a trip, by joint.
            columns: Columns of all signals by name.
            parameters: Values of all parameters by name.
            roles: Names by JOINT.ROLE, which override the default ones.
        """
        self._windings, self.columns = dict[int, Winding](), list[int]()
        for number, (joint, trip_fraction) in enumerate(trip_fractions.items()):
            signal = find_variable(joint, "temperature_rise", columns, roles)
            winding = find_winding(joint, parameters, roles, trip_fraction)
            if signal is not None and winding is not None:
                self._windings[number] = winding
                self.columns.append(columns[signal])
        self._samples = {joint: _Samples() for joint in self._windings}

    def write(self, time: Vector, rises: Vector, since: Vector, until: Sequence[float]) -> None:
        """Take the next rows.

        Args:
            time: Times in s, shape (rows,).
            rises: Temperature rises in K, of the signals in `columns`, shape (signals, rows).
            since: Time in s from which on each joint is evaluated; infinite while it is unknown.
            until: Time in s of the trip of each joint; infinite without one.
        """
        for (joint, samples), rise in zip(self._samples.items(), rises, strict=True):
            # an approach from a distant start does not repeat
            first = int(np.searchsorted(time, since[joint] - _ROUNDING))
            end = int(np.searchsorted(time, until[joint], side="right"))
            if first < end:
                samples.add(time[first:end], rise[first:end])

    def heat(self, joint: int) -> Heat | None:
        """Return what the winding of a joint reaches if the run repeats; None if it cannot be computed.

        It needs thermal data, at least `MIN_DURATION` of evaluated time, and finite temperatures.
        """
        if joint not in self._samples:
            return None
        time, rise = self._samples[joint].curve()
        # half a move would predict the heat of that half
        if not (time[-1] - time[0] >= MIN_DURATION - _ROUNDING and np.isfinite(rise).all()):
            return None
        return self._windings[joint].repeat(time, rise)

    def state_dict(self) -> dict[str, Any]:
        """Return the state as plain data, by number of the joint."""
        return {str(joint): samples.state_dict() for joint, samples in self._samples.items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a stored state; raise KeyError or ValueError if it belongs to another run."""
        for joint, samples in self._samples.items():
            samples.load_state_dict(state[str(joint)])
