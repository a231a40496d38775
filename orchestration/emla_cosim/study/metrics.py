"""Figures and verdict of joints, from the plants' true states at every communication point.

docs/metrics.md has their definitions and sources.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..base.arrays import Mask, Vector, count_true_per_row, read_stored_array
from ..recorders.metrics import HELD, Figures, MetricDisplay
from ..recorders.recorder import RunLayout
from .criteria import EVALUATED_AFTER, TOO_SHORT, format_length, resolve_criteria
from .heat import HeatWatch
from .idealisations import list_idealisations
from .limits import LimitWatch, Trip, find_torque_limit
from .loads import LoadMetrics, create_load_metrics
from .oscillation import OscillationWatch, WatchedJoint
from .roles import (
    INERTIA,
    RoleNames,
    check_roles,
    describe_error,
    find_all_joints,
    find_values,
    find_variable,
    list_joints_with_roles,
)
from .tracking import (
    AT_REST,
    FOLLOWING,
    OBSERVER,
    POSITION,
    SPEED,
    STANDSTILL,
    TORQUE,
    Settling,
    Tracking,
    VerdictMetrics,
)

# as in the paper; used only for the comparison with its Tables VI and VIII
CONVERGED_WITHIN = 0.05
"""The paper's convergence time: from then on, the position error is within this fraction of its first value.
"""

STARTS_CONVERGED = 1e-6
"""An initial position error in m below this counts as zero."""

_ROUNDING = 1e-9
"""Tolerance in s for equal times."""

_SAME_SAMPLE = 1e-6
"""Tolerance for equal times as a part of a sample time."""


@dataclass
class JointFigures:
    """One joint's part of metrics.json; docs/metrics.md defines each figure.

    `held` is the verdict: finite, settled and still so, not tripped, quiet; `reason` says why not. `judged`
    says of what: the screw, and the load if it is not rigid. `trip`, `limits_touched`, `excursions`,
    `oscillation` and `heat` have details, or None. `idealised` lists what the joint idealises. NaN marks a
    figure that does not exist.
    """

    held: bool
    reason: str | None
    judged: Sequence[str]
    settling_time_s: float
    evaluated_from_s: float
    position_error_m: float
    velocity_error_m_s: float
    following_error_m: float
    following_error_rms_m: float
    standstill_error_m: float
    standstill_error_rms_m: float
    torque_effort_N_m: float
    torque_peak_N_m: float
    observer_position_error_m: float
    saturated_fraction: float
    saturated_after_settling: float
    convergence_time_s: float
    steady_rise_K: float
    excursions: Mapping[str, Any] | None
    trip: Mapping[str, Any] | None
    limits_touched: Sequence[Mapping[str, Any]]
    oscillation: Mapping[str, Any] | None
    heat: Mapping[str, Any] | None
    idealised: Sequence[Mapping[str, str]]


_TRACKED = ("x_L", "x_c")
_REQUIRED = (*_TRACKED, "v_L", "tau_m", "v_c")
_ROLES = (*_REQUIRED, "x_hat", "limited_control", "limited_inverter", "x_load", "F_L", "d_2", "x_s", "v_s")
"""Roles of the watched signals, in the order of the gathered rows."""

_SEARCHED = ("tau_m", "x_L", "x_load", "v_s", "F_L", "d_2")
"""Roles of the signals for `OscillationWatch`. The commanded speed is not among them: with a sensor at the
load it contains the oscillation, and would explain it."""

_VERDICT = MetricDisplay(HELD, HELD)
_VERDICT_WITH_LOAD = MetricDisplay(HELD, "held (screw and load)")
_HEAT = MetricDisplay("steady_rise_K", "steady winding rise", 1.0, "K")
_DISPLAYS = (
    MetricDisplay("position_error_m", "position error", 1e6, "µm", "m"),
    MetricDisplay("velocity_error_m_s", "speed error", 1e3, "mm/s", "m/s"),
    MetricDisplay("following_error_rms_m", "following error, rms", 1e6, "µm", "m"),
    MetricDisplay("standstill_error_m", "standstill error", 1e6, "µm", "m"),
    MetricDisplay("settling_time_s", "settling time", 1e3, "ms"),
    MetricDisplay("torque_effort_N_m", "torque effort", 1.0, "N m"),
    MetricDisplay("torque_peak_N_m", "torque peak", 1.0, "N m"),
    MetricDisplay("observer_position_error_m", "observer position error", 1e6, "µm", "m"),
    MetricDisplay("saturated_fraction", "time at a limit", 100.0, "%"),
    MetricDisplay("saturated_after_settling", "at a limit once settled", 100.0, "%"),
)

SHOWN_WITH_LOAD = tuple(
    replace(display, label=f"screw {display.label}")
    if display.label in ("position error", "speed error")
    else display
    for display in _DISPLAYS
)
"""Metrics of joints beside those of their loads."""

CONVERGENCE_TIME = MetricDisplay("convergence_time_s", "convergence time", 1e3, "ms")
"""The paper's figures, for tables beside its own."""


def create_joint_metrics(layout: RunLayout) -> "JointMetrics | None":
    """Return the metrics of all joints of a run; None if it has no joints.

    Raises:
        CommandError: Roles or criteria are wrong.
    """
    check_roles(layout.roles, layout.names, layout.parameters)
    sample_times = {name: n * layout.times.step for name, n in layout.multiples.items()}
    metrics = JointMetrics(
        layout.names,
        layout.parameters,
        layout.roles,
        layout.criteria,
        sample_times,
        layout.times.start,
        create_load_metrics(layout),
    )
    return metrics if metrics.joints else None


class JointMetrics(VerdictMetrics):
    """Figures by joint; the joint is the part of a signal's name before the first dot.

    Joints need position, speed, torque and reference to have metrics; those in `roles` need only position and
    reference.
    """

    displays = (_VERDICT, _HEAT, *_DISPLAYS)

    def __init__(
        self,
        names: Sequence[str],
        parameters: Mapping[str, float] | None = None,
        roles: Mapping[str, str] | None = None,
        criteria: Mapping[str, float | str] | None = None,
        sample_times: Mapping[str, float] | None = None,
        start: float = 0.0,
        loads: LoadMetrics | None = None,
    ) -> None:
        """Prepare for the rows of a run.

        Args:
            names: Signals of a row.
            parameters: Parameters by full name.
            roles: Signals by joint and role.
            criteria: Values of the option `criteria`.
            sample_times: Sample times in s of components that do several steps at once, by name.
            start: Start time of the run in s, which is the first sample.
            loads: Metrics of the loads that are not rigid, which the verdict includes.
        """
        column = RoleNames((name, i + 1) for i, name in enumerate(names))
        parameters, roles = RoleNames(parameters or {}), roles or {}
        with_roles = list_joints_with_roles(roles)
        candidates = {
            joint: {role: find_variable(joint, role, column, roles) for role in _ROLES}
            for joint in find_all_joints(names, roles)
        }
        for joint, by_role in candidates.items():
            # this one depends on the position, so it explains nothing
            if by_role["F_L"] == f"{joint}.plant.load.force":
                by_role["F_L"] = find_variable(joint, "F_t", column, roles)
        signals = {
            joint: by_role
            for joint, by_role in candidates.items()
            if all(by_role[role] is not None for role in (_TRACKED if joint in with_roles else _REQUIRED))
        }
        super().__init__(list(signals))
        self._criteria = resolve_criteria(self._joints, criteria or {})
        joint_criteria = [self._criteria[joint] for joint in self._joints]
        # signals that a joint lacks are read from an added column of NaN
        self._columns = np.array(
            [[column.get(by_role[role] or "", -1) for by_role in signals.values()] for role in _ROLES],
            dtype=int,
        ).reshape(len(_ROLES), len(signals))
        self._missing = self._columns < 0
        estimates = [by_role["x_hat"] or "" for by_role in signals.values()]
        self._estimate_interval = np.array(
            [
                next((s for c, s in (sample_times or {}).items() if name.startswith(f"{c}.")), np.nan)
                for name in estimates
            ]
        )
        """Time in s from one estimate of each joint's observer to the next; NaN if each row has one."""
        # an observer with a step multiple estimates at its own times, from the start on
        self._first_estimate = start
        self._has_speed = ~(self._missing[_ROLES.index("v_s")])
        self._limits = LimitWatch(self._criteria, column, parameters, roles)
        trip_fractions = {joint: criteria_.over_temperature for joint, criteria_ in self._criteria.items()}
        self._heat = HeatWatch(trip_fractions, column, parameters, roles)
        self._columns = np.array(
            [*self._columns.ravel(), *self._limits.columns, *self._heat.columns], dtype=int
        )
        displays = _DISPLAYS if loads is None else SHOWN_WITH_LOAD
        self._displays = (_HEAT, *displays) if self._heat.columns else displays
        self._verdict = _VERDICT if loads is None else _VERDICT_WITH_LOAD
        self.displays = (self._verdict, *self._displays)
        self._parameters, self._roles = parameters, roles
        self._errors = [describe_error(joint, str(by_role["x_c"])) for joint, by_role in signals.items()]
        """How messages call the position errors."""
        self._settling = Settling(joint_criteria)
        self._tracking = Tracking(np.array([criteria_.position_window for criteria_ in joint_criteria]))
        self._loads = loads
        self._oscillation = OscillationWatch(
            [
                WatchedJoint(
                    # the force of a machine depends on the motion of the joint
                    has=[
                        (name := signals[joint][role]) is not None
                        and not (role == "F_L" and name.startswith("machine."))
                        for role in _SEARCHED
                    ],
                    inertia=_compute_inertia(joint, parameters, roles),
                    torque_limit=find_torque_limit(joint, parameters, roles, "i_max", "i_limit"),
                    window=criteria.position_window,
                    ripple=criteria.torque_ripple,
                    is_force_known=signals[joint]["F_L"] is not None,
                    sample_times=[
                        time for name, time in (sample_times or {}).items() if name.startswith(f"{joint}.")
                    ],
                )
                for joint, criteria in zip(self._joints, joint_criteria, strict=True)
            ]
        )
        count = len(self._joints)
        self._rows = 0
        self._last_outside = np.full(count, np.nan)
        """When the position error was last beyond 5 % of the first one, in s."""
        self._last_reference = np.full(count, np.nan)
        self._evaluated_from = np.full(count, np.nan)
        self._limited = np.zeros(count)
        self._peak = np.where(self._missing[_ROLES.index("tau_m")], np.nan, 0.0)
        # a plant whose torque is the commanded one has no drive that could trip
        self._has_drive = [
            not parameters.get(f"{joint}.plant.use_commanded_current", False) for joint in self._joints
        ]
        self._at_trip = np.full((len(_ROLES), count), np.nan)
        """Signals of each joint when it tripped."""

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        time = rows[:, 0].copy()
        gathered = rows.T[self._columns]
        signals = gathered[: len(_ROLES) * len(self._joints)].reshape(len(_ROLES), len(self._joints), -1)
        signals[self._missing] = np.nan
        if len(gathered) > signals.shape[0] * signals.shape[1]:
            self._limits.write(time, gathered[signals.shape[0] * signals.shape[1] :])
            self._hold_after_trips(time, signals)
        if self._loads is not None:
            self._loads.write(rows)
        x, x_c, v, torque, v_c, x_hat, control, inverter, x_load, force, disturbance, x_s, v_s = signals
        steps = np.empty(len(time))
        if not self._rows:
            self._start = self._last = float(time[0])
        steps[0] = time[0] - self._last
        np.subtract(time[1:], time[:-1], out=steps[1:])
        with np.errstate(invalid="ignore", over="ignore"):
            error, speed_error = x - x_c, v - v_c
            distance, torques = np.abs(error), np.abs(torque)
            values = (distance, np.abs(speed_error), torques, self._compute_estimation_error(time, x - x_hat))
            limited = (control > 0.0) | (inverter > 0.0)
            is_moving = self._detect_motion(x_s, v_s, steps)
        if not self._rows:
            self._first, self._last_outside = distance[:, 0].copy(), np.full(len(x), self._start)
        self._settling.write(time, distance)
        self._update_figures(time, steps, values, is_moving, limited)
        since = np.where(np.isnan(self._evaluated_from), np.inf, self._evaluated_from)
        # before a joint has settled, its motion would count as an oscillation
        self._oscillation.write(time, (torque, error, x_load - x_s, v_s, force, disturbance), since)
        # the way from a distant start does not repeat, so heat counts from settling, too
        if self._heat.columns:
            until = [
                math.inf if (t := self._get_trip(i)) is None else t.time_s for i in range(len(self._joints))
            ]
            self._heat.write(time, gathered[-len(self._heat.columns) :], since, until)
        # that of the paper
        for joint in np.flatnonzero(self._first > STARTS_CONVERGED):
            outside = np.flatnonzero(distance[joint] > CONVERGED_WITHIN * self._first[joint])
            if len(outside):
                self._last_outside[joint] = float(time[outside[-1]])
        self._record_not_finite(time, distance)
        self._peak = np.fmax(self._peak, torques.max(axis=1))
        self._limited += count_true_per_row(limited)
        self._rows += len(rows)
        self._last, self._final = float(time[-1]), distance[:, -1].copy()
        self.displays = self._displays if self._is_short else (self._verdict, *self._displays)

    def _hold_after_trips(self, time: Vector, signals: Vector) -> None:
        """Replace the signals of joints after their trips by those of the trip: figures end there.

        Args:
            time: Times in s, shape (rows,).
            signals: Signals of shape (roles, joints, rows), which change.
        """
        for number in range(len(self._joints)):
            if (trip := self._get_trip(number)) is None:
                continue
            after = int(np.searchsorted(time, trip.time_s, side="right"))
            if 0 < after:
                self._at_trip[:, number] = signals[:, number, after - 1]
            signals[:, number, after:] = self._at_trip[:, number, np.newaxis]

    def _get_trip(self, number: int) -> Trip | None:
        """Return the trip at which the figures of a joint end; None without a trip, or without a drive."""
        return self._limits.trip(self._joints[number]) if self._has_drive[number] else None

    def _detect_motion(self, x_s: Vector, v_s: Vector, steps: Vector) -> Mask:
        """Return whether references move, by their speeds, else by their positions since the last row."""
        if self._has_speed.all():
            return np.abs(v_s) > AT_REST
        changes = np.diff(x_s, prepend=self._last_reference[:, np.newaxis], axis=1)
        self._last_reference = x_s[:, -1].copy()
        return np.where(
            self._has_speed[:, np.newaxis], np.abs(v_s) > AT_REST, np.abs(changes) > AT_REST * steps
        )

    def _compute_estimation_error(self, time: Vector, error: Vector) -> Vector:
        """Return the absolute error of each observer in m; -inf in rows at which it does not estimate.

        Between its estimates an observer holds the last one. Its distance from a moving plant then is the
        way since that time, which is not an error of the observer.
        """
        size = np.abs(error)
        for joint in np.flatnonzero(self._estimate_interval > 0.0):
            estimates = (time - self._first_estimate) / self._estimate_interval[joint]
            size[joint, np.abs(estimates - np.rint(estimates)) > _SAME_SAMPLE] = -np.inf
        return size

    def _update_figures(
        self, time: Vector, steps: Vector, values: Sequence[Vector], is_moving: Mask, limited: Mask
    ) -> None:
        """Update the figures of each joint from when it is evaluated on.

        Before a joint has settled it counts from 0.3 s on, and restarts once it has settled.
        """
        earliest = self._start + EVALUATED_AFTER
        starts = list[int]()
        for joint in range(len(self._joints)):
            settled = self._settling.settled_at(joint)
            since = earliest if math.isnan(settled) else max(earliest, settled)
            starts.append(int(np.searchsorted(time, since - _ROUNDING)))
            if math.isnan(self._evaluated_from[joint]) and not math.isnan(settled):
                self._evaluated_from[joint] = since
                self._tracking.restart(joint)
        # in most blocks all joints are evaluated from the same row on, and are handled at once
        are_equal = len(set(starts)) == 1
        for first in range(0, len(starts), len(starts) if are_equal else 1):
            joints, start = slice(first, None if are_equal else first + 1), starts[first]
            if start < len(time):
                part = tuple(value[joints, start:] for value in values)
                flags = is_moving[joints, start:], limited[joints, start:]
                self._tracking.write(joints, time[start:], steps[start:], part, *flags)

    def state_dict(self) -> Any:
        """Return the state as plain data."""
        state = {name: np.asarray(getattr(self, name)).tolist() for name in _STATE}
        loads = None if self._loads is None else self._loads.state_dict()
        return {
            "own": state,
            "loads": loads,
            **{name: getattr(self, f"_{name}").state_dict() for name in _PARTS},
        }

    def load_state_dict(self, state: Any) -> None:
        """Continue from `state`; raise ValueError or KeyError if it belongs to another run."""
        for name in _STATE:
            value = read_stored_array(state["own"][name], np.shape(getattr(self, name)))
            setattr(self, name, value if value.ndim else float(value))
        # stored states have floats only
        self._rows = int(self._rows)
        for name in _PARTS:
            getattr(self, f"_{name}").load_state_dict(state[name])
        if self._loads is not None:
            self._loads.load_state_dict(state["loads"])

    def remarks(self) -> Sequence[str]:
        """Return messages on hot windings, joints that are not held, delays by notches, and touched limits.

        A run that is too short for a verdict has a remark, too.
        """
        heats = [self._heat.heat(number) for number in range(len(self._joints))]
        messages = [
            heat.sentence(joint)
            for joint, heat in zip(self._joints, heats, strict=True)
            if heat is not None and heat.is_excessive and self._limits.trip(joint) is None
        ]
        for number, joint in enumerate(self._joints):
            messages += self._list_reasons(number)
            if (delay := _compute_notch_delay(joint, self._parameters, self._roles)) > 0.0:
                messages.append(
                    f"{joint}: notches delay its motion by {1e3 * delay:.4g} ms; errors are those from the "
                    f"delayed motion, {joint}.command.x_s."
                )
            if self._limits.trip(joint) is None:
                messages += [touch.sentence(joint) for touch in self._limits.touches(joint)]
        if self._is_short:
            messages.append(f"{TOO_SHORT[:1].upper()}{TOO_SHORT[1:]}.")
        return messages

    def _list_reasons(self, number: int) -> list[str]:
        """Return the reasons why a joint is not held, except that the run is too short."""
        joint, error = self._joints[number], self._errors[number]
        window = format_length(self._criteria[joint].position_window)
        reasons = list[str]()
        if not math.isnan(at := self._not_finite[number]):
            reasons.append(f"{joint} has no finite {error} from t = {at:.6g} s on.")
        if (trip := self._limits.trip(joint)) is not None:
            reasons.append(trip.sentence(joint))
        if not self._is_short and not self._settling.is_settled(number):
            last = format_length(self._final[number])
            end = f"is {last} at the end" if self._get_trip(number) is None else f"was {last} at the trip"
            reasons.append(
                f"{joint} has not settled: its {error} was {format_length(self._first[number])} at the start "
                f"and {end}; its window is {window}."
            )
        if (excursions := self._describe_excursions(number)) is not None:
            times = "once" if excursions["count"] == 1 else f"{excursions['count']} times"
            reasons.append(
                f"{joint} left its position window of {window} {times} after settling; its {error} was "
                f"largest at t = {excursions['time_s']:.6g} s, {format_length(excursions['largest_m'])}."
            )
        if self._loads is not None and (reason := self._loads.reason(joint)) is not None:
            reasons.append(reason)
        if (oscillation := self._oscillation.oscillation(number)) is not None:
            reasons.append(oscillation.sentence(joint))
        return reasons

    def _describe_excursions(self, number: int) -> dict[str, Any] | None:
        """Return how often a joint left its window after settling, and its largest error; None if never."""
        count, time = self._tracking.excursions[:, number]
        if not count or not self._settling.is_settled(number):
            return None
        largest = float(self._tracking.largest[POSITION, number])
        return {"count": int(count), "largest_m": largest, "time_s": float(time)}

    def figures(self) -> Figures:
        """Return the figures by joint for the recorded rows."""
        return {joint: asdict(self._compute_figures(i, joint)) for i, joint in enumerate(self._joints)}

    def _compute_figures(self, number: int, joint: str) -> JointFigures:
        largest = self._tracking.largest[:, number]
        rms_moving, rms_resting = self._tracking.rms(number)
        oscillation = self._oscillation.oscillation(number)
        trip, heat = self._limits.trip(joint), self._heat.heat(number)
        counted, limited = self._tracking.counts[:, number]
        reason = next(iter(self._list_reasons(number)), None)
        if reason is None and self._is_short:
            reason = f"{TOO_SHORT}."
        # what the joint did is a better reason than that the run ended
        if reason is None and self._end_problem is not None:
            reason = self._end_problem
        has_converged = self._final[number] <= max(CONVERGED_WITHIN * self._first[number], STARTS_CONVERGED)
        settled = self._settling.is_settled(number)
        has_tripped = self._get_trip(number) is not None
        if has_tripped:  # means over the time after a trip mean nothing
            rms_moving = rms_resting = np.nan
        return JointFigures(
            held=reason is None,
            reason=reason,
            judged=["screw", *(["load"] if self._loads is not None and joint in self._loads.joints else [])],
            settling_time_s=self._settling.entered(number) - self._start if settled else np.nan,
            evaluated_from_s=float(self._evaluated_from[number]),
            position_error_m=float(largest[POSITION]),
            velocity_error_m_s=float(largest[SPEED]),
            following_error_m=float(largest[FOLLOWING]),
            following_error_rms_m=rms_moving,
            standstill_error_m=float(largest[STANDSTILL]),
            standstill_error_rms_m=rms_resting,
            torque_effort_N_m=float(largest[TORQUE]),
            torque_peak_N_m=float(self._peak[number]),
            observer_position_error_m=float(largest[OBSERVER]),
            saturated_fraction=np.nan if has_tripped else float(self._limited[number]) / max(self._rows, 1),
            saturated_after_settling=float(limited / counted)
            if counted and settled and not has_tripped
            else np.nan,
            convergence_time_s=float(self._last_outside[number]) - self._start if has_converged else np.nan,
            steady_rise_K=np.nan if heat is None else heat.steady_rise_K,
            excursions=self._describe_excursions(number),
            trip=None if trip is None else asdict(trip),
            limits_touched=[asdict(touch) for touch in self._limits.touches(joint)],
            oscillation=None if oscillation is None else asdict(oscillation),
            heat=None if heat is None else asdict(heat),
            idealised=[asdict(x) for x in list_idealisations(joint, self._parameters, self._roles)],
        )


_PARTS = ("limits", "settling", "tracking", "oscillation", "heat")
_STATE = (
    "_start",
    "_last",
    "_rows",
    "_first",
    "_final",
    "_last_outside",
    "_last_reference",
    "_evaluated_from",
    "_limited",
    "_not_finite",
    "_peak",
    "_at_trip",
)


def _compute_inertia(joint: str, parameters: Mapping[str, float], roles: Mapping[str, str]) -> float:
    """Return torque per acceleration of the screw, A_eq in N m / (m/s^2); NaN if it is unknown."""
    J_m, J_c, J_GB, M_BS, rho, lead = find_values(joint, parameters, roles, *INERTIA)
    alpha = 2.0 * math.pi / (rho * lead)
    return alpha * (J_m + J_c + J_GB + M_BS / alpha**2)


def _compute_notch_delay(joint: str, parameters: Mapping[str, float], roles: Mapping[str, str]) -> float:
    """Return by how many s the notches delay the reference motion of a joint; 0 without any."""
    delay = 0.0
    for i in (1, 2):
        frequency, zeta = find_values(joint, parameters, roles, f"f_notch_{i}", f"zeta_notch_{i}")
        if frequency > 0.0:
            # that of the filter in docs/load-control.md, which does not depend on the motion
            delay += 2.0 * (1.0 - zeta) / (math.pi * frequency)
    return delay
