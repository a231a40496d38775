"""The limits of a joint's plant: which ones it touches, and which trip it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Vector
from .criteria import Criteria
from .roles import RoleNames, find_values, find_variable


class Range(NamedTuple):
    """The roles of a signal and of its limits; without a lower limit, the range is symmetric.

    For `TORQUE_LIMIT`, see `find_torque_limit`. `threshold` is the criterion of a trip: a fraction of the
    limit, or a distance in the signal's unit if `is_distance`.
    """

    role: str
    quantity: str
    unit: str
    low: str | None
    high: str
    threshold: str
    is_distance: bool = False


TORQUE_LIMIT = "torque limit"
"""In place of a role: the largest torque of a motor, for plants that make the commanded torque."""

WINDING_TEMPERATURE = "winding temperature"

RANGES = (
    Range("x_L", "stroke", "m", "q_LB", "q_UB", "over_travel", is_distance=True),
    Range("v_L", "speed", "m/s", None, "v_max", "over_speed"),
    Range("i_q", "current", "A", None, "i_max", "over_current"),
    Range("i_d", "current", "A", None, "i_max", "over_current"),
    Range("tau_m", "demanded torque", "N m", None, TORQUE_LIMIT, "over_torque"),
    Range("temperature_rise", WINDING_TEMPERATURE, "K", None, "permitted_rise", "over_temperature"),
)
"""Ranges of a joint; a plant without these parameters has none."""


@dataclass(frozen=True)
class LimitViolation:
    """A value beyond a limit; `value`, `limit` and `threshold` are in `unit`, `what` names the quantity."""

    signal: str
    time_s: float
    value: float
    limit: float
    threshold: float
    unit: str
    what: str


@dataclass(frozen=True)
class Trip(LimitViolation):
    """The first value beyond the threshold of a limit.

    `cause` says that the load is more than the motor can hold, without full stop; empty if it is not.
    """

    cause: str = ""

    def sentence(self, joint: str) -> str:
        """Return a message that says when the joint tripped, and why."""
        value, threshold = format_distinct(self.value, self.threshold)
        return (
            f"{joint} tripped on its {self.what} at t = {self.time_s:.6g} s: {self.signal} = "
            f"{value} {self.unit}, beyond {threshold} {self.unit} (limit {self.limit:.6g} {self.unit})."
            f"{f' {self.cause}.' if self.cause else ''}"
        )


class Touch(LimitViolation):
    """A limit that was exceeded by less than its threshold: the first time, and the largest value."""

    def sentence(self, joint: str) -> str:
        """Return a message that says which limit the joint touched."""
        value, limit = format_distinct(self.value, self.limit)
        return (
            f"{joint} touched its {self.what} limit, first at t = {self.time_s:.6g} s: {self.signal} reached "
            f"{value} {self.unit}, the limit is {limit} {self.unit}, and it trips at {self.threshold:.6g}."
        )


class _WatchedSignal(NamedTuple):
    """A signal with its limits, and with the thresholds beyond them at which its joint trips."""

    joint: str
    range: Range
    signal: str
    column: int
    low_limit: float
    high_limit: float
    low_threshold: float
    high_threshold: float


class _WatchedLoad(NamedTuple):
    """The load force of a joint: its signal, and the torque per force in m and the limit in N m for it."""

    signal: str
    column: int
    ratio: float
    limit: float

    def cause(self, load: float) -> str:
        """Return the `cause` of a trip at this load in N."""
        torque = abs(load) * self.ratio
        if not torque > self.limit > 0.0:
            return ""
        return (
            f"The load of {1e-3 * load:.4g} kN ({self.signal}) takes {torque:.4g} N m of the motor at rest, "
            f"which makes {self.limit:.4g} N m at the most"
        )


class LimitWatch:
    """Finds values beyond limits, for each joint until it trips."""

    def __init__(
        self,
        criteria: Mapping[str, Criteria],
        columns: RoleNames[int],
        parameters: RoleNames[float],
        roles: Mapping[str, str],
    ) -> None:
        """Take the criteria by joint, the columns of signals and the values of parameters by full name."""
        self._watched = [
            watched
            for joint, joint_criteria in criteria.items()
            for range_ in RANGES
            if (watched := _find_watched_signal(joint, range_, joint_criteria, columns, parameters, roles))
            is not None
        ]
        self._loads = {
            joint: load
            for joint in criteria
            if (load := _find_watched_load(joint, columns, parameters, roles)) is not None
        }
        self._trips: dict[str, Trip] = {}
        self._touches: dict[str, dict[str, Touch]] = {joint: {} for joint in criteria}
        self._minima = np.array([w.low_limit for w in self._watched])
        self._maxima = np.array([w.high_limit for w in self._watched])

    @property
    def columns(self) -> list[int]:
        """The columns of the watched signals, then those of the loads."""
        return [item.column for item in (*self._watched, *self._loads.values())]

    def trip(self, joint: str) -> Trip | None:
        """Return the first trip of a joint; None if it did not trip."""
        return self._trips.get(joint)

    def touches(self, joint: str) -> list[Touch]:
        """Return the limits that a joint touched, in the order of `RANGES`."""
        return list(self._touches[joint].values())

    def write(self, time: Vector, values: Vector) -> None:
        """Take the next rows: times in s, and the signals of `columns`, shape (signals, rows)."""
        values, loads = values[: len(self._watched)], values[len(self._watched) :]
        if not len(values):
            return
        highest, lowest = values.max(axis=1), values.min(axis=1)
        # NaN counts as beyond
        # most blocks of rows are within all limits, and need no more than this
        signal_numbers = np.flatnonzero(~((self._minima <= lowest) & (highest <= self._maxima)))
        if not len(signal_numbers):
            return
        trips = dict[str, tuple[int, Trip]]()
        for number in signal_numbers.tolist():
            watched, series = self._watched[number], values[number]
            tripping = np.flatnonzero(
                ~((watched.low_threshold <= series) & (series <= watched.high_threshold))
            )
            if watched.joint in self._trips or not len(tripping):
                continue
            # of several signals, the first one to trip counts
            if (row := int(tripping[0])) < trips.get(watched.joint, (len(time),))[0]:
                cause = ""
                if (load := self._loads.get(watched.joint)) is not None:
                    row_of_load = list(self._loads).index(watched.joint)
                    cause = load.cause(float(loads[row_of_load, row]))
                trip = Trip(*_list_violation_fields(watched, float(time[row]), float(series[row])), cause)
                trips[watched.joint] = row, trip
        for number in signal_numbers.tolist():
            watched = self._watched[number]
            if watched.joint not in self._trips:
                # a real drive is off after its trip
                end = trips.get(watched.joint, (len(time),))[0]
                self._record_touch(watched, time[:end], values[number, :end])
        for joint, (_, trip) in trips.items():
            self._trips[joint] = trip

    def _record_touch(self, watched: _WatchedSignal, time: Vector, values: Vector) -> None:
        """Record the first time beyond a limit, and the largest value there."""
        beyond = (values < watched.low_limit) | (watched.high_limit < values)
        if not beyond.any():
            return
        excess = np.maximum(values - watched.high_limit, watched.low_limit - values)
        largest = float(values[excess.argmax()])
        before = self._touches[watched.joint].get(watched.signal)
        if before is None:
            touch = Touch(*_list_violation_fields(watched, float(time[beyond.argmax()]), largest))
        elif excess.max() > max(before.value - watched.high_limit, watched.low_limit - before.value):
            touch = Touch(*_list_violation_fields(watched, before.time_s, largest))
        else:
            return
        self._touches[watched.joint][watched.signal] = touch

    def state_dict(self) -> dict[str, Any]:
        """Return the state as plain data."""
        trips = {joint: asdict(trip) for joint, trip in self._trips.items()}
        touches = {
            joint: [asdict(t) for t in joint_touches.values()]
            for joint, joint_touches in self._touches.items()
        }
        return {"trips": trips, "touches": touches}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a stored state; raise KeyError or ValueError if it is damaged."""
        signals = {watched.signal for watched in self._watched}
        self._trips = {joint: _read_violation(Trip, trip, signals) for joint, trip in state["trips"].items()}
        self._touches = {
            joint: {t["signal"]: _read_violation(Touch, t, signals) for t in state["touches"][joint]}
            for joint in self._touches
        }


def _find_watched_signal(
    joint: str,
    range_: Range,
    criteria: Criteria,
    columns: Mapping[str, int],
    parameters: Mapping[str, float],
    roles: Mapping[str, str],
) -> _WatchedSignal | None:
    """Return a signal of a joint with its limits; None if the joint lacks the signal or the upper limit."""
    signal = find_variable(joint, range_.role, columns, roles)
    if range_.high != TORQUE_LIMIT:
        (high,) = find_values(joint, parameters, roles, range_.high)
    else:
        (is_ideal,) = find_values(joint, parameters, roles, "ideal_torque")
        high = find_torque_limit(joint, parameters, roles, "i_max") if is_ideal > 0.0 else math.nan
    if signal is None or math.isnan(high):
        return None
    low = -high if range_.low is None else find_values(joint, parameters, roles, range_.low)[0]
    low = -math.inf if math.isnan(low) else low
    # drives trip some per cent beyond a limit, so that a reference can move at the limit
    margin = getattr(criteria, range_.threshold) * (1.0 if range_.is_distance else abs(high))
    return _WatchedSignal(joint, range_, signal, columns[signal], low, high, low - margin, high + margin)


def find_torque_limit(
    joint: str, parameters: Mapping[str, float], roles: Mapping[str, str], *current_limits: str
) -> float:
    """Return the torque in N m of the motor at the lowest of these roles' currents; NaN if it is unknown."""
    poles, flux, *currents = find_values(joint, parameters, roles, "N_p", "Phi_PM", *current_limits)
    return 1.5 * poles * flux * float(np.fmin.reduce(currents))


def _find_watched_load(
    joint: str, columns: Mapping[str, int], parameters: Mapping[str, float], roles: Mapping[str, str]
) -> _WatchedLoad | None:
    """Return the load force of a joint; None if its signal or a needed parameter is missing."""
    signal = find_variable(joint, "F_L", columns, roles)
    rho, lead, efficiency, is_directional = find_values(
        joint, parameters, roles, "rho", "lead", "eta_GB", "directional"
    )
    if is_directional > 0.0:
        efficiency = 1.0  # its losses are zero at rest
    limit = find_torque_limit(joint, parameters, roles, "i_max")
    if signal is None or any(map(math.isnan, (rho, lead, efficiency, limit))):
        return None
    return _WatchedLoad(signal, columns[signal], rho * lead / (2.0 * math.pi * efficiency), limit)


def _list_violation_fields(
    watched: _WatchedSignal, time: float, value: float
) -> tuple[str, float, float, float, float, str, str]:
    """Return the fields of a trip or a touch."""
    below = value < watched.low_limit
    limit, threshold = (
        (watched.low_limit, watched.low_threshold) if below else (watched.high_limit, watched.high_threshold)
    )
    return watched.signal, time, value, limit, threshold, watched.range.unit, watched.range.quantity


def _read_violation(kind: Any, values: Mapping[str, Any], signals: set[str]) -> Any:
    """Return a trip or a touch from a stored state; raise KeyError if its signal is not watched."""
    if values["signal"] not in signals:
        raise KeyError(values["signal"])
    converted = {f.name: (float if f.type in (float, "float") else str)(values[f.name]) for f in fields(kind)}
    return kind(**converted)


def format_distinct(value: float, limit: float) -> tuple[str, str]:
    """Return two values with as many digits as show their difference, at least 4."""
    # 17 digits tell any two doubles apart
    texts: Sequence[tuple[str, str]] = [(f"{value:.{n}g}", f"{limit:.{n}g}") for n in range(4, 18)]
    return next(((a, b) for a, b in texts if a != b), (repr(value), repr(limit)))
