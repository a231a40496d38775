"""Tracking metrics of a joint, from the plant's true states at every communication point."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Vector
from ..recorders.metrics import Figures, Metrics, Shown
from ..recorders.recorder import Outline
from .limits import LimitWatch
from .roles import Named, all_joints, check_roles, given_joints, variable

SETTLED_AFTER = 0.3
"""Errors and torque count from this time on in s, or from convergence if that is later."""

CONVERGED_WITHIN = 0.05
"""Convergence is reached when the position error stays within this fraction of its initial value."""

STARTS_CONVERGED = 1e-6
"""An initial position error in m below this counts as none."""


@dataclass
class JointFigures:
    """One joint's part of metrics.json.

    `converged`: the last |x_L - x_d| is at most 5 % of the first, or 1e-6 m, no range was left, and the
    run went past 0.3 s. `left_limits` has the first value outside a range, if there was one.
    `convergence_time_s` is the last time at which |x_L - x_d| exceeds 5 % of its initial value; NaN where
    it does so in the end. Errors and `torque_effort_N_m` are the largest absolute values at or after that
    and 0.3 s; `torque_peak_N_m` is over the whole run. `saturated_fraction` is the part of all points at
    which controller or inverter is at a limit, `saturated_after_convergence` that of the points at or after
    convergence and 0.3 s. NaN where a run ended before.
    """

    converged: bool = False
    left_limits: Mapping[str, Any] | None = None
    position_error_m: float = 0.0
    velocity_error_m_s: float = 0.0
    torque_effort_N_m: float = 0.0
    torque_peak_N_m: float = 0.0
    convergence_time_s: float = 0.0
    observer_position_error_m: float = 0.0
    saturated_fraction: float = 0.0
    saturated_after_convergence: float = 0.0


_TRACKED = ("x_L", "x_d")
_NEEDED = (*_TRACKED, "v_L", "tau_m", "v_d")
_OPTIONAL = ("x_hat", "limited_control", "limited_inverter")

_SHOWN = (
    Shown("position_error_m", "position error", 1e6, "µm", "m"),
    Shown("velocity_error_m_s", "speed error", 1e3, "mm/s", "m/s"),
    Shown("torque_effort_N_m", "torque effort", 1.0, "N m"),
    Shown("torque_peak_N_m", "torque peak", 1.0, "N m"),
    Shown("convergence_time_s", "convergence time", 1e3, "ms"),
    Shown("observer_position_error_m", "observer position error", 1e6, "µm", "m"),
    Shown("saturated_fraction", "time at a limit", 100.0, "%"),
    Shown("saturated_after_convergence", "at a limit once converged", 100.0, "%"),
)

_CONVERGED = Shown("converged", "converged")

_TOO_SHORT = f"Too short to judge convergence: that takes more than {SETTLED_AFTER:g} s."


def joint_metrics(outline: Outline) -> "JointMetrics | None":
    """The metrics of all joints of a run; None where it has none. CommandError for wrong roles."""
    check_roles(outline.roles, outline.names, outline.parameters)
    metrics = JointMetrics(outline.names, outline.parameters, outline.roles)
    return metrics if metrics.joints else None


class JointMetrics(Metrics):
    """Tracking metrics by joint: what stands before the first dot of a signal's name.

    Joints without position, speed, torque and reference have no metrics, but those that are named in
    `roles` need no speed and no torque. `parameters` has the limits of the plants' ranges, by full name.
    """

    shown = (_CONVERGED, *_SHOWN)

    def __init__(
        self,
        names: Sequence[str],
        parameters: Mapping[str, float] | None = None,
        roles: Mapping[str, str] | None = None,
    ) -> None:
        column = Named((name, i + 1) for i, name in enumerate(names))
        self._joints: dict[str, _JointAccumulator] = {}
        given = roles or {}
        told = given_joints(given)
        for joint in all_joints(names, given):
            found = {role: variable(joint, role, column, given) for role in (*_NEEDED, *_OPTIONAL)}
            if all(found[role] is not None for role in (_TRACKED if joint in told else _NEEDED)):
                channels = {role: -1 if name is None else column[name] for role, name in found.items()}
                self._joints[joint] = _JointAccumulator(channels)
        self._limits = LimitWatch(self._joints, column, parameters or {}, given)

    @property
    def joints(self) -> list[str]:
        """The joints that have metrics."""
        return list(self._joints)

    @property
    def _is_short(self) -> bool:
        """Whether nobody can tell yet which joints converge."""
        return any(accumulator.is_short for accumulator in self._joints.values())

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        self._limits.write(rows)
        for accumulator in self._joints.values():
            accumulator.add(rows)
        self.shown = _SHOWN if self._is_short else (_CONVERGED, *_SHOWN)

    def memory(self) -> Any:
        """All that was computed so far, as plain numbers by joint."""
        joints = {joint: accumulator.memory() for joint, accumulator in self._joints.items()}
        return {"joints": joints, "left_limits": self._limits.memory()}

    def remember(self, memory: Any) -> None:
        """Go on from what was computed before."""
        for joint, accumulator in self._joints.items():
            accumulator.remember(memory["joints"][joint])
        self._limits.remember(memory["left_limits"])

    def remarks(self) -> Sequence[str]:
        """Which joints left their ranges, or did not converge, as far as the run was long enough to tell."""
        left = [sentence for joint in self._joints if (sentence := self._limits.sentence(joint))]
        late = [
            f"{joint} did not converge: its position error was {_length(a.first_error)} at the start and is "
            f"{_length(a.last_error)} at the end."
            for joint, a in self._joints.items()
            if not (a.is_short or a.is_within)
        ]
        return [*left, *late, *([_TOO_SHORT] if self._is_short else [])]

    def figures(self) -> Figures:
        """Metrics by joint, of what was recorded so far."""
        return {joint: self._figures(joint) for joint in self._joints}

    def _figures(self, joint: str) -> dict[str, Any]:
        accumulator, left = self._joints[joint], self._limits.left(joint)
        converged = accumulator.is_within and not accumulator.is_short and left is None
        found = accumulator.metrics()
        return asdict(replace(found, converged=converged, left_limits=None if left is None else asdict(left)))


class _JointAccumulator:
    """Largest values since convergence: an error beyond the 5 % band starts them anew.

    `first_error` and `last_error` are the position error in m of the first and of the last row so far.
    """

    def __init__(self, channels: Mapping[str, int]) -> None:
        self._channels = channels
        self.first_error = self.last_error = np.nan
        self._start = self._last_outside = 0.0
        self._last = np.nan
        self._largest = np.full(4, np.nan)
        self._peak = 0.0 if channels["tau_m"] >= 0 else np.nan
        self._rows = self._limited = 0
        self._settled = self._settled_limited = 0

    def add(self, rows: Vector) -> None:
        """Take the next rows (time first)."""
        t = rows[:, 0]
        self._last = float(t[-1])
        c = {name: rows[:, i] if i >= 0 else np.full(len(rows), np.nan) for name, i in self._channels.items()}
        error = np.abs(c["x_L"] - c["x_d"])
        self.last_error = float(error[-1])
        if self._rows == 0:
            self.first_error = float(error[0])
            self._start = self._last_outside = float(t[0])
        torque = np.abs(c["tau_m"])
        counted = np.stack([error, np.abs(c["v_L"] - c["v_d"]), torque, np.abs(c["x_L"] - c["x_hat"])])
        settled = t >= self._start + SETTLED_AFTER
        if self.first_error > STARTS_CONVERGED:
            outside = np.flatnonzero(error > CONVERGED_WITHIN * self.first_error)
            if len(outside):
                self._last_outside = float(t[outside[-1]])
                settled[: outside[-1]] = False
                self._largest[:] = np.nan
                self._settled = self._settled_limited = 0
        if settled.any():
            self._largest = np.fmax(self._largest, counted[:, settled].max(axis=1))
        self._peak = float(np.fmax(self._peak, torque.max()))
        self._rows += len(rows)
        limited = (c["limited_control"] > 0) | (c["limited_inverter"] > 0)
        self._limited += int(limited.sum())
        self._settled += int(settled.sum())
        self._settled_limited += int((limited & settled).sum())

    @property
    def is_within(self) -> bool:
        """Whether the last error is small enough for having converged."""
        return bool(self.last_error <= max(CONVERGED_WITHIN * self.first_error, STARTS_CONVERGED))

    @property
    def is_short(self) -> bool:
        """Whether nobody can tell yet if this converges."""
        return not self._last - self._start > SETTLED_AFTER

    def memory(self) -> list[float]:
        """All that changes, as plain numbers."""
        largest = [float(x) for x in self._largest]
        return [
            self.first_error,
            self.last_error,
            self._start,
            self._last,
            self._last_outside,
            self._peak,
            float(self._rows),
            float(self._limited),
            float(self._settled),
            float(self._settled_limited),
            *largest,
        ]

    def remember(self, memory: Sequence[float]) -> None:
        """Go on from what `memory` gave."""
        self.first_error, self.last_error, self._start, self._last, *others = map(float, memory)
        self._last_outside, self._peak, *counts = others[:6]
        self._rows, self._limited, self._settled, self._settled_limited = map(int, counts)
        self._largest[:] = others[6:]

    def metrics(self) -> JointFigures:
        """The metrics of all rows so far."""
        position, velocity, torque, observer = (float(x) for x in self._largest)
        return JointFigures(
            position_error_m=position,
            velocity_error_m_s=velocity,
            torque_effort_N_m=torque,
            torque_peak_N_m=self._peak,
            convergence_time_s=self._last_outside - self._start if self.is_within else np.nan,
            observer_position_error_m=observer,
            saturated_fraction=self._limited / max(self._rows, 1),
            saturated_after_convergence=self._settled_limited / self._settled if self._settled else np.nan,
        )


def _length(value: float) -> str:
    """A length in m as a person reads it."""
    if value < 1e-3:
        return f"{1e6 * value:.4g} µm"
    return f"{1e3 * value:.4g} mm" if value < 1.0 else f"{value:.4g} m"
